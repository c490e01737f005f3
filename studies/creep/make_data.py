"""Write the "measured" records of this study: linear viscoelasticity in closed form, integrated here, with noise.

    python studies/creep/make_data.py

A ball of R = 3 mm presses an incompressible half-space of G(t) = μ (1 − g + g exp(−t/τ)), μ = 0.01 MPa, g = 0.45,
τ = 6 s, at 0.1 mm/s until a force is met, which is then held for a minute.  While the contact grows (Lee & Radok 1960,
J. Appl. Mech. 27, 438)

    F + τ F′ = (16/3) √R (μ (1 − g) x + τ μ x′),   x = δ^{3/2},

integrated by an explicit method of order eight; nothing of this project is imported.  Noise: 0.5 µm and 0.02 mN white,
a contact that is found 1 µm late and a cell that shows 0.2 % too much.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

FOLDER = Path(__file__).parent
R, MU, G, TAU = 3.0, 0.01, 0.45, 6.0  # mm, MPa, 1, s
SPEED, HOLD = 0.1, 60.0  # mm/s, s
FORCES = {"held_8_mN": 8e-3, "held_4_mN": 4e-3}
DEPTH_NOISE, FORCE_NOISE, LATE, GAIN = 5e-4, 2e-5, 1e-3, 2e-3  # mm, N, mm, 1
SIZE = 16.0 / 3.0 * np.sqrt(R)


def pressed(force: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (s), depth (mm) and force (N) of a ramp of travel until a force is met."""

    def rate(t: float, F: np.ndarray) -> np.ndarray:
        x, dx = (SPEED * t) ** 1.5, 1.5 * SPEED * np.sqrt(SPEED * t)
        return SIZE * (MU * (1.0 - G) * x / TAU + MU * dx) - F / TAU

    met = lambda t, F: F[0] - force  # noqa: E731
    met.terminal = True  # type: ignore[attr-defined]
    way = solve_ivp(rate, (0.0, 100.0), [0.0], "DOP853", events=met, rtol=1e-10, atol=1e-16, dense_output=True)
    t = np.linspace(way.t[-1] / 40.0, way.t[-1], 40)
    return t, SPEED * t, way.sol(t)[0]


def crept(force: float, depth: float, since: np.ndarray) -> np.ndarray:
    """Depth (mm) since the force was met, while it is held: F′ = 0."""
    rate = lambda _, x: (force / (SIZE * MU) - (1.0 - G) * x) / TAU  # noqa: E731
    rest = solve_ivp(rate, (0.0, since[-1]), [depth**1.5], "DOP853", t_eval=since, rtol=1e-10, atol=1e-16)
    return rest.y[0] ** (2.0 / 3.0)


def main() -> None:
    """One file for each force."""
    rng = np.random.default_rng(44)
    (FOLDER / "measured").mkdir(exist_ok=True)
    since = np.concatenate([np.arange(0.1, 2.0, 0.1), np.arange(2.0, 10.0, 0.25), np.arange(10.0, HOLD + 0.5, 1.0)])
    for name, force in FORCES.items():
        t, u, F = pressed(force)
        time, depth = np.append(t, t[-1] + since), np.append(u, crept(force, u[-1], since))
        shown = (1.0 + GAIN) * np.append(F, np.full(len(since), force)) + FORCE_NOISE * rng.standard_normal(len(time))
        read = depth - LATE + DEPTH_NOISE * rng.standard_normal(len(time))
        segment = np.where(np.arange(len(time)) < len(t), "loading", "creep")
        rows = ["time_s,depth_mm,Fz_N,segment"]
        rows += [f"{a:.4f},{b:.5f},{c:.6f},{s}" for a, b, c, s in zip(time, read, shown, segment, strict=True)]
        (FOLDER / "measured" / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
