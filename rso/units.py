"""Units at the door: text such as ``"3.2 kPa"`` becomes a float in N, mm, MPa, s; bare numbers already are.

Arithmetic is exact (fractions) until the last step, so ``"3.2 kPa"`` and the bare number ``0.0032`` are the same bits.
"""

from __future__ import annotations

import functools
import math
import numbers
import re
from fractions import Fraction
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint

# What the columns of a measured file mean, and the unit in which everything behind the door sees them.
COLUMNS = MappingProxyType(
    {
        "depth": "mm",
        "time": "s",
        "Fx": "N",
        "Fy": "N",
        "Fz": "N",
        "x": "mm",
        "y": "mm",
        "ux": "mm",
        "uy": "mm",
        "uz": "mm",
    }
)
BARE_COLUMNS = ("repeat", "segment")

_EXAMPLES = {
    "MPa": '0.0032, "3.2 kPa" or "3200 Pa"',
    "1/MPa": '5.8, "5.8 1/MPa" or "0.0058 1/kPa"',
    "mm": '0.02, "0.02 mm" or "20 um"',
    "mm/s": '0.5, "0.5 mm/s" or "30 mm/min"',
    "mm/N": '0.2, "0.2 mm/N" or "0.2 um/mN"',
    "N": '0.01, "0.01 N" or "10 mN"',
    "s": '60, "60 s" or "1 min"',
    "1": '0.01 or "1 %"',
}
# Exponents are short and only plain factors are let through: pint evaluates powers, and 9**9**9 never ends.
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)(.*)", re.DOTALL)
_FACTOR = r"(?:1|%|‰|[A-Za-zµμΩ°]+)(?:(?:\*\*|\^)-?[1-9]|[²³])?"
_UNIT = re.compile(rf"{_FACTOR}(?:\s*[*·/ ]\s*{_FACTOR})*")
_HEADER = re.compile(r"([A-Za-z]+)(_sigma)?_([^\s_]+)")
_LONGEST = 80


@functools.cache
def _registry() -> pint.UnitRegistry:
    import pint  # 0.4 s, needed only when some text carries a unit

    return pint.UnitRegistry(non_int_type=Fraction)


@functools.lru_cache(maxsize=256)
def factor(unit: str, base: str) -> Fraction:
    """How many `base` one `unit` is, exactly; ValueError if `unit` is unknown or of another dimension."""
    import pint

    registry = _registry()
    written = unit.strip()
    if len(written) > _LONGEST or not _UNIT.fullmatch(written):
        raise ValueError(f"{written[:_LONGEST]!r} is not a unit")
    try:
        # An offset unit (degree Celsius) has no factor.
        if registry.Quantity(Fraction(0), written).to_base_units().magnitude != 0:
            raise ValueError(f"{written!r} has an offset and cannot be used")
        scale, dimension = registry.get_base_units(registry.parse_units(written))
    except (pint.PintError, AttributeError, TypeError, SyntaxError) as error:
        raise ValueError(f"{written!r} is not a known unit") from error
    base_scale, base_dimension = registry.get_base_units(registry.parse_units("dimensionless" if base == "1" else base))
    if dimension != base_dimension:
        raise ValueError(f"{written!r} is not a unit of the kind {base!r}")
    return Fraction(scale) / Fraction(base_scale)


def quantity(value: str | float, unit: str) -> float:
    """A number with a unit as a float in `unit`; a bare number is taken to be in `unit` already.

    >>> quantity("3.2 kPa", "MPa")
    0.0032

    Raises ValueError for text without a unit, a unit of another dimension, NaN, infinity and booleans; the
    message holds the value, the expected unit and examples.
    """
    examples = _EXAMPLES.get(unit, f'1.5 or "1.5 {unit}"')
    expected = f"expected {'a pure number' if unit == '1' else f'a number in {unit}'}, for example {examples}"
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ValueError(f"{str(value)[:_LONGEST]} is not finite; {expected}")
        return number
    if not isinstance(value, str):
        raise ValueError(f"{str(value)[:_LONGEST]!r} is no number with a unit; {expected}")
    match = _NUMBER.fullmatch(value) if len(value) <= _LONGEST else None
    if match is None:
        raise ValueError(f"{value[:_LONGEST]!r} does not start with a finite number; {expected}")
    digits, written = match.groups()
    if not written.strip():
        raise ValueError(f"{value!r} is text without a unit; {expected}")
    if re.match(r"\s*,\d", written):
        raise ValueError(f"{value!r} has a decimal comma, write a point; {expected}")
    try:
        return float(Fraction(digits) * factor(written, unit))
    except OverflowError as error:
        raise ValueError(f"{value!r} is not finite; {expected}") from error
    except ValueError as error:
        raise ValueError(f"{value!r}: {error}; {expected}") from error


def header(text: str) -> tuple[str, str]:
    """Column header → (name, unit as written): ``"depth_mm"`` → ``("depth", "mm")``; `repeat`, `segment` have no unit.

    ``"Fz_sigma_mN"`` → ``("Fz_sigma", "mN")`` is the stated standard uncertainty of each reading of Fz.
    Raises ValueError listing what is understood.
    """
    name = text.strip()
    if name in BARE_COLUMNS:
        return name, ""
    understood = (
        f"understood are {', '.join(f'{k}_{u}' for k, u in COLUMNS.items())} (or another unit of the same kind)"
    )
    understood += f", Fz_sigma_N and its like for stated uncertainties, and {', '.join(BARE_COLUMNS)} without unit"
    match = _HEADER.fullmatch(name)
    if match is None or match[1] not in COLUMNS:
        raise ValueError(f"unknown column {name[:_LONGEST]!r}; {understood}")
    try:
        factor(match[3], COLUMNS[match[1]])
    except ValueError as error:
        raise ValueError(f"column {name[:_LONGEST]!r}: {error}; {understood}") from error
    return match[1] + (match[2] or ""), match[3]


def column_factor(name: str, unit: str) -> float:
    """Factor that turns a column of :func:`header` into N, mm, s; 1 for columns without unit."""
    return 1.0 if name in BARE_COLUMNS else float(factor(unit, COLUMNS[name.removesuffix("_sigma")]))
