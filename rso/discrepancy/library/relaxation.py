"""What relaxation does to the force of an indenter, nearly: tables hold it densely, simulations add what it misses.

An indenter pressed at a steady rate to the travel p and back meets, with the elastic force F_e(u) and the relaxation
function R(t) = 1 − g + g exp(−t/τ),

    F(t) = ∫₀^{t₁} R(t − s) F_e'(u(s)) u'(s) ds,

t₁ = t on the way there (Lee & Radok, J. Appl. Mech. 27 (1960) 438), and in unloading the instant at which the
contact was as large as it is now,

    ∫_{t₁}^{t} R(t − s) u'(s) ds = 0    (Ting, J. Appl. Mech. 33 (1966) 845, eq. 22).

Exact for a linear half-space of constant Poisson's ratio.  A finite body of a rubber that relaxes in shear alone is off
by 1 to 2 % of the force on the way there, 10 % in unloading, where the change itself is all of the force; what is
off varies slowly with g and τ, while the travel at which contact is lost does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.interpolation import Nodes
from rso.discrepancy.library.simulations import Pass

MAX_DENSE_STEP_LN_TIME = 0.3  # of ln τ from one node of a dense table to the next, at most
N_DENSE_SIZES = 6  # of a dense table
N_HEREDITARY_STEPS = 400  # of the hereditary integral, evenly spaced in √u


def is_relaxation(effect: Effect) -> bool:
    """Whether an effect is a share of the stress that is lost in time: a share with one shape, a time."""
    size = effect.size
    share = size.neutral == 0.0 and 0.0 < size.high <= 1.0 and size.unit == "1" and not effect.settings
    return (
        effect.family == "model"
        and effect.place is None
        and share
        and len(effect.shape) == 1
        and effect.shape[0].power_of_time == 1
    )


def dense(nodes: Nodes) -> Nodes:
    """The nodes with others in between, those of the shape among them."""
    sizes, times = nodes.levels
    fine = max(2, math.ceil(float(np.max(np.diff(times))) / MAX_DENSE_STEP_LN_TIME))
    every = np.interp(np.arange((len(times) - 1) * fine + 1) / fine, np.arange(len(times)), times)
    return replace(
        nodes, levels=(sizes.max() * np.arange(1, N_DENSE_SIZES + 1) / N_DENSE_SIZES, every), middle=math.inf, fine=fine
    )


def foreseen(u: np.ndarray, base: np.ndarray, points: np.ndarray, ways: Sequence[Pass]) -> np.ndarray:
    """Changes (n, n_pass, 3, m) relative to Fz of the forces (m, 3) over travels u (m,); all of them fall alike."""
    fall = np.stack([expected_relaxation(u, base[:, 2], points, way) for way in ways], axis=1)
    share = np.divide(base.T, base[:, 2], out=np.zeros_like(base.T), where=base[:, 2] > 0.0)
    return fall[:, :, None] * share


def expected_relaxation(u: np.ndarray, force: np.ndarray, points: np.ndarray, way: Pass) -> np.ndarray:
    """Relative change (n, m) of the elastic force (m,) over travels u (m,) at points (n, 2) of g and ln τ.

    τ counts in travel, as at unit speed.  Beyond the peak of the `way`, and where there is no elastic force, the change
    is that beside it.
    """
    top = float(u[-1]) if way.peak is None else min(way.peak, float(u[-1]))
    a = np.linspace(0.0, math.sqrt(top), N_HEREDITARY_STEPS) ** 2
    F = np.interp(np.sqrt(a), np.sqrt(u), force)
    there = np.flatnonzero((force > 0.0) & (u > 0.0) & (u <= top))
    out = np.zeros((len(points), len(u)))
    if not len(there):
        return out
    x = u[there]
    for lnτ in np.unique(points[:, 1]):
        τ = math.exp(lnτ)
        held = _held(a, F, τ)
        for n in np.flatnonzero(points[:, 1] == lnτ):
            g = points[n, 0]
            t = x if way.peak is None else top + way.rest + (top - x) / way.pace
            at = x if way.peak is None else np.minimum(_as_large(t, top, way, g, τ), x)
            f = (1 - g) * _along(at, a, F) + g * np.exp(-(t - at) / τ) * _along(at, a, held)
            out[n, there] = f / _along(x, a, F) - 1.0
    out[:, : there[0]], out[:, there[-1] + 1 :] = out[:, there[:1]], out[:, there[-1:]]
    return out


def _held(a: np.ndarray, F: np.ndarray, τ: float) -> np.ndarray:
    """∫₀^a exp(−(a − s)/τ) dF(s) at a (n,), F linear between them."""
    out, q = np.zeros(len(a)), np.diff(a) / τ
    fall, part = np.exp(-q), -np.expm1(-q) / q
    for i, dF in enumerate(np.diff(F)):
        out[i + 1] = out[i] * fall[i] + dF * part[i]
    return out


def _as_large(t: np.ndarray, top: float, way: Pass, g: float, τ: float) -> np.ndarray:
    """Travels t₁ (n,) on the way there at which contact was as large as at times t in unloading: 0 where it is lost.

    With S(t) = ∫₀^t R, the rest from `top` to t_r and the pace w of the unloading the condition is

        S(t − t₁) = S(t − top) + w S(t − t_r).
    """
    wanted = _S(t - top, g, τ) + way.pace * _S(t - top - way.rest, g, τ)
    low, high = t - top, t.copy()
    for _ in range(50):
        middle = 0.5 * (low + high)
        below = _S(middle, g, τ) < wanted
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.clip(t - 0.5 * (low + high), 0.0, top)


def _S(t: np.ndarray, g: float, τ: float) -> np.ndarray:
    return (1 - g) * t - g * τ * np.expm1(-t / τ)


def _along(x: np.ndarray, a: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.interp(np.sqrt(x), np.sqrt(a), values)
