"""Exact similarity: Buckingham's Π theorem applied to the units that the knobs declare.

Lengths and times are left alone; only the unit of stress is changed. If every constant of the model that
has a stress in its unit is a listed parameter, then for any s > 0

    F(..., θ_i s^(e_i), ...) = s^(e_F) F(..., θ_i, ...),

where e is the exponent of stress in a unit (MPa: 1, 1/MPa: −1, N: 1 at fixed lengths, mm and s: 0). One
modulus can therefore be held at a reference value, and its effect is known without running it.
Source: Buckingham, Phys. Rev. 4 (1914) 345, eq. 8, with force as the only scaled dimension.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from rso.contract import Parameter

_UNITS_WITH_FORCE = ("N", "mN", "uN", "µN", "kN", "Pa", "kPa", "MPa", "GPa", "J", "mJ", "kg", "g", "t", "tonne")
_UNITS_WITHOUT_FORCE = (
    "1",
    "-",
    "%",
    "mm",
    "um",
    "µm",
    "cm",
    "m",
    "s",
    "ms",
    "min",
    "h",
    "Hz",
    "rad",
    "deg",
    "°",
    "K",
    "degC",
    "°C",
)
_UNIT_TOKEN = re.compile(r"\s*(\*\*|\^|[*/·()]|[-+]?\d+(?:\.\d+)?|[^\W\d_]+|[°%µ-][A-Za-z]*)")


def stress_exponent(unit: str) -> int:
    """Exponent of stress in a unit at fixed lengths and times: MPa 1, N/mm 1, 1/MPa −1, MPa*s 1, mm 0.

    Understands products (`*`, `·`, space), quotients (`/` divides by the next factor), powers (`^`, `**`) and
    brackets; mass counts as force (N s²/mm). Raises ValueError for an unknown unit or a fractional exponent.
    """
    text = unit.strip()
    if text in ("", "-"):
        return 0
    tokens, at = [], 0
    while at < len(text):
        match = _UNIT_TOKEN.match(text, at)
        if match is None:
            raise ValueError(f"unit {unit!r}: cannot read {text[at:]!r}")
        tokens.append(match.group(1))
        at = match.end()
    value = _product(tokens, unit)
    if tokens:
        raise ValueError(f"unit {unit!r}: unexpected {tokens[0]!r}")
    if value != int(value):
        raise ValueError(f"unit {unit!r}: stress to the power {value:g} is not an integer power")
    return int(value)


def _product(tokens: list[str], unit: str) -> float:
    total = _factor(tokens, unit)
    while tokens and tokens[0] != ")":
        sign = 1
        if tokens[0] in ("*", "·", "/"):
            sign = -1 if tokens.pop(0) == "/" else 1
        total += sign * _factor(tokens, unit)
    return total


def _factor(tokens: list[str], unit: str) -> float:
    if not tokens:
        raise ValueError(f"unit {unit!r} ends too early")
    token = tokens.pop(0)
    if token == "(":
        base = _product(tokens, unit)
        if not tokens or tokens.pop(0) != ")":
            raise ValueError(f"unit {unit!r}: a bracket is not closed")
    elif token in _UNITS_WITH_FORCE:
        base = 1.0
    elif token in _UNITS_WITHOUT_FORCE or re.fullmatch(r"\d+(\.\d+)?", token):
        base = 0.0
    else:
        raise ValueError(
            f"unit {unit!r}: unknown {token!r}; known: {', '.join(_UNITS_WITH_FORCE + _UNITS_WITHOUT_FORCE)}"
        )
    if tokens and tokens[0] in ("^", "**"):
        tokens.pop(0)
        bracket = bool(tokens) and tokens[0] == "("
        if bracket:
            tokens.pop(0)
        power = tokens.pop(0) if tokens else ""
        if not re.fullmatch(r"[-+]?\d+(\.\d+)?", power) or (bracket and (not tokens or tokens.pop(0) != ")")):
            raise ValueError(f"unit {unit!r}: {power!r} is not a power")
        return base * float(power)
    return base


@dataclass(frozen=True)
class Group:
    """A one-parameter scaling group: `reference` is held at `reference_value`, the rest scales with it.

    `reference` is None where nothing can be scaled out; reduce and expand then change nothing, and `why` says
    what stands in the way.
    """

    reference: str | None
    reference_value: float
    exponents: Mapping[str, int]
    outputs: Mapping[str, int]
    why: str

    @property
    def saved(self) -> int:
        """Dimensions that the design loses: 1 or 0."""
        return int(self.reference is not None)

    def reduce(self, values: Mapping[str, float]) -> tuple[float, dict[str, float]]:
        """(s, θ'): s = modulus / reference value and θ'_i = θ_i s^(−e_i); the modulus becomes its reference.

        Raises ValueError for a modulus that is not positive.
        """
        if self.reference is None:
            return 1.0, dict(values)
        s = float(values[self.reference]) / self.reference_value
        if not s > 0:
            raise ValueError(
                f"similarity: {self.reference} = {values[self.reference]} must be positive to be scaled out"
            )
        reduced = {k: float(v) * s ** -self.exponents.get(k, 0) for k, v in values.items()}
        reduced[self.reference] = self.reference_value
        return s, reduced

    def reduced_range(self, low: Mapping[str, float], high: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Smallest ranges of the reduced parameters that cover every θ in [low, high]; the modulus is left out."""
        if self.reference is None:
            return {k: (float(low[k]), float(high[k])) for k in low}
        s = [float(end[self.reference]) / self.reference_value for end in (low, high)]
        ranges = {}
        for k in low:
            if k != self.reference:
                ends = [v * f ** -self.exponents.get(k, 0) for v in (low[k], high[k]) for f in s]
                ranges[k] = (min(ends), max(ends))
        return ranges

    @overload
    def expand(self, channel: str, y: float, scale: float) -> float: ...
    @overload
    def expand(self, channel: str, y: np.ndarray, scale: float | np.ndarray) -> np.ndarray: ...
    def expand(self, channel: str, y: float | np.ndarray, scale: float | np.ndarray) -> float | np.ndarray:
        """Output of the full problem, y s^(e_channel), from that of the reduced one; y number or array."""
        if channel not in self.outputs:
            raise ValueError(f"similarity: unknown channel {channel!r}; known: {', '.join(sorted(self.outputs))}")
        return y * scale ** self.outputs[channel]


def group(
    parameters: Sequence[Parameter],
    output_units: Mapping[str, str],
    *,
    reference: str | None = None,
    reference_value: float | None = None,
    constants: Mapping[str, str] | None = None,
) -> Group:
    """The scaling group of a model, from the units of its free parameters and of its outputs.

    `reference` is the modulus to hold (default: the first parameter with a stress exponent of 1 and positive
    bounds) at `reference_value` (default: the geometric mean of its bounds). `constants` names whatever the
    model keeps fixed (settings, parameters not opened unless they are zero) with units: a single one with a
    stress in it breaks the theorem, and the group is then the identity.
    """
    exponents = {p.name: stress_exponent(p.unit) for p in parameters}
    outputs = {k: stress_exponent(u) for k, u in output_units.items()}
    fixed = [f"{k} ({u})" for k, u in (constants or {}).items() if stress_exponent(u) != 0]
    moduli = [p for p in parameters if exponents[p.name] == 1 and p.low > 0]
    if reference is not None:
        moduli = [p for p in moduli if p.name == reference]
        if not moduli:
            raise ValueError(f"similarity: {reference!r} is not a positive parameter with the unit of a stress")
    if fixed or not moduli:
        why = (
            f"fixed with a stress in its unit: {', '.join(fixed)}"
            if fixed
            else "no positive modulus among the parameters"
        )
        return Group(None, 1.0, exponents, outputs, why)
    p = moduli[0]
    value = (p.low * p.high) ** 0.5 if reference_value is None else float(reference_value)
    if not value > 0:
        raise ValueError(f"similarity: reference value of {p.name} must be positive, got {value} {p.unit}")
    n = len(parameters)
    return Group(p.name, value, exponents, outputs, f"{n} → {n - 1} dimensions: {p.name} held at {value:.4g} {p.unit}")
