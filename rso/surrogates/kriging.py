"""Kriging: a polynomial trend plus a Gaussian process with a Matérn 5/2 kernel, one length per parameter."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from rso.surrogates.common import checked, from_log, inside, legendre, outside, powers
from rso.surrogates.scores import Scores, score

LENGTHS = (0.05, 20.0)  # in units of the cube: shorter is unseen between points, longer is no influence
VARIANCES = (1e-2, 1e3)  # of the standardised output
JITTER = 1e-10


@dataclass(frozen=True, eq=False)
class Kriging:
    """Universal kriging y(x) = a(x)ᵀβ + Z(x), or its exponential where `log`; conditioned on X (n, d), t (n,).

    With K = c·Matérn5/2(ℓ) + noise, H = AᵀK⁻¹A and k = k(x) (Rasmussen & Williams 2006, eq. 2.41 and 2.42):
    mean = aᵀβ + kᵀK⁻¹(t − Aβ), var = c − kᵀK⁻¹k + rᵀH⁻¹r, r = a − AᵀK⁻¹k. The variance is that of the function, without
    noise, at fixed hyper-parameters. `t`, `variance` (c) and `noise` (n,) are those of y, or of ln y where `log`.
    """

    X: np.ndarray
    t: np.ndarray
    noise: np.ndarray
    trend: int
    variance: float
    lengths: np.ndarray
    log: bool
    L: np.ndarray
    beta: np.ndarray
    weights: np.ndarray
    LA: np.ndarray
    LH: np.ndarray
    cv: Scores | None = None
    story: str = ""

    @property
    def d(self) -> int:
        """Number of parameters."""
        return self.X.shape[1]

    def predict(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n,) in the units of y at X (n, d); ValueError outside the unit cube."""
        X = inside(X, self.d)
        k = self.variance * matern(X, self.X, self.lengths)
        a = legendre(X, powers(self.d, self.trend))
        m = a @ self.beta + k @ self.weights
        v = solve_triangular(self.L, k.T, lower=True)
        u = solve_triangular(self.LH, a.T - self.LA.T @ v, lower=True)
        sd = np.sqrt(np.maximum(self.variance - np.sum(v**2, axis=0) + np.sum(u**2, axis=0), 0.0))
        return from_log(m, sd) if self.log else (m, sd)

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Mean alone (n,), faster."""
        if self.log:
            return self.predict(X)[0]
        X = inside(X, self.d)
        trend = legendre(X, powers(self.d, self.trend)) @ self.beta
        return trend + self.variance * matern(X, self.X, self.lengths) @ self.weights

    def outside(self, X: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points where this surrogate refuses to answer."""
        return outside(X, self.d)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data."""
        return {
            "kind": "kriging",
            "X": self.X.tolist(),
            "t": self.t.tolist(),
            "noise": self.noise.tolist(),
            "trend": self.trend,
            "variance": self.variance,
            "lengths": self.lengths.tolist(),
            "log": self.log,
            "cv": None if self.cv is None else vars(self.cv).copy(),
            "story": self.story,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Kriging:
        """Inverse of :meth:`to_dict`."""
        X, t, noise, lengths = (np.array(data[k], float) for k in ("X", "t", "noise", "lengths"))
        cv = None if data["cv"] is None else Scores(**data["cv"])
        return _condition(X, t, noise, data["trend"], data["variance"], lengths, data["log"], cv, data["story"])


def matern(X: np.ndarray, Y: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Correlation (1 + √5 r + 5r²/3) e^(−√5 r), r = |(x − y)/ℓ| (Rasmussen & Williams 2006, eq. 4.17)."""
    # Term by term: |x|² + |y|² − 2xy loses the digits that a nearly interpolating process needs.
    r2 = sum(((X[:, j, None] - Y[None, :, j]) / lengths[j]) ** 2 for j in range(X.shape[1]))
    q = np.sqrt(5 * r2)
    return (1 + q + q**2 / 3) * np.exp(-q)


def fit_kriging(
    X: np.ndarray,
    y: np.ndarray,
    *,
    seed: int,
    trend: int = 1,
    log: bool = False,
    noise_sd: np.ndarray | float | None = None,
    restarts: int = 4,
    start: Kriging | None = None,
) -> Kriging:
    """Kriging through X (n, d) in the unit cube and y (n,), lengths and variance by maximum likelihood.

    `noise_sd` (n,) or scalar is the known standard deviation of y in its own units (0 interpolates); `trend`
    is the degree 0, 1 or 2 of the polynomial. `start` gives the first hyper-parameters of the optimiser.
    `cv` holds the leave-one-out scores at fixed hyper-parameters (optimistic; see `scores.cross_validate`).

    Raises
    ------
    ValueError
        for a trend with too many terms for the points, or fewer than 3 points.
    """
    X, y = checked(X, y, log)
    n, d = X.shape
    terms = len(powers(d, trend))
    if trend not in (0, 1, 2) or n < 3 or n <= terms:
        raise ValueError(
            f"kriging: trend must be 0, 1 or 2 with fewer terms ({terms}) than points ({n} >= 3), got {trend}"
        )
    noise = np.broadcast_to(0.0 if noise_sd is None else np.asarray(noise_sd, float), (n,))
    if not np.all(noise >= 0):
        raise ValueError(f"kriging: noise_sd must be finite and >= 0, the smallest is {noise.min()}")
    t, noise = (np.log(y), noise / y) if log else (y, noise)
    A = legendre(X, powers(d, trend))
    rest = t - A @ np.linalg.lstsq(A, t, rcond=None)[0]
    # What the trend leaves of an exactly polynomial output is rounding error: no process is fitted to that.
    size = max(np.abs(t).max(), np.ptp(t))
    scale = float(np.std(rest))
    if scale <= 1e-12 * size:
        return _condition(X, t, noise, trend, (1e-6 * size or 1.0) ** 2, np.full(d, 1.0), log)
    c, lengths = _hyper_parameters(X, rest / scale, (noise / scale) ** 2 + JITTER, restarts, seed, start, scale)
    return _condition(X, t, noise, trend, c * scale**2, lengths, log)


def _hyper_parameters(
    X: np.ndarray, z: np.ndarray, alpha: np.ndarray, restarts: int, seed: int, start: Kriging | None, scale: float
) -> tuple[float, np.ndarray]:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern
    from threadpoolctl import threadpool_limits  # comes with scikit-learn

    c = 1.0 if start is None else float(np.clip(start.variance / scale**2, *VARIANCES))
    lengths = np.full(X.shape[1], 0.5) if start is None else start.lengths
    kernel = ConstantKernel(c, VARIANCES) * Matern(lengths, LENGTHS, nu=2.5)
    process = GaussianProcessRegressor(kernel, alpha=alpha, n_restarts_optimizer=restarts, random_state=seed)
    # Two BLAS threads made such small fits 30 times slower on a loaded machine, and importing numpy before rso
    # defeats the environment variables that rso sets.
    with warnings.catch_warnings(), threadpool_limits(1):
        # A length at its upper bound means "no influence", which `describe` says in words.
        warnings.simplefilter("ignore")
        process.fit(X, z)
    theta = np.exp(process.kernel_.theta)
    return float(theta[0]), theta[1:]


def _condition(
    X: np.ndarray,
    t: np.ndarray,
    noise: np.ndarray,
    trend: int,
    variance: float,
    lengths: np.ndarray,
    log: bool,
    cv: Scores | None = None,
    story: str = "",
) -> Kriging:
    K = variance * matern(X, X, lengths) + np.diag(noise**2)
    jitter = JITTER
    while True:
        try:
            L = cholesky(K + jitter * variance * np.eye(len(X)), lower=True)
            break
        except np.linalg.LinAlgError:
            # Nearly coincident points: a hundred times the jitter still hides below any force that matters.
            jitter *= 100
            if jitter > 1e-5:
                raise
    A = legendre(X, powers(X.shape[1], trend))
    LA = solve_triangular(L, A, lower=True)
    LH = cholesky(LA.T @ LA, lower=True)
    beta = cho_solve((LH, True), LA.T @ solve_triangular(L, t, lower=True))
    weights = cho_solve((L, True), t - A @ beta)
    if cv is None:
        cv = _leave_one_out(L, LA, LH, t, weights, log)
    return Kriging(X, t, noise, trend, variance, lengths, log, L, beta, weights, LA, LH, cv, story)


def _leave_one_out(
    L: np.ndarray, LA: np.ndarray, LH: np.ndarray, t: np.ndarray, weights: np.ndarray, log: bool
) -> Scores:
    """Dubrule (1983): with P = K⁻¹ − K⁻¹A H⁻¹ AᵀK⁻¹, t_i − t_{−i} = (P t)_i/P_ii and var_{−i} = 1/P_ii."""
    KA = solve_triangular(L, LA, lower=True, trans="T")
    P = cho_solve((L, True), np.eye(len(t))) - KA @ cho_solve((LH, True), KA.T)
    p = np.diag(P)
    left_out = t - weights / p
    if not log:
        return score(left_out, t)
    with np.errstate(over="ignore"):
        return score(from_log(left_out, np.sqrt(1 / p))[0], np.exp(t))


def describe(model: Kriging, names: tuple[str, ...] | None = None) -> str:
    """The hyper-parameters in words, with those that ended at a bound."""
    names = names or tuple(f"x{j + 1}" for j in range(model.d))
    far = [name for name, length in zip(names, model.lengths, strict=True) if length > 0.99 * LENGTHS[1]]
    near = [name for name, length in zip(names, model.lengths, strict=True) if length < 1.01 * LENGTHS[0]]
    text = "Kriging of the logarithm" if model.log else "Kriging"
    text += f", Matérn 5/2, trend of degree {model.trend}"
    text += f"; beyond its trend it does not depend on {', '.join(far)}" if far else ""
    return text + (f"; unresolved between the points along {', '.join(near)}" if near else "")
