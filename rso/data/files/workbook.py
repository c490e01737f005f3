"""A spreadsheet's workbook (.xlsx) as the text that its sheet of readings would be saved as: cells between tabs."""

from __future__ import annotations

import datetime
import io
import itertools
import re
import warnings
import zlib
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

from rso.core.units import is_unit
from rso.data.files.columns import UNIT_IN_CELL_ADVICE, is_number, unit_of_cell

ZIP_START = b"PK\x03\x04"  # a zip archive, which such a file is
MIN_SHEET_READINGS = 4  # rows of two numbers and more: readings
FULL_COLUMN_SHARE = 0.5  # of the readings: a column of the table holds as many values
MAX_UNPACKED_BYTES = 128_000_000  # bytes of all parts: a million rows of three columns
MAX_SHEET_CELLS = 5_000_000  # of a sheet
UNPACKING_PIECE_BYTES = 1 << 20  # unpacked at a time, so that a bomb is stopped early
MAX_LISTED_SHEETS = 8  # names of sheets in a message
TABLE_ENDINGS = (".csv", ".txt", ".dat", ".tsv", ".asc", ".xlsx")  # of files in an archive that may hold readings
# Of the libraries, which take for granted that what they read is a workbook; SyntaxError: of the sheets' language.
DAMAGES: tuple[type[Exception], ...] = (
    BadZipFile,
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
    OSError,
    SyntaxError,
    ArithmeticError,
    NotImplementedError,
    RuntimeError,
    EOFError,
    zlib.error,
)
_FILE_AND_SHEET = re.compile(r"(.+\.xlsx)#(.+)", re.IGNORECASE | re.DOTALL)
_FILE_AND_BLOCK = re.compile(r"(.+)#([1-9]\d{0,3})", re.DOTALL)


def sheet_of(path: Path) -> tuple[Path, str]:
    """The file of a measurement and, of "book.xlsx#Sheet", the sheet, of "file.txt#2" the block, of "book.xlsx#Sheet#2"
    both, else nothing.

    A file of that whole name comes first.
    """
    match = _FILE_AND_SHEET.fullmatch(str(path)) or _FILE_AND_BLOCK.fullmatch(str(path))
    return (path, "") if match is None or path.is_file() else (Path(match[1]), match[2])


def block_of(path: Path) -> int:
    """The number of the block that "file.txt#2" or "book.xlsx#Sheet#2" names; 0 for a whole file or sheet."""
    file, name = sheet_of(path)
    if file.suffix.lower() == ".xlsx":
        match = _FILE_AND_BLOCK.fullmatch(name)
        return int(match[2]) if match else 0
    return int(name or 0)


def sheet_without_block(name: str) -> str:
    """The sheet of "Sheet#2", which also names a table in it."""
    match = _FILE_AND_BLOCK.fullmatch(name)
    return match[1] if match else name


def text_of_workbook(path: Path, raw: bytes, sheet: str = "") -> tuple[str, list[str]]:
    """The named sheet, or the one that holds readings, a line for each row, and remarks; ValueError for none, several,
    and other archives.

    Numbers are written to all their digits, however the sheet shows them, and formulas by the values last computed.
    What somebody computed beside the table, under no header of its own, is not read, which a remark says.
    """
    from openpyxl.utils.cell import get_column_letter

    sheets, titles = _sheets(path, raw, sheet)
    rows = sheets[_chosen(path, sheets, titles, sheet)]
    beside = _beside(rows)
    kept = [[v for k, v in enumerate(row) if k not in beside] for row in rows]
    letters = ", ".join(get_column_letter(k + 1) for k in sorted(beside))
    told = [f"column(s) {letters}, under no header of the table, are not read"] if letters else []
    return "".join("\t".join(map(_written, row)) + "\n" for row in kept), told


def _sheets(path: Path, raw: bytes, sheet: str) -> tuple[dict[str, list[list[Any]]], list[str]]:
    """Rows of the named sheet, or of all, and the titles of all; ValueError for other archives."""
    from openpyxl import load_workbook  # only who has such a file waits for it
    from openpyxl.utils.exceptions import InvalidFileException

    try:
        _admit(path, raw)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # styles and validations that it does not know
            book = load_workbook(io.BytesIO(raw), read_only=True, data_only=True)
            sheets = {s.title: _rows(path, s) for s in book.worksheets if not sheet or s.title == sheet}
            titles = book.sheetnames
    except Refused:
        raise
    except (InvalidFileException, *DAMAGES) as error:
        raise ValueError(
            f"{path}: is a zip archive and no workbook (.xlsx) that can be read; {_way_out(raw)}"
        ) from error
    return sheets, titles


def _way_out(raw: bytes) -> str:
    """What to do with a zip archive that is no workbook, by the names of its parts."""
    try:
        with ZipFile(io.BytesIO(raw)) as archive:
            names = archive.namelist()
    except DAMAGES:
        names = []
    tables = [name for name in names if name.lower().endswith(TABLE_ENDINGS)]
    if tables:
        return f"unpack it and give what it holds: {_few(tables)}"
    return "save it as CSV or as .xlsx"


def title_read(path: Path) -> str:
    """The sheet of a workbook that is read where none is named; ValueError as :func:`text_of_workbook`."""
    return _chosen(path, *_sheets(path, path.read_bytes(), ""), "")


class Refused(ValueError):
    """A workbook that could be read, at a cost that no file of readings has."""


def _admit(path: Path, raw: bytes) -> None:
    """Unpack every part of the archive once, without keeping it.

    Raises Refused where the parts together have more bytes than a sheet of readings may, whatever the archive says of
    their sizes, and where one declares entities of its own, which may stand for any amount of text.
    """
    left = MAX_UNPACKED_BYTES
    with ZipFile(io.BytesIO(raw)) as archive:
        for part in archive.infolist():
            end = b""
            with archive.open(part) as file:
                while piece := file.read(UNPACKING_PIECE_BYTES):
                    left -= len(piece)
                    if left < 0:
                        raise Refused(
                            f"{path}: unpacks to more than {MAX_UNPACKED_BYTES / 1e6:.0f} MB, no sheet of readings "
                            "does; save the sheet as CSV"
                        )
                    seen = (end + piece).replace(b"\0", b"")  # in UTF-16 too
                    if b"<!DOCTYPE" in seen and part.filename.endswith((".xml", ".rels")):
                        raise Refused(
                            f"{path}: its part {part.filename!r} declares entities, which no spreadsheet "
                            "writes; save the sheet as CSV"
                        )
                    end = piece[-32:]


def _rows(path: Path, sheet: Any) -> list[list[Any]]:
    """All rows of a sheet, as long as the longest, whatever size it claims to have; Refused beyond MAX_SHEET_CELLS."""
    sheet.reset_dimensions()
    rows: list[list[Any]] = []
    longest = 0
    for cells in sheet.iter_rows(values_only=True):
        row = list(cells)
        while row and row[-1] is None:
            row.pop()
        longest = max(longest, len(row))
        rows.append(row)
        if len(rows) * max(longest, 1) > MAX_SHEET_CELLS:
            raise Refused(
                f"{path}: sheet {sheet.title!r} spans more than {MAX_SHEET_CELLS / 1e6:.0f} million cells; save what "
                "was measured as a file of its own"
            )
    while rows and not rows[-1]:
        rows.pop()
    return [[*row, *[None] * (longest - len(row))] for row in rows]


def _chosen(path: Path, sheets: dict[str, list[list[Any]]], titles: Sequence[str], sheet: str) -> str:
    """Title of the sheet that is read."""
    if sheet and sheet not in sheets:
        near = get_close_matches(sheet, titles, n=MAX_LISTED_SHEETS, cutoff=0.0)
        raise ValueError(f"{path}: has no sheet {sheet!r}; choose from {_few(near)}")
    found = [title for title, rows in sheets.items() if sum(map(_is_reading, rows)) >= MIN_SHEET_READINGS]
    if len(found) == 1:
        return found[0]
    if not found:
        units = any(unit_of_cell(_written(v)) for rows in sheets.values() for row in rows for v in row)
        why = (
            UNIT_IN_CELL_ADVICE
            if units
            else "formulas that were never computed hold none, and readings stand beneath one another"
        )
        raise ValueError(
            f"{path}: none of its sheets ({_few(list(sheets))}) holds {MIN_SHEET_READINGS} rows of numbers; {why}"
        )
    longest = max(found, key=lambda title: len(sheets[title]))
    raise ValueError(
        f"{path}: {len(found)} of its sheets hold readings ({_few(found)}): name one behind a #, as in data = "
        f'"{path.name}#{longest}". Several in a list are repeats'
    )


def _few(titles: Sequence[str]) -> str:
    return ", ".join(map(repr, titles[:MAX_LISTED_SHEETS])) + (", …" if len(titles) > MAX_LISTED_SHEETS else "")


def _beside(rows: Sequence[Sequence[Any]]) -> set[int]:
    """Columns with cells and without a header: what was computed beside the table, as a mean or a force at 20 %.

    The table are the columns that hold a number in half of the rows of readings; its header is the last row of words
    above the longest run of these that is none of units.
    """
    numbers = [[k for k, v in enumerate(row) if is_number(_written(v))] for row in rows]
    filled = [k for found in numbers if len(found) > 1 for k in found]
    count = {k: filled.count(k) for k in set(filled)}
    table = {k for k, n in count.items() if n >= FULL_COLUMN_SHARE * max(count.values())}
    inside = [len(table & {*found}) > 1 for found in numbers]
    runs = [(len(list(run)), is_one) for is_one, run in itertools.groupby(inside)]
    ends = list(itertools.accumulate(n for n, _ in runs))
    first = max(((n, end - n) for (n, is_one), end in zip(runs, ends, strict=True) if is_one), default=(0, 0))[1]
    words = [{k: v for k, v in enumerate(row) if _is_word(v)} for row in rows[:first]]
    heads = [w for w in words if len(table & w.keys()) > 1 and not any(is_unit(w[k].strip("[]() ")) for k in w)]
    named = set(heads[-1]) if heads else set()
    used = {k for row in rows for k, v in enumerate(row) if v is not None}
    return used - named if named else set()


def _is_word(value: Any) -> bool:
    return isinstance(value, str) and value.strip() != "" and not is_number(value)


def _is_reading(row: Sequence[Any]) -> bool:
    return sum(is_number(_written(v)) for v in row) > 1


def _written(value: Any) -> str:
    """A cell as a CSV file would hold it; what would part cells or lines there is a blank."""
    if value is None:
        return ""
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    return " ".join(value.split()) if isinstance(value, str) else str(value)
