"""The lines of a measurement file: its bytes as text, its comments, cells of a header that have several lines."""

from __future__ import annotations

import difflib
import io
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from rso.data.files.columns import Row, is_number
from rso.data.files.header_words import KNOWN_COLUMN_NAMES
from rso.data.files.workbook import ZIP_START, sheet_of, sheet_without_block, text_of_workbook

MAX_FILE_BYTES = 200_000_000  # of a measured file, which is read as a whole
OLD_WORKBOOK_START = b"\xd0\xcf\x11\xe0"  # a workbook as spreadsheets wrote it until 2007
# What files of other kinds begin with, and what they are called: none of them is text.
OTHER_KINDS: Mapping[bytes, str] = MappingProxyType(
    {
        b"%PDF-": "a document (PDF)",
        b"{\\rtf": "a document (RTF)",
        b"\x89HDF": "an HDF5 file",
        b"MATLAB 5.0 MAT-file": "a MATLAB file",
        b"MATLAB 7.3 MAT-file": "a MATLAB file",
        b"TDSm": "a TDMS file",
        b"PAR1\x15": "a Parquet file",
        b"\x93NUMPY": "an array of NumPy",
        b"SQLite format 3": "a database",
        b"\x89PNG": "a picture",
        b"\xff\xd8\xff": "a picture",
    }
)
PACKED_KINDS: Mapping[bytes, str] = MappingProxyType({b"\x1f\x8b": "gzip", b"7z\xbc\xaf": "7z", b"Rar!\x1a": "RAR"})
EXPORT_ADVICE = "export its readings as CSV or as a workbook (.xlsx)"
_CONTROL_BYTES = bytes(k for k in range(1, 32) if k not in b"\t\n\v\f\r\x1a\x1b")  # which no text has many of
_MAX_CONTROL_SHARE, _SAMPLED_BYTES = 0.01, 10_000  # of the bytes at the begin that are looked at
# Code pages of files that are no UTF-8, the most usual one first: it can be read of any bytes.
CODE_PAGES: Mapping[str, str] = MappingProxyType(
    {
        "latin-1": "Latin-1",
        "cp932": "Shift-JIS",
        "gb18030": "GB 18030",
        "cp949": "Korean (CP949)",
        "cp1251": "Cyrillic (CP1251)",
        "cp1250": "Central European (CP1250)",
        "cp1254": "Turkish (CP1254)",
    }
)
# Names of columns that say by their letters what code page they are of; two letters are no chance.
_NON_ASCII_NAMES = tuple(n for names in KNOWN_COLUMN_NAMES.values() for n in names if not n.isascii() and len(n) > 1)
_JSON_LINES = 3  # of a text of one value a line
_HEADER_CHARACTERS = 50_000  # letters that hold the header
_MAX_CELL_LINES = 8  # lines that the cells of a header may have
_OPENS_QUOTE, _CLOSES_QUOTE = re.compile(r'(?:^|[;,\t])\s*"[^"]*$'), re.compile(r'[^"]*"\s*(?:[;,\t]|$)')
# A cell that a spreadsheet could not show or compute is a bad number, not the begin of a comment.
_FAULTY_CELL = re.compile(r"#(?:#+|DIV/0!|N/A|NV|[A-ZÄÖÜ]+[!?])\s*[;,\t]\s*[^\s;,]")


def _missing(path: Path) -> str:
    """That a file is not there, and what lies beside it under nearly the same name."""
    beside = [f.name for f in path.parent.iterdir() if f.is_file()] if path.parent.is_dir() else []
    near = difflib.get_close_matches(path.name, beside, n=2)
    hint = f"; did you mean {' or '.join(near)}?" if near else ""
    return f"there is no such file{hint}"


def file_text(path: Path) -> tuple[str, list[str]]:
    """Contents as text, and remarks: UTF-16 with its mark, UTF-8 with or without one, else an older code page; of a
    workbook its readings."""
    path, sheet = sheet_of(path)
    try:
        if not path.is_file():
            raise ValueError(f"{path}: {_missing(path) if not path.exists() else 'is not a file'}")
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise ValueError(
                f"{path}: {size / 1e6:.0f} MB is more than the {MAX_FILE_BYTES / 1e6:.0f} MB that are read"
            )
        raw = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from error
    if raw.startswith(ZIP_START):
        return text_of_workbook(path, raw, sheet_without_block(sheet))
    if raw.startswith(OLD_WORKBOOK_START):
        text = "is a workbook of the old kind (.xls) or has a password; save it as .xlsx, without one"
        raise ValueError(f"{path}: {text}")
    if kind := next((what for begin, what in OTHER_KINDS.items() if raw.startswith(begin)), ""):
        raise ValueError(f"{path}: is {kind} and no text; {EXPORT_ADVICE}")
    if kind := next((what for begin, what in PACKED_KINDS.items() if raw.startswith(begin)), ""):
        raise ValueError(f"{path}: is packed ({kind}); unpack it and give the file in it")
    if sheet and not sheet.isdigit():
        raise ValueError(f"{path}: is no workbook and has no sheet {sheet!r}")
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            raw = raw.decode("utf-16").encode()
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: begins as UTF-16 text and goes on as none; save it as UTF-8") from error
    filled = raw.rstrip(b"\0")
    if b"\0" not in filled and b"\n" in filled:
        raw = filled  # a logger that was cut off
    if b"\0" in raw and path.suffix.lower() == ".xlsx":
        raise ValueError(f"{path}: is no workbook that can be read; damaged?")
    if b"\0" in raw:
        raise ValueError(
            f"{path}: is not a text file (it holds zero bytes); a CSV file or a workbook (.xlsx) is expected. "
            "UTF-16 without a mark at its begin? Save it as UTF-8"
        )
    begin = raw[:_SAMPLED_BYTES]
    if len(begin) - len(begin.translate(None, _CONTROL_BYTES)) > _MAX_CONTROL_SHARE * len(begin):
        raise ValueError(f"{path}: is not a text file (it holds control characters); {EXPORT_ADVICE}")
    try:
        text, told = raw.decode("utf-8-sig"), list[str]()
    except UnicodeDecodeError:
        text, told = _of_code_page(raw)
    for mark in ("\u200b", "\ufeff"):  # of no width
        text = text.replace(mark, "")
    if language := _language(text):
        raise ValueError(f"{path}: is {language} and no table of plain text; {EXPORT_ADVICE}")
    return text.removesuffix("\x1a"), told  # the end of a file of DOS


def _language(text: str) -> str:
    """The language of a text that holds tables otherwise than in lines of cells; empty for other text."""
    begin = text[:_HEADER_CHARACTERS].lstrip()
    if re.match(r"<(?:\?xml|!doctype|html|head|body|table|meta|style)\b", begin, re.IGNORECASE):
        return "HTML or XML"
    if begin[:1] in ("{", "["):  # a table may stand beneath a line of it
        lines = [line for line in text.splitlines()[:_JSON_LINES] if line.strip()]
        return "JSON" if _is_json([text]) or (len(lines) > 1 and _is_json(lines)) else ""
    return ""


def _is_json(texts: Sequence[str]) -> bool:
    """Whether each of some texts is an object or a list."""
    try:
        return all(isinstance(json.loads(text), dict | list) for text in texts)
    except (ValueError, RecursionError):
        return False


def _of_code_page(raw: bytes) -> tuple[str, list[str]]:
    """Text that is no UTF-8, and a remark: Latin-1, unless another code page makes more names of columns of it."""
    texts = {}
    for page in CODE_PAGES:
        try:
            texts[page] = raw.decode(page)
        except UnicodeDecodeError:
            continue
    names = {page: _known(text[:_HEADER_CHARACTERS].lower()) for page, text in texts.items()}
    best = max(texts, key=names.__getitem__)  # of equals the first
    plain = next(iter(CODE_PAGES))
    said = f"read as {CODE_PAGES[best]}, in which its columns have names; UTF-8 would need no guess"
    return texts[best], [] if best == plain else [said]


def _known(text: str) -> int:
    """How many names of columns a text has whose letters are not ASCII."""
    return sum(name in text for name in _NON_ASCII_NAMES)


def numbered_lines(text: str, comments: list[Row]) -> Iterator[Row]:
    """Numbered lines that hold more than separators; those of comments, without '#', go to `comments`."""
    for number, line in enumerate(_joined(text), 1):
        row = line.strip("\r\n")
        if row.lstrip().startswith("#") and not _FAULTY_CELL.match(row.lstrip()):
            comments.append((number, row.lstrip()[1:].strip()))
        elif row.strip(' \t;,"'):
            yield number, row


def _joined(text: str) -> Iterator[str]:
    """Lines, where a cell in quotes has some of its own, "Weg⏎[mm]", as one, and empty ones in place of the others.

    Readings are lines of their own wherever quotes open and close.
    """
    held: list[str] = []
    for line in io.StringIO(text, newline=None):
        if not held and not (line.count('"') % 2 and _OPENS_QUOTE.search(line)):
            yield line
            continue
        held.append(line)
        closed = sum(v.count('"') for v in held) % 2 == 0
        if closed and _CLOSES_QUOTE.match(line) and not any(map(_is_reading, held[1:])):
            yield " ".join(v.strip("\r\n") for v in held)
            yield from [""] * (len(held) - 1)
            held = []
        elif closed or len(held) > _MAX_CELL_LINES:  # quotes that mean inches
            yield from held
            held = []
    yield from held


def _is_reading(line: str) -> bool:
    """Whether a line holds two numbers and more: no part of a cell, but of a table with a stray quote above."""
    return sum(map(is_number, re.split("[;,\t]", line.strip()))) > 1
