"""What `rso check` says: what would run, how much of it, and about how long.  Nothing is computed."""

from __future__ import annotations

import dataclasses
import itertools
import shlex
from pathlib import Path

import numpy as np

from rso import discrepancy
from rso.calibration import confirmed_optimum, formula_comparison, required_runs, stated_settings, uncertain_inputs
from rso.calibration.cost_model import Pace, pace
from rso.calibration.gauss_newton.iteration import MAX_DESCENT_END_ROUNDS
from rso.calibration.plan import Plan, fe_design, full_design, make_plan, proofs, source_of
from rso.calibration.predictive_check import held_out_experiments
from rso.cli.answer import interval_in_unit, number_text
from rso.cli.text_sketch import text_sketch
from rso.contract import FilledInputs, ModelHierarchy, Programme, Reduction, Refusals, capability
from rso.core.digits import quantity_text
from rso.core.symbols import symbol
from rso.core.units import people, spaced
from rso.data import SEGMENTS, MeasuredCurve, Measurement, usual_errors
from rso.discrepancy.study_diagnosis import ask
from rso.evaluation import Task
from rso.model_selection import ModelLevel
from rso.model_selection.candidate_models import STUDY_LEVEL, axes_of, levels_of
from rso.next_experiment import study_design
from rso.study import cases
from rso.study.cases import contact_modulus
from rso.study.errors import Problem, study_error
from rso.study.schema import ExperimentTable, Study

MAX_CORNER_PARAMETERS = 6  # open parameters up to which all corners of their ranges are looked at
ENCRYPTED_SCHEMES = ("tls://", "wss://")  # schemes of Dask's addresses
MAX_FILLED_LINES = 30  # lines of a filled input file that are shown
FAR_MODULUS_RATIO = 5.0  # times: held thin bodies are up to three times as stiff as a half-space


def check_lines(
    study: Study, folder: Path, trust: bool, store: Path | None = None, jobs: int | None = None
) -> list[str]:
    """Lines about a loaded study whose results go to `folder`; StudyError for what its backend does not allow.

    Times are those with as many `jobs` at a time, by default those of the study.

    A backend that is not rso's own is code of somebody else: it is loaded only with `trust`.
    """
    source = source_of(study)
    if (why := source.missing()) is not None:
        place = ("backend", "use" if source.use else "command")
        raise study_error(study.file, study.lines, [Problem(place, why, source.use)])
    if not (trust or source.own):
        what = repr(source.use) if source.use else shlex.join(source.command or ())
        return [
            f"{study.file}: good as far as this can be said without its backend",
            f"  {what} is foreign code and was not loaded: names, units and bounds of the parameters, settings and",
            "  the number of simulations were not checked; if you trust it: rso check --trust",
            *(
                f"  experiment {e.name!r}: {w}"
                for e in study.experiments
                for w in stated_settings.replaced(study, e.name)
            ),
            *_open_to_others(study),
        ]
    plan = make_plan(study)
    if "ladder" in study.model_fields_set:
        levels_of(plan)  # names of levels are known
    if "next" in study.model_fields_set:
        study_design.asked(plan, axes_of(plan, ModelLevel(STUDY_LEVEL), {}))
    if (few := required_runs.too_few(plan)) is not None:
        raise few
    direct = study.search.method == "gauss_newton"
    parts, asked = directly(plan) if direct else on_surfaces(plan)
    total = sum(parts.values())
    shown = ", ".join(f"{n} {what}" for what, n in parts.items() if n)
    lines = [
        f"{study.file}: good",
        f"  {study.study.title}",
        *sketch_lines(plan),
        *_things(plan),
        *_filled(plan),
        *asked,
    ]
    lines += [f"  similarity: {plan.group.why}", f"  simulations: {total} at most ({shown})" + ("" if direct else ",")]
    if direct:
        lines.append("    most descents need 3 to 8 points: they end as soon as a run agrees with its prediction;")
        lines.append("    ends of intervals are run where they lie far from all of those")
    else:
        widening = " and each widening of its ranges" if study.search.repair and plan.searches else ""
        lines.append(f"    and for the surrogates, each search{widening} up to {study.verify.max_infill} points more")
        points = confirmed_optimum.MAX_INTERVAL_END_ROUNDS * (2 * plan.box.d + confirmed_optimum.MAX_OPTIMUM_RUNS)
        lines.append(f"    and where these do not know what the data allow up to {points} points")
    known = pace(plan.backend, store or folder)
    jobs = jobs or study.dispatch.jobs
    seconds = known.seconds(_one_of_each(plan)) / len(plan.cases)
    time = f"{_minutes(total * seconds / jobs)} with {jobs} job(s)"
    most = "at most" if direct else "about"
    lines.append(f"  time of simulations: {most} {time} ({seconds:.3g} s a simulation, {known.basis})")
    if not direct:
        lines.append("    surrogates, searches and the report come on top")
    return [*lines, *_diagnosis(study, known, jobs), *_open_to_others(study), f"  results: {folder}"]


def sketch_lines(plan: Plan) -> list[str]:
    """Each different experiment in a sentence, the first as a drawing too."""
    found = cases.sketches(plan.study, plan.backend)
    lines = []
    for k, sketch in enumerate(found):
        names = ", ".join(repr(n) for n in sketch["experiments"])
        lines += [f"  {f'{names}: ' if len(found) > 1 else ''}{sketch['words']}"]
        lines += ["", *(f"    {line}" for line in text_sketch(sketch)), ""] if k == 0 else []
    return lines


def _filled(plan: Plan) -> list[str]:
    """The lines of a program's input files that are filled in, with the values in the middle of the ranges."""
    inputs = capability(plan.backend, FilledInputs)
    if inputs is None:
        return []
    values = plan.values(np.full(plan.box.d, 0.5))
    shown = ", ".join(f"{k} = {v:.6g}" for k, v in values.items())
    lines = [f"  input files, not run, with {shown}:"]
    for name, text in inputs.filled(values, plan.cases[0]).items():
        own = [(number, line.rstrip()) for number, line, holds in text if holds]
        lines += [f"    {name}:{number}: {line}" for number, line in own[:MAX_FILLED_LINES]]
        left = len(own) - MAX_FILLED_LINES
        lines += [f"    {name}: {left} more lines are filled in"] if left > 0 else []
    return lines


def _open_to_others(study: Study) -> list[str]:
    """A warning where simulations go to a scheduler that asks nobody who they are.

    Dask takes no scheme for tcp://.
    """
    address = study.dispatch.address
    if address is None or address.startswith(ENCRYPTED_SCHEMES):
        return []
    return [
        f"  warning: dispatch.address = {address!r} has no TLS, so neither encryption nor a password: whoever reaches",
        "    that scheduler can run code as you there and change what is computed; tls:// with certificates is safe,",
        "    or a network that only you can reach (docs/cluster.md)",
    ]


def _one_of_each(plan: Plan) -> list[Task]:
    """A simulation of every case that is fitted, in the middle of the ranges."""
    values = plan.values(np.full(plan.box.d, 0.5))
    return [Task(values, case) for case in plan.cases]


def _minutes(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _diagnosis(study: Study, known: Pace, jobs: int) -> list[str]:
    """What `rso diagnose` would simulate, or why it cannot; StudyError only for a study that asks for it."""
    try:
        asked = ask(study)
        library = [j.task for j in discrepancy.planned_simulations(asked.base, asked.plan, asked.effects)]
    except ValueError as error:
        if "diagnose" in study.model_fields_set:
            raise
        return [f"  rso diagnose: not with this study: {str(error).replace(f'{study.file}:', 'line ', 1)}"]
    left = [t for t in library if not known.stored(t)]
    there = f", of which {len(library) - len(left)} are there" if len(left) < len(library) else ""
    cost = f"a library of {len(library)} simulations at most{there}, {_minutes(known.seconds(left) / jobs)}, made once"
    lines = [f"  rso diagnose: {len(asked.effects)} effects; {cost}", *(f"    {words}" for words in asked.unseen)]
    anew, each = discrepancy.planned_rerun(asked.base, asked.plan, asked.effects)
    if anew:
        time = _minutes(known.seconds(anew) * each / len(anew) / jobs)
        count = f"{each:.0f} simulation{'s' * (round(each) != 1)}"
        lines.append(f"    a cause that it names is simulated again: about {count}, {time}, twice at most")
    # naming them takes longer than all else here: only who asks for a diagnosis waits
    tests = (
        discrepancy.planned_tests(asked.base, asked.plan, asked.effects) if "diagnose" in study.model_fields_set else {}
    )
    if tests:
        runs = sum(len(found) * share for found, share in tests.values())
        seconds = sum(known.seconds(j.task for j in found) * share for found, share in tests.values()) / jobs
        lines.append(
            f"    where it names two, {len(tests)} tests that could decide are computed: about {runs:.0f} "
            f"simulations, {_minutes(seconds)}"
        )
    return lines


def on_surfaces(plan: Plan) -> tuple[dict[str, int], list[str]]:
    """Simulations by purpose of a search on response surfaces, and a line about its design."""
    study = plan.study
    similar = plan.group.reference is not None
    design, held = fe_design(plan, similar)
    proof = proofs(plan, design) if similar else []
    cases, candidates, exact = len(plan.cases), study.search.candidates, similar and plan.box.d == 1
    parts = {
        "design": cases * len(design),
        "held out": cases * len(held),
        "proof": cases * len(proof),
        "candidates": cases * candidates * len(plan.searches),
        "identification": 0 if exact else cases * confirmed_optimum.MAX_OPTIMUM_RUNS,
        "uncertainty": 2 * uncertain_inputs.count(plan),  # before the search and at the most likely point
        "validation": candidates * len(plan.validation) + len(held_out_experiments(plan)),
    }
    return parts, [f"  design: {study.doe.kind}, {len(full_design(plan))} runs asked + {study.doe.held_out} held out"]


def directly(plan: Plan) -> tuple[dict[str, int], list[str]]:
    """Simulations by purpose of Gauss–Newton on simulations, at most, and lines about where it begins."""
    table, cases = plan.study.search, len(plan.cases)
    differences = table.derivatives == "differences"
    points = cases * table.starts * table.max_runs
    reduced = plan.box.d - plan.group.saved
    parts = {
        "iterates": points,
        "differences": points * reduced if differences else 0,
        "proof": cases * plan.group.saved if differences else 0,
        "ends of intervals": cases * MAX_DESCENT_END_ROUNDS * (4 if plan.resolved.inputs else 2) * plan.box.d,
        "uncertainty": uncertain_inputs.count(plan),
        "validation": len(plan.validation) + len(held_out_experiments(plan)),
    }
    begin = ", ".join(f"{k} = {v:g}" for k, v in plan.resolved.start.items()) or "the middle of the ranges"
    more = f" and {table.starts - 1} more start(s)" if table.starts > 1 else ""
    whose = "differences between runs" if differences else "the backend's derivatives"
    whose += "" if "derivatives" in table.model_fields_set else ", differences where it has none"
    return parts, [f"  search: Gauss–Newton on simulations with {whose}, from {begin}{more}; no design, no surrogates"]


def _things(plan: Plan) -> list[str]:
    """Parameters, settings and experiments."""
    lines = [
        f"  {symbol(a.name)}: {interval_in_unit((a.low, a.high), a.parameter.unit)} ({a.scale}), "
        f"{a.parameter.description}"
        for a in plan.resolved.axes
    ]
    lines += [f"  {symbol(name)} = {value:g} (fixed)" for name, value in plan.resolved.fixed.items()]
    lines += [
        f"  {words}"
        for words in (
            *stated_settings.extraordinary(plan),
            *stated_settings.unresolved_experiments(plan),
            *stated_settings.uncalibrated_experiments(plan),
        )
    ]
    lines += [f"  {words}" for words in plan.of_relaxation()]
    lines += uncertain_inputs.said_of_inputs(plan)
    lines += _refused(plan)
    lines += stated_settings.of_study(plan)
    for e in plan.study.experiments:
        curve = plan.curves[e.name]
        places = [] if curve.position is None else curve.position.tolist()
        remarks = plan.remarks(e.name)
        if e.name in plan.creeps.followed:
            lines += [f"  experiment {e.name!r} ({e.role}): {len(curve.depth)} moments", *(f"    {r}" for r in remarks)]
            continue
        depths, marks = (len(set(x)) for x in (curve.depth.tolist(), map(tuple, places)))
        what = f"{marks} mark(s) of a profile at " if e.kind == "profile" else ""
        reach = f"{what}{depths} depth(s) to {quantity_text(curve.depth.max(), 'mm', 6)}, {curve.n_repeats} repeat(s)"
        lines.append(f"  experiment {e.name!r} ({e.role}): {reach}")
        measured = plan.study.measurement(e.name)
        remarks += [*stated_settings.replaced(plan.study, e.name), *stated_settings.doubts_of_sizes(plan, e.name)]
        unread = f"not read: {', '.join(measured.unread)}" if measured.unread else ""
        known = (
            _recorded(measured, curve),
            _pace(plan, e),
            _reduction(plan, e),
            *_small_contacts(plan, e.name, curve),
            *formula_comparison.stated_formulas(plan, e.name),
            _noise(plan.study, e),
        )
        about = (*known, unread, *remarks)
        lines += [f"    {words}" for words in about if words]
        lines += stated_settings.of_experiment(plan, e.name)
    return lines


def _refused(plan: Plan) -> list[str]:
    """The first corner of the ranges that the backend refuses, and how many there are."""
    refusals = capability(plan.backend, Refusals)
    if refusals is None or plan.box.d > MAX_CORNER_PARAMETERS:
        return []
    corners = [plan.values(np.array(x)) for x in itertools.product((0.0, 1.0), repeat=plan.box.d)]
    why = [next(filter(None, (refusals.refused(v, case) for case in plan.cases)), None) for v in corners]
    first = next((k for k, reason in enumerate(why) if reason), None)
    if first is None:
        return []
    at = ", ".join(f"{a.name} = {corners[first][a.name]:g}" for a in plan.resolved.axes)
    count = sum(reason is not None for reason in why)
    return [
        f"  not modelled in {count} of {len(why)} corners of these ranges, first {at}:",
        f"    {why[first]};",
        "    simulations there fail, and rso diagnose has no library without them: narrow the ranges",
    ]


def _recorded(m: Measurement, curve: MeasuredCurve) -> str:
    """What a file holds, in words: readings of each branch and the range of the force, or that of the displacements."""
    if m.kind != "force":
        return f"{curve.channel} from {curve.value.min():.3g} to {curve.value.max():.3g}{spaced(curve.unit)}"
    count = {s: sum(int(np.sum(r.segment == s)) for r in m.repeats) for s in SEGMENTS}
    branches = ", ".join(f"{n} {s}" for s, n in count.items() if n)
    F = curve.value
    span = f"{F.min():.3g} to {F.max():.3g}{spaced(curve.unit)}"
    return f"readings: {branches}; {curve.channel} from {span} while {'unloading' if curve.back else 'loading'}"


def _pace(plan: Plan, e: ExperimentTable) -> str:
    """The speed of an experiment and whose word that is, where the backend's answer depends on it."""
    if e.kind != "force":
        return ""
    case = cases.case_for(plan.study, e.name, (float(plan.curves[e.name].depth.max()),))
    speed, whose = cases.speed_of(plan.study, e.name)
    slower = dataclasses.replace(case, programme=Programme.ramp(case.programme.asked_mm, 0.1 * speed))
    example = plan.values(np.full(plan.box.d, 0.5))
    kept, other = (plan.backend.canonical(example, c)[1].programme.time_s for c in (case, slower))
    return f"loaded with {speed:.3g} mm/s ({whose})" if kept != other else ""


def _reduction(plan: Plan, e: ExperimentTable) -> str:
    """How much of a specimen is simulated in the middle of the ranges, where the backend says that."""
    reductions = capability(plan.backend, Reduction)
    if reductions is None:
        return ""
    case = cases.case_for(plan.study, e.name, (float(plan.curves[e.name].depth.max()),))
    return reductions.reduction(plan.values(np.full(plan.box.d, 0.5)), case) or ""


def _small_contacts(plan: Plan, name: str, curve: MeasuredCurve) -> list[str]:
    """The modulus of the shallow half of a loading Fz in the limit of small contacts, where the backend knows one: far
    from its range a unit is wrong, or what is pressed is no half-space."""
    out, theory = [], _theory(plan, name)
    opened = {a.name for a in plan.resolved.axes} | {k for k, v in plan.resolved.fixed.items() if v}
    for knob, value in contact_modulus(plan.backend, plan.study.settings_of(name), curve).items():
        if "adhesion" in opened or curve.back:
            continue  # it has none; nor has what relaxes or sticks on its way back
        if value <= 0.0:
            n = [e.name for e in plan.study.experiments].index(name)
            text = (
                f"Fz falls while the indenter goes deeper: in the limit of small contacts{theory} {symbol(knob)} would "
                f"be {_modulus(value)}. Check the sign and the zero, and that this is no tensile record. For adhesion, "
                "open `adhesion` in [parameters]"
            )
            raise study_error(plan.study.file, plan.study.lines, [Problem(("experiments", n, "data"), text)])
        out.append(f"shallow half, in the limit of small contacts{theory}: {symbol(knob)} about {_modulus(value)}")
        axis = next((a for a in plan.resolved.axes if a.name == knob), None)
        fixed = plan.resolved.fixed.get(knob)
        low, high = (axis.low, axis.high) if axis else (fixed, fixed)
        if low is not None and high is not None and not low / FAR_MODULUS_RATIO < value < high * FAR_MODULUS_RATIO:
            span = interval_in_unit((low, high), "MPa")
            out.append(f"  that is far from {span}: are the units of force and depth right?")
    return out


def _modulus(value: float) -> str:
    """A modulus (MPa) to two digits in the unit that people use."""
    label, factor = people("MPa", abs(value))
    return f"{number_text(value * factor, 2)} {label}"


def _theory(plan: Plan, name: str) -> str:
    """Whose closed form the backend has for an experiment, in brackets; empty where it does not say."""
    ladder = capability(plan.backend, ModelHierarchy)
    rungs = ladder.levels(plan.study.settings_of(name)) if ladder else ()
    return next((f" ({level['title']})" for rung in rungs for level in rung if level.get("closed_form")), "")


def _noise(study: Study, e: ExperimentTable) -> str:
    """The stated noise of an experiment in words, and what its record says of its contact."""
    units = {"uz": "mm", "depth": "mm", "correlation": "mm", "contact": "mm"}
    units |= {"gain": "of the value, each test by itself", "calibration": "of the value, all experiments alike"}
    own = {k: v for k, v in e.noise.model_dump().items() if v is not None and v > 0.0}
    columns = sorted({f"{c} by its column" for r in study.measurement(e.name).repeats for c in r.sigma})
    shown = ", ".join([*(f"{k} {v:g} {units.get(k, 'N')}" for k, v in own.items()), *columns])
    found = study.noise_of(e.name).contact if e.noise.contact is None else None
    said = f"; contact {quantity_text(found, 'mm', 2)} by the record" if found else ""
    return f"stated noise: {shown or 'none'}{said}{_usual(study, e)}"


def _usual(study: Study, e: ExperimentTable) -> str:
    """What counts of the errors of its tests that nobody has stated."""
    if e.kind != "force":
        return ""
    noise, m = study.noise_of(e.name), study.measurement(e.name)
    once = noise.of_test(max(float(r.depth.max()) for r in m.repeats))
    sizes = {
        "gain": f"gain {100 * once.gain:.2g} %",
        "contact": f"contact {quantity_text(once.contact, 'mm', 2)}",
        "correlation": f"{100 * usual_errors.USUAL_CORRELATED_ERROR_SHARE:g} % of the largest force along the depth",
    }
    each = ", ".join(sizes[n] for n in noise.unstated)
    less = ", less as far as repeats show less" if len(m.repeats) > 1 else ""
    return f"; not stated, so usual errors count: {each}{less}" if each else ""
