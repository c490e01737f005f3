"""The catalogue: every knob with a plausible range is a hypothesis, of the backend and of the measurement chain.

An effect has a size (one knob, or a variant of the settings with its knob) and perhaps a shape (the other knobs of its
group that have a plausible range).  There is no list of effects here: it follows from what the backend and the
measurement chain declare.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rso.contract import Backend, NominalValues, Parameter, PlausibleRanges, Scope, Variants, capability, parameters_of
from rso.core.similarity import stress_exponent
from rso.data import CROSS_KNOBS, LATERAL_KNOBS, Chain

_SMALLEST_SIZE_RATIO = 1 / 40  # of the largest plausible size, where a range has no smallest size of its own
_LOGARITHMIC_RANGE_RATIO = 4.0  # ends of a range further apart than this are spaced logarithmically
DECLARED_FORCES_N = 0.2, 2.0  # N: largest forces for which the errors of a load cell are plausible as they are declared
# s: the same for errors of the clock, of the fastest loading of a plan, where they show most
DECLARED_LOADING_TIMES_S = 1.5, 20.0
DECLARED_TEST_TIMES_S = 5.0, 100.0  # s: and for a drift, of the longest test
# Of force, length, fastest loading and longest test in units of the chain.
UNIT_POWERS = {
    "N": (1, 0, 0, 0),
    "N/s": (1, 0, 0, -1),
    "1/N": (-1, 0, 0, 0),
    "mm": (0, 1, 0, 0),
    "mm/N": (-1, 1, 0, 0),
    "s": (0, 0, 1, 0),
}
# times what is plausible everywhere: how far a test at one place may have been done from there
ONE_PLACE_ERROR_RATIO = 5.0


@dataclass(frozen=True)
class Size:
    """One knob of an effect on a line s: v = neutral ± s, or neutral · exp(± s) for a ratio, or s itself as ln v.

    `low`, `high` bound the plausible values; `neutral` is where the effect is absent, None for a shape or a variant.
    Values of knobs whose unit holds a stress are multiples of the modulus (`exponent` 1 or −1).
    """

    name: str
    description: str
    unit: str
    low: float
    high: float
    neutral: float | None
    exponent: int = 0

    @property
    def ratio(self) -> bool:
        """Whether sizes are ratios to neutral."""
        return bool(self.neutral) and self.low > 0 and self.high / self.low > _LOGARITHMIC_RANGE_RATIO

    def value(self, s: np.ndarray | float) -> np.ndarray:
        """Value of the knob at signed deviations s (any shape); 0 is neutral."""
        s = np.asarray(s, float)
        if self.neutral is None:
            return np.exp(s) if self.logarithmic else s
        return self.neutral * np.exp(s) if self.ratio else self.neutral + s

    @property
    def power_of_time(self) -> int:
        """1 of a time, −1 of what goes with the inverse of one, as a permeability does, 0 of all others."""
        return 1 if self.unit == "s" else -1 if self.unit.endswith("/s") else 0

    @property
    def logarithmic(self) -> bool:
        """Whether a shape is spaced logarithmically."""
        return self.low > 0 and self.high / self.low > _LOGARITHMIC_RANGE_RATIO

    def ends(self) -> tuple[tuple[float, float], ...]:
        """(smallest, largest) signed deviation on each side of neutral that is plausible."""
        if self.neutral is None:
            low, high = (math.log(v) if self.logarithmic else v for v in (self.low, self.high))
            return ((low, high),)
        span = [math.log(v / self.neutral) if self.ratio else v - self.neutral for v in (self.low, self.high)]
        if span[0] < 0 < span[1]:
            return tuple((math.copysign(abs(e) * _SMALLEST_SIZE_RATIO, e), e) for e in span)
        near, far = sorted(span, key=abs)
        return ((near if near else far * _SMALLEST_SIZE_RATIO, far),)


@dataclass(frozen=True, eq=False)
class Effect:
    """A hypothesis: `size` and `shape` knobs, the `settings` it replaces (a variant), and where it lives.

    `family` is 'model' (the backend computes it), 'measurement' (the chain; costs no simulation) or 'scatter' (a knob
    of the chain that every curve has for itself: its size is a standard deviation).  `place` holds the settings of the
    only place where it acts; None: it acts everywhere.  `label` is what reports call it.  `known` is the standard
    uncertainty of its size by a calibration, None where there is none.
    """

    name: str
    description: str
    family: str
    size: Size
    shape: tuple[Size, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    cause: str = ""
    scope: Scope = "study"
    place: Mapping[str, Any] | None = None
    label: str = ""
    known: float | None = None

    @property
    def measured(self) -> bool:
        """Whether it lies in the measurement: in its chain, or in a test done elsewhere than it says."""
        return self.family != "model" or self.place is not None

    @property
    def is_gain(self) -> bool:
        """Whether it multiplies forces, as a modulus does."""
        return self.size.name == "gain"

    @property
    def is_scale(self) -> bool:
        """Whether it multiplies forces or depths, which calibration alone knows."""
        return self.size.name in ("gain", "depth_scale")

    @property
    def like_a_modulus(self) -> bool:
        """Whether it multiplies all forces of a test: a modulus that changes from test to test does the same."""
        return self.family == "scatter" and self.is_gain

    @property
    def like_a_body(self) -> bool:
        """Whether it yields with time under a load: a body out of which water is pressed does nearly the same."""
        return self.size.name == "creep"

    @property
    def like_a_spot(self) -> bool:
        """Whether it gives way at one place alone: a softer spot of the body there does nearly the same."""
        return self.place is not None and self.size.name == "compliance"

    @property
    def flows(self) -> bool:
        """Whether it goes on in a rest for a time that depends on the size of what is pressed: a shape is a rate.

        Its rests are simulated; those of a time of its own are exponentials.
        """
        return self.family == "model" and any(s.power_of_time < 0 for s in self.shape)

    def acts(self, place: Mapping[str, Any]) -> bool:
        """Whether it acts at a place with these settings."""
        return self.place is None or self.place == place

    @property
    def source(self) -> str:
        """What the effect is a form of: its cause, or else its name."""
        return self.cause or self.name

    @property
    def knobs(self) -> tuple[Size, ...]:
        """Size and shape."""
        return (self.size, *self.shape)


def catalogue(
    backend: Backend, settings: Mapping[str, Any], fixed: Mapping[str, float], opened: Sequence[str]
) -> tuple[Effect, ...]:
    """Every effect of the backend at these settings and of the measurement chain, without the study's own parameters.

    A knob that the study fixes is neutral at that value.  What is plausible may depend on the settings.
    """
    neutral = {p.name: p.neutral for p in backend.parameters}
    given = {*opened, *(k for k, v in fixed.items() if v != neutral.get(k))}
    priors, stated = capability(backend, PlausibleRanges), capability(backend, NominalValues)
    others = capability(backend, Variants)
    ranges = priors.plausible(settings, given) if priors else {}
    known = [replace(p, plausible=ranges.get(p.name, p.plausible)) for p in backend.parameters if p.name not in opened]
    variants = others.variants(settings) if others else {}
    nominal = stated.nominal(settings) if stated else {}
    effects = _grouped(known, nominal, fixed, "model")
    for name, variant in variants.items():
        members = [p for p in known if p.group == variant["group"] and p.group and p.plausible]
        if members:
            effects.append(
                Effect(
                    members[0].name,
                    f"{name}: {members[0].description}",
                    "model",
                    _size(members[0], None),
                    tuple(_size(p, None) for p in members[1:]),
                    variant["settings"],
                    label=variant["description"],
                )
            )
        else:
            effects.append(
                Effect(
                    name,
                    variant["description"],
                    "model",
                    Size(name, variant["description"], "1", 0, 1, None),
                    (),
                    variant["settings"],
                    label=variant["description"],
                )
            )
    return (*effects, *_grouped(parameters_of(Chain), {}, {}, "measurement"), *_scatter())


def bounded(
    effects: Sequence[Effect],
    reference: float,
    physical: Mapping[str, tuple[float, float]],
    hard: Mapping[str, float],
) -> tuple[tuple[Effect, ...], list[str]]:
    """Effects with sizes that no ordinary body leaves at the modulus `reference` (MPa), and what to say of the others.

    Sizes with a stress in their unit are multiples of the modulus; `physical` bounds, and `hard` ones of the knobs, are
    not.  What is below the smallest plausible multiple even at its bound cannot be seen and is left out.
    """
    kept, told = [], []
    for e in effects:
        k = e.size
        unit = reference**k.exponent if k.exponent else 1.0
        most = min(physical.get(k.name, (0.0, math.inf))[1], hard.get(k.name, math.inf)) / unit
        if not k.exponent or not most < k.high:
            kept.append(e)
        elif most > k.low:
            kept.append(replace(e, size=replace(k, high=most)))
        else:
            told.append(
                f"{e.label or k.name} is at most {most * unit:.2g} {k.unit} and cannot be seen in a body of "
                f"{reference:.2g} MPa: it is no hypothesis"
            )
    return tuple(kept), told


def suited(
    effects: Sequence[Effect],
    force: float,
    scale: float = 1.0,
    times: tuple[float, float] = (DECLARED_LOADING_TIMES_S[0], DECLARED_TEST_TIMES_S[0]),
) -> tuple[Effect, ...]:
    """The effects with the errors of the measurement in proportion to the largest `force` (N), if that is not
    DECLARED_FORCES_N, and to the lengths of the plan, `scale` times the usual ones, and all in proportion to its
    `times` (s), see :attr:`TestPlan.times`, if those are not DECLARED_LOADING_TIMES_S and DECLARED_TEST_TIMES_S.

    A cell of a larger range has larger errors of zero; where contact was is known to a share of the travel; what a load
    train gives way by counts by both.  Clocks are as far apart as a share of the loading; what drifts does so by as
    much in a long test as in a short one; what relaxes takes as long as the quickest or the longest test can show.
    """
    brisk, lasting = _beyond(times[0], DECLARED_LOADING_TIMES_S), _beyond(times[1], DECLARED_TEST_TIMES_S)
    by = [_beyond(force, DECLARED_FORCES_N), scale, brisk, lasting]
    # in powers of two: data sets of one plan share a library, though their clocks differ a little
    quick, long = (2.0 ** round(math.log2(v)) for v in (brisk, lasting))
    found = []
    for e in effects:
        powers = (0,) * 4 if e.family == "model" else UNIT_POWERS.get(e.size.unit, (0,) * 4)
        k = math.prod(v**p for v, p in zip(by, powers, strict=True))
        size = replace(e.size, low=k * e.size.low, high=k * e.size.high) if any(powers) else e.size
        factors = [{1: (quick, long), -1: (1.0 / long, 1.0 / quick)}.get(s.power_of_time, (1.0, 1.0)) for s in e.shape]
        shape = tuple(replace(s, low=a * s.low, high=b * s.high) for s, (a, b) in zip(e.shape, factors, strict=True))
        found.append(replace(e, size=size, shape=shape))
    return tuple(found)


def _beyond(value: float, usual: tuple[float, float]) -> float:
    """How many times as large as the nearest usual one a value is: 1 inside; nothing has no size and is usual."""
    return value / min(max(value, usual[0]), usual[1]) or 1.0


def measured_effects(effects: Sequence[Effect], channels: Collection[str]) -> tuple[Effect, ...]:
    """The effects without those of a channel that was not measured: they are none of this plan."""
    lost = {knob for channel, knob in CROSS_KNOBS.items() if channel not in channels}
    lost.update(LATERAL_KNOBS if lost == set(CROSS_KNOBS.values()) else ())
    return tuple(e for e in effects if e.family == "model" or e.size.name not in lost)


def localised(effects: Sequence[Effect], places: Mapping[str, Mapping[str, Any]]) -> tuple[Effect, ...]:
    """The effects, and those that a place may have for itself (scope "place") once more at each of several `places`.

    `places` maps a label to settings.  At one place they are forms of a cause of its own.  One with two signs is a
    position, and up to ONE_PLACE_ERROR_RATIO times as large: a test done elsewhere than noted.
    """
    found = list(effects)
    for e in effects if len(places) > 1 else ():
        for label, place in places.items() if e.scope == "place" else ():
            size, middle = e.size, e.size.neutral or 0.0
            if len(size.ends()) == 2:
                low, high = (middle + ONE_PLACE_ERROR_RATIO * (v - middle) for v in (size.low, size.high))
                size = replace(size, low=low, high=high)
            found.append(
                replace(
                    e,
                    name=f"{e.name} at {label}",
                    description=f"{e.description}, at {label} alone",
                    size=size,
                    cause=f"{e.source} at one place",
                    place=place,
                    label=f"{e.label or e.name} at {label}",
                )
            )
    return tuple(found)


def _scatter() -> list[Effect]:
    """Knobs of the chain that may differ from curve to curve."""
    found = []
    for p in parameters_of(Chain):
        if p.scope in ("mounting", "curve") and p.plausible is not None and (neutral := p.neutral) is not None:
            high = max(abs(v - neutral) for v in p.plausible)
            size = Size(p.name, f"{p.description}, each curve its own", p.unit, 0.1 * high, high, 0.0)
            label = f"{p.label or p.name} of each curve"
            found.append(Effect(f"{p.name}_each", size.description, "scatter", size, cause=p.name, label=label))
    return found


def _grouped(
    parameters: Sequence[Parameter], nominal: Mapping[str, float], fixed: Mapping[str, float], family: str
) -> list[Effect]:
    """One effect per group whose first member with a neutral value has a plausible range.

    Further members are its shapes; but those that the settings set too, `nominal` ones, are effects by themselves.
    """
    found: dict[str, Effect] = {}
    for p in parameters:
        if p.plausible is None:
            continue
        group = p.group or p.name
        neutral = {**nominal, **fixed}.get(p.name, p.neutral)
        if group in found and p.name in nominal:
            group = p.name
        if group not in found and neutral is not None:
            found[group] = Effect(
                p.name, p.description, family, _size(p, neutral), cause=p.cause, scope=p.scope, label=p.label
            )
        elif group in found and p.name not in fixed:
            e = found[group]
            found[group] = replace(e, shape=(*e.shape, _size(p, None)))
    return list(found.values())


def _size(p: Parameter, neutral: float | None) -> Size:
    assert p.plausible is not None
    return Size(p.name, p.description, p.unit, *p.plausible, neutral, stress_exponent(p.unit))
