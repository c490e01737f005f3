"""An indentation test whose programme is controlled by force as well as by travel."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import indentation, rezoning
from fem_backend.simulation.assembly import AssembledModel, NotModelled, Placement
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.indentation import FINAL_CAUSES, Result
from fem_backend.simulation.initial_state import InitialState, initial_state
from fem_backend.simulation.knobs import Knobs
from fem_backend.simulation.rezoning import MeshLeg
from fem_backend.solver import controlled_steps
from fem_backend.solver.controlled_steps import UNREACHED_FORCE_CAUSE, Bench, Drive, Followed
from fem_backend.solver.load_steps import Instant, Stopped
from fem_backend.solver.newton import Counters

COARSER_MERIDIAN_RATIO = 2.0  # times the size of the elements of a meridian, for its error


def simulate_programme(
    settings: Settings, knobs: Knobs, placement: Placement, model: AssembledModel, drive: Drive
) -> tuple[Result, list[Instant]]:
    """Curves at what a programme asks for, and every instant of its way with the travel found there.

    As :func:`fem_backend.simulation.indentation.simulate_indentation` tried twice; raises Stopped with the result so
    far, NotModelled.
    """
    if knobs.permeability:
        raise NotModelled(
            "not_supported", "pore flow follows travel over time alone: time_s and travel_mm, no segments and forces"
        )
    started = time.process_time()
    try:
        return _attempt(settings, knobs, placement, model, drive, started)
    except Stopped as stopped:
        if stopped.cause in (*FINAL_CAUSES, UNREACHED_FORCE_CAUSE):
            raise
        first = stopped
    patient = indentation.again(settings, first.reached)
    try:
        return _attempt(patient, knobs, placement, model, drive, started)
    except Stopped as stopped:
        raise (stopped if len(stopped.points) > len(first.points) else first) from None


def _attempt(
    settings: Settings, knobs: Knobs, placement: Placement, model: AssembledModel, drive: Drive, started: float
) -> tuple[Result, list[Instant]]:
    counters = Counters(deadline=started + settings.control.time_limit_s)
    at = initial_state(settings, knobs, placement, model, counters)
    legs = [MeshLeg(at, None)]
    try:
        u, history, touching = indentation.begun(at, counters)
        followed = controlled_steps.follow_drive(_bench(at, counters, legs), drive, u, history, touching)
    except Stopped as stopped:
        reached = stopped.reached if isinstance(stopped.reached, Followed) else Followed([], [], [], [], [])
        stopped.reached = _collected(at, reached, counters, time.process_time() - started, legs)
        raise
    return _collected(at, followed, counters, time.process_time() - started, legs), followed.way


def _bench(at: InitialState, counters: Counters, legs: list[MeshLeg]) -> Bench:
    share, prony = float(modelling.multiplicity(at.placement)), at.system.material.prony

    def along(force: np.ndarray) -> float:
        return -share * float(force @ at.placement.direction)

    tau = np.inf if prony is None else min(prony.tau)
    renew = rezoning.renewals(legs, counters)
    return Bench(at.system, at.start, at.settings.control, counters, along, share, tau, renew)


def _collected(at: InitialState, followed: Followed, counters: Counters, cpu_s: float, legs: list[MeshLeg]) -> Result:
    result = indentation.collect(at, followed.points, counters, cpu_s, None, legs)
    return replace(
        result, given=np.array(followed.given, bool), slopes=np.array(followed.slopes), left=np.array(followed.left)
    )


def checked_programme(
    settings: Settings, knobs: Knobs, placement: Placement, model: AssembledModel, drive: Drive
) -> Result:
    """Result of a programme; of a meridian beside the channels of coarser elements at the travels that were found.

    Raises Stopped and NotModelled.
    """
    result, way = simulate_programme(settings, knobs, placement, model, drive)
    if not placement.meridian:
        return result
    crude = replace(
        settings, fineness=COARSER_MERIDIAN_RATIO * settings.fineness, h0=COARSER_MERIDIAN_RATIO * settings.h0
    )
    try:
        other = modelling.model_for(crude, knobs, placement, None)
        first = indentation.simulate_indentation(crude, knobs, placement, other, way)
    except (NotModelled, Stopped):
        return result
    return replace(result, coarser=first.channels, cpu_s=result.cpu_s + first.cpu_s)


def errors_of_travel(error: dict[str, np.ndarray], result: Result) -> dict[str, np.ndarray]:
    """Errors (k,) of channels where the force was given: that of the force is one of the travel,

        δs = δF / (dF/ds),   δc ← δc + |c| δs/s,

    and of the force is left the share to which it was met.  What is given is the force along the way, Fz of a
    vertical one.  Of a channel c its growth with the travel is taken for that of a straight line, which contact radius
    (s^½) and area (s) of a smooth indenter do not exceed.
    """
    if result.given is None or not result.given.any():
        return error
    here, s = result.given, np.maximum(np.abs(result.travel), 1e-300)
    assert result.slopes is not None and result.left is not None
    off = np.where(here, error["Fz"] / np.maximum(result.slopes, 1e-300), 0.0)
    out = {n: v + np.abs(result.channels[n]) * off / s for n, v in error.items() if n not in ("time", "travel", "Fz")}
    held = np.where(here, result.left * np.abs(result.channels["Fz"]), error["Fz"])
    return {**error, **out, "travel": off, "Fz": held}
