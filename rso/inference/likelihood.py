"""How likely measured curves are under a model: errors with their covariance, weights, misfit and its gradient.

Everything works on the unit cube of a :class:`~rso.doe.Box`, where a parameter on a log scale is its logarithm.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from rso.core.digits import quantity_text
from rso.doe import Box

Weighting = Literal["noise", "absolute", "relative"]
WEIGHTINGS: tuple[Weighting, ...] = ("noise", "absolute", "relative")
# share of the largest value below which no error is believed: it keeps every covariance definite
MIN_ERROR_SHARE = 1e-6
BROKEN_CONDITION_SLOPE = 1e4  # of χ^½ per range of a condition that is broken: a thousandth of it rules a point out
DIFFERENCE_STEP = 1e-4  # of the unit cube, for differences: rounding (1e-16/h) and curvature (h²) are both below 1e-8


@dataclass(frozen=True, eq=False)
class Data:
    """One measured curve: `value` (n,) in `unit` at `depth` (n,) mm, and the covariance (n, n) of its errors.

    The size of the errors is known from `freedom` degrees of freedom; infinite: it is stated.  `shared` holds parts s
    (n,) of the covariance, s sᵀ each: of curves that have one of the same name it is the same error.  `white` w (n,) is
    the part diag(w²) that counts as white for want of knowledge; `memory` is the correlation of neighbours that it was
    given since.  `usual` holds the parts U (n, q) of the covariance, U Uᵀ each, that nobody has stated and the readings
    do not show: what a test is usually off by.  `itself` says that its size was taken from these very readings, not
    from what repeats differ by; `sized` from how many degrees of freedom of what the best fit leaves.
    `since` (n,) s is the time in a hold, 0 on the way there; None without a hold.  `parts` (n, n) of the covariance are
    those of the model that it is compared with, by name (:mod:`.error_model`).  `inputs` names those of the `shared`
    parts that come from what a study states of specimen and indenter.
    """

    name: str
    unit: str
    depth: np.ndarray
    value: np.ndarray
    covariance: np.ndarray
    freedom: float = np.inf
    shared: Mapping[str, np.ndarray] = field(default_factory=dict)
    white: np.ndarray | None = None
    memory: float = 0.0
    usual: Mapping[str, np.ndarray] = field(default_factory=dict)
    itself: bool = False
    sized: float | None = None
    since: np.ndarray | None = None
    parts: Mapping[str, np.ndarray] = field(default_factory=dict)
    inputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        u, y, C = (np.array(v, float) for v in (self.depth, self.value, self.covariance))
        if u.ndim != 1 or not len(u) or y.shape != u.shape or C.shape != (len(u), len(u)):
            raise ValueError(f"{self.name}: depth {u.shape}, value {y.shape} and covariance {C.shape} do not fit")
        if any(np.shape(s) != u.shape for s in self.shared.values()):
            raise ValueError(f"{self.name}: shared errors need the shape {u.shape} of the depth")
        if not all(np.all(np.isfinite(v)) for v in (u, y, C)):
            raise ValueError(f"{self.name}: depth, value and covariance must be finite")
        for key, v in (("depth", u), ("value", y), ("covariance", C)):
            object.__setattr__(self, key, v)

    @property
    def sigma(self) -> np.ndarray:
        """Standard uncertainty (n,) of each value."""
        return np.sqrt(np.diag(self.covariance))

    def plus(self, covariance: np.ndarray, part: str = "") -> Data:
        """The same curve with another independent error (n, n), noted under the name of its `part`."""
        parts = {**self.parts, part: self.parts.get(part, 0.0) + covariance} if part else self.parts
        return replace(self, covariance=self.covariance + covariance, parts=parts)

    def with_input(self, name: str, s: np.ndarray) -> Data:
        """The same curve with an uncertain input that moves its readings by s (n,), the same for all curves."""
        data = self.plus(np.outer(s, s))
        return replace(data, shared={**self.shared, name: s}, inputs=(*self.inputs, name))

    @property
    def inputs_exact(self) -> Data:
        """The same curve with its inputs taken as exact."""
        off = [np.outer(self.shared[n], self.shared[n]) for n in self.inputs]
        left = {n: s for n, s in self.shared.items() if n not in self.inputs}
        return replace(
            self, covariance=self.covariance - sum(off, np.zeros_like(self.covariance)), shared=left, inputs=()
        )

    def without(self, *names: str) -> Data:
        """The same curve without these parts of the errors, as far as it has them."""
        gone = [self.parts[n] for n in names if n in self.parts]
        left = {n: C for n, C in self.parts.items() if n not in names}
        return replace(self, covariance=self.covariance - sum(gone, np.zeros_like(self.covariance)), parts=left)

    def rows(self, order: np.ndarray) -> Data:
        """The same curve with its readings in another order, or some of them."""
        return replace(
            self,
            depth=self.depth[order],
            value=self.value[order],
            covariance=self.covariance[np.ix_(order, order)],
            shared={n: s[order] for n, s in self.shared.items()},
            white=None if self.white is None else self.white[order],
            usual={n: U[order] for n, U in self.usual.items()},
            since=None if self.since is None else self.since[order],
            parts={n: C[np.ix_(order, order)] for n, C in self.parts.items()},
        )

    @property
    def places(self) -> list[str]:
        """Where each value was measured, in words: ``2 mm``, in a hold ``2 mm, 5 s held``."""
        since = np.zeros(len(self.depth)) if self.since is None else self.since
        return [
            f"{quantity_text(u, 'mm')}" + (f", {s:.2g} s held" if s else "")
            for u, s in zip(self.depth, since, strict=True)
        ]

    @property
    def as_stated(self) -> Data:
        """The same curve without what is usual."""
        shared = {n: s for n, s in self.shared.items() if n not in self.usual}
        left = sum((U @ U.T for U in self.usual.values()), np.zeros_like(self.covariance))
        return replace(self, covariance=self.covariance - left, shared=shared, usual={})


def split_common_errors(data: Sequence[Data]) -> tuple[list[Data], np.ndarray]:
    """Curves without the errors that two of them and more share, and those, V (n, g): C = diag(C_1, C_2, …) + V Vᵀ."""
    count = Counter(name for d in data for name in d.shared)
    names = [name for name, k in count.items() if k > 1]
    if not names:
        return list(data), np.zeros((sum(len(d.value) for d in data), 0))
    alone = []
    for d in data:
        own = [np.outer(s, s) for n, s in d.shared.items() if n in names]
        alone.append(d.plus(-np.sum(own, axis=0)) if own else d)
    columns = [np.concatenate([d.shared.get(n, np.zeros(len(d.value))) for d in data]) for n in names]
    return alone, np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class Model:
    """θ → all measured points: `predict` X (k, d) in the unit cube of `box` → (k, n).

    `derivative` x (d,) → (n, d) in the same coordinates; None: central differences, one-sided at the bounds.
    """

    box: Box
    predict: Callable[[np.ndarray], np.ndarray]
    derivative: Callable[[np.ndarray], np.ndarray] | None = None

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """∂f/∂x (n, d) at x (d,)."""
        if self.derivative is not None:
            return np.asarray(self.derivative(np.asarray(x, float)), float)
        return self.jacobians(np.asarray(x, float)[None])[0]

    def jacobians(
        self, X: np.ndarray, free: np.ndarray | None = None, step: float | np.ndarray = DIFFERENCE_STEP
    ) -> np.ndarray:
        """∂f/∂x (k, n, f) at many points by differences, along the `free` axes only; one call of `predict`.

        `step` is that of all axes, or of each of the free ones (f,).
        """
        k, d = X.shape
        axes = np.arange(d) if free is None else np.flatnonzero(free)
        up, down = (np.repeat(X[:, None], len(axes), axis=1) for _ in range(2))
        rows = np.arange(len(axes))
        up[:, rows, axes] = np.minimum(up[:, rows, axes] + step, 1.0)
        down[:, rows, axes] = np.maximum(down[:, rows, axes] - step, 0.0)
        both = np.concatenate([up.reshape(-1, d), down.reshape(-1, d)])
        high, low = self.predict(both).reshape(2, k, len(axes), -1)
        width = up[:, rows, axes] - down[:, rows, axes]
        return np.swapaxes((high - low) / width[:, :, None], 1, 2)


@dataclass(frozen=True, eq=False)
class Misfit:
    """χ²(x) = ‖W (f(x) − y)‖² of a model against all data at once.

    WᵀW is the inverse of the covariance ('noise'; with L Lᵀ that of curve by curve and V of what they share, W is
    (1 + U Uᵀ)^{-1/2} L⁻¹ with U = L⁻¹ V), 1 ('absolute') or 1/|y| ('relative', points with |y|
    below `MIN_ERROR_SHARE` of the largest have no weight); with the latter two the size of the errors is taken from
    what is left over.  `scale` divides W: errors that are known only in their relation to one another.

    Beyond a `wall`, X (k, d) → (k, w) by how much conditions are broken, χ² grows by (BROKEN_CONDITION_SLOPE · wall)²:
    there is no answer there, or none is wanted.
    """

    model: Model
    data: tuple[Data, ...]
    weighting: Weighting = "noise"
    scale: float = 1.0
    wall: Callable[[np.ndarray], np.ndarray] | None = None
    _whiten: tuple[np.ndarray, ...] = field(init=False, repr=False)
    _shared: tuple[np.ndarray, np.ndarray] | None = field(init=False, repr=False)
    _value: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.weighting not in WEIGHTINGS:
            raise ValueError(f"weighting {self.weighting!r}; choose one of {', '.join(WEIGHTINGS)}")
        if not self.data or not self.scale > 0:
            raise ValueError("a misfit needs data and a scale > 0")
        object.__setattr__(self, "data", tuple(self.data))
        alone, V = split_common_errors(self.data) if self.weighting == "noise" else (self.data, np.zeros((0, 0)))
        object.__setattr__(self, "_whiten", tuple(_whitening(d, self.weighting) / self.scale for d in alone))
        object.__setattr__(self, "_shared", None)
        if V.size:
            Q, s, _ = np.linalg.svd(self.scale * self.white(V.T).T, full_matrices=False)
            object.__setattr__(self, "_shared", (Q, 1.0 - 1.0 / np.sqrt(1.0 + s**2)))
        object.__setattr__(self, "_value", np.concatenate([d.value for d in self.data]))

    @property
    def n(self) -> int:
        """Number of measured points."""
        return len(self._value)

    @property
    def freedom(self) -> float:
        """Degrees of freedom from which the size of all errors is known, n²/Σ_k (n_k²/m_k) over the curves k."""
        unknown = sum(len(d.value) ** 2 / d.freedom for d in self.data) if self.weighting == "noise" else 0.0
        return self.n**2 / unknown if unknown > 0 else np.inf

    def white(self, change: np.ndarray) -> np.ndarray:
        """W applied along the last axis (..., n): a change of the curves in units of their noise."""
        parts, start = [], 0
        for W in self._whiten:
            parts.append(change[..., start : start + len(W)] @ W.T)
            start += len(W)
        whole = np.concatenate(parts, axis=-1)
        if self._shared is None:
            return whole
        Q, less = self._shared
        return whole - (whole @ Q * less) @ Q.T

    def residuals(self, X: np.ndarray) -> np.ndarray:
        """W (f − y) (k, n) at X (k, d), and after them what lies beyond the wall (k, n + w)."""
        X = np.atleast_2d(X)
        r = self.white(self.model.predict(X) - self._value)
        return r if self.wall is None else np.hstack([r, self.beyond(X)])

    def beyond(self, X: np.ndarray) -> np.ndarray:
        """BROKEN_CONDITION_SLOPE · what is beyond the wall (k, w) at X (k, d); no columns where there is none."""
        return np.zeros((len(X), 0)) if self.wall is None else BROKEN_CONDITION_SLOPE * np.maximum(self.wall(X), 0.0)

    def chi2(self, X: np.ndarray) -> np.ndarray:
        """χ² (k,) at X (k, d)."""
        return np.sum(self.residuals(X) ** 2, axis=1)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """∂r/∂x (n, d) of the residuals at x (d,)."""
        J = self.white(self.model.jacobian(x).T).T
        if self.wall is None:
            return J
        return np.vstack([J, Model(self.model.box, self.beyond).jacobian(x)])

    def jacobians(self, X: np.ndarray, free: np.ndarray | None = None) -> np.ndarray:
        """∂r/∂x (k, n, f) at many points by differences, along the `free` axes only."""
        J = np.swapaxes(self.white(np.swapaxes(self.model.jacobians(X, free), 1, 2)), 1, 2)
        if self.wall is None:
            return J
        return np.concatenate([J, Model(self.model.box, self.beyond).jacobians(X, free)], axis=1)

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """∂χ²/∂x (d,) = 2 Jᵀ r."""
        return 2 * self.jacobian(x).T @ self.residuals(x)[0]


def _whitening(data: Data, weighting: Weighting) -> np.ndarray:
    n, y = len(data.value), np.abs(data.value)
    largest = float(y.max())
    if weighting == "absolute":
        return np.eye(n)
    if weighting == "relative":
        return np.diag(np.where(y > MIN_ERROR_SHARE * largest, 1.0 / np.where(y > 0, y, 1.0), 0.0))
    floor = MIN_ERROR_SHARE * (largest or 1.0)
    try:
        L = cholesky(data.covariance + floor**2 * np.eye(n), lower=True)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"{data.name}: the covariance of the errors is not positive definite") from error
    return solve_triangular(L, np.eye(n), lower=True)


def stack(models: Sequence[Model]) -> Model:
    """One model of all curves from a model of each, over the same box."""
    models = tuple(models)
    if any(m.box != models[0].box for m in models):
        raise ValueError("stack: the models need the same box")
    return Model(
        models[0].box,
        lambda X: np.concatenate([m.predict(X) for m in models], axis=1),
        None if any(m.derivative is None for m in models) else lambda x: np.vstack([m.jacobian(x) for m in models]),
    )
