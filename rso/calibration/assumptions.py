"""What an identification takes for granted of a test, and what the parameters would be without it, by a closed form.

    s(u) = F(u) ln[F₀(u; other) / F₀(u; as stated)],   Δθ = −(Jᵀ C⁻¹ J)⁻¹ Jᵀ C⁻¹ s

F are the fitted forces at the travels u of the readings, F₀ those of the last closed form of the backend.  It need not
be right itself, as its error is nearly the same on both sides.  Source: JCGM 102:2011, 6.2.1.3.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.calibration.plan import Plan
from rso.calibration.stated_settings import unstated_dimensions
from rso.contract import Formulas, Variants, capability
from rso.inference import CurvePlace, Determination
from rso.inference.input_effects import relative_moves
from rso.study.cases import MISREAD_SETTING_ERRORS, case_for
from rso.study.dimensions import stated_dimensions

SIZE_ERROR_SHARE = 0.05  # of a size: what nobody would be surprised to find on a soft specimen
MAX_FORM_RATIO = 1.25  # of the fitted forces over those of a closed form, or the reverse: beyond, it is of another body
MIN_MOVE = 0.01  # of a parameter: what moves all of them by less is not said, as closed forms are not that good
N_FORM_DEPTHS = 12  # at which a closed form is asked, evenly spaced to the deepest reading
FORCE_CHANNEL = "Fz"

Values = Mapping[str, float]
LogChange = Callable[[str], tuple[Values, Values, Mapping[str, Any]] | None]
"""Experiment → values of the one side and of the other, and settings that the other replaces; None: it has neither."""


@dataclass(frozen=True)
class Assumption:
    """What is taken for granted in `experiments` (all where empty), and what each parameter would be without it,
    relative to what it is."""

    name: str
    description: str
    experiments: tuple[str, ...]
    moves: Mapping[str, float]


def exact_sizes_moved(plan: Plan, d: Determination, places: Sequence[CurvePlace]) -> tuple[Assumption, ...]:
    """Sizes of which nobody said how well they are known, were they `SIZE_ERROR_SHARE` larger.

    None without a closed form that is near the fitted forces.  Validity: to first order, and where all readings are
    forces along the travel.
    """
    knobs = {p.name: p for p in plan.backend.parameters}
    found = []
    for name, experiments in unstated_dimensions(plan).items():
        neutral = knobs[name].neutral or 0.0

        def larger(
            e: str, name: str = name, neutral: float = neutral, own: Sequence[str] = experiments
        ) -> tuple[Values, Values, Mapping[str, Any]] | None:
            size = (stated_dimensions(plan.backend, plan.study.settings_of(e)) or {}).get(name)
            if e not in own or size is None:
                return None
            half = 0.5 * SIZE_ERROR_SHARE * size
            return {name: neutral - half}, {name: neutral + half}, {}

        if moves := _moves(plan, d, places, larger):
            every = set(experiments) == {p.experiment for p in places}
            found.append(Assumption(name, knobs[name].description, () if every else tuple(experiments), moves))
    return tuple(found)


def other_settings_moved(plan: Plan, d: Determination, places: Sequence[CurvePlace]) -> tuple[Assumption, ...]:
    """Other settings that a diagnosis might try, such as another support; as :func:`exact_sizes_moved` else."""
    offered = capability(plan.backend, Variants)
    if offered is None:
        return ()
    each = {e: offered.variants(plan.study.settings_of(e)) for e in dict.fromkeys(p.experiment for p in places)}
    found = []
    for name in dict.fromkeys(n for variants in each.values() for n in variants):

        def other(e: str, name: str = name) -> tuple[Values, Values, Mapping[str, Any]] | None:
            return ({}, {}, each[e][name]["settings"]) if name in each[e] else None

        if moves := _moves(plan, d, places, other):
            own = tuple(e for e, variants in each.items() if name in variants)
            words = each[own[0]][name]["description"]
            found.append(Assumption(name, words, () if len(own) == len(each) else own, moves))
    return tuple(found)


def _moves(plan: Plan, d: Determination, places: Sequence[CurvePlace], change: LogChange) -> Mapping[str, float] | None:
    """Relative changes of the parameters; None where no closed form is near, or nothing moves by `MIN_MOVE`."""
    if d.misfit.weighting != "noise" or any(p.channel != FORCE_CHANNEL or p.marks is not None for p in places):
        return None
    fitted = d.misfit.model.predict(d.fit.x[None])[0]
    values = {**plan.resolved.fixed, **dict(zip(d.misfit.model.box.names, map(float, d.fit.theta), strict=True))}
    shifts, start = [], 0
    for p in places:
        F = fitted[start : start + len(p.depth)]
        start += len(p.depth)
        sides = change(p.experiment)
        s = np.zeros(len(F)) if sides is None else _shift(plan, p, values, sides, F)
        if s is None:
            return None
        shifts.append(s)
    moves = relative_moves(d, np.concatenate(shifts))
    return moves if max(map(abs, moves.values())) >= MIN_MOVE else None


def _shift(
    plan: Plan, p: CurvePlace, values: Values, sides: tuple[Values, Values, Mapping[str, Any]], F: np.ndarray
) -> np.ndarray | None:
    """s (n,) of a curve whose fitted forces are F (n,); None where no closed form is near these."""
    form, deepest = capability(plan.backend, Formulas), float(p.depth.max())
    if form is None or deepest <= 0.0:
        return None
    u = np.linspace(deepest / N_FORM_DEPTHS, deepest, N_FORM_DEPTHS)
    one, other, replaced = sides
    try:
        case = case_for(plan.study, p.experiment, tuple(map(float, u)))
        changed = dataclasses.replace(case, settings={**case.settings, **replaced})
        asked = ((values, case), ({**values, **one}, case), ({**values, **other}, changed))
        curves = [form.formulas(v, c) for v, c in asked]
    except MISREAD_SETTING_ERRORS:  # there is none of what the study describes
        return None
    if not all(curves):
        return None
    stated, low, high = (np.asarray(each[-1].force, float) for each in curves)
    if not np.all(np.isfinite([stated, low, high])) or min(map(np.min, (stated, low, high))) <= 0.0:
        return None
    deep = p.depth >= 0.5 * deepest  # where forces are large against errors of the contact
    ratio = float(np.median(F[deep] / np.interp(p.depth[deep], u, stated)))
    if not 1.0 / MAX_FORM_RATIO <= ratio <= MAX_FORM_RATIO:
        return None
    return np.asarray(F * np.interp(p.depth, u, np.log(high / low)))
