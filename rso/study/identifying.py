"""Identification of a study: what its measured curves say about the parameters, recomputed until it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.doe import Box
from rso.emulator import Emulator, relearn
from rso.identify import (
    Data,
    Determination,
    Fit,
    Known,
    MetricMinimum,
    Misfit,
    Model,
    Place,
    all_minima,
    compare_weightings,
    curve_score,
    determine,
    downhill,
    emulated,
    gain,
    has_gradients,
    minimise,
    resample,
    stack,
    together,
)
from rso.identify.verdict import physical
from rso.measurement import MeasuredCurve, combine
from rso.running import Outcome, Task
from rso.store import Done
from rso.study.ladder_curves import as_data, error_at
from rso.study.plan import Plan
from rso.study.searching import Found, Validation
from rso.study.stages import NOISE, Bench, Run, sample

METRICS = ("nrmse", "mre", "rrmse")
ROUNDS = 4  # runs of the most likely point, at most
SETTLED = 0.5  # of χ² in units of its least value per degree of freedom: what prediction and run may differ by


@dataclass(frozen=True, eq=False)
class Identified:
    """Data and what they determine; best fits by weighting, minima by metric."""

    places: tuple[Place, ...]
    determination: Determination
    weightings: dict[str, Fit]
    metrics: dict[str, tuple[MetricMinimum, ...]]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Likelihood of the fitted curves on an emulator, where they were measured, and starts (k, d) in the ranges."""

    misfit: Misfit
    places: tuple[Place, ...]
    near: np.ndarray


@dataclass(frozen=True, eq=False)
class Settled:
    """The most likely point, recomputed: the runs made for it, the emulator that knows them, how far it was off.

    `agreement` is the largest difference of predicted and recomputed curves over their largest value, `chi2` the
    misfit of the recomputed ones; both are None where the last run has no answer.  `verified` says whether the
    difference is within verify.tolerance and does not count beside the errors of the data.
    """

    emulator: Emulator
    runs: tuple[Run, ...]
    agreement: float | None
    chi2: float | None
    verified: bool


def evidence(plan: Plan, emulator: Emulator, found: Sequence[Found]) -> Evidence:
    """Likelihood of every fitted curve in the ranges of the main search.

    Errors: those of the measurement, the estimated numerical error of the first recomputed candidate and the standard
    deviation of the surrogates at the best fit; the latter two belong together over the depth of the curve.
    ValueError where the data or their errors allow no likelihood.
    """
    box, near = ranges(plan), _start(plan, found)
    places, curves = (list(v) for v in zip(*fitted_curves(plan), strict=True))
    data = [
        d.plus(together(p.depth, _numerical(plan, found, p), float(p.depth.max())))
        for p, d in zip(places, curves, strict=True)
    ]
    pairs = [emulated(emulator, p) for p in places]
    models = [_within(plan, box, model) for model, _ in pairs]
    model = stack(models) if len(models) > 1 else models[0]
    first = all_minima(Misfit(model, tuple(data)), seed=plan.seed, near=near)[0]
    there = _wide(plan, first.x[None])[0]
    banded = zip(data, pairs, strict=True)
    data = [d.plus(together(d.depth, band(there), float(d.depth.max()))) for d, (_, band) in banded]
    return Evidence(Misfit(model, tuple(data)), tuple(places), np.vstack([first.x[None], near]))


def settle(bench: Bench, emulator: Emulator, found: Sequence[Found], meanwhile: Sequence[Task] = ()) -> Settled:
    """Recompute the most likely point and learn it, until prediction and simulation agree (`ROUNDS` times at most).

    Workers that are free begin what will be wanted later, `meanwhile`.
    """
    plan, runs = bench.plan, []
    if emulator.reduced is None:  # exact: similarity knows every run already
        return Settled(emulator, (), 0.0, None, True)
    gap, chi2, verified = None, None, False
    for k in range(ROUNDS):
        now = evidence(plan, emulator, found)
        best = all_minima(now.misfit, seed=plan.seed, near=now.near)[0]
        values = plan.values(_wide(plan, best.x[None])[0])
        bench.begin(plan.tasks(values))  # before those, which may need artefacts
        bench.begin(meanwhile)
        (outcomes,) = bench.run([values])
        bench.begin(meanwhile)  # whose artefacts may be there by now
        runs.append(Run("identified", values, outcomes))
        if not runs[-1].done:
            return Settled(emulator, tuple(runs), None, None, False)
        curves = [_recomputed(plan, outcomes, p) for p in now.places]
        whole = now.misfit.model.predict(best.x[None])[0]
        predicted = np.split(whole, np.cumsum([len(c) for c in curves])[:-1])
        sizes = np.array([np.abs(y).max() for y in curves])
        sizes = np.maximum(sizes, NOISE * sizes.max())  # by symmetry a lateral force may be zero, or noise about it
        gap = max(float(np.abs(f - y).max() / s) for f, y, s in zip(predicted, curves, sizes, strict=True))
        measured = np.concatenate([d.value for d in now.misfit.data])
        chi2 = float(np.sum(now.misfit.white(np.concatenate(curves) - measured) ** 2))
        off = float(np.sum(now.misfit.white(np.concatenate(curves) - whole) ** 2))
        least = max(1.0, best.chi2 / max(now.misfit.n - len(best.x), 1))
        verified = gap <= plan.study.verify.tolerance and off <= SETTLED * least
        if verified or k == ROUNDS - 1:
            break
        emulator = relearn(emulator, [sample(plan, values, outcomes)], seed=plan.seed)
    return Settled(emulator, tuple(runs), gap, chi2, verified)


def identify(plan: Plan, emulator: Emulator, found: Sequence[Found]) -> Identified:
    """What follows from the likelihood: intervals, verdicts, best fits by weighting, minima by metric."""
    now = evidence(plan, emulator, found)
    misfit, near = now.misfit, now.near
    model, data, seed = misfit.model, misfit.data, plan.seed
    wanted = dict.fromkeys([plan.study.search.metric, *METRICS])
    minima = {
        m: minimise(curve_score(model, data, m), model.box, seed=seed, near=near, steps=downhill(model, data, m))
        for m in wanted
    }
    determination = determine(misfit, seed=seed, near=near)
    return Identified(now.places, determination, compare_weightings(misfit, near, seed=seed), minima)


def of_identification(plan: Plan, found: Identified, settled: Settled) -> dict[str, Any]:
    """identification, determined."""
    box, d = found.determination.misfit.model.box, found.determination
    first = d.fit
    return {
        "identification": {
            "level": 0.9,
            "data": [{"experiment": p.experiment, "channel": p.channel, "points": len(p.depth)} for p in found.places],
            "values": _values(plan, box, first.x),
            "chi2": first.chi2,
            "degrees": d.degrees,
            "p_value": d.p_value,
            "noise_degrees": float(d.misfit.freedom) if np.isfinite(d.misfit.freedom) else None,
            "scale": d.scale,
            "story": d.story,
            "recomputed": {
                "agreement": settled.agreement,
                "chi2": settled.chi2,
                "verified": settled.verified,
            },
            "other_minima": [{"values": _values(plan, box, m.x), "chi2": m.chi2} for m in d.others],
            "parameters": [_known(box, k, known) for k, known in enumerate(d.known)],
            "directions": [{"change": dict(v.change), "sd": v.sd, "story": v.story} for v in d.directions],
            "gains": [{"test": g.test, "before": dict(g.before), "after": dict(g.after)} for g in d.gains],
            "mcmc": None
            if d.draws is None
            else {"draws": len(d.draws.X), "tau": d.draws.tau, "independent": d.draws.independent},
            "weightings": [{"weighting": w, "values": _values(plan, box, f.x)} for w, f in found.weightings.items()],
            "metrics": [
                {"metric": name, "minima": [{"values": _values(plan, box, m.x), "value": m.value} for m in minima]}
                for name, minima in found.metrics.items()
            ],
        },
        "determined": {k.name: _determined(box, n, k) for n, k in enumerate(d.known)},
    }


def identification(
    bench: Bench, emulator: Emulator, found: Sequence[Found], best: tuple[str, int] | None,
    meanwhile: Sequence[Task] = (),
) -> tuple[dict[str, Any], tuple[Run, ...], list[str], Determination | None]:  # fmt: skip
    """Two parts of results.json, the runs made for them, warnings, what they tell; `best` is a search and a place.

    What is wanted later may be run `meanwhile`.
    """
    plan = bench.plan
    try:
        settled = settle(bench, emulator, found, meanwhile)
        done = identify(plan, settled.emulator, found)
    except (ValueError, np.linalg.LinAlgError) as error:
        return not_identified(plan, str(error)), (), [f"identification: {error}"], None
    d = done.determination
    warnings = [f"identification: {text}" for text in (d.story if d.scale > 1 else "", d.lenient) if text]
    if settled.agreement is None:
        warnings.append("identification: the most likely point could not be recomputed, its run has no answer")
    elif not settled.verified:
        warnings.append(
            f"identification: recomputed, the most likely curve differs from its prediction by up to "
            f"{100 * settled.agreement:.2g} % of its largest value, and its χ² is {settled.chi2:.3g} where "
            f"{d.fit.chi2:.3g} is expected: the surrogates are not good enough for what the data say"
        )
    if d.draws is not None and not d.draws.enough:
        warnings.append(f"identification: only {d.draws.independent:.0f} independent draws of the posterior")
    if best is not None:
        values = next(f.result.candidates[best[1]].values for f in found if f.plan.name == best[0])
        warnings += _far(d, f"{best[0]} {best[1] + 1}", values)
    return of_identification(plan, done, settled), settled.runs, warnings, d


def _far(d: Determination, name: str, values: Mapping[str, float]) -> list[str]:
    """A candidate that meets its targets may be far from what the whole curves say; half an interval away is said."""
    box, said = d.misfit.model.box, []
    x = box.to_unit(np.array([values[n] for n in box.names]))
    for k, known in enumerate(d.known):
        i = known.profile_interval
        if max(i.low - x[k], x[k] - i.high) > 0.5 * (i.high - i.low):
            low, high = physical(box, k, i)
            said.append(f"{known.name} = {values[known.name]:.4g} (the curves: {low:.4g} to {high:.4g} {box.units[k]})")
    if not said:
        return []
    return [
        f"the best candidate, {name}, is not what the whole curves say: {', '.join(said)}; its search knows only the "
        "targets, more of them would bring it closer"
    ]


def further_gains(plan: Plan, d: Determination, checked: Sequence[Validation]) -> list[dict[str, Any]]:
    """What the experiments that were kept for the end would add if they were fitted too.

    From the derivatives that the backend gives with each run; those of other backends are not known here.
    """
    box, found = d.misfit.model.box, {}
    for v in checked:
        measured = plan.curves[v.experiment]
        if measured.position is not None:  # of a profile no single channel has the derivatives
            continue
        if not isinstance(v.outcome, Done) or not has_gradients(v.outcome.response, measured.channel, box):
            continue
        response, x = v.outcome.response, box.to_unit(np.array([v.values[n] for n in box.names]))
        deepest = float(response.curve(measured.channel).travel_mm.max())
        keep = (measured.depth > 0) & (measured.depth <= deepest * (1 + 1e-9))
        place = Place(v.experiment, measured.channel, np.minimum(measured.depth[keep], deepest))
        J = np.stack([resample(response, place, n) for n in box.names], axis=1) * box.slope(np.clip(x, 0, 1))
        C = measured.covariance[np.ix_(keep, keep)] * d.scale**2
        C = (
            C
            + together(place.depth, error_at(response, place))
            + 1e-12 * np.eye(len(C)) * float(np.max(measured.value)) ** 2
        )
        # Of several candidates the one nearest to the most likely values speaks.
        apart = float(np.linalg.norm(x - d.fit.x))
        if v.experiment not in found or apart < found[v.experiment][0]:
            g = gain(box, d.fit.x, d.fit.fisher / d.scale**2, f"{v.experiment}, fitted too", J, C)
            found[v.experiment] = (apart, {"test": g.test, "before": dict(g.before), "after": dict(g.after)})
    return [row for _, row in found.values()]


def not_identified(plan: Plan, reason: str) -> dict[str, Any]:
    """The same where nothing could be identified."""
    story = "Nothing can be said about {}: {}."
    unknown = {
        n: {"determined": False, "interval": [None, None], "story": story.format(n, reason)} for n in plan.box.names
    }
    return {"identification": None, "determined": unknown}


# ------------------------------------------------------------------------------------------------------ pieces


def fitted_curves(plan: Plan) -> list[tuple[Place, Data]]:
    """Where the fitted curves were measured, as deep as they are simulated, and their values with their errors."""
    found, fitted = [], _fitted(plan)
    for name, channel in fitted:
        measured = _curve(plan, name, channel)
        deepest = max(o.depth_mm for o in plan.outputs if (o.experiment, o.channel) == (name, channel))
        keep = (measured.depth > 0) & (measured.depth <= deepest * (1 + 1e-9))
        label = name if len({c for e, c in fitted if e == name}) == 1 else f"{name} {channel}"
        data = as_data(label, name, measured, keep)
        found.append((Place(name, channel, np.minimum(measured.depth[keep], deepest)), data))
    return found


def ranges(plan: Plan) -> Box:
    """The ranges of the study file; the plan's own box may be wider, for a design that reaches beyond them."""
    main = plan.searches[0]
    low, high = plan.box.from_unit(np.stack([main.low, main.high]))
    return Box(plan.box.names, plan.box.units, tuple(map(float, low)), tuple(map(float, high)), plan.box.log)


def _wide(plan: Plan, X: np.ndarray) -> np.ndarray:
    """From the unit cube of the ranges to that of the plan's box."""
    main = plan.searches[0]
    return np.clip(main.low + X * (main.high - main.low), 0.0, 1.0)


def _within(plan: Plan, box: Box, model: Model) -> Model:
    return Model(box, lambda X: model.predict(_wide(plan, X)))


def _start(plan: Plan, found: Sequence[Found]) -> np.ndarray:
    """Candidates (k, d) of all searches in the unit cube of the ranges."""
    main, box = plan.searches[0], plan.box
    values = [c.values for f in found for c in f.result.candidates]
    X = box.to_unit(np.array([[v[n] for n in box.names] for v in values]).reshape(-1, box.d))
    return np.clip((X - main.low) / np.maximum(main.high - main.low, 1e-12), 0.0, 1.0)


def _fitted(plan: Plan) -> list[tuple[str, str]]:
    """(experiment, channel) of the curves with role "fit"; where there are none, of all not kept for the end."""
    every = [e for e in plan.study.experiments if e.name in plan.case_of]
    mine = [e for e in every if e.role == "fit"] or every
    return [(e.name, c) for e in mine for c in e.compared]


def _curve(plan: Plan, name: str, channel: str) -> MeasuredCurve:
    measured = plan.curves[name]
    if measured.channel == channel:
        return measured
    return combine(plan.study.measurement(name), plan.study.experiment(name).noise.noise(), channel)


def _numerical(plan: Plan, found: Sequence[Found], place: Place) -> np.ndarray:
    """Estimated numerical error (n,) at the measured depths, of the first candidate that was recomputed; else 0."""
    for f in found:
        for c in f.result.candidates:
            outcome = c.outcomes[plan.case_of[place.experiment]]
            if isinstance(outcome, Done):
                return error_at(outcome.response, place)
    return np.zeros_like(place.depth)


def _recomputed(plan: Plan, outcomes: Sequence[Outcome], place: Place) -> np.ndarray:
    """The simulated curve (n,) at the measured depths."""
    outcome = outcomes[plan.case_of[place.experiment]]
    assert isinstance(outcome, Done)
    return resample(outcome.response, place, "")


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
