"""From responses of a backend to curves over the travels of a library's tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator, interp1d

from rso.contract import Response
from rso.contract.responses import FORCE_CHANNELS
from rso.core.curves import Resampling
from rso.discrepancy.library.simulations import N_REST_MOMENTS, Pass, Rest
from rso.discrepancy.library.test_plan import PlanPlace
from rso.evaluation.store import Done

MIN_FAILED_RUN_TRAVEL_SHARE = 0.6  # of the deepest travel: what a failed run must have reached to be of use


def forces_of(response: Response, modulus: float, back: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Travels (n,) in increasing order and forces over the modulus (n, 3) of the way there, or of the unloading."""
    travel, returning = response.channels["travel"], _returning(response)
    F = np.stack([response.channels[c] if c in response.channels else np.zeros(len(travel)) for c in FORCE_CHANNELS], 1)
    if back and returning.any():
        order = np.argsort(travel[returning])
        return travel[returning][order], F[returning][order] / modulus
    there = ~returning
    return travel[there], F[there] / modulus


def _returning(response: Response) -> np.ndarray:
    """(n,) whether an answer is in unloading: asked travels come up once on the way there and once on that."""
    travel, time = response.channels["travel"], response.channels["time"]
    return time > time[int(np.argmax(travel >= travel.max() - 1e-6))]


def loading_forces(response: Response, u: np.ndarray, modulus: float) -> np.ndarray:
    """Forces over the modulus (3, m) on the way there."""
    travel, F = forces_of(response, modulus)
    return Resampling(travel, F)(np.minimum(u, travel[-1])).T


def relative(travel: np.ndarray, change: np.ndarray, reference: np.ndarray, u: np.ndarray) -> np.ndarray:
    """change / reference (3, m) over u, constant before the first and after the last travel."""
    ratio = change / reference[:, None]
    if len(travel) == 1:
        return np.repeat(ratio.T, len(u), axis=1)
    at = np.clip(u, travel[0], travel[-1])
    return PchipInterpolator(np.sqrt(travel), ratio, axis=0)(np.sqrt(at)).T


def reached_by(outcome: Any, deepest: float) -> Response | None:
    """The response of a run, or what a failed one reached if that is most of the way; beyond it changes stay as they
    were there."""
    if isinstance(outcome, Done):
        return outcome.response
    partial = getattr(outcome, "partial", None)
    if partial is None or partial.channels["travel"].max() < MIN_FAILED_RUN_TRAVEL_SHARE * deepest:
        return None
    return partial


def changed(
    ways: Sequence[Pass],
    u: np.ndarray,
    place: PlanPlace,
    reference: float,
    outcomes: Sequence[Any],
    base: Resampling,
    foreseen: np.ndarray | None = None,
) -> tuple[np.ndarray, int]:
    """Changes (n_pass, 3, m) over `base` relative to its Fz, and how many passes have none.

    `outcomes` are those of every pass, or one where the way does not matter.  What is `foreseen` (n_pass, 3, m) need
    not be interpolated from travel to travel.
    """
    change, lost = np.zeros((len(ways), 3, len(u))), 0
    for i, way in enumerate(ways):
        response, back = reached_by(outcomes[min(i, len(outcomes) - 1)], place.deepest), way.peak is not None
        if response is None or (back and len(outcomes) > 1 and not _returning(response).any()):
            if foreseen is not None and (way.rest or way.pace != 1.0):  # it may be that alone which cannot be simulated
                change[i] = foreseen[i]
            else:
                lost += 1
            continue
        travel, F = forces_of(response, reference, back=back and len(outcomes) > 1)
        at = base(travel)
        if foreseen is None:
            change[i] = relative(travel, F - at, at[:, 2], u)
        else:
            known = interp1d(np.sqrt(u), foreseen[i])(np.sqrt(np.clip(travel, u[0], u[-1]))).T
            change[i] = foreseen[i] + relative(travel, F - at - known * at[:, 2:], at[:, 2], u)
    return change, lost


def rested(
    rests: Sequence[Rest], reference: float, outcomes: Sequence[Any], base: Resampling
) -> tuple[np.ndarray, int]:
    """Changes (n_rest, 3, N_REST_MOMENTS) over `base` relative to its Fz at the moments of rests, and how many have
    none."""
    change, lost = np.zeros((len(rests), 3, N_REST_MOMENTS)), 0
    for i, (rest, outcome) in enumerate(zip(rests, outcomes, strict=True)):
        if not isinstance(outcome, Done):
            lost += 1
            continue
        time, travel = outcome.response.channels["time"], outcome.response.channels["travel"]
        resting = travel >= rest.peak * (1.0 - 1e-9)
        since = time[resting] - time[resting][0]
        F = (
            np.stack([outcome.response.channels.get(c, np.zeros(len(time)))[resting] for c in FORCE_CHANNELS], 1)
            / reference
        )
        at = base(np.array([rest.peak]))
        known = np.log(np.maximum(since, 0.5 * rest.moments[1]))
        asked = np.log(np.maximum(rest.moments, 0.5 * rest.moments[1]))
        change[i] = PchipInterpolator(known, (F - at) / at[:, 2:], axis=0)(np.clip(asked, known[0], known[-1])).T
    return change, lost


def marks_of(response: Response, place: PlanPlace) -> np.ndarray:
    """Displacements (n_depths · n_marks,) of the marks of profiles, depth by depth."""
    if not place.marks:
        return np.empty(0)
    travel, out = response.channels["travel"], []
    for d in place.mark_depths:
        at = int(np.argmin(np.abs(travel - d)))
        out += [float(response.channels[f"uz({x:g},{y:g})"][at]) for x, y in place.marks]
    return np.array(out)
