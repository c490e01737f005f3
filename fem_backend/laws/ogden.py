"""Ogden: powers of the principal stretches, with stress and tangent in principal directions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import field_validator

from fem_backend import members
from fem_backend.compiled import compiled
from fem_backend.kinematics.voigt import VOIGT_COLUMN, VOIGT_ROW, cauchy_green, fill_tensor
from fem_backend.laws import law
from fem_backend.laws.law import LAWS, Isotropic, pairs
from rso.contract import knob


@LAWS.register
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

    class Table(law.LawTable):
        """{ law = "ogden", prony = [[g, tau in s], …] }"""

        law: Literal["ogden"] = "ogden"
        """See :class:`Ogden`."""
        ogden: tuple[tuple[float, float], ...] = ()
        """Further terms (alpha, share of mu), at most two; the first term has the knob alpha."""

        @field_validator("ogden", mode="before")
        @classmethod
        def _terms(cls, value: Any) -> tuple[tuple[float, float], ...]:
            """At most two pairs of an exponent that is not 0 and a share; together below 1."""
            terms = pairs("[alpha, share of mu]", value)
            if len(terms) > 2:
                raise members.refused(": at most two further terms (N <= 3)")
            if any(a == 0 for a, _ in terms) or sum(s for _, s in terms) >= 1:
                shown = list(map(list, terms))
                raise members.refused(": exponents must not be 0 and the shares must sum to less than 1", value=shown)
            return terms

    @dataclass(frozen=True)
    class Knobs:
        """Its own constants."""

        alpha: float = knob(
            "Ogden exponent (one term)",
            "1",
            -30.0,
            30.0,
            neutral=2.0,
            typical=5.0,
            plausible=(0.8, 12.0),
            cause="strain stiffening",
            label="stiffening (Ogden)",
        )

    principal: ClassVar[bool] = True
    own_at_neutral: ClassVar[bool] = True  # its exponent is one like any other

    name: ClassVar[str] = "ogden"
    rung: ClassVar[int] = 3
    level: ClassVar[Mapping[str, Any]] = {
        "name": "ogden",
        "title": "Ogden",
        "description": "one term",
        "open": {"alpha": (0.8, 12.0)},
        "extends": "neo_hooke",
    }

    alpha: tuple[float, ...] = (2.0,)
    share: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        if not 1 <= len(self.alpha) <= 3 or len(self.share) != len(self.alpha):
            raise ValueError(f"alpha = {self.alpha}, share = {self.share}: one to three terms, one share for each")
        if not math.isclose(math.fsum(self.share), 1.0, rel_tol=0.0, abs_tol=1e-9):
            raise ValueError(f"share = {self.share}: the shares of mu must sum to 1")

    @classmethod
    def of(cls, knobs: Any, terms: tuple[tuple[float, float], ...] = ()) -> Ogden:
        """The knob's exponent first, with the share that further terms leave."""
        share = tuple(s for _, s in terms)
        return cls(knobs.mu, knobs.D1, (knobs.alpha, *(a for a, _ in terms)), (1.0 - sum(share), *share))

    @classmethod
    def used(cls, knobs: Any, terms: tuple[tuple[float, float], ...] = ()) -> bool:
        """Whether the exponent is off 2 or there are further terms."""
        return knobs.alpha != 2.0 or bool(terms)

    def hessian(self, e: np.ndarray) -> np.ndarray:
        """Σᵢ 2μᵢ exp(αᵢ e) on the diagonal."""
        mu, alpha = self.terms
        return (2.0 * mu * np.exp(e[..., None] * alpha)).sum(-1)[..., None] * np.eye(3)

    @property
    def powers_of_stretch(self) -> tuple[tuple[float, float], ...]:
        """Its terms (MPa, 1)."""
        return tuple((float(m), float(a)) for m, a in zip(*self.terms, strict=True))

    @property
    def terms(self) -> tuple[np.ndarray, np.ndarray]:
        """μᵢ (MPa) and αᵢ, (N,)."""
        return self.mu * np.array(self.share, dtype=float), np.array(self.alpha, dtype=float)

    def isochoric(self, F: np.ndarray, J: np.ndarray, tangent: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """W, S and ℂ of the isochoric part at F (m, q, 3, 3): (m, q), (m, q, 6), (m, q, 6, 6); MPa."""
        return _principal(F, J, *self.terms, tangent)


@compiled()
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


@compiled()
def _quotients(y):  # type: ignore[no-untyped-def]
    """(eʸ − 1)/y and (eʸ − 1 − y)/y² without loss of digits near y = 0."""
    if abs(y) < 1e-2:
        second = 0.5 + y * (1 / 6 + y * (1 / 24 + y * (1 / 120 + y * (1 / 720 + y / 5040))))
        return 1.0 + y * second, second
    first = math.expm1(y) / y
    return first, (first - 1.0) / y


@compiled()
def _stretches(c, x, e, v, a):  # type: ignore[no-untyped-def]
    """Fill x = λ² (3,), e = ln λ̄ (3,) and the directions, columns of v, of C given as c (6,); `a` (3, 3) is room."""
    fill_tensor(c, a)
    _jacobi(a, v)
    # Σ ln λ̄ = 0 exactly, which a log of J alone would miss by round-off
    mean = (math.log(a[0, 0]) + math.log(a[1, 1]) + math.log(a[2, 2])) / 6.0
    for i in range(3):
        x[i] = a[i, i]
        e[i] = 0.5 * math.log(x[i]) - mean


@compiled()
def _terms(mu, alpha, x, e, s, k):  # type: ignore[no-untyped-def]
    """Energy; fill the principal stresses s (3,) and k (3,)."""
    W = 0.0
    for i in range(3):
        s[i], k[i] = 0.0, 0.0
        for t in range(len(mu)):
            y = alpha[t] * e[i]
            first, second = _quotients(y)
            s[i] += 2.0 * mu[t] * e[i] * first
            k[i] += 2.0 * mu[t] * (1.0 + y * first)
            W += 2.0 * mu[t] * e[i] * e[i] * second
    mean = (s[0] + s[1] + s[2]) / 3.0
    for i in range(3):
        s[i] = (s[i] - mean) / x[i]
    return W


@compiled()
def _normal(x, s, k, d):  # type: ignore[no-untyped-def]
    """Fill d (3, 3) = 2 ∂Sₐ/∂x_b, the tangent between principal directions."""
    mean = (k[0] + k[1] + k[2]) / 3.0
    for i in range(3):
        for j in range(3):
            d[i, j] = (mean / 3.0 - (k[i] + k[j]) / 3.0) / (x[i] * x[j])
        d[i, i] += (k[i] / x[i] - 2.0 * s[i]) / x[i]


@compiled()
def _shear(mu, alpha, x, e, s, g):  # type: ignore[no-untyped-def]
    """Fill g (3,) = (S_b − Sₐ)/(x_b − xₐ) of the plane across each direction, the tangent of its shear."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        part = (x[k] - x[j]) / x[j]
        log = math.log1p(part)
        ratio, quotient = 1.0 if part == 0.0 else log / part, 0.0
        for t in range(len(mu)):
            first, _ = _quotients(0.5 * alpha[t] * log)
            quotient += mu[t] * math.exp(alpha[t] * e[j]) / x[j] * ratio * first
        g[i] = (quotient - s[j]) / x[k]


@compiled()
def _dyads(v, N, P):  # type: ignore[no-untyped-def]
    """Fill Nₐ⊗Nₐ and N_b⊗N_c + N_c⊗N_b across it, (3, 6), from the columns of v."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for l in range(6):
            N[i, l] = v[VOIGT_ROW[l], i] * v[VOIGT_COLUMN[l], i]
            P[i, l] = v[VOIGT_ROW[l], j] * v[VOIGT_COLUMN[l], k] + v[VOIGT_ROW[l], k] * v[VOIGT_COLUMN[l], j]


@compiled()
def _tangent(d, g, N, P, C):  # type: ignore[no-untyped-def]
    """Fill ℂ (6, 6) = Σ dₐ_b Nₐ⊗Nₐ⊗N_b⊗N_b + Σ gₐ Pₐ⊗Pₐ."""
    for k in range(6):
        for l in range(k, 6):
            value = 0.0
            for i in range(3):
                value += g[i] * P[i, k] * P[i, l]
                for j in range(3):
                    value += d[i, j] * N[i, k] * N[j, l]
            C[k, l] = value
            C[l, k] = value


@compiled()
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
    c, ci = np.empty(6), np.empty(6)
    a, v, d = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    x, e, s, stiff, g = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    N, P = np.empty((3, 6)), np.empty((3, 6))
    for p in range(m):
        for q in range(n):
            cauchy_green(F[p, q], jac[p, q], c, ci)
            _stretches(c, x, e, v, a)
            W[p, q] = _terms(mu, alpha, x, e, s, stiff)
            _dyads(v, N, P)
            for k in range(6):
                S[p, q, k] = s[0] * N[0, k] + s[1] * N[1, k] + s[2] * N[2, k]
            if tangent:
                _normal(x, s, stiff, d)
                _shear(mu, alpha, x, e, s, g)
                _tangent(d, g, N, P, C4[p, q])
    return W, S, C4
