"""The organ and its data: python studies/organ_surface/make_surface.py [--data] [--picture]

A kidney-like closed surface by formula, no scan of anybody: a ball of facets becomes an ellipsoid of 110 x 56 x 40 mm,
is bent, thickened towards one pole and dented at the hilum.  Without options kidney.stl is written (3 380 facets).
--data makes the "measured" curves with the backend itself, on the same formula in 20 480 facets and the standard mesh,
with noise: what study.toml identifies on 3 380 facets and the coarse mesh.  --picture draws kidney.png.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
HALF = np.array([55.0, 28.0, 20.0])  # half extents of the ellipsoid, mm
BEND, PLUMP = 14.0, 0.10  # mm at the poles; share of the thickness
HILUM = 11.0, 15.0, 11.0  # depth of the dent, its half widths along x and z, mm
TRUTH = {"mu": 0.0087, "D1": 24.0}  # MPa, 1/MPa
TESTS = {
    "middle": {"point": [-12.0, -6.0]},
    "pole": {"point": [34.0, 4.0], "direction": "normal"},
    "beside_hilum": {"point": [3.0, 11.0], "direction": "normal"},
}
DEPTH, READINGS = 2.5, 26  # mm
NOISE, GAIN = 1e-3, 0.004  # N, share
SEED = 20261126


def ball(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit ball of 20 n² facets: an icosahedron whose edges are cut into n, (vertices, facets)."""
    t = 0.5 * (1.0 + 5.0**0.5)
    corners = np.array([(0, s, w) for s in (-1, 1) for w in (-t, t)], float)
    corners = np.vstack([np.roll(corners, k, axis=1) for k in range(3)])
    near = np.linalg.norm(corners[:, None] - corners[None], axis=-1) < 2.1
    points, facets = [], []
    for a in range(12):
        for b in range(a):
            for c in range(b):
                if not (near[a, b] and near[b, c] and near[a, c]):
                    continue
                one, two, three = corners[[a, b, c] if np.linalg.det(corners[[a, b, c]]) > 0.0 else [a, c, b]]
                index = {}
                for i in range(n + 1):
                    for j in range(n + 1 - i):
                        index[i, j] = len(points)
                        points.append(((n - i - j) * one + i * two + j * three) / n)
                for i in range(n):
                    for j in range(n - i):
                        facets.append((index[i, j], index[i + 1, j], index[i, j + 1]))
                        if i + j < n - 1:
                            facets.append((index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]))
    x = np.array(points)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    _, first, inverse = np.unique(np.round(x, 9), axis=0, return_index=True, return_inverse=True)
    return x[first], inverse.ravel()[np.array(facets)]


def kidney(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (mm) and facets of the organ, lying on its flat side: x along it, the hilum towards +y, z up from 0."""
    unit, facets = ball(n)
    x, y, z = (unit * HALF).T
    along = x / HALF[0]
    y, z = y * (1.0 + PLUMP * along), z * (1.0 + PLUMP * along)
    towards = np.clip(unit[:, 1], 0.0, None) ** 2
    depth, wide, high = HILUM
    y = y - depth * towards * np.exp(-((x / wide) ** 2) - (z / high) ** 2) + BEND * along**2
    out = np.column_stack([x, y, z])
    return out - [0.0, 0.0, out[:, 2].min()], facets


def write_stl(path: Path, x: np.ndarray, facets: np.ndarray) -> None:
    """A binary STL."""
    record = np.zeros(len(facets), np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")]))
    record["corner"] = x[facets]
    path.write_bytes(b"kidney by formula, mm".ljust(80) + len(facets).to_bytes(4, "little") + record.tobytes())


def data() -> None:
    """The curves of the three tests, from finer facets and a finer mesh than those of the study."""
    from fem_backend.backend import BACKEND
    from rso.contract import Case, Programme

    rng = np.random.default_rng(SEED)
    asked = tuple(np.round(np.linspace(0.25, DEPTH, 10), 12))
    depth = np.linspace(0.0, DEPTH, READINGS)
    fine = HERE / "kidney_fine.stl"
    write_stl(fine, *kidney(32))
    held = {"below": 4.0}
    body = {"shape": "surface", "file": str(fine), "unit": "mm", "held": held}
    try:
        for name, where in TESTS.items():
            settings = {"specimen": body, "indenter": {"shape": "sphere", "radius": 3.0}, **where, "derivatives": False}
            found = BACKEND(TRUTH, Case(name, Programme.ramp(asked), {**settings, "mesh": {"level": "standard"}}))
            root = np.concatenate([[0.0], found.channels["Fz"]]) / np.maximum(np.r_[1.0, asked], 1e-9) ** 1.5
            root[0] = root[1]  # F/u^1.5 is smooth and has a limit
            force = np.interp(depth, np.r_[0.0, asked], root) * depth**1.5
            rows = [
                np.column_stack(
                    [
                        np.full(READINGS, k),
                        depth,
                        force * (1.0 + GAIN * rng.normal()) + NOISE * rng.normal(size=READINGS),
                    ]
                )
                for k in (1, 2, 3)
            ]
            text = "\n".join(f"{int(k)},{u:.3f},{F:.5f}" for k, u, F in np.vstack(rows))
            (HERE / "measured" / f"{name}.csv").write_text(f"repeat,depth_mm,Fz_N\n{text}\n", encoding="utf-8")
            print(f"{name}: {found.channels['Fz'][-1]:.4f} N at {DEPTH} mm, {found.info['cpu_s']:.0f} s", flush=True)
    finally:
        fine.unlink()


def picture() -> None:
    """The organ, the held region and the three places."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    from fem_backend.simulation import experiment

    x, facets = kidney(24)
    corners = x[facets]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    light = 0.5 + 0.5 * np.clip(normal @ np.array([0.2, 0.55, 0.81]), 0.0, 1.0)
    colour = np.where((corners[:, :, 2] < 4.0).all(1)[:, None], [0.45, 0.5, 0.55], [0.85, 0.55, 0.5]) * light[:, None]
    figure = plt.figure(figsize=(7.0, 3.4))
    axes = figure.add_axes((0.0, -0.15, 1.0, 1.3), projection="3d", computed_zorder=False)
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colour, edgecolors=colour, linewidths=0.2))
    body = {"shape": "surface", "file": str(HERE / "kidney.stl"), "unit": "mm", "held": {"below": 4.0}}
    specimen = experiment.read_settings({"specimen": body, "point": TESTS["middle"]["point"]}).specimen
    for name, where in TESTS.items():
        on, out = specimen.above(*where["point"])
        way = out if where.get("direction") == "normal" else np.array([0.0, 0.0, 1.0])
        tail = on + 16.0 * way
        axes.quiver(*tail, *(-16.0 * way), color="black", arrow_length_ratio=0.25, linewidth=1.2)
        axes.text(*(on + 18.5 * way), name.replace("_", " "), ha="center", fontsize=9)
    axes.set_xlim(-56, 56), axes.set_ylim(-34, 34), axes.set_zlim(0, 46)
    axes.set_box_aspect((112, 68, 46), zoom=1.15)
    axes.view_init(12, 46)
    axes.set_axis_off()
    figure.savefig(HERE / "kidney.png", dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", action="store_true", help="make the curves, too (some minutes)")
    parser.add_argument("--picture", action="store_true", help="draw kidney.png, too")
    asked = parser.parse_args()
    write_stl(HERE / "kidney.stl", *kidney(13))
    if asked.data:
        data()
    if asked.picture:
        picture()


if __name__ == "__main__":
    main()
