"""The measurement chain: what stands between the specimen and the file, as transforms of any curve.

    recorded depth = true depth − offset + compliance · Fz
    recorded Fz    = gain · Fz(t − lag) + bias + drift · t
    recorded Fx    = Fx(t − lag) + cross_x · Fz(t − lag)        and Fy with cross_y

There are no mechanics in it and it costs no simulation.  Each knob is an effect: at neutral it is absent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso.contract import knob, parameters_of


@dataclass(frozen=True)
class Chain:
    """Every knob of the measurement chain, all neutral by default; ValueError outside the hard bounds."""

    offset: float = knob(
        "true depth at which the record says zero (contact found late)",
        "mm",
        -1.0,
        1.0,
        neutral=0.0,
        typical=0.05,
        scope="mounting",
        plausible=(-0.4, 0.4),
    )
    compliance: float = knob("load-train compliance", "mm/N", 0.0, 2.0, neutral=0.0, typical=0.1, plausible=(0.01, 0.8))
    gain: float = knob(
        "gain of the force channel", "1", 0.5, 2.0, neutral=1.0, typical=1.02, scope="curve", plausible=(0.8, 1.25)
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
    )
    lag: float = knob(
        "delay of the force clock behind the depth clock",
        "s",
        -1.0,
        1.0,
        neutral=0.0,
        typical=0.1,
        plausible=(-0.6, 0.6),
    )
    cross_x: float = knob(
        "share of Fz that appears in Fx", "1", -0.5, 0.5, neutral=0.0, typical=0.02, plausible=(-0.2, 0.2)
    )
    cross_y: float = knob(
        "share of Fz that appears in Fy", "1", -0.5, 0.5, neutral=0.0, typical=0.02, plausible=(-0.2, 0.2)
    )

    def __post_init__(self) -> None:
        for parameter in parameters_of(type(self)):
            parameter.check(getattr(self, parameter.name))


@dataclass(frozen=True, eq=False)
class Record:
    """Depth (n,) mm and forces (n,) N at the same instants, recorded or true."""

    depth: np.ndarray
    forces: Mapping[str, np.ndarray]


def record(
    chain: Chain, travel: np.ndarray, forces: Mapping[str, np.ndarray], time: np.ndarray | None = None
) -> Record:
    """True travel (n,) mm and forces (n,) N over `time` (n,) s → what the file holds at the same instants.

    `forces` holds Fz and whichever of Fx, Fy there are.  Drift and lag need `time`, which must increase.
    Between instants forces are linear in time; before the first and after the last one they are constant.
    """
    u, F, t = _checked(chain, travel, forces, time)
    late = {k: _shift(t, v, chain.lag) for k, v in F.items()}
    recorded = {k: v + _cross(chain, k) * late["Fz"] for k, v in late.items() if k != "Fz"}
    recorded["Fz"] = chain.gain * late["Fz"] + chain.bias + chain.drift * t
    return Record(u - chain.offset + chain.compliance * F["Fz"], recorded)


def correct(
    chain: Chain, depth: np.ndarray, forces: Mapping[str, np.ndarray], time: np.ndarray | None = None
) -> Record:
    """Inverse of :func:`record`: exact but for a lag, where the linear interpolation in time is undone by another."""
    d, R, t = _checked(chain, depth, forces, time)
    late = {"Fz": (R["Fz"] - chain.bias - chain.drift * t) / chain.gain}
    late |= {k: v - _cross(chain, k) * late["Fz"] for k, v in R.items() if k != "Fz"}
    true = {k: _shift(t, v, -chain.lag) for k, v in late.items()}
    return Record(d + chain.offset - chain.compliance * true["Fz"], true)


def _cross(chain: Chain, channel: str) -> float:
    return {"Fx": chain.cross_x, "Fy": chain.cross_y}[channel]


def _shift(t: np.ndarray, value: np.ndarray, lag: float) -> np.ndarray:
    """value(t − lag)."""
    return value if lag == 0 else np.interp(t - lag, t, value)


def _checked(
    chain: Chain, travel: np.ndarray, forces: Mapping[str, np.ndarray], time: np.ndarray | None
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Arrays of equal length; ValueError saying what is missing."""
    u = np.asarray(travel, float)
    F = {k: np.asarray(v, float) for k, v in forces.items()}
    if "Fz" not in F or not set(F) <= {"Fx", "Fy", "Fz"}:
        raise ValueError(f"the measurement chain needs Fz and knows Fx, Fy, Fz; got {', '.join(F) or 'nothing'}")
    if time is None and (chain.drift != 0 or chain.lag != 0):
        raise ValueError(f"drift = {chain.drift:g} N/s and lag = {chain.lag:g} s need the time of each reading")
    t = np.zeros_like(u) if time is None else np.asarray(time, float)
    if any(v.shape != u.shape for v in (t, *F.values())):
        raise ValueError(f"depth {u.shape}, time {t.shape} and forces {[v.shape for v in F.values()]} differ in length")
    if time is not None and np.any(np.diff(t) <= 0):
        raise ValueError("time must increase")
    return u, F, t
