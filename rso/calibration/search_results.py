"""Parts of results.json: searches with their candidates, which of them is best, and experiments kept for the end."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rso.calibration.plan import Plan, SearchPlan
from rso.calibration.range_extension import RangeStep
from rso.calibration.readings import compared_curves, profile_positions
from rso.calibration.search_stage import SearchResult, Validation, done_curves
from rso.emulation.emulator import Emulator
from rso.evaluation import Done, why
from rso.optimise.targets import Checked, Target

# times its noise: what a lateral force must be to count in the choice of the best candidate
MIN_LATERAL_FORCE_TO_NOISE = 3.0


def of_searches(plan: Plan, found: list[SearchResult], audit: Sequence[RangeStep]) -> dict[str, Any]:
    """searches, best, closest; `audit` is that of the first; the runs of candidates are added by the caller."""
    first = best(plan, found)
    near = closest(found) if first is None else None
    return {
        "searches": [_search(plan, f, () if k else audit) for k, f in enumerate(found)],
        "best": _named(first),
        "closest": _named(near),
    }


def _named(place: tuple[str, int] | None) -> dict[str, str] | None:
    return None if place is None else {"search": place[0], "candidate": f"{place[0]} {place[1] + 1}"}


def of_validation(found: list[Validation]) -> dict[str, Any]:
    """validation."""
    rows = []
    for v in found:
        cause, reason = why(v.outcome)
        rows.append(
            {
                "experiment": v.kept.experiment,
                "channel": v.kept.channel,
                "unit": v.kept.unit,
                "search": v.search,
                "candidate": f"{v.search} {v.candidate + 1}",
                "state": type(v.outcome).__name__.lower(),
                "cause": cause,
                "reason": reason,
                "depth": v.kept.depth,
                **v.kept.times,
                "measured": v.kept.value,
                "sigma": v.kept.sigma,
                "predicted": [] if v.predicted is None else v.predicted,
                "numerical_error": [] if v.error is None else v.error,
                "metrics": None if v.metrics is None else dataclasses.asdict(v.metrics),
                "position": profile_positions(v.kept.position),
            }
        )
    return {"validation": rows}


def best(plan: Plan, found: list[SearchResult]) -> tuple[str, int] | None:
    """Search and place of the candidate with the smallest study metric, averaged over the fitted curves.

    Only those are asked that are verified, meet every target and violate no constraint.
    """
    metric, telling = plan.study.search.metric, _telling(plan)
    scored = [
        (float(np.mean([getattr(m, metric) for n, m in scores.items() if n in telling])), f.plan.name, k)
        for f in found
        for k, (c, scores) in enumerate(zip(f.result.candidates, f.metrics, strict=True))
        if c.verified and c.meets and scores
    ]
    scored = [s for s in scored if math.isfinite(s[0])]
    if not scored:
        return None
    _, name, k = min(scored)
    return name, k


def closest(found: Sequence[SearchResult]) -> tuple[str, int] | None:
    """Search and place of the candidate that comes closest to what is demanded: constraints first, then targets."""
    every = [
        (c.distance, f.plan.name, k) for f in found for k, c in enumerate(f.result.candidates) if c.state == "done"
    ]
    return min(every)[1:] if every else None


def _telling(plan: Plan) -> set[str]:
    """Curves that a relative error says something about: a lateral force that is only noise about zero is none."""
    loud = {
        n
        for n, (_, c) in compared_curves(plan).items()
        if np.sum(c.value**2) > MIN_LATERAL_FORCE_TO_NOISE**2 * np.sum(c.sigma**2)
    }
    return {*plan.case_of, *loud}


def _search(plan: Plan, found: SearchResult, audit: Sequence[RangeStep]) -> dict[str, Any]:
    choice, front = found.result.choice, found.front
    return {
        "name": found.plan.name,
        "targets": [goal(g) for g in found.plan.goals],
        "ranges": {a.name: [a.low, a.high] for a in found.plan.axes},
        "kind": choice.kind,
        "reachable": choice.reachable,
        "story": found.story,
        "front": {"values": [plan.values(x) for x in front.X], "objectives": front.F},
        "candidates": [_candidate(plan, found, k) for k in range(len(found.result.candidates))],
        "infill": found.result.infill,
        "verified": found.result.verified,
        "met": any(c.meets for c in found.result.candidates),
        "audit": [_step(plan, s) for s in audit],
    }


def _step(plan: Plan, s: RangeStep) -> dict[str, Any]:
    unit = None if s.parameter is None else plan.box.units[plan.box.names.index(s.parameter)]
    return {
        "round": s.round,
        "what": s.what,
        "why": s.why,
        "parameter": s.parameter,
        "end": s.end,
        "from": s.before,
        "to": s.after,
        "unit": unit,
        "runs": s.runs,
    }


def _candidate(plan: Plan, found: SearchResult, k: int) -> dict[str, Any]:
    c, goals = found.result.candidates[k], {o.id: g for o, g in zip(found.plan.outputs, found.plan.goals, strict=True)}
    emulator = found.result.emulator
    errors: dict[str, float] = {}
    for name, index in plan.case_of.items() if c.state == "done" else ():
        outcome = c.outcomes[index]
        assert isinstance(outcome, Done)  # all of a candidate that is done are
        errors |= {o.id: o.error(outcome.response) for o in emulator.outputs if o.experiment == name}
    shown = list(dict.fromkeys([*found.plan.outputs, *(o for o in emulator.outputs if o in plan.extras)]))
    return {
        "name": f"{found.plan.name} {k + 1}",
        "values": dict(c.values),
        "state": c.state,
        "outputs": [
            {
                "output": o.id,
                "predicted": c.predicted[o.id][0],
                "sd": c.predicted[o.id][1],
                "recomputed": c.recomputed.get(o.id),
                "numerical_error": errors.get(o.id),
                "target": goals[o.id].value if o.id in goals else None,
            }
            for o in shown
        ],
        "agreement": c.agreement,
        "verified": c.verified,
        "worst": c.worst,
        "meets": c.meets if c.state == "done" else None,
        "demands": [demand(d) for d in c.checked],
        "curves": done_curves(plan, c.outcomes) if c.state == "done" else {},
        "metrics": {e: dataclasses.asdict(m) for e, m in found.metrics[k].items()},
        "at_bound": at_bound(found.plan, plan, c.values),
        "extrapolated": extrapolated(plan, emulator, c.values),
    }


def goal(target: Target) -> dict[str, Any]:
    """One target; `since_s` only of a moment in a hold, `input_error` only where stated inputs are uncertain."""
    return {k: v for k, v in dataclasses.asdict(target).items() if k not in ("since_s", "input_error") or v}


def demand(d: Checked) -> dict[str, Any]:
    """One target or constraint and how a candidate meets it; `words` only where it does not."""
    return {
        "kind": d.kind,
        "output": d.output,
        "demand": d.demand,
        "value": d.value,
        "miss": d.miss,
        "tolerance": d.tolerance,
        "unit": d.unit,
        "met": d.met,
        "words": None if d.met else str(d),
    }


def extrapolated(plan: Plan, emulator: Emulator, values: Mapping[str, float]) -> bool:
    """Whether a point lies outside the convex hull of the runs that the surrogates learnt from."""
    x = plan.box.to_unit(np.array([[values[n] for n in plan.box.names]]))
    return bool(emulator.beyond(np.clip(x, 0.0, 1.0))[0])


def at_bound(search: SearchPlan, plan: Plan, values: Mapping[str, float]) -> list[str]:
    """Parameters within 1 % of the width of the search's range of one of its ends."""
    x = plan.box.to_unit(np.array([[values[n] for n in plan.box.names]]))[0]
    width = np.maximum(search.high - search.low, 1e-12)
    near = np.minimum(np.abs(x - search.low), np.abs(search.high - x)) < 0.01 * width
    return [n for n, close in zip(plan.box.names, near, strict=True) if close]
