"""What every surrogate shares: the cube it lives in, the polynomial basis, the logarithm of a positive output."""

from __future__ import annotations

from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg.lapack import dgeqrf, dorgqr, dtrtrs


def outside(X: np.ndarray, d: int, tolerance: float = 1e-9) -> np.ndarray:
    """Mask (n,) of the points X (n, d) that lie outside the unit cube by more than `tolerance`."""
    X = np.asarray(X, float)
    if X.ndim != 2 or X.shape[1] != d:
        raise ValueError(f"surrogate: expected points of shape (n, {d}), got {X.shape}")
    return ~np.all((X >= -tolerance) & (X <= 1 + tolerance), axis=1)


def within_ranges(X: np.ndarray, d: int) -> np.ndarray:
    """X as an array, or ValueError: a surrogate knows nothing outside the ranges that were sampled."""
    bad = outside(X, d)
    if bad.any():
        first = np.asarray(X, float)[bad][0]
        raise ValueError(f"surrogate: {bad.sum()} of {len(bad)} points lie outside the unit cube, the first at {first}")
    return np.asarray(X, float)


def checked_samples(X: np.ndarray, y: np.ndarray, log: bool) -> tuple[np.ndarray, np.ndarray]:
    """Data of a fit as float arrays X (n, d) and y (n,); ValueError for what no fit can use."""
    X, y = np.asarray(X, float), np.asarray(y, float)
    if X.ndim != 2 or y.shape != (len(X),):
        raise ValueError(f"surrogate: needs X (n, d) and y (n,), got {X.shape} and {y.shape}")
    if not np.all(np.isfinite(y)):
        raise ValueError(f"surrogate: {np.sum(~np.isfinite(y))} values are not finite; leave failed runs out")
    if log and y.min() <= 0:
        raise ValueError(f"surrogate: a logarithm needs positive outputs, the smallest is {y.min():g}")
    return within_ranges(X, X.shape[1]), y


@cache
def monomial_exponents(d: int, degree: int) -> np.ndarray:
    """Exponents (terms, d) of every monomial of total degree <= `degree`, constant first; not to be written to."""
    rows = [c for k in range(degree + 1) for c in combinations_with_replacement(range(d), k)]
    found = np.array([[row.count(j) for j in range(d)] for row in rows])
    found.flags.writeable = False
    return found


def legendre(X: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """Basis Π_j P_{e_j}(2 x_j − 1) (n, terms): spans the monomials and is far better conditioned."""
    # numpy's legvander by hand: single points are asked for ten thousands of times, and its checks outweigh the sums.
    x, highest = 2 * X.T - 1, int(exponents.max(initial=0))
    P = np.ones((highest + 1, *x.shape))
    if highest > 0:
        P[1] = x
    for k in range(2, highest + 1):
        P[k] = (P[k - 1] * x * (2 * k - 1) - P[k - 2] * (k - 1)) / k
    A = P[exponents[:, 0], 0]
    for j in range(1, len(x)):
        A *= P[exponents[:, j], j]
    return A.T


def legendre_slopes(X: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """∂/∂x_k (n, d, terms) of the basis of :func:`legendre`."""
    legval, legder = np.polynomial.legendre.legval, np.polynomial.legendre.legder
    highest = int(exponents.max(initial=0))
    V = np.polynomial.legendre.legvander(2 * X - 1, highest)
    # d/dx of P_e(2x − 1) is 2 P_e′; column e of the identity holds the coefficients of P_e.
    S = np.stack([2 * legval(2 * X - 1, legder(np.eye(highest + 1)[e])) for e in range(highest + 1)], axis=-1)
    B = np.ones((len(X), X.shape[1], len(exponents)))
    for k in range(X.shape[1]):
        for j, column in enumerate(exponents.T):
            B[:, k] *= (S if j == k else V)[:, j, column]
    return B


def from_log(m: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of exp(N(m, s²)): e^(m + s²/2) and mean·√(e^(s²) − 1)."""
    mean = np.exp(m + s**2 / 2)
    return mean, mean * np.sqrt(np.expm1(s**2))


def triangular(L: np.ndarray, B: np.ndarray, *, upper: bool = False) -> np.ndarray:
    """L⁻¹ B for a lower triangular L (m, m), or L⁻ᵀ B for an `upper` one, B (m, n).

    LAPACK's own routine: predictions solve thousands of small systems, whose size scipy's checks outweigh.
    LinAlgError where L is singular.
    """
    X, info = dtrtrs(L, B, lower=not upper, trans=int(upper))
    if info:
        raise np.linalg.LinAlgError(f"a triangular factor is singular (dtrtrs: {info})")
    return X


def thin_qr(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Q (m, n) with orthonormal columns and upper R (n, n) of A = Q R (m, n), m >= n, as :func:`triangular`."""
    n = A.shape[1]
    factored, tau, _, _ = dgeqrf(A)
    R = factored[:n].copy()
    for i in range(1, n):  # few: np.triu takes longer
        R[i, :i] = 0.0
    return dorgqr(factored, tau, overwrite_a=True)[0], R
