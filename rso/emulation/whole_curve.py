"""A whole curve as one surrogate: modes of the sampled curves, one surrogate per coefficient, a checked band."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rso.core.curves import Resampling
from rso.emulation.common import from_log, outside
from rso.emulation.model_choice import Surrogate, fit_surrogate, from_dict, refit
from rso.emulation.scores import Scores, score

# at most so many modes; fewer where they leave out less than this share of the curves' size
MAX_MODES, MAX_LEFT_OUT_SHARE = 8, 1e-6
MIN_WEIGHT_RATIO = 1e-3  # of the largest: abscissae with smaller values count no more than this
SD_OF_95_PERCENT = 1.959964  # standard deviations of a normal law that hold 95 %


@dataclass(frozen=True, eq=False)
class WholeCurve:
    """Curve Y(u; x) = w(u) [c(u) + Σ_k a_k(x) φ_k(u)] at m abscissae, or its exponential where `log`.

    `centre` c (m,), `modes` φ (r, m) orthonormal and `truncation` (m,), the standard deviation of what they leave out,
    are those of the scaled curves T = Y/w (or T = ln Y, w = 1); a_k are surrogates of their own. Band:

        sd_T² = inflate² (Σ_k φ_k² sd_k² + truncation²).

    `inflate` >= 1 is what made 95 % of the left-out values lie within 1.96 sd in cross-validation; `covered` is the
    share before. `cv` (m,) are the scores by abscissa.
    """

    at: np.ndarray
    weight: np.ndarray
    centre: np.ndarray
    modes: np.ndarray
    truncation: np.ndarray
    coefficients: tuple[Surrogate, ...]
    log: bool
    inflate: float = 1.0
    covered: float = float("nan")
    cv: tuple[Scores, ...] = ()
    story: str = ""

    kind = "whole_curve"

    @property
    def d(self) -> int:
        """Number of parameters."""
        return self.coefficients[0].d

    def predict(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n, m) in the units of Y at X (n, d); ValueError outside the unit cube."""
        pairs = [a.predict(X) for a in self.coefficients]
        T = self.centre + np.stack([m for m, _ in pairs], axis=1) @ self.modes
        variance = np.stack([s**2 for _, s in pairs], axis=1) @ self.modes**2 + self.truncation**2
        sd = self.inflate * np.sqrt(variance)
        return from_log(T, sd) if self.log else (T * self.weight, sd * self.weight)

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Mean alone (n, m), faster."""
        if self.log:
            return self.predict(X)[0]
        return (self.centre + np.stack([a.mean(X) for a in self.coefficients], axis=1) @ self.modes) * self.weight

    def between(self, X: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n, k) at other abscissae `at` (k,) of a loading curve, by the spline of `core.curves` in √u."""
        mean, sd = self.predict(X)
        sampled = (Resampling(self.at, v.T)(np.asarray(at, float)).T for v in (mean, sd))
        mean, sd = sampled
        return mean, np.abs(sd)

    def outside(self, X: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points where this surrogate refuses to answer."""
        return outside(X, self.d)

    def to_dict(self) -> dict[str, Any]:
        """Plain data and arrays."""
        arrays = {k: getattr(self, k) for k in ("at", "weight", "centre", "modes", "truncation")}
        return {
            "kind": self.kind,
            **arrays,
            "coefficients": [a.to_dict() for a in self.coefficients],
            "log": self.log,
            "inflate": self.inflate,
            "covered": self.covered,
            "cv": [vars(s).copy() for s in self.cv],
            "story": self.story,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> WholeCurve:
        """Inverse of :meth:`to_dict`; lists are as good as arrays."""
        at, weight, centre, modes, left = (
            np.array(data[k], float) for k in ("at", "weight", "centre", "modes", "truncation")
        )
        coefficients = tuple(from_dict(a) for a in data["coefficients"])
        cv = tuple(Scores(**s) for s in data["cv"])
        return cls(
            at,
            weight,
            centre,
            modes,
            left,
            coefficients,
            data["log"],
            data["inflate"],
            data["covered"],
            cv,
            data["story"],
        )


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """One abscissa of a whole curve, used like any surrogate of a scalar."""

    curve: WholeCurve
    point: int

    kind = "whole_curve"

    @property
    def d(self) -> int:
        """Number of parameters."""
        return self.curve.d

    @property
    def log(self) -> bool:
        """Whether logarithms were learnt."""
        return self.curve.log

    @property
    def cv(self) -> Scores:
        """Cross-validation scores here."""
        return self.curve.cv[self.point]

    @property
    def story(self) -> str:
        """The reasons, those of the whole curve."""
        return self.curve.story

    def predict(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and sd (n,)."""
        mean, sd = self.curve.predict(X)
        return mean[:, self.point], sd[:, self.point]

    def mean(self, X: np.ndarray) -> np.ndarray:
        """Mean alone (n,)."""
        return self.curve.mean(X)[:, self.point]

    def outside(self, X: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points where this surrogate refuses to answer."""
        return self.curve.outside(X)


def on_common_grid(travels: Sequence[np.ndarray], values: Sequence[np.ndarray], m: int) -> tuple[np.ndarray, ...]:
    """Grid (m,) evenly spaced in √u, where forces are smooth, to the deepest common travel, and curves (n, m) on it."""
    deepest = min(float(u[-1]) for u in travels)
    grid = deepest * (np.arange(1, m + 1) / m) ** 2
    return grid, np.stack([Resampling(u, y)(grid) for u, y in zip(travels, values, strict=True)])


def fit_curve(
    X: np.ndarray,
    at: np.ndarray,
    Y: np.ndarray,
    *,
    seed: int,
    kind: str = "auto",
    log: bool | None = None,
    noise_sd: np.ndarray | None = None,
    gradients: np.ndarray | None = None,
    unit: str = "",
    names: tuple[str, ...] | None = None,
) -> WholeCurve:
    """Surrogate of the curves Y (n, m) at abscissae `at` (m,) over X (n, d) in the unit cube.

    `kind`, `noise_sd` (n, m), known up to a share, and `gradients` (n, d, m), NaN where unknown, as in
    :func:`rso.emulation.fit_surrogate`; `log` None tries logarithms too where Y > 0, judged by cross-validation.
    The band is checked: every fold is predicted from modes and coefficients learnt without it.

    Raises ValueError for values that are not finite or too few points.
    """
    X, at, Y = (np.asarray(v, float) for v in (X, at, Y))
    if Y.ndim != 2 or Y.shape != (len(X), len(at)) or not np.all(np.isfinite(Y)):
        raise ValueError(f"whole curve: needs finite curves (n, m) at (m,) for X (n, d), got {Y.shape}, {at.shape}")
    tried = []
    for g in (log,) if log is not None else (False, True) if Y.min() > 0 else (False,):
        model = _fit(
            X,
            at,
            Y,
            g,
            lambda a, s, G: fit_surrogate(
                kind, X, a, seed=seed, log=False, noise_sd=s, share=None, gradients=G, names=names
            ),
            noise_sd,
            gradients,
        )
        tried.append(_checked(model, X, Y, noise_sd, gradients, seed))
    model = min(tried, key=lambda m: sum(s.relative_rmse**2 for s in m.cv))
    return replace(model, story=_story(model, unit, len(X)))


def refit_curve(
    model: WholeCurve,
    X: np.ndarray,
    Y: np.ndarray,
    *,
    seed: int,
    noise_sd: np.ndarray | None = None,
    gradients: np.ndarray | None = None,
    unit: str = "",
) -> WholeCurve:
    """The same kind of whole-curve surrogate on other (usually more) curves; modes, coefficients and band again.

    Logarithms are given up where a curve is not positive.
    """
    X, Y = np.asarray(X, float), np.asarray(Y, float)
    if model.log and Y.min() <= 0:
        return fit_curve(X, model.at, Y, seed=seed, log=False, noise_sd=noise_sd, gradients=gradients, unit=unit)
    new = _again(model, X, Y, noise_sd, gradients, seed)
    new = _checked(new, X, Y, noise_sd, gradients, seed)
    return replace(new, story=_story(new, unit, len(X)))


def _scaled(Y: np.ndarray, log: bool) -> tuple[np.ndarray, np.ndarray]:
    if log:
        return np.log(Y), np.ones(Y.shape[1])
    weight = np.sqrt(np.mean(Y**2, axis=0))
    weight = np.maximum(weight, MIN_WEIGHT_RATIO * weight.max())  # what is zero by symmetry is no more than rounding
    weight = np.where(weight > 0, weight, 1.0)
    return Y / weight, weight


def _fit(
    X: np.ndarray,
    at: np.ndarray,
    Y: np.ndarray,
    log: bool,
    learn: Callable[..., Surrogate],
    noise_sd: np.ndarray | None,
    gradients: np.ndarray | None,
    start: WholeCurve | None = None,
) -> WholeCurve:
    """`learn(a, sd, G)` makes the surrogate of one coefficient; with `start` there are as many modes as it has."""
    T, weight = _scaled(Y, log)
    centre = T.mean(axis=0)
    _, S, V = np.linalg.svd(T - centre, full_matrices=False)
    left = np.sqrt(np.maximum(np.cumsum((S**2)[::-1])[::-1], 0.0) / T.size) / max(np.sqrt(np.mean(T**2)), 1e-300)
    # left[k] is what the first k modes leave out.
    enough = [k for k in range(1, len(S) + 1) if k == len(S) or left[k] < MAX_LEFT_OUT_SHARE]
    r = min(enough[0], MAX_MODES, max(1, len(X) - 2))
    modes = V[:r]
    A = (T - centre) @ modes.T
    n = len(X)
    truncation = np.sqrt(np.sum((T - centre - A @ modes) ** 2, axis=0) / max(n - r - 1, 1))
    scale = Y if log else weight
    slopes = None if gradients is None else gradients / (scale[:, None, :] if log else scale)
    coefficients = []
    for k in range(r):
        G = None if slopes is None else slopes @ modes[k]
        # Numerical errors of one run go together along its curve: the sum, not the root of the sum of squares.
        sd = None if noise_sd is None else np.abs(np.asarray(noise_sd) / scale @ modes[k])
        coefficients.append(learn(A[:, k], sd, G) if start is None else learn(k, A[:, k], sd, G))
    return WholeCurve(at, weight, centre, modes, truncation, tuple(coefficients), log)


def _again(
    model: WholeCurve,
    X: np.ndarray,
    Y: np.ndarray,
    noise_sd: np.ndarray | None,
    gradients: np.ndarray | None,
    seed: int,
) -> WholeCurve:
    """Modes again; each coefficient by the kind of surrogate it had, the last one's where there are more now."""

    def learn(k: int, a: np.ndarray, sd: np.ndarray | None, G: np.ndarray | None) -> Surrogate:
        old = model.coefficients[min(k, len(model.coefficients) - 1)]
        return refit(old, X, a, seed=seed, noise_sd=sd, gradients=G)

    return _fit(X, model.at, Y, model.log, learn, noise_sd, gradients, model)


def _checked(
    model: WholeCurve,
    X: np.ndarray,
    Y: np.ndarray,
    noise_sd: np.ndarray | None,
    gradients: np.ndarray | None,
    seed: int,
    folds: int = 10,
) -> WholeCurve:
    """The model with scores and band from predictions of each fold by a model learnt without it."""
    n = len(X)
    mean, sd = np.empty_like(Y), np.empty_like(Y)
    for part in np.array_split(np.random.default_rng(seed).permutation(n), min(folds, n)):
        rows = np.setdiff1d(np.arange(n), part)
        noise, slopes = (None if v is None else v[rows] for v in (noise_sd, gradients))
        try:
            mean[part], sd[part] = _again(model, X[rows], Y[rows], noise, slopes, seed).predict(X[part])
        except ValueError as refusal:
            raise ValueError(f"whole curve: too few points to check it: {refusal}") from refusal
    error = np.abs(mean - Y)
    floor = 1e-12 * np.abs(Y).max() + 1e-300  # an exact curve has no band to speak of
    z = error / np.maximum(sd, floor)
    covered = float(np.mean(z < SD_OF_95_PERCENT))
    inflate = max(1.0, float(np.quantile(z, 0.95)) / SD_OF_95_PERCENT)
    cv = tuple(score(mean[:, j], Y[:, j]) for j in range(Y.shape[1]))
    return replace(model, inflate=min(inflate, 1e3), covered=covered, cv=cv)


def _story(model: WholeCurve, unit: str, n: int) -> str:
    worst = max(model.cv, key=lambda s: s.relative_rmse)
    what = "the logarithms of the curves" if model.log else "the curves"
    kinds = ", ".join(a.kind for a in model.coefficients)
    text = f"Whole curve: {len(model.modes)} modes of {what} ({kinds}); cross-validation error up to "
    text += f"{worst.rmse:.3g} {unit}".rstrip() + f" ({100 * worst.relative_rmse:.2g} %) over {n} runs; "
    text += f"{100 * model.covered:.0f} % of the left-out values lay within its 95 % band"
    return text + (f", which was widened {model.inflate:.2g} times." if model.inflate > 1 else ".")
