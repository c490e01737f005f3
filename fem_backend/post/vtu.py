"""One step as a VTU file, for ParaView and everything that reads VTK."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from fem_backend.kinematics.bodies import Body

VTK_QUADRATIC_TETRA = 24  # VTK's cell type; its mid-edge nodes 01, 12, 02, 03, 13, 23 come in our order
TURNED_NODE_ORDER = [0, 2, 1, 3, 6, 5, 4, 7, 9, 8]  # the same cell seen from the other side


def write_vtu(
    path: Path | str,
    body: Body,
    u: np.ndarray,
    point_data: Mapping[str, np.ndarray] | None = None,
    cell_data: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Reference mesh with `displacement` u (n, 3) mm and further arrays (n, …), (m, …); tensors (…, 3, 3) as 9 columns.

    Positions are the undeformed ones: "Warp By Vector" shows the deformed body.  Plain XML with base64 arrays.
    Raises ValueError for an array of another length, or one that is not finite.
    """
    root = ElementTree.Element(
        "VTKFile", type="UnstructuredGrid", version="1.0", byte_order="LittleEndian", header_type="UInt64"
    )
    grid = ElementTree.SubElement(root, "UnstructuredGrid")
    n, m = len(body.nodes), len(body.cells)
    piece = ElementTree.SubElement(grid, "Piece", NumberOfPoints=str(n), NumberOfCells=str(m))
    _array(ElementTree.SubElement(piece, "Points"), "Points", body.nodes, n)
    cells = ElementTree.SubElement(piece, "Cells")
    X = body.nodes[body.cells[:, :4]]
    inward = np.linalg.det(X[:, 1:] - X[:, :1]) < 0.0
    oriented = np.where(inward[:, None], body.cells[:, TURNED_NODE_ORDER], body.cells).astype(np.int64)
    _array(cells, "connectivity", oriented.ravel(), oriented.size)
    _array(cells, "offsets", np.arange(10, 10 * m + 1, 10, dtype=np.int64), m)
    _array(cells, "types", np.full(m, VTK_QUADRATIC_TETRA, np.uint8), m)
    for tag, data, count in (
        ("PointData", {"displacement": u, **(point_data or {})}, n),
        ("CellData", cell_data or {}, m),
    ):
        section = ElementTree.SubElement(piece, tag)
        for name, values in data.items():
            _array(section, name, np.asarray(values), count)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _array(parent: ElementTree.Element, name: str, values: np.ndarray, count: int) -> None:
    if len(values) != count:
        raise ValueError(f"{name}: {len(values)} rows instead of {count}")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{name}: not finite")
    types = {"f": "Float64", "i": "Int64", "u": "UInt8", "b": "UInt8"}
    kind = types[values.dtype.kind]
    plain = np.ascontiguousarray(values.reshape(count, -1), dtype=np.dtype(kind.lower()).newbyteorder("<"))
    data = plain.tobytes()
    element = ElementTree.SubElement(
        parent, "DataArray", type=kind, Name=name, NumberOfComponents=str(plain.shape[1]), format="binary"
    )
    element.text = base64.b64encode(np.array(len(data), "<u8").tobytes() + data).decode()
