"""Ogden: powers of the principal stretches, with stress and tangent in principal directions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from fem_backend.laws.law import Isotropic, cauchy_green


@dataclass(frozen=True)
class Ogden(Isotropic):
    """W = Σᵢ (2μᵢ/αᵢ²)(λ̄₁^αᵢ + λ̄₂^αᵢ + λ̄₃^αᵢ − 3) + (1/D₁)(J − 1)², λ̄ = J^(-1/3) λ, μᵢ = shareᵢ μ, i ≤ 3.

    μ in MPa, D₁ in 1/MPa, α and share without unit, Σ share = 1, so that μ = Σ μᵢ is the initial shear modulus.
    In the other common convention, W = Σ (mᵢ/αᵢ)(…), mᵢ = 2μᵢ/αᵢ and μ = ½ Σ mᵢαᵢ.  α = (2,) is neo-Hookean,
    α = (2, −2) is Mooney–Rivlin with C₀₁ = share₂ μ/2, α → 0 is Hencky's W = μ Σ ln²λ̄.  Assumes isotropy and no
    rate dependence.  Validity: stretches of elastomers to about 7 with three terms; every share > 0 makes the law
    stable, whatever the signs of α.
    Raises ValueError for more than three terms, lengths that differ or shares that do not sum to 1.
    Source: Ogden 1972; Holzapfel 2000, eq. 6.119 in isochoric stretches.
    """

    alpha: tuple[float, ...] = (2.0,)
    share: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        if not 1 <= len(self.alpha) <= 3 or len(self.share) != len(self.alpha):
            raise ValueError(f"alpha = {self.alpha}, share = {self.share}: one to three terms, one share for each")
        if not math.isclose(math.fsum(self.share), 1.0, rel_tol=0.0, abs_tol=1e-9):
            raise ValueError(f"share = {self.share}: the shares of mu must sum to 1")

    @property
    def terms(self) -> tuple[np.ndarray, np.ndarray]:
        """μᵢ (MPa) and αᵢ, (N,)."""
        return self.mu * np.array(self.share, dtype=float), np.array(self.alpha, dtype=float)

    def isochoric(self, F: np.ndarray, J: np.ndarray, tangent: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """W, S and ℂ of the isochoric part at F (m, q, 3, 3): (m, q), (m, q, 6), (m, q, 6, 6); MPa."""
        return _principal(F, J, *self.terms, tangent)


@numba.njit(cache=True)
def _jacobi(a, v):  # type: ignore[no-untyped-def]
    """Diagonalise a symmetric a (3, 3) in place by cyclic Jacobi rotations; columns of v become its directions.

    The rotations are orthogonal to round-off whatever the eigenvalues, so that equal ones need no special treatment
    (Golub & Van Loan 2013, alg. 8.5.2).
    """
    for i in range(3):
        for j in range(3):
            v[i, j] = 1.0 if i == j else 0.0
    for _ in range(12):
        off = a[0, 1] * a[0, 1] + a[0, 2] * a[0, 2] + a[1, 2] * a[1, 2]
        if not off > 1e-34 * (a[0, 0] * a[0, 0] + a[1, 1] * a[1, 1] + a[2, 2] * a[2, 2]):
            break
        for p in range(2):
            for r in range(p + 1, 3):
                if a[p, r] == 0.0:
                    continue
                theta = 0.5 * (a[r, r] - a[p, p]) / a[p, r]
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                k = 3 - p - r
                a[p, p] -= t * a[p, r]
                a[r, r] += t * a[p, r]
                a[p, r] = a[r, p] = 0.0
                x, y = a[p, k], a[r, k]
                a[p, k] = a[k, p] = c * x - s * y
                a[r, k] = a[k, r] = s * x + c * y
                for i in range(3):
                    x, y = v[i, p], v[i, r]
                    v[i, p] = c * x - s * y
                    v[i, r] = s * x + c * y


@numba.njit(cache=True)
def _quotients(y):  # type: ignore[no-untyped-def]
    """(eʸ − 1)/y and (eʸ − 1 − y)/y² without loss of digits near y = 0."""
    if abs(y) < 1e-2:
        second = 0.5 + y * (1 / 6 + y * (1 / 24 + y * (1 / 120 + y * (1 / 720 + y / 5040))))
        return 1.0 + y * second, second
    first = math.expm1(y) / y
    return first, (first - 1.0) / y


@numba.njit(cache=True)
def _principal(F, jac, mu, alpha, tangent):  # type: ignore[no-untyped-def]
    """S = Σ Sₐ Nₐ⊗Nₐ and ℂ (Holzapfel 2000, eq. 6.180), with x = λ², e = ln λ̄ and

    Sₐ = βₐ/xₐ, βₐ = fₐ − f̄, f(λ̄) = Σᵢ (2μᵢ/αᵢ)(λ̄^αᵢ − 1), f̄ the mean over a, W = Σₐ Σᵢ (2μᵢ/αᵢ²)(λ̄ₐ^αᵢ − 1 − αᵢ eₐ),
    ∂βₐ/∂ln λ_b = δₐ_b kₐ − (kₐ + k_b)/3 + k̄/3, k = Σᵢ 2μᵢ λ̄^αᵢ.

    The coefficient of the shears is rewritten without the difference of two stresses,
    (S_b − Sₐ)/(x_b − xₐ) = [(f_b − fₐ)/(x_b − xₐ) − Sₐ]/x_b, and the quotient of f through expm1 and log1p, so that it
    is accurate to round-off for equal, nearly equal and different stretches alike.
    """
    m, n = F.shape[0], F.shape[1]
    W, S = np.empty((m, n)), np.empty((m, n, 6))
    C4 = np.empty((m, n, 6, 6) if tangent else (1, 1, 6, 6))
    row, col = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])
    c, ci = np.empty(6), np.empty(6)
    a, v, d = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    x, e, f, stiff, s = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    N, P = np.empty((3, 6)), np.empty((3, 6))
    for p in range(m):
        for q in range(n):
            J = jac[p, q]
            cauchy_green(F[p, q], J, c, ci)
            for k in range(6):
                a[row[k], col[k]] = c[k]
                a[col[k], row[k]] = c[k]
            _jacobi(a, v)
            # Σ ln λ̄ = 0 exactly, which a log of J alone would miss by round-off
            mean = (math.log(a[0, 0]) + math.log(a[1, 1]) + math.log(a[2, 2])) / 6.0
            W[p, q] = 0.0
            for i in range(3):
                x[i] = a[i, i]
                e[i] = 0.5 * math.log(x[i]) - mean
                f[i], stiff[i] = 0.0, 0.0
                for t in range(len(mu)):
                    y = alpha[t] * e[i]
                    first, second = _quotients(y)
                    f[i] += 2.0 * mu[t] * e[i] * first
                    stiff[i] += 2.0 * mu[t] * (1.0 + y * first)
                    W[p, q] += 2.0 * mu[t] * e[i] * e[i] * second
            mf, mk = (f[0] + f[1] + f[2]) / 3.0, (stiff[0] + stiff[1] + stiff[2]) / 3.0
            for i in range(3):
                s[i] = (f[i] - mf) / x[i]
                for k in range(6):
                    N[i, k] = v[row[k], i] * v[col[k], i]
            for k in range(6):
                S[p, q, k] = s[0] * N[0, k] + s[1] * N[1, k] + s[2] * N[2, k]
            if not tangent:
                continue
            for i in range(3):
                for j in range(3):
                    d[i, j] = (mk / 3.0 - (stiff[i] + stiff[j]) / 3.0) / (x[i] * x[j])
                d[i, i] += (stiff[i] / x[i] - 2.0 * s[i]) / x[i]
            for i in range(3):  # the shear in the plane of the other two directions
                j, k = (i + 1) % 3, (i + 2) % 3
                part = (x[k] - x[j]) / x[j]
                log = math.log1p(part)
                ratio, quotient = 1.0 if part == 0.0 else log / part, 0.0
                for t in range(len(mu)):
                    first, _ = _quotients(0.5 * alpha[t] * log)
                    quotient += mu[t] * math.exp(alpha[t] * e[j]) / x[j] * ratio * first
                g = (quotient - s[j]) / x[k]
                for l in range(6):
                    P[i, l] = v[row[l], j] * v[col[l], k] + v[row[l], k] * v[col[l], j]
                f[i] = g
            for k in range(6):
                for l in range(k, 6):
                    value = 0.0
                    for i in range(3):
                        value += f[i] * P[i, k] * P[i, l]
                        for j in range(3):
                            value += d[i, j] * N[i, k] * N[j, l]
                    C4[p, q, k, l] = value
                    C4[p, q, l, k] = value
    return W, S, C4
