"""Triangulated surfaces in files: STL (text and binary), PLY (text, both binary orders) and OBJ.

Small readers of their own: nothing but points and facets is wanted, and what is wrong is said by line or offset.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

SURFACE_FORMATS = ".stl, .ply, .obj"
STL_HEADER_BYTES, STL_FACET_BYTES = 84, 50  # bytes of a binary STL before its facets, and of each
PLY_NUMBER_TYPES: Mapping[str, str] = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}


def read_surface(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) in the file's unit and facets (m, 3) of a surface; corners with equal coordinates are one vertex.

    Polygons are cut into fans of triangles.  ValueError for a file that is missing, of another format or damaged.
    """
    file = Path(path)
    readers: Mapping[str, Callable[[bytes], tuple[np.ndarray, np.ndarray]]] = {
        ".stl": _stl,
        ".ply": _ply,
        ".obj": _obj,
    }
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise ValueError(f"has the unknown format {file.suffix!r}; choose from {SURFACE_FORMATS}")
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        raise ValueError("there is no such file") from None
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from error
    if not data.strip():
        raise ValueError("is empty: its file holds nothing")
    vertices, facets = reader(data)
    if not len(facets):
        raise ValueError("holds no facets")
    if not np.all(np.isfinite(vertices)):
        raise ValueError("holds coordinates that are no finite numbers")
    if facets.min() < 0 or facets.max() >= len(vertices):
        raise ValueError(f"has a facet that names vertex {int(facets.max())} of {len(vertices)}")
    return welded(vertices, facets)


def welded(vertices: np.ndarray, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The surface with one vertex for all of equal coordinates, none that no facet has, in the order of first use."""
    corners = vertices[facets.ravel()] + 0.0  # no negative zero
    _, first, inverse = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    rank = np.empty(len(first), int)
    order = np.argsort(first)
    rank[order] = np.arange(len(first))
    return corners[np.sort(first)], rank[inverse.ravel()].reshape(facets.shape)


def _stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    count = int.from_bytes(data[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")
    if len(data) >= STL_HEADER_BYTES and len(data) == STL_HEADER_BYTES + STL_FACET_BYTES * count:
        record = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(data, record, count, STL_HEADER_BYTES)["corner"].astype(float).reshape(-1, 3)
        return corners, np.arange(len(corners)).reshape(-1, 3)
    if not data.lstrip().startswith(b"solid") or b"\0" in data:  # many programs begin a binary one with "solid", too
        raise ValueError(
            f"is cut short or no STL: a binary one of {count} facets has "
            f"{STL_HEADER_BYTES + STL_FACET_BYTES * count} bytes, this file has {len(data)}"
        )
    words = data.split()
    at = [k for k, word in enumerate(words) if word == b"vertex"]
    try:
        corners = np.array([[float(v) for v in words[k + 1 : k + 4]] for k in at]).reshape(-1, 3)
    except ValueError:
        raise ValueError("has a vertex with other than three numbers (a text STL)") from None
    if len(corners) % 3:
        raise ValueError(f"has {len(corners)} vertices of facets: three a facet are expected, the file ends early")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    vertices: list[list[float]] = []
    facets: list[tuple[int, int, int]] = []
    for number, line in enumerate(data.splitlines(), 1):
        words = line.split()
        try:
            if words[:1] == [b"v"]:
                vertices.append([float(v) for v in words[1:4]])
            elif words[:1] == [b"f"]:
                named = [int(w.split(b"/")[0]) for w in words[1:]]
                loop = [k - 1 if k > 0 else len(vertices) + k for k in named]
                facets += [(loop[0], loop[k], loop[k + 1]) for k in range(1, len(loop) - 1)]
        except ValueError:
            raise ValueError(f"line {number} is no vertex or facet: {line.decode('latin-1')!r}") from None
    if any(len(v) != 3 for v in vertices):
        raise ValueError("a vertex has other than three coordinates")
    return np.array(vertices, float).reshape(-1, 3), np.array(facets, int).reshape(-1, 3)


Property = tuple[str, str, str]  # its name, its kind, the kind of its count where it is a list


def _ply(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    head, found, body = data.partition(b"end_header")
    if not data.startswith(b"ply") or not found:
        raise ValueError("a PLY begins with 'ply' and has a line 'end_header'")
    body = body[body.index(b"\n") + 1 :] if b"\n" in body else b""
    style = ""
    elements: list[tuple[str, int, list[Property]]] = []
    for line in head.decode("latin-1").splitlines():
        words = line.split()
        try:
            if words[:1] == ["format"]:
                style = words[1]
            elif words[:1] == ["element"]:
                elements.append((words[1], int(words[2]), []))
            elif words[:1] == ["property"]:
                listed = words[1] == "list"
                own = (
                    (words[4], PLY_NUMBER_TYPES[words[3]], PLY_NUMBER_TYPES[words[2]])
                    if listed
                    else (words[2], PLY_NUMBER_TYPES[words[1]], "")
                )
                elements[-1][2].append(own)
        except (IndexError, KeyError, ValueError):
            raise ValueError(f"its header has a line that is none of a PLY: {line!r}") from None
    orders = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    if style not in orders:
        raise ValueError(f"format {style!r} of its header; choose from {', '.join(orders)}")
    rows = _text_rows(body, elements) if style == "ascii" else _binary_rows(body, elements, orders[style])
    names = {name: [p[0] for p in own] for name, _, own in elements}
    if not {"x", "y", "z"} <= set(names.get("vertex", ())) or "face" not in names:
        raise ValueError("its header declares no vertices with x, y, z or no faces")
    vertices = np.column_stack([np.asarray(rows["vertex"][k], float) for k in "xyz"])
    loops = next((rows["face"][k] for k in ("vertex_indices", "vertex_index") if k in rows["face"]), None)
    if loops is None:
        raise ValueError("its faces have no list vertex_indices")
    fans = [(loop[0], loop[k], loop[k + 1]) for loop in loops for k in range(1, len(loop) - 1)]
    return vertices, np.array(fans, int).reshape(-1, 3)


def _text_rows(body: bytes, elements: Sequence[tuple[str, int, list[Property]]]) -> dict[str, dict[str, list]]:
    words, k = body.split(), 0
    out: dict[str, dict[str, list]] = {}
    try:
        for name, count, own in elements:
            columns: dict[str, list] = {p[0]: [] for p in own}
            for _ in range(count):
                for key, _, listed in own:
                    if not listed:
                        columns[key].append(float(words[k]))
                        k += 1
                        continue
                    size = int(words[k])
                    columns[key].append([int(float(w)) for w in words[k + 1 : k + 1 + size]])
                    k += 1 + size
            out[name] = columns
    except (IndexError, ValueError):
        raise ValueError(f"it ends early or holds no number at word {k + 1} after its header") from None
    return out


def _binary_rows(
    body: bytes, elements: Sequence[tuple[str, int, list[Property]]], order: str
) -> dict[str, dict[str, list]]:
    at = 0
    out: dict[str, dict[str, list]] = {}
    try:
        for name, count, own in elements:
            if not any(listed for _, _, listed in own):
                record = np.dtype([(key, order + kind) for key, kind, _ in own])
                table = np.frombuffer(body, record, count, at)
                out[name] = {key: table[key].tolist() for key, _, _ in own}
                at += count * record.itemsize
                continue
            columns: dict[str, list] = {p[0]: [] for p in own}
            for _ in range(count):
                for key, kind, listed in own:
                    size = 1
                    if listed:
                        size = int(np.frombuffer(body, order + listed, 1, at)[0])
                        at += np.dtype(listed).itemsize
                    values = np.frombuffer(body, order + kind, size, at)
                    at += values.nbytes
                    columns[key].append(values.tolist() if listed else values[0])
            out[name] = columns
    except ValueError:
        raise ValueError(f"it ends early: {len(body)} bytes after its header") from None
    return out
