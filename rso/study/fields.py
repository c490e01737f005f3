"""Kinds of values in a study file: quantities with their units, names, counts, settings."""

from __future__ import annotations

import datetime
import re
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from rso.contract import finite
from rso.core.printable import printable
from rso.core.units import value_in_unit


def list_to_tuple(value: Any) -> Any:
    """A list as a tuple, so that tables stay frozen; anything else as it is."""
    return tuple(value) if isinstance(value, list) else value


def one_or_more(value: Any) -> Any:
    """A file or a list of files as a tuple."""
    if not isinstance(value, str | list | tuple):
        raise ValueError('expected a file such as "measured/top.csv", or a list of files, one for each repeat')
    return (value,) if isinstance(value, str) else tuple(value)


def as_written(value: Any) -> Any:
    """A bound: a finite bare number, or text that will be read with the parameter's unit."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError('expected a number or text with a unit, for example 0.0032 or "3.2 kPa"')
    if not isinstance(value, str) and not finite(value):
        raise ValueError("expected a finite number")
    return value


def json_settings(value: Any) -> Any:
    """Settings travel to the backend as JSON: no dates, no NaN, no infinity."""
    if isinstance(value, dict):
        for v in value.values():
            json_settings(v)
    elif isinstance(value, list):
        for v in value:
            json_settings(v)
    elif isinstance(value, datetime.date | datetime.time) or (type(value) in (int, float) and not finite(value)):
        text = f"{str(value)[:20]} cannot be handed to a backend"
        raise ValueError(f"{text}; allowed are text, finite numbers, booleans, tables")
    return value


def listed_once(value: tuple[Any, ...]) -> tuple[Any, ...]:
    """What is read counts once: nothing is listed twice."""
    if twice := [v for k, v in enumerate(value) if v in value[:k]]:
        raise ValueError(f"{twice[0]!r} is listed twice; a reading counts once")
    return value


def power_of_two(value: int) -> int:
    """A number of points of a Sobol sequence, whose balance is that of powers of two."""
    if value < 4 or value & (value - 1):
        below = 2 ** max(2, value.bit_length() - 1)
        choices = "4" if value < 4 else f"{below} or {2 * below}"
        raise ValueError(f"points of a Sobol sequence come in powers of two, at least 4: take {choices}")
    return value


def even(value: int) -> int:
    """A number of individuals that mate in pairs."""
    if value % 2:
        raise ValueError(f"individuals mate in pairs, an even number is expected: take {value + 1}")
    return value


def names_of_effects(value: Any) -> Any:
    """The word all, or names of effects."""
    if value == "all" or (isinstance(value, list) and all(isinstance(v, str) for v in value)):
        return list_to_tuple(value)
    raise ValueError('expected "all" or a list of effects such as ["friction", "compliance"]')


def quantity_in(unit: str) -> BeforeValidator:
    """A number with or without its unit, in `unit`."""
    return BeforeValidator(lambda value: value_in_unit(value, unit))


def formed(pattern: str, words: str) -> AfterValidator:
    """Text of a form, which is said in words where it has another."""

    def check(value: str) -> str:
        if re.fullmatch(pattern, value) is None:
            raise ValueError(words)
        return value

    return AfterValidator(check)


def visible_line(value: str) -> str:
    """Text of one line in which every character is seen: it stands in titles and on terminals."""
    if printable(value) != value or "\n" in value:
        raise ValueError("holds characters that are not seen (line ends, controls, marks of direction): leave them out")
    return value


TEXT_SCHEMA = {"type": "string"}


def expected(words: str) -> Any:
    """What is allowed, in words, where the type does not show (see :mod:`rso.study.keys`)."""
    return Field(json_schema_extra={"expected": words})


def also(*schemas: dict[str, Any]) -> Any:
    """What a file may say in place of this, as JSON schemas (see :func:`rso.study.keys.study_schema`)."""
    return Field(json_schema_extra={"or": list(schemas)})


ONE_OR_MORE = Field(json_schema_extra={"alone": True})  # a list that a file may say by its only member


def number_in(
    unit: str, *, gt: float | None = None, ge: float | None = None, lt: float | None = None, le: float | None = None
) -> Any:
    """A number within bounds, as text with its unit or bare in `unit`."""
    return Annotated[float, quantity_in(unit), Field(json_schema_extra={"unit": unit}, gt=gt, ge=ge, lt=lt, le=le)]


Bound = Annotated[Any, AfterValidator(as_written), expected('number, or text with a unit such as "3.2 kPa"')]
Settings = Annotated[dict[str, Any], AfterValidator(json_settings)]
Names = Annotated[tuple[str, ...], BeforeValidator(list_to_tuple)]
Channels = Annotated[Names, AfterValidator(listed_once)]
Files = Annotated[
    tuple[Annotated[str, Field(min_length=1)], ...],
    BeforeValidator(one_or_more),
    Field(min_length=1, json_schema_extra={"expected": "a file, or a list of files", "alone": True}),
]
_NAME_FORM = (
    "expected is a name of letters, digits, blanks and . + - _, at most 64, that begins with a letter, digit or _"
)
Name = Annotated[str, formed(r"\w[\w .+-]{0,63}", _NAME_FORM)]
NotNegativeForce = number_in("N", ge=0, le=1e6)
NotNegativeLength = number_in("mm", ge=0, le=1e6)
Depth = number_in("mm", gt=0, le=1e6)
Share = number_in("1", ge=0, lt=1)
Tolerance = number_in("1", gt=0, lt=1)
Confidence = number_in("1", gt=0.5, lt=1)
Duration = number_in("s", gt=0)
Moment = number_in("s", ge=0)
Stiffness = number_in("N/mm", gt=0)
Compliance = number_in("mm/N", gt=0)
Force = number_in("N", gt=0)
Count = Annotated[int, Field(ge=0, le=10_000_000)]
Runs = Annotated[int, Field(ge=1, le=10_000)]
Positive = Annotated[int, Field(ge=1, le=10_000_000)]
