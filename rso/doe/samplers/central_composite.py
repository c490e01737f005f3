"""Central composite designs: corners, star points and a centre."""

from __future__ import annotations

import itertools
from typing import Literal

import numpy as np

from rso.doe.farthest import extend_by
from rso.doe.sampler import DesignTask, Options, Sampler, design_of_fixed_size

Star = Literal["circumscribed", "inscribed", "face"]
Alpha = float | Literal["rotatable", "orthogonal"]

# Resolution V fractions: (Box, Hunter & Hunter 2005, table 6.22): extra factor = product of these base factors.
_FRACTION_GENERATORS = {
    5: ((0, 1, 2, 3),),
    6: ((0, 1, 2, 3, 4),),
    7: ((0, 1, 2, 3, 4, 5),),
    8: ((0, 1, 2, 3), (0, 1, 4, 5)),
}


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


def _corners(d: int) -> np.ndarray:
    extra = _FRACTION_GENERATORS.get(d, ())
    base = np.array(list(itertools.product((-1.0, 1.0), repeat=d - len(extra))))
    return np.column_stack([base, *(base[:, list(g)].prod(axis=1) for g in extra)])


def points(task: DesignTask) -> np.ndarray:
    """The design of the options `star`, `alpha` and `centres`, all of whose points must be feasible."""
    return design_of_fixed_size("ccd", central_composite(task.d, **_stated(task.options)), task)


def wider(d: int, options: Options) -> float:
    """α where the stated ranges are those of the corners, whose box the star points leave; 1 for the other kinds."""
    return star_distance(d, **_stated(options)) if options.get("star", "circumscribed") == "circumscribed" else 1.0


def _stated(options: Options) -> Options:
    return {k: v for k, v in options.items() if k in ("star", "alpha", "centres")}


SAMPLER = Sampler("ccd", "central composite", points, extend_by, options=("star", "alpha", "centres"), wider=wider)
