"""What runs with derivatives say between them: curves through every run with its slopes, the modulus scaled exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve

from rso.core.similarity import Group
from rso.doe import Box
from rso.emulation.emulator import reduced_box
from rso.emulation.kernels import kernel_matrix
from rso.emulation.kriging_likelihood import cholesky_factor
from rso.inference.likelihood import Model

# of the unit cube, over which what the tangent leaves bends: between two runs it is nearly a cubic
TANGENT_KERNEL_LENGTH = 0.4
MAX_LOG_CHANGE = 10.0  # of ln f over the unit cube: a value that changes by more is none to take the logarithm of
TANGENT_JITTER_SHARE = 1e-13  # of the variance: keeps matrices of neighbouring runs definite


@dataclass(frozen=True, eq=False)
class EvaluatedPoint:
    """What one run says: x (d,) in the unit cube of a box, the measured points f (n,) and ∂f/∂θ (n, d)."""

    x: np.ndarray
    f: np.ndarray
    slopes: np.ndarray


@dataclass(frozen=True, eq=False)
class TangentFrame:
    """Where curves are compared: the box of θ, its similarity, and the exponent of stress of each point (n,)."""

    box: Box
    group: Group
    powers: np.ndarray

    def reduced(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """s (k,) and z (k, d') with y(θ) = s^e f(z), of X (k, d); d' = 0 where similarity leaves nothing."""
        theta = dict(zip(self.box.names, self.box.from_unit(np.asarray(X, float)).T, strict=True))
        group, inner = self.group, reduced_box(self.box, self.group)
        s = np.ones(len(X)) if group.reference is None else theta[group.reference] / group.reference_value
        if inner is None:
            return s, np.empty((len(X), 0))
        return s, inner.to_unit(np.stack([theta[k] * s ** -self._power(k) for k in inner.names], axis=1))

    def inner(self, run: EvaluatedPoint) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """z (d',), f′ = f s^(−e) (n,) and ∂f′/∂z (n, d') of a run."""
        (s,), (z,) = self.reduced(run.x[None])
        scaled = run.f * s**-self.powers
        inner = reduced_box(self.box, self.group)
        if inner is None:
            return z, scaled, np.empty((len(run.f), 0))
        columns = [self.box.names.index(k) for k in inner.names]
        shrink = np.array([s ** self._power(k) for k in inner.names])
        return z, scaled, run.slopes[:, columns] * shrink * inner.slope(z) * s ** -self.powers[:, None]

    def _power(self, name: str) -> int:
        return 0 if self.group.reference is None else self.group.exponents.get(name, 0)

    def imbalance(self, run: EvaluatedPoint) -> float:
        """How far the derivatives of a run are from similarity: max |Σ e_k θ_k ∂f/∂θ_k − e f| / max |f|, 0 without it.

        Euler's theorem on homogeneous functions: what scales as a power has exactly these derivatives.
        """
        if self.group.reference is None:
            return 0.0
        theta = self.box.from_unit(run.x)
        e = np.array([self.group.exponents.get(n, 0) for n in self.box.names])
        return float(np.abs(run.slopes @ (e * theta) - self.powers * run.f).max() / np.abs(run.f).max())


def tangents(frame: TangentFrame, runs: Sequence[EvaluatedPoint], base: EvaluatedPoint) -> Model:
    """Curves f(x) that agree with every run in value and slope; beyond the runs the tangent at `base`, one of them.

        ln f′(z) = ln f′_b + g_b·(z − z_b) + k(z)ᵀ K⁻¹ r        (f′ itself where a point is not positive in every run)

    r holds what the tangent leaves of the other runs' values and slopes, k and K are the squared exponential and its
    derivatives.  One run alone gives its tangent; between two close ones the error is of the fourth order.
    Source: Rasmussen & Williams, Gaussian Processes (2006), eq. 2.25 and section 9.4.
    """
    # By similarity two runs may be one: then the base speaks.
    places = {tuple(np.round(frame.inner(r)[0], 6)): r for r in (*runs, base)}
    runs = list(places.values())
    Z, T, G, log = unfolded(frame, runs)
    b = next(k for k, r in enumerate(runs) if r is base)
    bend = _bending(Z, T, G, b, np.where(log, 1.0, np.abs(T).max(axis=0) + 1e-300))

    def predict(X: np.ndarray) -> np.ndarray:
        s, z = frame.reduced(X)
        t = T[b] + (z - Z[b]) @ G[b].T
        if bend is not None:
            t = t + _kernel(z, Z) @ bend
        # A tangent that is followed too far must not overflow.
        return np.where(log, np.exp(np.minimum(np.where(log, t, 0.0), 300.0)), t) * s[:, None] ** frame.powers

    return Model(frame.box, predict)


def unfolded(
    frame: TangentFrame, runs: Sequence[EvaluatedPoint]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """z (k, d'), ln f′ (k, n) and its slopes (k, n, d'), and the mask (n,) of the points positive in every run.

    The other points keep f′ itself, and so do those that nearly vanish in a run, as where an unloading ends.
    """
    inner = [frame.inner(r) for r in runs]
    Z, F, G = (np.stack([v[i] for v in inner]) for i in range(3))
    positive = np.all(F > 0, axis=0)
    log = positive & ~_vanishing(np.where(positive, F, 1.0), G, positive)
    safe = np.where(log, F, 1.0)
    return Z, np.where(log, np.log(safe), F), np.where(log[:, None], G / safe[:, :, None], G), log


def _vanishing(F: np.ndarray, G: np.ndarray, positive: np.ndarray) -> np.ndarray:
    """(n,) whether ln of values F (k, n) changes by more than `MAX_LOG_CHANGE` beyond what most of the curve does.

    That is over the box, by the slopes G (k, n, d'), or between two runs; a modulus moves all alike.
    """
    if not positive.any():
        return ~positive
    slope, run = G / F[:, :, None], np.ptp(np.log(F), axis=0)
    beyond = np.abs(slope - np.median(slope[:, positive], axis=1, keepdims=True)).max(axis=(0, 2), initial=0.0)
    return np.asarray((beyond >= MAX_LOG_CHANGE) | (run - np.median(run[positive]) >= MAX_LOG_CHANGE))


def _bending(Z: np.ndarray, T: np.ndarray, G: np.ndarray, b: int, size: np.ndarray) -> np.ndarray | None:
    """Weights (n + n d', m) of the process for what the tangent at run b leaves; None where there is one run alone."""
    if len(Z) == 1 or Z.shape[1] == 0:
        return None
    values = T - T[b] - (Z - Z[b]) @ G[b].T
    R = np.vstack([values, *np.moveaxis(G - G[b], 2, 0)])
    return cho_solve((cholesky_factor(_kernel(Z, Z, left=True), TANGENT_JITTER_SHARE), True), R / size) * size


def _kernel(X: np.ndarray, Y: np.ndarray, left: bool = False) -> np.ndarray:
    """Correlation of values (and, with `left`, slopes) at X with values and slopes at Y."""
    return kernel_matrix("squared_exponential", X, Y, np.full(Y.shape[1], TANGENT_KERNEL_LENGTH), left=left, right=True)
