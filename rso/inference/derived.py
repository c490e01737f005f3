"""Quantities that follow from the parameters: most likely value and profile interval of their own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from rso.core.distributions import chi2_ppf
from rso.inference.identifiability import Determination
from rso.inference.intervals import CREDIBLE_LEVEL
from rso.inference.least_squares import fit_at
from rso.inference.likelihood import Misfit
from rso.inference.rules import RULES

Quantity = Callable[[np.ndarray], np.ndarray]  # of points (m, d) of the unit cube: (m,)
N_STARTS_PER_END = 3  # points of each end from which it is sought
QUANTITY_SLOPE_STEP = 1e-5  # of the unit cube, for the slopes of a quantity
QUANTITY_BOUND_TOLERANCE = 1e-4  # of the unit cube

FIXED_VALUE_SHIFT_SHARE = 1e-3  # of a value, for how much a quantity moves with it
EQUAL_INFLUENCE_SHARE = 0.9  # of the change with a fitted parameter: with the curvature over the shift, that is as much


@dataclass(frozen=True, eq=False)
class DerivedInterval:
    """Most likely value and interval of a quantity; names of the parameters whose range, not the data, makes an end."""

    value: float
    low: float
    high: float
    low_by: tuple[str, ...] = ()
    high_by: tuple[str, ...] = ()


def is_known(i: DerivedInterval, *, scale: bool) -> bool:
    """Whether the data show a value: no range makes an end, and the interval is narrow.

    A positive quantity with a `scale`, as a modulus, is judged as parameters are: its ends are within
    `determined_factor` of their geometric mean.  Any other, as a ratio between bounds, is within `max_half_width_share`
    of its middle.
    """
    if i.low_by or i.high_by:
        return False
    if scale and i.low > 0.0:
        return math.log(i.high / i.low) <= 2.0 * math.log(RULES.determined_factor)
    return 0.5 * (i.high - i.low) <= RULES.max_half_width_share * abs(0.5 * (i.low + i.high))


def rests_on(
    of: Callable[[Mapping[str, np.ndarray]], np.ndarray], fitted: Mapping[str, float], fixed: Mapping[str, float]
) -> list[str]:
    """Fixed values on which a quantity rests as much as on any fitted parameter: it is no finding of the data then.

    By its change for the same small share of each value: ν follows from μ D₁, and with D₁ fixed a sharp ν says no more
    than that was stated; E follows from μ almost alone.
    """
    here = {**fixed, **fitted}

    def change(name: str) -> float:
        ends = [
            of({n: np.array([v * (1.0 + s * (n == name))]) for n, v in here.items()})
            for s in (-FIXED_VALUE_SHIFT_SHARE, FIXED_VALUE_SHIFT_SHARE)
        ]
        return abs(float(np.ravel(ends[1])[0] - np.ravel(ends[0])[0]))

    most = max(map(change, fitted), default=0.0)
    return [n for n in fixed if change(n) > 0.0 and change(n) >= EQUAL_INFLUENCE_SHARE * most]


def derived_interval(d: Determination, quantity: Quantity, level: float = CREDIBLE_LEVEL) -> DerivedInterval:
    """Profile-likelihood interval of a function q(θ) of the parameters, from what determines these.

        [min q(θ), max q(θ)]   over all θ of the ranges with χ²(θ) − χ²_min ≤ quantile of χ²₁

    which is the interval that the profile of q would have.  Both ends are sought by sequential quadratic programming
    from the points of all profiles and of the posterior's draws that the data allow: no branch they know is missed.
    q must be continuous; errors are those of the intervals of the parameters, widened where these are.
    Source: Venzon & Moolgavkar, Appl. Stat. 37 (1988) 87, eq. 1, for a parameter; q may be one of a new set of them.
    """
    misfit = replace(d.misfit, scale=d.misfit.scale * d.wider)
    fit = fit_at(misfit, d.fit.x)
    paths = [k.profile.path[k.profile.rise <= chi2_ppf(level, 1)] for k in d.known]
    drawn = np.empty((0, len(fit.x))) if d.draws is None else d.draws.X
    X = np.concatenate([fit.x[None], *paths, *_allowed(misfit, fit.chi2, drawn, level)])
    q = quantity(X)
    low, at_low = _end(misfit, fit.chi2, quantity, X, q, level, -1.0)
    high, at_high = _end(misfit, fit.chi2, quantity, X, q, level, 1.0)
    names = misfit.model.box.names
    here = float(quantity(fit.x[None])[0])
    return DerivedInterval(
        here,
        min(low, here),
        max(high, here),
        _pressed(names, quantity, at_low, -1.0),
        _pressed(names, quantity, at_high, 1.0),
    )


def _allowed(misfit: Misfit, least: float, X: np.ndarray, level: float) -> Sequence[np.ndarray]:
    """Those of draws X (m, d) that the data allow."""
    return [X[misfit.chi2(X) - least <= chi2_ppf(level, 1)]] if len(X) else []


def _end(
    misfit: Misfit, least: float, quantity: Quantity, X: np.ndarray, q: np.ndarray, level: float, sign: float
) -> tuple[float, np.ndarray]:
    """Largest sign · q over the allowed region, times sign, and where (d,): no less than at any point X (m, d)."""
    order = np.argsort(-sign * q)
    best, place = float(q[order[0]]), X[order[0]]
    scale = max(float(np.ptp(q)), 1e-9 * abs(best), 1e-300)
    limit = chi2_ppf(level, 1)

    def room(x: np.ndarray) -> float:
        return float(limit - (misfit.chi2(x[None])[0] - least))

    def room_slope(x: np.ndarray) -> np.ndarray:
        return np.asarray(-2.0 * misfit.jacobian(x).T @ misfit.residuals(x[None])[0])

    for start in _apart(X[order]):
        found = minimize(
            lambda x: -sign * float(quantity(x[None])[0]) / scale,
            start,
            jac=lambda x: -sign * _slope(quantity, x) / scale,
            bounds=[(0.0, 1.0)] * len(start),
            constraints=[{"type": "ineq", "fun": room, "jac": room_slope}],
            method="SLSQP",
            options={"maxiter": 60, "ftol": 1e-8},
        )
        x = np.clip(found.x, 0.0, 1.0)
        value = float(quantity(x[None])[0])
        if sign * value > sign * best and room(x) >= -1e-3 * limit:
            best, place = value, x
    return best, place


def _apart(X: np.ndarray) -> list[np.ndarray]:
    """The first `N_STARTS_PER_END` of points (m, d) that lie apart from each other."""
    kept: list[np.ndarray] = []
    for x in X:
        if all(float(np.abs(x - v).max()) > 0.05 for v in kept):
            kept.append(x)
        if len(kept) == N_STARTS_PER_END:
            break
    return kept


def _slope(quantity: Quantity, x: np.ndarray) -> np.ndarray:
    """∂q/∂x (d,) by differences that stay in the cube."""
    up, down = (
        np.clip(x + QUANTITY_SLOPE_STEP * np.eye(len(x)), 0, 1),
        np.clip(x - QUANTITY_SLOPE_STEP * np.eye(len(x)), 0, 1),
    )
    return np.asarray((quantity(up) - quantity(down)) / np.diag(up - down))


def _pressed(names: Sequence[str], quantity: Quantity, x: np.ndarray, sign: float) -> tuple[str, ...]:
    """Parameters on a bound at x (d,) beyond which the quantity would go on by more than a thousandth."""
    slope, size = sign * _slope(quantity, x), 1e-3 * abs(float(quantity(x[None])[0]))
    out = np.where(x <= QUANTITY_BOUND_TOLERANCE, -slope, np.where(x >= 1 - QUANTITY_BOUND_TOLERANCE, slope, 0.0))
    return tuple(n for n, s in zip(names, out, strict=True) if 0.1 * s > size)  # over a tenth of the range beyond
