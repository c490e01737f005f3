"""What `rso check` says of a study with objectives.  Nothing is computed."""

from __future__ import annotations

import shlex
from pathlib import Path

from rso.core.units import spaced
from rso.objectives.plan import ParetoPlan, designed, held_out, pareto_plan
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
    held = held_out(plan, design)
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
