"""Rebuild the measured middle-point curve of EM II from the numbers that are printed about it.

The thesis shows the curve only as a figure.  In numbers it gives

    Fz(4 mm) = 0.546 N,    s/ȳ = 0.6835 over 0-4 mm (baseline NRMSE: standard deviation over mean),

and Fz(8 mm) = 1.283 N in another test.  Two numbers fix a one-parameter family: F = 0.546 (u/4)^p has
s/ȳ ≈ p / √(2p + 1), solved for p on the 0.1 mm grid of the triggers, without u = 0 (the source's relative
norms divide by the force there, so it cannot have been a point of them).  What is not known (whether u = 0 was a
point of the grid, its spacing, the divisor of s, the family itself) is varied; the largest deviation from the
central curve, at every depth, is the half-width of the band, given as standard uncertainty of each point.

A third printed number, mean|y − ȳ|/ȳ = 0.5916, is not used and shows how good the reconstruction is.

Run: python reconstruct.py [folder]   (writes the two CSV files, by default into measured/ next to this script)
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

DEEPEST, F_DEEPEST = 4.0, 0.546  # mm, N
RATIO, MAD_RATIO = 0.6835, 0.5916  # s/ȳ and mean|y − ȳ|/ȳ
VALIDATION = (8.0, 1.283)  # mm, N; another test
HALF_DIGIT = 0.0005  # N, the last printed digit

# F / F(4 mm) as a function of x = u / 4 mm and one parameter, with the bracket of that parameter.
FAMILIES: dict[str, tuple[Callable[[np.ndarray, float], np.ndarray], float, float]] = {
    "x^p": (lambda x, p: x**p, 1.0, 2.0),
    "a x^1.5 + (1-a) x": (lambda x, a: a * x**1.5 + (1 - a) * x, 0.0, 1.5),
    "a x^2 + (1-a) x": (lambda x, a: a * x**2 + (1 - a) * x, 0.0, 1.0),
}
CENTRAL = ("x^p", 0.1, False, 0)  # family, spacing in mm, u = 0 is a point, divisor n - ddof


def grid(spacing: float, with_zero: bool) -> np.ndarray:
    """Depths (n,) in mm up to 4."""
    n = round(DEEPEST / spacing)
    return DEEPEST * np.arange(0 if with_zero else 1, n + 1) / n


def solve(family: str, spacing: float, with_zero: bool, ddof: int) -> float:
    """The family's parameter for which s/ȳ on this grid is the printed one."""
    shape, low, high = FAMILIES[family]
    x = grid(spacing, with_zero) / DEEPEST

    def miss(q: float) -> float:
        y = shape(x, q)
        return float(np.std(y, ddof=ddof) / np.mean(y)) - RATIO

    return float(brentq(miss, low, high, xtol=1e-12))


def curve(assumption: tuple[str, float, bool, int], u: np.ndarray) -> np.ndarray:
    """Force (n,) in N at depths u (n,) in mm under one set of assumptions."""
    return F_DEEPEST * FAMILIES[assumption[0]][0](u / DEEPEST, solve(*assumption))


def reconstruct() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth (mm), force (N) and half-width of the band (N), each (40,)."""
    u = grid(0.1, with_zero=False)
    central = curve(CENTRAL, u)
    others = [curve(a, u) for a in product(FAMILIES, (0.1, 0.05), (False, True), (0, 1))]
    spread = np.max(np.abs(np.array(others) - central), axis=0)
    return u, central, np.hypot(spread, HALF_DIGIT)


def write(folder: Path) -> None:
    """Write middle_point.csv and force_8mm.csv."""
    u, force, half = reconstruct()
    mad = np.mean(np.abs(force - force.mean())) / force.mean()
    powers = [solve("x^p", *a) for a in product((0.1, 0.05), (False, True), (0, 1))]
    lines = [
        "# NOT A RECORD: a reconstruction. The measured curve is not printed in the source, a figure shows it.",
        f"# Built from two printed numbers: Fz(4 mm) = {F_DEEPEST} N, and standard deviation / mean = {RATIO}",
        "# over 0-4 mm (the baseline NRMSE), with F = 0.546 N (u / 4 mm)^p on a grid of 0.1 mm from 0.1 to 4 mm:",
        f"# p = {solve(*CENTRAL):.4f}. Grid with or without u = 0, 0.1 or 0.05 mm, divisor n or n-1 of the standard",
        f"# deviation: p = {min(powers):.3f} to {max(powers):.3f}; also the families a u^1.5 + b u and a u^2 + b u.",
        "# Fz_sigma_N: largest deviation of all these from the curve given, and half the last printed digit. It is",
        "# a half-width, taken for a standard uncertainty to be on the safe side; its errors are not independent",
        "# from point to point.",
        f"# Not used, for comparison: mean|y - mean|/mean is printed as {MAD_RATIO}; here it is {mad:.4f}.",
        "# Made by reconstruct.py; change that, not this file.",
        "depth_mm,Fz_N,Fz_sigma_N",
        *(f"{d:.1f},{f:.5f},{s:.5f}" for d, f, s in zip(u, force, half, strict=True)),
    ]
    validation = [
        "# One printed number of another, deeper test (0-8 mm): for validation only. The two tests do not join",
        "# into one curve: the source's figures place the same simulation differently against them.",
        "# Made by reconstruct.py; change that, not this file.",
        "depth_mm,Fz_N",
        f"{VALIDATION[0]:.1f},{VALIDATION[1]:.3f}",
    ]
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in (("middle_point.csv", lines), ("force_8mm.csv", validation)):
        (folder / name).write_text("\n".join(content) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "measured")
