"""Displacements of points of the surface along all axes: beside a closed form, on a meridian and in space."""

from __future__ import annotations

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme


def pressed(profile, level="coarse", asked=(0.3, 0.6), values=None, **more):
    """Response to a ball of 3 mm."""
    settings = {"specimen": {"shape": "half_space"}, "mesh": {"level": level}, "profile": profile, **more}
    return BACKEND(values or {"mu": 0.01, "D1": 60.0}, Case("p", Programme.ramp(tuple(asked)), settings))


def test_a_half_space_moves_towards_the_load_as_boussinesq_says():
    """u_r = −(1 − 2ν) P/(4πG r), u_z = −(1 − ν) P/(2πG r) (Johnson 1985, eq. 3.22) at twice the radius of the ball.

    The contact radius is 0.2 r there and the strain there is small: 10 %.
    """
    mu, K = 0.01, 2.0 / 60.0
    nu = (3 * K - 2 * mu) / (2 * (3 * K + mu))
    c = pressed([[6, 0], [0, 6], [3.6, 4.8], [-6, 0]]).channels
    inward, down = (k * c["Fz"] / (4 * np.pi * mu * 6.0) for k in (-(1 - 2 * nu), -2 * (1 - nu)))
    np.testing.assert_allclose(c["ux(6,0)"], inward, rtol=0.1)
    np.testing.assert_allclose(c["uz(6,0)"], down, rtol=0.1)
    np.testing.assert_allclose(c["ux(-6,0)"], -c["ux(6,0)"], rtol=1e-9)
    np.testing.assert_allclose(c["uy(0,6)"], c["ux(6,0)"], rtol=1e-9)
    np.testing.assert_allclose(c["ux(3.6,4.8)"], 0.6 * c["ux(6,0)"], rtol=1e-6)
    np.testing.assert_allclose(c["uy(3.6,4.8)"], 0.8 * c["ux(6,0)"], rtol=1e-6)
    assert not c["uy(6,0)"].any()


def test_points_move_in_space_as_on_a_meridian():
    """The same body with a ball a thousandth of a millimetre beside the axis is modelled in space: within the stated
    errors of both."""
    places = [[4.0, 0.0], [0.0, -4.0], [3.0, 3.0]]
    body = {"specimen": {"shape": "cylinder", "radius": 10, "height": 6}, "support": {"kind": "bonded"}}
    flat = pressed(places, asked=(1.0,), **body)
    beside = pressed(places, asked=(1.0,), values={"mu": 0.01, "D1": 60.0, "offset_x": 0.001}, **body)
    for name in (n for n in flat.channels if n.startswith(("ux(", "uy(", "uz("))):
        off = np.abs(flat.channels[name] - beside.channels[name])
        assert (off <= 2.0 * (flat.error[name] + beside.error[name]) + 1e-3).all(), name
    assert beside.channels["ux(4,0)"][0] < 0.0 < beside.channels["uy(0,-4)"][0]


def test_horizontal_displacements_lie_within_their_stated_errors():
    """Standard beside fine, at points below the ball, beside it and far away."""
    places = [[0.2, 0], [1.5, 0], [3, 0], [6, 0], [6, 6]]
    rough, fine = (pressed(places, level) for level in ("standard", "fine"))
    for x, y in places:
        name = f"ux({x:g},{y:g})"
        assert (np.abs(rough.channels[name] - fine.channels[name]) <= rough.error[name] + fine.error[name]).all(), name


def test_slopes_of_horizontal_displacements_are_those_of_runs_beside():
    here, high, low = (pressed([[6, 0]], values={"mu": 0.01, "D1": d}) for d in (60.0, 61.0, 59.0))
    slope = (high.channels["ux(6,0)"] - low.channels["ux(6,0)"]) / 2.0
    np.testing.assert_allclose(here.gradients["D1"]["ux(6,0)"], slope, rtol=0.05)
    np.testing.assert_allclose(
        here.gradients["mu"]["ux(6,0)"] * 0.01, here.gradients["D1"]["ux(6,0)"] * 60.0, rtol=1e-3
    )  # displacements know mu D1 alone
