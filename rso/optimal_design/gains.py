"""What a fit expects of more readings of its own kind: the same test once more, a few more readings at one depth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rso.doe import Box
from rso.inference import Data, Determination, Known, expected_sd
from rso.optimal_design.ranking import Worth, about_parameter, ranked

N_MORE_READINGS = 10  # more of them at the depth that shows most


@dataclass(frozen=True)
class Gain:
    """Standard deviation of ln θ by name that is expected before and after one more test, and its price in loadings."""

    test: str
    before: Mapping[str, float]
    after: Mapping[str, float]
    price: int = 1


def gain(
    box: Box,
    x: np.ndarray,
    fisher: np.ndarray,
    test: str,
    jacobian: np.ndarray,
    covariance: np.ndarray,
    price: int = 1,
) -> Gain:
    """What further points with ∂f/∂x (m, d) and errors (m, m) are expected to add: F′ = F + Jᵀ C⁻¹ J.

    The box itself counts as a uniform prior (12 per parameter), so that nothing is worse known than by its range.
    Assumption: linear in x between here and the edge of the interval.  Source: Lindley, Ann. Math. Stat. 27 (1956) 986,
    for Gaussian errors.
    """
    more = jacobian.T @ np.linalg.solve(covariance, jacobian)
    before, after = (expected_sd(box, x, f) for f in (fisher, fisher + more))
    return Gain(test, before, after, price)


def best_depth(
    box: Box, x: np.ndarray, fisher: np.ndarray, parameter: int, jacobian: np.ndarray, sigma: np.ndarray
) -> tuple[int, Gain]:
    """The measured point at which one more independent reading, of the same `sigma` (n,), shows most of a parameter."""
    found = [
        gain(box, x, fisher, "", jacobian[i : i + 1], np.array([[sigma[i] ** 2]])) for i in np.flatnonzero(sigma > 0)
    ]
    name = box.names[parameter]
    best = min(range(len(found)), key=lambda i: found[i].after[name])
    return int(np.flatnonzero(sigma > 0)[best]), found[best]


def gains_of_repeats(d: Determination) -> list[Gain]:
    """What each fitted curve once more, and more readings at the depth that shows most, would add.

    Errors are as much wider as those of the fit: what the model lacks it will lack in the next test too.  Stated
    inputs count as exact: a repeat is of the same specimen.
    """
    box, x, data = d.misfit.model.box, d.fit.x, [v.inputs_exact for v in d.misfit.data]
    J, fisher = d.misfit.model.jacobian(x), d.fisher_of_exact_inputs
    scale, found, start = d.used.scale, list[Gain](), 0
    for one in data:
        rows = J[start : start + len(one.value)]
        text = f"{one.name} once more, with errors of its own"
        found.append(gain(box, x, fisher, text, rows, scale**2 * _definite(one)))
        start += len(one.value)
    sigma = np.concatenate([one.sigma for one in data]) * scale
    places = [place for one in data for place in one.places]
    if sigma.max() > 0:
        at, _ = best_depth(box, x, fisher, box.names.index(weakest(d.known)), J, sigma)
        rows = np.repeat(J[at : at + 1], N_MORE_READINGS, axis=0)
        errors = sigma[at] ** 2 * np.eye(N_MORE_READINGS)
        found.append(gain(box, x, fisher, f"ten more readings at {places[at]}", rows, errors))
    return found


def weakest(known: Sequence[Known]) -> str:
    """The parameter that a fit knows worst, by the standard deviation of ln θ."""
    return max(known, key=lambda k: k.sd_log).name


def ranked_gains(found: Sequence[Gain], focus: str) -> list[tuple[Gain, Worth]]:
    """Tests by what they are expected to show of a parameter, and by their price."""
    worth = {id(g): Worth(about_parameter([g.before[focus]], [g.after[focus]]), g.price) for g in found}
    return [(g, worth[id(g)]) for g in ranked(found, lambda g: worth[id(g)])]


def _definite(d: Data) -> np.ndarray:
    return d.covariance + (1e-6 * float(np.abs(d.value).max()) or 1e-12) ** 2 * np.eye(len(d.value))
