"""Ranges that turn out too narrow are widened while the main search presses against an end; or it is said why not.

A candidate at an end of its range says that the best value may lie beyond; a target that no point of the ranges meets
may be met there.  Both are tried, step by step, and every step is written down with its reason.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.calibration import stages
from rso.calibration.plan import Plan, SearchPlan, ends_in
from rso.calibration.range_ends import RangeEnd, Stated, end_limit, moved_to, ordinary, room, with_ends
from rso.calibration.search_stage import Proposal, propose
from rso.calibration.stages import Design, FittedSurrogates, Run, Runner, outputs_sample
from rso.core.units import spaced
from rso.emulation.emulator import Emulator, reduced_box, relearn
from rso.evaluation import Done, why
from rso.study.resolve import Axis

MAX_WIDENING_ROUNDS = 12  # at most; a range that grows by half its width each time is then a hundred times as wide
RANGE_END_SHARE = 0.01  # share of the width of a range that counts as its end
MIN_RELATIVE_GAIN = 0.1  # an end whose move would help less than this share of the best one stays where it is
MIN_RUNS_PER_ROUND = 2  # new runs a round: at least this many, one more than there are parameters after similarity


@dataclass(frozen=True)
class RangeStep:
    """One line of the audit: what was done about which end of a range, why, and how many points were run for it.

    `what` is 'widened', 'taken back' or, in the last line, 'kept' (nothing to do), 'done' (candidates lie inside now)
    or 'stopped' (they do not, `why` says what stands in the way).
    """

    round: int
    what: str
    why: str
    parameter: str | None = None
    end: str | None = None
    before: float | None = None
    after: float | None = None
    runs: int = 0


@dataclass(frozen=True, eq=False)
class ExtendedRanges:
    """The bench with the ranges as they are now, the surrogates over them, the audit; `proposal` is the last search."""

    bench: Runner
    design: Design
    fitted: FittedSurrogates
    audit: tuple[RangeStep, ...]
    proposal: Proposal | None


def extend_ranges(
    bench: Runner, design: Design, fitted: FittedSurrogates, say: Callable[[str], None] = lambda _: None
) -> ExtendedRanges:
    """Widen the ranges of the main search until its candidates lie inside, or say why that is not to be had.

    An end that a valley touches moves to its limit at once: the valley either ends before it or does not.  Where the
    targets are out of reach, those ends move by half a width that bring the best compromise nearer.  Each round adds
    runs in the new part and fits the surrogates again.  No end passes its hard bound or `search.repair_limit`, nor goes
    so far that what holds of every ordinary material, all over the stated ranges, would not in a corner of the wider.
    """
    if not bench.plan.study.search.repair:
        return ExtendedRanges(bench, design, fitted, (), None)
    stated = Stated(bench.plan.searches[0].axes, ordinary(bench.plan))
    audit: list[RangeStep] = []
    barred: dict[RangeEnd, str] = {}  # ends that came back, with what stands in the way
    proposal = None
    for k in range(1, MAX_WIDENING_ROUNDS + 1):
        bench = bench.around_failures(design.similar)
        plan, axes = bench.plan, bench.plan.searches[0].axes
        proposal = proposal or propose(plan, plan.searches[0], fitted.emulator)
        moving, reason = _pressed(plan, proposal, stated, barred, fitted.emulator)
        wider = _moved(plan, proposal, moving, stated) if k < MAX_WIDENING_ROUNDS else {}
        if not wider:
            audit.append(RangeStep(k, _last_word(plan, proposal, audit), reason + _obstacle(moving, k)))
            break
        said = [
            f"{axes[e.j].name} {e.of(axes):.4g} → {to:.4g}{spaced(axes[e.j].parameter.unit)}" for e, to in wider.items()
        ]
        say(f"ranges: {reason}; {', '.join(said)}")
        grown, fitted_there, runs = _grown(bench, design, fitted, wider)
        rows = [RangeStep(k, "widened", reason, axes[e.j].name, e.word, e.of(axes), to) for e, to in wider.items()]
        audit += [replace(rows[0], runs=len(runs)), *rows[1:]]
        if doubt := _doubt(plan, proposal, fitted_there, runs):
            barred |= dict.fromkeys(wider, doubt)
            audit += [_back(row, f"beyond the former end {doubt}") for row in rows]
            fitted = replace(fitted, added=(*fitted.added, *runs))  # the search stays what it was
        else:
            design = replace(design, asked=_same_points(plan, grown.plan, design.asked))
            bench, fitted, proposal = grown, fitted_there, None
    return ExtendedRanges(bench, design, fitted, tuple(audit), proposal)


def audit_afterwards(plan: Plan, audit: Sequence[RangeStep], X: np.ndarray) -> tuple[RangeStep, ...]:
    """The audit, and one line more if the last candidates X (n, d) lie at an end although the first ones did not."""
    main = plan.searches[0]
    at = _ends_at(main, X)
    if not audit or audit[-1].what == "stopped" or not at:
        return tuple(audit)
    said = f"after its reruns a candidate lies at {_named(plan, at)} after all"
    return (*audit, RangeStep(audit[-1].round, "stopped", said))


# ------------------------------------------------------------------------------------------------------ what presses


def _ends_at(main: SearchPlan, X: np.ndarray) -> list[RangeEnd]:
    """Ends at which any of the points X (n, d) of the unit cube lies."""
    close = RANGE_END_SHARE * np.maximum(main.high - main.low, 1e-12)
    at = [(X - main.low < close).any(axis=0), (main.high - X < close).any(axis=0)]
    return [RangeEnd(j, side) for j in range(len(main.low)) for side in (0, 1) if at[side][j]]


def _pressed(
    plan: Plan, proposal: Proposal, stated: Stated, barred: dict[RangeEnd, str], emulator: Emulator
) -> tuple[list[RangeEnd], str]:
    """Ends worth moving and why; where there are none, why it ends."""
    choice, main = proposal.choice, plan.searches[0]
    if not choice.feasible:
        return [], "no point of the ranges respects every constraint; ranges are widened for targets only"
    touched = _ends_at(main, choice.X if choice.reachable else choice.X[:1])
    free = [e for e in touched if e not in barred and room(main.axes, stated, e, plan)]

    def limits(ends: Sequence[RangeEnd]) -> tuple[str, str]:
        return _and([_reach(plan, e) for e in ends]), _and([_stop(plan, stated, barred, e) for e in ends])

    if choice.reachable:
        return _reached(plan, proposal, touched, free, limits)
    return _missed(plan, proposal, touched, free, limits, emulator)


Words = Callable[[Sequence[RangeEnd]], tuple[str, str]]


def _reached(
    plan: Plan, proposal: Proposal, touched: list[RangeEnd], free: list[RangeEnd], limits: Words
) -> tuple[list[RangeEnd], str]:
    valley = proposal.choice.kind == "valley"
    if not touched:
        return [], "every candidate lies inside the ranges and the targets are met"
    if free:
        word = "a valley of values that all agree with the targets" if valley else "a candidate"
        return free, f"{word} reaches {_named(plan, free)}"
    reach, stop = limits(touched)
    if valley:
        return [], f"every {reach} agrees with the targets, along a valley; {stop}"
    return [], f"a candidate that meets the targets lies at the end of what is allowed, {reach}; {stop}"


def _missed(
    plan: Plan, proposal: Proposal, touched: list[RangeEnd], free: list[RangeEnd], limits: Words, emulator: Emulator
) -> tuple[list[RangeEnd], str]:
    choice, miss = proposal.choice, _miss(plan, proposal)
    if not touched:
        edge = " at the edge of where runs have an answer" if _at_edge(plan, choice.X[0]) else ""
        return [], f"the best compromise misses {miss} and lies inside the ranges{edge}: wider ones would not help"
    gains = {e: _gain(plan, emulator, choice.X[0], e, choice.tolerance) for e in touched}
    best = max(gains.values())
    useful = [e for e in touched if gains[e] > MIN_RELATIVE_GAIN * best and gains[e] > 0]
    moving = [e for e in useful if e in free]
    if not useful:
        return [], f"the best compromise misses {miss}, and no wider range would bring it nearer"
    if not moving:
        reach, stop = limits(useful)
        return [], f"the targets lie outside what any {reach} reaches: the best compromise misses {miss}; {stop}"
    press = _named(plan, moving)
    return moving, f"the targets are out of reach (the best compromise misses {miss}) and press against {press}"


def _gain(plan: Plan, emulator: Emulator, x: np.ndarray, e: RangeEnd, tolerance: np.ndarray) -> float:
    """How fast the root of the squared misses (in tolerances) falls towards the outside of an end, per width."""
    main = plan.searches[0]
    width = main.high[e.j] - main.low[e.j]
    inner = x.copy()
    inner[e.j] += (1 if e.side == 0 else -1) * 2 * RANGE_END_SHARE * width
    targets = np.array([g.value for g in main.goals])
    r = (emulator.means(main.outputs, np.stack([x, inner])) - targets) / tolerance
    size = np.sqrt((r**2).sum(axis=1))
    return float(size[1] - size[0]) / (2 * RANGE_END_SHARE)


def _miss(plan: Plan, proposal: Proposal) -> str:
    choice = proposal.choice
    rows = zip(plan.searches[0].goals, choice.residual[0], choice.tolerance, strict=True)
    return _and([f"{t} by {r:+.3g}{spaced(t.unit)}" for t, r, tol in rows if abs(r) > tol])


def _at_edge(plan: Plan, x: np.ndarray) -> bool:
    excess = plan.excess(x[None])
    return bool(excess.size and excess.max() > -0.1)


# ------------------------------------------------------------------------------------------------------ how far


def _moved(plan: Plan, proposal: Proposal, moving: Sequence[RangeEnd], stated: Stated) -> dict[RangeEnd, float]:
    """New values of the ends; empty where similarity would run outside the hard bounds however little they moved."""
    axes = plan.searches[0].axes
    whole = proposal.choice.reachable and proposal.choice.kind in ("valley", "islands")
    share = 1.0
    for _ in range(6):
        wider: dict[RangeEnd, float] = {}
        for e in moving:
            wider[e] = moved_to(plan, with_ends(axes, wider), stated, e, share, whole)
        if _may_run(_widened(plan, with_ends(axes, wider))):
            return wider
        share, whole = 0.5 * share, False
    return {}


def _widened(plan: Plan, axes: tuple[Axis, ...]) -> Plan:
    """The plan with wider ranges of its main search; variants keep theirs, the reference of similarity its value."""
    box = replace(
        plan.box,
        low=tuple(min(a.low, x) for a, x in zip(axes, plan.box.low, strict=True)),
        high=tuple(max(a.high, x) for a, x in zip(axes, plan.box.high, strict=True)),
    )
    main, *variants = plan.searches
    searches = [replace(main, axes=axes), *variants]
    ends = [ends_in(s.axes, box) for s in searches]
    searches = [replace(s, low=low, high=high) for s, (low, high) in zip(searches, ends, strict=True)]
    resolved = replace(plan.resolved, axes=axes)
    return replace(plan, box=box, resolved=resolved, searches=tuple(searches))


def _may_run(plan: Plan) -> bool:
    """Whether every reduced point lies within the hard bounds of the backend."""
    reduced = reduced_box(plan.box, plan.group)
    if plan.group.reference is None or reduced is None:
        return True
    hard = {a.name: a.parameter for a in plan.resolved.axes}
    return all(
        hard[n].low <= low and high <= hard[n].high
        for n, low, high in zip(reduced.names, reduced.low, reduced.high, strict=True)
    )


# ------------------------------------------------------------------------------------------------------ new runs


def _grown(
    bench: Runner, design: Design, fitted: FittedSurrogates, wider: dict[RangeEnd, float]
) -> tuple[Runner, FittedSurrogates, tuple[Run, ...]]:
    """The bench over wider ranges, its surrogates, and the runs that were added for them."""
    plan = _widened(bench.plan, with_ends(bench.plan.searches[0].axes, wider))
    grown = replace(bench, plan=plan).around_failures(design.similar)
    old = fitted.emulator
    reduced, room = reduced_box(plan.box, old.group), max(plan.study.verify.max_infill, MIN_RUNS_PER_ROUND)
    count = 0 if reduced is None else min(max(MIN_RUNS_PER_ROUND, reduced.d + 1), room)
    points = stages.farthest_values(grown.plan, old.group, old.samples, count)
    first = tuple(Run("repair", v, o) for v, o in zip(points, grown.run(points), strict=True))
    new = [outputs_sample(plan, r.values, r.outcomes) for r in first if r.done]
    if count and not new:
        return grown, replace(fitted, added=(*fitted.added, *first)), first
    wide = replace(old, box=plan.box, reduced=reduced)
    emulator = relearn(wide, [], seed=plan.seed, each=grown.evaluator.each_now)  # of the kinds that they are
    scores = dict(fitted.held_out)
    if new:  # what suits the wider ranges may be another kind of surrogate
        scores = {o.id: emulator.score(o, new) for o in emulator.outputs}
        emulator = stages.learnt_anew(plan, old.group, old.outputs, (*old.samples, *new), each=grown.evaluator.each)
    if new and stages.tolerance_misses(plan, emulator, scores):
        points = stages.worst(grown.around_failures(design.similar).plan, emulator, min(len(new), room - len(first)))
        more = tuple(Run("repair", v, o) for v, o in zip(points, grown.run(points), strict=True))
        first += more
        if fresh := [outputs_sample(plan, r.values, r.outcomes) for r in more if r.done]:
            emulator, scores, more = stages.refine(grown, emulator, fresh, room - len(first), "repair")
            first += more
    return grown, FittedSurrogates(emulator, scores, (*fitted.added, *first)), first


def _doubt(plan: Plan, proposal: Proposal, fitted: FittedSurrogates, runs: Sequence[Run]) -> str:
    """Why the new part of the ranges is of no use; empty if it is of use."""
    if runs and not any(r.done for r in runs):
        found = [why(o) for r in runs for o in r.outcomes if not isinstance(o, Done)]
        first = {cause: reason for cause, reason in reversed(found)}  # one example of each cause
        said = [f"{reason}" if cause == "not_supported" else f"{cause}, {reason}" for cause, reason in first.items()]
        tried = f"none of the {len(runs)} points tried has an" if len(runs) > 1 else "the point tried has no"
        return f"{tried} answer. The simulation says: {'; '.join(said)}"
    errors = stages.tolerance_misses(plan, fitted.emulator, fitted.held_out).values()
    # Where the targets are met already, ranges that the surrogates do not follow would spoil more than they tell.
    if runs and proposal.choice.reachable and errors:
        return f"the surrogates miss new runs by {100 * max(errors):.2g} % of their spread, above surrogate.tolerance"
    return ""


def _same_points(before: Plan, now: Plan, X: np.ndarray) -> np.ndarray:
    return np.clip(now.box.to_unit(before.box.from_unit(X)), 0.0, 1.0)


# ------------------------------------------------------------------------------------------------------ words


def _last_word(plan: Plan, proposal: Proposal, audit: Sequence[RangeStep]) -> str:
    choice = proposal.choice
    if choice.feasible and choice.reachable and not _ends_at(plan.searches[0], choice.X):
        return "done" if audit else "kept"
    return "stopped"


def _obstacle(moving: Sequence[RangeEnd], k: int) -> str:
    """Why ends that are worth moving do not move."""
    if not moving:
        return ""
    return (
        f"; {k} rounds are enough"
        if k == MAX_WIDENING_ROUNDS
        else "; similarity would need values beyond the hard bounds"
    )


def _back(row: RangeStep, reason: str) -> RangeStep:
    return replace(row, what="taken back", why=reason, before=row.after, after=row.before)


def _reach(plan: Plan, e: RangeEnd) -> str:
    return f"{plan.searches[0].axes[e.j].name} {('down to', 'up to')[e.side]} {_place(plan, e)}"


def _place(plan: Plan, e: RangeEnd) -> str:
    axes = plan.searches[0].axes
    return f"{e.of(axes):.4g}{spaced(axes[e.j].parameter.unit)}"


def _stop(plan: Plan, stated: Stated, barred: dict[RangeEnd, str], e: RangeEnd) -> str:
    """'10 MPa is the hard bound', or whatever else stops that end."""
    if e in barred:
        return f"{('below', 'above')[e.side]} {_place(plan, e)} {barred[e]}"
    if words := end_limit(plan, plan.searches[0].axes, stated, e)[1]:
        return f"{_place(plan, e)} {words}"
    told = plan.study.search.repair_limit
    limit_is = (
        "a width a side, the limit where search.repair_limit is not stated,"
        if told is None
        else (f"search.repair_limit = {told:g}")
    )
    return f"{limit_is} ends the range at {_place(plan, e)}"


def _named(plan: Plan, ends: Sequence[RangeEnd]) -> str:
    return _and([f"the {e.word} end of {plan.box.names[e.j]}" for e in ends])


def _and(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""
