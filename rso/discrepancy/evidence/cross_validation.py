"""What is predicted without having been fitted: experiments left out in turn, and the curves kept for validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from rso.discrepancy.evidence import attribution, noise, shrinkage
from rso.discrepancy.evidence.attribution import Evidence, Shared
from rso.discrepancy.evidence.gaussian_mixture import (
    Posterior,
    log_tiles,
    mixture_log_evidence,
    posterior,
    ready,
    whitening,
)
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import LOADING_BRANCH, SurfaceProfile, Test
from rso.inference.predictive_test import predictive_chi2, predictive_test

MIN_EFFECT_SD = 3.0  # standard deviations by which an effect must be able to move readings that are to tell of it


@dataclass(frozen=True)
class HeldOut:
    """Log predictive density of one experiment given all others, over that of the base model, by hypothesis.

    A hypothesis with an effect of which the others hold nothing predicts nothing: it is absent.
    """

    experiment: str
    gain: Mapping[str, float]


def held_out_evidence(bench: Shared, y: np.ndarray, hypotheses: Sequence[Hypothesis]) -> tuple[HeldOut, ...]:
    """log p(y_g | y_rest, H) for every experiment g, over that of the first hypothesis."""
    curves = shrinkage.experiment_blocks(bench.library)
    if len(curves) < 2:
        return ()
    everything = np.arange(len(y))
    total = {h.name: _log_evidence(bench, h, everything, y) for h in hypotheses}
    found = []
    for name, _, rows in curves:
        rest = np.setdiff1d(everything, rows)
        told = [h for h in hypotheses if set(_taught(bench, y, rest, h.effects)) == set(h.effects)]
        score = {h.name: total[h.name] - _log_evidence(bench, h, rest, y) for h in told}
        base = score[hypotheses[0].name]
        found.append(HeldOut(name, {k: float(v - base) for k, v in score.items()}))
    return tuple(found)


def predicts(held: Sequence[HeldOut], h: Hypothesis) -> bool:
    """Whether a hypothesis predicts experiments left out, all together, better than the base; yes where it is not
    asked: none was left out, or one experiment alone can show it."""
    asked = [c.gain[h.name] for c in held if h.name in c.gain]
    return len(asked) < len(held) or not held or sum(asked) > 0


def _log_evidence(bench: Shared, h: Hypothesis, rows: np.ndarray, y: np.ndarray, loose: bool = True) -> float:
    """Log evidence of some rows, over levels of scatter."""
    scatter = bench.settings.priors.scatter
    shares = scatter if any(e.family == "scatter" for e in h.effects) else scatter[:1]
    found = []
    for share in shares:
        white = whitening(bench.covariance(h.effects, share), rows)
        h_ready = ready(bench.of(h.effects, loose), white, bench.modulus)
        found.append(mixture_log_evidence(h_ready, white(y)[None])[0])
    return float(logsumexp(found) - np.log(len(found)))


def shrinkage_of(
    whole: Library,
    library: Library,
    bench: Shared,
    evidence: Evidence,
    y: np.ndarray,
    chosen: Hypothesis,
    seed: int,
    fitted: Mapping[str, float] | None = None,
) -> shrinkage.Shrinkage:
    """Gaps on the validate curves, or on each experiment left out in turn if there are none.

    `fitted` are the parameters as the study found them: on validate curves these are the model before, if they lie
    where the library knows the base model.
    """
    validation = [k for k, e in enumerate(whole.plan.experiments) if e.role == "validate"]
    if validation:
        first = _fitted_rows(library)
        mine = tuple(t for t in whole.plan.tests if t.experiment in validation)
        profiles = tuple(p for p in whole.plan.profiles if p.experiment in validation)
        unseen = replace(whole, plan=replace(whole.plan, tests=mine, profiles=profiles))
        v = unseen.plan.values()
        C = _covariance(unseen, bench, evidence, y)
        fits = _fits(unseen, bench, y, first, np.arange(len(y)), chosen.effects, seed + 2)
        own = None if fitted is None else _at(unseen, fitted, bench.modulus)
        fits[0] = fits[0] if own is None else own[None]
        found = [
            _gap(name, unit, rows, v, fits, C, chosen.effects)
            for name, unit, rows in shrinkage.experiment_blocks(unseen)
        ]
        sizes = [len(rows) for *_, rows in shrinkage.experiment_blocks(unseen)]
        told = shrinkage.summarise(found, sizes, "those with role validate", seed)
        return told if own is None else replace(told, fitted=fitted)
    return left_out_gaps(library, bench, evidence, y, chosen, seed)


def left_out_gaps(
    library: Library,
    bench: Shared,
    evidence: Evidence,
    y: np.ndarray,
    chosen: Hypothesis,
    seed: int,
    anew: bool = True,
) -> shrinkage.Shrinkage:
    """Gaps on each experiment left out in turn, whatever is kept for validation; the cause is chosen
    again without it (`anew`), or known.

    Without any force nothing shows an open modulus: an experiment that has all of them is not left out.
    """
    first = _fitted_rows(library)
    found, sizes = [], []
    curves = shrinkage.experiment_blocks(library)
    tells = _forces(library) if library.base.low < library.base.high else np.ones(len(y), bool)
    for name, unit, rows in curves if len(curves) > 1 else []:
        rest = np.setdiff1d(np.arange(len(y)), rows)
        if not tells[rest].any():
            continue
        before = np.setdiff1d(first, rows)
        before = rest if len(before) < 4 else before
        cause = _chosen_without(evidence, rest, y, chosen) if anew else _taught(bench, y, rest, chosen.effects)
        fits = _fits(library, bench, y, before, rest, cause, seed + 2)
        found.append(_gap(name, unit, rows, y, fits, bench.C, cause))
        sizes.append(len(rows))
    if not found:
        return shrinkage.Shrinkage((), np.nan, np.nan, np.nan, 1.0, np.nan, None, None, "one curve only")
    beside = " where forces remain beside it" if len(found) < len(curves) else ""
    causes = ", the cause chosen again without it," if chosen.effects and anew else ""
    how = f"each left out in turn{beside}{causes} as there are no validate curves"
    return shrinkage.summarise(found, sizes, how, seed)


def _forces(library: Library) -> np.ndarray:
    """(n,) whether a reading is one of force."""
    out = np.zeros(library.plan.n, bool)
    for item, _, at in library.plan.rows():
        out[at] = not isinstance(item, SurfaceProfile)
    return out


def _fits(
    library: Library,
    bench: Shared,
    y: np.ndarray,
    first: np.ndarray,
    rows: np.ndarray,
    cause: Sequence[Effect],
    seed: int,
) -> list[np.ndarray]:
    """Predictions (k, n) of a library's plan: the base model fitted to the `first` rows of y, to `rows`, and with the
    cause; without one that is the second once more."""
    rng = np.random.default_rng(seed)

    def draws(effects: Sequence[Effect], some: np.ndarray) -> np.ndarray:
        return shrinkage.predictive_draws(library, effects, fit_effects(bench, effects, some, y, rng), bench.modulus)

    before, again = draws((), first), draws((), rows)
    return [before, again, draws(cause, rows) if cause else again]


def _gap(
    name: str,
    unit: str,
    rows: np.ndarray,
    y: np.ndarray,
    fits: Sequence[np.ndarray],
    C: np.ndarray,
    cause: Sequence[Effect],
) -> shrinkage.Gap:
    C, value = C[np.ix_(rows, rows)], y[rows]
    means = [f[:, rows].mean(axis=0) for f in fits]
    δ = means[2] - means[0]
    noise_of_change = 2.0 * float(np.sqrt(δ @ np.linalg.solve(C, δ))) / len(rows)
    before, again, with_cause = (predictive_chi2(value, f, C) / len(rows) for f in means)
    a, b, c = (float(np.sqrt(np.mean((value - f) ** 2))) for f in means)
    spread = [np.cov(f[:, rows].T).reshape(C.shape) if len(f) > 1 else None for f in fits]
    p_values = tuple(predictive_test(value, f, C, s).p_value for f, s in zip(means, spread, strict=True))
    effects = tuple(e.name for e in cause)
    return shrinkage.Gap(name, unit, before, again, with_cause, (a, b, c), noise_of_change, effects, p_values)


def _at(library: Library, values: Mapping[str, float], modulus: float) -> np.ndarray | None:
    """Prediction (n,) of the base model at values of its open parameters; None where the library has none."""
    base = library.base
    μ = values.get(base.modulus, base.low)  # where it is fixed these are one
    x = np.array([a.coordinate(values[a.name], μ) for a in base.axes])
    if any(not low <= v <= high for v, (low, high) in zip(x, (a.ends for a in base.axes), strict=True)):
        return None
    A, c = predict(library, (), x[None], modulus)
    return μ * A[0] + c[0]


def _fitted_rows(library: Library) -> np.ndarray:
    """Rows of what the study itself fitted: loading of the first channel of experiments with role fit."""
    rows = []
    for item, c, at in library.plan.rows():
        e = library.plan.experiments[item.experiment]
        if isinstance(item, Test) and e.role == "fit" and c == ("Fz" if "Fz" in item.channels else item.channels[0]):
            rows.append(np.arange(at.start, at.stop)[item.branch == LOADING_BRANCH])
    return np.concatenate(rows) if rows else np.arange(library.plan.n)


def _taught(bench: Shared, y: np.ndarray, rest: np.ndarray, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Those effects of which the rows that are left can say anything: at its largest one moves them, beyond what a
    re-fit of the base model takes up, by MIN_EFFECT_SD standard deviations."""
    if not effects:
        return ()
    white = whitening(bench.C, rest)
    base, μ = ready(bench.of(()), white, bench.modulus), bench.modulus
    t = int(np.argmax(log_tiles(base, white(y)[None])[0]))
    Q, _ = np.linalg.qr((base.X[t] @ base.Q.T).T)
    at = base.tiles.at[t]

    def tells(e: Effect) -> bool:
        tiles = bench.of((e,))
        own = tiles.at[:, : len(at)]
        near = np.nonzero(np.sum((own - at) ** 2, axis=1) <= np.min(np.sum((own - at) ** 2, axis=1)) + 1e-12)[0]
        moduli = μ if tiles.moduli is None else tiles.moduli[near, None]
        v = white(tiles.lift(moduli * tiles.A[near] + tiles.c[near])) - base.middle(t)
        v = v - (v @ Q) @ Q.T
        return float(np.max(np.sum(v * v, axis=1))) > MIN_EFFECT_SD**2

    return tuple(e for e in effects if e.family == "scatter" or tells(e))


def fit_effects(
    bench: Shared,
    effects: Sequence[Effect],
    rows: np.ndarray,
    y: np.ndarray,
    rng: np.random.Generator,
    draws: int = 300,
) -> Posterior:
    """The base model with effects as some rows of the data y (n,) have it."""
    white = whitening(bench.covariance(effects, bench.settings.priors.scatter[-1]), rows)
    h = ready(bench.of(effects, loose=True), white, bench.modulus)
    return posterior(h, white(y), draws, rng)


def _chosen_without(evidence: Evidence, rest: np.ndarray, y: np.ndarray, chosen: Hypothesis) -> tuple[Effect, ...]:
    """The effects that are most probable by the rows that are left, of all single causes and the pair that was chosen.

    None where nothing was chosen, or where these rows make no gap more probable.
    """
    if not chosen.effects:
        return ()
    bench = evidence.bench
    taught = _taught(bench, y, rest, evidence.effects)

    def score(h: Hypothesis, loose: bool) -> float:
        return _log_evidence(bench, h, rest, y, loose) + attribution.log_prior(
            h, evidence.effects, bench.settings.priors
        )

    rough = {e: score(Hypothesis((e,)), False) for e in taught}
    leading = sorted(taught, key=lambda e: -rough[e])
    last = {e.source for e in leading[: attribution.N_SURVIVING_EFFECTS]}
    scores = {Hypothesis(()): score(Hypothesis(()), False)}
    scores |= {Hypothesis((e,)): score(Hypothesis((e,)), True) for e in leading if e.source in last}
    if len(chosen.effects) > 1 and set(chosen.effects) <= set(taught):
        scores[chosen] = score(Hypothesis(chosen.effects), True)
    return max(scores, key=lambda h: scores[h]).effects


def _covariance(unseen: Library, bench: Shared, evidence: Evidence, y: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    h = evidence.best((), y)
    f = shrinkage.predicted(unseen, (), posterior(h, h.white(y), 2000, rng), bench.modulus)
    return noise.data_covariance(
        unseen, _levels(bench, unseen), f, noise.slope_of(unseen, f), bench.settings.model_error
    )


def _levels(bench: Shared, unseen: Library) -> dict[str, noise.NoiseLevel]:
    """Levels of the seen data, and for channels they lack those of the held-out files."""
    return {**noise.noise_levels(unseen.plan, usual=bench.settings.noise), **bench.levels}
