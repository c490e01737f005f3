"""Polynomial response surfaces: full Legendre bases, least squares by QR, degree by leave-one-out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from rso.surrogates.common import checked, from_log, inside, legendre, outside, powers
from rso.surrogates.scores import Scores, score

HIGHEST = 4


@dataclass(frozen=True, eq=False)
class Polynomial:
    """y = Σ_k c_k Π_j P_{e_kj}(2 x_j − 1), or its exponential where `log`; sd from ordinary least squares.

    `R` (terms, terms) is the triangular factor of the design matrix and `s` the residual standard deviation
    (of ln y where `log`): var(x) = s² (1 + |a(x) R⁻¹|²), the variance of a new value at x.
    """

    d: int
    degree: int
    coefficients: np.ndarray
    R: np.ndarray
    s: float
    log: bool = False
    cv: Scores | None = None
    story: str = ""

    def predict(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n,) in the units of y at X (n, d); ValueError outside the unit cube."""
        A = legendre(inside(X, self.d), powers(self.d, self.degree))
        m = A @ self.coefficients
        h = np.sum(solve_triangular(self.R, A.T, trans="T") ** 2, axis=0)
        sd = self.s * np.sqrt(1 + h)
        return from_log(m, sd) if self.log else (m, sd)

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Mean alone (n,), faster."""
        if self.log:
            return self.predict(X)[0]
        return legendre(inside(X, self.d), powers(self.d, self.degree)) @ self.coefficients

    def outside(self, X: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points where this surrogate refuses to answer."""
        return outside(X, self.d)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data."""
        return {
            "kind": "polynomial",
            "d": self.d,
            "degree": self.degree,
            "coefficients": self.coefficients.tolist(),
            "R": self.R.tolist(),
            "s": self.s,
            "log": self.log,
            "cv": None if self.cv is None else vars(self.cv).copy(),
            "story": self.story,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Polynomial:
        """Inverse of :meth:`to_dict`."""
        return cls(
            data["d"],
            data["degree"],
            np.array(data["coefficients"], float),
            np.array(data["R"], float),
            data["s"],
            data["log"],
            None if data["cv"] is None else Scores(**data["cv"]),
            data["story"],
        )


def fit_polynomial(X: np.ndarray, y: np.ndarray, *, degree: int | None = None, log: bool = False) -> Polynomial:
    """Least-squares polynomial through X (n, d) in the unit cube and y (n,).

    Without `degree` the one of 1..4 with the smallest leave-one-out error in y is taken among those that the
    points determine. `cv` holds the leave-one-out scores.

    Raises
    ------
    ValueError
        if a stated degree has as many terms as there are points or more (nothing would be left to judge the
        fit), or if the points do not determine it (a two-level design and a square, say).
    """
    X, y = checked(X, y, log)
    if degree is not None:
        if not 1 <= degree <= HIGHEST:
            raise ValueError(f"polynomial: degree must be 1 to {HIGHEST}, got {degree}")
        return _fit(X, y, degree, log)
    fits, refusals = [], []
    for candidate in range(1, HIGHEST + 1):
        try:
            fits.append(_fit(X, y, candidate, log))
        except ValueError as refusal:
            refusals.append(str(refusal))
    if not fits:
        raise ValueError(refusals[0])
    return min(fits, key=lambda p: p.cv.rmse)


def _fit(X: np.ndarray, y: np.ndarray, degree: int, log: bool) -> Polynomial:
    n, d = X.shape
    exponents = powers(d, degree)
    terms = len(exponents)
    if terms >= n:
        raise ValueError(
            f"polynomial of degree {degree} in {d} parameters has {terms} terms: needs more than {n} points"
        )
    A, t = legendre(X, exponents), np.log(y) if log else y
    Q, R = np.linalg.qr(A)
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
    with np.errstate(over="ignore"):
        cv = score(np.exp(left_out + s**2 / 2) if log else left_out, y)
    return Polynomial(d, degree, c, R, s, log, cv)
