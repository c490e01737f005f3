"""Which test next: how far apart the surviving hypotheses predict it, all they do not know included (T-optimality).

    D² = (y_k − y_l)ᵀ (C + Σ_k + Σ_l)⁻¹ (y_k − y_l)

y_k is the posterior mean of the new test under hypothesis k and Σ_k its covariance, so that what a re-fit could still
move does not count (Atkinson & Fedorov 1975; Eriksson, Frisk & Krysander 2013 call D distinguishability).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rso.diagnosis import noise
from rso.diagnosis.attribute import Bench
from rso.diagnosis.effects import Effect
from rso.diagnosis.library import Library, build
from rso.diagnosis.mixture import Posterior
from rso.diagnosis.prediction import predict
from rso.diagnosis.testplan import Experiment, make_plan
from rso.measurement import Measurement, Repeat
from rso.running import Task

DRAWS = 80
SEPARATES = 4.0  # about 4 σ: what a test must reach to promise an answer
READINGS = 20

DIRECT = {  # tests that show one effect of the measurement chain by itself, whatever the specimen
    "compliance": "press a rigid block",
    "bias": "a run in air",
    "drift": "a run in air, as long as the longest test",
    "offset": "a shim of known thickness",
    "gain": "a dead weight",
    "lag": "a tap with both clocks recorded",
    "cross_x": "the sensor turned by 90 degrees",
    "cross_y": "the sensor turned by 90 degrees",
}


@dataclass(frozen=True)
class NextTest:
    """A test, the pair it separates worst, and the distance D of that pair; `dissolves` counts pairs with D ≥ 4."""

    test: str
    separates: tuple[str, str]
    distance: float
    resolves: int
    pairs: int


def next_tests(
    library: Library, bench: Bench, survivors: Mapping[str, tuple[tuple[Effect, ...], Posterior]],
    run: Callable[[Sequence[Task]], list[Any]] | None,
) -> list[NextTest]:  # fmt: skip
    """Candidate tests by the distance of the pair that they separate worst, then by how many pairs they resolve.

    `survivors` maps a name to its effects and posterior.  Without `run` only tests at places and rates of the library
    are considered.
    """
    pairs = list(itertools.combinations(survivors, 2))
    if not pairs:
        return []
    found = []
    for words, experiments in _candidates(library):
        try:
            plan = make_plan(experiments)
            effects = {e.name: e for group, _ in survivors.values() for e in group}
            if _known(library, plan):
                there = replace(library, plan=_moved(library, plan))
            elif run is None:
                continue
            else:
                there = build(library.base, plan, tuple(effects.values()), run)
        except ValueError:
            continue
        distance = _distances(there, bench, survivors, pairs)
        found.append(_ranked(words, distance))
    found += _direct(library, bench, survivors, pairs)
    return sorted(found, key=lambda t: (-t.resolves, -t.distance))


def _ranked(words: str, distance: Mapping[tuple[str, str], float]) -> NextTest:
    worst = min(distance, key=lambda p: distance[p])
    return NextTest(words, worst, float(distance[worst]), sum(v >= SEPARATES for v in distance.values()), len(distance))


def _candidates(library: Library) -> list[tuple[str, list[Experiment]]]:
    """Tests that are not in the plan yet: other rates and unloading at a known place, what the backend proposes."""
    plan = library.plan
    template = plan.experiments[next(t.experiment for t in plan.tests if t.place == library.primary)]
    place = plan.places[library.primary]
    speeds = [t.speed for t in plan.tests if t.place == library.primary]
    has_unload = any(np.any(t.branch == 1) for t in plan.tests if t.place == library.primary)
    d = min(place.deepest, 4.0)
    out = []
    if not has_unload:
        out.append(("load and unload at the same point", _experiment(template, d, speeds[0], True)))
    for factor, word in ((10.0, "ten times faster"), (0.1, "ten times slower")):
        v = factor * (max(speeds) if factor > 1 else min(speeds))
        out.append((f"load and unload {word} ({60 * v:.0f} mm/min)", _experiment(template, d, v, True)))
    proposals = getattr(library.base.backend, "tests", lambda _: {})(dict(place.settings))
    for word, settings in proposals.items():
        other = replace(template, settings={**template.settings, **settings})
        out.append((word, _experiment(other, d, speeds[0], True)))
    return [(words, [e]) for words, e in out]


def _experiment(template: Experiment, depth: float, speed: float, unload: bool) -> Experiment:
    """A test as it would be recorded, with no values in it."""
    u = np.linspace(0.0, depth, READINGS + 1)[1:]
    way = np.concatenate([u, u[-2::-1]]) if unload else u
    segment = np.array(["loading"] * len(u) + ["unloading"] * (len(way) - len(u)))
    time = np.cumsum(np.abs(np.diff(np.concatenate([[0.0], way])))) / speed
    channels = {c: np.zeros(len(way)) for c in ("Fx", "Fy", "Fz")}
    measurement = Measurement(Path("next test"), "force", (Repeat("1", way, time, channels, {}, segment),), ())
    return replace(template, name="next test", measurement=measurement, speed=speed, role="fit",
                   channels=("Fx", "Fy", "Fz"), after=())  # fmt: skip


def _known(library: Library, plan: Any) -> bool:
    """Whether a plan of one place can be read off the tables."""
    own = library.plan.places[library.primary]
    return plan.places[0].settings == own.settings and (
        not plan.places[0].peaks or any(abs(p - q) < 0.3 for p in plan.places[0].peaks for q in own.peaks)
    )


def _moved(library: Library, plan: Any) -> Any:
    """The new tests at the library's own places."""
    tests = tuple(replace(t, place=library.primary) for t in plan.tests)
    return replace(library.plan, experiments=plan.experiments, tests=tests, profiles=())


def _distances(there: Library, bench: Bench, survivors, pairs) -> dict[tuple[str, str], float]:
    mean, spread = {}, {}
    for name, (effects, post) in survivors.items():
        pick = np.linspace(0, len(post.modulus) - 1, DRAWS).astype(int)
        A, _ = predict(there, effects, post.at[pick], bench.modulus)
        F = post.modulus[pick, None] * A
        mean[name], spread[name] = F.mean(axis=0), np.cov(F.T)
    first = next(iter(mean.values()))
    some = bench.levels.get("Fz", next(iter(bench.levels.values())))
    levels = {c: bench.levels.get(c, some) for c in noise.FORCES}
    C = noise.covariance(there, levels, first, noise.slope_of(there, first))
    out = {}
    for k, l in pairs:
        Δ = mean[k] - mean[l]
        out[k, l] = float(np.sqrt(Δ @ np.linalg.solve(C + spread[k] + spread[l], Δ)))
    return out


def _direct(library: Library, bench: Bench, survivors, pairs) -> list[NextTest]:
    """Tests of the chain alone: the size of the effect over what that test resolves."""
    level = bench.levels.get("Fz", next(iter(bench.levels.values())))
    white = level.white / np.sqrt(READINGS)
    F = max(float(np.max(np.abs(t.values["Fz"]))) for t in library.plan.tests if "Fz" in t.values)
    longest = max(float(t.time.max()) for t in library.plan.tests)
    v = max(t.speed for t in library.plan.tests)
    resolution = {
        "compliance": 0.5 * level.contact / F, "bias": white, "drift": white / longest, "offset": level.contact,
        "gain": 0.002, "lag": white / max(F * v / 4.0, 1e-9), "cross_x": white / F, "cross_y": white / F,
    }  # fmt: skip
    found: dict[str, dict[tuple[str, str], float]] = {}
    for name, (effects, post) in survivors.items():
        column = post.at.shape[1] - sum(len(e.knobs) for e in effects)
        for e in effects:
            if e.name in DIRECT and e.family == "measurement":
                size = post.at[:, column]
                D = abs(float(np.mean(size))) / np.hypot(resolution[e.name], float(np.std(size)))
                own = found.setdefault(DIRECT[e.name], dict.fromkeys(pairs, 0.0))
                for p in pairs:
                    other = p[0] if p[1] == name else p[1]
                    if name in p and e.name not in {x.name for x in survivors[other][0]}:
                        own[p] = D
            column += len(e.knobs)
    return [_ranked(words, distance) for words, distance in found.items()]
