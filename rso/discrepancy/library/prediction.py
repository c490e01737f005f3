"""From a hypothesis and its parameters to the data vector: forces at recorded depths through the measurement chain.

Without the chain a prediction is bilinear in the library's tables, so that these are read off once at every recorded
depth; the chain moves depths and is applied to whole curves.

While the indenter rests, t after it came, only what relaxes goes on, δ the relative change at the end of loading:

    δ(t) = δ_∞ + (δ(0) − δ_∞) exp(−t/τ),    δ_∞ = δ(0) for τ → 0 (:meth:`Library.relaxed`).

What flows has tables of its rests (`LibraryTable.rests`), whose times depend on the size of what is pressed.

Exact for one exponential of relaxation where the strain rests too, which contact makes nearly true: each stress decays
as its hereditary integral does (Simo & Hughes 1998, §10.3).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import interp1d

from rso.contract import parameters_of
from rso.contract.responses import FORCE_CHANNELS
from rso.core.curves import rows_at
from rso.data import Chain, recorded_curve, yielded
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.interpolation import timed
from rso.discrepancy.library.simulations import passes_of, rest_of
from rso.discrepancy.library.tables import Library, PlaceTables
from rso.discrepancy.library.test_plan import LOADING_BRANCH, UNLOADING_BRANCH, SurfaceProfile, Test

CHAIN_APPROACH_MM = 1.0  # mm before contact from which the chain is followed, in a plan of the usual depth
STIFFNESS_TRAVEL_SHARE = 0.02  # of the travel, over which the stiffness of the contact is read
N_HOLD_INSTANTS = 40  # instants of a hold through which the chain is followed, dense at its start

Parts = Sequence[tuple[Effect, np.ndarray]]
Chained = Parts  # effects of the chain
Relaxing = tuple[np.ndarray, np.ndarray]  # weights (T, n) where all has relaxed, rate 1/τ (T,) in 1/s
Weighted = tuple[Effect, np.ndarray, Relaxing | None]
Curves = Callable[[int, float, int], np.ndarray]  # place, speed, way → forces over the modulus (T, 3, m)
Decays = Callable[[int, float, int], list[tuple[np.ndarray, np.ndarray]]]  # → rates (T,), what is lost of them at rest


def predict(
    library: Library, effects: Sequence[Effect], X: np.ndarray, modulus: float
) -> tuple[np.ndarray, np.ndarray]:
    """Forces over the modulus (T, n) and displacements (T, n) of the data vector at coordinates X (T, d).

    X holds the base axes, then size and shapes of each effect (signed deviations, see :class:`Size`).  `modulus` MPa
    sets the force against which absolute sizes of the chain (a compliance, a bias) count.
    """
    effects = [e for e in effects if e.family != "scatter"]  # these move no mean
    plan, d = library.plan, len(library.base.axes)
    x, parts, at = X[:, :d], [], d
    for e in effects:
        parts.append((e, X[:, at : at + len(e.knobs)]))
        at += len(e.knobs)
    chain = [(e, p) for e, p in parts if e.family == "measurement"]
    model = [(e, p) for e, p in parts if e.family == "model"]
    relaxing = library.base.relaxing
    if relaxing is not None:  # it comes first: all others change what it leaves
        model.insert(0, (relaxing.effect, library.base.relaxation(x)))
    W = library.base_weights(x)
    weights: dict[tuple[int, float], list[Weighted]] = {}  # of every model effect at every place and rate
    for place, speed in {(t.place, t.speed) for t in plan.tests}:
        weights[place, speed] = [
            (e, library.weights(place, e, p, speed), _relaxing(library, place, e, p, speed)) for e, p in model
        ]
    force, moved = np.zeros((len(X), plan.n)), np.zeros((len(X), plan.n))

    @functools.cache
    def curves(place: int, speed: float, way: int) -> np.ndarray:
        here = library.places[place]
        f = np.tensordot(W, here.base, axes=1)
        own = [np.tensordot(w, here.effects[e.name].change[:, way], axes=1) for e, w, _ in weights[place, speed]]
        step = here.mesh + here.ways[way]
        if relaxing is not None:
            return f + f[:, 2:] * (own[0] + (1.0 + own[0][:, 2:]) * (step + sum(own[1:])))
        return f + f[:, 2:] * (step + sum(own))

    def decays(place: int, speed: float, way: int) -> list[tuple[np.ndarray, np.ndarray]]:
        here = library.places[place]
        Fz = np.tensordot(W, here.base[:, 2:], axes=1)
        return [
            (r[1], Fz * np.tensordot(w - r[0], here.effects[e.name].change[:, way], axes=1))
            for e, w, r in weights[place, speed]
            if r is not None
        ]

    def flowing(test: Test, since: np.ndarray) -> np.ndarray:
        """What of Fz over the modulus (T, m) is lost or gained at moments (n,) s of a rest by what flows, (T, 3, n)."""
        here = library.places[test.place]
        each = [(w, here.effects[e.name].rests) for e, w, _ in weights[test.place, test.speed]]
        lost = [np.tensordot(w, _at_moments(here, test, v, since, True), axes=1) for w, v in each if v is not None]
        return np.asarray(sum(lost, np.zeros((len(X), 3, len(since)))))

    for item, channel, rows in plan.rows():
        if isinstance(item, SurfaceProfile):
            moved[:, rows] = _profile(library, item, x, model)
        elif acting := [(e, s) for e, s in chain if e.acts(plan.places[item.place].settings)]:
            if channel == item.channels[0]:  # all channels of a test come at once
                block = slice(rows.start, rows.start + item.n * len(item.channels))
                change_of = functools.partial(flowing, item)
                force[:, block] = _recorded(library, item, curves, decays, change_of, W, acting, modulus)
        else:
            read = _readings(library, item)
            c = item.channels.index(channel)
            mine = weights[item.place, item.speed]
            each = [_change(w, r, item, read.changes[e.name][:, c]) for e, w, r in mine]
            if relaxing is None:
                change = read.step[c] + sum(each)
            else:
                e, w, r = mine[0]
                left = 1.0 + _change(w, r, item, read.normal_changes[e.name])
                change = each[0] + left * (read.step[c] + sum(each[1:]))
            force[:, rows] = W @ read.base[:, c] + (W @ read.normal) * change
    return force, moved


def _relaxing(library: Library, place: int, effect: Effect, at: np.ndarray, speed: float) -> Relaxing | None:
    """What an effect with a time of its own tends to while the indenter rests; None where it has none."""
    k = next((k for k, s in enumerate(effect.shape, 1) if timed(s)), None)
    if k is None or effect.flows:
        return None
    rate = 1.0 / np.asarray(effect.shape[k - 1].value(at[:, k]), float)
    return library.relaxed(place, effect, at, speed), rate


def _change(weights: np.ndarray, relaxing: Relaxing | None, test: Test, change: np.ndarray) -> np.ndarray:
    """Relative change (T, n) of the readings of a test, from those of the nodes (n_nodes, n)."""
    out = weights @ change
    if relaxing is not None and test.held.any():
        relaxed, rate = relaxing
        end = relaxed @ change[:, test.held]
        out[:, test.held] = end + np.exp(-np.outer(rate, test.since[test.held])) * (out[:, test.held] - end)
    return out


@dataclass(frozen=True, eq=False)
class _Readings:
    """Tables at the recorded depths of a test: base (n_base, c, n), its Fz (n_base, n), steps and changes.

    `normal_changes` (n_nodes, n) are those of Fz, whichever channels were measured.
    """

    base: np.ndarray
    normal: np.ndarray
    step: np.ndarray
    changes: dict[str, np.ndarray]
    normal_changes: dict[str, np.ndarray]


def _readings(library: Library, test: Test) -> _Readings:
    return _read(_Key(library.places, test))


@dataclass(frozen=True, eq=False)
class _Key:
    """Tables and a test, equal where they are the same objects."""

    places: tuple[PlaceTables, ...]
    test: Test

    def __hash__(self) -> int:
        return hash((id(self.places), id(self.test)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.places is other.places and self.test is other.test


@functools.lru_cache(maxsize=256)
def _read(key: _Key) -> _Readings:
    test, here = key.test, key.places[key.test.place]
    s, w = np.sqrt(here.u), np.sqrt(np.clip(test.depth, 0.0, here.u[-1]))
    i = np.clip(np.searchsorted(s, w) - 1, 0, len(s) - 2)
    share = (w - s[i]) / (s[i + 1] - s[i])

    def at(v: np.ndarray) -> np.ndarray:
        return (1 - share) * v[..., i] + share * v[..., i + 1]

    pick = [FORCE_CHANNELS.index(c) for c in test.channels]
    loading, unloading = passes_of(here.passes, test)
    back = test.branch == UNLOADING_BRANCH
    every = {
        name: np.where(back, at(t.change[:, unloading]), at(t.change[:, loading])) for name, t in here.effects.items()
    }
    for name, t in here.effects.items():
        if t.rests is not None and test.held.any():
            every[name][..., test.held] = _at_moments(here, test, t.rests, test.since[test.held])
    changes, normal = {k: v[:, pick] for k, v in every.items()}, {k: v[:, 2] for k, v in every.items()}
    base = at(here.base)
    step = at(here.mesh) + np.where(back, at(here.ways[unloading]), at(here.ways[loading]))
    return _Readings(base[:, pick], base[:, 2], step[pick], changes, normal)


def _at_moments(here: PlaceTables, test: Test, table: np.ndarray, since: np.ndarray, lost: bool = False) -> np.ndarray:
    """Changes (n_nodes, 3, n) at moments (n,) s of the rest of a test, by a table (n_nodes, n_rest, 3, N_REST_MOMENTS).

    With `lost` those since it began.
    """
    i = rest_of(here.rests, test)
    if i is None:
        return np.zeros((len(table), 3, len(since)))
    moments = here.rests[i].moments
    own = table[:, i] - (table[:, i, :, :1] if lost else 0.0)
    x = np.log1p(moments / moments[1])
    at = np.clip(np.log1p(since * test.speed / moments[1]), 0.0, x[-1])
    return np.asarray(interp1d(x, own)(at))


def _recorded(
    library: Library,
    test: Test,
    curves: Curves,
    decays: Decays,
    flowing: Callable[[np.ndarray], np.ndarray],
    W: np.ndarray,
    chain: Chained,
    modulus: float,
) -> np.ndarray:
    """Rows of a test (T, channels · n) as the chain records them, over the modulus."""
    here = library.places[test.place]
    u = here.u
    loading, unloading = passes_of(here.passes, test)
    pick = [FORCE_CHANNELS.index(c) for c in test.channels]
    back, held = test.branch == UNLOADING_BRANCH, test.held
    F = curves(test.place, test.speed, loading)
    G = curves(test.place, test.speed, unloading) if back.any() else F
    setting = {k: v[:, None] for e, at in chain for k, v in _bounded(e, at).items()}
    # the indenter's way: from before contact to where the record turns, and back
    top = rests = np.full(len(F), u[-1])
    if back.any() or held.any():
        aged = modulus * F[:, 2] * (1.0 + test.age * setting.get("ageing", 0.0))
        dent = setting.get("permanent_set", 0.0) * test.earlier
        driven = (1.0 + setting.get("depth_scale", 0.0)) * (u - setting.get("offset", 0.0))
        reads = driven + dent + yielded(setting, np.broadcast_to(u / test.speed, aged.shape), aged)
        forward = np.maximum.accumulate(reads, axis=1)
        top = rows_at(np.array([test.peak]), forward, np.broadcast_to(u, reads.shape))[:, 0]
        if held.any():  # in the midst of what its depths scatter by, of which the peak is the largest
            level = np.mean(test.depth[held], keepdims=True)
            rests = rows_at(level, forward, np.broadcast_to(u, reads.shape))[:, 0]
    way = np.minimum(u, top[:, None])
    there = _stopped(u, F, top)
    home = _stopped(u, G, top) if back.any() else there
    turn = len(u) + 1
    far = min(-CHAIN_APPROACH_MM * library.plan.scale, 1.1 * float(test.depth.min()))
    way = np.concatenate([np.full((len(F), 1), far), way], axis=1)
    there = np.concatenate([np.zeros((len(F), 3, 1)), there], axis=2)
    rest = np.geomspace(1e-3, 1.0, N_HOLD_INSTANTS) * test.since.max() if held.any() else np.zeros(0)
    if held.any():
        ends = np.repeat(_stopped(u, F, rests)[:, :, -1:], len(rest), axis=2)
        for rate, fall in decays(test.place, test.speed, loading):
            ends = ends + np.expm1(-np.outer(rate, rest))[:, None] * _stopped(u, fall, rests)[:, :, -1:]
        Fz = np.tensordot(W, here.base[:, 2:], axes=1)
        ends = ends + _stopped(u, Fz, rests)[:, :, -1:] * flowing(rest)
        if "creep" in setting:
            ends = ends - _yielding(setting, u, F, rests, modulus, test.speed, rest)
        way = np.concatenate([way, np.repeat(rests[:, None], len(rest), axis=1)], axis=1)
        there = np.concatenate([there, ends], axis=2)
    if back.any():
        way = np.concatenate([way, way[:, turn - 2 :: -1]], axis=1)
        there = np.concatenate([there, home[:, :, -2::-1], np.zeros((len(F), 3, 1))], axis=2)
    moved = np.abs(np.diff(way, axis=1, prepend=far))
    moved[:, turn + len(rest) :] /= test.pace
    time = np.cumsum(moved, axis=1)
    time = (time - time[:, 1:2]) / test.speed + _contact_time(test)
    rested = max(test.rest, float(test.since.max()))
    time[:, turn:] += np.concatenate([rest, np.full(time.shape[1] - turn - len(rest), rested)])
    forces = {c: modulus * there[:, i] for i, c in enumerate(FORCE_CHANNELS)}
    depth, got = recorded_curve(setting, way, forces, time, test.age, test.earlier)
    forward = np.maximum.accumulate(depth[:, :turn], axis=1)
    backward = np.maximum.accumulate(depth[:, : -turn - 1 : -1], axis=1) if back.any() else depth
    out = np.empty((len(F), len(pick), test.n))
    for j, c in enumerate(pick):
        v = got[FORCE_CHANNELS[c]]
        out[:, j, ~(back | held)] = rows_at(test.depth[~(back | held)], forward, v[:, :turn])
        if held.any():
            resting = np.broadcast_to(rest, (len(F), len(rest)))
            out[:, j, held] = rows_at(test.since[held], resting, v[:, turn : turn + len(rest)])
            at = rows_at(np.append(test.depth[held], level), forward, v[:, :turn])
            out[:, j, held] += at[:, :-1] - at[:, -1:]
        if back.any():
            out[:, j, back] = rows_at(test.depth[back], backward, v[:, : -turn - 1 : -1])
    return (out / modulus).reshape(len(F), -1)


def _contact_time(test: Test) -> float:
    """Time (s) at which the record passes its zero of depth."""
    there = test.branch == LOADING_BRANCH
    if not there.any():
        return float(test.time[0])
    d, t = test.depth[there], test.time[there]
    return float(np.interp(0.0, np.maximum.accumulate(d), t)) if d[0] < 0.0 < d[-1] else float(t[0] - d[0] / test.speed)


def _stopped(u: np.ndarray, F: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Forces (T, 3, m) over u, each kept from where the indenter stops; linear in √u."""
    s, w = np.sqrt(u), np.sqrt(np.clip(top, 0.0, u[-1]))
    i = np.clip(np.searchsorted(s, w) - 1, 0, len(s) - 2)
    share = ((w - s[i]) / (s[i + 1] - s[i]))[:, None]
    t = np.arange(len(F))
    ends = (1 - share) * F[t, :, i] + share * F[t, :, i + 1]
    return np.where(u < top[:, None, None], F, ends[:, :, None])


def _yielding(
    setting: Mapping[str, np.ndarray],
    u: np.ndarray,
    F: np.ndarray,
    top: np.ndarray,
    modulus: float,
    speed: float,
    rest: np.ndarray,
) -> np.ndarray:
    """Forces over the modulus (T, 3, n) that are lost `rest` (n,) s after the drive has stopped and the load train has
    not: with the stiffness K of the contact and κ = K / (1 + compliance K),

    τ dz/dt + z = creep (F − κ (z − z₀))    →    z − z₀ = (creep F − z₀) / (1 + creep κ) · (1 − exp(−(1 + creep κ) t/τ))
    """
    pressed, c, τ = _stopped(u, F, top), setting["creep"][:, 0], setting["creep_tau"][:, 0]
    at = pressed[:, :, -1]
    K = (at - _stopped(u, F, (1.0 - STIFFNESS_TRAVEL_SHARE) * top)[:, :, -1]) / (STIFFNESS_TRAVEL_SHARE * top)[:, None]
    creep = {k: setting[k] for k in ("creep", "creep_tau")}
    z0 = yielded(creep, np.minimum(u, top[:, None]) / speed, modulus * pressed[:, 2])[:, -1]
    softer = 1.0 / (1.0 + np.asarray(setting.get("compliance", np.zeros((1, 1))))[:, 0] * modulus * K[:, 2])
    rate = 1.0 + c * softer * modulus * K[:, 2]
    z = ((c * modulus * at[:, 2] - z0) / rate)[:, None] * -np.expm1(-np.outer(rate / τ, rest))
    return K[:, :, None] * (softer[:, None] * z)[:, None]


def _bounded(effect: Effect, at: np.ndarray) -> dict[str, np.ndarray]:
    """Knobs (T,) of the chain within their hard bounds, which draws of a posterior may leave; that of the size as far
    from what is plausible here as they are declared."""
    out = {}
    for j, s in enumerate(effect.knobs):
        p = next(p for p in parameters_of(Chain) if p.name == s.name)
        assert p.plausible is not None
        k = 1.0 if j else s.high / p.plausible[1]
        out[s.name] = np.clip(np.asarray(s.value(at[:, j]), float), k * p.low, k * p.high)
    return out


def _profile(library: Library, profile: SurfaceProfile, x: np.ndarray, parts: Parts) -> np.ndarray:
    """Displacements (T, n) of a profile's readings."""
    place = library.plan.places[profile.place]
    marks = library.marks(profile.place, x)
    for e, at in parts:
        W = library.weights(profile.place, e, at, library.slowest)
        marks = marks + W @ library.places[profile.place].effects[e.name].marks
    row = np.searchsorted(np.array(place.mark_depths), profile.depth - 1e-9)
    return marks[:, row * len(place.marks) + profile.mark]
