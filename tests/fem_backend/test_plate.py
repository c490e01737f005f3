"""A block compressed between plates: homogeneous where both slide, stiffer where they hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from test_toy_members import Block, Smooth

from fem_backend import meshing
from fem_backend.backend import BACKEND
from fem_backend.specimens import SPECIMENS
from fem_backend.supports import SUPPORTS
from rso.contract import Case, Programme, SimulationFailed

HALF, HEIGHT, MU = 20.0, 15.0, 0.01
ASKED = (0.3, 1.5)


@pytest.fixture(autouse=True)
def block():
    """A block on a smooth plate, as the toys of test_toy_members.py."""
    known, makers = [(s, dict(s.members)) for s in (SPECIMENS, SUPPORTS)], dict(meshing.MAKERS)
    SPECIMENS.register(Block)
    SUPPORTS.register(Smooth)
    yield
    for s, before in known:
        s.members.clear()
        s.members.update(before)
    meshing.MAKERS.clear()
    meshing.MAKERS.update(makers)


def compressed(contact: str, kind: str, D1: float = 5.0, asked=ASKED, **values):
    settings = {
        "specimen": {"shape": "brick", "half": HALF, "height": HEIGHT},
        "indenter": {"shape": "plate", "contact": contact},
        "support": {"kind": kind},
        "mesh": {"level": "coarse"},
    }
    return BACKEND({"mu": MU, "D1": D1, **values}, Case("plate", Programme.ramp(asked), settings))


def uniaxial(stretch: float, D1: float) -> float:
    """Nominal stress (MPa) of the neo-Hookean body, W = mu/2 (I1 J^(-2/3) - 3) + (J - 1)^2/D1, free beside.

    dW/d(side) = 0 is solved for the side, dW/d(stretch) is the stress, both by central differences of W.
    """

    def W(a: float, b: float) -> float:
        J = a * b * b
        return 0.5 * MU * ((a * a + 2.0 * b * b) * J ** (-2.0 / 3.0) - 3.0) + (J - 1.0) ** 2 / D1

    side = brentq(lambda b: W(stretch, b + 1e-5) - W(stretch, b - 1e-5), 0.8, 1.6)
    return (W(stretch + 1e-5, side) - W(stretch - 1e-5, side)) / 2e-5


@pytest.mark.parametrize("D1", [5.0, 150.0])
def test_between_sliding_plates_compression_is_homogeneous(D1):
    """The exact nominal stress times the area: quadratic elements hold a homogeneous state, so what is left is the
    edge, which slides off by no more than the curvature of a facet, and differences of W, 1e-5."""
    found = compressed("slip", "smooth", D1)
    exact = [-4.0 * HALF**2 * uniaxial(1.0 - u / HEIGHT, D1) for u in ASKED]
    np.testing.assert_allclose(found.channels["Fz"], exact, rtol=1e-4)
    np.testing.assert_allclose(found.channels["contact_area"], 4.0 * HALF**2, rtol=0.12)  # it widens by u/2h a side


def test_plates_that_hold_are_stiffer():
    """Held on one side, then on both; for a body that does not widen (nu = 0) all are alike at small strain."""
    F = {(c, k): compressed(c, k).channels["Fz"][0] for c in ("slip", "bonded") for k in ("smooth", "fixed")}
    assert F["slip", "smooth"] < F["bonded", "smooth"] < F["bonded", "fixed"]
    assert F["slip", "fixed"] == pytest.approx(F["bonded", "smooth"], rel=0.1)  # turned over; the mesh is finer on top
    G = [compressed(c, "fixed", 3.0 / MU, (0.003,)).channels["Fz"][0] for c in ("slip", "bonded")]
    assert G[1] == pytest.approx(G[0], rel=1e-4)


def test_what_is_glued_follows_the_plate_and_pulls():
    """Unloading goes back along the loading curve to nothing; with sliding contact, too, but the glue may also pull a
    body that relaxed; support and plate balance."""
    found = compressed("bonded", "fixed")
    np.testing.assert_allclose(found.info["reaction_Fz"], found.channels["Fz"], rtol=1e-6)
    np.testing.assert_allclose(found.channels["uz_max"], ASKED, rtol=1e-4)  # some 1e-5 go into the glue
    np.testing.assert_allclose(found.channels["contact_area"], 4.0 * HALF**2, rtol=1e-4)
    way = Programme((0.0, 1.0, 2.0), (0.0, 1.5, 0.0), (0.1,))
    relaxing = {"prony_g": 0.6, "prony_tau": 1.0}
    settings = {c: compressed_on(way, c, relaxing) for c in ("slip", "bonded")}
    assert settings["bonded"][-1] < 0.0 <= settings["slip"][-1]


def compressed_on(way: Programme, contact: str, values: dict[str, float]) -> np.ndarray:
    settings = {
        "specimen": {"shape": "brick", "half": HALF, "height": HEIGHT},
        "indenter": {"shape": "plate", "contact": contact},
        "support": {"kind": "fixed"},
        "mesh": {"level": "coarse"},
    }
    return BACKEND({"mu": MU, "D1": 5.0, **values}, Case("way", way, settings)).channels["Fz"]


def test_glue_under_a_weight_is_not_modelled():
    with pytest.raises(SimulationFailed, match="bonded indenter on a specimen that sags"):
        compressed("bonded", "fixed", weight=1e-5)
