"""[columns]: what the columns of a testing machine's files are called, for all experiments or for one."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, create_model, model_validator

from rso.contract import finite
from rso.core.units import BARE_COLUMNS, COLUMN_NAMES, COLUMN_UNITS, UNITS_OF_KIND, kind_of, unit_or_count_factor
from rso.data import ZERO_AT_CONTACT, Column
from rso.study.base_table import StudyFileTable
from rso.study.fields import Compliance, Stiffness, expected, formed


def _zeros(value: Any) -> Any:
    """A finite number, a list of them as a tuple, or ZERO_AT_CONTACT."""
    if value == ZERO_AT_CONTACT:
        return value
    several = list(value) if isinstance(value, list | tuple) else [value]
    if not several or not all(isinstance(v, int | float) and not isinstance(v, bool) for v in several):
        raise ValueError(f"expected a number, a list with one for each file of an experiment, or {ZERO_AT_CONTACT!r}")
    if not all(map(finite, several)):
        raise ValueError("must be finite")
    return tuple(map(float, several)) if isinstance(value, list | tuple) else float(value)


Header = Annotated[str, formed(r"(?s:.*\S.*)", "must not be blank")]


class MinusTable(StudyFileTable):
    """What is subtracted of depth: a cantilever's deflection, or what a frame gives way under a force.

    `depth = ±(header − zero) − minus`: each column is turned to its own sign first."""

    header: Header
    """As it stands in the file, exactly; Fz may be read from the same column."""
    unit: str | None = None
    """Unless the file says it; also what one count is, as 62 nm for a volt of a photodiode."""
    flip: bool = False
    """Whether it falls while the indenter is pressed back."""
    stiffness: Stiffness | None = None
    """Where the column is a force: of what it bends, as "0.0876 N/m"."""
    compliance: Compliance | None = None
    """Or by how much the frame gives way under it, as "0.44 mm/N"."""

    @model_validator(mode="after")
    def _one_of(self) -> MinusTable:
        if self.stiffness is not None and self.compliance is not None:
            raise ValueError("compliance is 1 / stiffness: leave one of them out")
        if self.unit is not None:
            bends = self.stiffness is not None or self.compliance is not None
            _known(self.unit, "N" if bends else "mm", "" if bends else FORCE_SUBTRACTION_ADVICE)
        return self


class ColumnTable(StudyFileTable):
    """A column of a machine's files, here that of the depth."""

    header: Header
    """As it stands in the file, exactly."""
    unit: str | None = None
    """Unless the file says it; also what one count is, as 0.00125 mm."""
    flip: bool = False
    """Whether the machine counts with the other sign."""
    zero: Annotated[Any, AfterValidator(_zeros), expected('number, list of numbers or "contact"')] = 0.0
    """Subtracted as the file has it, before the sign is turned; one for each file; depth and Fz may be "contact"."""
    values: dict[str, Literal["loading", "hold", "creep", "unloading", "skip"]] | None = None
    """Of `segment` alone: what a machine's codes mean; a hold keeps its depth, creep its force."""
    minus: MinusTable | None = None
    """Of `depth` alone: subtracted after zero and sign of the column itself."""
    stiffness: Stiffness | None = None
    """Of forces alone: the column is a deflection, which this multiplies, as "0.0876 N/m"."""


def _fits(name: str, table: ColumnTable | None) -> ColumnTable | None:
    """Unit and sign are such as the column can have."""
    if table is None:
        return None
    if table.flip and name not in COLUMN_UNITS:
        raise ValueError(f"flip turns the sign of a measured value; {name} has none")
    if table.zero == ZERO_AT_CONTACT and name not in ("depth", "Fz"):
        raise ValueError(f"the contact that a record shows is the zero of depth and Fz; {name} has none")
    if table.zero and name not in COLUMN_UNITS:
        raise ValueError(f"zero is subtracted from a measured value; {name} is none")
    if table.values is not None and name != "segment":
        raise ValueError(f"values says what the codes of a column of segments mean; {name} has none")
    if table.values is not None and "loading" not in table.values.values():
        raise ValueError('values names no code that is "loading"')
    if table.unit is not None and name in BARE_COLUMNS:
        raise ValueError(f"{name} has no unit")
    if table.minus is not None and name != "depth":
        raise ValueError(f"minus is what is subtracted of depth; {name} has none")
    if table.minus is not None and table.minus.header.strip() == table.header.strip():
        raise ValueError(f"minus has the header of depth itself, {table.header!r}: nothing would be left")
    if table.stiffness is not None and kind_of(name) != "N":
        own = "; where minus of depth is a force, its stiffness stands there" if name == "depth" else ""
        raise ValueError(f"stiffness makes a force of a deflection; {name} is none{own}")
    if table.unit is not None:
        bends = "; stiffness makes a force of a deflection: leave it out where the column is a force"
        _known(table.unit, "mm" if table.stiffness else kind_of(name), bends if table.stiffness else "")
    return table


FORCE_SUBTRACTION_ADVICE = "; a force is subtracted with the stiffness or compliance of what it bends"


def _known(unit: str, base: str, more: str) -> None:
    """ValueError for text that is no unit of a kind, nor what one count is."""
    try:
        unit_or_count_factor(unit, base)
    except ValueError as error:
        choices = f'{UNITS_OF_KIND[base]}, or "0.00125 {base}" for what one count is'
        raise ValueError(f"unit = {unit!r}: {error}; choose from {choices}{more}") from error


class _Columns(StudyFileTable):
    """[columns]: what the columns of a testing machine's files are called, by their known names."""

    @model_validator(mode="after")
    def _headers_apart(self) -> _Columns:
        names: dict[str, str] = {}
        for name, column in self:
            if column is not None and names.setdefault(column.header.strip(), name) != name:
                raise ValueError(f"{names[column.header.strip()]} and {name} have the same header {column.header!r}")
        return self

    def columns(self) -> dict[str, Column]:
        """The same as plain dataclasses, by known name; nothing where files are read by their own headers."""
        return {name: _plain(column) for name, column in self if column is not None}

    def headers(self) -> dict[str, Any]:
        """Known name → header and codes: tables with the same read the same readings, whatever unit, sign or zero."""
        return {name: (column.header, column.values) for name, column in self if column is not None}


def _plain(table: ColumnTable) -> Column:
    """A column as a plain dataclass."""
    values = table.model_dump()
    less = values.pop("minus")
    return Column(**values, minus=None if less is None else Column(**less))


_fields: dict[str, Any] = {
    n: (Annotated[ColumnTable | None, AfterValidator(partial(_fits, n))], None) for n in COLUMN_NAMES
}
if TYPE_CHECKING:
    ColumnsTable = _Columns
else:
    ColumnsTable = create_model("ColumnsTable", __base__=_Columns, __doc__=_Columns.__doc__, **_fields)
