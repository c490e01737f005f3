"""Identification of a study: what its measured curves say about the parameters, recomputed until it holds."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rso.calibration.assumptions import SIZE_ERROR_SHARE, Assumption, exact_sizes_moved, other_settings_moved
from rso.calibration.confirmed_optimum import (
    ConfirmedFit,
    ConfirmedOptimum,
    confirm_optimum,
    covered,
    evidence,
    stated_ranges,
)
from rso.calibration.finished_runs import runs_with_curves
from rso.calibration.plan import Plan
from rso.calibration.readings import curve_data
from rso.calibration.search_stage import SearchResult, curve_metrics, done_curves
from rso.calibration.stages import Run, Runner
from rso.calibration.stated_settings import exact_dimensions
from rso.calibration.unstated_errors import unstated
from rso.contract import DerivedQuantities, DerivedQuantity, capability
from rso.core.curves import metrics
from rso.core.digits import significant
from rso.core.symbols import symbol
from rso.core.units import spaced
from rso.doe import Box
from rso.emulation.emulator import Emulator
from rso.evaluation import Task
from rso.evaluation.store import RunStore
from rso.inference import (
    CurvePlace,
    Determination,
    Fit,
    Known,
    MetricMinimum,
    Profiled,
    compare_weightings,
    curve_score,
    curves_as_fitted,
    derived_interval,
    determination_of,
    downhill,
    lenient,
    minimise,
    with_usual,
)
from rso.inference.derived import is_known, rests_on
from rso.inference.error_model import shares
from rso.inference.identifiability import doubt
from rso.inference.input_effects import BudgetEntry, shared_part, uncertainty_budget
from rso.inference.intervals import INTERVAL_BOUND_TOLERANCE
from rso.inference.rules import RULES
from rso.inference.systematic_residuals import systematic_misfit
from rso.inference.verdict import Word, physical
from rso.optimal_design.gains import Gain, gains_of_repeats, ranked_gains, weakest

MIN_MEASURED_SCATTER_SHARE = 1e-4  # of the largest value: readings that scatter less are computed ones
REPORTED_METRICS = ("nrmse", "mre", "rrmse")


@dataclass(frozen=True, eq=False)
class Identified:
    """Data and what they determine; best fits by weighting, minima by metric."""

    places: tuple[CurvePlace, ...]
    determination: Determination
    weightings: dict[str, Fit]
    metrics: dict[str, tuple[MetricMinimum, ...]]


def identify(plan: Plan, settled: ConfirmedOptimum, found: Sequence[SearchResult], store: RunStore) -> Identified:
    """What follows from the likelihood, every finished run heard: intervals, verdicts, best fits by weighting, minima
    by metric."""
    now, seen = settled.known or _asked(plan, settled.emulator, found, store)
    misfit, near = now.misfit, now.near
    model, data, seed = misfit.model, misfit.data, plan.seed
    wanted = dict.fromkeys([plan.study.search.metric, *REPORTED_METRICS])
    minima = {
        m: minimise(curve_score(model, data, m), model.box, seed=seed, near=near, steps=downhill(model, data, m))
        for m in wanted
    }
    determination = with_usual(determination_of(seen, seed=seed, mcmc=True, stated=stated_ranges(plan)), seed)
    return Identified(now.places, determination, compare_weightings(misfit, near, seed=seed), minima)


def _asked(
    plan: Plan, emulator: Emulator, found: Sequence[SearchResult], store: RunStore
) -> tuple[ConfirmedFit, Profiled]:
    """What an emulator makes of the curves, every finished run heard."""
    now = evidence(plan, emulator, found)
    runs, _ = runs_with_curves(plan, emulator, store, now.misfit, now.places)
    return now, now.with_profiles(plan, runs)


def of_identification(plan: Plan, found: Identified, settled: ConfirmedOptimum) -> dict[str, Any]:
    """identification, determined."""
    box, d = found.determination.misfit.model.box, found.determination
    first = d.fit
    return {
        "identification": {
            "level": 0.9,
            "data": [
                {
                    "experiment": p.experiment,
                    "channel": p.channel,
                    "points": len(p.depth),
                    "errors": shares(v),
                    **({} if p.marks is None else {"marks": p.marks.tolist(), "measured": v.value}),
                    "fitted": c,
                }
                for p, v, c in zip(found.places, d.misfit.data, _fitted(d), strict=True)
            ],
            "values": _values(plan, box, first.x),
            "chi2": first.chi2,
            "degrees": d.degrees,
            "p_value": d.p_value,
            "noise_degrees": float(d.misfit.freedom) if np.isfinite(d.misfit.freedom) else None,
            "scale": d.scale,
            "story": d.story,
            "doubts": _disbelieved(plan, d),
            "recomputed": {
                "agreement": settled.agreement,
                "chi2": settled.chi2,
                "chi2_bare": settled.chi2_bare,
                "p_value_bare": settled.p_bare,
                "verified": settled.verified,
                "open": list(settled.open),
                **_recomputed(plan, settled),
            },
            "other_minima": [{"values": _values(plan, box, m.x), "chi2": m.chi2} for m in d.others],
            "parameters": [_known(box, k, known) for k, known in enumerate(d.known)],
            "derived": derived_quantities(plan, d, is_trusted(d, settled) and not _disbelieved(plan, d)),
            "directions": [{"change": dict(v.change), "sd": v.sd, "story": v.story} for v in d.directions],
            "inputs": [_input_row(plan, d, e) for e in uncertainty_budget(d, plan.effects)],
            "calibration": _calibration_row(d),
            "exact_inputs": exact_dimensions(plan),
            "assumptions": [
                *(_assumed(plan, d, a, SIZE_ERROR_SHARE) for a in exact_sizes_moved(plan, d, found.places)),
                *(_assumed(plan, d, a, None) for a in other_settings_moved(plan, d, found.places)),
            ],
            "gains": gain_rows(d, gains_of_repeats(d)),
            "mcmc": None
            if d.draws is None
            else {
                "method": d.draws.method,
                "draws": len(d.draws.X),
                "steps": d.draws.steps,
                "tau": d.draws.tau,
                "independent": d.draws.independent,
                "r_hat": d.draws.r_hat,
                "converged": d.draws.enough,
            },
            "weightings": [{"weighting": w, "values": _values(plan, box, f.x)} for w, f in found.weightings.items()],
            "metrics": [
                {"metric": name, "minima": [{"values": _values(plan, box, m.x), "value": m.value} for m in minima]}
                for name, minima in found.metrics.items()
            ],
        },
        "determined": {k.name: _determined(box, n, k) for n, k in enumerate(d.known)},
    }


def _input_row(plan: Plan, d: Determination, entry: BudgetEntry) -> dict[str, Any]:
    one = entry.effect
    return {
        "input": one.knob,
        "experiment": ", ".join(one.experiments),
        "description": one.description,
        "unit": one.unit,
        "uncertainty": one.uncertainty,
        "moves": _moves_of_all(plan, d, entry.moves),
        "share": entry.share,
    }


def _calibration_row(d: Determination) -> dict[str, Any] | None:
    if d.misfit.weighting != "noise" or not any("calibration" in v.shared for v in d.misfit.data):
        return None
    moves, share = shared_part(d, "calibration")
    return {"moves": moves, "share": share}


def _assumed(plan: Plan, d: Determination, one: Assumption, larger: float | None) -> dict[str, Any]:
    return {
        "name": one.name,
        "experiment": ", ".join(one.experiments),
        "description": one.description,
        "larger": larger,
        "moves": _moves_of_all(plan, d, one.moves),
    }


def _moves_of_all(plan: Plan, d: Determination, moves: Mapping[str, float]) -> dict[str, float]:
    """Relative changes of the parameters with those of the quantities derived from them."""
    box, derived = d.misfit.model.box, capability(plan.backend, DerivedQuantities)
    here = {**plan.resolved.fixed, **dict(zip(box.names, map(float, d.fit.theta), strict=True))}
    there = {**here, **{n: here[n] * (1.0 + moved) for n, moved in moves.items()}}
    found = [] if derived is None else derived.derived(plan.study.backend.settings, list(here))
    values = {
        q.name: [float(np.ravel(q.of({n: np.array([v]) for n, v in p.items()}))[0]) for p in (here, there)]
        for q in found
    }
    return {**moves, **{n: b / a - 1.0 for n, (a, b) in values.items() if a}}


def _fitted(d: Determination) -> list[dict[str, Any] | None]:
    """What was fitted of each set of data; None where the weighting knows no errors."""
    found = curves_as_fitted(d)
    if not found:
        return [None] * len(d.misfit.data)
    rows: list[dict[str, Any] | None] = []
    for c, v in zip(found, d.misfit.data, strict=True):
        rows.append(
            {
                "depth": v.depth,
                **({} if v.since is None else {"since": v.since}),
                "value": c.fitted,
                "moved": c.fitted - c.predicted,
                "sd": c.sd,
                "reading_sd": c.reading_sd,
                "white": c.white,
                "contact": c.contact,
                "gain": c.gain,
                "expected": dict(c.expected),
                "inputs": dict(c.inputs),
                "metrics": dataclasses.asdict(metrics(v.value, c.fitted)),
            }
        )
    return rows


def gain_rows(d: Determination, found: Sequence[Gain]) -> list[dict[str, Any]]:
    """identification.gains: further tests in the order of what they show of the parameter that is known worst."""
    return [
        {
            "test": g.test,
            "before": dict(g.before),
            "after": dict(g.after),
            "information": w.information,
            "price": w.price,
        }
        for g, w in ranked_gains(found, weakest(d.known))
    ]


def _recomputed(plan: Plan, settled: ConfirmedOptimum) -> dict[str, Any]:
    """Values, curves and metrics of the run that confirmed the most likely point; none where no run of it has to."""
    run = next((r for r in reversed(settled.runs) if r.purpose == "identified"), None)
    if run is None or not run.done or not settled.verified:
        return {"values": None, "curves": {}, "metrics": {}}
    metrics = {e: dataclasses.asdict(m) for e, m in curve_metrics(plan, run.outcomes).items()}
    return {"values": dict(run.values), "curves": done_curves(plan, run.outcomes), "metrics": metrics}


def is_trusted(d: Determination, settled: ConfirmedOptimum) -> bool:
    """Whether simulations confirm what the surrogates say, and the model does not miss the data widely."""
    return (
        settled.verified and not (settled.open or settled.poor or d.refuting) and d.scale <= RULES.refuted_error_ratio
    )


def derived_quantities(plan: Plan, d: Determination, sure: bool = True) -> list[dict[str, Any]]:
    """identification.derived: what the backend derives from the parameters, with intervals of its own."""
    offered, box = capability(plan.backend, DerivedQuantities), d.misfit.model.box
    fixed = plan.resolved.fixed
    settings = plan.study.backend.settings
    found = [] if offered is None else offered.derived(settings, [*box.names, *fixed])
    return [{**one, "known": one["known"] and sure} for one in (_derived(q, box, fixed, d) for q in found)]


def _derived(q: DerivedQuantity, box: Box, fixed: Mapping[str, float], d: Determination) -> dict[str, Any]:
    def quantity(X: np.ndarray) -> np.ndarray:
        values = dict(zip(box.names, box.from_unit(X).T, strict=True))
        return np.broadcast_to(q.of({**{n: np.full(len(X), v) for n, v in fixed.items()}, **values}), len(X))

    i = derived_interval(d, quantity)
    outside = i.high < q.ordinary[0] or i.low > q.ordinary[1]
    fitted = dict(zip(box.names, box.from_unit(d.fit.x[None])[0].tolist(), strict=True))
    stated = rests_on(q.of, fitted, fixed)
    return {
        "name": q.name,
        "letter": q.letter,
        "description": q.description,
        "unit": q.unit,
        "value": i.value,
        "interval": [i.low, i.high],
        "known": not stated and is_known(i, scale=q.unit != "1"),
        "follows_from": stated,
        "ends_by": [list(i.low_by), list(i.high_by)],
        "unlikely": q.otherwise if outside else "",
    }


def identification(
    bench: Runner,
    emulator: Emulator,
    found: Sequence[SearchResult],
    best: tuple[str, int] | None,
    meanwhile: Sequence[Task] = (),
) -> tuple[dict[str, Any], tuple[Run, ...], list[str], Determination | None]:
    """Two parts of results.json, the runs made for them, warnings, what they show; `best` is a search and a place.

    What is wanted later may be run `meanwhile`.
    """
    plan = bench.plan
    try:
        settled = confirm_optimum(bench, emulator, found, meanwhile)
        plan = bench.around_failures(settled.emulator.group.reference is not None).plan
        done = identify(plan, settled, found, bench.evaluator.store)
        done = replace(done, determination=implausible(plan, doubted(done.determination, settled)))
    except (ValueError, np.linalg.LinAlgError) as error:
        return not_identified(plan, str(error)), (), [f"identification: {error}"], None
    d = done.determination
    chi2, p = (d.fit.chi2, d.p_value) if settled.chi2_bare is None else (settled.chi2_bare, settled.p_bare)
    warnings = [f"identification: {text}" for text in (d.warning, lenient(d.misfit, chi2, d.degrees, p)) if text]
    warnings += [*unstated(d), *_noiseless(plan, done.places, d)]
    if settled.agreement is None:
        warnings.append("identification: the most likely point could not be recomputed, its run has no answer")
    elif not settled.verified:
        warnings.append(
            "identification: the rerun of the most likely curve differs from its prediction by up to "
            f"{100 * settled.agreement:.2g} % of the largest value. Its χ² is {settled.chi2:.3g} instead of "
            f"{d.fit.chi2:.3g}: the surrogates are not accurate enough for these data"
        )
    elif settled.open:
        more = f" and {len(settled.open) - 2} more" if len(settled.open) > 2 else ""
        warnings.append(
            f"identification: after {len(settled.runs)} runs the surrogates are not accurate enough for these data "
            f"at {'; '.join(settled.open[:2])}{more}"
        )
    elif _hides_much(d, settled) and f"identification: {d.story}" not in warnings:
        warnings.append(f"identification: {d.story}")
    if d.draws is not None and not d.draws.enough:
        why = d.draws.doubt or f"only {d.draws.independent:.0f} of its draws are independent"
        text = f"identification: the chain of the posterior has not converged: {why}; its intervals are not given"
        warnings.append(text)
    if d.refuting:
        warnings.append(
            f"identification: {len(d.refuting)} finished run(s) agree with the data at values that the surrogates "
            "exclude. The intervals include them, and a parameter that they contradict is not called determined"
        )
    if best is not None:
        values = next(f.result.candidates[best[1]].values for f in found if f.plan.name == best[0])
        warnings += _far(d, f"{best[0]} {best[1] + 1}", values)
    return of_identification(plan, done, settled), settled.runs, warnings, d


def implausible(plan: Plan, d: Determination) -> Determination:
    """The same, no parameter called determined where :func:`_disbelieved`."""
    why = _disbelieved(plan, d)
    said = (doubt(k, "weakly", why, by="") if k.verdict.word == "determined" else k for k in d.known)
    return replace(d, known=tuple(said)) if why else d


def _disbelieved(plan: Plan, d: Determination) -> str:
    """Why nothing is called determined by a fit: what it asks of the material, and what it leaves of the curves."""
    return " ".join(filter(None, (_asks_too_much(plan, d), systematic_misfit(d))))


def _asks_too_much(plan: Plan, d: Determination) -> str:
    """Why a fit is not believed that asks for more than was stated and for an unlikely material; else nothing.

    That is where the whole interval of a parameter lies outside of the range that the study states, or the best fit at
    an end of what was searched, and that of a derived quantity outside of what is ordinary.  Either alone is a finding;
    both together are a sign that a stated dimension is wrong, or that the model lacks something.
    """
    stated, box = stated_ranges(plan), d.misfit.model.box
    ends = [
        k.profile_interval.open and not INTERVAL_BOUND_TOLERANCE < x < 1 - INTERVAL_BOUND_TOLERANCE
        for k, x in zip(d.known, d.fit.x, strict=True)
    ]
    beyond = [box.names[k] for k, known in enumerate(d.known) if ends[k] or _is_beyond(stated, box, k, known)]
    odd = [q["unlikely"] for q in derived_quantities(plan, d) if q["unlikely"]] if beyond else []
    if not odd:
        return ""
    names = " and ".join(symbol(n) for n in beyond)
    return " ".join(
        [f"The best fit has {names} beyond the stated range or at its end.", *(f"{q[:1].upper()}{q[1:]}." for q in odd)]
    )


def _is_beyond(stated: Box, box: Box, k: int, known: Known) -> bool:
    """Whether the whole interval of parameter k lies outside of the range that the study states."""
    low, high = physical(box, k, known.profile_interval)
    slack = 1e-9 * max(abs(stated.low[k]), abs(stated.high[k]))
    return bool(high < stated.low[k] - slack or low > stated.high[k] + slack)


def _hides_much(d: Determination, settled: ConfirmedOptimum) -> bool:
    """Whether the model agrees with the data only by what the surrogates may be off by, and misses them widely."""
    much = settled.chi2_bare is not None and settled.chi2_bare > RULES.refuted_error_ratio**2 * d.degrees
    return settled.verified and much and covered(d.p_value, settled.p_bare)


def doubted(d: Determination, settled: ConfirmedOptimum) -> Determination:
    """What is known, with no parameter called determined where simulations do not confirm what the surrogates say, or
    where what these may be off by hides a misfit of more than `refuted_error_ratio` times the errors; no p-value where
    it hides any.
    """
    hidden = _hides_much(d, settled)
    if settled.verified and settled.chi2_bare is not None and covered(d.p_value, settled.p_bare):
        text = (
            f"χ² = {significant(d.fit.chi2, 3)} for {d.degrees} degrees of freedom with the error of the surrogates, "
            f"{settled.chi2_bare:.3g} of the rerun without it. Whether the model fits is undecided."
        )
        d = replace(d, p_value=None, story=text)
    if settled.verified and not settled.open and not settled.poor and not hidden:
        return d
    word: Word = "weakly" if settled.verified else "not"
    why = "They do not know the curves well enough to exclude other values"
    if hidden and not settled.open:
        why = "What they may be off by hides a misfit"
    elif settled.agreement is None:
        why = "The most likely point has no answer"
    elif not settled.verified:
        why = "Simulations do not confirm them"
    elif settled.poor and not settled.open:
        why = f"Surrogates of {len(settled.poor)} fitted outputs miss surrogate.tolerance, {settled.poor[0]} among them"
    why += ': more runs (verify.max_infill, [doe]) or search.method = "gauss_newton" would decide it.'
    return replace(d, known=tuple(doubt(k, word, why) if k.verdict.word == "determined" else k for k in d.known))


def _noiseless(plan: Plan, places: Sequence[CurvePlace], d: Determination) -> list[str]:
    """Curves without stated noise whose readings show less than what is added for the computation of the curve."""
    said = []
    for p, data in zip(places, d.misfit.data, strict=True):
        # Usual errors are of the test as a whole, no noise of its readings.
        shown, data = curve_data(plan, p).as_stated, data.as_stated
        largest = float(np.abs(data.value).max()) or 1.0
        seen, whole = (float(np.sqrt(np.mean(v.sigma**2))) / largest for v in (shown, data))
        if np.isfinite(shown.freedom) and seen < MIN_MEASURED_SCATTER_SHARE and whole > 2.0 * seen:
            said.append(
                f"identification: the readings of {data.name} show no noise ({100 * seen:.1g} % of the largest "
                f"value); the intervals count the numerical error of the curve instead, {100 * whole:.1g} %. Real "
                "readings scatter: state noise under the experiment"
            )
    return said


def _far(d: Determination, name: str, values: Mapping[str, float]) -> list[str]:
    """A candidate that meets its targets may be far from what the whole curves say; half an interval away is said."""
    box, said = d.misfit.model.box, []
    x = box.to_unit(np.array([values[n] for n in box.names]))
    for k, known in enumerate(d.known):
        i = known.profile_interval
        if max(i.low - x[k], x[k] - i.high) > 0.5 * (i.high - i.low):
            low, high = physical(box, k, i)
            span = f"{low:.4g} to {high:.4g}{spaced(box.units[k])}"
            said.append(f"{known.name} = {values[known.name]:.4g} (the curves: {span})")
    if not said:
        return []
    why = (
        "its search takes the stated inputs as they are, the fit moves them within their uncertainty"
        if any(v.inputs for v in d.misfit.data)
        else "its search knows only the targets, more of them would bring it closer"
    )
    return [f"the best candidate, {name}, is not what the whole curves say: {', '.join(said)}; {why}"]


def not_identified(plan: Plan, reason: str) -> dict[str, Any]:
    """The same where nothing could be identified."""
    story = "Nothing can be said about {}: {}."
    unknown = {
        n: {"determined": False, "interval": [None, None], "story": story.format(n, reason)} for n in plan.box.names
    }
    return {"identification": None, "determined": unknown}


# ------------------------------------------------------------------------------------------------------ pieces


def _values(plan: Plan, box: Box, x: np.ndarray) -> dict[str, float]:
    return {**dict(zip(box.names, map(float, box.from_unit(x)), strict=True)), **plan.resolved.fixed}


def _known(box: Box, k: int, known: Known) -> dict[str, Any]:
    p, X = known.profile, np.tile(np.full(box.d, 0.5), (len(known.profile.at), 1))
    X[:, k] = p.at
    ends = [w for w, at in (("lower", known.profile_interval.at_low), ("upper", known.profile_interval.at_high)) if at]
    return {
        "parameter": known.name,
        "value": known.value,
        "verdict": known.verdict.word,
        "digits": known.verdict.digits,
        "sd_log": known.sd_log,
        "interval": list(physical(box, k, known.profile_interval)),
        "as_stated": None if known.as_stated is None else list(physical(box, k, known.as_stated.interval)),
        "usual_errors": {} if known.as_stated is None else dict(known.as_stated.shares),
        "bounds": ends,
        "laplace": list(physical(box, k, known.laplace)),
        "mcmc": None if known.mcmc is None else list(physical(box, k, known.mcmc)),
        "agreement": known.agreement,
        "noise_factor": known.verdict.noise_factor,
        "profile": {"values": box.from_unit(X)[:, k], "rise": p.rise, "change": p.change, "sigma": p.sigma},
        "story": known.story,
        "reason": known.reason,
    }


def _determined(box: Box, k: int, known: Known) -> dict[str, Any]:
    interval = list(physical(box, k, known.profile_interval))
    return {
        "determined": known.verdict.word == "determined",
        "interval": interval,
        "story": f"{known.story} {known.reason}".strip(),
    }
