"""What unstated usual errors of a test make of an interval: that without them, and which of them counts most."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rso.core.digits import two_digits
from rso.core.symbols import unit_text
from rso.core.units import people
from rso.inference.identifiability import AsStated, Determination, determine
from rso.inference.intervals import Interval
from rso.inference.verdict import physical

USUAL_DRIFT, USUAL_PULL = "drift", "pull"  # how a drift and a pull into contact that no model has are called
MENTIONED_WIDENING_RATIO = 1.1  # times as wide: less is not worth a word
MIN_OUTSIDE_SHARE = 0.25  # of its width that the interval as stated lies outside: the two say different things


def with_usual(d: Determination, seed: int) -> Determination:
    """The same, each parameter with its interval as stated, and a sentence where usual errors widen that.

    An error U (n, q) of a curve, C = U Uᵀ, moves the most likely values by (Jᵀ C⁻¹ J)⁻¹ Jᵀ C⁻¹ U.
    """
    if d.misfit.weighting != "noise" or not any(v.usual for v in d.misfit.data):
        return d
    misfit = replace(d.misfit, data=tuple(v.as_stated for v in d.misfit.data))
    alone = determine(misfit, seed=seed, near=d.fit.x[None], mcmc=False)
    moved, known = _moved(d), []
    for k, one in enumerate(d.known):
        variance = {name: float(np.sum(v[k] ** 2)) for name, v in moved.items()}
        whole = sum(variance.values()) or 1.0
        shares = tuple(sorted(((n, v / whole) for n, v in variance.items()), key=lambda s: -s[1]))
        found = AsStated(alone.known[k].profile_interval, shares)
        found = replace(found, story=_said(d, k, found))
        known.append(replace(one, as_stated=found, reason=f"{one.reason} {found.story}".strip()))
    return replace(d, known=tuple(known))


def _moved(d: Determination) -> dict[str, np.ndarray]:
    """By how much (d, q) each usual error moves the most likely values in the unit cube."""
    columns: dict[str, np.ndarray] = {}
    start = 0
    for v in d.misfit.data:
        for name, U in v.usual.items():
            full = np.zeros((d.misfit.n, U.shape[1]))
            full[start : start + len(v.value)] = U
            columns[name] = columns[name] + full if name in columns and U.shape[1] == 1 else full
        start += len(v.value)
    return {name: moved_by(d, U) for name, U in columns.items()}


def moved_by(d: Determination, U: np.ndarray) -> np.ndarray:
    """By how much (d, q) errors U (n, q) of the readings move the most likely values in the unit cube."""
    J = d.misfit.white(d.misfit.model.jacobian(d.fit.x).T).T
    return np.asarray(np.linalg.pinv(J, rcond=1e-9) @ d.misfit.white(U.T).T)


def elsewhere(a: Interval, b: Interval) -> bool:
    """Whether interval a lies outside of b by more than `MIN_OUTSIDE_SHARE` of its width: they do not say the same."""
    outside = max(b.low - a.low, 0.0) + max(a.high - b.high, 0.0)
    return outside > MIN_OUTSIDE_SHARE * max(a.high - a.low, 1e-12)


def widening(d: Determination, k: int) -> float:
    """How many times as wide the interval of parameter k is as that with what is stated alone."""
    known = d.known[k]
    if known.as_stated is None:
        return 1.0
    a, b = known.as_stated.interval, known.profile_interval
    return (b.high - b.low) / max(a.high - a.low, 1e-12)


def _said(d: Determination, k: int, found: AsStated) -> str:
    """The two intervals in words, the error that counts most, and the key that would state it."""
    known, box = d.known[k], d.misfit.model.box
    a, b = found.interval, known.profile_interval
    moved = elsewhere(a, b)
    if not found.shares or not (moved or (b.high - b.low) >= MENTIONED_WIDENING_RATIO * (a.high - a.low)):
        return ""
    name = found.shares[0][0]
    curve, key = name.rsplit(": ", 1) if ": " in name else ("", name)
    of = f" of {curve}" if curve else ""
    what = {"correlation": "correlated", "gain": "gain", "contact": "contact"}.get(key, key)
    alone, with_them = (physical(box, k, i) for i in (a, b))
    both = (
        f"{known.name} is known to {_either(alone)} by what is stated alone, to {_either(with_them)} with usual errors"
    )
    if moved:
        label, factor = people(box.units[k], max(map(abs, with_them)))
        unit = unit_text(label)
        each = [f"{low * factor:.3g} to {high * factor:.3g} {unit}".strip() for low, high in (alone, with_them)]
        both = (
            f"{known.name} depends on usual errors: it is {each[0]} with the stated errors alone, {each[1]} with "
            "usual ones"
        )
    size = _size(d, name, key)
    if key == USUAL_DRIFT:
        return (
            f"{both} of a test. The drift that the approach{of} shows, {size}, counts most: the key drift of the "
            "experiment subtracts it."
        )
    if key == USUAL_PULL:
        return f"{both} of a test. The pull into contact{of}, {size}, counts most: open adhesion in [parameters]."
    return (
        f"{both} of a test. The usual {what} error{of}, {size}, counts most: noise.{key} states it, and 0 says that "
        "there is none."
    )


def _either(ends: tuple[float, float]) -> str:
    low, high = ends
    if low <= 0:
        return f"{low:.3g} to {high:.3g}"
    half = math.sqrt(high / low)
    return f"±{100 * (half - 1):.2g} %" if half < 1.5 else f"a factor {half:.2g} either way"


def _size(d: Determination, name: str, key: str) -> str:
    """The standard deviation of a usual error in words."""
    curve = next(v for v in d.misfit.data if name in v.usual)
    U = curve.usual[name]
    largest = float(np.abs(curve.value).max()) or 1.0
    if key == "contact":
        there = np.ones(len(U), bool) if curve.since is None else curve.since == 0.0  # in a hold there is no slope
        order = np.flatnonzero(there)[np.argsort(curve.depth[there], kind="stable")]
        slope = np.gradient(
            curve.value[order], np.maximum.accumulate(curve.depth[order]) + 1e-12 * np.arange(len(order))
        )
        return f"{float(np.median(np.abs(U[order, 0]) / np.maximum(np.abs(slope), 1e-300))):.2g} mm"
    deviation = np.sqrt(np.sum(U**2, axis=1))
    return f"{two_digits(100 * float(deviation.max()) / largest)} % of the largest value"
