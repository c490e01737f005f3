"""What an interval says about a parameter, in one word, in digits and in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rso.core.digits import interval_ends, significant, two_digits
from rso.core.symbols import unit_text
from rso.core.units import people
from rso.doe import Box
from rso.inference.intervals import Interval, ProfileInterval
from rso.inference.rules import RULES, IdentificationRules

Word = Literal["determined", "weakly", "not"]
VERDICT_WORDS = {"determined": "is determined", "weakly": "is weakly determined", "not": "is not determined"}
ROUND_OFF_SHARE = 1e-6  # of the uncertainty: a change that is round-off
LOWER_NOISE_RATIOS = np.geomspace(1.0, 1e-3, 61)  # times what it is


@dataclass(frozen=True)
class Verdict:
    """One word; how many digits of the value are warranted (0: none); what of the noise would be little enough."""

    word: Word
    digits: int
    noise_factor: float | None


def judge_parameter(
    box: Box,
    k: int,
    interval: Interval,
    leaning: tuple[str, ...] = (),
    scale: float = 1.0,
    stated: Box | None = None,
    rules: IdentificationRules = RULES,
) -> Verdict:
    """'not': the interval covers half of the box or of the `stated` range, or ends at both bounds, or at one of a model
    that is refuted; else 'determined': it lies inside the box, its ends are within a factor 1.75 of its middle, and the
    model is not refuted; 'weakly': what lies between.

    Parameters that may be zero or negative are measured against their stated range: within ± 10 % of it is determined.
    A range that was widened since makes no interval narrower.
    `leaning` names other parameters whose bounds end the interval; then a factor 1.25 is asked for.  `scale` is what
    the errors were multiplied with as the model does not fit: beyond `refuted_error_ratio` nothing is determined.
    """
    low, high = physical(box, k, interval)
    width, covered = _shares(box, k, interval, box if stated is None else stated)
    if low > 0:
        most = math.log(rules.leaning_factor if leaning else rules.determined_factor)
        close, digits = 0.5 * math.log(high / low) <= most, _digits(math.sqrt(low * high), low, high)
    else:
        close, digits = width <= 0.2, _digits(0.5 * (low + high), low, high)
    pressed = interval.open and scale > rules.refuted_error_ratio  # it wants to go on, and fits nowhere
    word: Word = (
        "not" if covered >= rules.uninformative_share or (interval.at_low and interval.at_high) or pressed else "weakly"
    )
    if word == "weakly" and close and not interval.open and scale <= rules.refuted_error_ratio:
        return Verdict("determined", digits, None)
    return Verdict(word, digits if word == "weakly" and not interval.open else 0, None)


def _shares(box: Box, k: int, interval: Interval, stated: Box) -> tuple[float, float]:
    """Width of an interval over the stated range, and the larger share of that range and of the box that it covers."""
    X = np.full((2, box.d), 0.5)
    X[:, k] = [interval.low, interval.high]
    low, high = stated.to_unit(box.from_unit(X))[:, k]
    return high - low, max(min(high, 1.0) - max(low, 0.0), interval.high - interval.low)


def quieter(box: Box, k: int, profile: ProfileInterval, level: float = 0.9, stated: Box | None = None) -> float | None:
    """What the noise would have to be multiplied with for parameter k to be determined; None if that is below 1/1000.

    With f times the noise χ² rises by 1/f² times as much.  The most likely values would be others, within the noise:
    hence `noise_safety_ratio`.
    """
    for f in LOWER_NOISE_RATIOS:
        louder = replace(profile, rise=profile.rise / f**2)
        leaning = tuple(box.names[j] for j in louder.leaning(level))
        if judge_parameter(box, k, louder.interval(level), leaning, stated=stated).word == "determined":
            return RULES.noise_safety_ratio * float(f)
    return None


def physical(box: Box, k: int, interval: Interval) -> tuple[float, float]:
    """Ends of an interval of parameter k in its unit."""
    X = np.full((2, box.d), 0.5)
    X[:, k] = np.clip([interval.low, interval.high], 0.0, 1.0)
    low, high = box.from_unit(X)[:, k]
    return float(low), float(high)


def _digits(value: float, low: float, high: float) -> int:
    """Significant digits down to the size of the half-width: 9.98 ± 0.12 has 2, 47 ± 30 has 1."""
    half = 0.5 * (high - low)
    if value == 0 or half <= 0:
        return 1
    return int(max(1, min(6, math.floor(math.log10(abs(value))) - math.floor(math.log10(half)) + 1)))


def verdict_sentences(
    box: Box,
    k: int,
    verdict: Verdict,
    interval: Interval,
    profile: ProfileInterval,
    *,
    unit: str,
    places: Sequence[str],
    level: float = 0.9,
    leaning: tuple[str, ...] = (),
    scale: float = 1.0,
) -> tuple[str, str]:
    """The verdict in one sentence, and its reason: how little the curve changes where nothing is determined.

    `places` (n) of all measured points in words, in the order of the misfit's data, whose unit is `unit`; `scale` as in
    :func:`judge_parameter`.
    """
    name, of = box.names[k], box.units[k]
    low, high = physical(box, k, interval)
    label, factor = people(of, max(abs(low), abs(high)))
    tail = f" {unit_text(label)}".rstrip()
    pieces = profile.pieces(level) if profile is not None else (interval,)
    said = [" to ".join(interval_ends(a * factor, b * factor)) for a, b in (physical(box, k, p) for p in pieces)]
    span = f"{' or from '.join(said)}{tail}"
    other = f", as long as {' and '.join(leaning)} stay{'s' if len(leaning) == 1 else ''} in range" if leaning else ""
    missed = f"the model, which misses the data by {scale:.2g} times their errors" if scale > 1.0 else ""
    if verdict.word == "determined":
        given = f"under {missed}, " if missed else ""
        sure = f"{given}with {100 * level:.0f} % confidence {span}{_either_way(low, high)}"
        return f"{name} is determined: {sure}{other}.", ""
    if (
        scale > RULES.refuted_error_ratio
        and not interval.open
        and interval.high - interval.low < RULES.uninformative_share
    ):
        text = f"{name} {VERDICT_WORDS[verdict.word]}: {missed}, fits best from {span}{other}."
        return text, "What the model lacks has to be found first."
    ends = [w for w, at in (("lower", interval.at_low), ("upper", interval.at_high)) if at]
    bounds = f", as far as the {' and the '.join(ends)} bound of the search" if ends else other
    agrees = f"fits as well as any under {missed}" if missed else "agrees with the curve"
    text = f"{name} {VERDICT_WORDS[verdict.word]}: every value from {span} {agrees}{bounds}."
    inside = np.any([(profile.at >= p.low - 1e-9) & (profile.at <= p.high + 1e-9) for p in pieces], axis=0)
    worst = int(np.flatnonzero(inside)[np.argmax(np.abs(profile.change[inside]) / profile.sigma[inside])])
    over = f"Over the whole interval of {name}" if len(pieces) == 1 else f"Over all these values of {name}"
    over += " (the other parameters refitted)" if box.d > 1 else ""
    why = _little(over, abs(profile.change[worst]), profile.sigma[worst], places[profile.point[worst]], unit)
    if verdict.noise_factor is not None:
        likeliest = float(profile.at[int(np.argmin(profile.rise))])
        best = physical(box, k, Interval(likeliest, likeliest))[0]
        why += f" If its most likely value, {significant(best * factor, 2)}{tail}, is right, "
        why += f"{1 / verdict.noise_factor:.2g} times less noise would determine it."
    elif scale == 1.0 and not 0.0 < profile.at[int(np.argmin(profile.rise))] < 1.0:
        why += " The curve fits best at an end of the range, so the noise that would determine it is unknown."
    return text, why


def _little(over: str, change: float, sigma: float, place: str, unit: str) -> str:
    """How much a curve changes `over` an interval, against its uncertainty, where that shows most."""
    what = {"N": "force", "mm": "displacement"}.get(unit, "curve")
    if change < ROUND_OFF_SHARE * sigma:
        return f"{over} the {what} does not change."
    much = f"{change / sigma:.2g} times" if change >= sigma else f"{two_digits(100 * change / sigma)} % of"
    return (
        f"{over} the {what} changes by at most {much} its uncertainty: "
        f"{size(change, unit)} against {size(sigma, unit)}, at {place}."
    )


def _either_way(low: float, high: float) -> str:
    if low <= 0:
        return ""
    half = math.sqrt(high / low)
    return f" (±{100 * (half - 1):.2g} %)" if half < 1.2 else f" (a factor {half:.2g} either way)"


def size(value: float, unit: str) -> str:
    """A quantity with two digits, in the unit that people use for one of its size."""
    label, factor = people(unit, value)
    return f"{float(f'{value * factor:.2g}'):.6g} {label}".rstrip()
