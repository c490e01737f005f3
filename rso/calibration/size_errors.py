"""What a stated size that counts as exact would move the parameters by, were it larger, by a closed form.

    s(u) = ½ F(u) ln[F₀(u; x + Δx) / F₀(u; x − Δx)],   Δθ = −(Jᵀ C⁻¹ J)⁻¹ Jᵀ C⁻¹ s

F are the fitted forces at the travels u of the readings, F₀ those of the last closed form of the backend.  It need not
be right itself, as its error is nearly the same on both sides.  Sources: JCGM 102:2011, 6.2.1.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rso.calibration.plan import Plan
from rso.calibration.stated_settings import unstated_dimensions
from rso.contract import Formulas, capability
from rso.inference import CurvePlace, Determination
from rso.inference.input_effects import relative_moves
from rso.study.cases import MISREAD_SETTING_ERRORS, case_for
from rso.study.dimensions import stated_dimensions

SIZE_ERROR_SHARE = 0.05  # of a size: what nobody would be surprised to find on a soft specimen
MAX_FORM_RATIO = 1.25  # of the fitted forces over those of a closed form, or the reverse: beyond, it is of another body
MIN_SIZE_MOVE = 0.01  # of a parameter: what moves all of them by less is not said, as closed forms are not that good
N_FORM_DEPTHS = 12  # at which a closed form is asked, evenly spaced to the deepest reading
FORCE_CHANNEL = "Fz"


@dataclass(frozen=True)
class SizeError:
    """A size of `experiments` (all where empty) that nobody called uncertain, and what `SIZE_ERROR_SHARE` more of it
    moves each parameter by, relative."""

    knob: str
    description: str
    experiments: tuple[str, ...]
    moves: Mapping[str, float]


def size_errors(plan: Plan, d: Determination, places: Sequence[CurvePlace]) -> tuple[SizeError, ...]:
    """Those that move a parameter, as stated in the study; none without a closed form that is near the fitted forces.

    Validity: to first order, and where all readings are forces along the travel.
    """
    if d.misfit.weighting != "noise" or any(p.channel != FORCE_CHANNEL or p.marks is not None for p in places):
        return ()
    fitted = d.misfit.model.predict(d.fit.x[None])[0]
    values = {**plan.resolved.fixed, **dict(zip(d.misfit.model.box.names, map(float, d.fit.theta), strict=True))}
    found = []
    for name, experiments in unstated_dimensions(plan).items():
        shifts, start = [], 0
        for p in places:
            F = fitted[start : start + len(p.depth)]
            start += len(p.depth)
            change = _log_change(plan, p, values, name, F) if p.experiment in experiments else np.zeros(len(F))
            if change is None:
                return ()
            shifts.append(F * change)
        moves = relative_moves(d, np.concatenate(shifts))
        if max(map(abs, moves.values())) >= MIN_SIZE_MOVE:
            every = set(experiments) == {p.experiment for p in places}
            description = next(p.description for p in plan.backend.parameters if p.name == name)
            found.append(SizeError(name, description, () if every else tuple(experiments), moves))
    return tuple(found)


def _log_change(plan: Plan, p: CurvePlace, values: Mapping[str, float], name: str, F: np.ndarray) -> np.ndarray | None:
    """What a size that is larger changes ln F (n,) of a curve by; None where no closed form is near it."""
    form = capability(plan.backend, Formulas)
    sizes = stated_dimensions(plan.backend, plan.study.settings_of(p.experiment)) or {}
    knob = next(q for q in plan.backend.parameters if q.name == name)
    deepest = float(p.depth.max())
    if form is None or name not in sizes or deepest <= 0.0:
        return None
    u = np.linspace(deepest / N_FORM_DEPTHS, deepest, N_FORM_DEPTHS)
    error, neutral = SIZE_ERROR_SHARE * sizes[name], knob.neutral or 0.0
    try:
        case = case_for(plan.study, p.experiment, tuple(map(float, u)))
        forces = [
            np.asarray(curves[-1].force, float)
            for sign in (0.0, 1.0, -1.0)
            if (curves := form.formulas({**values, name: neutral + sign * error}, case))
        ]
    except MISREAD_SETTING_ERRORS:  # there is none of what the study describes
        return None
    if len(forces) < 3 or not np.all(np.isfinite(forces)) or np.min(forces) <= 0.0:
        return None
    deep = p.depth >= 0.5 * deepest  # where forces are large against errors of the contact
    ratio = float(np.median(F[deep] / np.interp(p.depth[deep], u, forces[0])))
    if not 1.0 / MAX_FORM_RATIO <= ratio <= MAX_FORM_RATIO:
        return None
    return np.interp(p.depth, u, 0.5 * np.log(forces[1] / forces[2]))
