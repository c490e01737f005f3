"""[columns]: what the columns of a testing machine's files are called, for all experiments or for one."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, create_model, model_validator

from rso.contract import finite
from rso.measurement import CONTACT, Column
from rso.study.fields import expected, formed
from rso.study.table import Table
from rso.units import BARE_COLUMNS, COLUMN_NAMES, COLUMNS, UNITS, kind_of, worth


def _zeros(value: Any) -> Any:
    """A finite number, a list of them as a tuple, or CONTACT."""
    if value == CONTACT:
        return value
    several = list(value) if isinstance(value, list | tuple) else [value]
    if not several or not all(isinstance(v, int | float) and not isinstance(v, bool) for v in several):
        raise ValueError(f"expected a number, a list with one for each file of an experiment, or {CONTACT!r}")
    if not all(map(finite, several)):
        raise ValueError("must be finite")
    return tuple(map(float, several)) if isinstance(value, list | tuple) else float(value)


class ColumnTable(Table):
    """A column of a machine's files, here that of the depth."""

    header: Annotated[str, formed(r"(?s:.*\S.*)", "must not be blank")]
    """As it stands in the file, exactly."""
    unit: str | None = None
    """Unless the file says it; also what one count is, as 0.00125 mm."""
    flip: bool = False
    """Whether the machine counts with the other sign."""
    zero: Annotated[Any, AfterValidator(_zeros), expected('number, list of numbers or "contact"')] = 0.0
    """Subtracted as the file has it, before the sign is turned; one for each file; depth and Fz may be "contact"."""
    values: dict[str, Literal["loading", "hold", "unloading", "skip"]] | None = None
    """Of `segment` alone: what a machine's codes mean."""


def _fits(name: str, table: ColumnTable | None) -> ColumnTable | None:
    """Unit and sign are such as the column can have."""
    if table is None:
        return None
    if table.flip and name not in COLUMNS:
        raise ValueError(f"flip turns the sign of a measured value; {name} has none")
    if table.zero == CONTACT and name not in ("depth", "Fz"):
        raise ValueError(f"the contact that a record shows is the zero of depth and Fz; {name} has none")
    if table.zero and name not in COLUMNS:
        raise ValueError(f"zero is subtracted from a measured value; {name} is none")
    if table.values is not None and name != "segment":
        raise ValueError(f"values says what the codes of a column of segments mean; {name} has none")
    if table.values is not None and "loading" not in table.values.values():
        raise ValueError('values names no code that is "loading"')
    if table.unit is not None and name in BARE_COLUMNS:
        raise ValueError(f"{name} has no unit")
    if table.unit is not None:
        try:
            worth(table.unit, kind_of(name))
        except ValueError as error:
            choices = f'{UNITS[kind_of(name)]}, or "0.00125 {kind_of(name)}" for what one count is'
            raise ValueError(f"unit = {table.unit!r}: {error}; choose from {choices}") from error
    return table


class _Columns(Table):
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
        return {name: Column(**column.model_dump()) for name, column in self if column is not None}

    def headers(self) -> dict[str, Any]:
        """Known name → header and codes: tables with the same read the same readings, whatever unit, sign or zero."""
        return {name: (column.header, column.values) for name, column in self if column is not None}


ColumnsTable = create_model(
    "ColumnsTable", __base__=_Columns, __doc__=_Columns.__doc__,
    **{n: (Annotated[ColumnTable | None, AfterValidator(partial(_fits, n))], None) for n in COLUMN_NAMES},
)  # fmt: skip
