"""The experiments of `rso next`: those done, with their readings, and those that might be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rso.calibration.plan import Plan
from rso.calibration.readings import curve_data, force_curves, places_from_contact
from rso.contract import Case, Programme
from rso.contract.responses import FORCE_CHANNELS
from rso.core.units import value_in_unit
from rso.data import StatedNoise
from rso.inference import CurvePlace, Data
from rso.study.analysis_tables import NextExperiment
from rso.study.cases import (
    DEFAULT_SPEED_MM_S,
    N_CURVE_TRAVELS,
    case_for,
    mark_channel,
    profile_case,
    profile_depths,
    travels,
)
from rso.study.creep import creep_case
from rso.study.errors import Problem, choices_text, study_error


@dataclass(frozen=True, eq=False)
class Block:
    """Readings that share errors: one channel of a force curve, or a whole profile; `data` is None if not measured."""

    places: tuple[CurvePlace, ...]
    unit: str
    noise: StatedNoise
    data: Data | None = None

    @property
    def depth(self) -> np.ndarray:
        """Depth (n,) of every reading."""
        return np.concatenate([p.depth for p in self.places])


@dataclass(frozen=True, eq=False)
class Item:
    """An experiment: what is simulated for it, what is read, and whether it has been done."""

    name: str
    words: str
    case: Case
    blocks: tuple[Block, ...]
    done: bool


def done(plan: Plan) -> list[Item]:
    """Experiments with role "fit": force curves, and profiles (which `rso run` does not fit)."""
    items = []
    for e in plan.study.experiments:
        if e.role != "fit":
            continue
        noise = plan.study.noise_of(e.name).of_test(float(plan.curves[e.name].depth.max()))
        if e.kind == "force":
            hold, creep = plan.holds.get(e.name), plan.creeps.followed.get(e.name)
            if creep is not None:
                case = creep_case(plan.study, e.name, creep)
            else:
                case = case_for(plan.study, e.name, travels(plan.curves[e.name], set(), hold), hold)
            pairs = [(n, c) for n, c in force_curves(plan, "fit") if n == e.name]
            data = [curve_data(plan, places_from_contact(plan, *pair)) for pair in pairs]
            blocks = [
                Block((places_from_contact(plan, *p),), d.unit, noise, d) for p, d in zip(pairs, data, strict=True)
            ]
        else:
            case, blocks = profile_case(plan.study, e.name, plan.curves[e.name]), [_measured_profile(plan, e.name)]
        items.append(Item(e.name, "", case, tuple(blocks), True))
    return items


def _measured_profile(plan: Plan, name: str) -> Block:
    """A measured profile, its readings in the order of the marks; depths as they were asked for."""
    curve, noise = plan.curves[name], plan.study.noise_of(name).stated
    assert curve.position is not None
    asked = np.array(profile_depths(curve))
    keep = np.flatnonzero(curve.depth > 0)
    names = np.array([mark_channel(p) for p in curve.position])[keep]
    order, places = [], []
    for channel in dict.fromkeys(names):
        mine = keep[names == channel]
        near = asked[np.argmin(np.abs(asked[:, None] - curve.depth[mine]), axis=0)]
        close = np.abs(near - curve.depth[mine]) <= 1e-3 * asked[-1]
        places.append(CurvePlace(name, channel, np.where(close, near, curve.depth[mine])))
        order += list(mine)
    depth = np.concatenate([p.depth for p in places])
    C = curve.covariance[np.ix_(order, order)]
    data = Data(name, curve.unit, depth, curve.value[order], C, curve.freedom)
    return Block(tuple(places), curve.unit, noise, data)


def planned_experiment(plan: Plan, e: NextExperiment) -> Item:
    """An experiment of `[[next.experiments]]`."""
    settings = {k: v for k, v in {**plan.study.backend.settings, **e.settings}.items() if k != "unload"}
    noise = e.noise.noise().stated if e.marks else e.noise.noise().of_test(e.depth)
    if e.marks:
        depths = tuple(sorted(e.depths))
        settings["profile"] = [list(map(float, m)) for m in e.marks]
        places = tuple(CurvePlace(e.name, mark_channel(m), np.array(depths)) for m in e.marks)
        return Item(e.name, e.words, _case(e.name, depths, settings), (Block(places, "mm", noise),), False)
    readings = np.round(np.arange(1, round(e.depth / e.step) + 1) * e.depth / round(e.depth / e.step), 9)
    asked = (*(round(e.depth * k / N_CURVE_TRAVELS, 6) for k in range(1, N_CURVE_TRAVELS)), e.depth)
    blocks = tuple(Block((CurvePlace(e.name, c, readings),), "N", noise) for c in e.channels)
    return Item(e.name, e.words, _case(e.name, asked, settings), blocks, False)


def _case(name: str, asked: tuple[float, ...], settings: Mapping[str, object]) -> Case:
    try:
        speed = value_in_unit(settings["speed"], "mm/s")  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError):
        speed = DEFAULT_SPEED_MM_S
    if speed <= 0:
        raise ValueError(f"settings.speed = {settings['speed']!r}: must be positive")
    return Case(name, Programme.ramp(asked, speed), dict(settings))


def refuse(plan: Plan, items: Sequence[Item], others: Sequence[Problem] = ()) -> None:
    """StudyError for `others` and for what of the experiments that might be done cannot be had, each with its place."""
    mine = {e.name: n for n, e in enumerate(plan.study.next.experiments)}
    problems = list(others)
    for item in items:
        if not item.done:
            problems += _refused(plan, item, ("next", "experiments", mine[item.name]))
    if problems:
        raise study_error(plan.study.file, plan.study.lines, problems)


def _refused(plan: Plan, item: Item, place: tuple[str | int, ...]) -> Iterator[Problem]:
    """A name that is taken, what the backend does not model, channels that are no forces, readings without errors."""
    backend, said = plan.backend, plan.study.next.experiments[int(place[-1])].noise.noise().stated
    if item.name in {e.name for e in plan.study.experiments}:
        yield Problem((*place, "name"), "this name is taken by an experiment", item.name)
    try:
        backend.check(item.case)
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        yield Problem((*place, "settings"), str(error))
    forces = [c for c in backend.channels if c in FORCE_CHANNELS]
    for b in item.blocks:
        if block_channel(b) not in ("uz", *forces):
            text = (
                f"the backend {backend.name!r} has no such channel of a force; {choices_text(block_channel(b), forces)}"
            )
            yield Problem((*place, "channels"), text, block_channel(b))
        elif not said.of(block_channel(b)) and not said.gain and not said.calibration:
            text = f"without errors of the readings of {block_channel(b)} everything would be known: "
            yield Problem((*place, "noise"), f"{text}noise.{block_channel(b)} or noise.gain must be positive")


def block_channel(block: Block) -> str:
    """Channel of a force curve, or uz of a profile."""
    return "uz" if block.unit == "mm" else block.places[0].channel
