"""Which test next: how likely it is to decide what is open, all that the hypotheses do not know included.

    D² = (y_k − y_l)ᵀ (C + Σ_k + Σ_l)⁻¹ (y_k − y_l)

y_k is the posterior mean of the new test under hypothesis k and Σ_k its covariance, so that what a re-fit could still
move does not count (Atkinson & Fedorov 1975; Eriksson, Frisk & Krysander 2013 call D distinguishability).  Where k is
true the log likelihood ratio against l is about N(D²/2, D²): how likely the test is to decide the matter, and how much
it shows, follow from D alone (:mod:`rso.optimal_design`).  What every curve has for itself moves no mean, but widens Σ
of the new curves.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rso.contract import Gauges, capability
from rso.discrepancy.evidence import noise
from rso.discrepancy.evidence.attribution import Shared, by_test
from rso.discrepancy.evidence.gaussian_mixture import Posterior
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.interpolation import timed
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library, build_library
from rso.discrepancy.library.test_plan import make_test_plan
from rso.discrepancy.proposals import (
    N_PROPOSED_READINGS,
    CandidateTest,
    at_library_places,
    proposed_tests,
    tables_cover,
    test_after_plan,
)
from rso.evaluation import Task
from rso.optimal_design import Worth, about_causes, ranked
from rso.optimal_design.separation import as_likely, chance_to_decide

N_FORECAST_DRAWS = 80  # of the parameters under each hypothesis, evenly picked from its posterior
MIN_DECISIVE_DISTANCE = 4.0  # about 4 σ: what a test must reach to promise an answer
MAX_OUT_OF_REACH_SHARE = 0.05  # of the draws of a time that may lie beyond the rates computed without a word
RATE_OUT_OF_REACH_NOTE = "its rate lies beyond those computed, of which the nearest stands for it"

_RIGID_BLOCK_TEST = "press a rigid block and hold, and a shim of known thickness on it"
_SENSOR_ALONE_TEST = "the sensor alone: a run in air, a dead weight, turned by 90 degrees"
DIRECT_TESTS = {  # tests that show an effect of the chain by itself, whatever the specimen; one visit to the bench each
    "compliance": _RIGID_BLOCK_TEST,
    "creep": _RIGID_BLOCK_TEST,
    "offset": _RIGID_BLOCK_TEST,
    "bias": _SENSOR_ALONE_TEST,
    "bias_side": _SENSOR_ALONE_TEST,
    "drift": _SENSOR_ALONE_TEST,
    "gain": _SENSOR_ALONE_TEST,
    "cross_x": _SENSOR_ALONE_TEST,
    "cross_y": _SENSOR_ALONE_TEST,
    "nonlinearity": _SENSOR_ALONE_TEST,
    "turn": _SENSOR_ALONE_TEST,
    "depth_scale": "the drive against a gauge block",
    "lag": "a tap with both clocks recorded",
}


@dataclass(frozen=True)
class NextTest:
    """A test, the `chance` that it decides what is open, the pair it separates worst and the distance D of that pair.

    `resolves` counts the `pairs` with D ≥ MIN_DECISIVE_DISTANCE.  `note` says what the forecast leans on.  Tests are
    ordered by the `information` (nats) that they are expected to give, and by their `price` in loadings
    (:mod:`rso.optimal_design`).
    """

    test: str
    chance: float
    separates: tuple[str, str]
    distance: float
    resolves: int
    pairs: int
    note: str = ""
    information: float = 0.0
    price: int = 1


Survivors = Mapping[str, tuple[tuple[Effect, ...], Posterior]]
Scatter = Mapping[str, float]  # of effects that scatter, their standard deviation in the unit of the knob


def next_tests(
    library: Library,
    bench: Shared,
    survivors: Survivors,
    probability: Mapping[str, float],
    run: Callable[[Sequence[Task]], list[Any]] | None,
    scatter: Scatter | None = None,
) -> list[NextTest]:
    """Candidate tests by what they are expected to show of which of the survivors is true.

    `survivors` maps a name to its effects and posterior, `probability` to its probability.  Without `run` only tests
    at places and rates of the library are considered; where all survivors scatter only repeats help, and none is.
    """
    if len(survivors) < 2 or all(e.family == "scatter" for effects, _ in survivors.values() for e in effects):
        return []
    found = []
    acting = {e.name for effects, _ in survivors.values() for e in effects}
    for candidate in proposed_tests(library):
        if candidate.without and not candidate.without & acting:
            continue  # what it keeps from acting is none of what is open
        try:
            there = candidate_library(library, candidate, survivors, run)
        except ValueError:
            continue
        if there is not None:
            D = distances(there, bench, survivors, candidate.without, scatter or {})
            loadings = sum(len(e.measurement.repeats) for e in candidate.experiments)
            test = weighed(candidate.words, D, probability, loadings)
            found.append(replace(test, note=RATE_OUT_OF_REACH_NOTE if _out_of_reach(there, survivors) else ""))
    found += [weighed(words, D, probability) for words, D in direct(library, bench, survivors).items()]
    return ranked(found, lambda t: Worth(t.information, t.price))


def candidate_library(
    library: Library, candidate: CandidateTest, survivors: Survivors, run: Callable[[Sequence[Task]], list[Any]] | None
) -> Library | None:
    """The library of a candidate test, None where that would need simulations and there is no `run`.

    Raises ValueError where the base model has no answer.
    """
    plan = make_test_plan(candidate.experiments, library.plan.scale)
    plan = replace(plan, tests=tuple(test_after_plan(library.plan, plan, t) for t in plan.tests))
    if tables_cover(library, plan):
        return replace(library, plan=at_library_places(library, plan))
    if run is None:
        return None
    effects = {e.name: e for group, _ in survivors.values() for e in group}
    return build_library(library.base, plan, tuple(effects.values()), run)


def _out_of_reach(there: Library, survivors: Survivors) -> bool:
    """Whether a survivor relaxes in times that, in the travel of the tests of a library, lie beyond those computed."""
    d, speeds, own = len(there.base.axes), {t.speed for t in there.plan.tests}, there.base.relaxing
    for effects, post in survivors.values():
        if own is not None:
            level = there.places[there.home(own.effect)].effects[own.effect.name].nodes.levels[1]
            late = there.base.relaxation(post.at[:, :d])[:, 1] + np.log([[v] for v in speeds])
            if np.mean((late < level.min()) | (late > level.max())) > MAX_OUT_OF_REACH_SHARE:
                return True
        column = d
        for e in (e for e in effects if e.family != "scatter"):  # these have no coordinate
            timely = [k for k, s in enumerate(e.knobs) if k and timed(s)] if e.family == "model" else []
            for k in timely:  # those of the chain are followed at any rate
                level = there.places[there.home(e)].effects[e.name].nodes.levels[k]
                for speed in speeds:
                    at = post.at[:, column + k] + e.knobs[k].power_of_time * np.log(speed)
                    if np.mean((at < level.min()) | (at > level.max())) > MAX_OUT_OF_REACH_SHARE:
                        return True
            column += len(e.knobs)
    return False


def weighed(
    words: str, distance: Mapping[tuple[str, str], float], probability: Mapping[str, float], price: int = 1
) -> NextTest:
    """A test by the distances D of the pairs and the probabilities of the survivors, and its price in loadings."""
    worst = min(distance, key=lambda p: distance[p])
    settled = sum(bool(v >= MIN_DECISIVE_DISTANCE) for v in distance.values())
    information = about_causes(distance, probability)
    chance = chance_to_decide(distance, probability)
    return NextTest(words, chance, worst, float(distance[worst]), settled, len(distance), "", information, price)


def distances(
    there: Library,
    bench: Shared,
    survivors: Survivors,
    without: frozenset[str] = frozenset(),
    scatter: Scatter | None = None,
) -> dict[tuple[str, str], float]:
    """D of every pair of survivors in the tests of a library's plan."""
    mean, spread = {}, {}
    for name, (effects, post) in survivors.items():
        F = forecast(there, bench, effects, post, without)
        mean[name], spread[name] = F.mean(axis=0), np.cov(F.T)
        for e in (e for e in effects if e.family == "scatter"):
            centre = np.median(post.at[:, : len(there.base.axes)], axis=0)[None]
            g = (scatter or {})[e.name] * by_test(there, e, centre, float(np.median(post.modulus)))
            spread[name] = spread[name] + g.T @ g
    C = new_tests_covariance(there, bench, next(iter(mean.values())))
    out = {}
    for k, l in itertools.combinations(survivors, 2):
        Δ = mean[k] - mean[l]
        out[k, l] = float(np.sqrt(Δ @ np.linalg.solve(C + spread[k] + spread[l], Δ)))
    return out


def forecast(
    there: Library, bench: Shared, effects: Sequence[Effect], post: Posterior, without: frozenset[str] = frozenset()
) -> np.ndarray:
    """Draws (N_FORECAST_DRAWS, n) of what a hypothesis predicts, effects of `without` left out."""
    effects = [e for e in effects if e.family != "scatter"]  # these move no mean
    pick = np.linspace(0, len(post.modulus) - 1, N_FORECAST_DRAWS).astype(int)
    d = len(there.base.axes)
    columns, at = list(range(d)), d
    for e in effects:
        columns += [] if e.name in without else range(at, at + len(e.knobs))
        at += len(e.knobs)
    acting = [e for e in effects if e.name not in without]
    A, c = predict(there, acting, post.at[pick][:, columns], bench.modulus)
    return post.modulus[pick, None] * A + c


def new_tests_covariance(there: Library, bench: Shared, force: np.ndarray) -> np.ndarray:
    """Noise (n, n) of new tests: that of the plan's."""
    some = bench.levels.get("Fz", next(iter(bench.levels.values())))
    mark = noise.NoiseLevel(there.plan.scale * bench.settings.noise.mark, 0.0, 0.0, 0.0, 0.0, 0.0, "assumed")
    levels = {c: bench.levels.get(c, some) for c in noise.FORCE_CHANNELS} | {"uz": bench.levels.get("uz", mark)}
    return noise.data_covariance(there, levels, force, noise.slope_of(there, force), bench.settings.model_error)


def gauge_tests(library: Library, bench: Shared) -> dict[str, tuple[str, float]]:
    """Knob → a test that shows it by itself, whatever the rest, and what that test resolves in the knob's unit."""
    level = bench.levels.get("Fz", next(iter(bench.levels.values())))
    white = level.white / np.sqrt(N_PROPOSED_READINGS)
    F = max(float(np.max(np.abs(v))) for t in library.plan.tests for c, v in t.values.items() if c == t.channels[-1])
    longest = max(float(t.time.max()) for t in library.plan.tests)
    v = max(t.speed for t in library.plan.tests)
    yields = 0.5 * level.contact / F
    resolution = {
        "compliance": yields,
        "creep": yields,
        "offset": level.contact,
        "bias": white,
        "bias_side": white,
        "drift": white / longest,
        "gain": 0.002,
        "lag": white / max(F * v / 4.0, 1e-300),
        "cross_x": white / F,
        "cross_y": white / F,
        "nonlinearity": white / F**2,
        "turn": np.degrees(white / F),
        "depth_scale": 0.002,
    }
    own = {k: (DIRECT_TESTS[k], resolution[k]) for k in DIRECT_TESTS}
    settings = dict(library.plan.places[0].settings)
    gauges = capability(library.base.backend, Gauges)
    return {**own, **(gauges.gauges(settings) if gauges else {})}


def direct(library: Library, bench: Shared, survivors: Survivors) -> dict[str, dict[tuple[str, str], float]]:
    """D of every pair in tests of one knob alone.

    What such a test shows is the size itself, so that a size known badly before is as good as any.
    """
    known, pairs = gauge_tests(library, bench), list(itertools.combinations(survivors, 2))
    found: dict[str, dict[tuple[str, str], float]] = {}
    for name, (effects, post) in survivors.items():
        for e in effects:
            if e.size.name not in known or e.size.neutral is None or e.place is not None or e.family == "scatter":
                continue  # no bench shows what one test had
            words, resolution = known[e.size.name]
            off = effect_sizes(bench, effects, post, e) - e.size.neutral
            D = as_likely(off, resolution)
            own = found.setdefault(words, dict.fromkeys(pairs, 0.0))
            for p in pairs:
                other = p[0] if p[1] == name else p[1]
                if name in p and e.name not in {x.name for x in survivors[other][0]}:
                    own[p] = max(own[p], D)
    return found


def effect_sizes(bench: Shared, effects: Sequence[Effect], post: Posterior, effect: Effect) -> np.ndarray:
    """Values (m,) of an effect's knob over the draws, in its unit."""
    column = post.at.shape[1] - sum(len(e.knobs) for e in effects)
    column += sum(len(e.knobs) for e in itertools.takewhile(lambda e: e is not effect, effects))
    scale = post.modulus / (1.0 if effect.family == "model" else bench.modulus)
    return effect.size.value(post.at[:, column]) * scale**effect.size.exponent
