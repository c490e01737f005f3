"""From a hypothesis and its parameters to the data vector: forces at recorded depths through the measurement chain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rso.diagnosis.effects import Effect
from rso.diagnosis.library import FORCES, Library, passes_of
from rso.diagnosis.testplan import Profile, Test
from rso.measurement import Chain, record


def predict(
    library: Library, effects: Sequence[Effect], X: np.ndarray, modulus: float
) -> tuple[np.ndarray, np.ndarray]:
    """Forces over the modulus (T, n) and displacements (T, n) of the data vector at coordinates X (T, d).

    X holds the base axes, then size and shapes of each effect (signed deviations, see :class:`Size`).  `modulus` MPa
    sets the force against which absolute sizes of the chain (a compliance, a bias) count.
    """
    plan, d = library.plan, len(library.base.axes)
    x, rest = X[:, :d], X[:, d:]
    parts, at = [], 0
    for e in effects:
        parts.append((e, rest[:, at : at + len(e.knobs)]))
        at += len(e.knobs)
    chain = [(e, p[:, 0]) for e, p in parts if e.family == "measurement"]
    force, moved = np.zeros((len(X), plan.n)), np.zeros((len(X), plan.n))
    ready: dict[tuple[int, float], np.ndarray] = {}
    for item, channel, rows in plan.rows():
        if isinstance(item, Profile):
            moved[:, rows] = _profile(library, item, x, parts)
            continue
        if channel != item.channels[0]:
            continue  # all channels of a test come at once
        key = (item.place, item.speed)
        if key not in ready:
            ready = {key: _curves(library, item.place, item.speed, x, parts)}
        force[:, rows.start : rows.start + item.n * len(item.channels)] = _recorded(
            library, item, ready[key], chain, modulus
        )
    return force, moved


def _curves(library: Library, place: int, speed: float, x: np.ndarray, parts: Sequence[tuple[Effect, np.ndarray]]):
    """Forces over the modulus (T, n_pass, 3, m)."""
    f, here = library.forces(place, x), library.places[place]
    change = np.zeros((len(x), len(here.passes), 3, len(here.u))) + here.finer
    for e, at in parts:
        if e.family == "model":
            change = change + library.change(place, e, at, speed)[0]
    return f[:, None] + f[:, None, 2:3] * change


def _recorded(library: Library, test: Test, F: np.ndarray, chain: Sequence[tuple[Effect, np.ndarray]], modulus: float):
    """Rows of a test (T, channels · n) as recorded, over the modulus."""
    u = library.places[test.place].u
    loading, unloading = passes_of(library, test)
    pick = [FORCES.index(c) for c in test.channels]
    back = test.branch == 1
    if not chain:
        s, w = np.sqrt(u), np.sqrt(np.clip(test.depth, 0.0, u[-1]))
        i = np.clip(np.searchsorted(s, w) - 1, 0, len(s) - 2)
        share = (w - s[i]) / (s[i + 1] - s[i])
        G = np.where(back, F[:, unloading][..., i], F[:, loading][..., i])
        H = np.where(back, F[:, unloading][..., i + 1], F[:, loading][..., i + 1])
        out = (1 - share) * G + share * H
        return out[:, pick].reshape(len(F), -1)
    # the indenter's way in time: from before contact to beyond the peak where nothing comes back, else there and back
    top = min(test.peak, u[-1]) if back.any() else u[-1]
    way = np.concatenate([[-1.0], u[u < top], [top]])
    there = np.stack([[np.interp(way[1:], u, F[t, loading, c]) for c in range(3)] for t in range(len(F))])
    there = np.concatenate([np.zeros((len(F), 3, 1)), there], axis=2)
    turn = len(way)
    if back.any():
        returning = way[-2::-1]
        home = np.stack([[np.interp(returning, u, F[t, unloading, c]) for c in range(3)] for t in range(len(F))])
        home[:, :, returning <= 0] = 0.0
        way, there = np.concatenate([way, returning]), np.concatenate([there, home], axis=2)
    time = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way)))])
    time = (time - time[1]) / test.speed + (test.time[0] - max(test.depth[0], 0.0) / test.speed)
    out = np.empty((len(F), len(pick), test.n))
    for t in range(len(F)):
        setting = Chain(**{e.name: float(e.size.value(s[t])) for e, s in chain})
        got = record(setting, way, dict(zip(FORCES, there[t] * modulus, strict=True)), time)
        forces = [got.forces[FORCES[c]] for c in pick]
        for j, F_rec in enumerate(forces):
            out[t, j] = np.interp(test.depth, _rising(got.depth[:turn]), F_rec[:turn])
            if back.any():
                d = _rising(got.depth[: turn - 2 : -1])
                out[t, j, back] = np.interp(test.depth[back], d, F_rec[: turn - 2 : -1])
    return (out / modulus).reshape(len(F), -1)


def _rising(depth: np.ndarray) -> np.ndarray:
    return np.maximum.accumulate(depth)


def _profile(library: Library, profile: Profile, x: np.ndarray, parts: Sequence[tuple[Effect, np.ndarray]]):
    """Displacements (T, n) of a profile's readings."""
    place = library.plan.places[profile.place]
    speed = min(t.speed for t in library.plan.tests)
    marks = library.marks(profile.place, x)
    for e, at in parts:
        if e.family == "model":
            marks = marks + library.change(profile.place, e, at, speed)[1]
    depths = np.array(place.mark_depths)
    row = np.searchsorted(depths, profile.depth - 1e-9)
    return marks[:, row * len(place.marks) + profile.mark]
