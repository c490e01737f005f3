"""A whole study: all stages in order, results written after each."""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from rso.calibration import (
    confirmed_optimum,
    deformed_body,
    formula_comparison,
    held_out,
    identification_stage,
    joined_runs,
    predictive_check,
    range_extension,
    required_runs,
    result_files,
    results,
    search_results,
    search_stage,
    sensitivity_stage,
    stages,
    uncertain_inputs,
)
from rso.calibration.exit_codes import EXIT_FAILED_RUNS, exit_code_of
from rso.calibration.gauss_newton import descent_results, iteration
from rso.calibration.plan import Plan
from rso.calibration.range_extension import ExtendedRanges
from rso.calibration.search_stage import SearchResult
from rso.calibration.stages import Runner
from rso.core.digits import two_digits
from rso.core.plain_results import RUN_STAGES
from rso.core.symbols import symbol, unit_text
from rso.core.units import people, spaced
from rso.emulation import emulator as emulator_file
from rso.evaluation import Evaluator, Watch
from rso.evaluation.store import Done, RunStore
from rso.inference import Determination
from rso.optimal_design import gains_of_repeats

Say = Callable[[str], None]
LARGE_NUMERICAL_ERROR_SHARE = 0.05  # of the largest value of a curve: a numerical error that leaves little to tell


def run_study(
    plan: Plan,
    store: RunStore,
    executor: Executor,
    folder: Path,
    *,
    command: str,
    jobs: int,
    watch: Watch | None = None,
    say: Say = lambda _: None,
    strict: bool = False,
) -> dict[str, Any]:
    """Run every stage, write ``results.json`` after each, return the results; `strict` is for the exit code alone.

    Where an earlier call has left results of the same study, they stay until there is more to show, and wall times
    add up; a call that finds everything computed keeps the times of the calls that did.

    Raises stages.NothingToFit when too few runs are done, StoreError, KeyboardInterrupt; what was computed stays.
    """
    notes = _begin(plan, store, folder, command, jobs)
    notes.write("plan")
    bench = Runner(plan, Evaluator(plan.backend, store, executor, watch))
    if plan.study.search.method == "gauss_newton":
        return _directly(bench, notes, say, strict)
    ranges = _learn(bench, notes, say)
    bench, searches = _search(ranges, notes, say)
    chosen = search_results.best(bench.plan, searches)
    determination = _identify(bench, searches, chosen, notes, say)
    return _validate(
        bench, ranges.design, search_stage.chosen_candidates(searches, chosen), determination, notes, say, strict
    )


def _directly(bench: Runner, notes: _Notes, say: Say, strict: bool) -> dict[str, Any]:
    """The same without a design and its surfaces: Gauss–Newton on simulations with their derivatives."""
    plan, found = bench.plan, notes.found
    say("search: Gauss–Newton on simulations and their derivatives")
    try:
        there = iteration.run_gauss_newton(bench, lambda theta, chi2: say(f"  {_values(plan, theta)}, χ² = {chi2:.4g}"))
    except stages.NothingToFit as error:
        found["warnings"].append(str(error))
        notes.write("plan", end=True, exit_code=EXIT_FAILED_RUNS, exit_reason=str(error))
        raise
    found["runs"] = results.run_rows(plan, there.runs)
    if there.best.confirmed:
        bench, before = _with_inputs(bench, there.likeliest, notes, say), len(there.runs)
        plan, there = bench.plan, iteration.with_uncertain_inputs(bench, there)
        found["runs"] += results.run_rows(plan, there.runs[before:])
    design = descent_results.design_of(plan, there)
    notes.write("search", **descent_results.descent_design(plan, there), **descent_results.of_gauss_newton(plan, there))
    say("identification: what the curves determine")
    one = (plan.searches[0].name, 0, found["searches"][0]["candidates"][0]["values"])
    bench.evaluator.begin(search_stage.validation_tasks(plan, [one]))
    known = None
    try:
        if not there.best.confirmed:
            raise ValueError(f"Gauss–Newton stopped without a confirmed answer: {there.best.why}")
        known, settled = iteration.identify_from_derivatives(plan, there)
        known = dataclasses.replace(known, determination=identification_stage.implausible(plan, known.determination))
        parts = identification_stage.of_identification(plan, known, settled)
        found["runs"] += results.run_rows(plan, settled.runs)
    except (ValueError, np.linalg.LinAlgError) as error:
        known, parts = None, identification_stage.not_identified(plan, str(error))
        found["warnings"].append(f"identification: {error}")
    found["warnings"] += [
        *descent_results.descent_warnings(plan, there, known),
        *rough(found["searches"][0]["candidates"]),
    ]
    notes.write("verify", **parts)
    return _validate(bench, design, [one], None if known is None else known.determination, notes, say, strict)


def _learn(bench: Runner, notes: _Notes, say: Say) -> ExtendedRanges:
    """Design, surrogates, the ranges that the main search needs, sensitivities."""
    plan, found = bench.plan, notes.found
    say("design: training runs of the surrogates")
    known = joined_runs.joined(plan, bench.evaluator.store, notes.before)
    if known.story:
        say(f"store: {known.story}")
    notes.write("plan", joined={**dataclasses.asdict(known), "story": known.story})
    if not known.points and (few := required_runs.too_few(plan)) is not None:
        raise few
    design = stages.run_design(bench, known.points)
    if not design.similar and plan.group.reference is not None:
        found["warnings"].append(f"similarity {design.story}")
    notes.write("design", **results.design_block(plan, design))
    say("surrogates: response surfaces of every output")
    try:
        fitted = stages.fit_surrogates(bench, design)
    except stages.NothingToFit as error:
        found["warnings"].append(str(error))
        notes.write("design", end=True, counts=notes.counts(plan), exit_code=EXIT_FAILED_RUNS, exit_reason=str(error))
        raise
    bench, before = _targets_with_inputs(bench, fitted, say)
    ranges = range_extension.extend_ranges(bench.around_failures(design.similar), design, fitted, say)
    plan, fitted = ranges.bench.plan, ranges.fitted
    if ranges.proposal is not None:  # the search begins with it
        search_stage.begin_candidates(ranges.bench, ranges.proposal)
    found["runs"] += [*results.run_rows(plan, before), *results.added_runs(plan, fitted)]
    _warn_of_poor_surrogates(plan, fitted, found)
    emulator_file.save_emulator(fitted.emulator, notes.path.parent / "surrogates")
    found["parameters"] = results.parameter_rows(bench.plan, plan)
    notes.write("surrogates", **results.of_surrogates(plan, ranges.design, fitted))
    say("sensitivity")
    notes.write(
        "sensitivity", **sensitivity_stage.of_sensitivity(plan, sensitivity_stage.analyse(plan, fitted, bench.plan))
    )
    return ranges


def _search(ranges: ExtendedRanges, notes: _Notes, say: Say) -> tuple[Runner, list[SearchResult]]:
    """Candidates of every search, verified."""
    bench, emulator, similar = ranges.bench, ranges.fitted.emulator, ranges.design.similar
    plan, found = bench.plan, notes.found
    searches: list[SearchResult] = []
    say(f"search: NSGA-II for {', '.join(s.name for s in plan.searches)}; then all candidates are rerun")
    proposals = search_stage.propose_all(bench, emulator, ranges.proposal)
    audit = ranges.audit
    for wanted, first in zip(plan.searches, proposals, strict=True):
        one = search_stage.find_candidates(bench, wanted, emulator, first)
        emulator, bench = one.result.emulator, bench.around_failures(similar)
        if not searches:
            audit = range_extension.audit_afterwards(plan, audit, one.result.choice.X)
        searches.append(one)
        _warn_of_constraints(one, found)
        _warn_of_reach(one, found)
        _warn_of_extrapolation(plan, one, found)
        found["runs"] += results.candidate_runs(plan, one)
        for c in search_results.of_searches(plan, [one], audit)["searches"][0]["candidates"]:
            state = "verified" if c["verified"] else "not verified" if c["state"] == "done" else c["state"]
            say(f"  {c['name']}: {_values(plan, c['values'])} ({state})")
        notes.write("search", **search_results.of_searches(plan, searches, audit))
    found["warnings"] += [f"Ranges of the main search: {s.why}" for s in audit[-1:] if s.what == "stopped"]
    found["warnings"] += rough(found["searches"][0]["candidates"])
    return bench, searches


def _values(plan: Plan, values: Mapping[str, float]) -> str:
    """Values of the open parameters in the units that people use."""
    each = []
    for a in plan.resolved.axes:
        label, factor = people(a.parameter.unit, abs(values[a.name]))
        each.append(f"{symbol(a.name)} = {values[a.name] * factor:.4g} {unit_text(label)}".strip())
    return ", ".join(each)


def _identify(
    bench: Runner, searches: list[SearchResult], chosen: tuple[str, int] | None, notes: _Notes, say: Say
) -> Determination | None:
    """What the curves determine; what is known then."""
    say("identification: what the curves determine")
    emulator = searches[-1].result.emulator
    likeliest = functools.partial(confirmed_optimum.most_likely_values, bench.plan, emulator, searches)
    bench = _with_inputs(bench, likeliest, notes, say)
    later = search_stage.validation_tasks(bench.plan, search_stage.chosen_candidates(searches, chosen))
    identified, extra, doubts, determination = identification_stage.identification(
        bench, emulator, searches, chosen, later
    )
    notes.found["runs"] += results.run_rows(bench.plan, extra)
    notes.found["warnings"] += [*_outside(identified.get("identification"), notes.found["parameters"]), *doubts]
    notes.write("verify", **identified)
    return determination


def _targets_with_inputs(
    bench: Runner, fitted: stages.FittedSurrogates, say: Say
) -> tuple[Runner, tuple[stages.Run, ...]]:
    """The same, whose targets know what uncertain inputs make of them, and the runs that say so.

    What has no answer is told where the identification asks again, at the point that it finds.
    """
    if not bench.plan.resolved.inputs or not any(g.read for s in bench.plan.searches for g in s.goals):
        return bench, ()
    say("uncertainty: simulations with the stated inputs one standard uncertainty off, for the targets of the search")
    try:
        values = confirmed_optimum.most_likely_values(bench.plan, fitted.emulator, ())
        aware, runs, _ = uncertain_inputs.learn_effects(bench, values)
    except (ValueError, np.linalg.LinAlgError):
        return bench, ()
    return aware, runs


def _with_inputs(bench: Runner, likeliest: Callable[[], Mapping[str, float]], notes: _Notes, say: Say) -> Runner:
    """The same, after simulations that say what the uncertain inputs of the study make of its curves."""
    if not bench.plan.resolved.inputs:
        return bench
    say("uncertainty: simulations with the stated inputs one standard uncertainty off")
    try:
        bench, runs, lost = uncertain_inputs.learn_effects(bench, likeliest())
    except (ValueError, np.linalg.LinAlgError) as error:
        bench = dataclasses.replace(bench, plan=dataclasses.replace(bench.plan, effects=()))
        runs, lost = (), [f"uncertainty: the stated inputs count as exact: {error}"]
    notes.found["runs"] += results.run_rows(bench.plan, runs)
    notes.found["warnings"] += lost
    return bench


def _validate(
    bench: Runner,
    design: stages.Design,
    chosen: list[search_stage.Chosen],
    determination: Determination | None,
    notes: _Notes,
    say: Say,
    strict: bool,
) -> dict[str, Any]:
    """The experiments kept for the end, and everything that is known only then; the whole results."""
    plan, found = bench.plan, notes.found
    result_files.write_draws(notes.path.parent / result_files.POSTERIOR_FILE, determination)
    picture = deformed_body.begin_deformed(bench, found, notes.path.parent)
    if plan.validation:
        say("validation: held-out experiments")
    values = None if determination is None else predictive_check.most_likely(plan, determination, chosen)
    if values is not None:
        bench.evaluator.begin(
            [held_out.task(plan, name, values) for name in predictive_check.held_out_experiments(plan)]
        )
    checked = search_stage.validate_candidates(bench, chosen)
    found["runs"] += results.validation_runs(checked)
    foretold = []
    if determination is not None and values is not None:
        foretold = predictive_check.predictive_checks(bench, determination, values)
        found["runs"] += results.predictive_check_runs([r for v in foretold for r in v.runs])
        found["warnings"] += predictive_check.prediction_warnings(plan, foretold)
        more = [*gains_of_repeats(determination), *predictive_check.gains(plan, determination, foretold)]
        found["identification"]["gains"] = identification_stage.gain_rows(determination, more)
    found["timings"]["fe_cpu"] = sum(r["cpu_s"] or 0.0 for r in _distinct(found["runs"]))
    found["provenance"].update(artefacts=_artefacts(design), solver=_solver(design), finished=_now())
    found.update(formula_comparison.of_formulas(plan, found))
    found.update(results.of_region(plan, bench.region(design.similar), found["runs"]))
    found["warnings"] += [found["feasible"]["story"]] if found["feasible"]["story"] else []
    units = {p.name: p.unit for p in plan.backend.parameters}
    result_files.write_runs(notes.path.parent / "runs.csv", found, units)
    counts, before = notes.counts(plan), notes.before
    if before is not None and before["stage"] == RUN_STAGES[-1] and counts["from_store"] == counts["fe_runs"]:
        notes.clock.stop(before["timings"])
        when = ("command", "started", "finished", "jobs")
        found["provenance"].update({k: v for k, v in before["provenance"].items() if k in when})
    found.update(**search_results.of_validation(checked), **predictive_check.of_predictions(foretold), counts=counts)
    deformed_body.write_deformed(picture, notes.path.parent)
    code, reason = exit_code_of(found, plan.study.identify.require, strict)
    return notes.write("validate", end=True, exit_code=code, exit_reason=reason)


@dataclass(frozen=True, eq=False)
class _Notes:
    """The results so far, and where they are written; `before` are those of an earlier call, `known` its runs."""

    found: dict[str, Any]
    path: Path
    before: dict[str, Any] | None
    known: frozenset[str]
    clock: _Clock

    def write(self, stage: str, *, end: bool = False, **parts: Any) -> dict[str, Any]:
        """Take the parts of a finished stage down; the file changes as soon as it shows more than it did before."""
        self.found.update(parts, stage=stage)
        self.clock.lap(stage)
        reached = -1 if self.before is None else RUN_STAGES.index(self.before["stage"])
        if end or RUN_STAGES.index(stage) >= reached:
            return result_files.write_results(self.path, self.found)
        return self.found

    def counts(self, plan: Plan) -> dict[str, int]:
        """Simulations: asked by the study file, different ones behind `runs`, and how those ended."""
        runs = _distinct(self.found["runs"])
        states = [r["state"] for r in runs]
        design, cases = self.found["design"], len(plan.cases)
        return {
            "asked": cases * (design["asked"] + plan.study.doe.held_out) if design["asked"] else 0,
            "fe_runs": len(runs),
            **{state: states.count(state) for state in ("done", "failed", "crashed")},
            "from_store": sum(r["key"] in self.known for r in runs),
            "saved_by_similarity": cases * design["similarity"]["runs_saved"],
        }


def _begin(plan: Plan, store: RunStore, folder: Path, command: str, jobs: int) -> _Notes:
    path = folder / "results.json"
    found = result_files.plainly(results.begun_results(plan, command, _now(), jobs))
    before = result_files.earlier(path, found)
    known = frozenset(row.key for row in store.rows() if row.state != "crashed")
    return _Notes(found, path, before, known, _Clock(found["timings"], before))


class _Clock:
    """Wall time by stage and in total; laps of one stage add up, also over the calls that an interruption parts."""

    def __init__(self, timings: dict[str, float], before: dict[str, Any] | None) -> None:
        self._timings, self._last = timings, time.perf_counter()
        self._stopped = False
        if before is not None:
            spent = {k: v for k, v in before["timings"].items() if k != "fe_cpu" and isinstance(v, int | float)}
            timings.update(spent)

    def lap(self, stage: str) -> None:
        if self._stopped:
            return
        now = time.perf_counter()
        for name in (stage, "total"):
            self._timings[name] = self._timings.get(name, 0.0) + now - self._last
        self._last = now

    def stop(self, timings: dict[str, float]) -> None:
        """Nothing was computed: the times are those that it took when it was."""
        self._timings.update(timings)
        self._stopped = True


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def rough(candidates: Sequence[Mapping[str, Any]]) -> list[str]:
    """Curves whose stated numerical error is a large share of them: an agreement within that says little.

    A contact far smaller than the elements has such a curve; so every material agrees with the data.
    """
    worst: dict[str, float] = {}
    for candidate in candidates:
        sizes: dict[str, float] = {}  # of all channels of a test: a lateral force may be zero by symmetry
        for curve in candidate["curves"].values():
            largest = max(map(abs, curve["value"]), default=0.0)
            sizes[curve["experiment"]] = max(sizes.get(curve["experiment"], 0.0), largest)
        for name, curve in candidate["curves"].items():
            size = sizes[curve["experiment"]]
            share = max(curve["error"], default=0.0) / size if size else 0.0
            worst[name] = max(worst.get(name, 0.0), share)
    return [
        f"{name}: the numerical error of the simulations is up to {two_digits(100 * share)} % of the largest value, so "
        "agreement within errors says little. The contact is small against the elements: use a finer mesh.level or "
        "a smaller specimen"
        for name, share in worst.items()
        if share > LARGE_NUMERICAL_ERROR_SHARE
    ]


def _warn_of_constraints(one: SearchResult, found: dict[str, Any]) -> None:
    if not one.result.choice.feasible:
        broken = [str(d) for c in one.result.candidates[:1] for d in c.checked if d.kind != "target" and not d.met]
        least = f"; where they are violated least, {'; '.join(broken)}" if broken else ""
        found["warnings"].append(f"search {one.plan.name!r}: no point of the ranges respects every constraint{least}")


def _outside(identification: dict[str, Any] | None, parameters: list[dict[str, Any]]) -> list[str]:
    """Warnings of most likely values outside of what the study states: ranges were widened, perhaps for what is missing
    in the model.  Nothing is said where stated values agree with the data as well: the interval holds some."""
    values = (identification or {}).get("values") or {}
    intervals = {p["parameter"]: p["interval"] for p in (identification or {}).get("parameters") or ()}
    said = []
    for p in parameters:
        (low, high), value = p["stated"], values.get(p["name"])
        allowed = intervals.get(p["name"])
        if allowed is not None and allowed[0] < high and low < allowed[1]:
            continue
        if value is not None and max(low - value, value - high) > 1e-9 * max(abs(low), abs(high)):
            said.append(
                f"identification: the most likely {p['name']}, {value:.3g}{spaced(p['unit'])}, lies outside the "
                f"stated range, {low:g} to {high:g}{spaced(p['unit'])}. The range is wrong, or the parameter makes "
                "up for something that the model lacks"
            )
    return said


def _warn_of_reach(one: SearchResult, found: dict[str, Any]) -> None:
    if one.result.choice.feasible and not one.result.choice.reachable:
        found["warnings"].append(f"search {one.plan.name!r}: {one.story}")


def _warn_of_extrapolation(plan: Plan, one: SearchResult, found: dict[str, Any]) -> None:
    emulator = one.result.emulator
    count = sum(search_results.extrapolated(plan, emulator, c.values) for c in one.result.candidates)
    if count:
        found["warnings"].append(
            f"search {one.plan.name!r}: {count} of {len(one.result.candidates)} candidates lie outside the convex "
            "hull of the runs; only their reruns are reliable there"
        )


def _warn_of_poor_surrogates(plan: Plan, fitted: stages.FittedSurrogates, found: dict[str, Any]) -> None:
    limit = plan.study.surrogate.tolerance
    used = {k: s for k, s in fitted.held_out.items() if k in stages.decisive(plan)}
    poor = stages.tolerance_misses(plan, fitted.emulator, used)
    if poor:
        name = max(poor, key=lambda i: poor[i])
        found["warnings"].append(
            f"{len(poor)} of {len(used)} surrogates miss surrogate.tolerance = {100 * limit:g} % of the spread of "
            f"their output on the last {used[name].n} unseen runs. The worst is {name} with "
            f"{two_digits(100 * poor[name])} %"
        )


def _distinct(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return list({r["key"]: r for r in runs}.values())


def _artefacts(design: stages.Design) -> dict[str, str]:
    found: dict[str, str] = {}
    for run in design.runs:
        for outcome in run.outcomes:
            for name, sha in outcome.case.artefacts.items():
                found[f"{outcome.case.name} {name}"] = sha
    return found


def _solver(design: stages.Design) -> str | None:
    for run in design.runs:
        for outcome in run.outcomes:
            if isinstance(outcome, Done):
                return outcome.response.info.get("solver")
    return None
