"""Creep under a ball at a held force beside the closed form of linear viscoelasticity."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme, Segment

HALF_SPACE = {
    "specimen": {"shape": "half_space"},
    "indenter": {"shape": "sphere", "radius": 3.0},
    "mesh": {"level": "fine"},
}


def compliance(t, mu, g, tau):
    """∫₀ᵗ J(t − s) ds of a standard solid: J = (1 − g exp(−(1 − g) t/τ))/(μ(1 − g)), the inverse of
    G = μ (1 − g + g exp(−t/τ)) under Laplace's transform, s² Ĵ Ĝ = 1."""
    k = (1.0 - g) / tau
    return (t - g * -np.expm1(-k * t) / k) / (mu * (1.0 - g))


@pytest.mark.verification
def test_creep_under_a_ball_is_that_of_lee_and_radok():
    """a³ = (3R/16) ∫ J(t − s) dF for an incompressible half-space (Lee & Radok 1960, J. Appl. Mech. 27, 438), δ = a²/R:
    δ^{3/2} over that at the end of the ramp, so that what depth (a/R = 0.2) leaves nearly cancels; 0.8 %, of which
    the ratio of moduli K/μ = 100 to 200 takes 0.5."""
    mu, g, tau, F, ramp = 0.01, 0.5, 4.0, 1e-3, 0.5
    values = {"mu": mu, "D1": 2.0 / (100.0 * mu), "prony_g": g, "prony_tau": tau}
    moments = (0.2, 1.0, 3.0, 8.0, 20.0, 60.0)
    segments = (Segment("force", rate=F / ramp, to_N=F), Segment("force", hold_s=60.0, asked_s=moments))
    found = BACKEND(values, Case("creep", Programme(segments=segments, asked_N=(F,)), HALF_SPACE))
    t = np.array([0.0, *moments]) + ramp
    exact = (compliance(t, mu, g, tau) - compliance(t - ramp, mu, g, tau)) / ramp
    depth = found.channels["travel"]
    assert depth[-1] / 3.0 < 0.05
    np.testing.assert_allclose((depth / depth[0]) ** 1.5, exact / exact[0], rtol=8e-3)
    first = 3.0 * (3.0 * F * exact[0] / (16.0 * 9.0)) ** (2.0 / 3.0)  # δ = R (3 F J/(16 R²))^{2/3}
    np.testing.assert_allclose(depth[0], first, rtol=0.025)
