"""The seam between `rso` and whatever computes: knobs, cases, responses, failures and the run key.

A backend is any object with the attributes of :class:`Backend`.  It receives one value per knob and one
:class:`Case`, and returns a :class:`Response` or raises :class:`SimulationFailed`.  A run therefore ends

* **done**: a response;
* **failed**: the backend itself says that there is no answer (:class:`SimulationFailed`, with a cause class), or
  answers with what is no number (:class:`NotFinite`): what is finite is kept as a partial answer;
* **crashed**: anything else (another exception, a killed process, a time-out).  It is shown apart and tried
  again next time, so that a bug is never recorded as physics.

Units inside are N, mm, MPa, s.  This module needs numpy and the standard library only.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

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

Scope = Literal["study", "mounting", "place", "curve"]


@dataclass(frozen=True)
class Parameter:
    """One scalar knob: its meaning, unit, hard bounds and, for an effect, the value that switches it off."""

    name: str
    description: str
    unit: str
    low: float
    high: float
    default: float | None = None
    neutral: float | None = None
    group: str = ""
    typical: float | None = None
    scope: Scope = "study"
    plausible: tuple[float, float] | None = None
    cause: str = ""
    label: str = ""

    def check(self, value: float) -> float:
        """Return `value` as a float, or raise ValueError naming knob, value, unit and bounds."""
        x = number(self.name, value)
        if not (math.isfinite(x) and self.low <= x <= self.high):
            raise ValueError(
                f"{self.name} = {x} {self.unit} is outside its hard bounds "
                f"[{self.low:g}, {self.high:g}] {self.unit} ({self.description})"
            )
        return x


def number(name: str, value: Any) -> float:
    """A number (of Python or numpy, no truth value, no text) as a float; ValueError naming what and value."""
    good = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not good:
        raise ValueError(f"{name} = {value!r}: a number is expected")
    try:
        return float(value)
    except OverflowError:  # a whole number of more than 308 digits
        raise ValueError(f"{name} = {str(value)[:20]}… is too large for a number") from None


def finite(value: Any) -> bool:
    """Whether it is a number (no truth value, no text) that is finite as a float: whole ones may be too large."""
    try:
        return math.isfinite(number("value", value))
    except ValueError:
        return False


def knob(
    description: str,
    unit: str,
    low: float,
    high: float,
    *,
    default: float | None = None,
    neutral: float | None = None,
    group: str = "",
    typical: float | None = None,
    scope: Scope = "study",
    plausible: tuple[float, float] | None = None,
    cause: str = "",
    label: str = "",
) -> Any:
    """Declare one knob as a dataclass field; an effect gives `neutral`, which is then also its default.

    `plausible` is the range one meets in practice: the prior of a diagnosis, neither hard bounds nor a design's box.
    Effects of one `cause` are forms of the same thing (two laws of strain stiffening).  `scope` is what shares a value:
    all tests, those of a mounting, those at a place, or none (each curve its own).  `label` is what reports call it.
    """
    start = neutral if default is None else default
    declared = Parameter("", description, unit, low, high, start, neutral, group, typical, scope, plausible,
                         cause, label)  # fmt: skip
    metadata = {"parameter": declared}
    return field(metadata=metadata) if start is None else field(default=start, metadata=metadata)


@functools.cache
def parameters_of(knobs: type) -> tuple[Parameter, ...]:
    """Every knob declared on a dataclass, in order of declaration."""
    return tuple(
        dataclasses.replace(f.metadata["parameter"], name=f.name)
        for f in dataclasses.fields(knobs)
        if "parameter" in f.metadata
    )


@dataclass(frozen=True)
class Programme:
    """Indenter travel over time, piecewise linear through (`time_s`, `travel_mm`), and what is asked for.

    Channels are returned at each passage of an asked travel and at each asked moment (a hold), in order of time.
    """

    time_s: tuple[float, ...]
    travel_mm: tuple[float, ...]
    asked_mm: tuple[float, ...]
    asked_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("time_s", "travel_mm", "asked_mm", "asked_s"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))
        t, u, a = (np.asarray(v) for v in (self.time_s, self.travel_mm, self.asked_mm))
        if len(t) != len(u) or len(t) < 2:
            raise ValueError(f"programme: time_s ({len(t)}) and travel_mm ({len(u)}) need the same length >= 2")
        for name, v in (("time_s", t), ("travel_mm", u), ("asked_mm", a)):
            if not np.all(np.isfinite(v)):
                raise ValueError(f"programme: {name} must be finite, got {v.tolist()}")
        if np.any(np.diff(t) <= 0):
            raise ValueError(f"programme: time_s must increase, got {list(self.time_s)}")
        if u.max() <= 0:
            raise ValueError(f"programme: travel_mm must go down, which counts as positive, got {list(self.travel_mm)}")
        if len(a) == 0 or np.any(np.diff(a) <= 0) or a[0] <= 0 or a[-1] > u.max() + 1e-12:
            raise ValueError(f"programme: asked_mm must increase within (0, {u.max():g}] mm, got {list(self.asked_mm)}")
        m = np.asarray(self.asked_s)
        outside = len(m) and not t[0] < m[0] <= m[-1] <= t[-1]
        if not np.all(np.isfinite(m)) or np.any(np.diff(m) <= 0) or outside:
            within = f"({t[0]:g}, {t[-1]:g}] s"
            raise ValueError(f"programme: asked_s must increase within {within}, got {list(self.asked_s)}")

    @classmethod
    def ramp(cls, asked_mm: tuple[float, ...], speed_mm_s: float = 0.5) -> Programme:
        """Monotonic loading to the deepest asked travel at one speed (mm/s)."""
        deepest = float(max(asked_mm))
        return cls((0.0, deepest / speed_mm_s), (0.0, deepest), tuple(asked_mm))


@dataclass(frozen=True)
class Case:
    """One simulation: a programme and the backend's own settings (where, geometry, support, law).

    `artefacts` maps a name to the SHA-256 of what the backend made for this case beforehand (a mesh); the
    hashes are part of the run key.  `objects` is the folder that holds them and is not.
    """

    name: str
    programme: Programme
    settings: Mapping[str, Any] = field(default_factory=dict)
    artefacts: Mapping[str, str] = field(default_factory=dict)
    objects: str | None = None

    def artefact(self, name: str) -> Path | None:
        """File of the named artefact, or None if the dispatcher prepared none."""
        if self.objects is None or name not in self.artefacts:
            return None
        return object_path(Path(self.objects), self.artefacts[name])

    def to_json(self) -> dict[str, Any]:
        """The case as plain JSON data (the `case` of a request)."""
        return {
            "name": self.name,
            "programme": dataclasses.asdict(self.programme),
            "settings": plain(self.settings),
            "artefacts": dict(self.artefacts),
            "objects": self.objects,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Case:
        """Inverse of :meth:`to_json`; a missing `artefacts`, `objects` or `settings` means none."""
        if not isinstance(data, Mapping):
            raise ValueError(f"case = {data!r}: a table with name, programme and settings is expected")
        unknown = sorted(set(data) - {"name", "programme", "settings", "artefacts", "objects"})
        if unknown or "programme" not in data:
            raise ValueError(f"case: needs name, programme, settings[, artefacts, objects]; unknown: {unknown}")
        programme = data["programme"]
        needed = {"time_s", "travel_mm", "asked_mm"}
        if not isinstance(programme, Mapping) or not needed <= set(programme) <= needed | {"asked_s"}:
            raise ValueError("case.programme: needs exactly time_s, travel_mm and asked_mm, and may have asked_s")
        for key, words in (("settings", "a table"), ("artefacts", "a table of names and hashes")):
            if not isinstance(data.get(key) or {}, Mapping):
                raise ValueError(f"case.{key} = {data[key]!r}: {words} is expected")
        for key in ("name", "objects"):
            if not isinstance(data.get(key, ""), str | None):
                raise ValueError(f"case.{key} = {data[key]!r}: a text is expected")
        return cls(
            str(data.get("name", "case")),
            Programme(**{k: _numbers(f"case.programme.{k}", v) for k, v in programme.items()}),
            dict(data.get("settings") or {}),
            dict(data.get("artefacts") or {}),
            data.get("objects"),
        )


def _numbers(name: str, value: Any) -> tuple[float, ...]:
    """A list of numbers; ValueError naming it, what it is and what is expected."""
    if not isinstance(value, list | tuple | np.ndarray):
        raise ValueError(f"{name} = {value!r}: a list of numbers is expected")
    return tuple(number(f"{name}[{k}]", v) for k, v in enumerate(value))


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


@dataclass(frozen=True)
class Curve:
    """One channel over travel: `travel_mm` (n,), `value` (n,) in `unit`, estimated numerical error (n,)."""

    channel: str
    unit: str
    travel_mm: np.ndarray
    value: np.ndarray
    error: np.ndarray


@dataclass(frozen=True)
class Response:
    """Channels over the programme, each (n,), with units and estimated numerical error in the same unit.

    `time` (s) and `travel` (mm) are always among the channels.  `gradients[knob][channel]` (n,) is optional:
    whoever needs derivatives must be able to live without.  `info` carries plain facts about the run
    (CPU seconds, iterations, versions); nothing in it enters a result.
    """

    channels: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    error: Mapping[str, np.ndarray] = field(default_factory=dict)
    gradients: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    info: Mapping[str, Any] = field(default_factory=dict)

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
        reason: str,
        partial: Response | None = None,
        history: tuple[Mapping[str, Any], ...] = (),
    ) -> None:
        if cause not in CAUSES:
            raise ValueError(f"unknown cause {cause!r}; choose one of {', '.join(CAUSES)}")
        super().__init__(f"{cause}: {reason}")
        self.cause, self.reason, self.partial, self.history = cause, reason, partial, history

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.cause, self.reason, self.partial, self.history)


@runtime_checkable
class Backend(Protocol):
    """What `rso` needs of a simulator.  `name` and `numerics` enter the run key.

    `numerics` is raised when, and only when, answers change: the package version does not enter the key.  So does
    `fingerprint` where there is one: of foreign backends the loader sets it to the hash of the files they come from.
    """

    name: str
    numerics: int

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every scalar knob."""

    @property
    def channels(self) -> Mapping[str, str]:
        """Name → unit of every channel a response can hold."""

    def check(self, case: Case) -> None:
        """Raise ValueError for settings this backend does not know, naming key, value and choices."""

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Drop what has no influence on the answer: effects at neutral, rates of an elastic body."""

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """Name → recipe of each artefact the case needs; equal recipes mean the same artefact."""

    def make(self, recipe: str) -> bytes:
        """Make one artefact (a mesh) from its recipe; slow, run once, stored by hash."""

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Compute the response, or raise SimulationFailed."""


def drop_neutral(parameters: tuple[Parameter, ...], values: Mapping[str, float]) -> dict[str, float]:
    """Values without the effects that are switched off: adding an effect later keeps every old key valid."""
    neutral = {p.name: p.neutral for p in parameters if p.neutral is not None}
    return {k: float(v) for k, v in values.items() if k not in neutral or float(v) != neutral[k]}


def plain(data: Any) -> Any:
    """Plain JSON data (dicts with string keys, lists, str, int, float, bool, None); ValueError for the rest."""
    if isinstance(data, Mapping | MappingProxyType):
        return {str(k): plain(v) for k, v in data.items()}
    if isinstance(data, np.ndarray):
        return plain(data.tolist())
    if isinstance(data, list | tuple):
        return [plain(v) for v in data]
    if isinstance(data, np.bool_ | np.integer | np.floating):
        return data.item()
    if data is None or isinstance(data, str | bool | int | float):
        return data
    raise ValueError(f"{data!r} ({type(data).__name__}) is not plain data")


def digest(data: Any) -> str:
    """SHA-256 of plain data in canonical form; 4 and 4.0 are the same number, -0.0 is 0.0."""

    def normal(x: Any) -> Any:
        if isinstance(x, dict):
            return {k: normal(v) for k, v in x.items()}
        if isinstance(x, list):
            return [normal(v) for v in x]
        if isinstance(x, int | float) and not isinstance(x, bool):
            return (float(x) + 0.0).hex()
        return x

    return hashlib.sha256(json.dumps(normal(plain(data)), sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def run_key(backend: Backend, values: Mapping[str, float], case: Case) -> str:
    """Content address of a run: everything that influences the answer and nothing else (no names, no paths).

    `values` and `case` are expected in the backend's canonical form.
    """
    fingerprint = getattr(backend, "fingerprint", "")
    return digest(
        {
            **({"fingerprint": fingerprint} if fingerprint else {}),
            "backend": backend.name,
            "numerics": backend.numerics,
            "values": {k: float(v) for k, v in values.items()},
            "programme": {k: v for k, v in dataclasses.asdict(case.programme).items() if v != ()},
            "settings": plain(case.settings),
            "artefacts": dict(case.artefacts),
        }
    )


def object_path(folder: Path, sha: str) -> Path:
    """Where a content-addressed object lies below `folder`."""
    return folder / sha[:2] / sha
