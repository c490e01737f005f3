"""Where things stand in a TOML text: path of keys and indices → line number."""

from __future__ import annotations

import re
from pathlib import Path

Place = tuple[str | int, ...]


class LineElsewhere(int):
    """A line of another file than the study's, such as a table of specimens, what it is called there, and the unit that
    its number has there; empty without one."""

    file: Path
    label: str
    unit: str

    def __new__(cls, line: int, file: Path, label: str, unit: str = "") -> LineElsewhere:
        """The line (from 1) of a file."""
        made = super().__new__(cls, line)
        made.file, made.label, made.unit = file, label, unit
        return made


_TOML_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_TOML_KEY = re.compile(r'[ \t]*(?:"((?:[^"\\\n]|\\.)*)"|\'([^\'\n]*)\'|([A-Za-z0-9_-]+))[ \t]*')
_TOML_STRING = re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'', re.DOTALL)
_TOML_SCALAR = re.compile(r"[^,\]}\n#]*")


def toml_lines(text: str) -> dict[Place, int]:
    """Line (from 1) of every table, key and array element of `text`, which must be valid TOML.

    Tables of an array are counted from 0: the second ``[[experiments]]`` is ("experiments", 1).
    """
    return _Scanner(text.replace("\r\n", "\n")).scan()


def line_of(lines: dict[Place, int], place: Place) -> int:
    """Line of `place`, or of the nearest thing around it that is written down."""
    return next((lines[place[:n]] for n in range(len(place), 0, -1) if place[:n] in lines), 1)


class _Scanner:
    """Recursive descent over valid TOML: a position that only moves forward."""

    def __init__(self, text: str) -> None:
        self.text, self.at, self.line, self.counted = text, 0, 1, 0
        self.found: dict[Place, int] = {}
        self.count: dict[Place, int] = {}

    def scan(self) -> dict[Place, int]:
        table: Place = ()
        self._skip()
        while self.at < len(self.text):
            table = self._header() if self.text[self.at] == "[" else self._pair(table)
            self._skip()
        return self.found

    def _here(self, place: Place) -> None:
        self.line += self.text.count("\n", self.counted, self.at)
        self.counted = self.at
        for n in range(1, len(place) + 1):  # [a.b] also makes a
            self.found.setdefault(place[:n], self.line)

    def _skip(self) -> None:
        match = _TOML_BLANK.match(self.text, self.at)
        assert match  # of nothing at least
        self.at = match.end()

    def _keys(self) -> list[str]:
        """A dotted key."""
        keys = []
        while match := _TOML_KEY.match(self.text, self.at):
            self.at = match.end()
            keys.append(next(group for group in match.groups() if group is not None))
            if not self.text.startswith(".", self.at):
                break
            self.at += 1
        return keys

    def _header(self) -> Place:
        many = self.text.startswith("[[", self.at)
        self.at += 2 if many else 1
        start, keys = self.at, self._keys()
        self.at += 2 if many else 1
        place: Place = ()
        for n, key in enumerate(keys):
            place += (key,)
            if many and n == len(keys) - 1:
                self.count[place] = self.count.get(place, -1) + 1
            if place in self.count:
                place += (self.count[place],)
        end, self.at = self.at, start
        self._here(place)
        self.at = end
        return place

    def _pair(self, table: Place) -> Place:
        """``key = value``; returns the table it stands in, so that the table stays current."""
        start, keys = self.at, self._keys()
        end, self.at = self.at, start
        self._here((*table, *keys))
        self.at = end + 1  # the equals sign
        self._value((*table, *keys))
        return table

    def _value(self, place: Place) -> None:
        self._skip()
        self._here(place)
        first = self.text[self.at : self.at + 1]
        if first in ("[", "{"):
            self._inside(place, first)
        else:
            match = _TOML_STRING.match(self.text, self.at) or _TOML_SCALAR.match(self.text, self.at)
            assert match  # of nothing at least
            self.at = match.end()

    def _inside(self, place: Place, opening: str) -> None:
        """Elements of an inline array or table."""
        closing, n = {"[": "]", "{": "}"}[opening], 0
        self.at += 1
        self._skip()
        while not self.text.startswith(closing, self.at) and self.at < len(self.text):
            if opening == "[":
                self._value((*place, n))
            else:
                self._pair(place)
            n += 1
            self._skip()
            if self.text.startswith(",", self.at):
                self.at += 1
                self._skip()
        self.at += 1
