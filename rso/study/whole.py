"""A whole study: all stages in order, results written after each."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rso.store import Done, RunStore
from rso.study import results, stages
from rso.study.plan import Plan
from rso.study.stages import Bench, Found, Watch

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
    found = results.begin(plan, command, datetime.now(UTC).isoformat(timespec="seconds"), jobs)
    path = folder / "results.json"
    bench = Bench(plan, store, executor, watch)
    clock = _Clock(found["timings"])

    def note(stage: str, **parts: Any) -> None:
        found.update(parts, stage=stage)
        clock.lap(stage)
        found["timings"]["total"] = time.perf_counter() - started
        results.write(path, found)

    note("plan")
    say("design: simulations to learn from")
    design = stages.run_design(bench)
    note("design", **results.of_design(plan, design))
    if not design.similar and design.proofs:
        found["warnings"].append(f"similarity {design.story}")
    say("surrogates: response surfaces of every output")
    fitted = stages.fit_surrogates(bench, design)
    found["runs"] += results.added_runs(plan, fitted)
    _warn_of_poor_surrogates(plan, fitted, found)
    note("surrogates", **results.of_surrogates(plan, design, fitted))
    say("sensitivity")
    note("sensitivity", **results.of_sensitivity(plan, stages.analyse(plan, fitted)))
    searches: list[Found] = []
    emulator = fitted.emulator
    for wanted in plan.searches:
        say(f"search {wanted.name!r}: NSGA-II, then its candidates are rerun")
        one = stages.find(bench, wanted, emulator)
        emulator = one.result.emulator
        searches.append(one)
        found["runs"] += results.candidate_runs(plan, one)
        note("search", **results.of_searches(plan, searches))
    note("verify")
    if plan.validation:
        say("validation: experiments kept for the end")
    checked = stages.validate(bench, searches[0])
    found["runs"] += [_validation_row(v, searches[0]) for v in checked]
    note("validate", **results.of_validation(plan, checked))
    found["counts"] = _counts(plan, design, found, store)
    found["timings"]["fe_cpu"] = sum(r["cpu_s"] or 0.0 for r in _distinct(found["runs"]))
    found["exit_code"] = exit_code(plan, found, searches)
    found["provenance"]["artefacts"] = _artefacts(design)
    found["provenance"]["solver"] = _solver(design)
    found["provenance"]["finished"] = datetime.now(UTC).isoformat(timespec="seconds")
    note("validate")
    return results.write(path, found)


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


def _warn_of_poor_surrogates(plan: Plan, fitted: stages.Fitted, found: dict[str, Any]) -> None:
    limit = plan.study.surrogate.tolerance
    poor = [(o, s) for o, s in fitted.held_out.items() if s.relative_rmse > limit]
    if poor:
        name, worst = max(poor, key=lambda pair: pair[1].relative_rmse)
        found["warnings"].append(
            f"{len(poor)} of {len(fitted.held_out)} surrogates miss surrogate.tolerance = {100 * limit:g} % on held-out "
            f"runs; worst is {name} with {100 * worst.relative_rmse:.2g} %"
        )


def _validation_row(v: stages.Validation, main: Found) -> dict[str, Any]:
    cause, reason = results._why(v.outcome)
    return {
        "key": v.outcome.key, "purpose": "validate", "state": type(v.outcome).__name__.lower(),
        "values": dict(main.result.candidates[v.candidate].values), "outputs": {}, "cause": cause, "reason": reason,
        "wall_s": getattr(v.outcome, "wall_s", None), "cpu_s": getattr(v.outcome, "cpu_s", None),
    }  # fmt: skip


def _distinct(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return list({r["key"]: r for r in runs if r["key"]}.values())


def _counts(plan: Plan, design: stages.Design, found: dict[str, Any], store: RunStore) -> dict[str, int]:
    runs = _distinct(found["runs"])
    states = [r["state"] for r in runs]
    return {
        "asked": len(design.asked) + plan.study.doe.held_out,
        "fe_runs": len(runs),
        **{state: states.count(state) for state in ("done", "failed", "crashed")},
        "from_store": 0,
        "saved_by_similarity": found["design"]["similarity"]["runs_saved"],
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
