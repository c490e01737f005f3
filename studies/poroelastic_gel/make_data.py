"""Writes measured/*.csv: pucks of a gel full of water between smooth plates; finite differences in r.

Radial flow in unconfined compression (Armstrong, Lai and Mow 1984, J. Biomech. Eng. 106, 165), small strains, and no
code of `fem_backend`.  With the radial displacement u(r, t), the axial strain e(t), H = K + 4 μ/3 and λ = K − 2 μ/3:

    H (r⁻¹ (r u)′)′ = (u̇ + r ė/2)/k,   u(0) = 0,   H u′ + λ (u/r + e) = 0 at the side,
    F = −2π ∫ (H e + λ r⁻¹ (r u)′ − p) r dr,   p = H (r⁻¹ (r u)′ − its value at the side).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

MU, NU, PERMEABILITY = 0.010, 0.2, 9.0  # MPa, 1, mm⁴/(N s): the truth
K = 2.0 * MU * (1.0 + NU) / (3.0 * (1.0 - 2.0 * NU))
HEIGHT, DEPTH, SPEED, REST = 3.0, 0.09, 0.3, 100.0  # mm, mm, mm/s, s
PUCKS = {"narrow": 2.0, "wide": 4.0}  # radius, mm
NOISE, REPEATS, SEED = 5e-5, 3, 20261127  # N
POINTS, GROWTH, FIRST = 200, 1.02, 1e-3  # of the radius; of the steps in time, s


def force(times: np.ndarray, radius: float) -> np.ndarray:
    """Force (N) at `times` (s) since first contact."""
    H, lame, k, n = K + 4.0 / 3.0 * MU, K - 2.0 / 3.0 * MU, PERMEABILITY, POINTS
    r, h = np.linspace(0.0, radius, n + 1), radius / n
    i, middle = np.arange(1, n), 0.5 * (r[1:] + r[:-1])
    A = np.zeros((n + 1, n + 1))
    A[i, i + 1], A[i, i - 1] = r[i + 1] / (r[i] + h / 2) / h**2, r[i - 1] / (r[i] - h / 2) / h**2
    A[i, i] = -r[i] * (1.0 / (r[i] + h / 2) + 1.0 / (r[i] - h / 2)) / h**2
    ramp = DEPTH / SPEED
    late, step = [ramp], FIRST
    while late[-1] < times.max():
        late.append(late[-1] + step)
        step *= GROWTH
    moments = np.concatenate([np.linspace(0.0, ramp, 301)[:-1], late])
    strain = -np.minimum(moments * SPEED, DEPTH) / HEIGHT
    u, found = np.zeros(n + 1), [0.0]
    for m in range(1, len(moments)):
        M = np.eye(n + 1) - (moments[m] - moments[m - 1]) * H * k * A
        b = u - 0.5 * r * (strain[m] - strain[m - 1])
        M[[0, n]], b[0], b[n] = 0.0, 0.0, -lame * strain[m]
        M[0, 0], M[n, n - 2 :] = 1.0, np.array([0.5, -2.0, 1.5]) * H / h
        M[n, n] += lame / radius
        u = np.linalg.solve(M, b)
        dilated = np.diff(r * u) / h / middle
        side = (1.5 * u[n] - 2.0 * u[n - 1] + 0.5 * u[n - 2]) / h + u[n] / radius
        axial = H * strain[m] + lame * dilated - H * (dilated - side)
        found.append(-2.0 * np.pi * h * float(axial @ middle))
    return np.interp(times, moments, found)


def main() -> None:
    """Write a file for each puck: repeats of a ramp and a rest."""
    random = np.random.default_rng(SEED)
    ramp = DEPTH / SPEED
    loading = np.linspace(0.0, ramp, 16)
    resting = ramp + np.geomspace(0.3, REST, 30)
    times = np.concatenate([loading, resting])
    depth = np.minimum(times * SPEED, DEPTH)
    for name, radius in PUCKS.items():
        exact = force(times, radius)
        lines = ["repeat,segment,time_s,depth_mm,Fz_N"]
        for repeat in range(1, REPEATS + 1):
            measured = exact + NOISE * random.normal(size=len(exact))
            words = ["loading"] * len(loading) + ["hold"] * len(resting)
            lines += [
                f"{repeat},{word},{t:.4f},{d:.5f},{F:.7f}"
                for word, t, d, F in zip(words, times, depth, measured, strict=True)
            ]
        path = Path(__file__).parent / "measured" / f"{name}.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
