"""What the settings of a study mean to its backend, in words.

Nothing is known here of what a setting is: plain data, and the backend's own form of them, are compared.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rso.calibration.plan import Plan
from rso.contract import Case, ErrorCalibration, OrdinaryMaterials, Resolution, SizeChecks, capability
from rso.core.digits import quantity_text
from rso.doe import read_condition
from rso.evaluation.joint import BACKEND_SETTING
from rso.study.cases import case_for, travels
from rso.study.dimensions import MISREAD_SETTING_ERRORS, dimension_errors
from rso.study.schema import Study

MAX_UNTOLD_MESH_ERROR_SHARE = 0.04  # of the force at the deepest reading: what a mesh may miss without a word
MAX_RANGE_CORNERS = 4096  # corners of the ranges that are looked at


def of_study(plan: Plan) -> list[str]:
    """Settings that the study states, whatever the defaults are, and those that it leaves to the backend."""
    taken, default = (_taken(plan, plan.study.experiments[0].name, s) for s in (plan.study.backend.settings, {}))
    if taken is None:
        return []
    said = _flat(plan.study.backend.settings)
    usual = default or {}
    other = {k: v for k, v in taken.items() if k not in usual or usual[k] != v}
    # a table's other keys follow from those that are said
    stated = {k: v for k, v in taken.items() if k in said or (k in other and "." not in k)}
    unstated = {k: v for k, v in taken.items() if k not in stated and v not in ([], None)}
    groups = {"settings as stated": stated, "settings by the backend, by default or for its own use": unstated}
    return [line for words, found in groups.items() for line in _list(f"  {words}: ", map(_pair, found.items()))]


def exact_dimensions(plan: Plan) -> list[str]:
    """Errors of stated dimensions that an identification leaves out: nobody said how well these are known.

    One that only some of the experiments state is named with the others.
    """
    named = {i.parameter.name for i in plan.resolved.inputs}
    left = unstated_dimensions(plan)
    return [f"{n} of {', '.join(own)}" if n in named else n for n, own in left.items()]


def unstated_dimensions(plan: Plan) -> dict[str, list[str]]:
    """Error of a stated dimension → fitted experiments that have it and do not say how well it is known."""
    given = [*(n for n, v in plan.resolved.fixed.items() if v), *(a.name for a in plan.resolved.axes)]
    left: dict[str, list[str]] = {}
    for e in [e.name for e in plan.study.experiments if e.name in plan.case_of]:
        said = {i.parameter.name for i in plan.resolved.inputs if not i.experiments or e in i.experiments}
        for n in dimension_errors(plan.backend, plan.study.settings_of(e), given):
            if n not in said and n not in given:
                left.setdefault(n, []).append(e)
    return left


def extraordinary(plan: Plan) -> list[str]:
    """What the backend says of ordinary materials and does not hold all over the ranges, a sentence each."""
    conditions = capability(plan.backend, OrdinaryMaterials)
    said = conditions.ordinary() if conditions else {}
    at: list[tuple[str, tuple[float, ...]]] = [(a.name, (a.low, a.high)) for a in plan.resolved.axes]
    at += [(name, (value,)) for name, value in plan.resolved.fixed.items()]
    names, lines = [name for name, _ in at], []
    corners = np.array(list(itertools.product(*(ends for _, ends in at)))[:MAX_RANGE_CORNERS])
    for text, words in said.items():
        if not set(re.findall(r"[A-Za-z_]\w*", text)) <= set(names):
            continue
        off = np.asarray(read_condition(text, names, words).excess(dict(zip(names, corners.T, strict=True)))) > 0.0
        if off.any():
            where = "any of their corners" if off.all() else "some of their corners"
            lines.append(f"ranges beyond ordinary materials: {words} needs {text}, not so at {where}")
    return lines


def unresolved_experiments(plan: Plan) -> list[str]:
    """Experiments whose deepest reading the mesh resolves badly, and by which level it would be better."""
    meshes = capability(plan.backend, Resolution)
    if meshes is None:
        return []
    lines = []
    for e in plan.study.experiments:
        if e.kind != "force" or e.name not in plan.curves:
            continue
        settings = {k: v for k, v in plan.study.settings_of(e.name).items() if k != "unload"}
        deepest = float(plan.curves[e.name].depth.max())
        given = [*plan.resolved.fixed, *(a.name for a in plan.resolved.axes)]
        levels = list(meshes.resolution(settings, deepest, given).items())
        if deepest <= 0.0 or not levels or levels[0][1] <= MAX_UNTOLD_MESH_ERROR_SHARE:
            continue
        (own, error), *others = levels
        better = [f"{name} {100 * v:.2g} %" for name, v in others if v < 0.8 * error]
        hint = f"; by level: {', '.join(better)}" if better else ""
        lines.append(
            f"experiment {e.name!r}: the mesh limits the accuracy, not the noise. The contact is small against the "
            f"elements: the force at {quantity_text(deepest, 'mm')} is about {100 * error:.2g} % off at mesh.level = "
            f"{json.dumps(own)}{hint}"
        )
    return lines


def uncalibrated_experiments(plan: Plan) -> list[str]:
    """Experiments for which the backend's stated errors were not fitted, a sentence for each reason."""
    errors = capability(plan.backend, ErrorCalibration)
    if errors is None:
        return []
    given = [*plan.resolved.fixed, *(a.name for a in plan.resolved.axes)]
    said = [errors.uncalibrated(plan.study.settings_of(e.name), given) for e in plan.study.experiments]
    return list(dict.fromkeys(s for s in said if s))


def of_experiment(plan: Plan, name: str) -> list[str]:
    """What the backend takes an experiment for where that differs from the study's settings."""
    if (other := plan.study.experiment(name).backend) is not None:
        said = {k: v for k, v in _flat(plan.study.settings_of(name)).items() if k != BACKEND_SETTING}
        return _list(f"    answered by [backends.{other}]: ", [f"{k} = {json.dumps(v)}" for k, v in said.items()])
    own, shared = (_taken(plan, name, s) for s in (plan.study.settings_of(name), plan.study.backend.settings))
    if own is None or shared is None:
        return []
    default = {p.name: p.default for p in plan.backend.parameters}
    pairs = {k: (own.get(k, default.get(k)), shared.get(k, default.get(k))) for k in {**own, **shared}}
    found = [f"{k} = {json.dumps(a)} (study: {json.dumps(b)})" for k, (a, b) in pairs.items() if a != b]
    return _list("    differs from the study's settings: ", found)


def replaced(study: Study, name: str) -> list[str]:
    """Tables of an experiment's settings that lack keys of the study's table, which they replace as a whole."""
    lines, own = [], study.experiment(name).settings
    for key, table in study.backend.settings.items():
        if isinstance(table, Mapping) and isinstance(own.get(key), Mapping):
            lost = {k: v for k, v in table.items() if k not in own[key]}
            words = f"settings.{key} replaces the study's table as a whole: without "
            lines += [f"{words}{', '.join(map(_pair, lost.items()))}"] if lost else []
    return lines


def _taken(plan: Plan, name: str, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """The backend's own form of such settings, knobs that they set included, by dotted key; None if it has none.

    What stands in a table of that form alone, neither stated nor there where nothing is, is left out.
    """
    found, usual, stated = _canonical(plan, name, settings), _canonical(plan, name, {}), _flat(settings)
    if found is None or usual is None:
        return found
    return {k: v for k, v in found.items() if "." not in k or k in stated or k in usual}


def _canonical(plan: Plan, name: str, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    # inside the ranges: at their ends an effect may be neutral
    given = {a.name: 0.5 * (a.low + a.high) for a in plan.resolved.axes} | dict(plan.resolved.fixed)
    programme = case_for(plan.study, name, travels(plan.curves[name], set())).programme
    case = Case(name, programme, {k: v for k, v in settings.items() if k != "unload"})
    try:
        values, case = plan.backend.canonical(given, case)
    except MISREAD_SETTING_ERRORS:
        return None
    return _flat(plan.study.written(case.settings)) | {k: v for k, v in values.items() if k not in given}


def _flat(settings: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in settings.items():
        found |= _flat(value, f"{above}{key}.") if isinstance(value, Mapping) else {f"{above}{key}": value}
    return found


def _pair(item: tuple[str, Any]) -> str:
    return f"{item[0]} = {json.dumps(item[1])}"


def _list(head: str, found: Iterable[str]) -> list[str]:
    """One line, or none where there is nothing."""
    text = ", ".join(found)
    return [head + text] if text else []


def doubts_of_sizes(plan: Plan, name: str) -> list[str]:
    """What does not fit between the sizes stated for an experiment and its record, a sentence each."""
    sizes, e = capability(plan.backend, SizeChecks), plan.study.experiment(name)
    if sizes is None or e.kind != "force" or e.backend is not None:
        return []
    settings = {k: v for k, v in plan.study.settings_of(name).items() if k != "unload"}
    m = plan.study.measurement(name)
    return list(sizes.odd_sizes(settings, max(float(r.depth.max()) for r in m.repeats), m.notes))
