"""Relaxation of a thick gel under a ball beside the published curve of Hu, Zhao, Vlassak and Suo (2010)."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme

MU, RADIUS = 0.01, 3.0


def published(tau: np.ndarray) -> np.ndarray:
    """g of F(t) = F(∞) + (F(0) − F(∞)) g(τ), τ = D t/a², a = √(R d), D = k H (Appl. Phys. Lett. 96, 121904, sphere)."""
    return 0.491 * np.exp(-0.908 * np.sqrt(tau)) + 0.509 * np.exp(-1.679 * tau)


@pytest.mark.verification
@pytest.mark.parametrize("nu", [0.0, 0.2, 0.35])
def test_a_ball_on_a_half_space(nu):
    """Within 0.06 of the force that relaxes, whatever Poisson's ratio; a porous ball relaxes sooner.

    The curve is a fit to finite elements of an infinitely small depth; here a/R = 0.45.
    """
    K = 2.0 * MU * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
    depth, H = 0.2 * RADIUS, K + 4.0 / 3.0 * MU
    unit = RADIUS * depth  # s of τ where k H = 1 mm²/s
    tau = np.array([0.1, 0.3, 1.0, 3.0, 100.0])
    start = 1e-4 * unit
    programme = Programme((0.0, start, start + 100.0 * unit), (0.0, depth, depth), (depth,), tuple(start + tau * unit))
    g = {}
    for indenter in ("sealed", "porous"):
        settings = {
            "specimen": {"shape": "half_space"},
            "indenter": {"shape": "sphere", "radius": RADIUS},
            "support": {"kind": "bonded"},
            "drainage": {"indenter": indenter},
            "material": {"law": "linear_elastic"},
        }
        F = BACKEND({"mu": MU, "D1": 2.0 / K, "permeability": 1.0 / H}, Case("a", programme, settings)).channels["Fz"]
        g[indenter] = (F[1:-1] - F[-1]) / (F[0] - F[-1])
    assert np.abs(g["sealed"] - published(tau[:-1])).max() < 0.06
    assert g["porous"][0] < published(tau[:1])[0] - 0.2
