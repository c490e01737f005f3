"""Numbers read off a response: a channel's value, or a curve's value at an abscissa, its maximum, its integral.

Written as text: ``cost``, ``stress(1.2)``, ``max(stress)``, ``integral(force, 0, 5)``.  Read as data, never executed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso.contract import FreeCurve, Response
from rso.core.units import value_in_unit

ABSCISSA_TOLERANCE = 1e-9  # of the whole abscissa: an end that is missed by less is reached
_OUTPUT_NAME = r"[A-Za-z_]\w*"
_REDUCTION_CALL = re.compile(rf"({_OUTPUT_NAME})\s*\(([^()]*)\)")
_LIMIT_SIGNS = re.compile(r"(<=|>=|<|>)")
_WRITTEN_LIMIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*\S)\s*")
MAX_QUANTITY_CHARACTERS = 200  # of a quantity or a limit as somebody writes it: more is none


class Unread(ValueError):
    """A response does not hold a number that is to be read: which, and why."""


@dataclass(frozen=True)
class OutputQuantity:
    """A number of a run: `how` it is read off the output `name`, with abscissae `at` as they are written."""

    text: str
    name: str
    how: str = "value"
    at: tuple[str | float, ...] = ()

    def unit(self, outputs: Mapping[str, tuple[str, str | None, str]]) -> str:
        """Its unit by the outputs' units, abscissae (None of a scalar) and units of these; ValueError for no reading.

        Distinguishes a scalar from a curve, and an abscissa of another unit.
        """
        unit, over, over_unit = outputs[self.name]
        if over is None and self.how != "value":
            raise ValueError(f"{self.name} is one number, no curve: write {self.name} alone")
        if over is not None and self.how == "value":
            forms = f"{self.name}(1.0), max({self.name}) or integral({self.name})"
            raise ValueError(f"{self.name} is a curve over {over}: say what of it, such as {forms}")
        self.abscissae(over_unit)
        if self.how in ("argmax", "argmin"):
            return over_unit
        if self.how != "integral" or over_unit == "1":
            return unit
        return over_unit if unit == "1" else f"{unit}*{over_unit}"

    def abscissae(self, over_unit: str) -> tuple[float, ...]:
        """The abscissae in the unit of the curve's; ValueError for another kind."""
        return tuple(value_in_unit(v, over_unit) for v in self.at)

    def read(self, response: Response) -> float:
        """The number; Unread where the curve does not reach what is asked of it."""
        if self.how == "value":
            if self.name not in response.channels:
                raise Unread(f"{self.text}: the run has no {self.name}; it has {', '.join(response.channels)}")
            return float(response.channels[self.name][-1])
        curve = self.curve(response)
        at, value = curve.at, curve.value
        asked = self.abscissae(curve.over_unit)
        slack = ABSCISSA_TOLERANCE * float(np.ptp(at))
        if asked and not (at[0] - slack <= min(asked) and max(asked) <= at[-1] + slack):
            raise Unread(f"{self.text}: the curve is there from {at[0]:g} to {at[-1]:g} {curve.over_unit}")
        if self.how == "at":
            return float(np.interp(asked[0], at, value))
        if asked:
            inner = at[(at > asked[0]) & (at < asked[1])]
            at, value = (grid := np.concatenate([[asked[0]], inner, [asked[1]]])), np.interp(grid, at, value)
        return float(REDUCTIONS[self.how](at, value))

    def curve(self, response: Response) -> FreeCurve:
        """The curve that it is read off: one of its own abscissa, else a channel over travel."""
        if self.name in response.curves:
            return response.curves[self.name]
        if self.name not in response.channels:
            raise Unread(f"{self.text}: the run has no {self.name}")
        channel = response.curve(self.name)
        return FreeCurve(channel.travel_mm, channel.value, channel.unit, "travel", "mm")


REDUCTIONS = {  # of a curve: abscissa (n,), values (n,) → a number; between two abscissae where these are stated
    "max": lambda at, value: value.max(),
    "min": lambda at, value: value.min(),
    "max_abs": lambda at, value: np.abs(value).max(),
    "mean": lambda at, value: value[0] if len(at) < 2 else np.trapezoid(value, at) / np.ptp(at),
    "integral": lambda at, value: np.trapezoid(value, at),
    "argmax": lambda at, value: at[value.argmax()],
    "argmin": lambda at, value: at[value.argmin()],
    "first": lambda at, value: value[0],
    "last": lambda at, value: value[-1],
}


@dataclass(frozen=True)
class Limits:
    """A quantity that must stay within `low` and `high`, as they are written; None where it has no such end."""

    text: str
    quantity: OutputQuantity
    low: str | float | None
    high: str | float | None


def read_quantity(text: str) -> OutputQuantity:
    """``cost``, ``stress(1.2)``, ``max(stress)``, ``max(stress, 0, 1.2)``; ValueError saying what there is."""
    written = text.strip()
    if len(written) > MAX_QUANTITY_CHARACTERS:
        raise ValueError(f"a quantity has at most {MAX_QUANTITY_CHARACTERS} characters, not {len(written)}")
    if re.fullmatch(_OUTPUT_NAME, written):
        return OutputQuantity(written, written)
    match = _REDUCTION_CALL.fullmatch(written)
    forms = f"an output such as cost, a value at an abscissa such as stress(1.2), or {', '.join(REDUCTIONS)} of a curve"
    if match is None:
        raise ValueError(f"{written!r} is no quantity: expected is {forms}")
    word, inner = match[1], [p.strip() for p in match[2].split(",")]
    if word not in REDUCTIONS:
        if len(inner) != 1 or not inner[0]:
            raise ValueError(f"{written!r}: one abscissa is expected, such as {word}(1.2); or {forms}")
        return OutputQuantity(written, word, "at", (_number(inner[0]),))
    name, *ends = inner
    if not re.fullmatch(_OUTPUT_NAME, name) or len(ends) not in (0, 2):
        raise ValueError(f"{written!r}: expected is {word}(CURVE) or {word}(CURVE, FROM, TO)")
    at = tuple(_number(e) for e in ends)
    if len(at) == 2 and all(isinstance(v, float) for v in at) and not float(at[0]) < float(at[1]):
        raise ValueError(f"{written!r}: from must be below to")
    return OutputQuantity(written, name, word, at)


def read_limits(text: str) -> Limits:
    """``max(stress) <= 250 MPa``, ``0.1 <= gap <= 0.3``; ValueError for anything else."""
    written = text.strip()
    if len(written) > MAX_QUANTITY_CHARACTERS:
        raise ValueError(f"a constraint has at most {MAX_QUANTITY_CHARACTERS} characters, not {len(written)}")
    parts = [p.strip() for p in _LIMIT_SIGNS.split(written)]
    values, signs = parts[::2], parts[1::2]
    good = len(signs) in (1, 2) and all(values) and len({s[0] for s in signs}) == 1
    if not good:
        raise ValueError(f"{written!r} is no constraint: expected is max(stress) <= 250, or 0.1 <= gap <= 0.3")
    if signs[0][0] == ">":
        values = values[::-1]
    if len(values) == 3:
        low, asked, high = values
    else:
        low, asked, high = ("", *values) if not _numeric(values[0]) else (*values, "")
    if _numeric(asked) or not all(v == "" or _numeric(v) for v in (low, high)):
        raise ValueError(f"{written!r}: one output between numbers is expected, such as max(stress) <= 250")
    ends = [None if v == "" else _number(v) for v in (low, high)]
    if all(isinstance(v, float) for v in ends) and not float(ends[0]) <= float(ends[1]):  # type: ignore[arg-type]
        raise ValueError(f"{written!r}: the lower end is above the upper one")
    return Limits(written, read_quantity(asked), *ends)


def _numeric(text: str) -> bool:
    return re.match(r"[+-]?(?:\d|\.\d)", text) is not None


def _number(text: str) -> str | float:
    """A number, or text with a unit that is read where the unit is known."""
    if not _numeric(text):
        raise ValueError(f"{text!r} is no number")
    try:
        return float(text)
    except ValueError:
        return text


def limit_in_unit(value: str | float | None, unit: str, otherwise: float) -> float:
    """An end of limits in the unit of its quantity, also one that no table of units has; ValueError for another."""
    if value is None:
        return otherwise
    match = _WRITTEN_LIMIT.fullmatch(value) if isinstance(value, str) else None
    return float(match[1]) if match and match[2] == unit else value_in_unit(value, unit)
