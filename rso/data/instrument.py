"""The measurement chain: what stands between the specimen and the file, as transforms of any curve.

    recorded depth = (1 + depth_scale)(true depth − offset) + permanent_set · earlier + compliance · Fz + z,
                     less the backlash in unloading,                      creep_tau dz/dt + z = creep · Fz
    recorded Fz    = gain · (1 + nonlinearity · Fz*) Fz* + bias + drift · t,      lag_filter dF*/dt + F* = F(t − lag)
    recorded Fx    = Fx* cos(turn) + Fy* sin(turn) + cross_x · Fz* + bias_side cos(bias_angle)
    recorded Fy    = Fy* cos(turn) − Fx* sin(turn) + cross_y · Fz* + bias_side sin(bias_angle)

`earlier` is the deepest travel of all tests before at the same place: what stays of it is a dent in which the next test
makes contact later.  There are no mechanics in it and it costs no simulation.  Each knob is an effect: at neutral it is
absent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso.contract import knob, parameters_of
from rso.core.curves import rows_at
from rso.core.digits import quantity_text


@dataclass(frozen=True)
class Chain:
    """Every knob of the measurement chain, all neutral by default; ValueError outside the hard bounds."""

    offset: float = knob(
        "true depth at which the record says zero (above 0: contact was taken late, below: early)",
        "mm",
        -1.0,
        1.0,
        neutral=0.0,
        typical=0.05,
        scope="mounting",
        plausible=(-0.4, 0.4),
        label="contact point",
    )
    compliance: float = knob(  # a specimen that rocks on its seat has one beside its middle alone
        "load-train compliance",
        "mm/N",
        0.0,
        2.0,
        neutral=0.0,
        typical=0.1,
        scope="place",
        plausible=(0.01, 0.8),
        label="compliant load train",
    )
    gain: float = knob(
        "gain of the force channel",
        "1",
        0.5,
        2.0,
        neutral=1.0,
        typical=1.02,
        scope="curve",
        plausible=(0.8, 1.25),
        label="gain of the cell",
    )
    bias: float = knob(
        "zero error of the force channel",
        "N",
        -0.5,
        0.5,
        neutral=0.0,
        typical=0.005,
        scope="curve",
        plausible=(-0.05, 0.05),
        label="untared Fz",
    )
    drift: float = knob(
        "drift of the force channel",
        "N/s",
        -0.1,
        0.1,
        neutral=0.0,
        typical=0.0005,
        scope="curve",
        plausible=(-0.004, 0.004),
        label="drift of the force",
    )
    lag: float = knob(
        "delay of the force clock behind the depth clock",
        "s",
        -2.0,
        2.0,
        neutral=0.0,
        typical=0.1,
        plausible=(-1.0, 1.0),
        label="late force clock",
    )
    cross_x: float = knob(
        "share of Fz that appears in Fx",
        "1",
        -0.5,
        0.5,
        neutral=0.0,
        typical=0.02,
        plausible=(-0.2, 0.2),
        label="crosstalk Fz to Fx",
    )
    cross_y: float = knob(
        "share of Fz that appears in Fy",
        "1",
        -0.5,
        0.5,
        neutral=0.0,
        typical=0.02,
        plausible=(-0.2, 0.2),
        label="crosstalk Fz to Fy",
    )
    lag_filter: float = knob(
        "time constant of the force channel's filter",
        "s",
        0.0,
        2.0,
        neutral=0.0,
        typical=0.1,
        plausible=(0.01, 1.0),
        cause="lag",
        label="filter of the force",
    )

    backlash: float = knob(  # of either sign: a gauge that sticks shows on the way back what was
        "play of the drive, taken up when unloading; negative: of the depth gauge",
        "mm",
        -1.0,
        1.0,
        neutral=0.0,
        typical=0.05,
        plausible=(-0.3, 0.3),
        label="backlash",
    )

    ageing: float = knob(
        "change of all forces from the first test to the last (warmth, drying, ageing)",
        "1",
        -1.9,
        1.9,
        neutral=0.0,
        typical=0.05,
        plausible=(-0.4, 0.4),
        label="ageing from test to test",
    )

    permanent_set: float = knob(
        "share of the deepest earlier travel at a place that stays as a dent (the body's doing, not the rig's)",
        "1",
        0.0,
        0.9,
        neutral=0.0,
        typical=0.03,
        plausible=(0.005, 0.3),
        label="permanent set",
    )

    depth_scale: float = knob(
        "error of the depth scale",
        "1",
        -0.5,
        0.5,
        neutral=0.0,
        typical=0.02,
        plausible=(-0.15, 0.15),
        label="scale of the depth",
    )

    nonlinearity: float = knob(
        "nonlinearity of the force channel: change of its gain with the force",
        "1/N",
        -0.5,
        0.5,
        neutral=0.0,
        typical=0.02,
        plausible=(-0.2, 0.2),
        label="nonlinear cell",
    )

    turn: float = knob(
        "turn of the force sensor about the axis of the press",
        "deg",
        -180.0,
        180.0,
        neutral=0.0,
        typical=2.0,
        plausible=(-20.0, 20.0),
        label="turned sensor",
    )

    creep: float = knob(  # a glue, a tape, a soft seat: what gives way with time, not at once
        "creep compliance of the load train",
        "mm/N",
        0.0,
        2.0,
        neutral=0.0,
        group="creep",
        typical=0.1,
        plausible=(0.01, 0.8),
        cause="compliance",
        label="creeping load train",
    )

    creep_tau: float = knob(
        "retardation time of the load train", "s", 1e-9, 1e9, default=5.0, group="creep", plausible=(0.3, 100.0)
    )

    bias_side: float = knob(  # a cell of which Fz alone was tared
        "zero error of the force channels Fx and Fy",
        "N",
        -0.5,
        0.5,
        neutral=0.0,
        group="bias_side",
        typical=0.005,
        plausible=(-0.05, 0.05),
        label="untared Fx and Fy",
    )

    bias_angle: float = knob(
        "direction of the zero error from x to y",
        "deg",
        -180.0,
        180.0,
        default=0.0,
        group="bias_side",
        plausible=(-90.0, 90.0),
    )

    def __post_init__(self) -> None:
        for parameter in parameters_of(Chain):
            parameter.check(getattr(self, parameter.name))


_NEUTRAL_KNOBS: Mapping[str, float] = vars(Chain())
CROSS_KNOBS = {"Fx": "cross_x", "Fy": "cross_y"}  # knobs that act on one channel alone
TIMED_KNOBS = ("drift", "lag", "lag_filter", "creep")  # knobs that ask for the time of each reading
LATERAL_KNOBS = ("turn", "bias_side")  # and those that act on Fx and Fy alone


@dataclass(frozen=True, eq=False)
class Record:
    """Depth (n,) mm and forces (n,) N at the same instants, recorded or true."""

    depth: np.ndarray
    forces: Mapping[str, np.ndarray]


def record(
    chain: Chain,
    travel: np.ndarray,
    forces: Mapping[str, np.ndarray],
    time: np.ndarray | None = None,
    age: float = 0.0,
    earlier: float = 0.0,
) -> Record:
    """True travel (n,) mm and forces (n,) N over `time` (n,) s → what the file holds at the same instants.

    `forces` holds Fz and whichever of Fx, Fy there are.  Drift and lag need `time`, which must increase; `age` is where
    the test stands between the first, −1/2, and the last one of its series, 1/2; `earlier` mm is how deep the place was
    pressed before.
    Between instants forces are linear in time; before the first and after the last one they are constant.
    """
    u, F, t = _checked(chain, travel, forces, time)
    return Record(
        *recorded_curve({p.name: getattr(chain, p.name) for p in parameters_of(Chain)}, u, F, t, age, earlier)
    )


def recorded_curve(
    knobs: Mapping[str, float | np.ndarray],
    u: np.ndarray,
    F: Mapping[str, np.ndarray],
    t: np.ndarray,
    age: float = 0.0,
    earlier: float = 0.0,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Recorded depth and forces for knobs that are numbers or columns (T, 1); `u`, `F` and `t` are (n,) or (T, n)."""
    k = {name: knobs.get(name, start) for name, start in _NEUTRAL_KNOBS.items()}
    F = {c: (1.0 + k["ageing"] * age) * v for c, v in F.items()}
    late = {c: _filtered(t, _shift(t, v, k["lag"]), k["lag_filter"]) for c, v in F.items()}
    Fz = late["Fz"]
    zero = _zero(k["bias_side"], k["bias_angle"])
    out = {c: v + k[CROSS_KNOBS[c]] * Fz + zero[c] for c, v in _turned(late, k["turn"]).items()}
    out["Fz"] = k["gain"] * (1.0 + k["nonlinearity"] * Fz) * Fz + k["bias"] + k["drift"] * t
    depth = (1.0 + k["depth_scale"]) * (u - k["offset"]) + k["permanent_set"] * earlier
    return depth + yielded(k, t, F["Fz"]) - k["backlash"] * _returning(u), out


def yielded(knobs: Mapping[str, float | np.ndarray], t: np.ndarray, Fz: np.ndarray) -> np.ndarray:
    """What the load train has given way (mm) under the true force (…, n) N over time (…, n) s, at once and since."""
    out, creep = knobs.get("compliance", 0.0) * Fz, knobs.get("creep", 0.0)
    if np.all(np.asarray(creep) == 0):
        return out
    return out + creep * _filtered(t, Fz, knobs["creep_tau"])


def correct(
    chain: Chain,
    depth: np.ndarray,
    forces: Mapping[str, np.ndarray],
    time: np.ndarray | None = None,
    age: float = 0.0,
    earlier: float = 0.0,
) -> Record:
    """Inverse of :func:`record`: exact but for a lag, where the linear interpolation in time is undone by another, and
    for a backlash, where nobody sees the indenter wait."""
    d, R, t = _checked(chain, depth, forces, time)
    if chain.lag_filter:
        raise ValueError("a filter loses what it smooths: it cannot be undone")
    linear = (R["Fz"] - chain.bias - chain.drift * t) / chain.gain
    if np.any(1.0 + 4.0 * chain.nonlinearity * linear < 0.0):
        k, most = chain.nonlinearity, R["Fz"].max()
        raise ValueError(f"no force makes a cell with nonlinearity = {k:g} 1/N read {quantity_text(most, 'N', 6)}")
    late = {"Fz": 2.0 * linear / (1.0 + np.sqrt(1.0 + 4.0 * chain.nonlinearity * linear))}
    zero = _zero(chain.bias_side, chain.bias_angle)
    lateral = {k: v - getattr(chain, CROSS_KNOBS[k]) * late["Fz"] - zero[k] for k, v in R.items() if k != "Fz"}
    late |= _turned(lateral, -chain.turn)
    true = {k: _shift(t, v, -chain.lag) for k, v in late.items()}
    by = 1.0 + chain.depth_scale
    given = yielded({k: getattr(chain, k) for k in ("compliance", "creep", "creep_tau")}, t, true["Fz"])
    u = (d - chain.permanent_set * earlier - given) / by + chain.offset
    young = {c: v / (1.0 + chain.ageing * age) for c, v in true.items()}
    return Record(np.minimum(u + chain.backlash / by * _returning(u), u.max()), young)


def _turned(forces: Mapping[str, np.ndarray], angle: float | np.ndarray) -> dict[str, np.ndarray]:
    """Fx and Fy, whichever there are, in axes turned by `angle` degrees about z; what there is not is nothing."""
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    Fx, Fy = forces.get("Fx", 0.0), forces.get("Fy", 0.0)
    out = {"Fx": c * Fx + s * Fy, "Fy": c * Fy - s * Fx}
    return {k: np.asarray(v) for k, v in out.items() if k in forces}


def _zero(size: float | np.ndarray, angle: float | np.ndarray) -> dict[str, np.ndarray]:
    """What Fx and Fy read (N) of no force at all."""
    return {"Fx": np.asarray(size * np.cos(np.deg2rad(angle))), "Fy": np.asarray(size * np.sin(np.deg2rad(angle)))}


def _returning(u: np.ndarray) -> np.ndarray:
    """1 after the first of the deepest travels along the last axis, else 0."""
    return np.arange(u.shape[-1]) > np.argmax(u, axis=-1)[..., None]


def _shift(t: np.ndarray, value: np.ndarray, lag: float | np.ndarray) -> np.ndarray:
    """value(t − lag)."""
    if np.all(np.asarray(lag) == 0):
        return value
    if value.ndim == 1:
        return np.interp(t - lag, t, value)
    return rows_at(t - lag, t, value)


def _filtered(t: np.ndarray, value: np.ndarray, τ: float | np.ndarray) -> np.ndarray:
    """First-order filter of what is linear between instants and constant before the first: exact at the instants."""
    τ = np.asarray(τ, float)
    if np.all(τ == 0):
        return value
    q = np.diff(t, axis=-1) / np.maximum(τ, 1e-9)
    decay = np.exp(-q)
    ramp = np.where(q > 1e-6, -np.expm1(-q) / np.maximum(q, 1e-300), 1.0)  # mean of the decay over an interval
    out = np.array(value, float)
    for i in range(q.shape[-1]):
        past = decay[..., i] * out[..., i] + (ramp[..., i] - decay[..., i]) * value[..., i]
        out[..., i + 1] = past + (1.0 - ramp[..., i]) * value[..., i + 1]
    return out


def _checked(
    chain: Chain, travel: np.ndarray, forces: Mapping[str, np.ndarray], time: np.ndarray | None
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Arrays of equal length; ValueError saying what is missing."""
    u = np.asarray(travel, float)
    F = {k: np.asarray(v, float) for k, v in forces.items()}
    if "Fz" not in F or not set(F) <= {"Fx", "Fy", "Fz"}:
        raise ValueError(f"the measurement chain needs Fz and knows Fx, Fy, Fz; got {', '.join(F) or 'nothing'}")
    timed = [p for p in parameters_of(Chain) if p.name in TIMED_KNOBS and getattr(chain, p.name) != p.neutral]
    if time is None and timed:
        each = " and ".join(f"{p.name} = {getattr(chain, p.name):g} {p.unit}" for p in timed)
        raise ValueError(f"{each}: the time of each reading is needed")
    t = np.zeros_like(u) if time is None else np.asarray(time, float)
    if chain.turn != 0 and not {"Fx", "Fy"} <= set(F):
        raise ValueError(f"turn = {chain.turn:g} deg needs both Fx and Fy; got {', '.join(F)}")
    if any(v.shape != u.shape for v in (t, *F.values())):
        raise ValueError(f"depth {u.shape}, time {t.shape} and forces {[v.shape for v in F.values()]} differ in length")
    if time is not None and np.any(np.diff(t) <= 0):
        raise ValueError("time must increase")
    return u, F, t
