"""A spreadsheet's workbook (.xlsx) as the text that its sheet of readings would be saved as: cells between tabs."""

from __future__ import annotations

import datetime
import io
import warnings
import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

from rso.measurement.columns import is_number

BEGINS = b"PK\x03\x04"  # a zip archive, which such a file is
FEWEST = 4  # rows of two numbers and more: readings


def text_of_workbook(path: Path, raw: bytes) -> str:
    """The one sheet that holds readings, a line for each row; ValueError for none, several, and other archives.

    Numbers are written to all their digits, however the sheet shows them, and formulas by the values last computed.
    """
    from openpyxl import load_workbook  # only who has such a file waits for it
    from openpyxl.utils.exceptions import InvalidFileException

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # styles and validations that it does not know
            book = load_workbook(io.BytesIO(raw), read_only=True, data_only=True)
            sheets = {s.title: [list(row) for row in s.iter_rows(values_only=True)] for s in book.worksheets}
    # SyntaxError: of what the sheets are written in; the library does not catch it.
    except (BadZipFile, InvalidFileException, KeyError, ValueError, OSError, SyntaxError, zlib.error) as error:
        raise ValueError(
            f"{path}: is a zip archive and no workbook (.xlsx) that can be read; save it as CSV"
        ) from error
    found = {title: rows for title, rows in sheets.items() if sum(map(_is_reading, rows)) >= FEWEST}
    if len(found) != 1:
        names = ", ".join(map(repr, found or sheets))
        many = f"{len(found)} of its sheets hold readings ({names}): save each as a file of its own"
        none = (
            f"none of its sheets ({names}) holds {FEWEST} rows of numbers; formulas that were never computed hold none"
        )
        raise ValueError(f"{path}: {many if found else none}")
    return "".join("\t".join(map(_written, row)) + "\n" for row in next(iter(found.values())))


def _is_reading(row: list[Any]) -> bool:
    return sum(is_number(_written(v)) for v in row) > 1


def _written(value: Any) -> str:
    """A cell as a CSV file would hold it; what would part cells or lines there is a blank."""
    if value is None:
        return ""
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    return " ".join(value.split()) if isinstance(value, str) else str(value)
