"""A bonded, sealed linear biphasic layer under a porous flat end: Hankel and Laplace transforms, no finite elements.

Solid and liquid are incompressible by themselves (Mow et al. 1980); with p = 0 on all of the surface the travel u_z
of a pressure distribution P(ξ) J₀(ξ r) is C(ξ, s) P.  Six exponentials solve the layer (McNamee and Gibson 1960,
Q. J. Mech. Appl. Math. 13, 98), and the dual integral equations of the flat end,

    ∫ ξ C P J₀(ξ r) dξ = d (r < a),   ∫ ξ P J₀(ξ r) dξ = 0 (r > a),   P = ∫₀ᵃ φ(t) cos ξt dt,

become Fredholm's with ξ C = (1 − ν)/μ (1 + g) (Sneddon 1966; Mak, Lai and Mow 1987, J. Biomech. 20, 703):

    φ(τ) + 2/π ∫₀ᵃ φ(t) ∫₀^∞ g cos ξt cos ξτ dξ dt = 2 μ d/(π (1 − ν)),   F = 2π ∫ φ dt.

Times come from the fixed Talbot contour (Abate and Valkó 2004, Int. J. Numer. Meth. Eng. 60, 979).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True)
class Layer:
    """Shear modulus (MPa) and Poisson's ratio of the drained solid, permeability (mm⁴/(N s)), thickness (mm)."""

    mu: float
    nu: float
    k: float
    h: float

    @property
    def H(self) -> float:
        """The aggregate modulus (MPa)."""
        return 2.0 * self.mu * (1.0 - self.nu) / (1.0 - 2.0 * self.nu)

    @property
    def D(self) -> float:
        """Diffusivity (mm²/s)."""
        return self.k * self.H


def compliance(xi: np.ndarray, s: complex, layer: Layer) -> np.ndarray:
    """C (n,) mm/MPa of a layer: by what σ_z = −J₀(ξ r), without shear and pore pressure, moves its top down.

    Modes of V J₁, W J₀ (displacements), E J₀ (dilatation) and Q J₀ (p − H E, harmonic) in exp(k z): dilatation with
    k = ±γ, γ² = ξ² + s/D; harmonic pressure and displacement without dilatation with k = ±ξ.
    """
    mu, H, D, h = layer.mu, layer.H, layer.D, layer.h
    lame, gamma = H - 2.0 * mu, np.sqrt(xi**2 + s / D + 0j)
    z = np.array([0.0, h])
    A, zero = np.zeros((len(xi), 6, 6), complex), np.zeros((len(xi), 2))

    def column(j, k, V, dV, W, dW, E, dE, Q, dQ):
        p, dp = H * E + Q, H * dE + dQ
        rows = [V[:, 0], W[:, 0], dp[:, 0], p[:, 1], mu * (dV - xi[:, None] * W)[:, 1]]
        A[:, :, j] = np.stack([*rows, (lame * E + 2.0 * mu * dW - p)[:, 1]], axis=1)
        tops[:, j] = W[:, 1]

    tops = np.zeros((len(xi), 6), complex)
    for j, sign in enumerate((1.0, -1.0)):
        k = sign * gamma[:, None]
        e = np.exp(k * (z - (h if sign > 0 else 0.0)))
        # times (γ² − ξ²)/γ: displacements of the order 1
        c = (s / D) / gamma[:, None]
        V, W, E = -xi[:, None] / gamma[:, None] * e, sign * e, c * e
        column(j, k, V, k * V, W, k * W, E, k * E, zero, zero)
        k = sign * xi[:, None]
        e = np.exp(k * (z - (h if sign > 0 else 0.0)))
        b, d = -xi[:, None] / (2.0 * k * mu), 1.0 / (2.0 * mu)
        a = -d / xi[:, None]
        V, dV = (a + b * z) * e, (b + k * (a + b * z)) * e
        W, dW = d * z * e, (d + k * d * z) * e
        column(2 + j, k, V, dV, W, dW, zero, zero, e, k * e)
        V, W = -k / xi[:, None] * e, e
        column(4 + j, k, V, k * V, W, k * W, zero, zero, zero, zero)
    right = np.zeros((len(xi), 6, 1), complex)
    right[:, 5] = -1.0
    scale = np.abs(A).max(1, keepdims=True)
    solution = np.linalg.solve(A / scale, right)[..., 0] / scale[:, 0]
    return -(tops * solution).sum(1)


@dataclass(frozen=True)
class Rounded:
    """A flat end of radius a (mm), its edge rounded by a `fillet` (mm), at a travel d (mm); c is its radius of contact.

    Beyond b = a − fillet it rises by (r − b)²/2 fillet.  The drained layer decides c: where φ(c) = 0.  It hardly
    changes while liquid flows, and during the ramp the whole of d − f(r) is taken to grow evenly.
    """

    a: float
    fillet: float
    d: float
    c: float = 0.0

    def profile(self, tau: np.ndarray) -> np.ndarray:
        """1 − τ/d ∫₀^τ f′ dr/√(τ² − r²), f the rise: the right-hand side of Fredholm's equation, 1 of a sharp edge."""
        b = self.a - self.fillet
        beyond = np.maximum(tau, b)
        return 1.0 - tau * (np.sqrt(beyond**2 - b**2) - b * np.arccos(b / beyond)) / (self.fillet * self.d)


def density(s: complex, layer: Layer, end: Rounded, fine: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t (n,) mm, weights and φ (n,) of a unit travel; `fine` multiplies all points of quadrature."""
    edges = np.concatenate([[0.0], np.geomspace(0.02, 120.0 * fine, 40 * fine)]) / end.a
    x, w = np.polynomial.legendre.leggauss(4)
    half, middle = 0.5 * np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
    xi, weights = (middle[:, None] + half[:, None] * x).ravel(), (half[:, None] * w).ravel()
    g = xi * compliance(xi, s, layer) * layer.mu / (1.0 - layer.nu) - 1.0
    b, parts = end.a - end.fillet, []
    for low, high, n in ((0.0, b, 16 * fine), (b, end.c, 4)):
        x, w = np.polynomial.legendre.leggauss(n)
        parts.append((low + 0.5 * (high - low) * (x + 1.0), 0.5 * (high - low) * w))
    t, wt = (np.concatenate(p) for p in zip(*parts, strict=True))
    cos = np.cos(xi[:, None] * t)
    kernel = np.einsum("x,xi,xj->ij", g * weights, cos, cos)
    right = 2.0 * layer.mu / (np.pi * (1.0 - layer.nu)) * end.profile(t)
    return t, wt, np.linalg.solve(np.eye(len(t)) + 2.0 / np.pi * kernel * wt, right)


def stiffness(s: complex, layer: Layer, end: Rounded, fine: int = 1) -> complex:
    """F/d (N/mm) of the Laplace transforms at s (1/s)."""
    _, w, phi = density(s, layer, end, fine)
    return complex(2.0 * np.pi * (w * phi).sum())


def touching(layer: Layer, a: float, fillet: float, d: float) -> Rounded:
    """The end with its radius of contact: φ(c) = 0 where the layer is drained."""

    def last(c: float) -> float:
        end = Rounded(a, fillet, d, c)
        t, _, phi = density(1e-9 * layer.D / a**2, layer, end)
        return float(np.polyfit((t[-4:] - c) / fillet, phi[-4:].real, 3)[-1])

    return Rounded(a, fillet, d, brentq(last, a - 0.999 * fillet, a))


def relaxation(
    times: np.ndarray, ramp: float, layer: Layer, end: Rounded, nodes: int = 10, fine: int = 1
) -> np.ndarray:
    """F/d (N/mm) at `times` (s) of a travel d that is reached in `ramp` (s) and held."""
    at = functools.cache(lambda s: stiffness(s, layer, end, fine))

    def integral(t: float) -> float:
        """Inverse of the stiffness over s², the force under a travel of slope 1."""
        if t <= 0.0:
            return 0.0
        r = 2.0 * nodes / (5.0 * t)
        theta = np.arange(1, nodes) * np.pi / nodes
        cot = 1.0 / np.tan(theta)
        s, turn = r * theta * (cot + 1j), 1.0 + 1j * (theta + (theta * cot - 1.0) * cot)
        total = 0.5 * np.exp(r * t) * (at(complex(r)) / r**2).real
        total += sum((np.exp(v * t) * at(complex(v)) / v**2 * c).real for v, c in zip(s, turn, strict=True))
        return float(r / nodes * total)

    return np.array([(integral(t) - integral(t - ramp)) / ramp for t in times])
