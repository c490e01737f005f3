"""Structured designs: factorial, central composite, Box–Behnken; fixed counts, no chance in them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Literal

import numpy as np

Star = Literal["circumscribed", "inscribed", "face"]
Alpha = float | Literal["rotatable", "orthogonal"]

# Resolution V fractions: (Box, Hunter & Hunter 2005, table 6.22): extra factor = product of these base factors.
_GENERATORS = {5: ((0, 1, 2, 3),), 6: ((0, 1, 2, 3, 4),), 7: ((0, 1, 2, 3, 4, 5),), 8: ((0, 1, 2, 3), (0, 1, 4, 5))}
# Blocks of Box & Behnken (1960), table 4: which factors sit at +-1 together.
_BLOCKS = {
    6: ((0, 1, 3), (1, 2, 4), (2, 3, 5), (0, 3, 4), (1, 4, 5), (0, 2, 5)),
    7: ((3, 4, 5), (0, 5, 6), (1, 4, 6), (0, 1, 3), (2, 3, 6), (0, 2, 4), (1, 2, 5)),
}


def factorial(d: int, runs: int | None = None, levels: Sequence[int] | None = None) -> np.ndarray:
    """Every combination of `levels[j]` equidistant values per parameter (both ends included).

    Without `levels`, `runs` must be a power L^d with L >= 2, otherwise ValueError names the nearest ones.
    """
    if levels is None:
        if runs is None:
            raise ValueError("design: factorial needs runs or levels")
        L = max(2, round(runs ** (1 / d)))
        if L**d != runs:
            near = sorted({max(2, L - 1) ** d, L**d, (L + 1) ** d})
            raise ValueError(f"design: factorial of {d} parameters has levels^{d} runs, not {runs}; try one of {near}")
        levels = (L,) * d
    if len(levels) != d or min(levels) < 2:
        raise ValueError(f"design: factorial needs {d} levels >= 2, got {list(levels)}")
    if runs is not None and runs != int(np.prod(levels)):
        raise ValueError(f"design: levels {list(levels)} give {int(np.prod(levels))} runs, not {runs}")
    return np.array(list(itertools.product(*(np.linspace(0, 1, L) for L in levels))))


def central_composite(d: int, star: Star = "circumscribed", alpha: Alpha | None = None, centres: int = 1) -> np.ndarray:
    """Central composite design: corners, 2d star points and one centre (a computed centre repeats exactly).

    In coded units the corners sit at ±1 and the star points at ±α. α = 1 is face-centred; the default is rotatable,
    α = F^(1/4) with F corners (Box & Hunter 1957); `centres` counts for
    an orthogonal α alone (:func:`star_distance`). The cube holds the whole design: its star points lie on the faces,
    its corners at 0.5 ± 0.5/α, which is `inscribed`. For `circumscribed`, where the ranges are those of the corners,
    the same points belong to the box that is α times as wide (:meth:`Box.widened`). From 5 parameters on the corners
    are a resolution V fraction.
    """
    a, corners = star_distance(d, star, alpha, centres), _corners(d)
    stars = np.vstack([a * np.eye(d), -a * np.eye(d)])
    coded = np.vstack([corners, stars, np.zeros((1, d))])
    return 0.5 + 0.5 * coded / a


def star_distance(d: int, star: Star = "circumscribed", alpha: Alpha | None = None, centres: int = 1) -> float:
    """α of a central composite design of F corners and n0 = `centres` centres; ValueError for what there is none of.

        rotatable:  α⁴ = F        orthogonal:  α² = ½ (√(F (F + 2d + n0)) − F)

    Orthogonal: the pure quadratic terms, less their means, are uncorrelated, so that α⁴-terms cancel in the normal
    equations. Source: Khuri & Cornell, Response Surfaces (1996), eq. 4.21; Montgomery, Design and Analysis of
    Experiments (2017), section 11.4.
    """
    if not 2 <= d <= 8:
        raise ValueError(f"design: ccd is for 2 to 8 parameters, got {d}; use lhs, sobol or osf")
    if star not in ("circumscribed", "inscribed", "face"):
        raise ValueError(f"design: unknown star {star!r}; choose circumscribed, inscribed or face")
    if isinstance(alpha, str) and alpha not in ("rotatable", "orthogonal"):
        raise ValueError(f"design: unknown alpha {alpha!r}; choose rotatable, orthogonal or a number")
    if not 1 <= centres <= 100:
        raise ValueError(f"design: ccd needs 1 to 100 centres, got {centres}")
    F = len(_corners(d))
    if star == "face":
        a = 1.0
    elif alpha == "orthogonal":
        a = float(np.sqrt(0.5 * (np.sqrt(F * (F + 2 * d + centres)) - F)))
    else:
        a = F**0.25 if alpha in (None, "rotatable") else float(alpha)
    if not 1 <= a < 100 or (star == "face" and alpha not in (None, 1, 1.0)):
        raise ValueError(f"design: ccd needs alpha >= 1 (exactly 1 where face-centred), got {alpha}")
    return a


def box_behnken(d: int) -> np.ndarray:
    """Box–Behnken design for 3 to 7 parameters: edge or face midpoints and one centre; no corner is run."""
    if not 3 <= d <= 7:
        raise ValueError(f"design: box_behnken is for 3 to 7 parameters, got {d}; use ccd (2 to 8), lhs or osf")
    rows = []
    for block in _BLOCKS.get(d, tuple(itertools.combinations(range(d), 2))):
        points = np.zeros((2 ** len(block), d))
        points[:, block] = list(itertools.product((-1.0, 1.0), repeat=len(block)))
        rows.append(points)
    return 0.5 + 0.5 * np.vstack([*rows, np.zeros((1, d))])


def _corners(d: int) -> np.ndarray:
    extra = _GENERATORS.get(d, ())
    base = np.array(list(itertools.product((-1.0, 1.0), repeat=d - len(extra))))
    return np.column_stack([base, *(base[:, list(g)].prod(axis=1) for g in extra)])
