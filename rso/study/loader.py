"""study.toml → :class:`Study`: every problem of the file and of its data files at once, each with its place."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from rso.data import Measurement, Noise, combine, fingerprint, read_measurement, value_at
from rso.evaluation.joint import BACKEND_SETTING
from rso.study.base_table import StudyFileTable
from rso.study.columns_table import ColumnsTable
from rso.study.confusable_text import look_alikes
from rso.study.deck_table import deck_parameter
from rso.study.errors import Problem, choices_text, schema_problems, study_error
from rso.study.line_numbers import Place, toml_lines
from rso.study.schema import DoeTable, ExperimentTable, Study, StudySource
from rso.study.search_table import ConstraintTable, TargetTable
from rso.study.settings_files import with_absolute_paths
from rso.study.toml_text import study_source, tables_of

T = TypeVar("T", bound=StudyFileTable)

ATTRACTION_PARAMETER = "adhesion"  # where a study states it, a pull into contact is its model's, or said to be none


def load_study(path: str | Path) -> Study:
    """Read and check a study file, or the study.toml inside a folder; StudyError with all that is wrong.

    Data files are read too.  What needs the backend (names, units and hard bounds of the parameters) is
    checked by :func:`rso.study.resolve.resolve`.
    """
    file, text = study_source(path)
    raw, lines = tables_of(file, text), toml_lines(text)
    if "specimens" in raw:
        many = "this study has many specimens: name one (--specimen NAME; from Python specimen=...)"
        raise study_error(file, lines, [Problem(("specimens",), f"{many}, or use rso run, status or rso.specimens")])
    return study_of(file, raw, lines)


def study_of(
    file: Path, raw: dict[str, Any], lines: Mapping[Place, int], specimen: str = "", digest: str = ""
) -> Study:
    """The study of parsed tables, as of :func:`load_study`; `specimen` and `digest` are those of one of many."""
    raw = _with_files(raw, file.parent)
    problems: list[Problem] = []
    study = None
    try:
        study = Study.model_validate(raw)
    except ValidationError as error:
        problems += schema_problems(Study, error)
    measurements: dict[str, Measurement] = {}
    problems += _check_experiments(raw, file.parent, measurements)
    problems += _check_search(raw, measurements)
    problems += _check_names(raw, file.parent)
    problems += _check_look_alikes(raw)
    problems += (
        [] if study is None else [*_check_deck(study), *_check_objectives(study), *_check_backends(study, specimen)]
    )
    if problems or study is None:
        raise study_error(file, lines, problems)
    if specimen:
        title = f"{study.study.title}: {specimen}"
        study = study.model_copy(update={"study": study.study.model_copy(update={"title": title})})
    study._source = StudySource(file, lines, measurements, specimen, digest)
    return study


def _with_files(raw: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Unchecked data in which files that settings name are found from anywhere."""

    def here(table: Any) -> Any:
        settings = table.get("settings") if isinstance(table, dict) else None
        return {**table, "settings": with_absolute_paths(settings, folder)} if isinstance(settings, dict) else table

    found = {**raw, "backend": here(raw["backend"])} if "backend" in raw else dict(raw)
    if isinstance(raw.get("backends"), dict):
        found["backends"] = {name: here(table) for name, table in raw["backends"].items()}
    experiments = raw.get("experiments")
    return {**found, "experiments": [here(e) for e in experiments]} if isinstance(experiments, list) else found


def _tables(raw: dict[str, Any], *place: str) -> list[Any]:
    """The array of tables at `place` of unchecked data; empty where there is none."""
    inner: Any = raw
    for key in place:
        inner = inner.get(key) if isinstance(inner, dict) else None
    return inner if isinstance(inner, list) else []


def _valid(model: type[T], raw: list[Any]) -> Iterator[tuple[int, T]]:
    """Those tables that are right in themselves: the others have been reported, checks go on with these."""
    for n, table in enumerate(raw):
        try:
            yield n, model.model_validate(table)
        except ValidationError:
            continue


def _names(raw: dict[str, Any]) -> list[str]:
    """Names of all experiments, right or wrong."""
    tables = [e for e in _tables(raw, "experiments") if isinstance(e, dict)]
    return [e["name"] for e in tables if isinstance(e.get("name"), str)]


def _check_experiments(raw: dict[str, Any], folder: Path, measurements: dict[str, Measurement]) -> Iterator[Problem]:
    """Names, order, data; fills `measurements`."""
    names = _names(raw)
    experiments = dict(_valid(ExperimentTable, _tables(raw, "experiments")))
    shared = dict(_valid(ColumnsTable, [raw.get("columns", {})]))
    roles = [e.get("role") for e in _tables(raw, "experiments") if isinstance(e, dict)]
    if "objectives" not in raw and "experiments" not in raw:
        text = "are missing: [[experiments]] with data to fit, or [objectives] of a study without measurements"
        yield Problem(("experiments",), text)
    if "experiments" in raw and "objectives" in raw:
        text = "a study has data to fit ([[experiments]]) or something to minimise ([objectives]), not both"
        yield Problem(("objectives",), text)
    elif "experiments" in raw and "fit" not in roles:
        yield Problem(("experiments",), 'at least one experiment needs role = "fit"')
    circles: set[frozenset[str]] = set()
    after = {e.name: e.after for e in experiments.values()}
    round_about = _on_circles(after)
    count = Counter(names)
    known = set(names)
    for n, e in experiments.items():
        place: Place = ("experiments", n)
        if count[e.name] > 1 and any(other.name == e.name for k, other in experiments.items() if k < n):
            yield Problem((*place, "name"), "this name is taken by an earlier experiment", e.name)
        for other in e.after:
            if other not in known or (other == e.name and count[other] == 1):
                yield Problem(
                    (*place, "after"), f"no other experiment; {choices_text(other, set(names) - {e.name})}", other
                )
        circle = _circle(e.name, after) if e.name in round_about else ()
        taken = any(count[k] > 1 for k in circle or ())  # of two with one name nobody knows which is meant
        if circle and not taken and frozenset(circle) not in circles:  # one mistake, wherever it is entered
            circles.add(frozenset(circle))
            text = f"comes after itself: {', '.join(circle)}; leave one of these out"
            yield Problem((*place, "after"), text, list(e.after))
        columns = e.columns or shared.get(0)
        if columns is None:  # the table of all experiments is wrong in itself
            continue
        files = [folder / f for f in e.data]
        try:
            measurement = read_measurement(files, columns.columns(), e.preload, e.drift)
        except ValueError as error:
            yield Problem((*place, "data"), f"cannot be used: {error}", e.files)
            continue
        if measurement.kind != ("profile" if e.kind == "surface" else e.kind):
            yield Problem((*place, "kind"), f"the columns of {e.files} are those of a {measurement.kind}", e.kind)
            continue
        parameters = raw.get("parameters")
        if isinstance(parameters, dict) and ATTRACTION_PARAMETER in parameters:  # the model follows the pull
            measurement = replace(measurement, repeats=tuple(replace(r, pull=0.0) for r in measurement.repeats))
        measurements.setdefault(e.name, measurement)
        for channel in e.compared:
            if channel not in measurement.channels:
                message = f"{e.files} has no such channel; {choices_text(channel, measurement.channels)}"
                yield Problem((*place, "channels"), message, channel)
    yield from _check_once(raw, experiments, folder, measurements)


def _check_once(
    raw: dict[str, Any], experiments: dict[int, ExperimentTable], folder: Path, measurements: dict[str, Measurement]
) -> Iterator[Problem]:
    """Readings count once: those kept for validation are not fitted or selected on, no others stand in two tests.

    Files are the same where their bytes are, readings where they also stand beneath the same headers.
    """
    there = {n: e for n, e in experiments.items() if e.name in measurements}
    known = {n: {fingerprint(folder / f): f for f in e.data} for n, e in there.items()} if len(there) > 1 else {}
    for n, k in itertools.permutations(known, 2):
        e, other = there[n], there[k]
        same = known[n].keys() & known[k].keys()
        heads = measurements[e.name].headers, measurements[other.name].headers
        twice = {c for c in {*e.compared} & {*other.compared} if heads[0].get(c) == heads[1].get(c)}
        if not (same and twice):
            continue
        files = " and ".join(dict.fromkeys((known[n][min(same)], known[k][min(same)])))
        text = (
            f"experiments {e.name!r} (role = {e.role!r}) and {other.name!r} (role = {other.role!r}) have the same "
            f"data ({files})"
        )
        branches, alike = e.branch != other.branch and e.kind == "force", _settings(raw, e) == _settings(raw, other)
        if e.role == "validate" and other.role != "validate":
            why = ": what was used before validates nothing"
            if branches:
                why = ': its loading and unloading share contact and gain. Fit both, each with role = "fit"'
        elif k < n and other.role != "validate" and branches:
            apart = [*e.differing(other), *([] if alike else ["settings"])]
            if not apart:
                continue  # one record, whose errors the two branches share
            keys = " and ".join(apart)
            why = f": state the same {keys} in both, so that its loading and unloading share contact and gain"
        elif k < n and other.role != "validate" and alike:
            why = " of one test: a repeat counts once"
        else:
            continue
        yield Problem(("experiments", n, "data"), text + why, e.files)


def _settings(raw: dict[str, Any], e: ExperimentTable) -> dict[str, Any]:
    """Settings of an experiment: its own replace those of the backend; that its file has an unloading is none."""
    backend = raw.get("backend")
    shared = backend.get("settings") if isinstance(backend, dict) else None
    own = {**(shared if isinstance(shared, dict) else {}), **e.settings}
    return {name: value for name, value in own.items() if name != "unload"}


def _on_circles(after: Mapping[str, Sequence[str]]) -> set[str]:
    """Names left when those are taken away again and again that come after none of the others: all on circles."""
    waits = {name: {k for k in others if k in after and k != name} for name, others in after.items()}
    behind: dict[str, list[str]] = {}
    for name, others in waits.items():
        for k in others:
            behind.setdefault(k, []).append(name)
    free = [name for name, others in waits.items() if not others]
    while free:
        done = free.pop()
        del waits[done]
        for name in behind.get(done, ()):
            waits[name].discard(done)
            if not waits[name]:
                free.append(name)
    return set(waits)


def _circle(name: str, after: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Other names on a way along `after` that ends where it began, with the name at both ends; empty without one."""
    ways: list[tuple[str, ...]] = [(name, other) for other in after[name] if other != name]
    seen = {name}
    while ways:
        way = ways.pop()
        if way[-1] == name:
            return way
        if way[-1] not in seen:
            seen.add(way[-1])
            ways += [(*way, other) for other in after.get(way[-1], ())]
    return ()


def _check_search(raw: dict[str, Any], measurements: dict[str, Measurement]) -> Iterator[Problem]:
    """Targets and constraints refer to what is there; variants have names of their own and known parameters."""
    names = _names(raw)
    variants = _tables(raw, "search", "variants")
    places: list[Place] = [("search",), *(("search", "variants", n) for n in range(len(variants)))]
    owners = [raw.get("search"), *variants]
    experiments = [e for _, e in _valid(ExperimentTable, _tables(raw, "experiments"))]
    roles: dict[str, str] = {e.name: e.role for e in reversed(experiments)}  # of two with one name the first counts
    for owner, place in zip(owners, places, strict=True):
        if not isinstance(owner, dict):
            continue
        for n, target in _valid(TargetTable, _tables(owner, "targets")):
            yield from _check_target(target, (*place, "targets", n), names, roles, measurements)
        if place != ("search",):
            yield from _check_ranges(owner, (*place, "ranges"), raw.get("parameters"))
    for n, constraint in _valid(ConstraintTable, _tables(raw, "search", "constraints")):
        if constraint.experiment not in names:
            where = ("search", "constraints", n, "experiment")
            yield Problem(
                where, f"unknown experiment; {choices_text(constraint.experiment, names)}", constraint.experiment
            )
    titles = [v.get("name") for v in variants if isinstance(v, dict)]
    for n, title in enumerate(titles):
        if isinstance(title, str) and title in ("main", *titles[:n]):
            whose = "the search itself" if title == "main" else "an earlier variant"
            yield Problem(("search", "variants", n, "name"), f"this name is taken by {whose}", title)


def _check_target(
    target: TargetTable, place: Place, names: list[str], roles: dict[str, str], measurements: dict[str, Measurement]
) -> Iterator[Problem]:
    name = target.experiment
    if name not in names:
        yield Problem((*place, "experiment"), f"unknown experiment; {choices_text(name, names)}", name)
        return
    if roles.get(name) == "validate":
        yield Problem((*place, "experiment"), 'is for validation (role = "validate") and cannot be a target', name)
        return
    if name not in measurements:
        return
    measurement = measurements[name]
    if measurement.kind == "profile":
        yield Problem((*place, "experiment"), "is a profile; targets are points of a force curve", name)
        return
    if target.channel not in measurement.channels:
        message = f"not measured in {name!r}; {choices_text(target.channel, measurement.channels)}"
        yield Problem((*place, "channel"), message, target.channel)
        return
    if target.since:  # a moment of a hold, which the plan knows
        return
    try:
        value_at(combine(measurement, Noise(), target.channel), target.depth)
    except ValueError as error:
        yield Problem((*place, "depth"), f"{name}: {error}", target.depth)


def _check_ranges(variant: dict[str, Any], place: Place, parameters: Any) -> Iterator[Problem]:
    ranges = variant.get("ranges")
    if isinstance(ranges, dict) and isinstance(parameters, dict):
        for name in ranges.keys() - parameters.keys():
            yield Problem((*place, name), f"no parameter of this study; {choices_text(name, parameters)}")


def _check_names(raw: dict[str, Any], folder: Path) -> Iterator[Problem]:
    """Required parameters are searched for, something is searched for, and the DOE file is there."""
    parameters = raw.get("parameters")
    if isinstance(parameters, dict):
        free = [k for k, v in parameters.items() if not (isinstance(v, dict) and "value" in v)]
        if not free:
            yield Problem(("parameters",), "nothing to identify: at least one parameter needs low and high")
        for n, name in enumerate(_tables(raw, "identify", "require")):
            if isinstance(name, str) and name not in free:
                yield Problem(("identify", "require", n), f"not searched for; {choices_text(name, free)}", name)
    for _, doe in _valid(DoeTable, [raw.get("doe", {})]):
        if doe.file is not None and not (folder / doe.file).is_file():
            yield Problem(("doe", "file"), "there is no such file next to the study", doe.file)


def _check_backends(study: Study, specimen: str) -> Iterator[Problem]:
    """Experiments name backends that there are, and every further one has an experiment, but of one specimen of many,
    with which not every test was done."""
    for n, e in enumerate(study.experiments):
        if e.backend is not None and e.backend not in study.backends:
            yield Problem(("experiments", n, "backend"), choices_text(e.backend, study.backends), e.backend)
        if BACKEND_SETTING in e.settings:
            place = ("experiments", n, "settings", BACKEND_SETTING)
            yield Problem(
                place,
                f"the backend of an experiment stands beside its settings: backend = {e.settings[BACKEND_SETTING]!r}",
            )
    used = {e.backend for e in study.experiments}
    for name, table in study.backends.items():
        if name not in used and not specimen:
            yield Problem(("backends", name), f'no experiment has it: give one backend = "{name}"')
        if table.template is not None or study.backend.template is not None:
            yield Problem(("backends", name), "a program with a template cannot stand beside other backends")
    if study.backends and "diagnose" in study.model_fields_set:
        yield Problem(("diagnose",), "a diagnosis is of one backend; this study has several ([backends])")
    if study.backends and "ladder" in study.model_fields_set:
        yield Problem(("ladder",), "a ladder is of one backend; this study has several ([backends])")


MEASURED_ONLY_KEYS = {  # tables and keys that mean something only where there are data
    "columns": (),
    "uncertainty": (),
    "identify": (),
    "diagnose": (),
    "ladder": (),
    "next": (),
    "search": ("targets", "constraints", "metric", "repair", "repair_limit", "variants"),
    "doe": ("reduce",),
}
DISCRETE_KEYS = ("whole", "values", "choices")


def _check_objectives(study: Study) -> Iterator[Problem]:
    """What belongs to data has no place in a study without, and the other way round."""
    if study.objectives is None:
        for name, table in study.parameters.items():
            for key in DISCRETE_KEYS:
                if getattr(table, key):
                    text = "belongs to a study with [objectives]; a fit to measurements searches ranges, low to high"
                    yield Problem(("parameters", name, key), text)
        if study.search.method == "simulations":
            yield Problem(("search", "method"), "belongs to a study with [objectives]", study.search.method)
        return
    for place, keys in MEASURED_ONLY_KEYS.items():
        if place in study.model_fields_set and not keys:
            yield Problem((place,), "belongs to a study with data; this one has [objectives]")
        for key in keys:
            if key in getattr(study, place).model_fields_set:
                yield Problem((place, key), "belongs to a study with data; this one has [objectives]")
    if study.search.method == "gauss_newton":
        text = "fits curves; with [objectives] choose response_surface or simulations"
        yield Problem(("search", "method"), text, study.search.method)
    if study.surrogate.kind == "whole_curve":
        text = "learns curves; with [objectives] choose auto, polynomial or kriging: what is read of a curve is learnt"
        yield Problem(("surrogate", "kind"), text, study.surrogate.kind)


def _check_deck(study: Study) -> Iterator[Problem]:
    """Units of what a program is given and of what it writes; without a template the backend declares parameters."""
    own = ("unit", "bounds", "description")
    for name, table in study.parameters.items():
        stated = [k for k in own if k in table.model_fields_set]
        if study.backend.template is None and stated:
            text = "belongs to a parameter of a template (backend.template); here the backend declares it"
            yield Problem(("parameters", name, stated[0]), text, getattr(table, stated[0]))
        elif study.backend.template is not None:
            try:
                deck_parameter(name, table)
            except ValueError as error:
                yield Problem(("parameters", name), str(error))
    for name, output in study.backend.outputs.items():
        try:
            output.output(name)
        except ValueError as error:
            yield Problem(("backend", "outputs", name), str(error))


def _check_look_alikes(raw: dict[str, Any]) -> Iterator[Problem]:
    """Names of one kind that differ by nothing that a reader sees would be mistaken for one another."""
    rungs: list[tuple[Place, list[Any]]] = [(("ladder", "levels"), _tables(raw, "ladder", "levels"))]
    rungs += [
        ((*place, n), inner) for place, tables in rungs for n, inner in enumerate(tables) if isinstance(inner, list)
    ]
    kinds = [
        (("experiments",), "name"),
        (("experiments",), "mounting"),
        (("search", "variants"), "name"),
        (("next", "experiments"), "name"),
    ]
    lists = [(place, key, _tables(raw, *place)) for place, key in kinds] + [(p, "name", t) for p, t in rungs]
    for place, key, tables in lists:
        named = [(n, t[key]) for n, t in enumerate(tables) if isinstance(t, dict) and isinstance(t.get(key), str)]
        for k, name, earlier in look_alikes([name for _, name in named]):
            text = f"looks like {earlier!r} and is another name: by case, a blank or a letter of another script"
            yield Problem((*place, named[k][0], key), text, name)
