"""Creep in the records of a study: an experiment of its own beside the loading, where the model can follow it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from rso.contract import Backend, Case, Programme, Segment, beyond_control
from rso.core.curves import CREEP_CHANNEL
from rso.data import CreepHold, MeasuredCurve, creep_curve, creep_of
from rso.study.cases import speed_of
from rso.study.holds import MAX_RELAXATION_TIME_RATIO, MIN_RELAXATION_TIME_RATIO, hold_ranges, relaxation_knobs, relaxes
from rso.study.schema import Study

CREEP_SUFFIX = " creep"  # behind the name of an experiment: that of its hold at a force


@dataclasses.dataclass(frozen=True, eq=False)
class Creeps:
    """Holds at a force of the records of a study.

    `found` has those of every experiment, or why one is of no use, `followed` those that the model follows, by the name
    of the experiment that the hold makes, `curves` what was measured there.
    """

    found: Mapping[str, CreepHold | str] = dataclasses.field(default_factory=dict)
    followed: Mapping[str, CreepHold] = dataclasses.field(default_factory=dict)
    curves: Mapping[str, MeasuredCurve] = dataclasses.field(default_factory=dict)


def loading_experiment(name: str) -> str:
    """The experiment whose loading comes before a hold at a force, or the name itself of another."""
    return name.removesuffix(CREEP_SUFFIX)


def creep_case(study: Study, name: str, hold: CreepHold) -> Case:
    """The way to a held force and the moments of the hold, as the instrument went there."""
    settings = {k: v for k, v in study.settings_of(loading_experiment(name)).items() if k != "unload"}
    there = Segment(hold.control, rate=hold.rate, to_N=hold.force)
    rest = Segment("force", hold_s=hold.moments[-1], asked_s=hold.moments)
    return Case(name, Programme(segments=(there, rest), asked_N=(hold.force,)), settings)


def with_creep(
    study: Study,
    backend: Backend,
    values: Mapping[str, float],
    beside: Sequence[tuple[Mapping[str, float], Mapping[str, Any]]],
) -> tuple[Study, Creeps]:
    """The study with an experiment for each hold at a force that one of its models follows, and all that were found."""
    found = {
        e.name: hold
        for e in study.experiments
        if e.kind == "force"
        and e.branch != "unloading"
        and (hold := creep_of(study.measurement(e.name), speed_of(study, e.name)[0]))
    }
    tables, followed, curves, measurements = [], {}, {}, {}
    for name, hold in found.items():
        if isinstance(hold, str) or not _followed(study, backend, values, beside, name, hold):
            continue
        own = name + CREEP_SUFFIX
        followed[own] = hold
        curves[own] = creep_curve(study.measurement(name), study.noise_of(name), hold)
        tables.append(study.experiment(name).model_copy(update={"name": own, "channels": (CREEP_CHANNEL,)}))
        measurements[own] = dataclasses.replace(study.measurement(name), doubts=(), notes=())
    if tables:
        study = study.beside(tables, measurements)
    return study, Creeps(found, followed, curves)


def _followed(
    study: Study,
    backend: Backend,
    values: Mapping[str, float],
    beside: Sequence[tuple[Mapping[str, float], Mapping[str, Any]]],
    name: str,
    hold: CreepHold,
) -> bool:
    case = creep_case(study, name, hold)
    if CREEP_CHANNEL not in backend.channels or beyond_control(backend, case) is not None:
        return False
    replaced = [dataclasses.replace(case, settings={**case.settings, **s}) for _, s in beside]
    models = [(values, case), *(({**values, **v}, c) for (v, _), c in zip(beside, replaced, strict=True))]
    return any(relaxes(backend, v, c) for v, c in models)


def said_of(
    study: Study, backend: Backend, creeps: Creeps, name: str, taus: Mapping[str, tuple[float, float]]
) -> list[str]:
    """What there is to say of the hold at a force of an experiment; nothing where there is none.

    `taus` are the ranges (s) of the times that are open.
    """
    hold = creeps.found.get(name, "")
    if isinstance(hold, str):
        return [f"Its hold at a force is not used: {hold}."] if hold else []
    grows = (
        f"the indenter creeps by {hold.grows:.3g} mm" if hold.grows else "the depth does not grow by more than noise"
    )
    span = f"{hold.force:.3g} N for {hold.lasts:.3g} s, where {grows}"
    if name + CREEP_SUFFIX in creeps.followed:
        used = f"It is held at {span}: {len(hold.since)} moments of it are compared, depth over time."
        return [used, *_too_short(hold, taus)]
    refused = beyond_control(backend, creep_case(study, name, hold))
    if refused is not None:
        return [f"It is held at {span}. Only the loading is fitted: {refused}."]
    pair = relaxation_knobs(backend)
    said = [f"It is held at {span}. Only the loading is fitted, by a model that does not creep."]
    if pair is None or not hold.grows:
        return said
    opened = hold_ranges(pair, hold)
    lines = [
        f"  {p.name} = {{ low = {opened[p.name][0]:g}, high = {opened[p.name][1]:g}{log} }}"
        for p, log in zip(pair, ("", ', scale = "log"'), strict=True)
    ]
    return [*said, "To fit the creep too, add below [parameters]:", *lines]


def _too_short(hold: CreepHold, taus: Mapping[str, tuple[float, float]]) -> list[str]:
    """What a hold cannot show of the times that are open: beyond its end, and before its first moment."""
    said = []
    longest, shortest = MAX_RELAXATION_TIME_RATIO * hold.lasts, MIN_RELAXATION_TIME_RATIO * float(hold.since[0])
    for name, (low, high) in taus.items():
        if high > longest:
            said.append(
                f"A hold of {hold.lasts:.3g} s cannot determine {name} beyond about {longest:.2g} s, and "
                f"its range goes to {high:.3g} s. Creep is a straight line there, which fixes only share/{name}."
            )
        if low < shortest:
            said.append(
                f"Its first moment, {hold.since[0]:.3g} s, cannot determine {name} below about "
                f"{shortest:.2g} s: faster creep is over by then and looks like a softer body."
            )
    return said
