"""`rso check` and `rso run` of a study with objectives."""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path

from rso.cli import output
from rso.core.units import spaced
from rso.objectives.plan import ParetoPlan, designed, held_out_points, pareto_plan
from rso.study.errors import Problem, study_error
from rso.study.schema import Study
from rso.study.sources import source_of


def check_objectives(study: Study, folder: Path, trust: bool) -> list[str]:
    """Lines about a loaded study; a backend that is not rso's own is loaded only with `trust`."""
    source = source_of(study)
    if (why := source.missing()) is not None:
        place = ("backend", "use" if source.use else "command")
        raise study_error(study.file, study.lines, [Problem(place, why, source.use)])
    if not (trust or source.own):
        what = repr(source.use) if source.use else shlex.join(source.command or ())
        return [
            f"{study.file}: good as far as this can be said without its backend",
            f"  {what} is foreign code and was not loaded: names, units and bounds of the parameters and outputs",
            "  were not checked; if you trust it: rso check --trust",
        ]
    plan = pareto_plan(study)
    design = designed(plan)
    held = held_out_points(plan, design)
    lines = [f"{study.file}: good", f"  {study.study.title}", *_parameters(plan), *_wanted(plan)]
    if study.search.method == "simulations":
        most = study.search.population * study.search.generations
        lines.append(f"  simulations: {len(design)} of the design, {len(held)} held out, and up to {most} of NSGA-II")
    else:
        n = study.search.candidates
        lines.append(
            f"  simulations: {len(design)} of the design ({study.doe.kind}), {len(held)} held out, {n} candidates,"
        )
        lines.append(f"    and up to {study.verify.max_infill} more until these agree with their surfaces")
    return [*lines, f"  results: {folder}"]


def _parameters(plan: ParetoPlan) -> list[str]:
    lines = []
    for j, p in enumerate(plan.parameters):
        space, unit = plan.space, spaced(p.unit)
        if space.labels[j]:
            what = f"one of {', '.join(space.labels[j])}"
        elif space.levels[j]:
            levels = space.levels[j]
            few = ", ".join(f"{v:g}" for v in levels[:6]) + (f", … {levels[-1]:g}" if len(levels) > 6 else "")
            what = f"{few}{unit} ({len(levels)} values)"
        else:
            what = f"{space.box.low[j]:.4g} to {space.box.high[j]:.4g}{unit}{' (log)' if space.box.log[j] else ''}"
        lines.append(f"  {p.name}: {what}")
    return lines + [f"  {k} = {v:g}, fixed" for k, v in plan.fixed.items()]


def _wanted(plan: ParetoPlan) -> list[str]:
    lines = [f"  {'minimise' if o.minimise else 'maximise'} {o.quantity.text}{_in(o.unit)}" for o in plan.objectives]
    lines += [f"  within {c.text}" for c in plan.limits]
    return lines + [f"  within {c.text} (parameters)" for c in plan.conditions]


def _in(unit: str) -> str:
    return "" if unit in ("", "1") else f" ({unit})"


def run_objectives(options: argparse.Namespace, study: Study, folder: Path, store: Path, command: str) -> int:
    """Run the study, write its pages, and say what was found; the exit code."""
    from rso.calibration.result_files import claim, may_be_moved
    from rso.cli.progress import Progress
    from rso.evaluation import executor
    from rso.evaluation.store import RunStore, set_aside
    from rso.objectives.pipeline import run_pareto
    from rso.objectives.solving import NoSurface
    from rso.report import render_pareto
    from rso.report.pareto.report import summary

    if options.fresh and folder.exists():
        may_be_moved(folder, study.file, study.inputs())
    plan = pareto_plan(study)
    jobs = options.jobs or study.dispatch.jobs
    with executor(study.dispatch, jobs, plan.source, folder) as pool:
        if options.fresh and folder.exists():
            aside = set_aside(folder)
            if not options.json:
                output.say(f"old results moved to {aside}")
        claim(folder, study.file)
        with RunStore(store) as runs, Progress(options.quiet or options.json) as progress:
            try:
                found = run_pareto(
                    plan, runs, pool, folder, command=command, jobs=jobs, watch=progress.watch, say=progress.say
                )
            except NoSurface as error:
                return output.say_why_ended(3, f"stopped: {error}")
    files = []
    if study.report.html or study.report.pdf:
        files = render_pareto(found, folder, html=study.report.html, pdf=study.report.pdf)
    if options.json:
        keys = ("words", "warnings", "objectives", "candidates", "best_runs", "counts", "exit_code", "exit_reason")
        told = {"results": str(folder), **{k: found[k] for k in keys}, "pages": [str(f) for f in files]}
        print(json.dumps(told, indent=1, ensure_ascii=False))
        return int(found["exit_code"])
    print()
    output.bold(found["study"]["title"])
    output.lines([*summary(found, options.quiet), *(f"  {f}" for f in files)])
    return output.say_why_ended(int(found["exit_code"]), found["exit_reason"])
