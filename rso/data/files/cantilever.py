"""Travels of a piezo beside the deflection of a cantilever: what a file cannot say of them, and what is to be written.

The tip goes as far as the piezo less what the cantilever bends (H.-J. Butt, B. Cappella, M. Kappl, Surf. Sci. Rep. 59
(2005) 1); read as depth the travel alone makes a stiff body soft.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rso.core.inline_toml import inline
from rso.core.units import is_of
from rso.data.files import header_aliases
from rso.data.files.header_words import KNOWN_COLUMN_NAMES

PIEZO_WORDS = ("piezo", "zsens", "zsnsr", "z sens", "scanner", "calc ramp")  # in the name of a travel
HEIGHT_WORDS = ("height",)  # of a microscope beside a deflection; of a press without one
DEFLECTION_WORDS = ("defl", "défl", "cantilever", "auslenkung", "durchbiegung", "verbiegung")
# Of a travel from which it was subtracted before.
CORRECTED_TRAVEL_WORDS = ("tip", "separation", "surface", "indent", "penetr", "eindring", "enfoncement")
NUMBER_BLANK = "…"  # in place of a number that its owner knows
_SPRING_CONSTANT = re.compile(r"(?:spring ?constant|k \(N/m\))\s*[:=\t ]\s*([0-9.]+(?:e[-+]?\d+)?)", re.IGNORECASE)
_SENSITIVITY = re.compile(r"sensitivity\s*[:=]\s*([0-9.]+(?:e[-+]?\d+)?)\s*$", re.IGNORECASE)


class Unsaid(ValueError):
    """What a file does not say of its columns; `columns` is what to say, with the keys of [columns] in a study."""

    def __init__(self, message: str, columns: Mapping[str, Mapping[str, Any]]) -> None:
        lines = "".join(f"\n  {name} = {inline(column)}" for name, column in columns.items())
        super().__init__(f"{message}:\n  [columns]{lines}")
        self.message, self.columns = message, columns


def bending(cells: Sequence[str], units: Sequence[str], known: Sequence[str | None]) -> tuple[int, int, int] | None:
    """Columns of the travel, of what bends and of the force of a line of headers, where its travel holds a deflection.

    What bends and the force may be one column, a deflection or a force; None where a depth is there, or none of these.
    """
    names = [header_aliases.bare_header(cell, "depth") for cell in cells]
    forces = [k for k, cell in enumerate(cells) if known[k] == "Fz" or _is_force(cell, units[k])]
    bends = [k for k, name in enumerate(names) if any(part in name for part in DEFLECTION_WORDS)]
    named = [
        k
        for k, name in enumerate(names)
        if (name in KNOWN_COLUMN_NAMES["depth"] or known[k] == "depth") and k not in bends
    ]
    if any(known[k] == "depth" or any(part in names[k] for part in CORRECTED_TRAVEL_WORDS) for k in named):
        return None
    if any(part in name for name in names for part in ("indentation", "penetration", "separation")):
        return None
    piezo = [k for k, name in enumerate(names) if any(part in name for part in PIEZO_WORDS) and k not in bends]
    high = [
        k for k, name in enumerate(names) if any(part in name for part in HEIGHT_WORDS) and bends and k not in bends
    ]
    travel = next(iter([*piezo, *high, *(named if bends else [])]), None)
    force = next((k for k in forces if k not in bends), None)
    bend = next(iter(sorted(bends, key=lambda k: not _has(units[k], cells[k], "N", "mm"))), force)
    return None if travel is None or bend is None else (travel, bend, bend if force is None else force)


def question(
    place: str,
    cells: Sequence[str],
    units: Sequence[str],
    found: tuple[int, int, int],
    numbers: np.ndarray,
    notes: Sequence[str],
) -> Unsaid:
    """What to ask of the columns of :func:`bending`, by `numbers` (n, columns) of some rows and notes above them."""
    travel, bend, force = found
    spring, sensitivity = (
        next((m[1] for t in notes if (m := p.search(t))), None) for p in (_SPRING_CONSTANT, _SENSITIVITY)
    )
    stiffness = {"stiffness": f"{spring or NUMBER_BLANK} N/m"}
    down, up = _flips(numbers[:, travel], numbers[:, bend])
    is_force = _has(units[bend], cells[bend], "N")
    less = _named(cells[bend], units[bend], "Fz" if is_force else "depth", sensitivity) | up
    less |= stiffness if is_force else {}
    zero = {"zero": "contact"}
    columns = {"depth": _named(cells[travel], units[travel], "depth", None) | down | zero | {"minus": less}}
    own = _named(cells[force], units[force], "depth" if force == bend and not is_force else "Fz", sensitivity)
    if force == bend:
        columns["Fz"] = own | ({} if is_force else stiffness) | up | zero
    else:
        flip = _flips(numbers[:, travel], numbers[:, force])[1]
        columns["Fz"] = own | flip | zero
    time = next(
        (k for k, c in enumerate(cells) if header_aliases.bare_header(c, "time") in KNOWN_COLUMN_NAMES["time"]), None
    )
    if time is not None and is_of("s", unit := header_aliases.header_unit(cells[time], units[time], "time")):
        columns["time"] = {"header": cells[time], "unit": unit}
    both = f"{cells[travel]!r} and {cells[bend]!r} are the travel and " + (
        "the force of a cantilever, or of a frame that gives way" if is_force else "the deflection of a cantilever"
    )
    blank = (
        f", with numbers in place of {NUMBER_BLANK}" if NUMBER_BLANK in json.dumps(columns, ensure_ascii=False) else ""
    )
    text = (
        f"{place}: {both}, and no column is the depth: that is the travel less what bends; say "
        f"(without minus where nothing bends){blank}"
    )
    return Unsaid(text, columns)


def is_corrected(cell: str) -> bool:
    """Whether a header says that what bends was subtracted of a travel, which then differs from the machine's."""
    return any(part in header_aliases.bare_header(cell, "depth") for part in CORRECTED_TRAVEL_WORDS)


def _is_force(cell: str, beneath: str) -> bool:
    return header_aliases.bare_header(cell, "Fz") in KNOWN_COLUMN_NAMES["Fz"] and _has(beneath, cell, "N")


def _has(beneath: str, cell: str, *bases: str) -> bool:
    """Whether a header, or the row beneath it, says a unit of one of these kinds."""
    return any(is_of(b, header_aliases.header_unit(cell, beneath, "Fz" if b == "N" else "depth")) for b in bases)


def _named(cell: str, beneath: str, like: str, sensitivity: str | None) -> dict[str, Any]:
    """Header, and unit where the file does not say one of the right kind."""
    base = "N" if like == "Fz" else "mm"
    if _has(beneath, cell, base):
        return {"header": cell}
    volts = "V" in (header_aliases.header_unit(cell, beneath, like), beneath)  # of a photodiode
    one = (
        f"{sensitivity or NUMBER_BLANK} m" if sensitivity and volts else f"{NUMBER_BLANK} nm" if volts else NUMBER_BLANK
    )
    return {"header": cell, "unit": one}


def _flips(travel: np.ndarray, force: np.ndarray) -> tuple[dict[str, bool], dict[str, bool]]:
    """Which of a travel and a force (n,) have their sign turned, as far as the numbers show."""
    good = np.isfinite(travel) & np.isfinite(force)
    columns = {"depth": travel[good], "Fz": force[good]}
    try:
        turned = (
            header_aliases.reversed_columns(columns, np.full(int(good.sum()), "1"), ("depth", "Fz"))
            if good.sum() > 2
            else []
        )
    except ValueError:
        turned = []
    return ({"flip": True} if "depth" in turned else {}), ({"flip": True} if "Fz" in turned else {})
