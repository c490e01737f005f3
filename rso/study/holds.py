"""Holds of the records of a study: which of them a model can follow, and what is said of those that it cannot."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rso.contract import Backend, Case, Parameter, Relaxation, capability
from rso.data import CreepHold, Hold, MeasuredCurve, hold_of, recorded_speed
from rso.data.loading_rate import lost_work
from rso.study.cases import case_for, other_branch, speed_of
from rso.study.errors import Problem, study_error
from rso.study.resolve import Resolved
from rso.study.schema import Study
from rso.study.search_table import TargetTable

MAX_RELAXATION_TIME_RATIO = 3.0  # times as long as the hold: a relaxation time beyond is not told from a drift
MIN_RELAXATION_TIME_RATIO = 0.5  # of the first moment of a hold: a relaxation time below is over by then
MAX_LAST_MOMENT_RATIO = 1.1  # times the length of a hold up to which its last moment is meant
DIFFERENT_SPEED_RATIO = 1.5  # ratio of speeds that are different ones
MIN_LOST_WORK_SHARE = 0.02  # of the work of loading: less is hardly told from noise and from play of the drive
LOOP_RELAXATION_TIME_RATIOS = 0.05, 10.0  # times as long as loading and unloading: relaxation times that a loop shows
MIN_TIME_RANGE_RATIO = 10.0  # ratio of the ends of a range of times, at least where plausible times leave none


def middle(resolved: Resolved) -> dict[str, float]:
    """Values inside the ranges: at their ends an effect may be neutral."""
    return {a.name: 0.5 * (a.low + a.high) for a in resolved.axes} | dict(resolved.fixed)


def hold_in(study: Study, name: str, curve: MeasuredCurve) -> Hold | str:
    """The hold of an experiment whose loading is `curve`, or why it is of no use; "" where there is none."""
    return hold_of(study.measurement(name), speed_of(study, name)[0], float(curve.depth.max()))


def relaxes(backend: Backend, values: Mapping[str, float], case: Case) -> bool:
    """Whether forces go on changing while the indenter rests: the backend's word, else a time among the knobs in use.

    That the answer depends on the way there is not enough: it does with friction, and then a rest changes nothing.
    """
    known = capability(backend, Relaxation)
    if known is not None:
        return known.relaxes(values, case.settings)
    kept = backend.canonical(values, case)[0]
    return any(p.unit == "s" and p.name in kept for p in backend.parameters)


def relaxation_knobs(backend: Backend) -> tuple[Parameter, Parameter] | None:
    """The knobs that a first relaxation opens: a share that is absent at 0, and its time; None where there are none."""
    for share in backend.parameters:
        if share.group and share.neutral == 0.0 and share.unit == "1" and share.plausible and 0.0 < share.high <= 1.0:
            times = [p for p in backend.parameters if p.group == share.group and p.unit == "s" and p.plausible]
            if len(times) == 1:
                return share, times[0]
    return None


def hold_ranges(pair: tuple[Parameter, Parameter], hold: Hold | CreepHold) -> dict[str, tuple[float, float]]:
    """Ranges of a share and a time that a hold can show: the plausible ones, times as far as it lasts."""
    share, time = pair
    assert share.plausible is not None and time.plausible is not None
    low, high = MIN_RELAXATION_TIME_RATIO * float(hold.since[0]), MAX_RELAXATION_TIME_RATIO * hold.lasts
    low, high = (
        max(low, min(time.plausible[0], high / MIN_TIME_RANGE_RATIO)),
        min(high, max(time.plausible[1], MIN_TIME_RANGE_RATIO * low)),
    )
    return {share.name: share.plausible, time.name: (float(f"{low:.2g}"), float(f"{high:.2g}"))}


def followed(
    study: Study,
    backend: Backend,
    values: Mapping[str, float],
    found: Mapping[str, Hold | str],
    beside: Sequence[tuple[Mapping[str, float], Mapping[str, Any]]],
) -> dict[str, Hold]:
    """The holds of the experiments in which a model relaxes."""
    there = {}
    for name, hold in found.items():
        if isinstance(hold, str):
            continue
        case = case_for(study, name, (hold.depth,), hold)
        models = [(values, case), *((({**values, **v}), _within(case, s)) for v, s in beside)]
        if any(relaxes(backend, v, c) for v, c in models):
            there[name] = hold
    return there


def _within(case: Case, settings: Mapping[str, Any]) -> Case:
    return dataclasses.replace(case, settings={**case.settings, **settings})


def place_of_target(study: Study, t: TargetTable, hold: Hold | CreepHold | None) -> tuple[float, float]:
    """Depth (mm) and time in the hold (s) at which a target is met; StudyError for a hold that is not compared."""
    if not t.since:
        return (t.depth if hold is None else min(t.depth, hold.depth)), 0.0
    if hold is None or t.since > hold.lasts * MAX_LAST_MOMENT_RATIO:
        why = "no hold of it is compared" if hold is None else f"it holds for {hold.lasts:.3g} s"
        text = f"the target {t.channel} of {t.experiment!r} {t.since:g} s into its hold: {why}"
        raise study_error(study.file, study.lines, [Problem(("search", "targets"), text)])
    return hold.depth, min(hold.moments, key=lambda s: abs(s - t.since))


def value_at_rest(curve: MeasuredCurve, since: float) -> tuple[float, float]:
    """Value and standard uncertainty of a measured curve at a moment (s) of its hold."""
    assert curve.since is not None
    k = int(np.argmin(np.abs(np.where(curve.held, curve.since, np.inf) - since)))
    return float(curve.value[k]), float(curve.sigma[k])


def of_unused(backend: Backend, hold: Hold, inline: bool = False) -> list[str]:
    """What is said of a hold that the model of a study does not follow, and the lines that would open it, each by
    itself or `inline` in one sentence."""
    span = f"{hold.lasts:.3g} s at {hold.depth:.3g} mm"
    if not hold.fall:
        return [f"It holds for {span}, where Fz does not fall by more than noise: the hold is not fitted."]
    share = f"{100.0 * hold.fall:.2g} %"
    said = [
        f"It holds for {span}, where Fz falls by {share}. Only the loading is fitted: moduli are those of its rate, "
        f"and at rest the same body is at least {share} softer."
    ]
    pair = relaxation_knobs(backend)
    if pair is None:
        return [*said, f"The backend {backend.name!r} has no relaxation that would fit the hold."]
    lines = _opening(pair, hold_ranges(pair, hold))
    opens = "To fit the hold too, add below [parameters]:"
    return [*said, f"{opens} {' and '.join(lines)}."] if inline else [*said, opens, *(f"  {line}" for line in lines)]


def _opening(pair: tuple[Parameter, Parameter], ranges: Mapping[str, tuple[float, float]]) -> list[str]:
    """Lines of [parameters] that open a share and a time."""
    return [
        f"{p.name} = {{ low = {ranges[p.name][0]:g}, high = {ranges[p.name][1]:g}{log} }}"
        for p, log in zip(pair, ("", ', scale = "log"'), strict=True)
    ]


def of_loop(study: Study, backend: Backend, values: Mapping[str, float], name: str, inline: bool = False) -> list[str]:
    """What is said of a record whose unloading gives less work back than loading took, and what would fit that."""
    m, e = study.measurement(name), study.experiment(name)
    share = None if m.kind != "force" or e.branch == "unloading" or other_branch(study, name) else lost_work(m)
    if share is None or share < MIN_LOST_WORK_SHARE:
        return []
    work = f"Unloading gives back {100.0 * (1.0 - share):.0f} % of the work of loading."
    said = [f"{work} If the body relaxes, moduli are those of the rate of this test."]
    pair, speed = relaxation_knobs(backend), recorded_speed(m)
    deepest = max(float(r.depth.max()) for r in m.repeats)
    if pair is None or speed is None or relaxes(backend, values, case_for(study, name, (deepest,))):
        return said
    share_knob, time = pair
    assert share_knob.plausible is not None
    lasts = 2.0 * deepest / speed
    ends = tuple(float(f"{ratio * lasts:.2g}") for ratio in LOOP_RELAXATION_TIME_RATIOS)
    lines = _opening(pair, {share_knob.name: share_knob.plausible, time.name: (ends[0], ends[1])})
    opens = "To fit both branches, add below [parameters]:"
    return [*said, f"{opens} {' and '.join(lines)}."] if inline else [*said, opens, *(f"  {line}" for line in lines)]


def of_used(hold: Hold) -> list[str]:
    """What is said of a hold that is fitted."""
    fall = f", where Fz falls by {100.0 * hold.fall:.2g} %" if hold.fall else ", where Fz does not fall beyond noise"
    return [
        f"Loading and the hold of {hold.lasts:.3g} s at {hold.depth:.3g} mm are compared{fall}: "
        f"{len(hold.since)} moments of it."
    ]


def unseen(study: Study, backend: Backend, opened: Mapping[str, object], fitted: Sequence[str]) -> list[str]:
    """What is said of open relaxation times where no fitted record holds or returns, and all go at one speed."""
    times = [p.name for p in backend.parameters if p.unit == "s" and p.name in opened]
    speeds = [speed_of(study, name)[0] for name in fitted]
    if (
        not times
        or any(other_branch(study, name) for name in fitted)
        or max(speeds) > DIFFERENT_SPEED_RATIO * min(speeds)
    ):
        return []
    return [
        f"No fitted record holds, and all go at one speed: relaxation ({' and '.join(times)}) and a modulus are "
        "hardly separable. A hold, the unloading too, or tests at different speeds would separate them."
    ]
