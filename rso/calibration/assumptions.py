"""What an identification takes for granted of a test, and what the parameters would be without it, by a closed form.

    θ' = argmin χ²[F(u; θ) ρ(u; θ')],   ρ = F₀(u; other) / F₀(u; as stated)

F are the simulated forces at the travels u of the readings, F₀ those of the last closed form of the backend that holds
where strains are small.  It need not be right deeper, as its error is nearly the same on both sides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rso.calibration.plan import Plan
from rso.calibration.stated_settings import unstated_dimensions
from rso.contract import Formulas, Programme, Variants, capability
from rso.inference import CurvePlace, Determination, Fit, Model
from rso.inference.least_squares import fit_at, levenberg_marquardt
from rso.study.cases import case_for
from rso.study.dimensions import MISREAD_SETTING_ERRORS, stated_dimensions

SIZE_ERROR_SHARE = 0.05  # of a size: what nobody would be surprised to find on a soft specimen
MAX_FORM_RATIO = 1.25  # of the fitted forces over those of a closed form, or the reverse: beyond, it is of another body
MIN_MOVE = 0.01  # of a parameter: what moves all of them by less is not said, as closed forms are not that good
SHALLOW_SHARE = 1e-3  # of the deepest reading: there strains are small, and a closed form holds if it does at all
MAX_RISE_CHI2 = 9.0  # that χ² rises by without it: three standard deviations, beyond which the data speak against it
MAX_FITS, FIT_TOLERANCE = 8, 5e-3  # fits to a ratio until the next moves by no more of the ranges
N_FORM_DEPTHS = 5  # at which a closed form is asked, evenly spaced to the deepest reading
FORCE_CHANNEL = "Fz"

Values = Mapping[str, float]
Otherwise = tuple[Values, Mapping[str, Any]]
"""Values, and settings, that stand in place of the stated ones."""


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

    None without a closed form that is near the fitted forces, none whose fit ends at a bound of the ranges,
    and none that the data speak against.
    Validity: all readings are forces along the travel.
    """
    knobs, found = {p.name: p for p in plan.backend.parameters}, []
    for name, experiments in unstated_dimensions(plan).items():
        each: dict[str, Otherwise] = {}
        for e in experiments:
            size = (stated_dimensions(plan.backend, plan.study.settings_of(e)) or {}).get(name)
            if size is not None:
                each[e] = {name: (knobs[name].neutral or 0.0) + SIZE_ERROR_SHARE * size}, {}
        if each and (moves := _moves(plan, d, places, each)):
            every = set(each) == {p.experiment for p in places}
            found.append(Assumption(name, knobs[name].description, () if every else tuple(each), moves))
    return tuple(found)


def other_settings_moved(plan: Plan, d: Determination, places: Sequence[CurvePlace]) -> tuple[Assumption, ...]:
    """Other settings that a diagnosis might try, such as another support; as :func:`exact_sizes_moved` else."""
    offered = capability(plan.backend, Variants)
    if offered is None:
        return ()
    each = {e: offered.variants(plan.study.settings_of(e)) for e in dict.fromkeys(p.experiment for p in places)}
    found = []
    for name in dict.fromkeys(n for variants in each.values() for n in variants):
        own: dict[str, Otherwise] = {e: ({}, v[name]["settings"]) for e, v in each.items() if name in v}
        if moves := _moves(plan, d, places, own):
            words = next(v[name]["description"] for v in each.values() if name in v)
            found.append(Assumption(name, words, () if len(own) == len(each) else tuple(own), moves))
    return tuple(found)


def _moves(
    plan: Plan, d: Determination, places: Sequence[CurvePlace], otherwise: Mapping[str, Otherwise]
) -> Mapping[str, float] | None:
    """Relative changes of the parameters; None where no closed form is near, or nothing moves by `MIN_MOVE`.

    ρ is that of θ', found by fits to the ρ of the one before until they stay.
    """
    misfit, model = d.misfit, d.misfit.model
    if misfit.weighting != "noise" or any(p.channel != FORCE_CHANNEL or p.marks is not None for p in places):
        return None
    fitted, again = model.predict(d.fit.x[None])[0], d.fit
    for _ in range(MAX_FITS):
        values = {**plan.resolved.fixed, **dict(zip(model.box.names, map(float, again.theta), strict=True))}
        ρ = _ratios(plan, places, values, otherwise, fitted if again is d.fit else None)
        if ρ is None:
            return None
        before, again = again, _fitted_otherwise(d, again, ρ)
        if np.abs(again.x - before.x).max() < FIT_TOLERANCE:
            break
    else:
        return None
    # beyond the ranges it would go on, or the data speak against it
    if set(again.at_bound) - set(d.fit.at_bound) or again.chi2 - d.fit.chi2 > MAX_RISE_CHI2 * d.wider**2:
        return None
    there = zip(model.box.names, again.theta, d.fit.theta, strict=True)
    moves = {n: float(new / old - 1.0) if old else float("nan") for n, new, old in there}
    return moves if max((abs(v) for v in moves.values() if np.isfinite(v)), default=0.0) >= MIN_MOVE else None


def _fitted_otherwise(d: Determination, start: Fit, ρ: np.ndarray) -> Fit:
    """The fit of forces that are ρ (n,) times those of the model."""
    model = d.misfit.model
    other = Model(model.box, lambda X: model.predict(X) * ρ, lambda x: model.jacobian(x) * ρ[:, None])
    misfit = replace(d.misfit, model=other)
    return fit_at(misfit, levenberg_marquardt(misfit, start.x[None])[0])


def _ratios(
    plan: Plan,
    places: Sequence[CurvePlace],
    values: Values,
    otherwise: Mapping[str, Otherwise],
    fitted: np.ndarray | None,
) -> np.ndarray | None:
    """ρ (n,) at all readings; None where no closed form holds, or none is near the `fitted` forces (n,), if given."""
    parts, start = [], 0
    for p in places:
        F = None if fitted is None else fitted[start : start + len(p.depth)]
        start += len(p.depth)
        if p.experiment not in otherwise:
            parts.append(np.ones(len(p.depth)))
            continue
        u = np.append(SHALLOW_SHARE, np.linspace(1.0 / N_FORM_DEPTHS, 1.0, N_FORM_DEPTHS)) * float(p.depth.max())
        more, replaced = otherwise[p.experiment]
        stated, other = _forms(plan, p, values, {}, u), _forms(plan, p, {**values, **more}, replaced, u)
        name = next((n for n in reversed(stated) if n in other), None)
        if name is None or (F is not None and not _is_near(p.depth, F, u, stated[name])):
            return None
        parts.append(np.interp(p.depth, u, other[name] / stated[name]))
    return np.concatenate(parts)


def _forms(
    plan: Plan, p: CurvePlace, values: Values, replaced: Mapping[str, Any], u: np.ndarray
) -> dict[str, np.ndarray]:
    """Forces (k,) at travels u (k,) of the closed forms that hold at the first of these, by name."""
    form = capability(plan.backend, Formulas)
    if form is None or u[-1] <= 0.0:
        return {}
    try:
        asked = tuple(map(float, u))
        case = case_for(plan.study, p.experiment, asked)  # of an unloading the forms are those of the way there
        settings = {**case.settings, **replaced}
        found = form.formulas(values, replace(case, programme=Programme.ramp(asked), settings=settings))
    except MISREAD_SETTING_ERRORS:  # there is none of what the study describes
        return {}
    forces = {f.name: np.asarray(f.force, float) for f in found if not f.invalid[0]}
    return {n: F for n, F in forces.items() if np.all(np.isfinite(F)) and F.min() > 0.0}


def _is_near(depth: np.ndarray, F: np.ndarray, u: np.ndarray, closed_form: np.ndarray) -> bool:
    deep = depth >= 0.5 * depth.max()  # where forces are large against errors of the contact
    ratio = float(np.median(F[deep] / np.interp(depth[deep], u, closed_form)))
    return 1.0 / MAX_FORM_RATIO <= ratio <= MAX_FORM_RATIO
