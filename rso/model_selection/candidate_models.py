"""The levels of a ladder: what `[ladder]` names, what the backend offers, and the axes of each level in numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rso.calibration.plan import STRESS_SCALE_REASON, Plan
from rso.contract import Backend, ModelHierarchy, Parameter, Variants, capability
from rso.core.similarity import Group, group, stress_exponent
from rso.core.units import value_in_unit
from rso.data import CreepHold, Hold
from rso.doe import Box
from rso.model_selection import ModelLevel
from rso.study.analysis_tables import LevelTable
from rso.study.errors import Problem, choices_text, study_error
from rso.study.holds import hold_ranges, middle, relaxation_knobs, relaxes
from rso.study.line_numbers import Place

STUDY_LEVEL = "study"  # the model as the study file states it
LOG_SCALE_RATIO = 4.0  # a positive range with a larger ratio of its ends is searched on a log scale


@dataclass(frozen=True, eq=False)
class Axes:
    """A level in numbers: box and similarity of what it opens, and what its values mean to the backend.

    `knob` maps an axis to a parameter; `power` says of those parameters that are shares of the `modulus` how they
    scale with it; `held` are further shares, `fixed` plain values.
    """

    box: Box
    group: Group
    knob: Mapping[str, str]
    power: Mapping[str, int]
    held: Mapping[str, float]
    fixed: Mapping[str, float]
    modulus: str | None

    def physical(self, values: Mapping[str, float]) -> dict[str, float]:
        """What the backend is given for values of the axes."""
        m = 1.0 if self.modulus is None else float({**self.fixed, **values}[self.modulus])
        shares = {self.knob[a]: float(v) for a, v in values.items()} | dict(self.held)
        return dict(self.fixed) | {k: v * m ** self.power.get(k, 0) for k, v in shares.items()}

    def slopes(self, values: Mapping[str, float], by_knob: Mapping[str, Any]) -> dict[str, Any]:
        """∂/∂axis from ∂/∂parameter, for the axes where they are known: shares follow the modulus."""
        real = self.physical(values)
        m = real[self.modulus] if self.modulus is not None else 1.0
        out = {}
        for axis, knob in self.knob.items():
            followers = [k for k, e in self.power.items() if e] if axis == self.modulus else []
            if knob in by_knob and all(k in by_knob for k in followers):
                own = by_knob[knob] * m ** self.power.get(knob, 0)
                out[axis] = own + sum(self.power[k] * real[k] / m * by_knob[k] for k in followers)
        return out


def axes_of(plan: Plan, level: ModelLevel, ranges: Mapping[str, tuple[float, float]]) -> Axes:
    """The study's open parameters (in `ranges` instead of their own where given) and those of the level."""
    known = {p.name: p for p in plan.backend.parameters}
    base = [a for a in plan.resolved.axes if a.name not in level.hold and a.name not in level.open]
    fixed = {k: v for k, v in plan.resolved.fixed.items() if k not in level.open}
    held = {k: v for k, v in level.hold.items() if k not in fixed}
    modulus = _modulus(plan, [a.name for a in base], fixed)
    rows: list[tuple[str, str, Parameter, float, float, bool]] = []
    for a in base:
        low, high = ranges.get(a.name, (a.low, a.high))
        rows.append((a.name, a.name, dataclasses.replace(a.parameter, low=low, high=high), low, high, a.scale == "log"))
    power = {k: stress_exponent(known[k].unit) for k in held if k in level.relative}
    for k, (low, high) in level.open.items():
        p, name = known[k], k
        e = stress_exponent(p.unit) if k in level.relative and modulus is not None else 0
        if e:
            name, power[k] = f"{k}{'/' if e > 0 else '·'}{modulus}", e
        p = dataclasses.replace(p, name=name, unit=_shared(p.unit, e), low=low, high=high)
        rows.append((name, k, p, low, high, low > 0 and high > LOG_SCALE_RATIO * low))
    box = Box(*map(tuple, zip(*((n, p.unit, low, high, log) for n, _, p, low, high, log in rows), strict=True)))
    open_or_held = {*(k for _, k, *_ in rows), *(k for k in held if k in level.relative)}
    others = [p for p in plan.backend.parameters if p.name not in open_or_held]
    values = {**fixed, **held}
    constants = {p.name: p.unit for p in others if values.get(p.name, p.default) not in (0.0, p.neutral)}
    found = group([p for _, _, p, *_ in rows], plan.backend.channels, constants=constants)
    if plan.creeps.followed:
        found = dataclasses.replace(found, reference=None, why=STRESS_SCALE_REASON)
    if not plan.study.doe.reduce:
        found = dataclasses.replace(found, reference=None, why="switched off: doe.reduce = false")
    return Axes(box, found, {n: k for n, k, *_ in rows}, power, held, fixed, modulus)


def _shared(unit: str, e: int) -> str:
    """Unit of a share of the modulus: nothing for a stress, 1/mm for a force per volume, written as it is made."""
    if e == 0:
        return unit
    return "" if unit in ("MPa", "1/MPa") else f"{unit}{'/' if e > 0 else '*'}MPa"


def _modulus(plan: Plan, opened: Sequence[str], fixed: Mapping[str, float]) -> str | None:
    """The first parameter with the unit of a stress and a positive value: what shares are of."""
    for p in plan.backend.parameters:
        if stress_exponent(p.unit) == 1 and p.low > 0 and (p.name in opened or fixed.get(p.name, 0.0) > 0):
            return p.name
    return None


def levels_of(plan: Plan) -> tuple[tuple[ModelLevel, ...], ...]:
    """The rungs that `[ladder]` asks for, by default all that the backend offers; StudyError for unknown names."""
    study, backend = plan.study, plan.backend
    each = [study.settings_of(name) for name in plan.case_of] or [study.backend.settings]
    offered = _relaxing(plan, _offered(backend, each))
    if not study.ladder.levels:
        return offered or _relaxing(plan, ((ModelLevel(STUDY_LEVEL, "the model of the study file"),),))
    problems: list[Problem] = []
    rungs = []
    for n, rung in enumerate(study.ladder.levels):
        place: Place = ("ladder", "levels", n)
        found = [_named(v, plan, offered, place, problems) for v in rung]
        rungs.append(tuple(v for v in found if v is not None))
    names = [v.name for rung in rungs for v in rung]
    twice = sorted({v for v in names if names.count(v) > 1})
    problems += [Problem(("ladder", "levels"), "each level once, and this one is there twice", v) for v in twice]
    if problems:
        raise study_error(study.file, study.lines, problems)
    return tuple(rungs)


def _relaxing(plan: Plan, rungs: tuple[tuple[ModelLevel, ...], ...]) -> tuple[tuple[ModelLevel, ...], ...]:
    """The rungs, each followed by the same levels with a first relaxation where forces fall in a hold, or the depth
    grows at a held force, and the study's own model does not relax; a closed form has none."""
    fitted = [n for n in plan.case_of if n not in plan.creeps.followed]
    resting: dict[str, Hold | CreepHold] = {}
    for n in fitted:
        hold, creep = plan.found.get(n), plan.creeps.found.get(n)
        if isinstance(hold, Hold) and hold.fall:
            resting[n] = hold
        elif isinstance(creep, CreepHold) and creep.grows:
            resting[n] = creep
    pair = relaxation_knobs(plan.backend)
    if not resting or pair is None:
        return rungs
    values = middle(plan.resolved)
    if any(relaxes(plan.backend, values, plan.cases[plan.case_of[n]]) for n in resting):
        return rungs
    opened = hold_ranges(pair, max(resting.values(), key=lambda h: h.lasts))

    def with_it(level: ModelLevel) -> ModelLevel:
        return dataclasses.replace(
            level,
            name=f"{level.name}+{pair[0].group}",
            title=f"{level.label}, relaxing",
            description="; ".join(filter(None, [level.description, pair[0].description])),
            open={**level.open, **opened},
            extends=f"{level.extends}+{pair[0].group}" if level.extends else level.name,
        )

    found = [(rung, tuple(with_it(v) for v in rung if not v.closed_form)) for rung in rungs]
    return tuple(r for both in found for r in both if r)


def cases_of_levels(
    plan: Plan, rungs: Sequence[Sequence[ModelLevel]]
) -> list[tuple[dict[str, float], Mapping[str, Any]]]:
    """Values inside of what each level opens, and its settings: what one level follows is compared for all."""
    middles = [{k: 0.5 * (low + high) for k, (low, high) in v.open.items()} for rung in rungs for v in rung]
    return list(zip(middles, (v.settings for rung in rungs for v in rung), strict=True))


def _offered(backend: Backend, settings: Sequence[Mapping[str, Any]]) -> tuple[tuple[ModelLevel, ...], ...]:
    """The rungs that a backend has for the settings of every experiment; a level has the titles of all of them."""
    models = capability(backend, ModelHierarchy)
    if models is None:
        return ()
    each = [[[_plain(v) for v in rung] for rung in models.levels(one)] for one in settings]
    titles = [{v.name: v.title for rung in rungs for v in rung} for rungs in each]
    shared = [
        tuple(
            dataclasses.replace(v, title=" and ".join(dict.fromkeys(t[v.name] for t in titles)))
            for v in rung
            if all(v.name in t for t in titles)
        )
        for rung in each[0]
    ]
    return tuple(rung for rung in shared if rung)


def _plain(data: Mapping[str, Any]) -> ModelLevel:
    """A level that a backend offers: its moduli are shares."""
    opened = {k: (float(a), float(b)) for k, (a, b) in data.get("open", {}).items()}
    held = {k: float(v) for k, v in data.get("hold", {}).items()}
    rest = {k: data[k] for k in ("title", "description", "settings", "closed_form", "extends") if k in data}
    return ModelLevel(data["name"], open=opened, hold=held, relative=frozenset({*opened, *held}), **rest)


def _named(
    table: LevelTable, plan: Plan, offered: tuple[tuple[ModelLevel, ...], ...], place: Place, problems: list[Problem]
) -> ModelLevel | None:
    """A level by name (offered, a variant of the settings, a parameter or group of parameters) or by its own table."""
    backend = plan.backend
    known = {p.name: p for p in backend.parameters}
    if table.settings or table.open or table.alone:
        return _own(table, known, place, problems)
    wanted = table.name
    settings = plan.study.backend.settings
    others = capability(backend, Variants)
    variants = others.variants(settings) if others else {}
    members = [p for p in backend.parameters if p.name == wanted]
    group_of = wanted if wanted not in variants else str(variants[wanted].get("group", ""))
    members = members or [p for p in backend.parameters if group_of and p.group == group_of]
    opened = {p.name: p.plausible for p in members if p.plausible is not None}
    for v in (v for rung in offered for v in rung):
        if v.name == wanted:
            return v
    if wanted == STUDY_LEVEL:
        return ModelLevel(STUDY_LEVEL, "the model of the study file")
    if wanted in variants:
        text = str(variants[wanted].get("description", ""))
        return ModelLevel(wanted, text, variants[wanted]["settings"], opened, relative=frozenset(opened), adds=True)
    if opened:
        text = "; ".join(p.description for p in members if p.name in opened)
        return ModelLevel(wanted, text, {}, opened, relative=frozenset(opened), adds=True)
    if members:
        text = f'no range is known for it; give a table: {{ name = "{wanted}", open = {{ {wanted} = [low, high] }} }}'
        problems.append(Problem(place, text, wanted))
        return None
    choices = [STUDY_LEVEL, *(v.name for rung in offered for v in rung), *variants]
    choices += [p.name for p in backend.parameters if p.plausible] + sorted({p.group for p in known.values()} - {""})
    problems.append(Problem(place, f"no such level; {choices_text(wanted, dict.fromkeys(choices))}", wanted))
    return None


def _own(table: LevelTable, known: Mapping[str, Parameter], place: Place, problems: list[Problem]) -> ModelLevel | None:
    """A level of the study file: its ranges are in the units of the parameters."""
    opened: dict[str, tuple[float, float]] = {}
    for name, ends in table.open.items():
        if name not in known:
            problems.append(Problem(place, f"the backend has no such parameter; {choices_text(name, known)}", name))
            continue
        try:
            low, high = (known[name].check(value_in_unit(v, known[name].unit)) for v in ends)
        except ValueError as error:
            problems.append(Problem(place, str(error), name))
            continue
        if low >= high:
            problems.append(Problem(place, f"low = {low:g} must be below high = {high:g} {known[name].unit}", name))
        opened[name] = (low, high)
    return ModelLevel(table.name, table.description, table.settings, opened, adds=not table.alone)
