"""Names and units as the literature prints them: mu → μ, C10 → C₁₀, 1/MPa → MPa⁻¹."""

from __future__ import annotations

import re
from collections.abc import Iterable

_GREEK = dict(
    zip(
        "alpha beta gamma delta epsilon eta theta kappa lambda mu nu rho sigma tau phi".split(),
        "αβγδεηθκλμνρστφ",
        strict=True,
    )
)
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SUBSCRIPT = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def symbol(name: str) -> str:
    """The literature's letter of a parameter: mu → μ, C10 → C₁₀; any other name as it is."""
    match = re.fullmatch(r"([A-Za-z]+?)_?(\d{0,2})", name)
    if match is None:
        return name
    letter, index = match.groups()
    if letter in _GREEK:
        return _GREEK[letter] + index.translate(_SUBSCRIPT)
    return letter + index.translate(_SUBSCRIPT) if len(letter) == 1 else name


def unit_text(unit: str) -> str:
    """A unit as it is printed: 1/MPa → MPa⁻¹, mm^2 → mm², 1 → nothing."""
    if unit in ("1", "-", ""):
        return ""
    match = re.fullmatch(r"1/([A-Za-zµ]+)", unit)
    return f"{match.group(1)}⁻¹" if match else raised(unit)


def raised(text: str) -> str:
    """Text with its powers as superscripts: mm^2 → mm²."""
    return re.sub(r"(?<=[A-Za-zµ])\^(-?\d+)", lambda m: m.group(1).translate(_SUPERSCRIPT), text)


def in_units(text: str) -> str:
    """A sentence with its units as they are printed: 1.2 1/MPa → 1.2 MPa⁻¹."""
    return re.sub(r"(?<=\d)( ?)1/(\w+)\b", lambda m: f"{m[1] or ' '}{unit_text(f'1/{m[2]}')}", text)


def in_letters(text: str, names: Iterable[str]) -> str:
    """A sentence with the letters of these names, and units as they are printed: b2 is 3 1/MPa → b₂ is 3 MPa⁻¹."""
    for name in names:
        text = re.sub(rf"(?<![\w./]){re.escape(name)}(?![\w.]*\w)", symbol(name), text)
    return in_units(text)


def superscript(number: int) -> str:
    """An exponent: −3 → ⁻³."""
    return str(number).translate(_SUPERSCRIPT)
