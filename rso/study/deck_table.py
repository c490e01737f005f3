"""[backend] of a program with input files: templates, results, what means failure; and its parameters."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from rso.contract import Parameter
from rso.core.similarity import stress_exponent
from rso.core.units import CHANNEL_UNITS, conversion_factor, in_base, is_of, value_in_unit
from rso.evaluation.decks import READERS, DeckOutput, Failure
from rso.study.base_table import StudyFileTable
from rso.study.fields import Names, list_to_tuple

HARD_BOUND_RATIO = 1e6  # times a range: how far a modulus may leave it, as similarity sees to
_PYTHON_FUNCTION = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
READER_KEYS = {  # of readers, beside those that all have
    "table": {"column"},
    "regex": {"pattern"},
    "calculix": {"set", "column"},
    "febio": {"column", "item"},
}
NEEDED_READER_KEYS = {"table": (), "regex": ("pattern",), "calculix": ("set", "column"), "febio": ("column",)}


def _reader(value: str) -> str:
    if value in READERS or _PYTHON_FUNCTION.fullmatch(value):
        return value
    raise ValueError(f'choose from {", ".join(READERS)}, or a Python function "module:function"')


def _pattern(value: str) -> str:
    try:
        re.compile(value)
    except re.error as error:
        raise ValueError(f"is no regular expression: {error}") from None
    return value


Pattern = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_pattern)]
Column = str | Annotated[int, Field(ge=1)]


class OutputTable(StudyFileTable):
    """[backend.outputs]: where the program writes a channel."""

    file: Annotated[str, Field(min_length=1)]
    """The file, as seen from the folder of the run."""
    reader: Annotated[
        str, AfterValidator(_reader), Field(json_schema_extra={"expected": " | ".join([*READERS, "module:function"])})
    ] = "table"
    """A table of numbers, a regular expression, a .dat file of CalculiX, a log file of FEBio, or a Python function.
    The function is given the path and returns values, or a pair of what they belong to and values."""
    column: Column | None = None
    """Its name, or its number from 1; of CalculiX the component such as fx."""
    pattern: Pattern | None = None
    """A regular expression with a group (value) and, where it has one, a group at."""
    set: str | None = None
    """The set of nodes of CalculiX."""
    item: int | None = None
    """The row of FEBio's records, by its number; by default all are summed."""
    unit: str | None = None
    """The unit of what is written; by default the one in which the channel is compared."""
    factor: float = 1.0
    """What the numbers are multiplied by: -1 turns a reaction, 4 completes a quarter."""
    at: Literal["order", "step", "time", "travel"] | None = None
    """What a value belongs to: asked travels in order, steps of time 1 each, a time or a travel; between rows it is
    interpolated. By default step for CalculiX, time for FEBio, else order."""
    at_column: Column | None = None
    """The column of times or travels."""
    at_unit: str | None = None
    """Its unit; by default s, or mm."""
    at_factor: float = 1.0
    """What times or travels are multiplied by."""
    over: str | None = None
    """Of a curve over an abscissa of its own: its name, as "stretch" or "frequency"; at_column says where it is,
    at_unit its unit."""

    @model_validator(mode="after")
    def _keys_of_its_reader(self) -> OutputTable:
        own = READER_KEYS.get(self.reader, set())
        every = set().union(*READER_KEYS.values())
        if wrong := [k for k in every if k in self.model_fields_set and k not in own]:
            raise ValueError(f"{wrong[0]} is no key of the reader {self.reader!r}")
        if lost := [k for k in NEEDED_READER_KEYS.get(self.reader, ()) if getattr(self, k) is None]:
            raise ValueError(f"the reader {self.reader!r} needs {lost[0]}")
        if self.over is not None and (self.at is not None or self.at_column is None):
            raise ValueError("over names an abscissa: give at_column, the column that holds it, and no at")
        if self.at_unit is not None and self.over is None and self.at not in ("time", "travel"):
            raise ValueError('at_unit is that of a time or a travel: give at = "time" or at = "travel"')
        return self

    def output(self, channel: str) -> DeckOutput:
        """What is read, in the unit of the channel; ValueError for a unit of another kind."""
        base = CHANNEL_UNITS.get(channel) or ("1" if self.unit is None else _base(self.unit))
        default = {"calculix": "step", "febio": "time"}.get(self.reader, "order")
        at = self.at or default
        scale, over_unit = 1.0, "1"
        if self.over is not None and self.at_unit is not None:
            over_unit = _base(self.at_unit)
            scale = float(conversion_factor(self.at_unit, over_unit))
        elif self.at_unit is not None:
            scale = float(conversion_factor(self.at_unit, {"time": "s", "travel": "mm"}[at]))
        given = {k: getattr(self, k) for k in ("column", "item", "at_column")}
        return DeckOutput(
            channel,
            base,
            self.file,
            self.reader,
            self.factor * (1.0 if self.unit is None else float(conversion_factor(self.unit, base))),
            pattern=self.pattern or "",
            set=self.set or "",
            at=at,
            at_factor=self.at_factor * scale,
            over=self.over or "",
            over_unit=over_unit,
            **given,
        )


def _base(unit: str) -> str:
    return in_base(f"1 {unit}")[1]


class FailureTable(StudyFileTable):
    """[backend.failed]: what in the output means that there is no answer."""

    pattern: Pattern
    """A regular expression, searched in what the program prints and in the files of its outputs."""
    files: Names = ()
    """Further files in which it is searched, such as job.sta."""
    cause: Literal["step_limit", "contact", "inversion", "instability", "bad_geometry", "inadmissible"] = "step_limit"
    """What such a failure is counted as."""

    def failure(self) -> Failure:
        """The same as the backend has it."""
        return Failure(self.pattern, self.files, self.cause)


def pattern_alone(value: Any) -> Any:
    """The short form of a failure, the pattern alone."""
    return {"pattern": value} if isinstance(value, str) else value


def two_marks(value: Any) -> Any:
    """Delimiters: two different texts."""
    given = list_to_tuple(value)
    if not (isinstance(given, tuple) and len(given) == 2 and all(isinstance(v, str) and v.strip() for v in given)):
        raise ValueError('expected two texts such as ["<<", ">>"]')
    return given


def deck_parameter(name: str, table: Any) -> tuple[Parameter, tuple[float, float]]:
    """A parameter that a study declares by its line in [parameters], and its range.

    The unit is that stated, or that of its values.  A positive parameter whose unit holds a stress may leave its range,
    as similarity scales it with the modulus; any other stays in it, unless `bounds` says more.  A fixed value keeps its
    sign and may be up to twice as large: [uncertainty] says how far it is off.  Raises ValueError for a
    unit that there is not, values of different kinds, and bounds that do not hold the range.
    """
    if table.choices is not None:
        high = len(table.choices) - 1.0
        declared = Parameter(name, table.description or name, "1", 0.0, high, choices=tuple(table.choices))
        return declared, (0.0, high)
    written = [v for v in (table.low, table.high, table.value, *(table.values or ())) if v is not None]
    units = [in_base(v)[1] for v in written if isinstance(v, str)]
    unit = table.unit or next(iter(units), "1")
    if table.unit is not None:
        base = _base(table.unit)
        if base != table.unit and not is_of(base, table.unit):
            raise ValueError(f"unit = {table.unit!r} is not known")
        if table.unit not in (base, "1") and any(not isinstance(v, str) for v in written):
            raise ValueError(f"unit = {table.unit!r}: bare numbers are in {base}; write them with their unit")
        unit = base
    values = [value_in_unit(v, unit) for v in written]
    low, high = min(values), max(values)
    if table.bounds is not None:
        first, last = (value_in_unit(v, unit) for v in table.bounds)
        if not first <= low <= high <= last:
            raise ValueError(f"bounds = {list(table.bounds)} do not hold {low:g} to {high:g} {unit}")
        return Parameter(name, table.description or name, unit, first, last, whole=table.whole), (low, high)
    scaled = low > 0 and _of_stress(unit) and table.values is None and not table.whole
    hard = (low / HARD_BOUND_RATIO, high * HARD_BOUND_RATIO) if scaled else (low, high)
    if table.value is not None and not (scaled or table.whole):
        hard = (min(0.0, 2.0 * low), max(0.0, 2.0 * high))
    return Parameter(name, table.description or name, unit, *hard, whole=table.whole), (low, high)


def _of_stress(unit: str) -> bool:
    try:
        return stress_exponent(unit) != 0
    except ValueError:
        return False


def names_of_settings(tables: Iterable[Mapping[str, Any]], above: str = "") -> tuple[str, ...]:
    """Names of all settings as placeholders write them: ``mesh.size`` is one within a table."""
    found: dict[str, None] = {}
    for table in tables:
        for key, value in table.items():
            inner = names_of_settings([value], f"{above}{key}.") if isinstance(value, Mapping) else (f"{above}{key}",)
            found |= dict.fromkeys(inner)
    return tuple(found)
