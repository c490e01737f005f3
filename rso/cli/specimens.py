"""`rso check`, `run`, `status` and `report` of a study of many specimens."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rso.calibration import uncertain_inputs
from rso.calibration.plan import Plan, source_of
from rso.cli import output
from rso.cli.answer import interval_in_unit
from rso.cli.checking import sketch_lines
from rso.contract import digest
from rso.core import disk
from rso.core.digits import quantity_text
from rso.core.symbols import symbol
from rso.population.plans import specimen_plans
from rso.population.summary import (
    SPECIMENS_FILE,
    SPECIMENS_SCHEMA,
    folder_of,
    is_finished,
    population_summary,
    specimen_results,
    write_summary,
)
from rso.study.errors import Problem, study_error
from rso.study.specimens import SpecimenStudies, load_specimens

MAX_SPECIMEN_LINES = 12  # specimens that `rso check` lists


def check_specimens(options: argparse.Namespace, folder: Path) -> int:
    """Print what would run of each specimen, and how much of it is shared; nothing is computed."""
    found = load_specimens(options.study)
    first = found.studies[0]
    source = source_of(first)
    if (why := source.missing()) is not None:
        place = ("backend", "use" if source.use else "command")
        raise study_error(found.file, first.lines, [Problem(place, why, source.use)])
    head = [f"{found.file}: good", f"  {found.title}: {len(found.studies)} specimens"]
    if not (options.trust or source.own):
        what = repr(source.use) if source.use else shlex.join(source.command or ())
        head[0] += " as far as this can be said without its backend"
        output.lines([*head, f"  {what} is foreign code and was not loaded; if you trust it: rso check --trust"])
        return 0
    plans = specimen_plans(found)
    output.lines(
        [*head, *sketch_lines(plans[0]), *_things(found, plans), *_sizes(plans), *_alike(plans), f"  results: {folder}"]
    )
    name = shlex.quote(found.names[0])
    output.say(f"  one alone, in full: rso check {shlex.quote(str(options.study))} --specimen {name}")
    return 0


def _things(found: SpecimenStudies, plans: Sequence[Plan]) -> list[str]:
    """Each specimen in a line: its tests and what is its own."""
    lines = []
    for plan in plans[:MAX_SPECIMEN_LINES]:
        name = plan.study.specimen
        tests = ", ".join(
            f"{e.name} to {quantity_text(plan.curves[e.name].depth.max(), 'mm')}"
            for e in plan.study.experiments
            if e.kind == "force"
        )
        own = ", ".join(f"{k} = {v}" for k, v in found.own[name].items())
        lines.append(f"  {name}: {tests}" + (f"; {own}" if own else ""))
    left = len(plans) - MAX_SPECIMEN_LINES
    return [*lines, f"  and {left} more"] if left > 0 else lines


def _sizes(plans: Sequence[Plan]) -> list[str]:
    """What is said of stated sizes and their uncertainties, with the specimens that it is said of where not of all."""
    said: dict[str, list[str]] = {}
    for plan in plans:
        for line in uncertain_inputs.said_of_inputs(plan):
            said.setdefault(line, []).append(plan.study.specimen)
    lines = []
    for line, names in list(said.items())[:MAX_SPECIMEN_LINES]:
        few = ", ".join(names[:MAX_SPECIMEN_LINES])
        lines.append(
            line
            if len(names) == len(plans)
            else f"{line} ({few}{' and others' if len(names) > MAX_SPECIMEN_LINES else ''})"
        )
    left = len(said) - MAX_SPECIMEN_LINES
    return [*lines, f"  and {left} more sentences on sizes"] if left > 0 else lines


def _alike(plans: Sequence[Plan]) -> list[str]:
    """How many different designs there are: specimens with equal cases share theirs."""
    kinds: dict[str, int] = {}
    for plan in plans:
        key = digest([[c.programme.plain(), dict(c.settings)] for c in plan.cases])
        kinds[key] = kinds.get(key, 0) + 1
    many = "design" if len(kinds) == 1 else "designs"
    return [f"  simulations: {len(kinds)} {many} for {len(plans)} specimens; those of one geometry share theirs"]


def run_many(options: argparse.Namespace, folder: Path, store: Path, command: str) -> int:
    """Run the specimens that are not finished, or the one that was named, and write the summary; the exit code."""
    from rso.calibration.result_files import claim, may_be_moved
    from rso.cli.progress import Progress
    from rso.evaluation import executor
    from rso.evaluation.store import RunStore, set_aside
    from rso.population.running import run_specimens
    from rso.report import render, render_specimens

    found = load_specimens(options.study)
    first = found.study(options.specimen) if options.specimen else found.studies[0]
    if options.fresh and folder.exists():
        inputs = [*(f for s in found.studies for f in s.inputs()), *([found.table] if found.table else [])]
        may_be_moved(folder, found.file, inputs)
    plans = specimen_plans(found)
    wanted = [p for p in plans if options.specimen in (None, p.study.specimen)]
    jobs = options.jobs or first.dispatch.jobs
    html, pdf = first.report.html, first.report.pdf
    quiet = options.quiet or options.json
    with executor(first.dispatch, jobs, source_of(first), folder) as pool:
        if options.fresh and folder.exists():
            aside = set_aside(folder)
            if not options.json:
                output.say(f"old results moved to {aside}")
        claim(folder, found.file)
        with RunStore(store) as runs, Progress(quiet) as progress:
            stopped = run_specimens(
                wanted,
                runs,
                pool,
                folder,
                command=command,
                jobs=jobs,
                watch=progress.watch,
                say=progress.say,
                strict=options.strict,
                pages=lambda one, place: render(one, place, html=html, pdf=pdf) if html or pdf else None,
            )
            progress.say("summary: parameters over all specimens")
    answer = population_summary(plans, folder, stopped, found.own, found.notes, command)
    files = write_summary(folder, answer)
    if html or pdf:
        files += render_specimens(answer, folder, html=html, pdf=pdf)
    if options.json:
        keys = ("words", "warnings", "population", "counts", "exit_code", "exit_reason")
        print(json.dumps({"results": str(folder), **{k: answer[k] for k in keys}}, indent=1, ensure_ascii=False))
        return int(answer["exit_code"])
    print()
    output.bold(answer["study"]["title"])
    output.wrapped_sentences(answer["words"])
    if not options.quiet:
        output.lines(_table(answer))
        output.wrapped_sentences([f"warning: {w}" for w in answer["warnings"]])
        c = answer["counts"]
        output.say(f"  {c['done']} of {c['specimens']} specimens have an answer, by {c['runs']} different simulations")
    output.lines([f"  {f}" for f in files])
    return output.say_why_ended(int(answer["exit_code"]), answer["exit_reason"])


def _table(answer: Mapping[str, Any]) -> list[str]:
    """A line for each specimen: its parameters with intervals, or why it has none."""
    wide = max(len(s["name"]) for s in answer["specimens"])
    lines = []
    for s in answer["specimens"]:
        if s["state"] != "done":
            lines.append(f"  {s['name']:{wide}}  {s['state']}: {s['reason'] or 'not run yet'}")
            continue
        parts = []
        for p in s["parameters"]:
            if p["verdict"] != "fixed" and None not in p["interval"]:
                span = interval_in_unit(p["interval"], p["unit"])
                parts.append(f"{symbol(p['parameter'])} {span}" + " (outlier)" * p["outlier"])
        lines.append(f"  {s['name']:{wide}}  {'; '.join(parts)}")
    return lines


def status_of_many(options: argparse.Namespace, folder: Path) -> int:
    """Print how far the specimens are and what was found; always 0."""
    found = load_specimens(options.study)
    states = {s.specimen: _state(folder, s.specimen, s.sha256) for s in found.studies}
    done = [n for n, state in states.items() if state == "done"]
    answer = _summary(folder)
    then = f"rso run {shlex.quote(str(options.study))}"
    out = f" --out {shlex.quote(str(options.out))}" if options.out else ""
    then = f"{then}{out}" if len(done) < len(states) else f"rso open {shlex.quote(str(options.study))}{out}"
    if options.json:
        data = {"study": str(found.file), "results": str(folder), "specimens": states, "next": then}
        kept = {k: answer[k] for k in ("words", "population", "exit_code", "exit_reason")} if answer else {}
        print(json.dumps({**data, **kept}, indent=1, ensure_ascii=False))
        return 0
    output.bold(found.title)
    output.say(f"  {len(done)} of {len(states)} specimens are finished")
    rest = [f"{n} ({state})" for n, state in states.items() if state != "done"]
    if rest:
        more = f" and {len(rest) - MAX_SPECIMEN_LINES} more" if len(rest) > MAX_SPECIMEN_LINES else ""
        output.lines([f"  not finished: {', '.join(rest[:MAX_SPECIMEN_LINES])}{more}"])
    if answer:
        output.wrapped_sentences(answer["words"])
        if answer["exit_code"]:
            output.lines([f"  exit code {answer['exit_code']}: {answer['exit_reason']}"])
        page = folder / "specimens.html"
        if page.is_file():
            output.say(f"  page: {page}")
    output.say(f"  next: {then}")
    return 0


def _state(folder: Path, specimen: str, sha256: str) -> str:
    found = specimen_results(folder, specimen, sha256)
    if found is None:
        return "not begun"
    return "done" if is_finished(found) else f"stage {found.get('stage')}"


def _summary(folder: Path) -> dict[str, Any] | None:
    try:
        found = disk.read_json(folder / SPECIMENS_FILE)
        return found if found["schema"] == SPECIMENS_SCHEMA else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def report_of_many(options: argparse.Namespace, folder: Path) -> int:
    """Write the pages of all specimens and the summary again from what lies there."""
    from rso.report import render, render_specimens

    found = load_specimens(options.study)
    answer = _summary(folder)
    if answer is None:
        output.complain(f"{folder / SPECIMENS_FILE}: is not there; run the study first: rso run {options.study}")
        return 2
    for s in found.studies:
        one = specimen_results(folder, s.specimen, s.sha256)
        if one is not None and is_finished(one):
            place = folder_of(folder, s.specimen)
            render(dict(one), place, html=True, pdf=s.report.pdf, language=options.language)
    missing: list[str] = []
    for file in render_specimens(answer, folder, language=options.language, untranslated=missing):
        output.say(file)
    output.untranslated(missing, options.language)
    return 0
