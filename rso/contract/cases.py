"""What is asked of a backend: a programme of travel over time, and the backend's own settings."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rso.contract.parameters import number
from rso.contract.plain_data import object_path, plain


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

    def passages(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) s and travels (n,) mm of all passages of asked travels and all asked moments, in order of time."""
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
