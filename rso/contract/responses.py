"""What a backend answers: channels over the programme, or the reason why there is no answer."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rso.contract.parameters import number
from rso.contract.plain_data import plain

ALWAYS_CHANNELS = {"time": "s", "travel": "mm"}  # channels that every response has, and their units
FORCE_CHANNELS = ("Fx", "Fy", "Fz")  # of the channels, those that a load cell measures
CAUSES = (
    "inversion",  # an element turned inside out and no smaller step helped
    "contact",  # the contact search or its multipliers did not settle
    "step_limit",  # the load step became smaller than allowed
    "instability",  # the tangent lost positive definiteness and no equilibrium was found
    "time_limit",  # the backend's own limit; counts as a crash, as it says nothing of what was asked
    "bad_geometry",  # the values describe no body (inclusion outside, negative thickness, ...)
    "inadmissible",  # the values describe no material (energy not convex over the stretches reached)
    "not_supported",  # the backend does not model what was asked
    "not_finite",  # what it answers is no number at some depth; set by the contract, the rest is kept as partial
)


@dataclass(frozen=True)
class Curve:
    """One channel over travel: `travel_mm` (n,), `value` (n,) in `unit`, estimated numerical error (n,)."""

    channel: str
    unit: str
    travel_mm: np.ndarray
    value: np.ndarray
    error: np.ndarray


@dataclass(frozen=True)
class FreeCurve:
    """A curve over an abscissa of its own: `value` (n,) in `unit` over increasing `at` (n,), `over` in `over_unit`.

    ValueError for what is no such curve.  Values and abscissa may have any sign; a value that is no number is refused.
    """

    at: np.ndarray
    value: np.ndarray
    unit: str = "1"
    over: str = "x"
    over_unit: str = "1"

    def __post_init__(self) -> None:
        at, value = (np.atleast_1d(_real(f"curve over {self.over!r}", v)) for v in (self.at, self.value))
        if at.ndim != 1 or at.shape != value.shape or not len(at):
            raise ValueError(f"curve over {self.over!r}: {at.shape} abscissae and {value.shape} values; both need (n,)")
        if not (np.isfinite(at).all() and np.isfinite(value).all()):
            raise NotFinite(f"curve over {self.over!r}: holds what is no number")
        if np.any(np.diff(at) <= 0):
            raise ValueError(f"curve over {self.over!r}: the abscissa must increase")
        object.__setattr__(self, "at", at)
        object.__setattr__(self, "value", value)


@dataclass(frozen=True)
class Response:
    """Channels over the programme, each (n,), with units and estimated numerical error in the same unit.

    `time` (s) and `travel` (mm) are always among the channels.  `gradients[knob][channel]` (n,) is optional:
    whoever needs derivatives must be able to live without.  `info` carries plain facts about the run
    (CPU seconds, iterations, versions); nothing in it enters a result.  `curves` are those over other abscissae.
    """

    channels: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    error: Mapping[str, np.ndarray] = field(default_factory=dict)
    gradients: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    info: Mapping[str, Any] = field(default_factory=dict)
    curves: Mapping[str, FreeCurve] = field(default_factory=dict)

    def __post_init__(self) -> None:
        channels = {k: np.atleast_1d(_real(f"response: channel {k!r}", v)) for k, v in self.channels.items()}
        for name in ("time", "travel"):
            if name not in channels:
                raise ValueError(f"response: channel {name!r} is missing (got {sorted(channels)})")
        n = len(channels["travel"])
        error = {k: _along(f"response: error of {k!r}", v, n, broadcast=True) for k, v in self.error.items()}
        for k, v in channels.items():
            if v.shape != (n,):
                raise ValueError(f"response: channel {k!r} has shape {v.shape}, expected ({n},)")
            if k not in self.units:
                raise ValueError(f"response: channel {k!r} has no unit")
        whole = np.all([np.isfinite(v) for v in channels.values()], axis=0)
        for k, v in error.items():
            if k not in channels:
                raise ValueError(f"response: error of {k!r}, which is none of its channels {sorted(channels)}")
            if not np.all(np.isfinite(v[whole]) & (v[whole] >= 0)):
                got = f"got {v.min():g} to {v.max():g}"
                raise ValueError(f"response: error of {k!r} must be finite and at least 0, {got}")
        gradients = {
            knob: {c: _along(f"response: gradient of {c!r} by {knob!r}", v, n) for c, v in by_channel.items()}
            for knob, by_channel in self.gradients.items()
        }
        if not whole.all():
            raise self._not_finite(channels, error, whole)
        object.__setattr__(self, "channels", channels)
        object.__setattr__(self, "error", error)
        object.__setattr__(self, "gradients", gradients)

    def _not_finite(
        self, channels: dict[str, np.ndarray], error: dict[str, np.ndarray], whole: np.ndarray
    ) -> NotFinite:
        """What is no number and where, with the rows that are `whole` (n,)."""
        name, row = next((k, int(np.argmin(np.isfinite(v)))) for k, v in channels.items() if not np.isfinite(v).all())
        at = "" if name == "travel" else f" at travel {channels['travel'][row]:g} mm"
        text = f"response: channel {name!r} is {channels[name][row]:g}{at}, no number"
        more = int((~whole).sum()) - 1
        text += f" ({more} more of {len(whole)} like it)" if more else ""
        kept = {k: v[whole] for k, v in channels.items()}
        partial = Response(kept, self.units, {k: v[whole] for k, v in error.items()}) if whole.any() else None
        return NotFinite(text, partial)

    def curve(self, channel: str) -> Curve:
        """One channel as a curve over travel; unknown channels raise KeyError listing the known ones."""
        if channel not in self.channels:
            raise KeyError(f"no channel {channel!r}; this response has {sorted(self.channels)}")
        value = self.channels[channel]
        error = self.error.get(channel, np.zeros_like(value))
        return Curve(channel, self.units[channel], self.channels["travel"], value, error)

    def to_json(self) -> dict[str, Any]:
        """The response as plain JSON data."""
        return {
            "status": "done",
            "channels": plain(self.channels),
            "units": dict(self.units),
            "error": plain(self.error),
            "gradients": plain(self.gradients),
            "info": plain(self.info),
            **({"curves": {k: plain(dataclasses.asdict(c)) for k, c in self.curves.items()}} if self.curves else {}),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Response:
        """Inverse of :meth:`to_json`; raises ValueError on missing channels, units or non-finite values."""
        return cls(
            data["channels"],
            data["units"],
            data.get("error") or {},
            data.get("gradients") or {},
            data.get("info") or {},
            {k: FreeCurve(**c) for k, c in (data.get("curves") or {}).items()},
        )


class NotFinite(ValueError):
    """A response with a value that is no number: a sentence, and what is left without the rows that hold such."""

    def __init__(self, reason: str, partial: Response | None = None) -> None:
        super().__init__(reason)
        self.reason, self.partial = reason, partial

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.reason, self.partial)

    def failure(self) -> SimulationFailed:
        """The same as a failed run: asked again, the same backend would answer the same."""
        return SimulationFailed("not_finite", self.reason, self.partial)


class SimulationFailed(Exception):
    """The backend says that there is no answer: a cause class, a sentence, what was reached, the history."""

    def __init__(
        self,
        cause: str,
        reason: str = "",
        partial: Response | None = None,
        history: tuple[Mapping[str, Any], ...] = (),
    ) -> None:
        if cause not in CAUSES:
            raise ValueError(f"unknown cause {cause!r}; choose one of {', '.join(CAUSES)}")
        super().__init__(f"{cause}: {reason}" if reason else cause)
        self.cause, self.reason, self.partial, self.history = cause, reason, partial, history

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.cause, self.reason, self.partial, self.history)


def _real(name: str, value: Any) -> np.ndarray:
    """An array of floats; ValueError for complex numbers, text, truth values and masked ones, which numpy takes."""
    found = np.asarray(value)
    if np.ma.is_masked(value):
        raise ValueError(f"{name} holds masked values; a run without an answer must fail")
    if found.dtype.kind == "O":
        return np.array([np.nan if v is None else number(name, v) for v in found.ravel()], float).reshape(found.shape)
    if found.dtype.kind not in "iuf" and found.size:
        what = {"c": "complex numbers", "b": "truth values", "U": "text", "S": "text"}.get(
            found.dtype.kind, "no numbers"
        )
        raise ValueError(f"{name} holds {what}; real numbers are expected")
    return found.astype(float)


def _along(name: str, value: Any, n: int, *, broadcast: bool = False) -> np.ndarray:
    """Floats (n,); one alone holds for all where it may be `broadcast`; ValueError with its name for another shape."""
    found = _real(name, value)
    if found.shape != (n,) and not (broadcast and found.size == 1):
        raise ValueError(f"{name} has shape {found.shape}, expected ({n},)")
    return np.broadcast_to(found, (n,)).copy()
