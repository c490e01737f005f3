"""The simulations behind the experiments of a study, and what its backend does not model."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from rso.contract import (
    Backend,
    Case,
    ContactModulus,
    Programme,
    SettingUnits,
    Sketches,
    by_contents,
    capability,
    digest,
    plain,
)
from rso.core.units import CHANNEL_UNITS, COLUMN_UNITS, UNITS_OF_KIND, in_base, same, value_in_unit
from rso.data import (
    N_CLOUD_POINTS,
    Hold,
    MeasuredCurve,
    Measurement,
    SurfaceCloud,
    UnstatedNoise,
    combine,
    recorded_speed,
    surface_cloud,
    without_spikes,
)
from rso.data.loading_rate import dwell_time, unloading_pace
from rso.evaluation.joint import BACKEND_SETTING
from rso.study.dimensions import MISREAD_SETTING_ERRORS
from rso.study.errors import Problem, choices_text, study_error
from rso.study.input_sizes import refuse_inputs
from rso.study.line_numbers import LineElsewhere, Place
from rso.study.resolve import Resolved
from rso.study.schema import ExperimentTable, Study
from rso.study.search_table import TargetTable

DEFAULT_SPEED_MM_S = 0.5  # assumed where neither the study nor its files say one
TURN_DIGITS = 4  # of the turn of a record: what is read of it asks for the same run again
MAX_UNLOADING_TRAVELS = 16  # travels at which a way back is computed, straight between them
N_CURVE_TRAVELS = 8  # travels at which a whole curve is computed; between them a spline that is exact for u^{3/2}
MAX_PROFILE_DEPTHS = 2 * N_CURVE_TRAVELS  # different depths of a profile up to which each is asked for
PLAUSIBLE_SPEEDS_MM_S = 1e-5, 1e3  # mm/s: slower or quicker is nobody's test
OTHER_SPEED_RATIO = 1.5  # ratio of a stated to a recorded speed that is remarked upon
SAME_SPEED_RATIO = 1.05  # ratio within which the stated one is meant: clocks and stages differ by as much
_SETTING_SENTENCE = re.compile(r"unknown setting |[a-z_.]+( = |: )")  # how a backend begins the sentence on one setting
MIN_DEPTH_RATIO = 1e-4  # of the radius of the indenter: a deepest travel below this is a unit misread
MIN_DEPTH_MM = 1e-5  # mm: the same where no radius is stated, for no instrument presses by so little
LARGE_NOISE_SHARE = 0.5  # of a range: a stated noise beyond is remarked upon
MAX_DISPLACEMENTS = 3000  # of a profile: more say no more, and the covariance of all would fill the memory
LOADING_COMPARED_NOTE = (
    "Only the loading branch is compared; unloading and holds are for rso diagnose. A second experiment with the same "
    'data and branch = "unloading" compares the unloading, too.'
)
UNLOADING_COMPARED_NOTE = "The unloading is compared, down to the strongest pull; loading and holds are not."
UNLOADING_TOO_NOTE = (
    "The unloading is compared, down to the strongest pull; {!r} compares the loading of the same record."
)
LOADING_TOO_NOTE = "The loading branch is compared; {!r} compares the unloading of the same record."
UNLOADING_NOT_COMPARED_NOTE = "The unloading is not compared; rso diagnose uses it."
PROFILE_NOT_USED_NOTE = (
    'Not used by the search: profiles are used by rso diagnose, or with role = "validate" for validation.'
)
# of settings
UNDRAWN_SETTINGS = ("speed", "unload", "profile", "mesh", "solver", "earlier", "derivatives", "multipliers")


def measured_curves(study: Study) -> dict[str, MeasuredCurve]:
    """First compared channel of every force experiment, repeats combined; of a load-unload test the loading."""
    return _measured(study, "force")


def measured_profiles(study: Study) -> dict[str, MeasuredCurve]:
    """Vertical displacements of every profile, repeats combined, with the reference places in `position`."""
    return _measured(study, "profile")


def measured_clouds(study: Study) -> dict[str, SurfaceCloud]:
    """The readings of every point cloud that are compared; StudyError for one that cannot be used."""
    clouds, problems = {}, []
    for n, e in enumerate(study.experiments):
        if e.kind == "surface":
            points = N_CLOUD_POINTS if e.points is None else e.points
            try:
                clouds[e.name] = surface_cloud(study.measurement(e.name), study.noise_of(e.name), e.compared, points)
            except ValueError as error:
                place = "noise" if isinstance(error, UnstatedNoise) else "data"
                problems.append(Problem(("experiments", n, place), f"cannot be used: {error}", e.files))
    if problems:
        raise study_error(study.file, study.lines, problems)
    return clouds


def _measured(study: Study, kind: str) -> dict[str, MeasuredCurve]:
    curves, problems = {}, []
    for n, e in enumerate(study.experiments):
        if e.kind != kind:
            continue
        try:
            measurement = study.measurement(e.name)
            readings = len(measurement.repeats[0].depth)
            if kind == "profile" and readings > MAX_DISPLACEMENTS:
                raise ValueError(f"{readings} displacements of one profile: keep at most {MAX_DISPLACEMENTS}")
            curve = combine(measurement, study.noise_of(e.name), e.compared[0], e.branch)
            if not curve.depth.max() > 0:
                raise ValueError(f"no depth is positive, the largest is {curve.depth.max():g} mm")
            deepest, radius = float(curve.depth.max()), _radius(study, e.name)
            if deepest < (MIN_DEPTH_RATIO * radius or MIN_DEPTH_MM):
                share = f", {deepest / radius:.1g} of the radius of the indenter, {radius:g} mm" if radius else ""
                raise ValueError(
                    f"the largest depth is {deepest:g} mm{share}: is column 'depth' in the unit that it "
                    f"is read in? Choose from {UNITS_OF_KIND['mm']}"
                )
            curves[e.name] = curve
        except ValueError as error:
            problems.append(Problem(("experiments", n, "data"), f"cannot be used: {error}", e.files))
    if problems:
        raise study_error(study.file, study.lines, problems)
    return curves


def _radius(study: Study, name: str) -> float:
    """Radius (mm) of the indenter of an experiment, 0 where its settings state none that is understood."""
    indenter = study.settings_of(name).get("indenter")
    value = indenter.get("radius") if isinstance(indenter, Mapping) else None
    try:
        return value_in_unit(value, "mm")  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return 0.0


def remarks(study: Study, name: str, of_hold: Sequence[str] = ()) -> list[str]:
    """What of the data of an experiment is not used by `rso run`, in words, with what there is to say of its hold."""
    e, measurement = study.experiment(name), study.measurement(name)
    doubtful = [*measurement.doubts, *_loud(measurement, e)]
    if e.kind == "profile":
        return doubtful if e.role == "validate" else [*doubtful, PROFILE_NOT_USED_NOTE]
    returns = any(np.any(r.segment != "loading") for r in measurement.repeats)
    left_out = without_spikes(measurement)[1]
    loading = [LOADING_COMPARED_NOTE] if returns or study.settings_of(name).get("unload") is True else []
    loading = [UNLOADING_COMPARED_NOTE] if e.branch == "unloading" else loading
    if (of_other := other_branch(study, name)) is not None:
        loading = [(UNLOADING_TOO_NOTE if e.branch == "unloading" else LOADING_TOO_NOTE).format(of_other)]
    if of_hold:
        back = of_other is None and any(np.any(r.segment == "unloading") for r in measurement.repeats)
        loading = [*of_hold, *([UNLOADING_NOT_COMPARED_NOTE] if back else [])]
    own, stated = recorded_speed(measurement), stated_speed(study, name)
    other = own is not None and stated is not None and not 1.0 / OTHER_SPEED_RATIO < own / stated < OTHER_SPEED_RATIO
    said, speed = study.settings_of(name).get("speed"), []
    if other:
        speed = [f"The times of the file say {own:.3g} mm/s, the study says speed = {said!r}: the file's counts."]
    if own is not None and stated is None and not PLAUSIBLE_SPEEDS_MM_S[0] < own < PLAUSIBLE_SPEEDS_MM_S[1]:
        speed = [f"The times of the file say {own:.3g} mm/s: is the unit of its time right?"]
    return [*doubtful, *left_out, *speed, *loading]


def _loud(measurement: Measurement, e: ExperimentTable) -> list[str]:
    """Stated noise that is more than half of what was measured: a unit misread?"""
    noise, ranges = e.noise.noise().stated, {}
    for channel in measurement.channels:
        key = "uz" if e.kind == "profile" else channel
        values = np.concatenate([r.channels[channel] for r in measurement.repeats])
        if channel in e.compared:
            ranges[key] = (
                noise.of(channel),
                f"{channel} goes over",
                float(np.ptp([0.0, *values])),
                COLUMN_UNITS[channel],
            )
    deepest = max(float(r.depth.max()) for r in measurement.repeats)
    ranges["depth"] = (noise.depth, "depth goes over", deepest, "mm")
    ranges["contact"] = (noise.contact, "depth goes over", deepest, "mm")
    return [
        f"noise.{key} = {stated:g} {unit} is more than half of the {span:.3g} {unit} that {what}: is its unit right?"
        for key, (stated, what, span, unit) in ranges.items()
        if stated > LARGE_NOISE_SHARE * span
    ]


def sketches(study: Study, backend: Backend) -> list[dict[str, Any]]:
    """Sketches of the different experiments to their deepest readings as plain data, with the names of each."""
    drawing = capability(backend, Sketches)
    if drawing is None:
        return []
    alike: dict[str, list[str]] = {}
    for e in study.experiments:
        own = {k: v for k, v in study.settings_of(e.name).items() if k not in UNDRAWN_SETTINGS}
        alike.setdefault(json.dumps(plain(own), sort_keys=True), []).append(e.name)
    found = []
    for text, names in alike.items():
        deepest = max(float(r.depth.max()) for n in names for r in study.measurement(n).repeats)
        try:
            sketch = drawing.sketch(json.loads(text), max(deepest, 0.0))
        except MISREAD_SETTING_ERRORS:  # whoever runs it says why
            continue
        found.append({"experiments": names, **dataclasses.asdict(sketch)})
    return found


def travels(curve: MeasuredCurve, targets: set[float], hold: Hold | None = None) -> tuple[float, ...]:
    """The targets, and evenly spaced travels to the deepest measured depth, that of a hold, where no target is near."""
    if curve.back:
        return _travels_back(curve)
    deepest = float(curve.depth.max()) if hold is None else hold.depth
    steps = 1 if len(curve.depth) == 1 else N_CURVE_TRAVELS
    digits = 6 - math.floor(math.log10(deepest)) if deepest > 0.0 else 6
    grid = [round(deepest * k / steps, digits) for k in range(1, steps)]
    kept = {u for u in grid if all(abs(u - t) > 0.01 * deepest for t in targets)}
    if hold is not None:  # where the indenter rests the way there ends: a target beyond is a reading's noise
        targets = {min(t, deepest) for t in targets}
    if max(targets, default=0.0) < deepest:
        kept.add(deepest)  # not rounded: every measured depth must be reached
    return tuple(sorted({*kept, *targets}))


def _travels_back(curve: MeasuredCurve) -> tuple[float, ...]:
    """Travels of an unloading: those of its readings, or as many evenly spaced ones as are bearable."""
    u = np.unique(np.round(curve.depth, 9))
    u = u if len(u) <= MAX_UNLOADING_TRAVELS else np.linspace(u[0], u[-1], MAX_UNLOADING_TRAVELS)
    return tuple(map(float, u))


def case_for(study: Study, name: str, asked: tuple[float, ...], hold: Hold | None = None) -> Case:
    """Loading of an experiment through the asked travels (mm), and its hold; that its file also has an unloading is no
    setting."""
    settings = {k: v for k, v in study.settings_of(name).items() if k != "unload"}
    speed = speed_of(study, name)[0]
    if study.experiment(name).branch == "unloading":
        return Case(name, programme_back(asked, _turn(study, name, speed)), settings)
    return Case(name, programme_of(asked, speed, hold), settings)


@dataclass(frozen=True)
class Turn:
    """How a test goes there and back: to `deepest` mm at `speed` mm/s, `rest` s there, back `pace` times as fast."""

    speed: float
    deepest: float = 0.0
    rest: float = 0.0
    pace: float = 1.0


def _turn(study: Study, name: str, speed: float) -> Turn:
    """The median over the repeats of a record."""
    repeats = study.measurement(name).repeats
    each = np.median([[r.depth.max(), dwell_time(r, speed), unloading_pace(r, speed)] for r in repeats], axis=0)
    deepest, rest, pace = (float(f"{v:.{TURN_DIGITS}g}") for v in each)
    return Turn(speed, deepest, rest, pace)


def programme_back(asked: tuple[float, ...], turn: Turn) -> Programme:
    """There, a rest, and back to the least of the asked travels (mm), which are asked for in unloading.

    So is the deepest of all, at the end of the rest.
    """
    deepest, least = max(asked[-1], turn.deepest), min(asked[0], 0.0)
    came, back = deepest / turn.speed, turn.speed * turn.pace
    left = came + turn.rest
    moments = tuple(left + (deepest - u) / back for u in sorted({*asked, deepest}, reverse=True))
    time, travel = (0.0, came, left, left + (deepest - least) / back), (0.0, deepest, deepest, least)
    keep = [0, 1, *([2] if turn.rest else []), 3]
    return Programme(tuple(time[k] for k in keep), tuple(travel[k] for k in keep), (deepest,), moments)


def other_branch(study: Study, name: str) -> str | None:
    """The experiment that compares the other branch of the same record, of one test."""
    e = study.experiment(name)
    return next((o.name for o in study.experiments if of_one_record(study, e, o)), None)


def of_one_record(study: Study, e: ExperimentTable, other: ExperimentTable) -> bool:
    """Whether two experiments compare the two branches of one record."""
    settings = [{k: v for k, v in study.settings_of(x.name).items() if k != "unload"} for x in (e, other)]
    same = not e.differing(other) and settings[0] == settings[1]
    return same and e.kind == "force" and e.branch != other.branch


def programme_of(asked: tuple[float, ...], speed: float, hold: Hold | None = None) -> Programme:
    """Loading through the asked travels (mm) at a speed (mm/s), then the moments of a hold at the deepest of them."""
    ramp = Programme.ramp(asked, speed)
    if hold is None:
        return ramp
    (_, came), (_, deepest) = ramp.time_s, ramp.travel_mm
    moments = tuple(came + s for s in hold.moments)
    return Programme((0.0, came, moments[-1]), (0.0, deepest, deepest), ramp.asked_mm, moments)


def profile_case(study: Study, name: str, curve: MeasuredCurve) -> Case:
    """The same for a profile: its depths are asked for, and the displacements of its marks."""
    case = case_for(study, name, profile_depths(curve))
    return dataclasses.replace(case, settings={**case.settings, "profile": profile_places(curve)})


def cloud_case(study: Study, name: str, cloud: SurfaceCloud) -> Case:
    """The same for a point cloud."""
    case = case_for(study, name, tuple(map(float, np.unique(cloud.depth))))
    places = [list(map(float, p)) for p in np.unique(cloud.position, axis=0)]
    return dataclasses.replace(case, settings={**case.settings, "profile": places})


def cloud_channels(cloud: SurfaceCloud) -> np.ndarray:
    """Channels (n,) of a response behind the readings of a point cloud."""
    each = zip(cloud.component.tolist(), cloud.position, strict=True)
    return np.array([mark_channel(p, component) for component, p in each])


def profile_places(curve: MeasuredCurve) -> list[list[float]]:
    """Different reference places [x, y] (mm) of a profile."""
    assert curve.position is not None
    return [list(map(float, p)) for p in np.unique(curve.position + 0.0, axis=0)]  # + 0.0: no negative zero


def mark_channel(place: Sequence[float], component: str = "uz") -> str:
    """Channel of a displacement of the surface point whose reference place is (x, y) mm."""
    x, y = (float(v) + 0.0 for v in place)
    return f"{component}({x:g},{y:g})"


def profile_depths(curve: MeasuredCurve) -> tuple[float, ...]:
    """Depths at which a profile was recorded; where they scatter from mark to mark, travels to the deepest one."""
    u = np.unique(curve.depth[curve.depth > 0])[::-1]
    kept = [float(u[0])]
    for depth in u:
        if kept[-1] - depth > 1e-3 * u[0]:  # nearer ones are the same depth, read twice
            kept.append(float(depth))
    return tuple(kept[::-1]) if len(kept) <= MAX_PROFILE_DEPTHS else travels(curve, set())


def speed_of(study: Study, name: str) -> tuple[float, str]:
    """Speed (mm/s) of an experiment and whose word that is: its record's, the study's, or nobody's.

    The same for simulations of every command; what differs from the record by no more than clocks do is as stated.
    """
    m, stated = study.measurement(name), stated_speed(study, name)
    recorded = recorded_speed(m) if m.kind == "force" else None
    if recorded is None:
        return (stated, "as stated") if stated else (DEFAULT_SPEED_MM_S, "assumed")
    if stated and 1.0 / SAME_SPEED_RATIO < recorded / stated < SAME_SPEED_RATIO:
        return stated, "as stated"
    return float(f"{recorded:.3g}"), "by its times"


def stated_speed(study: Study, name: str) -> float | None:
    """Speed (mm/s) that the study gives an experiment, None without; StudyError for what is none."""
    value = study.settings_of(name).get("speed")
    if value is None:
        return None
    try:
        speed = value_in_unit(value, "mm/s")
        if not 0.0 < speed < float("inf"):
            raise ValueError("must be positive and finite")
    except (TypeError, ValueError) as error:
        n = [e.name for e in study.experiments].index(name)
        text = f"speed = {value!r}: {error}" if "must be" in str(error) else f"speed: {error}"
        raise study_error(study.file, study.lines, [Problem(place_of_setting(study, n, "speed"), text)]) from error
    return speed


def merge_cases(
    study: Study,
    backend: Backend,
    fitted: list[ExperimentTable],
    asked: Mapping[str, tuple[float, ...]],
    resolved: Resolved,
    holds: Mapping[str, Hold],
) -> tuple[tuple[Case, ...], dict[str, int]]:
    """Experiments whose canonical settings are equal become one case that is asked for all their travels; those with a
    hold only where it is the same."""
    # Inside the ranges: at their ends an effect may be neutral, and then more drops out than elsewhere.
    example = {a.name: 0.5 * (a.low + a.high) for a in resolved.axes} | dict(resolved.fixed)
    cases: list[Case] = []
    index: dict[str, int] = {}
    case_of: dict[str, int] = {}
    for e in fitted:
        hold = holds.get(e.name)
        case = case_for(study, e.name, asked[e.name], hold)
        plain = backend.canonical(example, case)[1]
        speed = _pace(plain.programme)  # one and the same where rates do not matter
        rest = {} if hold is None else {"hold": [hold.depth, *hold.moments]}
        if e.branch == "unloading":
            rest |= {"back": [*asked[e.name], *plain.programme.time_s, *plain.programme.travel_mm]}
        same = digest({"settings": by_contents(dict(plain.settings)), "speed": round(speed, 12), **rest})
        if same in index:
            k = index[same]
            if e.branch == "unloading":
                case_of[e.name] = k
                continue
            union, own = tuple(sorted({*cases[k].programme.asked_mm, *asked[e.name]})), cases[k].programme
            cases[k] = dataclasses.replace(cases[k], programme=programme_of(union, _pace(own), hold))
        else:
            k = index[same] = len(cases)
            cases.append(case)
        case_of[e.name] = k
    return tuple(cases), case_of


def _pace(programme: Programme) -> float:
    """Speed (mm/s) of the way there."""
    k = 1 if programme.asked_s else -1
    return programme.travel_mm[k] / programme.time_s[k]


def refuse_what_is_not_modelled(
    study: Study,
    backend: Backend,
    resolved: Resolved,
    curves: Mapping[str, MeasuredCurve],
    clouds: Mapping[str, SurfaceCloud] = MappingProxyType({}),
) -> None:
    problems = [*foreign_units(study, backend), *foreign_setting_units(study, backend)]
    for n, e in enumerate(study.experiments):
        place: Place = ("experiments", n)
        unload = study.settings_of(e.name).get("unload", False)
        if not isinstance(unload, bool):
            text = f"unload = {unload!r}: true or false is expected"
            problems.append(Problem(place_of_setting(study, n, "unload"), text))
        wrong = _refusal(backend, case_for(study, e.name, travels(curves[e.name], set())))
        for line in [] if wrong is None else _one_a_line(wrong):
            at = place_of_setting(study, n, line)
            found = Problem(at, line, e.files) if at[-1] == "data" else Problem(at, line)
            problems += [] if found in problems else [found]  # what all experiments share is said once
        if e.kind == "force":
            problems += [_no_channel(backend, (*place, "channels"), c) for c in e.compared if c not in backend.channels]
        elif e.kind == "surface":
            if wrong is None and (why := _refusal(backend, cloud_case(study, e.name, clouds[e.name]))) is not None:
                text = f"the backend {backend.name!r} has no such points: {why}"
                problems.append(Problem((*place, "data"), text, e.files))
        elif e.compared != ("uz",):
            text = 'a profile is compared by its vertical displacements: leave this out, or give ["uz"]'
            problems.append(Problem((*place, "channels"), text, list(e.compared)))
        elif wrong is None and (why := _refusal(backend, profile_case(study, e.name, curves[e.name]))) is not None:
            problems.append(Problem((*place, "kind"), f"the backend {backend.name!r} has no profiles: {why}", e.kind))
    if not any(e.kind == "force" and e.role == "fit" for e in study.experiments):
        text = 'profiles are not fitted: at least one force curve needs role = "fit"'
        problems.append(Problem(("experiments",), text))
    problems += _refuse_search(study, backend)
    opened = [a.name for a in resolved.axes]
    if not problems:  # settings that can be read
        problems += refuse_inputs(study, backend, resolved.inputs, resolved.fixed, opened)
    for p in backend.parameters:
        if p.default is None and p.name not in opened and p.name not in resolved.fixed:
            text = f"the backend needs {p.name!r} ({p.description}, {p.unit}): give low and high, or value"
            problems.append(Problem(("parameters",), text))
    if problems:
        raise study_error(study.file, study.lines, problems)


def foreign_units(study: Study, backend: Backend) -> list[Problem]:
    """Channels that the backend declares in another unit than that in which they meet what was measured."""
    place: Place = ("backend", "use" if study.backend.command is None else "command")
    wrong = [
        (c, unit) for c, unit in backend.channels.items() if c in CHANNEL_UNITS and not same(unit, CHANNEL_UNITS[c])
    ]
    return [
        Problem(
            place,
            f"the backend {backend.name!r} declares channel {c!r} in {unit}; choose {CHANNEL_UNITS[c]}, in which it is "
            "compared: responses are not converted",
        )
        for c, unit in wrong
    ]


def foreign_setting_units(study: Study, backend: Backend) -> list[Problem]:
    """Columns of a table of specimens that state a setting in a unit of another kind than the backend reads it in."""
    asked, problems = capability(backend, SettingUnits), []
    for place, line in study.lines.items():
        if asked is None or not (isinstance(line, LineElsewhere) and line.unit and "settings" in place):
            continue
        at = place.index("settings")
        above, keys = place[:at], tuple(str(k) for k in place[at + 1 :])
        if above[:1] == ("experiments",):
            settings = study.settings_of(study.experiments[int(above[1])].name)
        else:
            settings = {BACKEND_SETTING: above[1]} if above[:1] == ("backends",) else {}
        meant = asked.setting_unit(settings, keys)
        if meant is not None and not same(in_base(f"1 {line.unit}")[1], meant):
            what = "is a pure number" if meant == "1" else f"is in {meant}"
            text = f"{line.unit!r} is no unit of it: {'.'.join(keys)} {what}"
            problems.append(Problem(place, text))
    return problems


def _refusal(backend: Backend, case: Case) -> str | None:
    """Why the backend does not model a case, or None if it does."""
    try:
        backend.check(case)
    except MISREAD_SETTING_ERRORS as error:
        return str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    return None


def _one_a_line(refusal: str) -> list[str]:
    """The problems that a refusal names: its lines where each begins with a setting, else the whole of it."""
    lines = refusal.splitlines()
    return lines if len(lines) > 1 and all(map(_SETTING_SENTENCE.match, lines)) else [refusal]


def place_of_setting(study: Study, n: int, message: str) -> Place:
    """Where the setting stands that a message of the backend names first, as choices come after it.

    A travel or a programme is that of the n-th experiment's data.  Else where that experiment has its own settings.
    """
    own, words = study.experiments[n].settings, re.findall(r"\w+", message)
    if words and words[0] in ("travel", "travel_mm", "programme"):
        return ("experiments", n, "data")
    owners: list[tuple[Place, Mapping[str, object]]] = [
        (("experiments", n, "settings"), own),
        (("backend", "settings"), study.backend.settings),
    ]
    for key in words:
        for place, settings in owners:
            if key in settings:
                return _of_a_table(study, (*place, key), message)
    return ("experiments", n, "settings") if own else ("backend", "settings")


def _of_a_table(study: Study, place: Place, message: str) -> Place:
    """The key below `place` that the message begins with, as specimen.thickness, where a table of specimens has it."""
    named = re.match(r"\w+((?:\.\w+)+)", message)
    deep = (*place, *named[1][1:].split(".")) if named else place
    return deep if isinstance(study.lines.get(deep), LineElsewhere) else place


def _refuse_search(study: Study, backend: Backend) -> list[Problem]:
    """Targets and constraints on channels that the backend has, constraints on experiments that are fitted."""
    problems = []
    owners: list[tuple[Place, tuple[TargetTable, ...]]] = [(("search",), study.search.targets)]
    owners += [(("search", "variants", n), v.targets) for n, v in enumerate(study.search.variants)]
    for place, targets in owners:
        for n, t in enumerate(targets):
            if t.channel not in backend.channels:
                problems.append(_no_channel(backend, (*place, "targets", n, "channel"), t.channel))
    for n, c in enumerate(study.search.constraints):
        place = ("search", "constraints", n)
        if c.channel not in backend.channels:
            problems.append(_no_channel(backend, (*place, "channel"), c.channel))
        if study.experiment(c.experiment).role == "validate":
            text = 'is for validation (role = "validate") and cannot be constrained'
            problems.append(Problem((*place, "experiment"), text, c.experiment))
        elif study.experiment(c.experiment).kind != "force":
            text = f"is a {study.experiment(c.experiment).kind}; constraints are on the response to a force experiment"
            problems.append(Problem((*place, "experiment"), text, c.experiment))
    return problems


def _no_channel(backend: Backend, place: Place, channel: str) -> Problem:
    return Problem(
        place, f"the backend {backend.name!r} has no such channel; {choices_text(channel, backend.channels)}", channel
    )


def contact_modulus(backend: Backend, settings: Mapping[str, object], curve: MeasuredCurve) -> Mapping[str, float]:
    """Knob → modulus (MPa) of the shallow half of a loading on a half-space; nothing where the backend knows none."""
    limit, deepest = capability(backend, ContactModulus), 0.5 * float(curve.depth.max())
    shallow = (curve.depth > 0.0) & (curve.depth <= deepest)
    if limit is None or curve.channel != "Fz" or not shallow.any():
        return {}
    return limit.hertz(settings, curve.depth[shallow], curve.value[shallow])
