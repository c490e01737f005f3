"""Polynomial response surfaces: Legendre terms, all of a degree or selected ones, least squares by QR."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from rso.core.polynomial_degree import MAX_POLYNOMIAL_DEGREE
from rso.emulation.common import (
    checked_samples,
    from_log,
    legendre,
    monomial_exponents,
    outside,
    thin_qr,
    triangular,
    within_ranges,
)
from rso.emulation.scores import Scores, score

MAX_BATCH_VALUES = 2_000_000  # that a batch holds at a time: 16 MB


@dataclass(frozen=True, eq=False)
class Polynomial:
    """y = Σ_k c_k Π_j P_{e_kj}(2 x_j − 1), or its exponential where `log`; sd from ordinary least squares.

    `exponents` (terms, d) are the e_kj; `R` (terms, terms) is the triangular factor of the design matrix and `s` the
    residual standard deviation (of ln y where `log`): var(x) = s² (1 + |a(x) R⁻¹|²), the variance of a new value at x.
    Selected terms leave too small an s: `inflate` >= 1 multiplies the standard deviation of y.
    """

    exponents: np.ndarray
    coefficients: np.ndarray
    R: np.ndarray
    s: float
    log: bool = False
    cv: Scores | None = None
    story: str = ""
    inflate: float = 1.0

    kind = "polynomial"

    @property
    def d(self) -> int:
        """Number of parameters."""
        return self.exponents.shape[1]

    @property
    def degree(self) -> int:
        """Total degree of the highest term."""
        return int(self.exponents.sum(axis=1).max())

    @property
    def full(self) -> bool:
        """Whether every term up to the degree is there."""
        return len(self.exponents) == len(monomial_exponents(self.d, self.degree))

    def predict(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n,) in the units of y at X (n, d); ValueError outside the unit cube."""
        m, sd = self._moments(legendre(within_ranges(X, self.d), self.exponents))
        return m, self.inflate * sd

    def _moments(self, A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n,) of least squares from the basis A (n, terms)."""
        m = A @ self.coefficients
        h = np.sum(triangular(self.R, A.T, upper=True) ** 2, axis=0)
        sd = self.s * np.sqrt(1 + h)
        return from_log(m, sd) if self.log else (m, sd)

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Mean alone (n,), faster."""
        A = legendre(within_ranges(X, self.d), self.exponents)
        return self._moments(A)[0] if self.log else A @ self.coefficients

    def outside(self, X: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points where this surrogate refuses to answer."""
        return outside(X, self.d)

    def to_dict(self) -> dict[str, Any]:
        """Plain data and arrays."""
        return {
            "kind": "polynomial",
            "exponents": self.exponents,
            "coefficients": self.coefficients,
            "R": self.R,
            "s": self.s,
            "log": self.log,
            "cv": None if self.cv is None else vars(self.cv).copy(),
            "story": self.story,
            "inflate": self.inflate,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Polynomial:
        """Inverse of :meth:`to_dict`; lists are as good as arrays."""
        return cls(
            np.array(data["exponents"], int),
            np.array(data["coefficients"], float),
            np.array(data["R"], float),
            data["s"],
            data["log"],
            None if data["cv"] is None else Scores(**data["cv"]),
            data["story"],
            data.get("inflate", 1.0),
        )


@dataclass(frozen=True, eq=False)
class PolynomialBatch:
    """Polynomials of one cube, to be asked for their means together."""

    models: tuple[Polynomial, ...]

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Means (n, m) at X (n, d) in the unit cube: those of :meth:`Polynomial.mean` but for round-off."""
        exponents, C, logs, W, s = self._together
        m = (A := legendre(X, exponents)) @ C
        if len(logs):
            rows = max(1, MAX_BATCH_VALUES // W.shape[1])
            for a in range(0, len(X), rows):
                at = slice(a, a + rows)
                h = np.sum((A[at] @ W).reshape(-1, len(s), W.shape[1] // len(s)) ** 2, axis=2)
                m[at, logs] = from_log(m[at, logs], s * np.sqrt(1.0 + h))[0]
        return m

    @cached_property
    def _together(self) -> tuple[np.ndarray, ...]:
        """All terms (p, d), coefficients (p, m), places of logarithms, their R⁻¹ side by side, and their s."""
        known: dict[tuple[int, ...], int] = {}
        rows = [
            np.array([known.setdefault(tuple(e), len(known)) for e in model.exponents.tolist()])
            for model in self.models
        ]
        C = np.zeros((len(known), len(self.models)))
        for k, (model, at) in enumerate(zip(self.models, rows, strict=True)):
            C[at, k] = model.coefficients
        logs = np.array([k for k, model in enumerate(self.models) if model.log], int)
        widest = max((len(rows[k]) for k in logs), default=0)
        W = np.zeros((len(known), len(logs), widest))
        for j, k in enumerate(logs):
            R = self.models[k].R
            W[rows[k], j, : len(R)] = triangular(R, np.eye(len(R)), upper=True).T
        s = np.array([self.models[k].s for k in logs])
        return np.array(list(known), int), C, logs, W.reshape(len(known), -1), s


def fit_polynomial(X: np.ndarray, y: np.ndarray, *, degree: int | None = None, log: bool = False) -> Polynomial:
    """Least-squares polynomial through X (n, d) in the unit cube and y (n,).

    With `degree` it has every term of that degree. Without, the smallest leave-one-out error in y decides among
    all terms of degree 1 to 4 that the points determine and selections of terms (see :func:`select`), which may also
    come from degrees with more terms than points. `cv` holds the leave-one-out scores, optimistic after a selection.

    Raises
    ------
    ValueError
        if a stated degree has as many terms as there are points or more (nothing would be left to judge the
        fit), or if the points do not determine it (a two-level design and a square, say).
    """
    X, y = checked_samples(X, y, log)
    d = X.shape[1]
    if degree is not None:
        if not 1 <= degree <= MAX_POLYNOMIAL_DEGREE:
            raise ValueError(f"polynomial: degree must be 1 to {MAX_POLYNOMIAL_DEGREE}, got {degree}")
        return _fit(X, y, monomial_exponents(d, degree), log)[0]
    fits, refusals = [], []
    for candidate in range(1, MAX_POLYNOMIAL_DEGREE + 1):
        try:
            fits.append(_fit(X, y, monomial_exponents(d, candidate), log))
        except ValueError as refusal:
            refusals.append(str(refusal))
    if not fits:
        raise ValueError(refusals[0])
    for candidate in range(2, MAX_POLYNOMIAL_DEGREE + 1):
        chosen = select(X, np.log(y) if log else y, candidate)
        if 1 < len(chosen) < len(monomial_exponents(d, candidate)):
            fits.append(_fit(X, y, chosen, log))
    return min(fits, key=lambda pair: pair[1])[0]


def select(X: np.ndarray, t: np.ndarray, degree: int) -> np.ndarray:
    """Exponents (terms, d) of the terms up to `degree` that are worth having, constant first.

    Orthogonal forward selection: the term that lowers the residual most enters next; the number of terms is that of
    the smallest leave-one-out error times :func:`_penalty` (Blatman & Sudret, J. Comput. Phys. 230 (2011) 2345).
    """
    n, d = X.shape
    exponents = monomial_exponents(d, degree)
    B = legendre(X, exponents)
    size = np.linalg.norm(B, axis=0)
    q = B[:, 0] / size[0]
    h, e, order = q**2, t - q * (q @ t), [0]
    Q = np.empty((min(n, len(exponents)), n))
    Q[0] = q
    B = B - np.outer(q, q @ B)
    best, errors = 1, [_penalised(e, h, 1)]
    while len(order) < min(n - 2, len(exponents)):
        norm = np.sqrt(np.einsum("ij,ij->j", B, B))
        usable = norm > 1e-8 * size
        usable[order] = False
        if not usable.any():
            break
        gain = np.where(usable, np.abs(e @ B) / np.where(usable, norm, 1.0), -1.0)
        k = int(gain.argmax())
        q = B[:, k] / norm[k]
        there = Q[: len(order)]
        q -= (there @ q) @ there  # once more: rounding has crept into B
        q /= np.sqrt(q @ q)
        Q[len(order)] = q
        order.append(k)
        h, e, B = h + q**2, e - q * (q @ e), B - np.outer(q, q @ B)
        errors.append(_penalised(e, h, len(order)))
        # A clearly better fit only: equal errors are rounding and the shorter polynomial is the better one.
        if errors[-1] < 0.999 * errors[best - 1] and errors[-1] > 0:
            best = len(order)
        if np.abs(e).max() <= 1e-13 * np.abs(t).max():
            break
    return exponents[sorted(order[:best])]


def _penalised(e: np.ndarray, h: np.ndarray, terms: int) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        left_out = np.where(h < 1 - 1e-10, e / (1 - h), np.inf)
    return float(np.sqrt(np.mean(left_out**2))) * _penalty(len(e), terms)


def _penalty(n: int, terms: int) -> float:
    """√((1 + p/n) n/(n − p)): the correction of Chapelle et al. for an orthonormal basis of p terms."""
    return float(np.sqrt((1 + terms / n) * n / (n - terms))) if terms < n else np.inf


def _fit(X: np.ndarray, y: np.ndarray, exponents: np.ndarray, log: bool) -> tuple[Polynomial, float]:
    """The fit of these terms and its leave-one-out error in y with the penalty for their number."""
    n, d = X.shape
    terms, degree = len(exponents), int(exponents.sum(axis=1).max())
    if terms >= n:
        raise ValueError(
            f"polynomial of degree {degree} in {d} parameters has {terms} terms: needs more than {n} points"
        )
    A, t = legendre(X, exponents), np.log(y) if log else y
    Q, R = thin_qr(A)
    diagonal = np.abs(np.diag(R))
    if diagonal.min() < 1e-9 * diagonal.max():
        raise ValueError(f"polynomial of degree {degree}: these {n} points do not determine its {terms} terms")
    c = solve_triangular(R, Q.T @ t)
    e = t - A @ c
    s = float(np.sqrt(e @ e / (n - terms)))
    # Leave-one-out without refitting: e_i / (1 − h_ii), h = diag(QQᵀ) (Allen 1974, PRESS). Where a point alone
    # fixes a term, h_ii = 1 and leaving it out is no fit: such a degree scores an infinite error.
    h = np.sum(Q**2, axis=1)
    left_out = t - e / np.maximum(1 - h, 1e-300) if h.max() < 1 - 1e-10 else np.full(n, np.inf)
    with np.errstate(over="ignore", invalid="ignore"):
        cv = score(np.exp(left_out + s**2 / 2) if log else left_out, y)
    return Polynomial(exponents, c, R, s, log, cv), cv.rmse * _penalty(n, terms)
