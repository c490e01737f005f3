"""What testing machines customarily call travel, force and time: files that need no [columns].

Only whole names count, and only where a single column has one: what may be two things is asked for.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from rso.units import is_of, kind_of, unit_in, weight

NAMES: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "depth": frozenset(
            {"indentation", "indentation depth", "penetration", "penetration depth", "indenter displacement",
             "indenter position", "indenter travel", "displacement", "displ", "disp", "distance", "extension",
             "travel", "stroke", "position", "deformation", "compression", "crosshead", "crosshead displacement",
             "crosshead position", "crosshead travel", "actuator displacement", "actuator position",
             "axial displacement", "axial position", "compressive displacement", "compressive extension",
             "z displacement", "displacement z", "z position", "position z", "weg", "standardweg", "traversenweg",
             "verformung", "verfahrweg", "eindringtiefe", "eindringweg", "position traverse", "déplacement",
             "enfoncement", "desplazamiento", "spostamento"}
        ),
        "Fz": frozenset(
            {"force", "force z", "z force", "load", "normal force", "normal load", "axial force",
             "axial load", "compressive force", "compressive load", "vertical force", "indentation force", "load cell",
             "kraft", "standardkraft", "prüfkraft", "normalkraft", "fuerza", "forza"}
        ),
        "time": frozenset(
            {"time", "timestamp", "elapsed time", "test time", "total time", "zeit", "prüfzeit", "testzeit", "temps",
             "tiempo", "tempo"}
        ),
    }
)  # fmt: skip
_GROUP = re.compile(r"\[[^\[\]]*\]|\([^()]*\)")
_JOINED = re.compile(r"[\s_\-.:]+")


def plain(cell: str, name: str) -> str:
    """A header in small letters without what says its unit, for a column of the kind of `name`."""
    text = _GROUP.sub(" ", cell)
    for mark in ("/", "_", ",", " "):
        words, _, last = text.strip().rpartition(mark)
        if words and (is_of(kind_of(name), last) or (kind_of(name) == "N" and weight(last))):
            text = words
            break
    return _JOINED.sub(" ", text).strip().lower()


def is_one(cell: str) -> bool:
    """Whether a header is a customary name."""
    return any(plain(cell, name) in names for name, names in NAMES.items())


def named(
    cells: Sequence[str], beneath: Sequence[str], known: Sequence[str | None], clocks: Sequence[bool]
) -> dict[str, int]:
    """Known name → column of a line of headers; empty unless travel and force are there and one by a customary name.

    `beneath` are the units in the row below, `known` what a header is by itself, `clocks` whether a time of day stands
    below.  A known name without its unit is none of these names; a time without a unit or a clock is left out.
    ValueError where two columns may be the same.
    """
    found = {name: k for k, name in enumerate(known) if name is not None}
    customary = False
    for name, names in NAMES.items():
        if name in found:
            continue
        united = [is_of(kind_of(name), unit_in(cell, name) or beneath[k]) for k, cell in enumerate(cells)]
        called = [plain(cell, name) if known[k] is None else "" for k, cell in enumerate(cells)]
        mine = [k for k, c in enumerate(called) if c in names or (united[k] and c == name.lower())]
        if name == "time":
            mine = [k for k in mine if clocks[k] or united[k]]
            mine = mine if len(mine) == 1 else []
        if len(mine) > 1:
            each = " and ".join(repr(cells[k]) for k in mine[:3])
            raise ValueError(f"{each} may each be {name}: say with [columns] in the study file which is")
        if mine:
            found[name] = mine[0]
            customary = customary or name != "time"
    return found if customary and {"depth", "Fz"} <= found.keys() else {}


def turned(columns: Mapping[str, np.ndarray], names: Sequence[str]) -> list[str]:
    """Which of the columns `names` count the other way: the force is to be larger where it is furthest from where the
    record begins, and to grow with the travel, from reading to reading, whatever offsets the tests of a file have."""
    force, depth = columns["Fz"], columns["depth"]
    if len(force) < 2:
        return []
    far = force - float(np.median(force[:3]))
    upright = float(far[np.argmax(np.abs(far))])
    step = np.diff(depth)
    usual = 3.0 * float(np.median(np.abs(step)))
    together = float(np.sum(np.diff(force) * np.clip(step, -usual, usual)))
    grows = {"Fz": upright, "depth": together * upright}
    return [name for name in names if grows.get(name, 0.0) < 0.0]
