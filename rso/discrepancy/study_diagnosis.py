"""The diagnosis of a study: its experiments as a test plan, the library of simulations, the verdict, its rerun."""

from __future__ import annotations

import dataclasses
import datetime
import math
import textwrap
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

import rso
from rso import discrepancy
from rso.calibration import result_files
from rso.calibration.plan import source_of
from rso.calibration.results import data_hashes
from rso.contract import (
    Backend,
    Case,
    DraftSettings,
    ForceExponents,
    LeanSettings,
    PhysicalBounds,
    PlausibleRanges,
    Programme,
    capability,
    plain,
)
from rso.core import disk
from rso.core.similarity import group, stress_exponent
from rso.core.units import value_in_unit
from rso.data import recorded_speed
from rso.discrepancy import Base, BaseAxis, Effect, Experiment, Library
from rso.discrepancy.base_model import base_model, base_model_block, base_model_sentence
from rso.discrepancy.library.planning import framed
from rso.discrepancy.library.relaxation import is_relaxation
from rso.discrepancy.library.simulations import BaseRelaxation
from rso.discrepancy.library.test_plan import ASSUMED_TIMES_NOTE, NOT_USED_NOTE, SurfaceProfile, Test
from rso.doe import Box
from rso.evaluation import Evaluator, Task, Watch
from rso.evaluation.store import RunStore
from rso.study.cases import (
    DEFAULT_SPEED_MM_S,
    MAX_DISPLACEMENTS,
    MISREAD_SETTING_ERRORS,
    foreign_units,
    other_branch,
    place_of_setting,
    sketches,
    speed_of,
    stated_speed,
)
from rso.study.errors import Problem, choices_text, study_error
from rso.study.resolve import Axis, Resolved, resolve
from rso.study.schema import ExperimentTable, Study
from rso.study.sources import backend_of, needs_data

DIAGNOSIS_FILE = "diagnosis.json"
MESSAGE_WIDTH_CHARACTERS = 79  # of lines that say much
MAX_RERUN_ROUNDS = 2  # of finalists computed anew
RELAXATION_TIME_MARGIN_RATIO = 2.5  # times a time that relaxes: how far it is computed on each side
# times the range of a modulus that moves what is fixed over it: how far simulations go on each side
MODULUS_MARGIN_RATIO = 1.5


@dataclasses.dataclass(frozen=True, eq=False)
class Asked:
    """What `rso diagnose` works on: the base model, the test plan and the catalogue."""

    study: Study
    base: Base
    plan: discrepancy.TestPlan
    effects: tuple[Effect, ...]
    unseen: tuple[str, ...] = ()  # what of the catalogue cannot be seen in such a body, in words
    box: Box | None = None  # ranges of the open parameters


def ask(study: Study) -> Asked:
    """The study as a diagnosis; StudyError for what its backend or its data do not allow."""
    needs_data(study)
    if study.backends:
        text = "a diagnosis is of one backend; this study has several"
        raise study_error(study.file, study.lines, [Problem(("backends",), text)])
    source = source_of(study)
    backend = backend_of(study, source)
    resolved = resolve(study, backend.parameters)
    experiments = [_experiment(study, n) for n, e in enumerate(study.experiments) if _diagnosed(study, e)]
    _refuse_what_is_not_modelled(study, backend, experiments)
    try:
        plan = discrepancy.make_test_plan(_powered(backend, experiments))
        plan = dataclasses.replace(plan, notes=(*plan.notes, *_assumed_speed(study, experiments)))
    except (ValueError, TypeError) as error:
        raise study_error(study.file, study.lines, [Problem(("experiments",), str(error))]) from error
    _refuse_what_is_too_deep(study, backend, plan)
    base = _base(study, backend, resolved)
    settings = _settings(study, backend, experiments)
    base = _relaxing(base, settings, resolved)
    try:
        framed(base, plan)
    except ValueError as error:
        place = ("parameters", *(a.name for a in base.simulated[2:3]))
        raise study_error(study.file, study.lines, [Problem(place, str(error))]) from error
    if not any(e.role != "validate" and e.measurement.kind == "force" for e in experiments):
        text = 'diagnosis needs a force curve with role "fit" or "select"'
        raise study_error(study.file, study.lines, [Problem(("experiments",), text)])
    opened = [a.name for a in resolved.axes]
    every = discrepancy.catalogue(backend, settings, resolved.fixed, opened)
    own = {*base.held, *(base.relaxing.names if base.relaxing else ())}
    every = tuple(e for e in every if e.size.name not in own)  # known, and no multiple of the modulus, or open
    every = tuple(e for e in every if not e.flows or _flows_everywhere(backend, e, plan, {*opened, *resolved.fixed}))
    measured = {c for t in plan.seen().tests for c in t.channels}
    effects = discrepancy.measured_effects(every, measured)
    wanted = study.diagnose.effects
    if wanted != "all":
        known, hidden = [e.name for e in effects], {e.name for e in every}
        why = f"shows only in a channel that was not measured; measured are {', '.join(sorted(measured))}"
        problems = [
            Problem(("diagnose", "effects"), why if n in hidden else f"no such effect; {choices_text(n, known)}", n)
            for n in wanted
            if n not in known
        ]
        if problems:
            raise study_error(study.file, study.lines, problems)
        effects = tuple(e for e in effects if e.name in wanted)
    largest = max(float(np.abs(v).max(initial=0.0)) for t in plan.tests for v in t.values.values())
    effects = discrepancy.suited(effects, largest, plan.scale, plan.times)
    bounds = capability(backend, PhysicalBounds)
    physical = bounds.physical() if bounds else {}
    effects, unseen = discrepancy.bounded(
        effects, base.reference, physical, {p.name: p.high for p in backend.parameters}
    )
    effects = discrepancy.localised(effects, plan.seen().labels())
    effects = _calibrated(study, effects, every)
    if not any(e.family != "scatter" for e in effects):
        text = "at least one effect is needed that is not one of scatter (each curve its own)"
        raise study_error(study.file, study.lines, [Problem(("diagnose", "effects"), text)])
    return Asked(study, base, plan, effects, tuple(unseen), resolved.box)


def _flows_everywhere(backend: Backend, effect: Effect, plan: discrepancy.TestPlan, given: Collection[str]) -> bool:
    """Whether what flows is plausible, and modelled, at every place of a plan."""
    ranges = capability(backend, PlausibleRanges)
    each = [ranges.plausible(p.settings, given) for p in plan.places] if ranges else []
    return all(found.get(effect.size.name, ()) is not None for found in each)


def _calibrated(study: Study, effects: Sequence[Effect], every: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects with what is known of them; the gain of the cell is as uncertain as the experiments state."""
    stated = max((study.noise_of(e.name).calibration for e in study.experiments), default=0.0)
    known, problems = {"gain": stated} if stated else {}, []
    units = {e.name: e.size.unit for e in every if e.family != "scatter" and e.size.neutral is not None}
    for name, written in study.diagnose.known.items():
        place = ("diagnose", "known", name)
        try:
            if name not in units:
                raise ValueError(f"no such effect; {choices_text(name, list(units))}")
            if not 0.0 <= (value := value_in_unit(written, units[name])) < math.inf:
                raise ValueError(f"{written!r}: a standard uncertainty is a number of at least 0 in {units[name]}")
            known[name] = value
        except (ValueError, TypeError) as error:
            problems.append(Problem(place, str(error), name))
    if problems:
        raise study_error(study.file, study.lines, problems)
    return tuple(dataclasses.replace(e, known=known.get(e.name)) for e in effects)


def _refuse_what_is_not_modelled(study: Study, backend: Backend, experiments: Sequence[Experiment]) -> None:
    """StudyError for what of the experiments the backend refuses, at the setting that it names."""
    problems = foreign_units(study, backend)
    names = [e.name for e in study.experiments]
    for e in experiments:
        n = names.index(e.name)
        try:
            case = _probe(e)
        except ValueError as error:
            problems.append(Problem(("experiments", n, "data"), str(error)))
            continue
        try:
            backend.check(case)
        except MISREAD_SETTING_ERRORS as error:
            found = Problem(place_of_setting(study, n, str(error)), str(error))
            problems += [] if found in problems else [found]  # what all experiments share is said once
    if problems:
        raise study_error(study.file, study.lines, problems)


def _powered(backend: Backend, experiments: Sequence[Experiment]) -> list[Experiment]:
    """The experiments with the exponent of force over small depths that the backend says of their indenter."""
    forces = capability(backend, ForceExponents)
    return [dataclasses.replace(e, power=forces.exponents(e.settings)[0]) if forces else e for e in experiments]


def _refuse_what_is_too_deep(study: Study, backend: Backend, plan: discrepancy.TestPlan) -> None:
    """StudyError where a place must be computed farther than the backend goes: beyond the deepest reading."""
    for k, place in enumerate(plan.places):
        reach = plan.reach(k)
        try:
            backend.check(Case("reach", Programme.ramp((reach,)), place.settings))
        except MISREAD_SETTING_ERRORS as error:
            items: list[Test | SurfaceProfile] = [*plan.tests, *plan.profiles]
            there = [o for o in items if o.place == k]
            deepest = plan.experiments[max(there, key=lambda o: float(o.depth.max())).experiment].name
            n = [e.name for e in study.experiments].index(deepest)
            words = f"a diagnosis computes to {reach:g} mm, beyond the deepest reading, for a contact found late"
            found = Problem(("experiments", n, "data"), f"{words}; leave out what is deeper: {error}")
            raise study_error(study.file, study.lines, [found]) from error


def _probe(e: Experiment) -> Any:
    repeats = e.measurement.repeats
    deepest, settings = max(float(r.depth.max()) for r in repeats), dict(e.settings)
    if e.measurement.kind == "profile":
        readings = sum(len(r.depth) for r in repeats)
        if readings > MAX_DISPLACEMENTS:
            raise ValueError(
                f"{e.measurement.where}: {readings} displacements of one profile: keep at most {MAX_DISPLACEMENTS}"
            )
        marks = {(float(x), float(y)) for r in repeats for x, y in zip(r.channels["x"], r.channels["y"], strict=True)}
        settings["profile"] = [list(m) for m in sorted(marks)]
    return Case(e.name, Programme.ramp((deepest,)), settings)


def _diagnosed(study: Study, e: ExperimentTable) -> bool:
    """Whether an experiment is diagnosed: no point cloud, and of one record that stands in two the loading alone, as a
    diagnosis takes all branches of it."""
    return e.kind != "surface" and not (e.branch == "unloading" and other_branch(study, e.name))


def _experiment(study: Study, n: int) -> Experiment:
    """One experiment with the speed that its record shows, or else its settings."""
    e = study.experiments[n]
    m = study.measurement(e.name)
    settings = {k: v for k, v in study.settings_of(e.name).items() if k not in ("speed", "unload")}
    channels = ("uz",) if m.kind == "profile" else e.channels or m.channels
    speed = recorded_speed(m) or stated_speed(study, e.name) or DEFAULT_SPEED_MM_S
    return Experiment(e.name, e.role, m, study.noise_of(e.name), tuple(channels), settings, speed, e.mounting, e.after)


def _assumed_speed(study: Study, experiments: Sequence[Experiment]) -> list[str]:
    """A note on tests whose speed neither their records nor the study say."""
    forces = [e.name for e in experiments if e.measurement.kind == "force"]
    names = [n for n in forces if speed_of(study, n)[1] == "assumed"]
    return (
        [f"A speed of {60.0 * DEFAULT_SPEED_MM_S:g} mm/min is assumed for {', '.join(names)}, {ASSUMED_TIMES_NOTE}"]
        if names
        else []
    )


def _base(study: Study, backend: Backend, resolved: Resolved) -> Base:
    """The open parameters with one modulus scaled out; StudyError where none can be.

    That is the first open one, or else the first that is fixed.  What is fixed with a stress in its unit does not go
    with an open modulus: there it is an axis of simulations too, at p (μ/μ₀)^−e.
    """
    parameters = [dataclasses.replace(a.parameter, low=a.low, high=a.high) for a in resolved.axes]
    constant = {p.name: p for p in backend.parameters if resolved.fixed.get(p.name, p.neutral) not in (p.neutral, 0.0)}
    try:
        scaling = group(parameters, backend.channels)
        held = {k: e for k, p in constant.items() if (e := stress_exponent(p.unit))}
    except ValueError as error:
        raise study_error(study.file, study.lines, [Problem(("parameters",), str(error))]) from error
    own, fixed = {a.name: a for a in resolved.axes}, dict(resolved.fixed)
    modulus, reference = scaling.reference, scaling.reference_value
    ranges = scaling.reduced_range({k: a.low for k, a in own.items()}, {k: a.high for k, a in own.items()})
    if modulus is None:
        modulus = next((k for k, e in held.items() if e == 1 and constant[k].low > 0.0), None)
        if modulus is None:
            raise study_error(study.file, study.lines, _no_modulus(backend))
        held.pop(modulus)
        reference = low = high = fixed[modulus]
    else:
        low, high = own[modulus].low, own[modulus].high
    keep = study.diagnose.keep_ranges
    axes = [_axis(own[k], *ends, scaling.exponents[k], reference, keep) for k, ends in ranges.items()]
    if held and low < high:
        axes.insert(
            0,
            BaseAxis(
                modulus, own[modulus].parameter.unit, low / MODULUS_MARGIN_RATIO, high * MODULUS_MARGIN_RATIO, True, 0
            ),
        )
    forces, cheap = capability(backend, LeanSettings), capability(backend, DraftSettings)
    lean = forces.lean if forces else {}
    draft = dict(cheap.draft if cheap else lean) | dict(study.diagnose.settings)
    return Base(backend, modulus, reference, low, high, tuple(axes), fixed, draft, lean, held)


def _settings(study: Study, backend: Backend, experiments: Sequence[Experiment]) -> Mapping[str, Any]:
    """Settings of which the catalogue is asked: those that all experiments share, where they describe an experiment.

    Where each experiment says by itself what is pressed, they do not: then those of the first that is fitted.
    """
    shared = study.backend.settings
    try:
        backend.check(Case("shared", Programme.ramp((0.0,)), dict(shared)))
    except MISREAD_SETTING_ERRORS:
        fitted = [e for e in experiments if e.role != "validate"] or list(experiments)
        return dict(fitted[0].settings)
    return shared


def _relaxing(base: Base, settings: Mapping[str, Any], resolved: Resolved) -> Base:
    """The base model with its share and its time that relax, if it has one of each, taken as an effect in all it says.

    So every rate and every hold is followed, and no simulation of the base rests.
    """
    opened = {a.name: a for a in resolved.axes}
    values = {p.name: resolved.fixed.get(p.name, p.default) for p in base.backend.parameters}
    for e in filter(is_relaxation, discrepancy.catalogue(base.backend, settings, {}, ())):
        share, time = e.size.name, e.shape[0].name
        (_, most), (short, long) = (
            (opened[k].low, opened[k].high) if k in opened else (values[k] or 0.0,) * 2 for k in (share, time)
        )
        if not (0.0 < most <= 1.0 and short > 0.0):  # none
            continue
        wide = short / RELAXATION_TIME_MARGIN_RATIO, long * RELAXATION_TIME_MARGIN_RATIO
        effect = dataclasses.replace(
            e,
            name=f"{e.name} of the base model",
            size=dataclasses.replace(e.size, low=0.0, high=most),
            shape=(dataclasses.replace(e.shape[0], low=wide[0], high=wide[1]),),
        )
        fixed = tuple(None if k in opened else values[k] for k in (share, time))
        last = sorted(base.axes, key=lambda a: a.name in (share, time))
        return dataclasses.replace(base, axes=tuple(last), relaxing=BaseRelaxation(effect, fixed))
    return base


def _axis(a: Axis, low: float, high: float, exponent: int, reference: float, keep: bool) -> BaseAxis:
    """An open parameter over the modulus to its exponent, from its range at the reference modulus."""
    factor = reference**-exponent
    kept = (a.low, a.high) if keep and exponent and a.low > 0 else None
    log = a.scale == "log" or kept is not None or (low > 0 and high / low > 4)  # fits keep to a range in its logarithm
    return BaseAxis(a.name, a.parameter.unit, low * factor, high * factor, log, exponent, kept)


def _no_modulus(backend: Backend) -> list[Problem]:
    """No modulus can be scaled out: which there are."""
    moduli = [p.name for p in backend.parameters if stress_exponent(p.unit) == 1 and p.low > 0]
    choices = f"one of {', '.join(moduli)}" if moduli else "this backend declares none that is positive"
    needs = "diagnosis needs one parameter with the unit of a stress that the forces scale with"
    return [Problem(("parameters",), f"{needs}: {choices} with low and high, or with value where it is known")]


def run_diagnosis(
    asked: Asked,
    store: RunStore,
    executor: Executor,
    folder: Path,
    *,
    command: str,
    watch: Watch | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Library, verdict and rerun; writes ``diagnosis.json`` and puts its core into ``results.json`` if there is one.

    The verdict is written before candidates of the next test are simulated, which may take longer than all before.
    Raises NoAnswer where the base model has none; what was computed stays in the store.
    """
    started, cpu = time.perf_counter(), time.process_time()

    run = Evaluator(asked.base.backend, store, executor, watch).run
    for note in asked.plan.notes:
        if note.endswith((NOT_USED_NOTE, ASSUMED_TIMES_NOTE)):
            say(note)
    say("library: the base model and every effect of the catalogue, once for this test plan")
    library = discrepancy.build_library(asked.base, asked.plan, asked.effects, run)
    built = time.perf_counter() - started

    alone = plain(base_model_block(base_model(asked.study, library, asked.box)))

    def keep(found: dict[str, Any]) -> None:
        found["words"] = [*found["words"], *base_model_sentence(alone, found["diagnosis"]["verdict"] != "no_gap")]
        found["timings"] = {
            "library_wall": built,
            "library_cpu": library.cpu_s,
            "library_runs": library.runs,
            "judging_cpu": time.process_time() - cpu,
        }
        found["base_model"] = alone
        found["command"] = command
        found["settings"] = plain(asked.study.written(asked.study.backend.settings))
        found["sketches"] = plain(sketches(asked.study, asked.base.backend))
        found["study"] = {"file": asked.study.file.name, "seed": asked.study.study.seed}
        found["provenance"] = {
            "rso": rso.__version__,
            "backend": asked.base.backend.name,
            "numerics": asked.base.backend.numerics,
            "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "data_sha256": data_hashes(asked.study),
        }
        _write(folder, found)

    found = judge_library(asked, library, run, say=say, fitted=_fitted(asked, folder), keep=keep)
    keep(found)
    return found


def _fitted(asked: Asked, folder: Path) -> dict[str, float] | None:
    """Open parameters of the best candidate that a run of this study left in its folder; None without one."""
    try:
        results = disk.read_json(folder / "results.json")
        best = results["best"]
        search = next(s for s in results["searches"] if s["name"] == best["search"])
        values = next(c for c in search["candidates"] if c["name"] == best["candidate"])["values"]
        same = results["backend"]["settings"] == plain(asked.study.written(asked.study.backend.settings))
    except (OSError, ValueError, KeyError, TypeError, StopIteration):
        return None
    fixed = asked.base.fixed
    opened = [k for k in dict.fromkeys([asked.base.modulus, *(a.name for a in asked.base.axes)]) if k not in fixed]
    same = same and {k: v for k, v in values.items() if k not in opened} == fixed
    return {k: float(values[k]) for k in opened} if same and set(opened) <= set(values) else None


def judge_library(
    asked: Asked,
    library: Library,
    run: Callable[[Sequence[Task]], list[Any]] | None,
    say: Callable[[str], None] = lambda _: None,
    fitted: Mapping[str, float] | None = None,
    keep: Callable[[dict[str, Any]], None] = lambda _: None,
) -> dict[str, Any]:
    """The verdict on a finished library as plain data; `fitted` are open parameters as the study found them.

    With `run` the effects that the verdict names are recomputed at their sizes, the library is mended there and the
    verdict found again, until both agree or MAX_RERUN_ROUNDS are over; candidates of the next test are simulated too.
    What is known before these is handed to `keep`.
    """
    seed = asked.study.study.seed
    say("what this test plan can show, before any cause meets the data")
    visible = discrepancy.detectable_by_plan(library, seed)
    for line in discrepancy.announced(visible):
        say(textwrap.fill(line, MESSAGE_WIDTH_CHARACTERS, subsequent_indent="  ", break_on_hyphens=False))
    say("verdict: evidence, held-out prediction and self-checks")
    result = discrepancy.diagnose(library, seed, fitted=fitted)
    checks: list[discrepancy.RerunCheck] = []
    while run is not None and len(checks) < MAX_RERUN_ROUNDS:
        picks = discrepancy.finalists(library, result)
        if not picks:
            break
        say(f"simulated again at the estimated size: {', '.join(e.name for e in picks)}")
        library, check = discrepancy.corrected_library(library, picks, run)
        checks.append(check)
        if check.rms is None or check.rms < discrepancy.LIBRARY_TOLERANCE:
            break
        result = discrepancy.diagnose(library, seed, fitted=fitted)
    named = f" ({', '.join(result.named)})" if result.named else ""
    if len(result.named) == 2 and any(c.effect.flows for c in result.causes):
        run = None  # what tells a flow from a relaxation is known: tests of another size
    further = "; tests that could decide it" if run is not None and len(result.named) > 1 else ""
    say(f"the verdict is {result.verdict}{named}{further}")
    title = asked.study.study.title
    if run is not None and len(result.named) > 1:
        keep(discrepancy.diagnosis_data(library, result, visible, None, title, checks))
    return discrepancy.diagnosis_data(library, result, visible, run, title, checks)


def _write(folder: Path, found: Mapping[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    result_files.write_results(folder / DIAGNOSIS_FILE, found)
    path = folder / "results.json"
    if not path.exists():
        return
    try:
        result_files.write_results(path, disk.read_json(path) | {"diagnosis": found["diagnosis"]})
    except (ValueError, TypeError):  # what is damaged is no place for it; diagnosis.json has it
        return
