"""Closed triangulated surfaces and the files of them, written by hand: nothing of the program's readers is used."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def sphere(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit sphere of 20 n² facets: an icosahedron whose edges are cut into n."""
    t = 0.5 * (1.0 + 5.0**0.5)
    corners = np.array([(0, s, w) for s in (-1, 1) for w in (-t, t)], float)
    corners = np.vstack([np.roll(corners, k, axis=1) for k in range(3)])
    near = np.linalg.norm(corners[:, None] - corners[None], axis=-1) < 2.1
    faces = [
        (a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] and near[b, c] and near[a, c]
    ]
    points, facets = [], []
    for a, b, c in faces:
        if np.linalg.det(corners[[a, b, c]]) < 0.0:
            b, c = c, b
        index = {}
        for i in range(n + 1):
            for j in range(n + 1 - i):
                index[i, j] = len(points)
                points.append(((n - i - j) * corners[a] + i * corners[b] + j * corners[c]) / n)
        for i in range(n):
            for j in range(n - i):
                facets.append((index[i, j], index[i + 1, j], index[i, j + 1]))
                if i + j < n - 1:
                    facets.append((index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]))
    x = np.array(points)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    _, first, inverse = np.unique(np.round(x, 9), axis=0, return_index=True, return_inverse=True)
    return x[first], inverse.ravel()[np.array(facets)]


def ellipsoid(n: int, axes: tuple[float, float, float] = (60.0, 35.0, 35.0)) -> tuple[np.ndarray, np.ndarray]:
    """The same, stretched to semi-axes."""
    x, facets = sphere(n)
    return x * np.array(axes), facets


def torus(large: float, small: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Torus about z: circle of radius `small` around one of radius `large`, 3n by n quadrangles cut in two."""
    u, v = np.meshgrid(np.arange(3 * n), np.arange(n), indexing="ij")
    a, b = 2.0 * np.pi * u / (3 * n), 2.0 * np.pi * v / n
    r = large + small * np.cos(b)
    x = np.stack([r * np.cos(a), r * np.sin(a), small * np.sin(b)], axis=-1).reshape(-1, 3)

    def at(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return (i % (3 * n) * n + j % n).ravel()

    p, q, r_, s = at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)
    return x, np.vstack([np.column_stack([p, q, r_]), np.column_stack([p, r_, s])])


def write_stl(path: Path, x: np.ndarray, facets: np.ndarray, text: bool = False) -> Path:
    """An STL with the numbers to the last bit in the text flavour, in single precision in the binary one."""
    if text:
        lines = ["solid made"]
        for f in facets:
            lines += ["facet normal 0 0 0", " outer loop"]
            lines += [f"  vertex {' '.join(repr(float(v)) for v in x[k])}" for k in f]
            lines += [" endloop", "endfacet"]
        path.write_text("\n".join([*lines, "endsolid made", ""]))
        return path
    record = np.zeros(len(facets), np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")]))
    record["corner"] = x[facets]
    path.write_bytes(b"solid, though it is binary".ljust(80) + len(facets).to_bytes(4, "little") + record.tobytes())
    return path


def write_ply(path: Path, x: np.ndarray, facets: np.ndarray, order: str = "") -> Path:
    """A PLY: text, or binary in the byte `order` < or >; with a property and an element that nobody wants."""
    style = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {style} 1.0\ncomment made\nelement vertex {len(x)}\nproperty double x\nproperty double y\n"
    head += "property double z\nproperty uchar red\nelement dust 2\nproperty float size\n"
    head += f"element face {len(facets)}\nproperty list uchar int vertex_indices\nend_header\n"
    if not order:
        rows = [f"{' '.join(repr(float(v)) for v in p)} 7" for p in x] + ["0.5", "0.25"]
        rows += [f"3 {' '.join(map(str, f))}" for f in facets]
        path.write_text(head + "\n".join(rows) + "\n")
        return path
    points = np.zeros(len(x), np.dtype([("x", order + "f8", 3), ("red", "u1")]))
    points["x"], points["red"] = x, 7
    faces = np.zeros(len(facets), np.dtype([("count", "u1"), ("index", order + "i4", 3)]))
    faces["count"], faces["index"] = 3, facets
    path.write_bytes(head.encode() + points.tobytes() + np.array([0.5, 0.25], order + "f4").tobytes() + faces.tobytes())
    return path


def write_obj(path: Path, x: np.ndarray, facets: np.ndarray) -> Path:
    """An OBJ with normals and texture places that nobody wants."""
    rows = ["# made", "o body", "vt 0 0", "vn 0 0 1"]
    rows += [f"v {' '.join(repr(float(v)) for v in p)}" for p in x]
    rows += [f"f {' '.join(f'{k + 1}/1/1' for k in f)}" for f in facets]
    path.write_text("\n".join([*rows, ""]))
    return path
