"""The text of a study file and the tables in it, before anybody asks what they mean."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from rso.study.confusable_text import too_deep
from rso.study.errors import StudyError, choices_text

MAX_STUDY_FILE_BYTES = 1_000_000  # of text that people write by hand: more is another file
MAX_LINE_CHARACTERS = 10_000  # the time to read a dotted key grows with the square of its length
MAX_NESTING = 64  # tables and arrays within one another


def study_source(path: str | Path) -> tuple[Path, str]:
    """The study file and its text."""
    file = Path(path)
    try:
        if file.is_dir():
            file = file / "study.toml"
        if not file.exists():
            near = [f.name for f in file.parent.glob("*.toml")] if file.parent.is_dir() else []
            cure = (
                choices_text(file.name, near)
                if near
                else ("write one with: rso new CURVE.csv …; or try a worked one: rso example")
            )
            if any((file.parent / name).is_file() for name in ("results.json", "diagnosis.json", "specimens.json")):
                cure = f"the folder holds results: show their pages with: rso open {file.parent}"
            raise StudyError([f"{file}: there is no such study file; {cure}"])
        if not file.is_file():
            raise StudyError([f"{file}: is not a file; a study file such as study.toml is expected"])
        size = file.stat().st_size
        if size > MAX_STUDY_FILE_BYTES:
            raise StudyError(
                [f"{file}: {size / 1e6:.1f} MB is too large for a study file ({MAX_STUDY_FILE_BYTES / 1e6:.0f} MB)"]
            )
        raw = file.read_bytes()
    except OSError as error:
        raise StudyError([f"{path}: cannot be read ({error.strerror})"]) from error
    except ValueError as error:
        if isinstance(error, StudyError):
            raise
        raise StudyError([f"{str(path)!r}: is not a path ({error})"]) from error
    try:
        return file, raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise StudyError([f"{file}:{line}: is not UTF-8 text; save the study file as UTF-8"]) from error


def tables_of(file: Path, text: str) -> dict[str, Any]:
    """The parsed file; a syntax error keeps its line."""
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > MAX_LINE_CHARACTERS:
            raise StudyError([f"{file}:{number}: not a study file: a line of {len(line)} characters ({line[:60]!r}…)"])
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = re.search(r"\(at line (\d+), column \d+\)", str(error))
        at = int(match[1]) if match else text.count("\n") + 1
        where = text.split("\n")[at - 1].strip()[:60]
        raise StudyError([f"{file}:{at}: not valid TOML: {error}: {where!r}"]) from error
    except RecursionError as error:
        raise StudyError([f"{file}: not a study file: brackets are nested too deeply"]) from error
    except ValueError as error:  # an integer of thousands of digits
        raise StudyError([f"{file}: not valid TOML: {error}"]) from error
    if (deep := too_deep(found, MAX_NESTING)) is not None:
        raise StudyError(
            [f"{file}: not a study file: {str(deep)[:60]} holds tables or arrays nested more than {MAX_NESTING} deep"]
        )
    return found
