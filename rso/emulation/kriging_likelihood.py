"""Hyper-parameters of kriging by restricted maximum likelihood, with its exact gradient."""

from __future__ import annotations

import functools
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import minimize
from threadpoolctl import ThreadpoolController

from rso.doe import sobol_sequence
from rso.emulation.common import thin_qr, triangular
from rso.emulation.kernels import kernel_derivatives, kernel_matrix, length_slopes, squares

# in units of the cube: shorter is unseen between points; a long one makes a nearly linear term
CORRELATION_LENGTH_RANGE = (0.05, 500.0)
VARIANCE_RANGE = (1e-3, 1e8)  # of the standardised output; beyond, the jitter would be a noise that nobody stated
NOISE_SHARE_RANGE = (1e-3, 1.0)  # of the stated noise
CHOLESKY_JITTER = 1e-14  # of the diagonal: rounding alone makes a matrix of near points indefinite
N_RANDOM_STARTS = 8  # random starts that are looked at


@dataclass(frozen=True, eq=False)
class KrigingData:
    """What the likelihood sees: observations z (N,) with trend rows A (N, p) and noise (N,) at points X (n, d).

    `keep` (n + n d,) marks the values and slopes that were observed; `slopes` whether there are slopes at all.
    """

    X: np.ndarray
    z: np.ndarray
    A: np.ndarray
    noise: np.ndarray
    keep: np.ndarray
    slopes: bool = field(default=False)

    @functools.cached_property
    def squares(self) -> np.ndarray:
        """(x_j − y_j)² (d, n, n) of all pairs of points."""
        return squares(self.X)


@functools.cache
def _threads() -> ThreadpoolController:
    return ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """Context with one BLAS thread: two made such small fits 30 times slower on a loaded machine.

    Importing numpy before rso defeats the environment variables that rso sets.
    """
    return _threads().limit(limits=1)


def cholesky_factor(K: np.ndarray, jitter: float = CHOLESKY_JITTER) -> np.ndarray:
    """Lower Cholesky factor of K (N, N) with `jitter` of its own diagonal added, more where that is not enough."""
    # LAPACK by its own name: half the time of such small fits went into scipy's checks of its arguments.
    diagonal = np.diag(K)
    while True:
        J = K.copy()
        J.flat[:: len(K) + 1] += jitter * diagonal
        L, info = lapack.dpotrf(J, lower=1, clean=1, overwrite_a=1)
        if info == 0:
            return L
        # Nearly coincident points: more jitter still hides below any force that matters.
        jitter *= 10
        if not jitter < 1e-5:
            raise np.linalg.LinAlgError("kriging: the covariance is not positive definite")


def correlation(data: KrigingData, kernel: str, lengths: np.ndarray) -> np.ndarray:
    """Correlation (N, N) of the observations."""
    K = kernel_matrix(kernel, data.X, data.X, lengths, left=data.slopes, right=data.slopes)
    return K if data.keep.all() else K[np.ix_(data.keep, data.keep)]


def restricted(p: np.ndarray, data: KrigingData, kernel: str, free_share: bool) -> tuple[float, np.ndarray]:
    """Negative restricted log-likelihood, without constants, and its gradient in p = (ln ℓ, ln c, ln η).

    ½ ln|K| + ½ ln|AᵀK⁻¹A| + ½ zᵀPz, P = K⁻¹ − K⁻¹A(AᵀK⁻¹A)⁻¹AᵀK⁻¹, K = c R + η² diag(noise²)
    (Harville, J. Am. Stat. Assoc. 72 (1977) 320, eq. 4.1); without noise c = zᵀP_R z/(N − p) is put in.
    """
    d = data.X.shape[1]
    lengths, noisy = np.exp(p[:d]), len(p) > d
    c = np.exp(p[d]) if noisy else 1.0
    share = np.exp(p[d + 1]) if free_share else 1.0
    if data.slopes:
        R = correlation(data, kernel, lengths)
    else:
        s = (lengths**-2.0 @ data.squares.reshape(d, -1)).reshape(data.squares.shape[1:])
        R, slope = kernel_derivatives(kernel, s, 1)
    K = R
    if noisy:
        K = c * R
        K.flat[:: len(K) + 1] += (share * data.noise) ** 2
    N, q = data.A.shape
    try:
        L = cholesky_factor(K)
    except np.linalg.LinAlgError:
        return 1e10, np.zeros_like(p)
    Q, T = thin_qr(triangular(L, data.A))
    r = triangular(L, data.z)
    r = r - Q @ (Q.T @ r)
    fit = float(r @ r)
    logdet = np.log(L.diagonal()).sum() + np.log(np.abs(T.diagonal())).sum()
    V = lapack.dtrtrs(L, np.column_stack([Q, r]), lower=1, trans=1)[0]
    V, a = V[:, :-1], V[:, -1]
    P = lapack.dpotri(L, lower=1)[0]  # its lower half; the upper one is zero, as that of L is
    diagonal = P.diagonal().copy()
    P = P + P.T - V @ V.T
    P.flat[:: N + 1] -= diagonal
    square = a[:, None] * a
    if noisy:
        value, W = logdet + 0.5 * fit, square - P
    else:
        value, W = logdet + 0.5 * (N - q) * np.log(max(fit, 1e-300)), square * ((N - q) / max(fit, 1e-300)) - P
        # The variance that was put in has an upper bound too: a wall in its logarithm.
        beyond = np.log(max(fit, 1e-300) / (N - q) / VARIANCE_RANGE[1])
        if beyond > 0:
            value, W = value + beyond**2, W + 4 * beyond / fit * square
    if data.slopes:
        full = W
        if len(W) < len(data.keep):
            full = np.zeros((len(data.keep),) * 2)
            full[np.ix_(data.keep, data.keep)] = W
        gradient = [-0.5 * c * length_slopes(kernel, data.X, lengths, full)]
    else:
        gradient = [c * lengths**-2.0 * (data.squares.reshape(d, -1) @ (W * slope).ravel())]
    if noisy:
        gradient.append(np.array([-0.5 * c * (W.ravel() @ R.ravel())]))
    if free_share:
        gradient.append(np.array([-(W.diagonal() @ (share * data.noise) ** 2)]))
    return float(value), np.concatenate(gradient)


def hyper_parameters(
    data: KrigingData, kernel: str, *, seed: int, start: np.ndarray | None, restarts: int, free_share: bool
) -> tuple[float, np.ndarray, float]:
    """(c, ℓ, η) of the smallest negative restricted likelihood; z is expected of size one.

    `start` (ln ℓ, ln c, ln η) replaces the search among random starts; `restarts` more of these are optimised.
    """
    d = data.X.shape[1]
    noisy = bool(data.noise.any())
    bounds = np.log([CORRELATION_LENGTH_RANGE] * d + [VARIANCE_RANGE] * noisy + [NOISE_SHARE_RANGE] * free_share)
    first = [np.full(d, np.log(v)) for v in (0.5, 1.5)]
    more = np.log(0.15) + np.log(20.0) * sobol_sequence(d, N_RANDOM_STARTS, seed)
    rest = [0.0] * noisy + [np.log(0.1)] * free_share
    starts = [np.array([*lengths, *rest]) for lengths in (*first, *more)]
    if start is not None:
        starts = [np.resize(start, len(bounds)), *starts[: 2 * (restarts > 0)]]

    def f(p: np.ndarray) -> tuple[float, np.ndarray]:
        return restricted(p, data, kernel, free_share)

    if len(starts) > 1:
        starts = sorted(starts, key=lambda p: f(p)[0])[: 1 + restarts]
    found = [
        minimize(f, np.clip(p, *bounds.T), jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 100})
        for p in starts
    ]
    p = min(found, key=lambda r: r.fun).x
    lengths = np.exp(p[:d])
    share = float(np.exp(p[-1])) if free_share else 1.0
    if noisy:
        return float(np.exp(p[d])), lengths, share
    L = cholesky_factor(correlation(data, kernel, lengths))
    Q, _ = thin_qr(triangular(L, data.A))
    r = triangular(L, data.z)
    r = r - Q @ (Q.T @ r)
    return float(r @ r) / (len(r) - data.A.shape[1]), lengths, share
