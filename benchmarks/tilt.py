"""What a tilt does beside what the change of the surface's slope says to first order: python benchmarks/tilt.py

    ΔF_x = k (s' − s),   k = F_x / s at (20, 0),   s = −∂z/∂x of the surface where the ball's axis meets it

is how the blind generator made tilts in its first four rounds, and nearly what a crosstalk does; printed is ΔF_x of
finite elements over it.  Half models, neo-Hookean, μD₁ = 0.2; about a minute.
"""

from __future__ import annotations

import fem_backend  # noqa: F401 - before numpy: it sees to one thread, and waiting threads count as CPU time

# isort: split
import argparse

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

SEMI_AXES = np.array([60.0, 35.0, 35.0])
TRAVELS = (1.0, 2.0, 3.0, 4.0)


def slope(x: float, angle: float) -> float:
    """−∂z/∂x of the ellipsoid at (x, 0), turned by an angle (rad) about y through its centre."""
    c, s = np.cos(angle), np.sin(angle)
    Q = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    A = Q @ np.diag(SEMI_AXES**-2.0) @ Q.T
    b = A[2, 0] * x
    z = (-b + np.sqrt(b * b - A[2, 2] * (A[0, 0] * x * x - 1.0))) / A[2, 2]
    g = A @ np.array([x, 0.0, z])
    return float(g[0] / g[2])


def lateral(x: float, level: str, **knobs: float) -> np.ndarray:
    """Fx (4,) N at the travels."""
    settings = {"mesh": {"level": level}, "point": [x, 0.0]}
    values = {"mu": 0.01, "D1": 20.0, **knobs}
    return np.asarray(BACKEND(values, Case("tilt", Programme.ramp(TRAVELS, 0.5), settings)).channels["Fx"])


def main() -> None:
    """Both places."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--degrees", type=float, default=2.5)
    parser.add_argument("--level", default="standard")
    options = parser.parse_args()
    angle = np.deg2rad(options.degrees)
    straight = {x: lateral(x, options.level) for x in (0.0, 20.0)}
    k = straight[20.0] / slope(20.0, 0.0)
    print("travel mm                ", *(f"{u:7.1f}" for u in TRAVELS))
    for x, before in straight.items():
        change = lateral(x, options.level, tilt_y=options.degrees) - before
        ratio = change / (k * (slope(x, angle) - slope(x, 0.0)))
        print(f"({x:4.1f}, 0): dFx over k ds   ", *(f"{v:7.3f}" for v in ratio))


if __name__ == "__main__":
    main()
