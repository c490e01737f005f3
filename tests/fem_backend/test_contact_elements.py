"""Elements below a ball or a tip that is hardly pressed in: a contact much smaller than it is resolved, too."""

import numpy as np
import pytest

from fem_backend import meshing
from fem_backend.accuracy import two_grid
from fem_backend.backend import BACKEND
from fem_backend.indenters.sphere import Sphere
from fem_backend.simulation import assembly, contact_elements
from fem_backend.simulation.experiment import read_settings
from rso.contract import Case, Programme, Segment

R, MU, K = 3.0, 0.01, 2.0
LIGHT = {"support": {"kind": "bonded"}, "mesh": {"level": "coarse"}}
SHARES = np.array([0.25, 0.5, 1.0])  # of the deepest travel


def pressed(specimen, depth, level, law="neo_hookean"):
    """Response (channels of three depths) of a bonded body under a ball."""
    settings = {
        "material": {"law": law},
        "specimen": specimen,
        "indenter": {"shape": "sphere", "radius": R},
        "support": {"kind": "bonded"},
        "mesh": {"level": level},
    }
    case = Case("ball", Programme.ramp(tuple(depth * SHARES), 1.0), settings)
    return BACKEND(*BACKEND.canonical({"mu": MU, "D1": 2.0 / K}, case))


@pytest.mark.parametrize("depth", [0.001, 0.01, 0.05])
def test_a_ball_that_is_hardly_pressed_in_has_the_force_of_hertz(depth):
    """F = 4/3 E/(1 − ν²) √R δ^1.5; with elements of the size of R/20 it was 7 to 50 % more on the level coarse."""
    E, nu = 9.0 * K * MU / (3.0 * K + MU), (3.0 * K - 2.0 * MU) / (2.0 * (3.0 * K + MU))
    u = depth * R * SHARES
    found = pressed({"shape": "half_space"}, depth * R, "coarse", "linear_elastic").channels["Fz"]
    hertz = 4.0 / 3.0 * E / (1.0 - nu**2) * R**0.5 * u**1.5
    # Hertz's paraboloid and small slopes are right to 0.3 δ/R: the level reference has 0.1, 0.6 and 1.0 % less at
    # 0.01, 0.03 and 0.05 R; coarse misses 2 % of a contact half as wide as the deepest, and 0.5 % of that
    np.testing.assert_allclose(found, hertz, rtol=0.02 + 0.3 * depth)
    assert abs(found[-1] / hertz[-1] - 1.0) < 0.006 + 0.3 * depth


@pytest.mark.parametrize("depth", [0.01, pytest.param(0.002, marks=pytest.mark.verification)])
def test_in_space_a_ball_that_is_hardly_pressed_in_has_the_contact_of_the_meridian(depth):
    """A block beside a puck that is as wide: the sides, 20 contact radii away and more, make them unlike by 0.1 %.

    Elements of R/3 made the force 6 to 29 % more on the level standard, and the contact radius was nought.
    """
    block, puck = {"shape": "block", "size": [40.0, 40.0, 9.0]}, {"shape": "cylinder", "radius": 20.0, "height": 9.0}
    found, best = pressed(block, depth * R, "coarse"), pressed(puck, depth * R, "reference")
    for name, most in (
        ("Fz", 0.03),
        ("contact_radius", 0.09),
        ("peak_pressure", 0.06),
    ):  # coarse has 3 elements along a
        off = np.abs(found.channels[name] - best.channels[name])
        assert np.all(off < found.error[name]) and np.all(off < most * best.channels[name]), name
    assert found.error["Fz"][-1] < 0.1 * best.channels["Fz"][-1]


@pytest.mark.parametrize("depth", [0.01, 0.1])
def test_what_is_stated_covers_what_a_fine_mesh_shows_and_is_of_use(depth):
    slab = {"shape": "slab", "thickness": 3.0 * R}
    r, best = pressed(slab, depth * R, "standard"), pressed(slab, depth * R, "reference")
    off = np.abs(r.channels["Fz"] - best.channels["Fz"])
    assert np.all(off < r.error["Fz"])
    assert r.error["Fz"][-1] < 0.01 * r.channels["Fz"][-1]  # it was 7 and 1.4 %


@pytest.mark.parametrize("depth", [0.03, pytest.param(0.3, marks=pytest.mark.verification)])
def test_a_tip_that_is_hardly_pressed_in_is_resolved(depth):
    """Of the radius of the tip; forces were 3 to 99 % too large, where 11 to 142 % were stated."""
    tip = {"indenter": {"shape": "cone", "half_angle": 60.0, "tip_radius": 1.0}, "support": {"kind": "bonded"}}

    def run(level):
        settings = {"specimen": {"shape": "slab", "thickness": 9.0}, **tip, "mesh": {"level": level}}
        case = Case("tip", Programme.ramp(tuple(depth * SHARES), 1.0), settings)
        return BACKEND(*BACKEND.canonical({"mu": MU, "D1": 2.0 / K}, case))

    r, best = run("standard"), run("reference")
    assert np.all(np.abs(r.channels["Fz"] - best.channels["Fz"]) < r.error["Fz"])
    assert np.all(r.error["Fz"] < 0.015 * r.channels["Fz"])


def test_where_a_small_force_leads_another_mesh_asks_that_force():
    """It was 2 % less far on the level standard, where 12 % were stated."""
    force, slab = 2e-4, {"shape": "slab", "thickness": 3.0 * R}
    settings = {"specimen": slab, "indenter": {"shape": "sphere", "radius": R}, "support": {"kind": "bonded"}}
    held = Programme(segments=(Segment("force", rate=force, to_N=force),), asked_N=(force,))
    case = Case("held", held, {**settings, "mesh": {"level": "standard"}})
    found = BACKEND(*BACKEND.canonical({"mu": MU, "D1": 2.0 / K}, case))
    travel = found.channels["travel"][-1]
    assert found.error["travel"][-1] < 0.005 * travel
    best = pressed(slab, travel, "reference").channels["Fz"][-1]
    assert best == pytest.approx(force, rel=1.5 * float(found.error["travel"][-1]) / travel + 1e-3)  # F grows as δ^1.5


@pytest.mark.verification  # 9 s; daily a force has the key of such a mesh: test_experiment.py
def test_where_a_small_force_leads_in_space_is_where_it_leads_on_the_meridian():
    """A block beside a puck; with elements of R/3 the ball came 33 % less far, where 170 % were stated."""
    force = 2e-4
    held = Programme(segments=(Segment("force", rate=force, to_N=force),), asked_N=(force,))

    def travel(body, level):
        settings = {"specimen": body, "indenter": {"shape": "sphere", "radius": R}, "support": {"kind": "bonded"}}
        case = Case("held", held, {**settings, "mesh": {"level": level}})
        found = BACKEND(*BACKEND.canonical({"mu": MU, "D1": 2.0 / K}, case))
        return found.channels["travel"][-1], found.error["travel"][-1]

    block, puck = {"shape": "block", "size": [40.0, 40.0, 9.0]}, {"shape": "cylinder", "radius": 20.0, "height": 9.0}
    (s, error), (best, _) = travel(block, "coarse"), travel(puck, "standard")
    assert abs(s - best) < error < 0.1 * s and abs(s - best) < 0.03 * best


def test_only_a_small_contact_that_begins_in_a_point_asks_for_other_elements():
    def settings(indenter):
        return read_settings(
            {"specimen": {"shape": "slab", "thickness": 9.0}, "indenter": indenter, "support": {"kind": "bonded"}}
        )

    ball = settings({"shape": "sphere", "radius": R})
    assert contact_elements.shallow(ball, 0.3 * R) is ball and contact_elements.shallow(ball, 0.0) is ball
    h, radius = contact_elements.shallow(ball, 0.1 * R).fine
    a = np.sqrt(0.1) * R
    assert h <= a / contact_elements.N_ELEMENTS_PER_SMALL_CONTACT < 2.0**0.5 * h and a < radius
    assert contact_elements.shallow(ball, 0.101 * R).fine == (h, radius)  # like runs share a grid
    flat = settings({"shape": "flat", "radius": R, "fillet": 0.3})
    assert contact_elements.shallow(flat, 0.1) is flat
    cone = settings({"shape": "cone", "half_angle": 60.0, "tip_radius": 0.3})
    assert contact_elements.shallow(cone, 3.0) is cone and contact_elements.shallow(cone, 0.1).fine is not None


def test_a_grid_of_a_small_contact_is_checked_on_one_of_the_same_contact():
    """A level below has a third to two thirds of the nodes; one for the whole ball had the contact in an element."""
    thin = {"specimen": {"shape": "slab", "thickness": 0.5}, "indenter": {"shape": "sphere", "radius": R}}
    for level, coarser in (("standard", meshing.CRUDE_LEVEL), ("fine", "coarse")):
        own = contact_elements.shallow_in_space(read_settings({**thin, "mesh": {"level": level}}), 0.32)
        other = two_grid.rougher_mesh(own)
        assert meshing.graded_for(other.recipe) == meshing.graded_for(own.recipe) < R
        assert other.level == coarser


@pytest.mark.parametrize("depth,known", [(2.1, False), (0.05, True)])
def test_only_a_grid_of_a_small_contact_says_how_wide_that_is(monkeypatch, depth, known):
    """Edges are fitted as before where the grid is the indenter's own, also where the actual ball is larger."""
    widths = []

    def seen(self, *arguments):
        widths.append(arguments[-1])
        return of_sphere(self, *arguments)

    of_sphere = Sphere.patch
    monkeypatch.setattr(Sphere, "patch", seen)
    block = {"shape": "block", "size": [20.0, 20.0, 6.0]}
    settings = {"specimen": block, "indenter": {"shape": "sphere", "radius": 2.0}, **LIGHT}
    case = Case("ball", Programme.ramp((depth,), 1.0), settings)
    BACKEND(*BACKEND.canonical({"mu": MU, "D1": 2.0 / K, "delta_R": 0.2}, case))
    assert {np.isfinite(w) for w in widths} == {known}


OWN = {"thickness": 0.3, "material": {"law": "yeoh"}}


@pytest.mark.parametrize(
    "top,layer,firm",
    [
        ({"layer_ratio": 40.0}, {}, 40.0),
        ({"layer_ratio": 0.1}, {}, 1.0),
        ({"layer_mu": 0.3, "layer_D1": 1.0}, OWN, 30.0),
    ],
)
def test_a_ball_does_not_go_through_a_stiff_layer(top, layer, firm):
    """Its lowest point touches: the surface moves as far as it does; a third of that was missing under 40."""
    block = {"shape": "block", "size": [2.0, 2.0, 1.5], "layers": [layer or {"thickness": 0.3, "ratio": 1.0}]}
    settings = {"specimen": block, "indenter": {"shape": "sphere", "radius": 2.0}, "derivatives": False, **LIGHT}
    case = Case("ball", Programme.ramp((0.02,), 1.0), settings)
    solved = BACKEND.solve(*BACKEND.canonical({"mu": MU, "D1": 2.0 / K, **top}, case))
    assert solved.result.channels["uz_max"][0] == pytest.approx(0.02, rel=0.01)
    ratio = solved.system.pressing.epsilon * 2.0 / (assembly.BODY_PENALTY_RATIO * MU)
    np.testing.assert_allclose(ratio, firm, rtol=1e-12)
