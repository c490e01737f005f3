"""What is asked of a backend: a programme of travel and force over time, and the backend's own settings."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rso.contract.parameters import number
from rso.contract.plain_data import object_path, plain
from rso.contract.segments import Segment, clock, refuse_together


@dataclass(frozen=True)
class Programme:
    """What the indenter does over time, and what is asked for: travel as waypoints, or segments of travel and force.

    Either travel is piecewise linear through (`time_s`, `travel_mm`), or it follows `segments`, from rest at first
    contact at 0 s.  Channels are returned at each passage of an asked travel or force and at each asked moment (a
    hold), in order of time.  Segments have asked moments of their own, since each began.  A moment of `asked_s` counts
    from the programme's start and needs segments whose durations are known before they are run.
    Travel counts from the first contact with the undeformed specimen.  It is negative where the indenter is above that:
    before a contact, and where it draws the specimen up behind it.

    With nothing stated nothing is moved: the case of a model that has no indenter, whose one passage is at 0 s, 0 mm.
    """

    time_s: tuple[float, ...] = ()
    travel_mm: tuple[float, ...] = ()
    asked_mm: tuple[float, ...] = ()
    asked_s: tuple[float, ...] = ()
    asked_N: tuple[float, ...] = ()
    segments: tuple[Segment, ...] = ()

    def __post_init__(self) -> None:
        for name in ("time_s", "travel_mm", "asked_mm", "asked_s", "asked_N"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))
        object.__setattr__(self, "segments", tuple(self.segments))
        self._refuse_asked()
        if self.segments:
            self._refuse_segments()
        elif not self.still:
            self._refuse_waypoints()

    @property
    def still(self) -> bool:
        """Whether nothing is moved and nothing asked for along the way."""
        asked = self.asked_mm or self.asked_s or self.asked_N
        return not (self.time_s or self.travel_mm or self.segments or asked)

    @property
    def forced(self) -> bool:
        """Whether a force decides where the indenter goes, or what is answered."""
        return bool(self.asked_N) or any(s.control == "force" or s.to_N is not None for s in self.segments)

    def plain(self) -> dict[str, Any]:
        """What is stated of it, as plain data: a part that says nothing is left out."""
        numbers = ("time_s", "travel_mm", "asked_mm", "asked_s", "asked_N")
        found: dict[str, Any] = {k: v for k in numbers if (v := getattr(self, k))}
        return {**found, **({"segments": [s.plain() for s in self.segments]} if self.segments else {})}

    def _refuse_asked(self) -> None:
        """Raise ValueError for asked travels, forces and moments that are none by themselves."""
        for name in ("asked_mm", "asked_N", "asked_s"):
            v = getattr(self, name)
            if not all(map(math.isfinite, v)):
                raise ValueError(f"programme: {name} must be finite, got {list(v)}")
        moments = any(s.asked_s for s in self.segments)
        if self.segments and not (self.asked_mm or self.asked_s or self.asked_N or moments):
            raise ValueError("programme: nothing is asked for; state asked_mm, asked_N, asked_s or those of a segment")
        if self.asked_N and (not _increases(self.asked_N) or 0.0 in self.asked_N):
            raise ValueError(f"programme: asked_N must increase and is never 0 N, got {list(self.asked_N)}")

    def _refuse_segments(self) -> None:
        """Raise ValueError for segments that cannot follow each other, or beside waypoints."""
        if self.time_s or self.travel_mm:
            raise ValueError("programme: segments stand alone, without time_s and travel_mm")
        wrong = [s for s in self.segments if not isinstance(s, Segment)]
        if wrong:
            raise ValueError(f"programme: segments must be Segment, got {wrong[0]!r}")
        try:
            refuse_together(self.segments)
        except ValueError as error:
            raise ValueError(f"programme: {error}") from None
        if not _increases(self.asked_mm) or any(v <= 0 for v in self.asked_mm):
            raise ValueError(f"programme: asked_mm must increase and be positive, got {list(self.asked_mm)}")
        if not self.asked_s:
            return
        end = clock(self.segments)[-1]
        if end is None:
            raise ValueError(
                "programme: asked_s counts from the start, but the duration of these segments is known only after "
                "the run. State asked_s within a segment, counted from its beginning"
            )
        if not _increases(self.asked_s) or not 0.0 < self.asked_s[0] <= self.asked_s[-1] <= end * (1.0 + 1e-12):
            raise ValueError(f"programme: asked_s must increase within (0, {end:g}] s, got {list(self.asked_s)}")

    def _refuse_waypoints(self) -> None:
        """Raise ValueError for waypoints of travel that are none."""
        t, u, a, m = self.time_s, self.travel_mm, self.asked_mm, self.asked_s
        if len(t) != len(u) or len(t) < 2:
            raise ValueError(f"programme: time_s ({len(t)}) and travel_mm ({len(u)}) need the same length >= 2")
        for name, v in (("time_s", t), ("travel_mm", u), ("asked_mm", a)):
            if not all(map(math.isfinite, v)):
                raise ValueError(f"programme: {name} must be finite, got {list(v)}")
        if not _increases(t):
            raise ValueError(f"programme: time_s must increase, got {list(self.time_s)}")
        if max(u) <= 0:
            raise ValueError(f"programme: travel_mm must go down, which counts as positive, got {list(self.travel_mm)}")
        least, low, high = 0 if self.asked_s or self.asked_N else 1, min(*u, 0.0), max(u)
        above = len(a) == 0 or (a[0] >= low - 1e-12 if low < 0.0 else a[0] > 0.0)
        if len(a) < least or not above or not _increases(a) or (len(a) and a[-1] > high + 1e-12):
            within = f"{'[' if low < 0.0 else '('}{low:g}, {high:g}] mm"
            raise ValueError(f"programme: asked_mm must increase within {within}, got {list(self.asked_mm)}")
        outside = m and not t[0] < m[0] <= m[-1] <= t[-1]
        if not _increases(m) or outside:
            within = f"({t[0]:g}, {t[-1]:g}] s"
            raise ValueError(f"programme: asked_s must increase within {within}, got {list(self.asked_s)}")

    @classmethod
    def ramp(cls, asked_mm: tuple[float, ...], speed_mm_s: float = 0.5) -> Programme:
        """Monotonic loading to the deepest asked travel at one speed (mm/s)."""
        deepest = float(max(asked_mm))
        return cls((0.0, deepest / speed_mm_s), (0.0, deepest), tuple(asked_mm))

    def passages(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) s and travels (n,) mm of all passages of asked travels and all asked moments, in order of time."""
        if self.still:
            return np.zeros(1), np.zeros(1)
        t, s = np.array(self.time_s), np.array(self.travel_mm)
        found: dict[float, float] = {}
        for (t0, s0), (t1, s1) in itertools.pairwise(zip(t, s, strict=True)):
            low, high = min(s0, s1), max(s0, s1)
            for a in np.minimum(self.asked_mm, s.max()):
                if low <= a <= high and s0 != s1:
                    found[float(t0 + (t1 - t0) * (a - s0) / (s1 - s0))] = float(a)
        found |= {float(m): float(np.interp(m, t, s)) for m in self.asked_s}
        times = sorted(found)
        return np.array(times), np.array([found[k] for k in times])


@dataclass(frozen=True)
class Case:
    """One simulation: a programme and the backend's own settings (where, geometry, support, law).

    `artefacts` maps a name to the SHA-256 of what the backend made for this case beforehand (a mesh).  The
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
            "programme": _request(self.programme),
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
        for key, words in (("settings", "a table"), ("artefacts", "a table of names and hashes")):
            if not isinstance(data.get(key) or {}, Mapping):
                raise ValueError(f"case.{key} = {data[key]!r}: {words} is expected")
        for key in ("name", "objects"):
            if not isinstance(data.get(key, ""), str | None):
                raise ValueError(f"case.{key} = {data[key]!r}: a text is expected")
        return cls(
            str(data.get("name", "case")),
            _programme(data["programme"]),
            dict(data.get("settings") or {}),
            dict(data.get("artefacts") or {}),
            data.get("objects"),
        )


def _request(programme: Programme) -> dict[str, Any]:
    """The programme of a request: waypoints always with these four lists, the rest only where it is stated."""
    waypoints = {k: list(getattr(programme, k)) for k in ("time_s", "travel_mm", "asked_mm", "asked_s")}
    return plain(programme.plain() if programme.segments else {**waypoints, **programme.plain()})


def _programme(data: Any) -> Programme:
    """A programme from plain data; ValueError naming key, value and choices."""
    known = [f.name for f in dataclasses.fields(Programme)]
    needed = {"time_s", "travel_mm"}
    if not isinstance(data, Mapping) or not (needed <= set(data) or "segments" in data) or not set(data) <= {*known}:
        unknown = sorted(set(data) - {*known}) if isinstance(data, Mapping) else data
        raise ValueError(
            "case.programme: needs time_s and travel_mm, or segments, and asks by asked_mm, asked_N or asked_s; "
            f"unknown: {unknown}"
        )
    segments = data.get("segments", ())
    if not isinstance(segments, list | tuple):
        raise ValueError(f"case.programme.segments = {segments!r}: a list of tables is expected")
    numbers = {k: _numbers(f"case.programme.{k}", v) for k, v in data.items() if k != "segments"}
    read = tuple(Segment.read(f"case.programme.segments[{k}]", v) for k, v in enumerate(segments))
    return Programme(**numbers, segments=read)


def _increases(values: Sequence[float]) -> bool:
    return not any(b <= a for a, b in itertools.pairwise(values))


def _numbers(name: str, value: Any) -> tuple[float, ...]:
    """A list of numbers; ValueError naming it, what it is and what is expected."""
    if not isinstance(value, list | tuple | np.ndarray):
        raise ValueError(f"{name} = {value!r}: a list of numbers is expected")
    return tuple(number(f"{name}[{k}]", v) for k, v in enumerate(value))
