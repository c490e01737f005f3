"""Kriging: a polynomial trend plus a stationary Gaussian process, through values and, where known, their slopes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from rso.emulation.common import (
    checked_samples,
    from_log,
    legendre,
    legendre_slopes,
    monomial_exponents,
    outside,
    triangular,
    within_ranges,
)
from rso.emulation.kernels import KERNEL_WORDS, KERNELS, covariances, kernel_matrix
from rso.emulation.kriging_likelihood import (
    CORRELATION_LENGTH_RANGE,
    KrigingData,
    cholesky_factor,
    correlation,
    hyper_parameters,
    one_thread,
)
from rso.emulation.scores import Scores, score


@dataclass(frozen=True, eq=False)
class Kriging:
    """Universal kriging y(x) = a(x)ᵀβ + Z(x), or its exponential where `log`; conditioned on X (n, d), t (n,).

    With K = c R + η² noise², H = AᵀK⁻¹A and k = k(x) (Rasmussen & Williams 2006, eq. 2.41 and 2.42):
    mean = aᵀβ + kᵀK⁻¹(t − Aβ), var = c − kᵀK⁻¹k + rᵀH⁻¹r, r = a − AᵀK⁻¹k. The variance is that of the function, without
    noise, at fixed hyper-parameters. `t`, `variance` (c) and `noise` (n,) are those of y, or of ln y where `log`;
    `share` is η. `slopes` (n, d) are ∂t/∂x, NaN where unknown, with noise `slope_noise` (n, d); None if there are none.

    Hyper-parameters that are taken for known leave too small an sd, and another kernel or trend might have been chosen:

        sd² = (inflate √var)² + Σ_k w_k ((m_k − m)² + var_k),   in the units of y

    with `inflate` >= 1 from refitted folds and the `rivals` (w_k, m_k), the next best models by cross-validation.
    Source: Goel, Haftka, Shyy & Queipo, Struct. Multidisc. Optim. 33 (2007) 199 (disagreement of several surrogates);
    Hoeting, Madigan, Raftery & Volinsky, Stat. Sci. 14 (1999) 382, eq. 3 (their variances), but for the best one's
    weight, which stays 1.
    """

    X: np.ndarray
    t: np.ndarray
    noise: np.ndarray
    trend: int
    variance: float
    lengths: np.ndarray
    log: bool
    kernel: str
    share: float
    slopes: np.ndarray | None
    slope_noise: np.ndarray | None
    L: np.ndarray
    beta: np.ndarray
    weights: np.ndarray
    LA: np.ndarray
    LH: np.ndarray
    cv: Scores | None = None
    story: str = ""
    inflate: float = 1.0
    rivals: tuple[tuple[float, Kriging], ...] = ()

    kind = "kriging"

    @property
    def d(self) -> int:
        """Number of parameters."""
        return self.X.shape[1]

    @cached_property
    def _columns(self) -> np.ndarray | slice:
        return slice(None) if self.slopes is None else _kept(self.slopes)

    def _covariance(self, X: np.ndarray, left: bool = False) -> np.ndarray:
        """Covariance of the process at X with the observations, ((1 + d left) n, N)."""
        right = self.slopes is not None
        K = self.variance * kernel_matrix(self.kernel, X, self.X, self.lengths, left=left, right=right)
        return K[:, self._columns]

    def predict(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n,) in the units of y at X (n, d); ValueError outside the unit cube."""
        m, sd = self._moments(X)
        variance = (self.inflate * sd) ** 2
        for weight, rival in self.rivals:
            other, s = rival._moments(X)
            variance += weight * ((other - m) ** 2 + s**2)
        return m, np.sqrt(variance)

    def _moments(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n,) of this process alone."""
        X = within_ranges(X, self.d)
        return self._moments_of(legendre(X, monomial_exponents(self.d, self.trend)), self._covariance(X))

    def _moments_of(self, a: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        m = a @ self.beta + k @ self.weights
        v = triangular(self.L, k.T)
        u = triangular(self.LH, a.T - self.LA.T @ v)
        sd = np.sqrt(np.maximum(self.variance - np.einsum("ij,ij->j", v, v) + np.einsum("ij,ij->j", u, u), 0.0))
        return from_log(m, sd) if self.log else (m, sd)

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Mean alone (n,), faster."""
        X = within_ranges(X, self.d)
        return self.mean_of(legendre(X, monomial_exponents(self.d, self.trend)), self._covariance(X))

    def mean_of(self, a: np.ndarray, k: np.ndarray) -> np.ndarray:
        """Mean (n,) from the basis of the trend a (n, terms) and covariances with the observations k (n, N)."""
        return self._moments_of(a, k)[0] if self.log else a @ self.beta + k @ self.weights

    def gradient(self, X: np.ndarray) -> np.ndarray:
        """∂/∂x (n, d) of the mean; where `log`, of its median e^m."""
        X = within_ranges(X, self.d)
        exponents = monomial_exponents(self.d, self.trend)
        process = (self._covariance(X, left=True) @ self.weights).reshape(1 + self.d, -1)
        slopes = process[1:].T + np.einsum("nkp,p->nk", legendre_slopes(X, exponents), self.beta)
        if not self.log:
            return slopes
        return np.exp(legendre(X, exponents) @ self.beta + process[0])[:, None] * slopes

    def outside(self, X: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points where this surrogate refuses to answer."""
        return outside(X, self.d)

    def to_dict(self) -> dict[str, Any]:
        """Plain data and arrays; an unknown slope is NaN."""
        return {
            "kind": "kriging",
            "X": self.X,
            "t": self.t,
            "noise": self.noise,
            "trend": self.trend,
            "variance": self.variance,
            "lengths": self.lengths,
            "log": self.log,
            "kernel": self.kernel,
            "share": self.share,
            "slopes": self.slopes,
            "slope_noise": self.slope_noise,
            "cv": None if self.cv is None else vars(self.cv).copy(),
            "story": self.story,
            "inflate": self.inflate,
            "rivals": [{"weight": w, "model": rival.to_dict()} for w, rival in self.rivals],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Kriging:
        """Inverse of :meth:`to_dict`; lists are as good as arrays."""
        X, t, noise, lengths = (np.array(data[k], float) for k in ("X", "t", "noise", "lengths"))
        slopes = (None if data[k] is None else np.array(data[k], float) for k in ("slopes", "slope_noise"))
        cv = None if data["cv"] is None else Scores(**data["cv"])
        model = condition(
            X,
            t,
            noise,
            data["trend"],
            data["variance"],
            lengths,
            data["log"],
            data["kernel"],
            data["share"],
            *slopes,
            cv=cv,
            story=data["story"],
        )
        rivals = tuple((r["weight"], cls.from_dict(r["model"])) for r in data.get("rivals", ()))
        return replace(model, inflate=data.get("inflate", 1.0), rivals=rivals)


@dataclass(frozen=True, eq=False)
class KrigingBatch:
    """Processes of one kernel and trend through the same points, to be asked for their means together."""

    models: tuple[Kriging, ...]

    @staticmethod
    def alike(model: Kriging) -> tuple[Any, ...]:
        """Equal for processes that a batch may hold."""
        mask = None if model.slopes is None else _kept(model.slopes).tobytes()
        return model.kernel, model.trend, model.X.shape, model.X.tobytes(), mask

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Means (n, m) at X (n, d) in the unit cube, to the bits of :meth:`Kriging.mean`: a search follows them."""
        first, m = self.models[0], np.empty((len(X), len(self.models)))
        G = covariances(first.kernel, X, first.X, self._lengths, first.slopes is not None)
        A = legendre(X, monomial_exponents(first.d, first.trend))
        for j, model in enumerate(self.models):
            m[:, j] = model.mean_of(A, (model.variance * G[j])[:, first._columns])
        return m

    @cached_property
    def _lengths(self) -> np.ndarray:
        """(m, d)."""
        return np.array([k.lengths for k in self.models])


def fit_kriging(
    X: np.ndarray,
    y: np.ndarray,
    *,
    seed: int,
    trend: int = 1,
    log: bool = False,
    kernel: str = "matern52",
    noise_sd: np.ndarray | float | None = None,
    share: float | None = 1.0,
    gradients: np.ndarray | None = None,
    gradient_sd: np.ndarray | float = 0.0,
    restarts: int = 2,
    start: Kriging | None = None,
) -> Kriging:
    """Kriging through X (n, d) in the unit cube and y (n,), hyper-parameters by restricted maximum likelihood.

    `noise_sd` (n,) or scalar is the standard deviation of y in its own units (0 interpolates), known up to the factor
    `share`; None has that factor estimated in [0.001, 1]. `trend` is the degree 0, 1 or 2 of the polynomial; `kernel`
    'matern52' or 'squared_exponential'. `gradients` (n, d) are ∂y/∂x over the unit cube, NaN where unknown, with
    standard deviation `gradient_sd` (n, d) or scalar: values and gradients are then both interpolated.
    `start` gives the first hyper-parameters of the optimiser. `cv` holds the leave-one-out scores (value and
    gradient of a point left out together) at fixed hyper-parameters: optimistic; see `scores.cross_validate`.

    Raises
    ------
    ValueError
        for a trend with too many terms for the points, fewer than 3 points, an unknown kernel or bad noise.
    """
    X, y = checked_samples(X, y, log)
    n, d = X.shape
    terms = len(monomial_exponents(d, trend))
    if trend not in (0, 1, 2) or n < 3 or n <= terms:
        raise ValueError(
            f"kriging: trend must be 0, 1 or 2 with fewer terms ({terms}) than points ({n} >= 3), got {trend}"
        )
    if kernel not in KERNELS:
        raise ValueError(f"kriging: unknown kernel {kernel!r}; choose one of {', '.join(KERNELS)}")
    noise = np.broadcast_to(0.0 if noise_sd is None else np.asarray(noise_sd, float), (n,))
    if not np.all(noise >= 0):
        raise ValueError(f"kriging: noise_sd must be finite and >= 0, the smallest is {noise.min()}")
    slopes, slope_noise = _checked_slopes(X, gradients, gradient_sd)
    t = y
    if log:
        t, noise = np.log(y), noise / y
        if slopes is not None:
            slopes, slope_noise = slopes / y[:, None], slope_noise / y[:, None]
    data, t_all = _data(X, t, noise, trend, slopes, slope_noise)
    rest = t_all - data.A @ np.linalg.lstsq(data.A, t_all, rcond=None)[0]
    # What the trend leaves of an exactly polynomial output is rounding error: no process is fitted to that.
    size = max(np.abs(t).max(), np.ptp(t))
    scale = float(np.std(rest[:n]))
    if float(np.abs(rest).max()) <= 1e-12 * size or scale == 0.0:
        small = (1e-6 * size or 1.0) ** 2
        return condition(X, t, noise, trend, small, np.full(d, 1.0), log, kernel, 1.0, slopes, slope_noise)
    scaled = KrigingData(data.X, rest / scale, data.A, data.noise / scale, data.keep, data.slopes)
    first = None
    if start is not None:
        variance = np.clip(start.variance / scale**2, 1e-3, 1e4)
        first = np.log(
            [*start.lengths, *([variance] if noise.any() else []), *([start.share] if share is None else [])]
        )
    with one_thread():
        c, lengths, found = hyper_parameters(
            scaled, kernel, seed=seed, start=first, restarts=restarts, free_share=share is None and bool(noise.any())
        )
        used = found if share is None else share
        return condition(X, t, noise, trend, c * scale**2, lengths, log, kernel, used, slopes, slope_noise)


def _checked_slopes(X: np.ndarray, gradients: Any, sd: Any) -> tuple[np.ndarray | None, np.ndarray | None]:
    if gradients is None:
        return None, None
    slopes = np.array(gradients, float)
    if slopes.shape != X.shape or np.any(np.isinf(slopes)):
        raise ValueError(f"kriging: gradients need shape {X.shape} and no infinities, got {slopes.shape}")
    noise = np.broadcast_to(np.asarray(sd, float), X.shape)
    if not np.all(noise >= 0):
        raise ValueError("kriging: gradient_sd must be finite and >= 0")
    return (None, None) if np.isnan(slopes).all() else (slopes, noise)


def _kept(slopes: np.ndarray) -> np.ndarray:
    """Mask ((1 + d) n,) of the values, all there, and of the slopes that are known, parameter by parameter."""
    return np.concatenate([np.full(len(slopes), True), ~np.isnan(slopes).T.ravel()])


def _data(
    X: np.ndarray,
    t: np.ndarray,
    noise: np.ndarray,
    trend: int,
    slopes: np.ndarray | None,
    slope_noise: np.ndarray | None,
) -> tuple[KrigingData, np.ndarray]:
    """Observations with their trend rows and noise, and z (N,)."""
    n, d = X.shape
    exponents = monomial_exponents(d, trend)
    A = legendre(X, exponents)
    if slopes is None or slope_noise is None:
        return KrigingData(X, t, A, np.asarray(noise), np.full(n, True)), t
    keep = _kept(slopes)
    A = np.vstack([A, *legendre_slopes(X, exponents).transpose(1, 0, 2)])[keep]
    z = np.concatenate([t, slopes.T.ravel()])[keep]
    return KrigingData(X, z, A, np.concatenate([noise, slope_noise.T.ravel()])[keep], keep, True), z


def condition(
    X: np.ndarray,
    t: np.ndarray,
    noise: np.ndarray,
    trend: int,
    variance: float,
    lengths: np.ndarray,
    log: bool,
    kernel: str = "matern52",
    share: float = 1.0,
    slopes: np.ndarray | None = None,
    slope_noise: np.ndarray | None = None,
    *,
    cv: Scores | None = None,
    story: str = "",
) -> Kriging:
    """The process with these hyper-parameters, conditioned on the data; leave-one-out scores unless `cv` is given."""
    data, z = _data(X, t, noise, trend, slopes, slope_noise)
    with one_thread():
        L = cholesky_factor(variance * correlation(data, kernel, lengths) + np.diag((share * data.noise) ** 2))
        LA = solve_triangular(L, data.A, lower=True)
        LH = cholesky(LA.T @ LA, lower=True)
        beta = cho_solve((LH, True), LA.T @ solve_triangular(L, z, lower=True))
        weights = cho_solve((L, True), z - data.A @ beta)
        if cv is None:
            cv = _leave_one_out(L, LA, LH, t, weights, log, data.keep)
    return Kriging(
        X,
        t,
        np.asarray(noise),
        trend,
        float(variance),
        lengths,
        log,
        kernel,
        float(share),
        slopes,
        slope_noise,
        L,
        beta,
        weights,
        LA,
        LH,
        cv,
        story,
    )


def conditioned(model: Kriging, rows: np.ndarray) -> Kriging:
    """The process with the hyper-parameters of `model`, conditioned on these rows of its data alone."""
    slopes, slope_noise = (None if v is None else v[rows] for v in (model.slopes, model.slope_noise))
    return condition(
        model.X[rows],
        model.t[rows],
        model.noise[rows],
        model.trend,
        model.variance,
        model.lengths,
        model.log,
        model.kernel,
        model.share,
        slopes,
        slope_noise,
        cv=model.cv,
    )


def _leave_one_out(
    L: np.ndarray,
    LA: np.ndarray,
    LH: np.ndarray,
    t: np.ndarray,
    weights: np.ndarray,
    log: bool,
    keep: np.ndarray,
) -> Scores:
    """Dubrule (1983) in blocks: with P = K⁻¹ − K⁻¹A H⁻¹ AᵀK⁻¹, z_I − z_{−I} = P_II⁻¹ (P z)_I with covariance P_II⁻¹.

    A block I is the value of a point and whatever slopes are known there; P z are the weights.
    """
    n = len(t)
    KA = solve_triangular(L, LA, lower=True, trans="T")
    P = cho_solve((L, True), np.eye(len(L))) - KA @ cho_solve((LH, True), KA.T)
    if len(P) == n:
        gap, variance = weights / np.diag(P), 1 / np.diag(P)
    else:
        point = np.tile(np.arange(n), len(keep) // n)[keep]
        gap, variance = np.empty(n), np.empty(n)
        for i in range(n):
            I = np.nonzero(point == i)[0]
            inverse = np.linalg.pinv(P[np.ix_(I, I)], hermitian=True)
            gap[i], variance[i] = inverse[0] @ weights[I], inverse[0, 0]
    left_out = t - gap
    if not log:
        return score(left_out, t)
    with np.errstate(over="ignore"):
        return score(from_log(left_out, np.sqrt(np.maximum(variance, 0.0)))[0], np.exp(t))


def _changes(model: Kriging) -> list[float]:
    """Largest change (of t) of the process over the range of each parameter, at the points of the data."""
    found = []
    for j in range(model.d):
        ends = []
        for end in (0.0, 1.0):
            X = model.X.copy()
            X[:, j] = end
            ends.append(model._covariance(X) @ model.weights)
        found.append(float(np.abs(ends[1] - ends[0]).max()))
    return found


def describe(model: Kriging, names: tuple[str, ...] | None = None) -> str:
    """The hyper-parameters in words, with those that ended at a bound."""
    names = names or tuple(f"x{j + 1}" for j in range(model.d))
    far = [name for name, change in zip(names, _changes(model), strict=True) if change < 1e-3 * np.std(model.t)]
    near = [
        name for name, length in zip(names, model.lengths, strict=True) if length < 1.01 * CORRELATION_LENGTH_RANGE[0]
    ]
    text = "Kriging of the logarithm" if model.log else "Kriging"
    text += f", {KERNEL_WORDS[model.kernel]}, trend of degree {model.trend}"
    text += "" if model.slopes is None else ", through the derivatives too"
    text += f"; {100 * model.share:.2g} % of the stated numerical error is scatter" if model.share != 1.0 else ""
    text += f"; beyond its trend it does not depend on {', '.join(far)}" if far else ""
    return text + (f"; unresolved between the points along {', '.join(near)}" if near else "")
