"""Units at the door: text such as ``"3.2 kPa"`` becomes a float in N, mm, MPa, s; bare numbers already are.

Arithmetic is exact (fractions) until the last step, so ``"3.2 kPa"`` and the bare number ``0.0032`` are the same bits.
"""

from __future__ import annotations

import difflib
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
COLUMN_UNITS = MappingProxyType(
    {
        "depth": "mm",
        "time": "s",
        "Fx": "N",
        "Fy": "N",
        "Fz": "N",
        "x": "mm",
        "y": "mm",
        "z": "mm",
        "ux": "mm",
        "uy": "mm",
        "uz": "mm",
    }
)
CHANNEL_UNITS = MappingProxyType(  # of a response, whose values meet those of the columns as they are
    {"time": "s", "travel": "mm", **{c: COLUMN_UNITS[c] for c in ("Fx", "Fy", "Fz", "ux", "uy", "uz")}}
)
BARE_COLUMNS = ("repeat", "segment")
UNIT_LADDERS = {
    "MPa": (("MPa", 1.0), ("kPa", 1e3), ("Pa", 1e6)),
    "N": (("N", 1.0), ("mN", 1e3), ("µN", 1e6), ("nN", 1e9)),
    "mm": (("mm", 1.0), ("µm", 1e3), ("nm", 1e6)),
    "N/mm": (("N/mm", 1.0), ("N/m", 1e3), ("mN/m", 1e6)),
    "N/s": (("N/s", 1.0), ("mN/s", 1e3), ("µN/s", 1e6), ("nN/s", 1e9)),
    "mm/s": (("mm/s", 1.0), ("µm/s", 1e3), ("nm/s", 1e6)),
    "mm/N": (("mm/N", 1.0), ("µm/N", 1e3), ("nm/N", 1e6)),
}
COLUMN_NAMES = (*COLUMN_UNITS, *(f"{name}_sigma" for name in COLUMN_UNITS if name != "z"), *BARE_COLUMNS)
UNITS_OF_KIND = MappingProxyType(
    {"mm": "mm, um, nm, m, inch", "s": "s, ms, min", "N": "N, mN, uN, nN, kN, gf, lbf"}
)  # of each kind, some
WEIGHT_UNITS = MappingProxyType({"g": "gf", "kg": "kgf", "lb": "lbf", "oz": "ozf"})  # masses where only a force can be
_WEIGHT_WORDS = MappingProxyType(  # the same, written out
    {
        "gram": "gf",
        "gramme": "gf",
        "kilogram": "kgf",
        "kilogramme": "kgf",
        "kilo": "kgf",
        "pound": "lbf",
        "lb": "lbf",
        "ounce": "ozf",
    }
)

_UNIT_EXAMPLES = {
    "MPa": '0.0032, "3.2 kPa" or "3200 Pa"',
    "1/MPa": '5.8, "5.8 1/MPa" or "0.0058 1/kPa"',
    "mm": '0.02, "0.02 mm" or "20 um"',
    "mm/s": '0.5, "0.5 mm/s" or "30 mm/min"',
    "mm/N": '0.2, "0.2 mm/N" or "0.2 um/mN"',
    "N/mm": '8.76e-5, "0.0876 N/m" or "87.6 pN/nm"',
    "N": '0.01, "0.01 N" or "10 mN"',
    "s": '60, "60 s" or "1 min"',
    "1": '0.01 or "1 %"',
}
# Exponents are short and only plain factors are let through: pint evaluates powers, and 9**9**9 never ends.
_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)(.*)", re.DOTALL)
_UNIT_FACTOR = r"(?:1|%|‰|[A-Za-zµμΩ°]+)(?:(?:\*\*|\^)-?[1-9]|[²³])?"
_UNIT_PRODUCT = re.compile(rf"{_UNIT_FACTOR}(?:\s*[*·/ ]\s*{_UNIT_FACTOR})*")
_RAISED = re.compile(r"[⁻⁰¹²³⁴-⁹]+")
_FROM_RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_DIVISOR = re.compile(r"/\s*\(([^()/]*)\)")
_HEADER_WITH_UNIT = re.compile(r"([A-Za-z]+)(_sigma)?_([^\s_]+)")
_NAME_AND_ENDING = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|/\s*([^\s/()\[\]]+))", re.DOTALL)
_BRACKETED_UNIT = re.compile(r"\[([^\[\]]*)\]|\(([^()]*)\)|/\s*([^\s/()\[\]]+)")
_NAME_COMMA_UNIT = re.compile(r"(.*\S)\s*,\s*([^\s,]+)\s*", re.DOTALL)  # "Fz, gf"
_UNIT_BEHIND_LOW_LINE = re.compile(r".*_([^\s_]+)", re.DOTALL)
_UNIT_BEHIND_BLANK = re.compile(r".*\S\s+(?:[-–]\s+)?(?!in$)(\S+)", re.DOTALL)  # "Force mN", "Travel - mm"
_NAMES_BY_LOWER = MappingProxyType({name.lower(): name for name in COLUMN_NAMES})
# Units as words, in capitals or not: no unit of one letter more or less is meant.
_WRITTEN_OUT = re.compile(
    r"(?:kilo|centi|milli|micro|nano)?(?:newton|met(?:er|re)|second)s?|microns?|inch(?:es)?|minutes?", re.IGNORECASE
)
_MAX_UNIT_CHARACTERS = 80  # of a unit, or a value with one, that is looked at and shown

# The units that nearly every study has, in m, kg, s, as pint knows them (tests/rso/test_units.py): others load pint,
# which takes 0.4 s, a third of `rso check`.
_LENGTH_DIMENSION, _FORCE_DIMENSION = (("meter", 1),), (("kilogram", 1), ("meter", 1), ("second", -2))
_PRESSURE_DIMENSION, _SPEED_DIMENSION = (("kilogram", 1), ("meter", -1), ("second", -2)), (("meter", 1), ("second", -1))
_COMPLIANCE_DIMENSION = (("kilogram", -1), ("meter", 1), ("second", 2))
_PLAIN_UNITS = MappingProxyType(
    {
        **{
            f"{p}m": (Fraction(10) ** k, _LENGTH_DIMENSION)
            for p, k in (("", 0), ("m", -3), ("u", -6), ("µ", -6), ("n", -9))
        },
        **{
            f"{p}N": (Fraction(10) ** k, _FORCE_DIMENSION)
            for p, k in (("", 0), ("k", 3), ("m", -3), ("u", -6), ("n", -9))
        },
        **{f"{p}Pa": (Fraction(10) ** k, _PRESSURE_DIMENSION) for p, k in (("", 0), ("k", 3), ("M", 6), ("G", 9))},
        **{f"1/{p}Pa": (Fraction(10) ** -k, _COMPLIANCE_DIMENSION) for p, k in (("", 0), ("k", 3), ("M", 6))},
        "mm/s": (Fraction(1, 1000), _SPEED_DIMENSION),
        "mm/min": (Fraction(1, 60000), _SPEED_DIMENSION),
        "s": (Fraction(1), (("second", 1),)),
        "%": (Fraction(1, 100), ()),
        "1": (Fraction(1), ()),
        "dimensionless": (Fraction(1), ()),
    }
)


@functools.cache
def _registry() -> pint.UnitRegistry:
    import pint  # 0.4 s, needed only when some text carries a unit

    return pint.UnitRegistry(non_int_type=Fraction)


@functools.lru_cache(maxsize=256)
def _scale(unit: str) -> tuple[Fraction, tuple[tuple[str, Fraction | int], ...]]:
    """A unit in m, kg, s, …, exactly, and its kind as their powers; ValueError if there is no such unit."""
    written = unit.strip().removesuffix(".")
    if _WRITTEN_OUT.fullmatch(written):
        written = written.lower()
    return _PLAIN_UNITS[written] if written in _PLAIN_UNITS else _by_pint(written)


def _in_one_line(unit: str) -> str:
    """A unit without raised digits, as reports print it, and without a divisor in brackets: m⁴/(N·s) is m^4/N/s."""
    flat = _RAISED.sub(lambda found: "^" + found[0].translate(_FROM_RAISED), unit)
    return _DIVISOR.sub(lambda found: "".join(f"/{f}" for f in re.split(r"[*· ]+", found[1].strip())), flat)


def _by_pint(unit: str) -> tuple[Fraction, tuple[tuple[str, Fraction | int], ...]]:
    """The same of any unit that pint knows."""
    written = _in_one_line(unit) if len(unit) <= _MAX_UNIT_CHARACTERS else unit
    if len(written) > _MAX_UNIT_CHARACTERS or not _UNIT_PRODUCT.fullmatch(written):
        raise ValueError(f"{unit[:_MAX_UNIT_CHARACTERS]!r} is not a unit")
    if "px" in written:  # pint's are those of a screen
        raise ValueError(f"{written!r} is a pixel, no length of a body: multiply by the length of one")
    import pint

    registry = _registry()
    try:
        # An offset unit (degree Celsius) has no factor.
        if registry.Quantity(Fraction(0), written).to_base_units().magnitude != 0:
            raise ValueError(f"{written!r} has an offset and cannot be used")
        scale, dimension = registry.get_base_units(registry.parse_units(written))
    except (pint.PintError, AttributeError, TypeError, SyntaxError) as error:
        raise ValueError(f"{written!r} is not a known unit") from error
    assert isinstance(scale, Fraction | int | float)
    powers: list[tuple[str, Fraction | int]] = []
    for name, power in sorted(dimension._units.items()):
        assert isinstance(power, Fraction | int)
        powers.append((name, power))
    return Fraction(scale), tuple(powers)


def spaced(unit: str) -> str:
    """What stands behind a number in a sentence: a blank and its unit, nothing where it has none ("1")."""
    return "" if unit in ("", "1") else f" {unit}"


def same(unit: str, base: str) -> bool:
    """Whether they are one unit, however it is written."""
    try:
        return unit == base or conversion_factor(unit, base) == 1
    except ValueError:
        return False


@functools.lru_cache(maxsize=256)
def conversion_factor(unit: str, base: str) -> Fraction:
    """How many `base` one `unit` is, exactly; ValueError if `unit` is unknown or of another dimension."""
    scale, dimension = _scale(unit)
    base_scale, base_dimension = _scale("dimensionless" if base == "1" else base)
    if dimension != base_dimension:
        raise ValueError(f"{unit.strip()!r} is not a unit of the kind {base!r}")
    return scale / base_scale


def unit_or_count_factor(unit: str, base: str) -> Fraction:
    """How many `base` one `unit` is, or one count of a raw channel: ``"0.00125 mm"`` for a motor's step.

    ValueError as :func:`conversion_factor`, and for what is not positive.
    """
    match = _NUMBER_AND_UNIT.fullmatch(unit) if is_counted(unit) else None
    if match is None:
        return conversion_factor(unit, base)
    if Fraction(match[1]) <= 0:
        raise ValueError(f"{unit!r} must be positive; flip turns a sign")
    return Fraction(match[1]) * conversion_factor(match[2], base)


def is_counted(unit: str | None) -> bool:
    """Whether a unit says what one count is: a number with a unit."""
    return unit is not None and len(unit) <= _MAX_UNIT_CHARACTERS and _NUMBER_AND_UNIT.fullmatch(unit) is not None


def is_unit(text: str) -> bool:
    """Whether a text is a unit that numbers alone do not have."""
    try:
        return _scale(text)[1] != _scale("dimensionless")[1]
    except ValueError:
        return False


def value_in_unit(value: str | float, unit: str) -> float:
    """A number with a unit as a float in `unit`; a bare number is taken to be in `unit` already.

    >>> quantity("3.2 kPa", "MPa")
    0.0032

    Raises ValueError for text without a unit, a unit of another dimension, NaN, infinity and booleans; the
    message holds the value, the expected unit and examples.
    """
    examples = _UNIT_EXAMPLES.get(unit, f'1.5 or "1.5 {unit}"')
    expected = f"expected {'a pure number' if unit == '1' else f'a number in {unit}'}, for example {examples}"
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ValueError(f"{str(value)[:_MAX_UNIT_CHARACTERS]} is not finite; {expected}")
        return number
    if not isinstance(value, str):
        raise ValueError(f"{str(value)[:_MAX_UNIT_CHARACTERS]!r} is no number with a unit; {expected}")
    match = _NUMBER_AND_UNIT.fullmatch(value) if len(value) <= _MAX_UNIT_CHARACTERS else None
    if match is None:
        raise ValueError(f"{value[:_MAX_UNIT_CHARACTERS]!r} does not start with a finite number; {expected}")
    digits, written = match.groups()
    if not written.strip():
        raise ValueError(f"{value!r} is text without a unit; {expected}")
    if re.match(r"\s*,\d", written):
        raise ValueError(f"{value!r} has a decimal comma, write a point; {expected}")
    try:
        return float(Fraction(digits) * conversion_factor(written, unit))
    except OverflowError as error:
        raise ValueError(f"{value!r} is not finite; {expected}") from error
    except ValueError as error:
        raise ValueError(f"{value!r}: {error}; {expected}") from error


def in_base(text: str) -> tuple[float, str]:
    """Text with a unit as a number in N, mm, MPa, s, and the unit that this is: ``"3.2 kPa"`` → (0.0032, "MPa").

    Angles stay in degrees where they are given so; a unit of another kind stays as it is.  ValueError as
    :func:`value_in_unit`.
    """
    match = _NUMBER_AND_UNIT.fullmatch(text) if len(text) <= _MAX_UNIT_CHARACTERS else None
    unit = match[2].strip() if match else ""
    if not unit:
        raise ValueError(f"{text[:_MAX_UNIT_CHARACTERS]!r} is no number with a unit")
    base = unit if unit in ("deg", "°") else next((b for b in _UNIT_EXAMPLES if is_of(b, unit)), unit)
    return value_in_unit(text, base), base


def people(unit: str, size: float) -> tuple[str, float]:
    """The unit that people use for a quantity of this size, and the factor to it: 0.014 MPa is 14 kPa."""
    ladder = UNIT_LADDERS.get(unit, ((unit, 1.0),))
    return next(((label, k) for label, k in ladder if abs(size) * k >= 0.1), ladder[-1]) if size else ladder[0]


def header(text: str) -> tuple[str, str]:
    """Column header → (name, unit as written): ``"depth_mm"`` → ``("depth", "mm")``; `repeat`, `segment` have no unit.

    ``"Depth [mm]"``, ``"depth (mm)"`` and ``"depth/mm"`` say the same, in capitals or not.
    ``"Fz_sigma_mN"`` → ``("Fz_sigma", "mN")`` is the stated standard uncertainty of each reading of Fz.
    Raises ValueError listing what is understood.
    """
    written = text.strip()
    if written.lower() in BARE_COLUMNS:
        return written.lower(), ""
    low_line, ending = _HEADER_WITH_UNIT.fullmatch(written), _ending(written)
    name, unit = None, ""
    if low_line and low_line[1] in COLUMN_UNITS:
        name, unit = low_line[1] + (low_line[2] or ""), low_line[3]
    elif ending:
        name, unit = _NAMES_BY_LOWER.get(ending[0].lower()), ending[1]
    if name is None or name in BARE_COLUMNS:
        what = "column {} has no unit" if written.lower() in _NAMES_BY_LOWER else "unknown column {}"
        raise ValueError(f"{what.format(repr(written[:_MAX_UNIT_CHARACTERS]))}; {_meant(written)}{_understood()}")
    try:
        conversion_factor(unit, kind_of(name))
    except ValueError as error:
        raise ValueError(f"column {written[:_MAX_UNIT_CHARACTERS]!r}: {error}; {_understood()}") from error
    return name, unit


@functools.lru_cache  # a table of many columns asks the same of each
def _meant(written: str) -> str:
    """The nearest column to one that is written nearly so."""
    usual = [f"{k}_{u}" for k, u in COLUMN_UNITS.items()]
    near = difflib.get_close_matches(written[:_MAX_UNIT_CHARACTERS], [*usual, *BARE_COLUMNS], n=1)
    return f"did you mean {near[0]}? " if near else ""


@functools.cache
def _understood() -> str:
    columns = ", ".join(f"{k}_{u}" for k, u in COLUMN_UNITS.items())
    return (
        f"understood are {columns} (or another unit of the same kind), Fz_sigma_N and its like for stated "
        f"uncertainties, and {', '.join(BARE_COLUMNS)} without unit"
    )


def _ending(text: str) -> tuple[str, str] | None:
    """``"Weg [mm]"``, ``"Weg (mm)"`` or ``"Weg/mm"`` → ``("Weg", "mm")``."""
    match = _NAME_AND_ENDING.fullmatch(text) if len(text) <= _MAX_UNIT_CHARACTERS else None
    return (match[1], (match[2] or match[3] or match[4] or "").strip()) if match else None


def unit_in(text: str, name: str) -> str | None:
    """The unit that any header says of the column `name`: mm in ``"Weg [mm] (roh)"``, None in ``"Weg (Traverse)"``.

    Behind a low line, a comma or a blank or before other words only a unit of the right kind counts: the A of
    ``"Load_A"`` and of ``"Load, A"`` is a channel, not an ampere.
    """
    written = text.strip()
    if (ending := _ending(written)) and is_unit(ending[1]):
        return ending[1]
    base = kind_of(name)
    for unit in reversed(["".join(group).strip() for group in _BRACKETED_UNIT.findall(written)]):
        # KN is no unit, but says that N is not meant.
        if (
            is_of(base, unit)
            or unit.lower() in UNITS_OF_KIND[base].lower().split(", ")
            or (base == "N" and weight(unit))
        ):
            return unit
    if (comma := _NAME_COMMA_UNIT.fullmatch(written)) and (is_of(base, comma[2]) or (base == "N" and weight(comma[2]))):
        return comma[2]
    bare = _BRACKETED_UNIT.sub("", written).strip()
    if (low_line := _UNIT_BEHIND_LOW_LINE.fullmatch(bare)) and is_of(base, low_line[1]):
        return low_line[1]
    blank = _UNIT_BEHIND_BLANK.fullmatch(bare)
    if blank is None or re.search(r"\d\s*$", bare[: blank.start(1)]):  # "Load cell 50 kN" is what a cell is for
        return None
    customary = blank[1] in UNITS_OF_KIND[base].split(", ") or _WRITTEN_OUT.fullmatch(blank[1])
    said = (customary and is_of(base, blank[1])) or (base == "N" and weight(blank[1]) is not None)
    return blank[1] if said else None


def bracketed(text: str, name: str) -> str | None:
    """What stands where a header of the column `name` says its unit and is none: kp in ``"Kraft [kp]"``, else None.

    Square brackets hold nothing but units; round ones and a slash may hold words, but for % and words with a unit of
    the right kind among them: ``"Kraft (mN, tared)"``.
    """
    if unit_in(text, name) is not None:
        return None
    for square, *other in _BRACKETED_UNIT.findall(text):
        words = "".join(other).strip()
        told = re.findall(r"[A-Za-zµμ]+|%", words)
        if square.strip() or any(word == "%" or is_of(kind_of(name), word) for word in told):
            return square.strip() or words
    return None


def weight(unit: str) -> str | None:
    """The force that a mass stands for where only a force can be: gf for g, gram and Grams; None for what is none."""
    return WEIGHT_UNITS.get(unit) or _WEIGHT_WORDS.get(unit.lower().removesuffix("s"))


def is_of(base: str, unit: str) -> bool:
    """Whether a text is a unit of the kind of `base`."""
    try:
        return bool(conversion_factor(unit, base))
    except ValueError:
        return False


def kind_of(name: str) -> str:
    """The unit behind the door of a column of :func:`header`; empty for those without."""
    return COLUMN_UNITS.get(name.removesuffix("_sigma"), "")


def column_factor(name: str, unit: str) -> float:
    """Factor that turns a column, of a unit or of counts, into N, mm, s; 1 for columns without unit."""
    return 1.0 if name in BARE_COLUMNS else float(unit_or_count_factor(unit, kind_of(name)))
