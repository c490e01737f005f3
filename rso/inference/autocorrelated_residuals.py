"""What the best fit shows of errors that neither repeats nor the study do: their size, and whether they go together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag, null_space

from rso.core.distributions import chi2_cdf, student
from rso.data import autocorrelation
from rso.inference.likelihood import Data, Misfit, split_common_errors

# chance of errors of the stated size to leave so little: then it is not they that go together
MIN_CHANCE_OF_SMALL_RESIDUALS = 0.001
UNKNOWN_ERROR_SHARE = 0.01  # of the largest value: a reading's error, where no reading is left over to tell it
TRIED_VARIANCES = np.geomspace(1e-12, 1.0, 241)  # variances that are tried, over the square of the largest value


def with_autocorrelation(misfit: Misfit, x: np.ndarray) -> Misfit:
    """The misfit with sizes (:func:`with_estimated_error`), and autocorrelated where the residuals at x (d,) of a curve
    show it and its errors were white by default.

        C_ij → C_ij + w_i w_j ρ^|i−j|   (i ≠ j)

    w is what counts as white, ρ the correlation of neighbours in the whitened residuals, in order of depth.  A model
    that is wrong leaves residuals that go together, too: the size of the errors is not changed here, so that a misfit
    beyond them stays one.  n values hold n (1 − ρ²)/(1 + ρ²) degrees of freedom (Bartlett, J. R. Stat. Soc. 98 (1935)
    536); where χ² is too small for these, what goes together is not the errors.
    """
    misfit = with_estimated_error(misfit, x)
    left = misfit.model.predict(x[None])[0] - np.concatenate([d.value for d in misfit.data])
    orders = [np.argsort(d.depth, kind="stable") for d in misfit.data]
    at = np.cumsum([len(d.value) for d in misfit.data])[:-1]
    # A triangular factor whitens each reading by those before it: these are the shallower ones.
    r = replace(misfit, data=tuple(d.rows(o) for d, o in zip(misfit.data, orders, strict=True))).white(
        np.concatenate([e[o] for e, o in zip(np.split(left, at), orders, strict=True)])
    )
    found = zip(misfit.data, np.split(r, at), orders, strict=True)
    return replace(misfit, data=tuple(_remembering(*each) for each in found))


def with_estimated_error(misfit: Misfit, x: np.ndarray) -> Misfit:
    """The misfit with errors of readings that nobody stated and the readings do not show, of a size by what is left.

        C → C + t² τ² Y²,    max_τ −½ Σ_j [ln(τ² + λ_j) + z_j²/(τ² + λ_j)]

    Y is the largest value of each such curve, z its residuals at x (d,) over that without what the parameters can do
    (restricted likelihood; Patterson & Thompson, Biometrika 58 (1971) 545), in the basis in which all other errors have
    the variances λ.  t is Student's factor for Σ (τ²/(τ² + λ_j))² degrees of freedom; where none is left, τ is
    `UNKNOWN_ERROR_SHARE`.
    """
    new = [d.white is not None and not d.white.any() and d.sized is None for d in misfit.data]
    if not any(new) or misfit.weighting != "noise":
        return misfit
    rows = np.concatenate([np.full(len(d.value), n) for d, n in zip(misfit.data, new, strict=True)])
    each = [float(np.abs(d.value).max()) or 1.0 for d in misfit.data]
    Y = np.concatenate([np.full(len(d.value), v) for d, v in zip(misfit.data, each, strict=True)])[rows]
    J = misfit.model.jacobian(x)[rows] / Y[:, None]
    r = (misfit.model.predict(x[None])[0] - np.concatenate([d.value for d in misfit.data]))[rows] / Y
    Q = null_space(J.T, rcond=1e-8) if J.any() else np.eye(len(r))
    τ2, freedom = _size(Q.T @ r, Q.T @ (_whole(misfit.data)[np.ix_(rows, rows)] / np.outer(Y, Y)) @ Q)
    found = []
    for d, n, largest in zip(misfit.data, new, each, strict=True):
        if n:
            size = np.full(len(d.value), student(freedom) * np.sqrt(τ2) * largest)
            d = replace(d.plus(np.diag(size**2)), white=size, sized=freedom)
        found.append(d)
    return replace(misfit, data=tuple(found))


def _size(z: np.ndarray, C: np.ndarray) -> tuple[float, float]:
    """τ² and its degrees of freedom from residuals z (m,) that have errors C (m, m) already."""
    if not len(z):
        return UNKNOWN_ERROR_SHARE**2, 2.0
    λ, V = np.linalg.eigh(C)
    all_ = TRIED_VARIANCES[:, None] + np.maximum(λ, 0.0)
    τ2 = float(TRIED_VARIANCES[np.argmin(np.sum(np.log(all_) + (V.T @ z) ** 2 / all_, axis=1))])
    return τ2, max(float(np.sum((τ2 / (τ2 + np.maximum(λ, 0.0))) ** 2)), 1.0)


def _whole(data: Sequence[Data]) -> np.ndarray:
    """Covariance (n, n) of all curves with what they share."""
    alone, V = split_common_errors(data)
    return np.asarray(block_diag(*(d.covariance for d in alone)) + V @ V.T)


def independent(ρ: float) -> float:
    """Degrees of freedom of a value whose neighbours have the correlation ρ: (1 − ρ²)/(1 + ρ²)."""
    return (1 - ρ**2) / (1 + ρ**2)


def _remembering(data: Data, r: np.ndarray, order: np.ndarray) -> Data:
    """The curve with memory where whitened residuals r (n,), in `order` of depth, show it."""
    if data.white is None or data.memory:
        return data
    ρ = autocorrelation(r[:, None])
    each = independent(ρ)
    if ρ == 0.0 or chi2_cdf(each * float(r @ r), each * len(r)) < MIN_CHANCE_OF_SMALL_RESIDUALS:
        return data
    place = np.argsort(order)
    along = ρ ** np.abs(np.subtract.outer(place, place)) - np.eye(len(r))
    return replace(data.plus(along * np.outer(data.white, data.white)), memory=ρ)
