"""Flat bodies in three dimensions against the same problem on a meridian: other elements, kinematics and assembly."""

from __future__ import annotations

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme, Response

pytestmark = pytest.mark.verification

R = 3.0
ASKED = (0.25 * R, 0.5 * R, 0.75 * R, R)
UNSEEN = {"fibre": 1e-9}  # of the modulus 1e-7: too little to change a force, enough to end the symmetry
BODIES = {
    "slab": {"shape": "slab", "thickness": 2 * R},
    "cylinder": {"shape": "cylinder", "radius": 10.0, "height": 2 * R},
    "cylinder with rounded edge": {"shape": "cylinder", "radius": 10.0, "height": 2 * R, "fillet": 1.0},
    "two layers": {"shape": "slab", "thickness": 2 * R, "layers": [{"thickness": 1.0, "ratio": 4.0}]},
}
CHANNELS = ("Fz", "contact_radius", "peak_pressure")


def answer(specimen: dict, level: str, values: dict, K_over_mu: float = 60.0, **table) -> Response:
    """A ball of 3 mm down to its radius."""
    settings = {"specimen": specimen, "indenter": {"radius": R}, "support": {"kind": "bonded"}, **table}
    settings |= {"mesh": {"level": level}, "derivatives": False}
    return BACKEND({"mu": 0.01, "D1": 200.0 / K_over_mu, **values}, Case("3d", Programme.ramp(ASKED, 1.0), settings))


def off(found: Response, fine: Response, name: str) -> np.ndarray:
    """Difference over what is stated for both, (k,)."""
    return np.abs(found.channels[name] - fine.channels[name]) / (found.error[name] + fine.error[name])


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("level", ["coarse", "standard"])
def test_three_dimensions_agree_with_the_meridian(record, name, level):
    """Within what both state; the force is too large, as that of a displacement element should be."""
    fine = answer(BODIES[name], "fine", {})
    found = answer(BODIES[name], level, UNSEEN)
    share = 100.0 * (found.channels["Fz"] / fine.channels["Fz"] - 1.0)
    stated = 100.0 * found.error["Fz"] / found.channels["Fz"]
    record(
        f"{name}, {level} in three dimensions ({found.info['nodes']} nodes of a quarter) beside the meridian, "
        "Fz at 0.25 to 1 R: difference (stated)",
        ", ".join(f"{a:+.2f} % ({b:.1f})" for a, b in zip(share, stated, strict=True)),
    )
    for channel in CHANNELS:
        assert np.all(off(found, fine, channel) < 1.0), channel
    assert np.all(share > -0.2)


def test_three_dimensions_converge_to_the_meridian(record):
    """Each level halves the error of the one before at least, down to the 0.1 % that the meridian itself may miss."""
    fine = answer(BODIES["slab"], "fine", {})
    levels = ("coarse", "standard", "fine")
    mean = [
        100 * float(np.mean(answer(BODIES["slab"], n, UNSEEN).channels["Fz"] / fine.channels["Fz"] - 1)) for n in levels
    ]
    record("slab in three dimensions beside the meridian, mean of Fz: " + ", ".join(levels), f"{np.round(mean, 2)} %")
    assert mean[1] < 0.5 * mean[0] and mean[2] < 0.5 * mean[1] + 0.1


@pytest.mark.parametrize("K_over_mu", [3.0, 1000.0])
def test_three_dimensions_agree_whatever_the_compressibility(record, K_over_mu):
    """Quadratic tetrahedra with four points lock a little near incompressibility: within what is stated."""
    fine = answer(BODIES["slab"], "fine", {}, K_over_mu)
    found = answer(BODIES["slab"], "standard", UNSEEN, K_over_mu)
    share = 100.0 * (found.channels["Fz"] / fine.channels["Fz"] - 1.0)
    record(
        f"slab, standard in three dimensions beside the meridian, K/mu = {K_over_mu:g}: Fz", f"{np.round(share, 2)} %"
    )
    assert np.all(off(found, fine, "Fz") < 1.0)


def test_beside_the_axis_levels_agree(record):
    """A puck touched at 0.7 of its radius: coarse beside fine, forces within what is stated."""
    found, fine = (answer(BODIES["cylinder"], n, {}, point=[7.0, 0.0]) for n in ("coarse", "fine"))
    difference = {n: 100 * (found.channels[n] - fine.channels[n])[-1] / fine.channels["Fz"][-1] for n in ("Fx", "Fz")}
    record(
        "puck at 0.7 of its radius, coarse beside fine at 1 R: Fx, Fz, of Fz",
        ", ".join(f"{v:+.2f} %" for v in difference.values()),
    )
    assert np.all(off(found, fine, "Fz") < 1.0) and np.all(off(found, fine, "Fx") < 1.0)


def test_a_wrong_thickness_is_not_within_what_is_stated():
    """The control: a tenth of the thickness is seen at the level standard from half the radius on."""
    fine = answer({"shape": "slab", "thickness": 1.8 * R}, "fine", {})
    found = answer(BODIES["slab"], "standard", UNSEEN)
    assert np.all(off(found, fine, "Fz")[1:] > 1.0)
