"""Correlation of errors along a record: kernels over a distance, and that of neighbouring readings."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

Kernel = Callable[[np.ndarray, float], np.ndarray]


def exponential(at: np.ndarray, length: float) -> np.ndarray:
    """Correlation (n, n) e^{−|Δu|/ℓ} of errors at u (n,): continuous and rough (Ornstein–Uhlenbeck)."""
    return np.exp(-np.abs(at[:, None] - at) / length)


def gaussian_correlation(at: np.ndarray, length: float) -> np.ndarray:
    """Correlation (n, n) e^{−(Δu/ℓ)²/2} of errors at u (n,): smooth."""
    return np.exp(-0.5 * ((at[:, None] - at) / length) ** 2)


def of_neighbours(deviations: Iterable[np.ndarray]) -> float:
    """ρ = Σ x_i x_{i+1} / Σ x_i² of deviations (n,) of one curve or several; 0 where there are none."""
    product = power = 0.0
    for x in deviations:
        product += float(x[1:] @ x[:-1])
        power += float(x @ x)
    return product / power if power else 0.0


def restored(ρ: float, n: int) -> float:
    """ρ of curves of n readings with what taking out their mean cost it, (1 + 4ρ)/n.

    Source: Marriott & Pope, Biometrika 41 (1954) 390.
    """
    return ρ + (1.0 + 4.0 * ρ) / n
