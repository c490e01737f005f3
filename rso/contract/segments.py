"""Segments of a programme, each controlled by travel or by force."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rso.contract.parameters import number

CONTROLS = {"travel": "mm", "force": "N"}  # what a segment may control, and its unit


@dataclass(frozen=True)
class Segment:
    """One part of a programme: what is controlled moves at a constant `rate` to its end, or rests for `hold_s`.

    `control` is "travel" (mm, positive into the body) or "force" (N, that of the specimen on the indenter along its
    way, positive where it pushes back); `rate` in that unit per s, positive.  A moving segment ends at `to_mm` or
    `to_N`; one of travel may end at a force (an approach to a preload), and one of force at a force only.  A rest keeps
    what is controlled at the value that it began with.  Channels are returned `asked_s` after the segment began, too.
    Raises ValueError naming key, value and choices.
    """

    control: str
    rate: float | None = None
    to_mm: float | None = None
    to_N: float | None = None
    hold_s: float | None = None
    asked_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.control not in CONTROLS:
            raise ValueError(f"control = {self.control!r}: choose from {', '.join(CONTROLS)}")
        for name in ("rate", "to_mm", "to_N", "hold_s"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _finite(name, value))
        object.__setattr__(self, "asked_s", tuple(_finite("asked_s", v) for v in self.asked_s))
        unit = f"{CONTROLS[self.control]}/s"
        if self.hold_s is not None:
            if any(v is not None for v in (self.rate, self.to_mm, self.to_N)):
                raise ValueError("hold_s: a rest has no rate, to_mm or to_N; make it a segment of its own")
            if self.hold_s <= 0.0:
                raise ValueError(f"hold_s = {self.hold_s:g} s: a rest lasts longer than 0 s")
        else:
            if (self.to_mm is None) == (self.to_N is None):
                raise ValueError("one of to_mm, to_N (where it ends) or hold_s (how long it rests) is needed")
            if self.control == "force" and self.to_mm is not None:
                raise ValueError('to_mm: a segment with control = "force" ends at a force, to_N')
            if self.rate is None or self.rate <= 0.0:
                raise ValueError(f"rate = {self.rate} {unit}: a positive rate is needed")
        if any(b <= a for a, b in zip((0.0, *self.asked_s), self.asked_s, strict=False)):
            raise ValueError(f"asked_s = {list(self.asked_s)}: moments after its beginning, in increasing order")
        if self.hold_s is not None and self.asked_s and self.asked_s[-1] > self.hold_s * (1.0 + 1e-12):
            raise ValueError(f"asked_s = {list(self.asked_s)}: at most hold_s = {self.hold_s:g} s")

    def lasts(self, begins: Mapping[str, float | None]) -> float | None:
        """Its duration (s) where it `begins` at a travel and a force, None for what is not known before it is run."""
        if self.hold_s is not None:
            return self.hold_s
        ends = {"travel": self.to_mm, "force": self.to_N}[self.control]
        start = begins[self.control]
        assert self.rate is not None
        return None if ends is None or start is None else abs(ends - start) / self.rate

    def plain(self) -> dict[str, Any]:
        """What is stated of it, as plain data: what a later version adds changes no key of a run."""
        return {k: v for k, v in dataclasses.asdict(self).items() if v is not None and v != ()}

    @classmethod
    def read(cls, name: str, data: Any) -> Segment:
        """A segment from plain data; ValueError naming it, key and choices."""
        known = [f.name for f in dataclasses.fields(cls)]
        if not isinstance(data, Mapping):
            raise ValueError(f"{name} = {data!r}: a table with the keys {', '.join(known)} is expected")
        unknown = sorted(set(data) - set(known))
        if unknown:
            raise ValueError(f"{name}.{unknown[0]}: unknown; choose from {', '.join(known)}")
        if "control" not in data:
            raise ValueError(f"{name}.control: missing; choose from {', '.join(CONTROLS)}")
        given = dict(data)
        if "asked_s" in given and not isinstance(given["asked_s"], list | tuple):
            raise ValueError(f"{name}.asked_s = {given['asked_s']!r}: a list of numbers is expected")
        try:
            return cls(**{**given, "asked_s": tuple(given.get("asked_s", ()))})
        except (ValueError, TypeError) as error:
            raise ValueError(f"{name}.{error}") from None


def clock(segments: Sequence[Segment]) -> list[float | None]:
    """When (s) each segment ends, None from the first on whose duration is not known before the programme is run."""
    now: float | None = 0.0
    at: dict[str, float | None] = {"travel": 0.0, "force": 0.0}
    ends: list[float | None] = []
    for s in segments:
        duration = s.lasts(at)
        now = None if now is None or duration is None else now + duration
        ends.append(now)
        stays = s.hold_s is not None
        own = {"travel": s.to_mm, "force": s.to_N}
        at = {k: (at[k] if k == s.control else None) if stays else own[k] for k in at}
    return ends


def refuse_together(segments: Sequence[Segment]) -> None:
    """Raise ValueError for segments, each right by itself, that cannot follow each other."""
    at: dict[str, float | None] = {"travel": 0.0, "force": 0.0}
    pressed = False
    for k, s in enumerate(segments):
        name = f"segments[{k}]"
        if s.hold_s is None:
            to, unit = (s.to_mm, "mm") if s.to_mm is not None else (s.to_N, "N")
            start = at["travel" if unit == "mm" else "force"]
            if start is not None and start == to:
                raise ValueError(f"{name}: it ends at {to:g} {unit}, where it begins; a rest is hold_s")
            pressed = pressed or (to or 0.0) > 0.0
            duration = s.lasts(at)
            if duration is not None and s.asked_s and s.asked_s[-1] > duration * (1.0 + 1e-12):
                raise ValueError(f"{name}.asked_s = {list(s.asked_s)}: at most {duration:g} s, how long it lasts")
        elif s.control == "force" and not pressed:
            raise ValueError(f"{name}: a rest at a force comes after a segment that presses, to_mm or to_N above 0")
        own = {"travel": s.to_mm, "force": s.to_N}
        at = {k: (at[k] if k == s.control else None) if s.hold_s is not None else own[k] for k in at}
    if not pressed:
        raise ValueError("segments: none of them presses; one must go to a positive to_mm or to_N")


def _finite(name: str, value: Any) -> float:
    found = number(name, value)
    if not math.isfinite(found):
        raise ValueError(f"{name} = {found}: a finite number is expected")
    return found
