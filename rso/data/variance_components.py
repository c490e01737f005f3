"""What repeats differ by, in parts that are estimated together: white and correlated noise, gain and contact.

    Σ = κ diag(w) + c² e^{−|Δu|/ℓ} + g² ŷ ŷᵀ + o² ŷ' ŷ'ᵀ
    ln p = −k/2 [ln |Σ| + tr Σ⁻¹ S] − Σ_j ν₀/2 (ln v_j + v₀_j/v_j)       v = c², g², o²

S is the covariance of k = r − 1 contrasts of r repeats: what they have in common, the force itself, is not in it
(restricted maximum likelihood; Patterson & Thompson, Biometrika 58 (1971) 545).  The second sum is the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

N_CORRELATION_LENGTHS = 5  # of correlation that are tried, from the spacing of readings to the whole travel
N_POLISHED_STARTS = 2  # of these are followed to their maximum, the likeliest from where they begin
MIN_VARIANCE_RATIO = 1e-8  # of the white variance, at least: nothing
FLAT_PRIOR_WEIGHT = 1e-3  # weight of a prior that says nothing, so that a flat likelihood has a maximum


@dataclass(frozen=True)
class Parts:
    """Variances of one test: white noise in units of what was given, correlated over `length` mm, gain, contact."""

    white: float
    correlated: float
    length: float
    gain: float
    contact: float


def variance_parts(
    u: np.ndarray,
    contrasts: np.ndarray,
    white: np.ndarray,
    shapes: np.ndarray,
    priors: Sequence[float | None],
    weight: float,
    least: float = 0.0,
) -> Parts:
    """The most likely parts of contrasts (k, n) at depths u (n,), of white noise of variance `white` (n,) each.

    `shapes` (2, n) are ŷ and ŷ'; `priors` are the usual deviations of correlated noise, gain and contact, known from
    `weight` degrees of freedom; None: nothing is expected of it.  κ is `least` at least.
    """
    from scipy.linalg import eigh  # 0.1 s of start-up that only repeats need
    from scipy.optimize import minimize

    apart, k = np.abs(u[:, None] - u), len(contrasts)
    root = np.sqrt(white)
    Z = np.vstack([contrasts, shapes]) / root
    span = float(np.ptp(u)) or 1.0
    best, found = np.inf, Parts(1.0, 0.0, span, 0.0, 0.0)
    # in units in which each part is of the size of the white noise
    unit = np.array([float(np.mean(white)), *(1.0 / np.maximum(np.sum(Z[k:] ** 2, axis=1), 1e-300))])
    usual = np.array([0.0 if p is None else p**2 for p in priors]) / unit
    held = np.array([FLAT_PRIOR_WEIGHT if p is None else weight for p in priors])
    usual = np.maximum(usual, MIN_VARIANCE_RATIO)
    starts = [np.r_[0.0, np.log(np.maximum(usual, 1e-2))], *_moments(Z[:k], Z[k:])]
    bounds = [(np.log(max(least, 1e-6)), 12.0), *[(np.log(MIN_VARIANCE_RATIO), 25.0)] * 3]
    starts = [np.clip(s, *np.transpose(bounds)) for s in starts]
    tried = []
    for length in np.geomspace(span / max(len(u) - 1, 1), span, N_CORRELATION_LENGTHS):
        λ, Q = eigh(np.exp(-apart / length) * unit[0] / np.outer(root, root), check_finite=False)
        rotated = Z @ Q
        args = (np.maximum(λ, 0.0), rotated[:k] ** 2, rotated[:k], rotated[k:] * np.sqrt(unit[1:, None]), usual, held)
        tried.append((*min((float(_minus(s, *args)[0]), j) for j, s in enumerate(starts)), float(length), args))
    for _, j, length, args in sorted(tried, key=lambda t: t[0])[:N_POLISHED_STARTS]:
        result = minimize(
            _minus, starts[j], args, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 40, "ftol": 1e-7}
        )
        if result.fun < best:
            best, v = result.fun, np.exp(result.x)
            v[1:][v[1:] < 10 * MIN_VARIANCE_RATIO] = 0.0
            found = Parts(float(v[0]), float(v[1] * unit[0]), length, *map(float, v[2:] * unit[1:]))
    return found


def _moments(E: np.ndarray, F: np.ndarray) -> list[np.ndarray]:
    """Logarithms (4,) of the parts by least squares of contrasts E (k, n) on the shapes F (2, n), together and alone.

    The likelihood has more than one maximum: a gain that begins too small ends as white noise.
    """
    found = []
    for rows in ([0, 1], [0], [1]):
        A = np.linalg.lstsq(F[rows].T, E.T, rcond=1e-8)[0]
        rest = E - A.T @ F[rows]
        white = max(float(np.mean(rest**2)), 1e-6)
        each = np.full(2, MIN_VARIANCE_RATIO)
        each[rows] = np.maximum(np.mean(A**2, axis=1) * np.sum(F[rows] ** 2, axis=1), MIN_VARIANCE_RATIO)
        found.append(np.log(np.r_[white, 0.1 * white, each]))
    return found


def _minus(
    x: np.ndarray, λ: np.ndarray, squares: np.ndarray, E: np.ndarray, F: np.ndarray, usual: np.ndarray, held: np.ndarray
) -> tuple[float, np.ndarray]:
    """−2 ln p and its gradient by the logarithms x (4,) of κ, c², g², o², in the basis in which K is diag(λ).

    Σ⁻¹ = D⁻¹ − D⁻¹ V (1 + Vᵀ D⁻¹ V)⁻¹ Vᵀ D⁻¹ with D = κ + c² λ and V of ŷ and ŷ'.
    """
    κ, c, *g = np.exp(x)
    k, d = len(E), κ + c * λ
    V = F * np.sqrt(g)[:, None]  # (2, n)
    Vd = V / d
    B = np.eye(2) + Vd @ V.T
    inverse = np.linalg.inv(B)
    P = (E / d) @ V.T  # (k, 2)
    solved = E / d - P @ inverse @ Vd  # Σ⁻¹ of the contrasts
    fun = k * (np.sum(np.log(d)) + np.log(np.linalg.det(B))) + float(np.sum(squares / d)) - np.sum((P @ inverse) * P)
    diagonal = 1.0 / d - np.einsum("in,ij,jn->n", Vd, inverse, Vd)
    left = k * diagonal - np.sum(solved**2, axis=0)  # diag(k Σ⁻¹ − Σ⁻¹ E Eᵀ Σ⁻¹)
    FS = Vd - (Vd @ V.T) @ inverse @ Vd  # (2, n): Vᵀ Σ⁻¹
    shaped = k * np.sum(FS * V, axis=1) - np.sum((solved @ V.T) ** 2, axis=0)
    gradient = np.r_[κ * np.sum(left), c * np.sum(λ * left), shaped]
    v = np.array([c, *g])
    fun += float(np.sum(held * (x[1:] + usual / v)))
    gradient[1:] += held * (1.0 - usual / v)
    return float(fun), gradient
