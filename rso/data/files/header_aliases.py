"""What testing machines customarily call travel, force and time: files that need no [columns].

Only whole names count, and only where a single column has one: what may be two things is asked for.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np

from rso.core.units import bracketed, is_of, kind_of, unit_in, weight
from rso.data.files.header_words import (
    COLUMN_NAMES_WITH_UNIT,
    COLUMN_QUALIFIERS,
    KNOWN_COLUMN_NAMES,
    SEGMENT_COLUMN_NAMES,
    SEGMENT_WORDS,
    TENSILE_WORDS,
    WEIGHT_WORDS,
)
from rso.data.files.rows import rows_by_label

FROM_CONTACT_WORDS = ("indentation", "penetration", "eindring", "enfoncement")  # such a travel is no machine's position
LATE_WAY_PARTS = ((0.6, 0.7), (0.8, 0.9), (0.95, 1.0))  # of the way: where a force is looked for
TAKEN_OFF_SLOPE_RATIO = 2.5  # times the last fifth of the way: u^0.7 is by 2.2, an indenter that is taken off by 3
MIN_EARLIER_WAY_SHARE = 0.1  # of the longest way: the way before it in the other sense, where the force is
MAX_READINGS_WITHOUT_SHAPE = 7  # readings: more of them tell the shape of a curve
_BRACKETED = re.compile(r"\[[^\[\]]*\]|\([^()]*\)")
_NAME_JOINTS = re.compile(r"[\s_\-.:]+")


def bare_header(cell: str, name: str) -> str:
    """A header in small letters without what says its unit, for a column of the kind of `name`."""
    text = _BRACKETED.sub(" ", cell)
    for mark in ("/", "_", ",", " "):
        words, _, last = text.strip().rpartition(mark)
        last = last.lower() if name == "time" else last
        if words and (is_of(kind_of(name), last) or (kind_of(name) == "N" and weight(last))):
            text = words
            break
    return _NAME_JOINTS.sub(" ", text).strip().lower()


def header_unit(cell: str, beneath: str, name: str) -> str:
    """What a header, or the row beneath it, says for its unit, known or not; Sec and MIN of a time are sec and min."""
    unit = unit_in(cell, name) or bracketed(cell, name) or beneath
    if not unit and name == "time":
        words = re.split(r"[\s_()\[\]]+", cell)[1:]  # Time (Sec) and Time_S
        unit = next((word for word in words if is_of("s", word.lower())), "")
    small = unit.lower()
    return small if name == "time" and not is_of("s", unit) and is_of("s", small) else unit


def is_one(cell: str) -> bool:
    """Whether a header is a usual name."""
    return any(bare_header(cell, name) in names for name, names in KNOWN_COLUMN_NAMES.items())


def named_columns(
    cells: Sequence[str], beneath: Sequence[str], known: Sequence[str | None], clocks: Sequence[bool]
) -> dict[str, int]:
    """Known name → column of a line of headers; empty unless travel and force are there and one by a usual name.

    `beneath` are the units in the row below, `known` what a header is by itself, `clocks` whether a time of day stands
    below.  A known name without its unit is none of these names; a time without a unit or a clock is left out.
    ValueError where two columns may be the same.
    """
    found = {name: k for k, name in enumerate(known) if name is not None}
    customary = False
    for name, names in KNOWN_COLUMN_NAMES.items():
        if name in found:
            continue
        units = [header_unit(cell, beneath[k], name) for k, cell in enumerate(cells)]
        united = [is_of(kind_of(name), unit) for unit in units]
        called = [bare_header(cell, name) if known[k] is None else "" for k, cell in enumerate(cells)]
        small = COLUMN_NAMES_WITH_UNIT[name] | {name.lower()}
        mine = [k for k, c in enumerate(called) if c in names or (united[k] and c in small)]
        if not any(united[k] or not units[k] for k in mine):  # none of them has the right kind of unit
            bare = [_bare(c) for c in called]
            mine = [k for k, c in enumerate(bare) if c in names or (united[k] and c in small)] or mine
        if name == "time":
            mine = [k for k in mine if clocks[k] or united[k]]
            mine = mine if len(mine) == 1 else []
        if len(own := [k for k in mine if united[k] or not units[k]]) == 1:
            mine = own  # beside an Extension (%) and a Force (g)
        if len(mine) > 1 and len(own := [k for k in mine if name == "depth" and from_contact(cells[k])]) == 1:
            mine = own  # beside the position of the machine
        if len(mine) > 1 and name == "Fz" and (own := [k for k in mine if _bare(called[k]) not in WEIGHT_WORDS]):
            mine = own  # beside the weight of the specimen
        if len(mine) > 1:
            each = " and ".join(repr(cells[k]) for k in mine[:3])
            raise ValueError(f"{each} may each be {name}: say with [columns] in the study file which is")
        if mine:
            found[name] = mine[0]
            customary = customary or name != "time"
    return found if customary and {"depth", "Fz"} <= found.keys() else {}


def _bare(name: str) -> str:
    """A name without the words that say how it was come by: corrected force."""
    return " ".join(word for word in name.split() if word not in COLUMN_QUALIFIERS)


def segment_column(cells: Sequence[str]) -> int | None:
    """The one column of a machine's codes of its segments; None without, and for several."""
    found = [k for k, cell in enumerate(cells) if bare_header(cell, "segment") in SEGMENT_COLUMN_NAMES]
    return found[0] if len(found) == 1 else None


def segment_codes(values: Sequence[str]) -> dict[str, str]:
    """Words of such a column → loading, hold or unloading; nothing where one of them, as a number, may be anything."""
    codes = {value: SEGMENT_WORDS.get(_segment_word(value), "") for value in dict.fromkeys(values)}
    return codes if "loading" in codes.values() and all(codes.values()) else {}


def _segment_word(value: str) -> str:
    """A word of such a column in small letters, without what only says that it is one: Load Segment Type."""
    return _NAME_JOINTS.sub(" ", value).strip().lower().removesuffix(" type").removesuffix(" segment")


def tensile(texts: Sequence[str]) -> str:
    """The first of the headers and notes of a file that says that it was pulled, empty without one."""
    small = [text.lower() for text in texts]
    pressed = any(word in text for text in small for word in ("compress", "indent", "druck", "eindring"))
    return next(
        (t for t, s in zip(texts, small, strict=True) if not pressed and any(w in s for w in TENSILE_WORDS)), ""
    )


def from_contact(cell: str) -> bool:
    """Whether a header says that a travel counts from contact."""
    name = bare_header(cell, "depth")
    return name == "pd" or any(part in name for part in FROM_CONTACT_WORDS)  # penetration depth


def reversed_columns(columns: Mapping[str, np.ndarray], labels: np.ndarray, names: Sequence[str]) -> list[str]:
    """Which of the columns `names` count the other way, by most of the tests `labels` (n,), whatever their offsets.

    It is pressed where the travel is furthest from where the record begins: there the force is larger than in the
    first half of the way, of which less than half may have been tared otherwise.  ValueError where the force changes
    most where the record begins.
    """
    votes = {"depth": 0.0, "Fz": 0.0}
    for rows in rows_by_label(labels.tolist()).values():
        sense = _sense(columns["depth"][rows], columns["Fz"][rows])
        votes = {name: votes[name] + sign for name, sign in zip(votes, sense, strict=True)}
    return [name for name in names if votes.get(name, 0.0) < 0.0]


def _sense(travel: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Signs of travel and force of one test, 0 where it does not show any."""
    way = travel - float(np.median(travel[: 3 if len(travel) > MAX_READINGS_WITHOUT_SHAPE else 1]))
    end = int(np.argmax(np.abs(way)))
    if way[end] == 0.0:
        return 0.0, 0.0
    other = int(np.argmax(-np.sign(way[end]) * way[:end])) if end else 0
    if -way[other] / way[end] > MIN_EARLIER_WAY_SHARE and abs(force[other] - force[0]) > 2.0 * abs(
        force[end] - force[0]
    ):
        end = other  # an indenter that was taken off further than it was pressed
    x, F = way[: end + 1] / way[end], force[: end + 1]

    def at(low: float, high: float) -> float:
        inside = F[(x >= low) & (x <= high)]
        return float(np.median(inside)) if len(inside) else float(np.interp(0.5 * (low + high), x, F))

    rises = [at(*part) - at(0.0, 0.5) for part in LATE_WAY_PARTS]
    sign = float(np.sign(max(rises, key=abs)))
    slope = [sign * (at(b, b + 0.05) - at(a, a + 0.05)) for a, b in itertools.pairwise((0.0, 0.2, 0.4, 0.6, 0.8, 0.95))]
    if (
        len(x) > MAX_READINGS_WITHOUT_SHAPE
        and slope[0] > max(TAKEN_OFF_SLOPE_RATIO * max(slope[-1], 0.0), *slope[1:])
        and slope[0] > 0.25 * sum(slope)
    ):
        raise ValueError(
            "the force changes most where the record begins: unloading alone, rows in reverse order, or a cell tared "
            "during the test? Remove such readings, sort the rows, or describe the columns with [columns] in the study "
            "file"
        )
    return float(np.sign(way[end])), sign
