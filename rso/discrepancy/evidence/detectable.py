"""Before the data are judged: which effects this test plan can see, from which size, and which it confuses.

Every effect is simulated at several sizes with the plan's noise and goes through the contest; the limit of detection
is the size found in half of the data sets at the verdict's own false alarms, 5 % or less.  Only the level of the noise
and the base model enter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.special import logsumexp

from rso.discrepancy.evidence import attribution
from rso.discrepancy.evidence.attribution import Evidence
from rso.discrepancy.evidence.gaussian_mixture import log_tiles
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.tables import Library

N_DETECTABLE_SIZES = 5  # of an effect, from its smallest to its largest
N_DETECTABLE_DATA_SETS = 20  # data sets per size; power is read off a curve over all sizes
MIN_CONFUSED_PROBABILITY = 0.15  # mean over the data sets of an effect, from which another cause is named
MIN_POWER_FOR_CONFUSION = 0.9  # power from which confusion counts: about three times the limit


@dataclass(frozen=True)
class Detectable:
    """`limit` is |value − neutral| found with 50 % power (None: invisible), `power` by size, which it grows with.

    `recognised` is the mean probability of the right cause, `confused_with` holds what takes more than
    MIN_CONFUSED_PROBABILITY of it: both at the smallest clear size, since what is large enough is separated from much,
    or where none is clear at the one that is seen most often."""

    effect: Effect
    limit: float | None
    value: float | None
    power: tuple[tuple[float, float], ...]
    confused_with: tuple[str, ...]
    recognised: float


def detectable_by_plan(library: Library, seed: int) -> tuple[Detectable, ...]:
    """What a test plan can see, by its noise and by the base model as fitted; no effect has met the data."""
    seen = replace(library, plan=library.plan.seen())
    y = seen.plan.values()
    return detectable(Evidence(attribution.set_up(seen, y), seen.effects), y, seed)


def announced(visible: Sequence[Detectable]) -> list[str]:
    """The same in sentences: from which size on, what is confused with what, and what cannot be seen."""
    seen = [v for v in visible if v.limit is not None]
    sizes = [f"{v.effect.name} {_size(v)}" for v in seen]
    alike = [f"{v.effect.name} with {', '.join(v.confused_with)}" for v in seen if v.confused_with]
    hidden = [v.effect.name for v in visible if v.limit is None]
    told = (("visible in half of all tests from", sizes), ("confused", alike), ("not visible at any size", hidden))
    return [f"{words}: {'; '.join(each)}" for words, each in told if each]


def _size(v: Detectable) -> str:
    if v.value is None:
        return "as such"
    least = "≤ " if v.power[0][1] >= 0.5 else ""  # the smallest size that was simulated is seen already
    return f"{least}{v.value:.3g} {v.effect.size.unit}".removesuffix(" 1").removesuffix(" -")


def detectable(evidence: Evidence, y: np.ndarray, seed: int) -> tuple[Detectable, ...]:
    """Power and confusion of every effect of the catalogue around the base model as fitted to y (n,)."""
    rng = np.random.default_rng(seed)
    base = evidence.ready(())
    null = attribution.nulls(evidence, y, 200, seed)
    threshold = np.quantile(_statistics(evidence, null)[0], 1 - _alarms(evidence, null))
    centre = base.tiles.at[int(np.argmax(log_tiles(base, base.white(y)[None])[0]))]
    L = base.white.L
    sets, labels = [], []
    effects = [e for e in evidence.effects if e.family != "scatter"]
    for e in effects:
        # that of all sizes, of which the larger shows in more
        scatter = (L @ rng.standard_normal((len(y), N_DETECTABLE_DATA_SETS))).T
        for t in _ladder(evidence, e, centre):
            r = evidence.ready((e,))
            sets.append(L @ r.middle(t) + scatter)
            labels.append((e, float(r.tiles.at[t, len(centre)])))
    T, P = _statistics(evidence, np.concatenate(sets))
    T, P = T.reshape(len(labels), N_DETECTABLE_DATA_SETS), P.reshape(len(labels), N_DETECTABLE_DATA_SETS, -1)
    found = []
    for e in effects:
        mine = [i for i, (own, _) in enumerate(labels) if own is e]
        sizes = np.array([labels[i][1] for i in mine])
        power = np.array([np.mean(T[i] > threshold) for i in mine])
        if e.size.neutral is not None:
            power = isotonic_regression(power).x
        limit = _limit(np.abs(sizes) if e.size.neutral is not None else np.arange(len(sizes)), power)
        clear = [
            i
            for i, q in zip(mine, power, strict=True)
            if limit is not None and (q > MIN_POWER_FOR_CONFUSION or e.size.neutral is None)
        ]
        clear = clear[:1] if e.size.neutral is not None else clear
        if limit is not None and not clear:  # never clear, but seen
            clear = [mine[int(np.argmax(power))]]
        mean = P[clear].mean(axis=(0, 1)) if clear else np.zeros(len(evidence.effects))
        forms = np.array([o.source == e.source for o in evidence.effects])
        rivals = _rivals(evidence.effects, np.where(forms, 0.0, mean))
        sign = np.sign(sizes[-1]) if e.size.neutral is not None else 1.0
        value = None if limit is None or e.size.neutral is None else float(e.size.value(sign * limit))
        if value is not None and e.family == "model":
            value *= evidence.bench.modulus**e.size.exponent
        found.append(
            Detectable(
                e,
                limit,
                value,
                tuple(zip(map(float, sizes), map(float, power), strict=True)),
                tuple(rivals),
                float(mean[forms].sum()),
            )
        )
    return tuple(found)


def _alarms(evidence: Evidence, null: np.ndarray) -> float:
    """Share of data sets without a gap (B, n) in which the verdict finds one: the false alarms allowed, or less where
    the largest of them make a gap no more probable than none."""
    T = np.array([c.statistic for c in attribution.comparisons(evidence, null)])
    return float(np.mean(T > attribution.critical(T, evidence.bench.settings.rules.false_alarm)))


def _rivals(effects: Sequence[Effect], mean: np.ndarray) -> list[str]:
    """Likeliest form of every cause whose forms together hold more than MIN_CONFUSED_PROBABILITY of the probabilities
    `mean` (k,)."""
    held: dict[str, float] = {}
    for e, p in zip(effects, mean, strict=True):
        held[e.source] = held.get(e.source, 0.0) + float(p)
    best = {effects[j].source: effects[j].name for j in np.argsort(mean)}
    return [best[s] for s in sorted(held, key=lambda s: -held[s]) if held[s] > MIN_CONFUSED_PROBABILITY]


def _ladder(evidence: Evidence, e: Effect, centre: np.ndarray) -> list[int]:
    """Tiles of an effect at the base's coordinates, shapes in the middle, sizes from small to large, larger side."""
    at = evidence.ready((e,)).tiles.at
    d = len(centre)
    near = np.all(np.abs(at[:, :d] - centre) < 1e-9, axis=1)
    for j in range(d + 1, at.shape[1]):
        levels = np.unique(at[:, j])
        near &= at[:, j] == levels[len(levels) // 2]
    mine = np.nonzero(near)[0]
    if e.size.neutral is not None:
        sign = np.sign(max((end[1] for end in e.size.ends()), key=lambda v: (round(abs(v), 9), v)))
        mine = mine[np.sign(at[mine, d]) == sign]
        mine = mine[np.argsort(np.abs(at[mine, d]))]
    pick = np.unique(np.linspace(0, len(mine) - 1, min(N_DETECTABLE_SIZES, len(mine))).astype(int))
    return [int(mine[i]) for i in pick]


def _statistics(evidence: Evidence, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ln Bayes factor of any single effect against none (B,), and probabilities (B, effects) given there is one."""
    none = evidence.of((), Y)
    Z = np.array([evidence.of((e,), Y) for e in evidence.effects]).T
    total = logsumexp(Z, axis=1)
    return total - np.log(Z.shape[1]) - none, np.exp(Z - total[:, None])


def _limit(size: np.ndarray, power: np.ndarray) -> float | None:
    """Size at which the power crosses one half, log-linear between; None if it never does."""
    above = np.nonzero(power >= 0.5)[0]
    if not len(above):
        return None
    k = int(above[0])
    if k == 0:
        return float(size[0])
    share = (0.5 - power[k - 1]) / max(power[k] - power[k - 1], 1e-9)
    low, high = np.log(max(size[k - 1], 1e-12)), np.log(max(size[k], 1e-12))
    return float(np.exp(low + share * (high - low)))


def limits_by_effect(found: Sequence[Detectable]) -> dict[str, float | None]:
    """Limit by effect."""
    return {d.effect.name: d.limit for d in found}
