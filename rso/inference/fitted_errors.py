"""The curve that a fit has really drawn through its readings: the model's, moved by the errors of the test as a whole.

    y = f(θ) + S a + ε,      a ~ N(0, 1),      ε ~ N(0, C₀),      C = C₀ + S Sᵀ

The columns of S are errors that move every reading of a test alike: contact point, gain, calibration.  A fit by C has
estimated θ and a together; f(θ̂) alone runs beside the readings where it has moved them.
Source: Robinson, Statist. Sci. 6 (1991) 15, eqs. 1.1 to 1.3 (best linear unbiased prediction).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag, cholesky, solve_triangular

from rso.inference.identifiability import Determination
from rso.inference.likelihood import MIN_ERROR_SHARE

CONTACT_ERROR, GAIN_ERROR = "contact", "gain"
_ERROR_OF_ONE_TEST = re.compile(r"^(?:.*: )?(.*?)(?: of repeat \d+)?$")  # "test: gain of repeat 2" → gain


@dataclass(frozen=True, eq=False)
class FittedCurve:
    """One measured curve as the fit sees it, n readings: the `fitted` value (n,) and what it is made of.

    fitted = predicted + Σ moved[kind].  `sd` (n,) is what the fit leaves open of the fitted curve, `reading_sd` (n,)
    that of a reading about it.  `contact` mm > 0: the specimen was deeper than recorded; `gain`: relative.  Both have
    their standard deviation before the fit, `expected`, by kind.  `white` (n,) are the residuals of the fit, each
    against those before it, in standard deviations: of a right model, white noise of size 1.  `inputs` are the errors
    of stated inputs that the fit has found, in standard uncertainties: positive ones are more than stated.
    """

    predicted: np.ndarray
    moved: Mapping[str, np.ndarray]
    sd: np.ndarray
    reading_sd: np.ndarray
    contact: float | None
    gain: float | None
    expected: Mapping[str, float]
    white: np.ndarray
    inputs: Mapping[str, float] = field(default_factory=dict)

    @property
    def fitted(self) -> np.ndarray:
        """The curve (n,) that was fitted."""
        return self.predicted + sum(self.moved.values(), np.zeros_like(self.predicted))


def curves_as_fitted(d: Determination) -> tuple[FittedCurve, ...]:
    """The fitted curve of each set of data, all of them estimated together; none where the weighting knows no errors.

        z = (θ − θ̂, a),   H = [J S],   P = (Hᵀ C₀⁻¹ H + diag(0, 1))⁻¹,   var(H z) = H P Hᵀ

    J (n, d) are the slopes of the curves at θ̂.  Widths grow with the factor by which the errors were widened.
    LinAlgError where the rest of the errors is not positive definite.
    """
    misfit = d.misfit
    if misfit.weighting != "noise":
        return ()
    data, n = misfit.data, misfit.n
    names = list(dict.fromkeys(name for v in data for name in v.shared))
    S = np.array([np.concatenate([v.shared.get(name, np.zeros(len(v.value))) for v in data]) for name in names])
    S = S.reshape(len(names), n).T
    own = [v.covariance - sum((np.outer(s, s) for s in v.shared.values()), np.zeros((len(v.value),) * 2)) for v in data]
    largest = [MIN_ERROR_SHARE * (float(np.abs(v.value).max()) or 1.0) for v in data]
    rest = block_diag(*(C + f**2 * np.eye(len(C)) for C, f in zip(own, largest, strict=True)))
    L = cholesky(0.5 * (rest + rest.T), lower=True)
    y, f = np.concatenate([v.value for v in data]), misfit.model.predict(d.fit.x[None])[0]
    J = misfit.model.jacobian(d.fit.x)
    r, J, columns = (solve_triangular(L, v, lower=True) for v in (y - f, J, S))
    a = np.linalg.solve(np.eye(len(names)) + columns.T @ columns, columns.T @ r)
    spread = L @ _seen(J, columns) * d.wider
    noise = np.diag(rest) * d.wider**2
    white = misfit.white(y - f) / d.wider
    found, start = [], 0
    for v in data:
        rows = slice(start, start + len(v.value))
        start = rows.stop
        moved = _by_kind(names, S[rows] * a)
        size = {k: np.sqrt(np.sum(_columns(names, S[rows], k) ** 2, axis=1)) for k in moved}
        slope = _slope(v.depth, f[rows], v.since)
        shapes = {CONTACT_ERROR: slope, GAIN_ERROR: f[rows]}
        found.append(
            FittedCurve(
                f[rows],
                moved,
                np.sqrt(np.sum(spread[rows] ** 2, axis=1)),
                np.sqrt(np.sum(spread[rows] ** 2, axis=1) + noise[rows]),
                _along(moved.get(CONTACT_ERROR), slope),
                _along(moved.get(GAIN_ERROR), f[rows]),
                {k: abs(_along(size[k], np.abs(shape)) or 0.0) for k, shape in shapes.items() if k in size},
                white[rows],
                {name: float(a[names.index(name)]) for name in v.inputs},
            )
        )
    return tuple(found)


def _seen(J: np.ndarray, S: np.ndarray) -> np.ndarray:
    """A root B (n, k), B Bᵀ = H P Hᵀ in units of the rest of the errors, without directions that change no reading."""
    n, d = J.shape
    q = S.shape[1]
    H = np.block([[J, S], [np.zeros((q, d)), np.eye(q)]])
    H = H / np.maximum(np.linalg.norm(H, axis=0), 1e-300)
    U, s, _ = np.linalg.svd(H, full_matrices=False)
    return np.asarray(U[:n, s > 1e-9 * max(float(s.max(initial=0.0)), 1e-300)])


def _kind(name: str) -> str:
    found = _ERROR_OF_ONE_TEST.match(name)
    return found[1] if found else name


def _columns(names: list[str], S: np.ndarray, kind: str) -> np.ndarray:
    return S[:, [k for k, n in enumerate(names) if _kind(n) == kind]]


def _by_kind(names: list[str], moved: np.ndarray) -> dict[str, np.ndarray]:
    """What errors of each kind move the readings (n,) of one curve by; those that do not reach it are left out."""
    kinds = dict.fromkeys(map(_kind, names))
    sums = {k: _columns(names, moved, k).sum(axis=1) for k in kinds}
    return {k: v for k, v in sums.items() if np.any(v)}


def _slope(depth: np.ndarray, value: np.ndarray, since: np.ndarray | None) -> np.ndarray:
    """Slope (n,) of a curve over depth; none in a hold."""
    out = np.zeros(len(depth))
    there = np.flatnonzero(np.ones(len(depth), bool) if since is None else since == 0.0)
    order = there[np.argsort(depth[there], kind="stable")]
    if len(order) > 1:
        u, where = np.unique(depth[order], return_inverse=True)
        mean = np.bincount(where, value[order]) / np.bincount(where)
        out[order] = np.gradient(mean, u)[where] if len(u) > 1 else 0.0
    return out


def _along(moved: np.ndarray | None, shape: np.ndarray) -> float | None:
    """The factor c of the least squares of `moved` (n,) by c times a shape (n,); None where there is neither."""
    if moved is None or not np.any(shape):
        return None
    return float(moved @ shape / (shape @ shape))
