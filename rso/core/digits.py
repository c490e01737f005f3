"""Numbers as text: as many digits as are known."""

from __future__ import annotations

import math
from typing import TypeGuard

from rso.core.symbols import superscript
from rso.core.units import people

DASH = "–"
NBSP = "\N{NO-BREAK SPACE}"  # between a number and its unit
# of its larger end: an interval that is less wide is written to the digits of its half-width
NARROW_INTERVAL_RATIO = 0.5
MIN_KEPT_UNIT_SIZE = 1e-3  # of a unit: what is smaller is written in a smaller unit
MISSED_ZERO_SHARE = 1e-6  # of its larger end: what is nearer to 0 in an interval about it
MAX_SIGNIFICANT_DIGITS = 5  # significant digits of a number that is known however well


def known(x: object) -> TypeGuard[float]:
    """True for a finite number."""
    return isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)


def places(x: float, digits: int = 4) -> int:
    """Decimals with which x has that many significant digits (negative: tens, hundreds)."""
    return digits - 1 - _exponent(x, digits) if x else digits - 1


def _exponent(x: float, digits: int) -> int:
    # After rounding: 9.9997 with three digits is 10.0.
    return int(f"{abs(x):.{digits - 1}e}".split("e")[1])


def fixed(x: float, decimals: int) -> str:
    """x with that many decimals and a true minus sign; zero has no sign."""
    text = f"{x:.{max(decimals, 0)}f}"
    if not text.strip("-0."):
        text = text.lstrip("-")
    return text.replace("-", "−")


def significant(x: float | None, digits: int = 4) -> str:
    """x with that many significant digits, as a decimal between 1e-4 and 1e6 and as a power of ten outside."""
    if not known(x):
        return DASH
    if x == 0:
        return "0"
    exponent = _exponent(x, digits)
    if -5 < exponent < 6:
        return fixed(x, digits - 1 - exponent)
    mantissa = f"{x:.{digits - 1}e}".split("e")[0].replace("-", "−")
    return f"{mantissa}{NBSP}×{NBSP}10{superscript(exponent)}"


def rounded(x: float | None, half_width: float | None) -> str:
    """x to the second digit of its half-width, the last that an uncertainty is worth (GUM, JCGM 100:2008, 7.2.6)."""
    if not known(x) or not known(half_width) or half_width <= 0:
        return significant(x)
    decimals = places(half_width, 2)
    if decimals < 0:
        return fixed(round(x, decimals), 0)
    # A half-width far below 1e-4 of x claims more digits than a reader can use.
    return fixed(x, min(decimals, max(places(x, MAX_SIGNIFICANT_DIGITS), 0)))


def interval_ends(low: float, high: float, digits: int = 3) -> tuple[str, str]:
    """Both ends of an interval, to the digits of its half-width where that is small, else to so many of their own."""
    first, last = (estimate(v, low, high, digits) for v in (low, high))
    return first, last


def estimate(value: float, low: float, high: float, digits: int = 3) -> str:
    """A value written as the ends of its interval are, so that it lies in what is written, too."""
    if low < 0.0 < high and abs(value) < MISSED_ZERO_SHARE * max(-low, high):
        return "0"  # the end of a range that arithmetic has missed: no logarithm has one of either sign
    narrow = 0.0 < high - low < NARROW_INTERVAL_RATIO * max(abs(low), abs(high))
    return rounded(value, 0.5 * (high - low)) if narrow else significant(value, digits)


def two_digits(x: float) -> str:
    """x with two significant digits and no power of ten where it is a percentage or a length that people read: 140,
    not 1.4e+02."""
    text = f"{x:.2g}"
    return f"{x:.0f}" if "e+" in text and abs(x) < 1e6 else text


def quantity_text(x: float, unit: str, digits: int = 3) -> str:
    """A length or force with its unit; one below a thousandth of it in a smaller one: 7e-09 N is 7 nN."""
    label, factor = _fitting(unit, abs(x))
    return f"{x * factor:.{digits}g} {label}"


def range_text(low: float, high: float, unit: str, word: str = "to", digits: int = 3) -> str:
    """Two of them with one unit, that of the larger one, and a `word` between."""
    label, factor = _fitting(unit, max(abs(low), abs(high)))
    return f"{low * factor:.{digits}g} {word} {high * factor:.{digits}g} {label}"


def _fitting(unit: str, size: float) -> tuple[str, float]:
    return (unit, 1.0) if size >= MIN_KEPT_UNIT_SIZE or not math.isfinite(size) else people(unit, size)
