"""Which smooth surface stands for the facets of a scan: python benchmarks/surface_facets.py

An ellipsoid of 60 x 35 x 35 mm in 1 280 to 20 480 facets, with exact vertices and with a scatter of 0.05 mm.  Printed
are the largest errors of place (mm) and normal (degrees) of

* facets, and facets with normals interpolated between the vertices (Phong): contact takes its gap from places, so
  smoothed normals alone leave the error of the facets;
* PN triangles, cubic patches from vertices and vertex normals (Vlachos et al. 2001), which interpolate scatter;
* jets blended over the facets (fem_backend/meshing/smooth_surface.py), what is used.
"""

from __future__ import annotations

import sys
from pathlib import Path

from fem_backend import geometry
from fem_backend.meshing.smooth_surface import SmoothSurface, vertex_normals

import numpy as np  # isort: skip

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "fem_backend"))
import scan_files  # isort: skip

AXES = np.array([60.0, 35.0, 35.0])
SCATTER = 0.05  # mm, along the normal


def pn_triangle(P: np.ndarray, N: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and unit normals of cubic patches with corners P, corner normals N (n, 3, 3) at b (n, 3)."""

    def edge(i: int, j: int) -> np.ndarray:
        lift = np.einsum("ni,ni->n", P[:, j] - P[:, i], N[:, i])
        return (2.0 * P[:, i] + P[:, j] - lift[:, None] * N[:, i]) / 3.0

    inner = [edge(i, j) for i in range(3) for j in range(3) if i != j]
    middle = sum(inner) / 6.0
    middle = middle + (middle - P.mean(1)) / 2.0
    terms = {(3, 0, 0): P[:, 0], (0, 3, 0): P[:, 1], (0, 0, 3): P[:, 2], (1, 1, 1): 6.0 * middle}
    for i in range(3):
        for j in (k for k in range(3) if k != i):
            power = [0, 0, 0]
            power[i], power[j] = 2, 1
            terms[tuple(power)] = 3.0 * edge(i, j)

    def at(c: np.ndarray) -> np.ndarray:
        return sum(np.prod(c**power, axis=1)[:, None] * point for power, point in terms.items())

    h = 1e-5
    along = [(at(b + h * e) - at(b - h * e)) / (2.0 * h) for e in np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])]
    normal = np.cross(*along)
    return at(b), normal / np.linalg.norm(normal, axis=1, keepdims=True)


def main() -> None:
    exact = geometry.EllipsoidShape(*AXES)
    rng = np.random.default_rng(0)
    asked = rng.normal(size=(3000, 3))
    asked *= AXES / np.linalg.norm(asked, axis=1, keepdims=True)
    print(f"{'facets':>7} {'scatter':>8}   " + "".join(f"{n:>22}" for n in ("facets", "Phong", "PN triangles", "jets")))
    for scatter in (0.0, SCATTER):
        for n in (8, 16, 32):
            x, f = scan_files.ellipsoid(n)
            out = x / AXES**2
            x = x + scatter * rng.normal(size=(len(x), 1)) * out / np.linalg.norm(out, axis=1, keepdims=True)
            surface, normals = SmoothSurface.through(x, f), vertex_normals(x, f)
            facet, b, _ = surface.tree.nearest(asked)
            P, N = x[f[facet]], normals[f[facet]]
            flat = np.einsum("na,nai->ni", b, P)
            face = np.cross(P[:, 1] - P[:, 0], P[:, 2] - P[:, 0])
            phong = np.einsum("na,nai->ni", b, N)
            y = surface.project(flat)
            found = [(flat, face), (flat, phong), pn_triangle(P, N, b), (y, surface.normals(y))]
            line = ""
            for place, normal in found:
                right = place / AXES**2
                cosine = np.einsum("ni,ni->n", right, normal) / np.linalg.norm(right, axis=1)
                angle = np.degrees(np.arccos(np.clip(cosine / np.linalg.norm(normal, axis=1), -1.0, 1.0))).max()
                line += f"{np.abs(exact.depth(place)).max():13.1e} {angle:8.3f}"
            print(f"{len(f):7d} {scatter:8.2f}   {line}")


if __name__ == "__main__":
    main()
