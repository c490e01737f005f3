"""Draws docs/figures/sketches/*.svg, small sketches of what can be modelled: `python docs/figures/sketches.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fem_backend.backend import BACKEND

FOLDER = Path(__file__).parent / "sketches"
WIDTH, HEIGHT, PAD = 168.0, 110.0, 4.0
FINEST = 0.4  # px: points that lie closer to a straight line are left out
LOOKS = {  # fill, stroke
    "specimen": ("#e3ded6", "#5b564e"),
    "layer": ("#cfc6b8", "#5b564e"),
    "indenter": ("#0b5a7d", "#0b5a7d"),
    "held": ("none", "#23272b"),
    "support": ("none", "#23272b"),
}
BALL = {"shape": "sphere", "radius": 3.0}
BONDED = {"kind": "bonded"}
EXPERIMENTS: dict[str, dict[str, Any]] = {
    "slab": {"specimen": {"shape": "slab", "thickness": 5.0}, "indenter": BALL, "support": BONDED},
    "layers": {
        "specimen": {"shape": "slab", "thickness": 5.0, "layers": [{"thickness": 1.0, "ratio": 5.0}]},
        "indenter": {"shape": "flat", "radius": 2.0, "fillet": 0.2},
        "support": BONDED,
    },
    "puck": {
        "specimen": {"shape": "cylinder", "radius": 6.0, "height": 5.0},
        "indenter": {"shape": "plate", "contact": "slip"},
        "support": {"kind": "plate"},
    },
    "well": {
        "specimen": {"shape": "cylinder", "radius": 6.0, "height": 5.0},
        "indenter": {"shape": "cone", "half_angle": 60.0, "tip_radius": 0.2},
        "support": {"kind": "well"},
    },
    "half_space": {"specimen": {"shape": "half_space"}, "indenter": BALL},
    "organ": {
        "specimen": {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]},
        "indenter": {"shape": "sphere", "radius": 8.0},
        "support": {"kind": "bowl", "clearance": 1.0},
    },
}


def svg(settings: dict[str, Any]) -> str:
    """The section of an experiment as a small SVG."""
    drawn = [d for d in BACKEND.sketch(settings, 0.0).drawn if d.role in LOOKS and len(d.points) > 1]
    every = np.vstack([np.asarray(d.points, float) for d in drawn])
    low, high = every.min(0), every.max(0)
    scale = min((WIDTH - 2 * PAD) / (high[0] - low[0]), (HEIGHT - 2 * PAD) / (high[1] - low[1]))
    middle = 0.5 * (low + high)
    body = []
    for d in drawn:
        p = (np.asarray(d.points, float) - middle) * scale * [1.0, -1.0] + [WIDTH / 2, HEIGHT / 2]
        fill, stroke = LOOKS[d.role]
        close = "Z" if fill != "none" else ""
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in thinned(p)) + close
        wide = 1.2 if fill != "none" else 3.0
        body.append(f'<path d="{path}" fill="{fill}" stroke="{stroke}" stroke-width="{wide}"/>')
    size = f'width="{WIDTH:g}" height="{HEIGHT:g}" viewBox="0 0 {WIDTH:g} {HEIGHT:g}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n' + "\n".join(body) + "\n</svg>\n"


def thinned(p: np.ndarray) -> np.ndarray:
    """The points (n, 2) of a line without those that lie on it within FINEST (Douglas and Peucker 1973)."""
    if len(p) < 3:
        return p
    way = p[-1] - p[0]
    long = np.hypot(*way)
    off = p - p[0]
    far = np.abs(off[:, 0] * way[1] - off[:, 1] * way[0]) / long if long > 1e-9 else np.hypot(*off.T)
    k = int(far.argmax())
    if far[k] <= FINEST:
        return p[[0, -1]]
    return np.vstack([thinned(p[: k + 1])[:-1], thinned(p[k:])])


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, settings in EXPERIMENTS.items():
        (FOLDER / f"{name}.svg").write_text(svg(settings), encoding="utf-8")
