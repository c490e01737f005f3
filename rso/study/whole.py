"""A whole study: all stages in order, results written after each."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rso.store import Done, RunStore
from rso.study import results, searching, stages
from rso.study.plan import Plan
from rso.study.searching import Found
from rso.study.stages import Bench, Watch

EXIT_DONE, EXIT_FAILED_RUNS, EXIT_NOT_VERIFIED, EXIT_NOT_DETERMINED = 0, 3, 4, 5


def run_study(
    plan: Plan,
    store: RunStore,
    executor: Executor,
    folder: Path,
    *,
    command: str,
    jobs: int,
    watch: Watch | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Run every stage, write ``results.json`` after each, return the results.

    Raises stages.NothingToFit when too few runs are done, StoreError, KeyboardInterrupt; what was computed stays.
    """
    started = time.perf_counter()
    found = results.begin(plan, command, _now(), jobs)
    bench = Bench(plan, store, executor, watch)
    known = {row.key for row in store.rows() if row.state != "crashed"}
    clock = _Clock(found["timings"])

    def note(stage: str, **parts: Any) -> dict[str, Any]:
        found.update(parts, stage=stage)
        clock.lap(stage)
        found["timings"]["total"] = time.perf_counter() - started
        return results.write(folder / "results.json", found)

    found["warnings"] += unused(plan)
    note("plan")
    say("design: simulations to learn from")
    design = stages.run_design(bench)
    if not design.similar and plan.group.reference is not None:
        found["warnings"].append(f"similarity {design.story}")
    note("design", **results.of_design(plan, design))
    say("surrogates: response surfaces of every output")
    try:
        fitted = stages.fit_surrogates(bench, design)
    except stages.NothingToFit as error:
        found["warnings"].append(str(error))
        note("design", counts=_counts(plan, found, known), exit_code=EXIT_FAILED_RUNS)
        raise
    found["runs"] += results.added_runs(plan, fitted)
    _warn_of_poor_surrogates(plan, fitted, found)
    note("surrogates", **results.of_surrogates(plan, design, fitted))
    say("sensitivity")
    note("sensitivity", **results.of_sensitivity(plan, stages.analyse(plan, fitted)))
    searches: list[Found] = []
    emulator = fitted.emulator
    say(f"search: NSGA-II for {', '.join(s.name for s in plan.searches)}; then all candidates are rerun")
    proposals = searching.propose_all(bench, emulator)
    for wanted, first in zip(plan.searches, proposals, strict=True):
        one = searching.find(bench, wanted, emulator, first)
        emulator = one.result.emulator
        searches.append(one)
        _warn_of_constraints(one, found)
        found["runs"] += results.candidate_runs(plan, one)
        note("search", **results.of_searches(plan, searches))
    note("verify")
    if plan.validation:
        say("validation: experiments kept for the end")
    checked = searching.validate(bench, searches, results.best(plan, searches))
    found["runs"] += results.validation_runs(checked)
    found["timings"]["fe_cpu"] = sum(r["cpu_s"] or 0.0 for r in _distinct(found["runs"]))
    found["provenance"].update(artefacts=_artefacts(design), solver=_solver(design), finished=_now())
    results.write_runs(folder / "runs.csv", found)
    return note(
        "validate",
        **results.of_validation(plan, checked),
        counts=_counts(plan, found, known),
        exit_code=exit_code(plan, found, searches),
    )


def unused(plan: Plan) -> list[str]:
    """Settings of the study file that ask for what is not done."""
    study = plan.study
    return [
        text
        for asked, text in (
            (study.sensitivity.morris, "sensitivity.morris = true: Morris screening is not part of a run, use Sobol"),
            (study.dispatch.engine != "local", f"dispatch.engine = {study.dispatch.engine!r}: runs are local"),
        )
        if asked
    ]


def exit_code(plan: Plan, found: dict[str, Any], searches: list[Found]) -> int:
    """4 if a candidate is not verified, 5 if a required parameter is not determined, 3 if runs failed, else 0."""
    if not all(s.result.verified for s in searches):
        return EXIT_NOT_VERIFIED
    if any(not found["determined"][n]["determined"] for n in plan.study.identify.require):
        return EXIT_NOT_DETERMINED
    return EXIT_FAILED_RUNS if any(r["state"] != "done" for r in found["runs"]) else EXIT_DONE


class _Clock:
    """Wall time by stage; laps of one stage add up."""

    def __init__(self, timings: dict[str, float]) -> None:
        self._timings, self._last = timings, time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self._timings[stage] = self._timings.get(stage, 0.0) + now - self._last
        self._last = now


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _warn_of_constraints(one: Found, found: dict[str, Any]) -> None:
    if not one.result.choice.feasible:
        found["warnings"].append(f"search {one.plan.name!r}: no point of the ranges respects every constraint")


def _warn_of_poor_surrogates(plan: Plan, fitted: stages.Fitted, found: dict[str, Any]) -> None:
    limit = plan.study.surrogate.tolerance
    used = {k: s for k, s in fitted.held_out.items() if k in stages.decisive(plan)}
    poor = [(o, s) for o, s in used.items() if s.relative_rmse > limit]
    if poor:
        name, worst = max(poor, key=lambda pair: pair[1].relative_rmse)
        found["warnings"].append(
            f"{len(poor)} of {len(used)} surrogates miss surrogate.tolerance = {100 * limit:g} % on the "
            f"last {worst.n} runs that were new to them; worst is {name} with {100 * worst.relative_rmse:.2g} %"
        )


def _distinct(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return list({r["key"]: r for r in runs}.values())


def _counts(plan: Plan, found: dict[str, Any], known: set[str]) -> dict[str, int]:
    """Simulations: asked by the study file, different ones behind `runs`, and how those ended."""
    runs = _distinct(found["runs"])
    states = [r["state"] for r in runs]
    design, cases = found["design"], len(plan.cases)
    return {
        "asked": cases * (design["asked"] + plan.study.doe.held_out),
        "fe_runs": len(runs),
        **{state: states.count(state) for state in ("done", "failed", "crashed")},
        "from_store": sum(r["key"] in known for r in runs),
        "saved_by_similarity": cases * design["similarity"]["runs_saved"],
    }


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
