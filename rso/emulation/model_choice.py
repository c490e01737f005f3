"""Fit one surrogate per output and say why this one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rso.core.distributions import chi2_ppf
from rso.doe import factorial, sobol_sequence
from rso.emulation.common import monomial_exponents
from rso.emulation.kernels import KERNELS
from rso.emulation.kriging import Kriging, conditioned, describe, fit_kriging
from rso.emulation.polynomial import Polynomial, fit_polynomial
from rso.emulation.scores import Scores, held_out_scores, left_out_bands, left_out_means, pooled, scaled, score

Surrogate = Polynomial | Kriging
SURROGATE_KINDS = ("auto", "polynomial", "kriging")
N_RIVAL_MODELS = 3  # kriging models whose disagreement with the best one widens its band
MAX_LOG_SD_RATIO = 0.1  # of the mean: sd up to which a logarithm may predict more than ten times the largest value seen
TOO_NARROW_BAND_CHANCE = 0.1  # chance that a band whose scale is known from n squared errors alone is too narrow
ROUNDING_DEVIATION_SHARE = 1e-12  # of the largest value: a smaller deviation is rounding
MAX_SEARCHED_RUNS = 150  # runs that kernel and trend are sought with where there are more; all fit the hyper-parameters
GOOD_ENOUGH_ERROR = 1e-5  # relative error below which derivatives, which cost fits, are not tried


@dataclass(frozen=True, eq=False)
class TrainingData:
    """What one output is learnt from: X (n, d) in the unit cube, y (n,); noise sd (n,), gradients (n, d) or None."""

    X: np.ndarray
    y: np.ndarray
    noise: np.ndarray | None = None
    gradients: np.ndarray | None = None

    def rows(self, keep: np.ndarray) -> TrainingData:
        """Some of the points."""
        parts = (None if v is None else v[keep] for v in (self.noise, self.gradients))
        return TrainingData(self.X[keep], self.y[keep], *parts)


def fit_surrogate(
    kind: str,
    X: np.ndarray,
    y: np.ndarray,
    *,
    seed: int,
    noise_sd: np.ndarray | float | None = None,
    share: float | None = 1.0,
    gradients: np.ndarray | None = None,
    held: tuple[np.ndarray, np.ndarray] | None = None,
    degree: int | None = None,
    log: bool | None = None,
    unit: str = "",
    names: tuple[str, ...] | None = None,
    trends: tuple[int, ...] = (0, 1, 2),
) -> Surrogate:
    """The surrogate of y (n,) over X (n, d) in the unit cube with the smallest error in y on points it has not seen.

    kind 'auto' compares polynomials, kriging and, where `gradients` (n, d; NaN: unknown) are given, kriging through
    them, on the same ten folds, refitted without each fold, pooled with the points `held` = (X, y) that no fold holds.
    Gradients that do not help there are not used. `degree` fixes the degree of the polynomial (1 to 4), otherwise its
    terms are selected; `log` None tries the logarithm too where y > 0. `noise_sd` is used by kriging alone (a
    polynomial estimates its own scatter); share None has the share of it that is scatter estimated, if that helps.
    Of more than 150 runs (more from nine dimensions on) as many that fill the space seek kernel and trend; the four
    best are fitted to all, and folds keep their hyper-parameters. `trends` are the degrees that kriging may choose
    from: a column of few different values carries few.
    The reasons are in `story`. `cv` holds the scores on left-out points, for kriging those that they let expect over
    the whole cube (see :func:`_over_the_cube`); kinds are compared by the former.

    Raises
    ------
    ValueError
        for an unknown kind, values that are not finite, or too few points for every surrogate of that kind.
    """
    if kind not in SURROGATE_KINDS:
        raise ValueError(f"surrogate: unknown kind {kind!r}; choose one of {', '.join(SURROGATE_KINDS)}")
    X, y = np.asarray(X, float), np.asarray(y, float)
    noise = None if noise_sd is None else np.broadcast_to(np.asarray(noise_sd, float), y.shape)
    data = TrainingData(X, y, noise, None if gradients is None else np.asarray(gradients, float))
    logs = (log,) if log is not None else (False, True) if y.size and y.min() > 0 else (False,)
    makers: list[Callable[[], tuple[Surrogate, Scores]]] = []
    if kind != "kriging":
        makers.append(lambda: _best_polynomial(X, y, degree, logs, seed))
    if kind != "polynomial":
        makers.append(lambda: _best_kriging(replace(data, gradients=None), share, logs, seed, trends))
        if data.gradients is not None and np.isfinite(data.gradients).any():
            makers.append(lambda: _best_kriging(data, share, logs, seed, trends))
    tried: list[tuple[Surrogate, Scores]] = []
    refusals = []
    for make in makers:
        if (
            make is makers[-1]
            and data.gradients is not None
            and any(s.relative_rmse < GOOD_ENOUGH_ERROR for _, s in tried)
        ):
            break
        try:
            tried.append(make())
        except ValueError as refusal:
            refusals.append(str(refusal))
    if not tried:
        raise ValueError("; ".join(dict.fromkeys(refusals)))
    judged = [s if held is None or not len(held[1]) else pooled(s, held_out_scores(m, *held)) for m, s in tried]
    # A tie goes to the polynomial, the simpler one.
    best = min(range(len(tried)), key=lambda k: judged[k].rmse)
    model, cv = tried[best]
    others = [f"{_name(m)} had {_error(s, unit)}" for k, (m, s) in enumerate(tried) if k != best]
    words = describe(model, names) if isinstance(model, Kriging) else _name(model)
    if isinstance(model, Kriging) and len(y) > _searched(X.shape[1]):
        words += f"; kernel and trend were sought with {_searched(X.shape[1])} of the runs"
    story = f"{words}: cross-validation error {_error(cv, unit)} over {len(y)} runs"
    if model.cv is not None and model.cv.rmse < cv.rmse:
        story += f", which lets {_error(model.cv, unit)} be expected over the whole ranges"
    if judged[best] is not cv:
        story += f", with {len(held[1])} held out {_error(judged[best], unit)}"  # type: ignore[index]
    return replace(model, story="; ".join([story, *others, *dict.fromkeys(refusals)]) + ".")


def refit(
    model: Surrogate,
    X: np.ndarray,
    y: np.ndarray,
    *,
    seed: int,
    noise_sd: np.ndarray | None = None,
    gradients: np.ndarray | None = None,
    degree: int | None = None,
) -> Surrogate:
    """The same kind of surrogate on other (usually more) data, no contest: see :func:`fit_surrogate` for the arguments.

    Kriging finds its hyper-parameters again from the old ones and uses gradients if it did; a polynomial selects its
    terms again unless `degree` is given. The cross-validation scores are leave-one-out at fixed hyper-parameters; what
    widens the band is kept, the rivals of a kriging model are refitted as it is.  A logarithm that the new data do not
    have is given up: then a surrogate of this kind is chosen again.
    """
    if _logs(model) and np.min(y) <= 0:
        return fit_surrogate(
            model.kind, X, y, seed=seed, degree=degree, noise_sd=noise_sd, share=None, gradients=gradients
        )
    if isinstance(model, Kriging):
        return _refit_kriging(model, X, y, seed, noise_sd, gradients)
    return replace(
        fit_polynomial(X, y, degree=degree, log=model.log), inflate=model.inflate, story=_anew(model, len(y))
    )


def _logs(model: Surrogate) -> bool:
    """Whether a surrogate or one of its rivals is of the logarithm."""
    return model.log or (isinstance(model, Kriging) and any(rival.log for _, rival in model.rivals))


def _refit_kriging(
    model: Kriging, X: np.ndarray, y: np.ndarray, seed: int, noise_sd: np.ndarray | None, gradients: np.ndarray | None
) -> Kriging:
    noise = noise_sd if model.noise.any() else None
    new = fit_kriging(
        X, y, seed=seed, trend=model.trend, log=model.log, kernel=model.kernel, noise_sd=noise,
        share=None if model.share != 1.0 else 1.0, gradients=None if model.slopes is None else gradients,
        gradient_sd=0.0 if model.slopes is None else _gradient_sd(noise, X), restarts=0, start=model,
    )  # fmt: skip
    rivals = tuple((w, _refit_kriging(rival, X, y, seed, noise_sd, gradients)) for w, rival in model.rivals)
    new = replace(new, inflate=model.inflate, rivals=rivals)
    return replace(new, cv=_over_the_cube(new, scores_of(new)), story=_anew(model, len(y)))


def _anew(model: Surrogate, n: int) -> str:
    """The story of a model that is fitted again to n runs."""
    story = model.story.removesuffix(f" Fitted again to {model.cv.n if model.cv else 0} runs.")
    return f"{story} Fitted again to {n} runs."


def scores_of(model: Surrogate) -> Scores:
    """The cross-validation scores, which every fitted surrogate has."""
    assert model.cv is not None
    return model.cv


def from_dict(data: Mapping[str, Any]) -> Surrogate:
    """The surrogate that `to_dict` wrote."""
    makers: dict[str, Callable[[Mapping[str, Any]], Surrogate]] = {
        "polynomial": Polynomial.from_dict,
        "kriging": Kriging.from_dict,
    }
    if data.get("kind") not in makers:
        raise ValueError(f"surrogate: unknown kind {data.get('kind')!r}; choose one of {', '.join(makers)}")
    return makers[data["kind"]](data)


def _best_polynomial(
    X: np.ndarray, y: np.ndarray, degree: int | None, logs: tuple[bool, ...], seed: int
) -> tuple[Polynomial, Scores]:
    model = min(_tame([fit_polynomial(X, y, degree=degree, log=g) for g in logs], y), key=lambda p: p.cv.rmse)
    try:
        # Terms are selected without each fold too: a selection that has seen the fold would flatter itself.
        mean = left_out_means(lambda rows: fit_polynomial(X[rows], y[rows], degree=degree, log=model.log), X, y, seed)
        cv = score(mean, y)
        model = replace(model, inflate=_widening(model, X, y, mean), cv=cv)
    except ValueError:
        cv = model.cv  # with a fold left out too few points remain: leave-one-out has the largest folds there are
    return model, cv


def _widening(model: Polynomial, X: np.ndarray, y: np.ndarray, mean: np.ndarray) -> float:
    """How many times larger, at least once, the errors of what was predicted without them are than the deviation that
    the model states for new values there, root mean squares; relative ones where it is of the logarithm."""
    of = y if model.log else np.ones_like(y)
    stated = float(np.mean((model.predict(X)[1] / of) ** 2))
    return float(np.sqrt(max(np.mean(((mean - y) / of) ** 2) / max(stated, 1e-300), 1.0)))


def _best_kriging(
    data: TrainingData, share: float | None, logs: tuple[bool, ...], seed: int, degrees: tuple[int, ...]
) -> tuple[Kriging, Scores]:
    n, d = data.X.shape
    known = share is not None and data.noise is not None
    # Twice as many points as trend terms, so that the process has something left to learn from.
    trends = [q for q in degrees if q == 0 or n >= 2 * len(monomial_exponents(d, q))]
    first = data if known else replace(data, noise=None)
    options = [(kernel, q, g) for kernel in KERNELS for g in logs for q in trends]
    few = farthest_first(data.X, _searched(d))

    def search(data: TrainingData, o: tuple[str, int, bool], share: float | None, restarts: int) -> Kriging:
        found = _kriging(data.rows(few), o, share, seed, restarts=restarts)
        return found if len(few) == n else _kriging(data, o, share, seed, start=found)

    tried = _tame([_kriging(first.rows(few), o, share, seed, restarts=int(d > 1)) for o in options], data.y)
    tried = sorted(tried, key=lambda m: m.cv.rmse)
    if len(few) < n:
        tried = _tame([_kriging(first, _option(m), share, seed, start=m) for m in tried[: 1 + N_RIVAL_MODELS]], data.y)
    model, *others = sorted(tried, key=lambda m: m.cv.rmse)
    model = search(first, _option(model), share, 4)
    if not known and data.noise is not None and data.noise.any():
        noisy = search(data, _option(model), None, 2)
        if scores_of(noisy).rmse < 0.99 * scores_of(model).rmse:
            model, first = noisy, data

    def again(rows: np.ndarray) -> Kriging:
        # A tenth of many points tells nothing new of the hyper-parameters.
        if len(few) < n:
            return conditioned(model, rows)
        return _kriging(first.rows(rows), _option(model), share, seed, start=model)

    mean, sd = left_out_bands(again, data.X, data.y, seed)
    scatter = 0.0 if first.noise is None else model.share * first.noise
    size = float(np.abs(data.y).max()) or 1.0
    z = (mean - data.y) / np.maximum(np.hypot(sd, scatter), ROUNDING_DEVIATION_SHARE * size)
    # z² scatter: with the mean in place of the quantile every other band would be too narrow.
    inflate = float(np.sqrt(max(np.sum(z**2) / chi2_ppf(TOO_NARROW_BAND_CHANCE, n), 1.0)))
    cv = score(mean, data.y)
    model = replace(model, inflate=inflate, rivals=_rivals(cv.rmse, others))
    return replace(model, cv=_over_the_cube(model, cv)), cv


def _over_the_cube(model: Kriging, left_out: Scores) -> Scores:
    """Scores that those of left-out points let expect over the whole cube; never worse than they are.

    A left-out point is farther from all others than a new one, and often outside of them: its error e counts as
    e s/s₋, s₋ the deviation that was stated for it and s that of all data at a new point. The root mean square is

        rmse = √mean(e²/s₋²) √mean_x s(x)² = inflate √mean_x s(x)²,   x over the cube.

    Source: Bachoc, Comput. Stat. Data Anal. 66 (2013) 55 (scale of the variance by cross-validation); Le Gratiet &
    Cannamela, Technometrics 57 (2015) 418 (the stated variance corrected by left-out errors).
    """
    with np.errstate(over="ignore", invalid="ignore"):
        sd = replace(model, rivals=()).predict(sobol_sequence(model.d, 512, 0))[1]
        expected = float(np.sqrt(np.mean(sd**2)))
    return scaled(left_out, expected / left_out.rmse) if expected < left_out.rmse else left_out


def _searched(d: int) -> int:
    """Runs at most that kernel and trend are sought with: enough for a quadratic trend too."""
    return max(MAX_SEARCHED_RUNS, 2 * len(monomial_exponents(d, 2)))


def _option(model: Kriging) -> tuple[str, int, bool]:
    return model.kernel, model.trend, model.log


def farthest_first(X: np.ndarray, m: int) -> np.ndarray:
    """Rows (at most m) of X (n, d) that fill the space as X does: each is the farthest from those before it.

    Source: Gonzalez, Theor. Comput. Sci. 38 (1985) 293 (within a factor 2 of the least covering radius).
    """
    if len(X) <= m:
        return np.arange(len(X))
    rows = [int(np.sum((X - X.mean(axis=0)) ** 2, axis=1).argmin())]
    distance = np.full(len(X), np.inf)
    while len(rows) < m:
        distance = np.minimum(distance, np.sum((X - X[rows[-1]]) ** 2, axis=1))
        rows.append(int(distance.argmax()))
    return np.sort(rows)


def _rivals(error: float, others: list[Kriging]) -> tuple[tuple[float, Kriging], ...]:
    """The next best models with weights e_k⁻⁴/Σ_j e_j⁻⁴ among them and the best.

    e are their leave-one-out errors, but for the best one's, `error`, that of refitted folds: it was chosen for the
    smallest of many leave-one-out errors, which flatters it.
    Source: Goel, Haftka, Shyy & Queipo, Struct. Multidisc. Optim. 33 (2007) 199 (weights by errors).
    """
    others = others[:N_RIVAL_MODELS]
    if error == 0.0 or not others or scores_of(others[0]).rmse == 0.0:  # exact: nobody has a say beside it
        return ()
    weights = np.array([(error / scores_of(m).rmse) ** 4 for m in others])
    return tuple(zip((weights / (1 + weights.sum())).tolist(), others, strict=True))


def _tame(models: list[Any], y: np.ndarray) -> list[Any]:
    """The models without those of a logarithm that are lost between the points, if any others are there.

    exp(m + s²/2) has no bound where s is large: one such place spoils a prediction that cross-validation praised.  How
    large the mean is says nothing by itself: a power law rises by decades, and its sd shows whether it knows that.
    """
    d = models[0].d
    Q = np.vstack([sobol_sequence(d, 256, 0), *([factorial(d, levels=(2,) * d)] if d <= 8 else [])])
    kept = []
    for m in models:
        if m.log:
            with np.errstate(over="ignore", invalid="ignore"):
                mean, sd = m.predict(Q)
                far = mean > 10 * y.max()
                if not np.all(np.isfinite(mean)) or np.any(sd > np.where(far, MAX_LOG_SD_RATIO, 1.0) * mean):
                    continue
        kept.append(m)
    return kept or models


def _kriging(
    data: TrainingData, option: tuple[str, int, bool], share: float | None, seed: int, *, restarts: int = 0,
    start: Kriging | None = None,
) -> Kriging:  # fmt: skip
    kernel, trend, log = option
    return fit_kriging(
        data.X, data.y, seed=seed, trend=trend, log=log, kernel=kernel, noise_sd=data.noise, share=share,
        gradients=data.gradients, gradient_sd=_gradient_sd(data.noise, data.X), restarts=restarts, start=start,
    )  # fmt: skip


def _gradient_sd(noise: np.ndarray | None, X: np.ndarray) -> np.ndarray | float:
    """Scatter of gradients where that of values is known: the same over half the range, an error of size σ/½."""
    return 0.0 if noise is None else np.repeat(2 * np.asarray(noise, float)[:, None], X.shape[1], axis=1)


def _name(model: Surrogate) -> str:
    if isinstance(model, Polynomial):
        selected = "" if model.full else f" with {len(model.exponents)} selected terms"
        name = f"polynomial of degree {model.degree}{selected}"
    else:
        name = "kriging" + ("" if model.slopes is None else " through the derivatives")
    return name + (" of the logarithm" if model.log else "")


def _error(scores: Scores, unit: str) -> str:
    return f"{scores.rmse:.3g} {unit}".rstrip() + f" ({100 * scores.relative_rmse:.2g} %)"
