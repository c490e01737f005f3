"""Numbers with their units, and names, as the pages print them; never markup."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rso.core import symbols
from rso.core.digits import DASH, NBSP, fixed, interval_ends, known, places, significant
from rso.core.units import UNIT_LADDERS, people
from rso.report.layout.document import Cell

_CONTROL_CHARACTERS = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")


@dataclass(frozen=True)
class Unit:
    """How a quantity is shown: value in base units × `factor` is a number of `label`."""

    label: str
    factor: float = 1.0

    @property
    def after(self) -> str:
        """The label with the unbreakable space that goes before it, or nothing."""
        return f"{NBSP}{self.label}" if self.label else ""

    @property
    def bracket(self) -> str:
        """The label in brackets for an axis, or nothing."""
        return f" ({self.label})" if self.label else ""


def clean(text: object) -> str:
    """Any text without control characters and lone surrogates, which neither page can hold."""
    return _CONTROL_CHARACTERS.sub("\N{REPLACEMENT CHARACTER}", "" if text is None else str(text))


def symbol(name: str) -> str:
    """The literature's letter of a parameter: mu → μ, D1 → D₁, C10 → C₁₀; any other name as it is."""
    return symbols.symbol(clean(name))


def unit_text(unit: str) -> str:
    """A unit as it is printed: 1/MPa → MPa⁻¹, mm^2 → mm², 1 → nothing."""
    return symbols.unit_text(clean(unit))


def raised(text: str) -> str:
    """Text with its powers as superscripts: mm^2 → mm²."""
    return symbols.raised(text)


def channel_text(name: object) -> str:
    """The name of a channel as people read it: contact_area → contact area."""
    return clean(name).replace("_", " ")


def sentence(text: object) -> str:
    """Words of the program with true minus signs, and nothing parted from its %."""
    return re.sub(r"(?<=\d) %", f"{NBSP}%", re.sub(r"(?<![\w.])-(?=\d)", "−", clean(text)))


def shown(unit: str, size: float | None = None) -> Unit:
    """The unit people would use for a quantity of this size (MPa, kPa or Pa; N or mN; mm or µm)."""
    if unit not in UNIT_LADDERS or not known(size) or size == 0:
        return Unit(unit_text(unit))
    return Unit(*people(unit, size))


def largest(values: Sequence[float | None]) -> float | None:
    """The largest size among the known values, None where nothing is known."""
    sizes = [abs(v) for v in values if known(v)]
    return max(sizes, default=None)


def shortest(x: object) -> str:
    """A number as a person wrote it (a depth, a count), or any text."""
    if isinstance(x, str):
        return clean(x)
    return f"{x:.6g}".replace("-", "−") if known(x) else DASH


def quantity(x: float | None, unit: str, digits: int = 4, size: float | None = None) -> str:
    """A number with the unit people would use for it."""
    if not known(x):
        return DASH
    use = shown(unit, x if size is None else size)
    return f"{significant(x * use.factor, digits)}{use.after}"


def signed(x: float | None, text: str) -> str:
    """Text of a number with a plus sign where it is positive."""
    return f"+{text}" if known(x) and x > 0 and text.strip("0.") else text


def percent(fraction: float | None, digits: int = 2) -> str:
    """A fraction as a percentage; below one part in 10⁵ it is only said to be so."""
    if not known(fraction):
        return DASH
    if 0 < abs(fraction) < 1e-5:
        return f"<{NBSP}0.001{NBSP}%"
    return f"{significant(100 * fraction, digits)}{NBSP}%"


def between(low: float | None, high: float | None, unit: Unit, digits: int = 3) -> str:
    """Two ends of a range with one unit, rounded by its width where that is small."""
    if not (known(low) and known(high)):
        return DASH
    if low == high:
        return f"{significant(low * unit.factor, digits)}{unit.after}"
    return f"{' to '.join(interval_ends(low * unit.factor, high * unit.factor, digits))}{unit.after}"


def duration(seconds: float | None) -> str:
    """Seconds as people say them: 8.4 s, 4 min 12 s, 3 h 20 min."""
    if not known(seconds):
        return DASH
    if seconds < 60:
        return f"{significant(seconds, 2 if seconds < 10 else 3)}{NBSP}s"
    whole = round(seconds)
    hours, minutes = whole // 3600, whole % 3600 // 60
    parts = (hours, "h", minutes, "min") if hours else (minutes, "min", whole % 60, "s")
    return NBSP.join(map(str, parts))


def aligned(values: Sequence[float | None], digits: int = 4, plus: bool = False) -> tuple[Cell, ...]:
    """One column of numbers with their decimal points below each other.

    The largest number gets `digits` significant digits and the others as many decimals; where
    that leaves the smallest fewer than two each number gets its own digits, and invisible ones keep the points in line.
    """
    sizes = [abs(v) for v in values if known(v) and v != 0]
    if not sizes:
        return tuple(Cell(fixed(v, 0) if known(v) else DASH) for v in values)
    decimals = max(places(max(sizes), digits), 0)
    wide = max(sizes) >= 10 ** max(digits - 2, 1) * min(sizes) and not plus
    if max(sizes) < 1e-5 or max(sizes) >= 1e6 or (wide and min(sizes) < 1e-4):
        return tuple(Cell(significant(v, digits)) for v in values)
    if wide:
        text = [significant(v, digits) for v in values]
    else:
        text = [fixed(v, decimals) if known(v) else DASH for v in values]
    text = [signed(v, s) for v, s in zip(values, text, strict=True)] if plus else text
    tail = [t.partition(".")[2] for t in text]
    longest = max(map(len, tail))
    pad = ["0" * (longest - len(t)) if t else ("." + "0" * longest) * (longest > 0) for t in tail]
    return tuple(Cell(t, "" if t == DASH else p) for t, p in zip(text, pad, strict=True))
