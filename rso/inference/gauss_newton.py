"""Least misfit straight on simulations: Gauss–Newton with what every run shows of its own derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.doe import sobol_sequence
from rso.inference.least_squares import all_minima
from rso.inference.likelihood import Data, Misfit, Model
from rso.inference.tangents import EvaluatedPoint, TangentFrame, tangents, unfolded

FIRST_TRUST_RADIUS = 0.25  # of the unit cube: how far a tangent is trusted at first
MIN_STEP_LENGTH = 1e-3  # a step this short leads nowhere
SMALL_CHANGE_SHARE = 0.1  # share of the tolerance by which a next step may still move a curve
# of χ², absolute and relative: what a next step may still gain
CONVERGED_CHI2_GAIN, CONVERGED_CHI2_GAIN_SHARE = 0.5, 0.01
MAX_DERIVATIVE_ERROR_SHARE = 0.5  # of a derivative: an error that is not believed to be one of curvature
NEIGHBOUR_DISTANCE = 0.1  # of the unit cube: neighbours
TRUST_REGION_SLACK = 1e-3  # of the unit cube: so far beyond the trusted region a step costs what the whole misfit is
RUN_POINT_DIGITS = 10  # of x: the same study asks for the same runs wherever it goes on
WRONG_DERIVATIVES_REASON = "the runs do not follow the derivatives that the backend gives"

Look = Callable[[Sequence[np.ndarray]], list[EvaluatedPoint | None]]
DataOf = Callable[[EvaluatedPoint], tuple[Data, ...]]


@dataclass(frozen=True, eq=False)
class Iterate:
    """One point that was run: x (d,), misfit and its prediction, largest miss of the prediction, length of the step.

    `sight` is None where the run has no answer, and then `chi2` and `gap` are too; a start has no prediction. `gap` is
    the largest difference of predicted and recomputed curve over the curve's largest value; `better` says whether it
    became the best so far; `step` and `radius` are the largest change of a (reduced) parameter and what was allowed.
    """

    start: int
    x: np.ndarray
    sight: EvaluatedPoint | None
    chi2: float | None
    predicted: np.ndarray | None
    expected: float | None
    gap: float | None
    step: float | None
    radius: float
    better: bool


@dataclass(frozen=True, eq=False)
class GaussNewtonFit:
    """Where one start led to: every point on the way, the best run, whether a rerun confirmed it, and why it ended.

    `data` are the measured curves with the errors that `chi2` counts, () without an answer.
    """

    iterates: tuple[Iterate, ...]
    best: EvaluatedPoint | None
    chi2: float | None
    confirmed: bool
    why: str
    data: tuple[Data, ...] = ()

    @property
    def gap(self) -> float | None:
        """How far the last run was from its prediction; None where it has no answer or none was predicted."""
        return self.iterates[-1].gap if self.iterates else None


def on_runs(
    frame: TangentFrame, look: Look, data_of: DataOf, starts: np.ndarray, *, tolerance: float, most: int, seed: int
) -> list[GaussNewtonFit]:
    """Least χ² by Gauss–Newton on runs with derivatives from each of the starts (k, d) in the unit cube.

        x_(n+1) = argmin χ²[f_n(x)]  in the box and in |z − z_b| <= Δ

    f_n are the curves through all runs so far (:func:`~rso.inference.tangents.tangents`; after one run its tangent, the
    classic step), z the parameters that similarity leaves, b the best run.  Δ halves where the misfit falls by less
    than a quarter of what was predicted, doubles where by more than three quarters; from a run without an answer the
    next step stays twice as far away as it was.  A descent ends when a run agrees with its prediction to `tolerance`
    and a next step would move no curve by a tenth of that and gain nothing, after `most` runs, or when steps shrink to
    nothing.  It is not confirmed where the slopes of neighbouring runs contradict these (:func:`contradiction`).
    Each run states its own numerical error, and misfits compare only under one: that of the start at first, then the
    mean over the runs where the descent came to rest.  It ends where such a run is the best again, or as good.
    A start without an answer is replaced by points of a Sobol sequence.  All descents share their runs.
    Source: Levenberg, Q. Appl. Math. 2 (1944) 164, with the region of Conn, Gould & Toint, Trust-Region Methods (2000),
    algorithm 6.1.1.
    """
    known: list[EvaluatedPoint] = []
    first = look(list(starts))  # together: no worker waits
    spare = iter(sobol_sequence(frame.box.d, 256, seed))
    found = []
    for k, (x, sight) in enumerate(zip(starts, first, strict=True)):
        walk = [Iterate(k, x, sight, None, None, None, None, None, FIRST_TRUST_RADIUS, False)]
        while sight is None and len(walk) < most:
            x = next(spare)
            (sight,) = look([x])
            walk.append(Iterate(k, x, sight, None, None, None, None, None, FIRST_TRUST_RADIUS, False))
        if sight is None:
            found.append(GaussNewtonFit(tuple(walk), None, None, False, "no start has an answer"))
            continue
        known.append(sight)
        walk[-1] = _started(walk[-1], frame, data_of)
        found.append(_descend(frame, look, data_of, walk, sight, known, tolerance, most, seed))
    return found


def _started(i: Iterate, frame: TangentFrame, data_of: DataOf) -> Iterate:
    assert i.sight is not None
    chi2 = chi2_in_frame(data_of(i.sight), i.sight.f, frame)
    return Iterate(i.start, i.x, i.sight, chi2, None, None, None, None, FIRST_TRUST_RADIUS, True)


def _descend(
    frame: TangentFrame,
    look: Look,
    data_of: DataOf,
    walk: list[Iterate],
    best: EvaluatedPoint,
    known: list[EvaluatedPoint],
    tolerance: float,
    most: int,
    seed: int,
) -> GaussNewtonFit:
    """The descent from the last point of the walk, which has an answer."""
    radius, start = FIRST_TRUST_RADIUS, walk[0].start
    lost = [i.x for i in walk if i.sight is None]
    data = data_of(best)
    rests: list[EvaluatedPoint] = []
    while True:
        S = chi2_in_frame(data, best.f, frame)
        reach = min((0.5 * float(np.abs(best.x - x).max()) for x in lost), default=1.0)
        x, predicted = trial(tangents(frame, known, best), frame, data, best, radius, reach, seed)
        z_best, z = (frame.reduced(v[None])[1][0] for v in (best.x, x))
        step = float(np.abs(z - z_best).max(initial=0.0))
        last, still = walk[-1].gap, np.array_equal(x, best.x)
        expected = chi2_in_frame(data, predicted, frame)
        small = largest_change(data, predicted, best.f) <= SMALL_CHANGE_SHARE * tolerance and S - expected <= max(
            CONVERGED_CHI2_GAIN, CONVERGED_CHI2_GAIN_SHARE * S
        )
        if still or (small and last is not None and last <= tolerance):
            before = rests[-1] if rests else None
            if not any(r is best for r in rests):
                rests.append(best)
                data = mean_errors([data_of(r) for r in rests])
                S = chi2_in_frame(data, best.f, frame)
                if before is None or chi2_in_frame(data, before.f, frame) - S > max(
                    CONVERGED_CHI2_GAIN, CONVERGED_CHI2_GAIN_SHARE * S
                ):
                    continue
            wrong = contradiction(frame, known) > MAX_DERIVATIVE_ERROR_SHARE
            return GaussNewtonFit(
                tuple(walk), best, S, not wrong, WRONG_DERIVATIVES_REASON if wrong else "at rest", data
            )
        if len(walk) >= most:
            return GaussNewtonFit(tuple(walk), best, S, False, f"search.max_runs = {most} is spent", data)
        if min(radius, reach) < MIN_STEP_LENGTH:
            why = WRONG_DERIVATIVES_REASON if radius <= reach else "beyond, runs have no answer"
            return GaussNewtonFit(tuple(walk), best, S, False, why, data)
        (sight,) = look([x])
        if sight is None:
            lost.append(x)
            walk.append(Iterate(start, x, None, None, predicted, expected, None, step, radius, False))
            continue
        gap, new = largest_change(data, predicted, sight.f), chi2_in_frame(data, sight.f, frame)
        walk.append(Iterate(start, x, sight, new, predicted, expected, gap, step, radius, new < S))
        known.append(sight)
        gain = (S - new) / (S - expected) if S > expected else 1.0
        if gap > tolerance and gain < 0.25:
            radius = 0.5 * min(radius, step) if step > 0 else 0.5 * radius
        elif gain > 0.75 and step > 0.8 * radius:
            radius = min(2 * radius, 1.0)
        best = sight if new < S else best


def mean_errors(each: Sequence[tuple[Data, ...]]) -> tuple[Data, ...]:
    """The same curves with the mean of the covariances, and of their parts, that they have in `each`."""

    def mean(of: Sequence[Data]) -> Data:
        names = {n: None for d in of for n in d.parts}
        parts = {n: np.mean([d.parts.get(n, np.zeros_like(d.covariance)) for d in of], axis=0) for n in names}
        return replace(of[0], covariance=np.mean([d.covariance for d in of], axis=0), parts=parts)

    return tuple(mean(of) for of in zip(*each, strict=True))


def trial(
    model: Model,
    frame: TangentFrame,
    data: tuple[Data, ...],
    best: EvaluatedPoint,
    radius: float,
    reach: float,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """The point x (d,) of least misfit of a model not farther than `radius` (in z) and `reach` (in x), and its curve.

    Where nothing is better than the best run, that.
    """
    z_best = frame.reduced(best.x[None])[1][0]
    S = chi2_in_frame(data, best.f, frame)
    wall = np.sqrt(max(S, 1.0)) / TRUST_REGION_SLACK

    def fenced(X: np.ndarray) -> np.ndarray:
        over = np.abs(frame.reduced(X)[1] - z_best) - radius, np.abs(X - best.x) - reach
        return np.hstack([model.predict(X), *(wall * np.maximum(v, 0.0) for v in over)])

    rows = len(z_best) + len(best.x)
    fence = Data("trusted", "", np.zeros(rows), np.zeros(rows), np.eye(rows))
    misfit = Misfit(Model(frame.box, fenced), (*data, fence))
    found = all_minima(misfit, seed=seed, near=best.x[None])[0]
    x = np.clip(np.round(found.x, RUN_POINT_DIGITS), 0.0, 1.0)
    predicted = model.predict(x[None])[0]
    return (x, predicted) if chi2_in_frame(data, predicted, frame) < S else (best.x, best.f)


def largest_change(data: Sequence[Data], a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two sets of curves (n,), each over the largest value that was measured or computed."""
    ends = np.cumsum([len(d.value) for d in data])[:-1]
    parts = [np.split(v, ends) for v in (a, b)]
    sizes = np.array([max(np.abs(d.value).max(), np.abs(y).max()) for d, y in zip(data, parts[1], strict=True)])
    # By symmetry a lateral force may be zero, or noise about it.
    sizes = np.maximum(sizes, 1e-4 * sizes.max())
    return max(float(np.abs(p - q).max() / s) for p, q, s in zip(*parts, sizes, strict=True))


def contradiction(frame: TangentFrame, runs: Sequence[EvaluatedPoint]) -> float:
    """How wrong the derivatives are by one parameter, at most: 0 where they explain neighbouring runs, 2 for a sign.

        min over α of Σ |t_j − t_i − Σ_k α_k c_k|² / |z_j − z_i|² + ρ |α − 1|²,   c_k = ½ (g_i + g_j)_k (z_j − z_i)_k

    over all pairs (i, j) nearer than `NEIGHBOUR_DISTANCE`, or the nearest one: what the derivatives would have to be
    multiplied with; t = ln f′ as in :func:`~rso.inference.tangents.tangents`.  The result is max |α_k − 1|; ρ keeps a
    parameter of which these pairs show nothing at 1.
    """
    Z, T, G, log = unfolded(frame, runs)
    size = np.where(log, 1.0, np.abs(T).max(axis=0) + 1e-300)
    apart = {(i, j): float(np.abs(Z[i] - Z[j]).max(initial=0.0)) for j in range(len(Z)) for i in range(j)}
    apart = {p: d for p, d in apart.items() if d > 1e-4}  # what is closer differs by what the solver leaves
    if not apart:
        return 0.0
    pairs = [p for p, d in apart.items() if d <= max(NEIGHBOUR_DISTANCE, min(apart.values()))]
    C = np.vstack([0.5 * (G[i] + G[j]) * (Z[j] - Z[i]) / size[:, None] / apart[i, j] for i, j in pairs])
    t = np.concatenate([(T[j] - T[i]) / size / apart[i, j] for i, j in pairs])
    A = C.T @ C
    ρ = 1e-4 * float(np.trace(A)) + 1e-300
    return float(np.abs(np.linalg.solve(A + ρ * np.eye(len(A)), C.T @ (t - C.sum(axis=1)))).max())


def chi2_in_frame(data: tuple[Data, ...], f: np.ndarray, frame: TangentFrame) -> float:
    """χ² of curves `f` (n,) given data with their covariance."""
    misfit = Misfit(Model(frame.box, lambda X: np.tile(f, (len(X), 1))), data)
    return float(np.sum(misfit.white(f - np.concatenate([d.value for d in data])) ** 2))
