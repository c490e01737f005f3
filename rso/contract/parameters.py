"""Knobs: what a parameter of a backend means, its unit, bounds and, of an effect, the value that switches it off."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

Scope = Literal["study", "mounting", "place", "curve"]


@dataclass(frozen=True)
class Parameter:
    """One scalar knob: its meaning, unit, hard bounds and, for an effect, the value that switches it off.

    The value of a category is the number of one of its `choices`, from 0; that of a `whole` one is a whole number.
    """

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
    choices: tuple[str, ...] = ()
    whole: bool = False

    def check(self, value: float) -> float:
        """Return `value` as a float, or raise ValueError naming knob, value, unit and bounds."""
        x = number(self.name, value)
        if (self.choices or self.whole) and x != round(x):
            what = f"the number of one of {', '.join(self.choices)}, from 0" if self.choices else "a whole number"
            raise ValueError(f"{self.name} = {x}: {what} is expected ({self.description})")
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
    declared = Parameter(
        "", description, unit, low, high, start, neutral, group, typical, scope, plausible, cause, label
    )
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


def worded(parameters: tuple[Parameter, ...], values: Mapping[str, float]) -> dict[str, float | int | str]:
    """Values as a model is given them: the text of a category, a whole number as an integer, any other as it is."""
    found: dict[str, float | int | str] = dict(values)
    for p in parameters:
        if p.name in values and (p.choices or p.whole):
            n = round(values[p.name])
            found[p.name] = p.choices[n] if p.choices else n
    return found


def drop_neutral(parameters: tuple[Parameter, ...], values: Mapping[str, float]) -> dict[str, float]:
    """Values without the effects that are switched off: adding an effect later keeps every old key valid."""
    neutral = {p.name: p.neutral for p in parameters if p.neutral is not None}
    return {k: float(v) for k, v in values.items() if k not in neutral or float(v) != neutral[k]}
