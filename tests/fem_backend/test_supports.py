"""Supports of flat specimens: a plate with friction, wells, a substrate that yields, a base that lifts off."""

from __future__ import annotations

import functools
import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from fem_backend.backend import BACKEND
from fem_backend.contact import tractions
from fem_backend.solver import newton
from fem_backend.supports.walls import Plane, Wall
from rso.cli.checking import check_lines
from rso.contract import Case, Programme, SimulationFailed, run_key
from rso.study.errors import StudyError
from rso.study.loader import load_study

SLAB = {"shape": "slab", "thickness": 6.0}
PUCK = {"shape": "cylinder", "radius": 10.0, "height": 5.0}
VALUES = {"mu": 0.01, "D1": 5.8}
WATER = 1e-5  # N/mm³


def case(support, specimen=SLAB, asked=(0.75, 1.5)):
    settings = {"specimen": specimen, "indenter": {"shape": "sphere", "radius": 3.0}, "support": support}
    return Case("support", Programme.ramp(tuple(asked)), {**settings, "mesh": {"level": "coarse"}})


@functools.cache
def _solved(support, specimen, asked, values):
    return BACKEND.solve({**VALUES, **json.loads(values)}, case(json.loads(support), json.loads(specimen), asked))


def solved(support, specimen=SLAB, asked=(0.75, 1.5), **values):
    return _solved(json.dumps(support), json.dumps(specimen), tuple(asked), json.dumps(values))


def force(*args, **kwargs):
    return solved(*args, **kwargs).result.Fz


def sag(*args, **kwargs):
    """How far (mm) the top on the axis sinks under the weight alone."""
    return solved(*args, **kwargs).result.notes["sag_mm"]


def plate(friction=0.0, **more):
    return {"kind": "plate", "friction": friction, **more}


# ------------------------------------------------------------------------------------------------------------ plates


def test_more_friction_is_stiffer_from_slip_to_bonded():
    """Work of friction is never given back: forces rise with it, and end at those of a bonded base."""
    each = [force(plate(f)) for f in (0.0, 0.1, 0.3, 1.0, 3.0)] + [force({"kind": "bonded"})]
    assert all(np.all(a < b) for a, b in itertools.pairwise(each))
    assert each[-1][1] > 1.15 * each[0][1]  # there is something between


@pytest.mark.parametrize("specimen", [SLAB, PUCK])
def test_plate_limits_are_slip_and_bonded(specimen):
    """f → 0: a force of 1e-6 times the normal one; f → ∞: sticking points give way by t/ε_T, 1e-4 of the thickness."""
    np.testing.assert_allclose(force(plate(1e-6), specimen), force(plate(), specimen), rtol=1e-5)
    np.testing.assert_allclose(force(plate(100.0), specimen), force({"kind": "bonded"}, specimen), rtol=3e-4)


def test_friction_on_the_plate_is_coulombs():
    """|t| ≤ f p at all points, both sticking and slipping ones, and none where the plate would have to pull."""
    run = solved(plate(1.0))
    seat = run.result.points[-1].evaluation.seat[0]
    t, p = np.linalg.norm(seat.traction, axis=-1), seat.pressure
    assert np.all(t <= 1.0 * np.maximum(p, 0.0) * (1.0 + 1e-9))
    assert (p < 0.0).any() and not t[p < 0.0].any()
    assert (t > 0.999 * p)[p > 0.0].any() and (t < 0.9 * p)[p > 0.0].any()
    assert np.all(np.abs(run.result.points[-1].evaluation.u[run.model.held, 2]) < 1e-6)  # mm: it stays in its plane


def test_friction_hardly_hangs_on_the_steps():
    """The same depth in 1 and in 12 steps: loading is nearly proportional, so that little of the way shows."""
    once, often = force(plate(0.3), asked=(1.5,)), force(plate(0.3), asked=np.linspace(0.125, 1.5, 12))
    assert abs(once[-1] / often[-1] - 1.0) < 5e-4


def test_what_rubs_takes_work():
    """On the way back the force is below that of loading; without friction it is the same."""
    back = Programme((0.0, 1.0, 2.0), (0.0, 1.5, 0.0), (0.75,))
    for support, loses in ((plate(0.5), True), (plate(), False)):
        F = BACKEND(VALUES, Case("back", back, case(support).settings)).channels["Fz"]
        there, again = (F[0], F[-1]) if len(F) > 1 else (F[0], F[0])
        assert (again < 0.999 * there) if loses else again == pytest.approx(there, rel=1e-9)


def test_a_plate_may_let_go():
    """Weightless, the base lifts off beside the contact and the force falls; the weight of water holds it there."""
    held, free = solved(plate()), solved(plate(lift=True))
    ratio = free.result.Fz / held.result.Fz
    assert np.all((0.98 < ratio) & (ratio < 0.999)) and ratio[1] < ratio[0]
    gap = free.result.points[-1].evaluation.seat[0].gap
    assert gap.max() > 1e-3 and free.result.points[-1].evaluation.seat[0].pressure.min() == 0.0
    heavy = force(plate(lift=True), weight=WATER) / force(plate(), weight=WATER)
    np.testing.assert_allclose(heavy, 1.0, atol=2e-5)  # grounding springs carry 1e-5


# ------------------------------------------------------------------------------------------------------------- wells


def oedometer(mu=0.01, D1=5.8):
    """M = K + 4μ/3 (MPa)."""
    return 2.0 / D1 + 4.0 * mu / 3.0


def test_a_column_in_a_slipping_well_settles_as_in_an_oedometer():
    """u = w h²/2M under its weight w; beside a wall with room it settles by more.  Small strain: 1e-3 of it here."""
    stuff, h, light = {"mu": 0.01, "D1": 40.0}, PUCK["height"], 1e-6
    exact = light * h**2 / (2.0 * oedometer(**stuff))
    slips = {"kind": "well", "base": "slip", "wall": "slip"}
    assert sag(slips, PUCK, weight=light, **stuff) == pytest.approx(exact, rel=1e-3)
    gap = {"kind": "well", "base": "slip", "wall": "gap", "radius": 11.0}
    assert sag(gap, PUCK, weight=light, **stuff) > 1.2 * exact


def test_a_very_wide_well_is_a_slab():
    """Beyond five thicknesses a wall has no share on a bonded base; grids differ by 0.2 %, and a narrow one is felt."""
    wide = force({"kind": "well", "radius": 60.0})
    np.testing.assert_allclose(wide, force({"kind": "bonded"}), rtol=4e-3)
    assert np.all(force({"kind": "well", "radius": 6.0}) > 1.1 * wide)


def test_a_gap_that_never_closes_is_a_free_side():
    asked = (1.0, 2.0)
    free = force({"kind": "bonded"}, PUCK, asked)
    well = {"kind": "well", "wall": "gap"}
    np.testing.assert_allclose(force({**well, "radius": 11.0}, PUCK, asked), free, rtol=1e-9)
    closing = solved({**well, "radius": 10.05}, PUCK, asked)
    state = closing.result.points[-1].evaluation
    assert closing.result.Fz[1] > 1.005 * free[1]
    out = (PUCK["radius"] + state.u[:, 0])[closing.model.body.nodes[:, 0] > 9.999]
    assert 10.04 < out.max() < 10.0501  # it is stopped at the wall: multipliers leave 1e-4 mm


def test_walls_stiffen_in_order():
    """Free, may come off, slips, rubs, bonded; and a bonded base is stiffer than one that slips."""
    well = {"kind": "well", "radius": 5.0}
    gap, slip, rubs, bonded = (
        force({**well, **more})
        for more in ({"wall": "gap"}, {"wall": "slip"}, {"wall": "slip", "friction": 0.2}, {"wall": "bonded"})
    )
    assert np.all(gap <= slip * (1.0 + 1e-6)) and np.all(slip < 0.999 * rubs) and np.all(rubs < 0.99 * bonded)
    assert np.all(force({**well, "base": "slip"}) < slip)


@pytest.mark.parametrize(
    ("specimen", "wall"), [(SLAB, "slip"), (SLAB, "bonded"), (SLAB, "gap"), (PUCK, "gap")], ids=str
)
def test_the_error_of_a_well_is_another_well(specimen, wall):
    """What is cast in it is as wide; a puck keeps its width and has more room.  Grids differ: stated errors count."""
    radius = 10.3 if specimen is PUCK else 6.0
    well = {"kind": "well", "wall": wall, "radius": radius}
    for off in (-0.25, 0.25):
        moved = BACKEND(VALUES | {"delta_well": off}, case({**well, "radius": radius - off}, specimen))
        wanted = BACKEND(VALUES, case(well, specimen))
        left = np.abs(moved.channels["Fz"] - wanted.channels["Fz"])
        assert np.all(left <= moved.error["Fz"] + wanted.error["Fz"])
    felt = force({**well, "radius": radius - 0.25}, specimen) / force(well, specimen) - 1.0
    assert felt[1] > 5e-3  # a quarter of a millimetre is felt


def test_the_error_of_a_well_counts_where_it_has_a_radius_of_its_own():
    def key(support, specimen=SLAB, **values):
        return BACKEND.canonical({**VALUES, **values}, case(support, specimen))

    for support in ({"kind": "well", "radius": 6.0}, {"kind": "well", "radius": 6.0, "wall": "gap"}):
        assert key(support, delta_well=0.1) != key(support)
        low, high = BACKEND.plausible({"specimen": SLAB, "support": support}).get("delta_well", (-0.3, 0.3))
        assert low == -high
    for support in ({"kind": "well"}, {"kind": "well", "radius": 10.0}, {"kind": "well", "wall": "gap"}):
        assert key(support, PUCK, delta_well=0.1) == key(support, PUCK)
        assert BACKEND.plausible({"specimen": PUCK, "support": support})["delta_well"] is None
    with pytest.raises(SimulationFailed, match=r"delta_well = -0\.4 mm: the specimen, of radius 10 mm, is wider"):
        BACKEND(VALUES | {"delta_well": -0.4}, case({"kind": "well", "radius": 10.2, "wall": "gap"}, PUCK))
    with pytest.raises(SimulationFailed, match="delta_well = -5 mm: a well of radius 1 mm"):
        BACKEND(VALUES | {"delta_well": -5.0}, case({"kind": "well", "radius": 6.0}))


def test_no_closed_form_has_the_wall_of_a_well():
    """Beside four thicknesses and the ball it counts for less than 0.1 %: there the formulas of a layer hold again."""
    slab, ball = {"shape": "slab", "thickness": 3.0}, {"shape": "sphere", "radius": 3.0}
    asked = Programme.ramp((0.1, 0.9))

    def reasons(radius):
        well = {"kind": "well", "radius": radius, "wall": "bonded"}
        found = BACKEND.formulas(
            {"mu": 0.01, "D1": 0.2}, Case("a", asked, {"specimen": slab, "indenter": ball, "support": well})
        )
        return [f.invalid[0] for f in found]

    assert all("the wall of the well, 7.5 mm from the axis" in why for why in reasons(7.5))
    assert not any("wall" in why for why in reasons(15.5))
    far, bonded = ({"kind": "well", "radius": 15.5, "wall": "bonded"}, {"kind": "bonded"})
    assert force(far, slab, (0.1, 0.9)) == pytest.approx(force(bonded, slab, (0.1, 0.9)), rel=2e-3)  # two grids
    u = np.linspace(0.0, 0.5, 21)
    settings = {"specimen": slab, "indenter": ball, "support": {"kind": "well", "radius": 4.0}}
    told = BACKEND.first_parameters(settings, u, 0.05 * u**1.5)["mu"]
    plain = BACKEND.first_parameters({**settings, "support": {"kind": "bonded"}}, u, 0.05 * u**1.5)["mu"]
    assert "the wall of the well makes that too much" in told.remark and "wall" not in plain.remark
    assert float(told.value["low"].split()[0]) < 0.4 * float(plain.value["low"].split()[0])


# ------------------------------------------------------------------------------------------------- yielding substrate


def test_a_yielding_substrate_sinks_by_its_compliance():
    """Under its weight a bonded slab sinks by c w h more on a compliance c, and a softer one gives less force.

    The pressure below is w h far from the edge, whose elements are so large that they miss 6e-5.
    """
    h, light, c = SLAB["thickness"], 1e-6, 20.0
    more = sag({"kind": "bonded"}, weight=light, substrate_compliance=c) - sag({"kind": "bonded"}, weight=light)
    assert more == pytest.approx(c * light * h, rel=3e-4)
    for support in ({"kind": "bonded"}, plate()):
        stiff = force(support)
        np.testing.assert_allclose(force(support, substrate_compliance=1e-6), stiff, rtol=1e-5)
        softer = [force(support, substrate_compliance=c) for c in (1.0, 10.0)]
        assert np.all(softer[1] < softer[0]) and np.all(softer[0] < stiff)


# ---------------------------------------------------------------------------------------------------------- balances


@pytest.mark.parametrize(
    ("support", "compliance"),
    [
        ({"kind": "bonded"}, 0.0),
        ({"kind": "bonded"}, 10.0),
        (plate(), 0.0),
        (plate(), 10.0),
        (plate(0.3), 0.0),
        (plate(0.3), 10.0),
        ({"kind": "well", "friction": 0.3}, 0.0),
        ({"kind": "well", "base": "slip", "wall": "bonded"}, 0.0),
        ({"kind": "well", "base": "slip", "wall": "gap", "radius": 10.02, "friction": 0.1}, 0.0),
    ],
)
def test_the_support_carries_force_and_weight(support, compliance):
    """To the residual, 1e-9 of the forces; the grid of a straight cylinder has its volume."""
    result = solved(support, PUCK, weight=WATER, substrate_compliance=compliance).result
    weight = WATER * np.pi * PUCK["radius"] ** 2 * PUCK["height"]
    np.testing.assert_allclose(result.reaction[:, 2], result.Fz + weight, rtol=1e-7)


# ---------------------------------------------------------------------------------------------------- rigid surfaces


@pytest.mark.parametrize("rigid", [Plane(0.3), Wall(2.0)])
def test_gap_normal_and_hessian_agree(rigid):
    """Central differences of the gap and of its gradient, in space; their error is h²."""
    x, h = np.random.default_rng(5).uniform(-1.5, 1.5, (40, 3)), 1e-5
    _, n, H = rigid.gap(x)
    for k, e in enumerate(np.eye(3)):
        high, low = rigid.gap(x + h * e), rigid.gap(x - h * e)
        np.testing.assert_allclose((high[0] - low[0]) / (2 * h), n[:, k], atol=1e-8)
        np.testing.assert_allclose((high[1] - low[1]) / (2 * h), H[..., k], atol=1e-6)
    assert np.all(rigid.gap(np.array([[0.1, 0.0, 1.0]]))[0] > 0.0)  # inside is free


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_tangent_of_a_contact_that_holds_on(friction):
    """K d against differences of the residual, of pressing, pulling, sticking and slipping points alike.

    Over 1e-10 mm no point changes from one to another; round-off of positions of 10 mm leaves 1e-6.
    """
    run = solved(plate(0.3))
    body, point = run.result.system.body, run.result.points[-1]
    pair, load = replace(run.result.system.seat[0], friction=friction), point.load.seat[0]
    x, d, size = body.nodes + point.evaluation.u, np.zeros_like(body.nodes), 1e-10
    d[:, [0, 2]] = np.random.default_rng(2).standard_normal((len(d), 2))
    d = newton.full(body, newton.reduced(body, d))
    state = tractions.evaluate_contact(pair, x, load)
    assert (state.pressure < 0.0).any() and (state.pressure > 0.0).any()
    assert friction == 0.0 or 0.2 < state.slipping.mean() < 0.9
    data = np.zeros(len(body.pattern.indices))
    tractions.add_contact_tangent(pair, x, load, state, data)
    high, low = (tractions.evaluate_contact(pair, x + s * size * d, load).residual for s in (1.0, -1.0))
    slope = newton.reduced(body, (high - low) / (2.0 * size))
    K = csr_matrix((data, body.pattern.indices, body.pattern.indptr), shape=(body.pattern.size,) * 2)
    assert np.linalg.norm(K @ newton.reduced(body, d) - slope) < 1e-6 * np.linalg.norm(slope)


# ------------------------------------------------------------------------------------- settings, keys and a diagnosis


@pytest.mark.parametrize(
    ("support", "specimen", "said"),
    [
        ({"kind": "plate", "friction": -0.1}, SLAB, "support.friction = -0.1: must be >= 0"),
        ({"kind": "plate", "lift": 1}, SLAB, "support.lift = 1: true or false is expected"),
        ({"kind": "plate", "wall": "slip"}, SLAB, "support.wall = 'slip': unknown; choose from kind, friction, lift"),
        ({"kind": "well", "wall": "slips"}, SLAB, "support.wall = 'slips' is not modelled; did you mean 'slip'"),
        ({"kind": "well", "base": "gap"}, SLAB, "support.base = 'gap' is not modelled; choose from bonded, slip"),
        ({"kind": "well", "radius": 0}, SLAB, "support.radius = 0.0 mm: must be positive"),
        ({"kind": "well"}, SLAB, "support.radius: a slab has no width of its own"),
        ({"kind": "well", "radius": 9.0}, PUCK, "support.radius = 9 mm: the specimen, of radius 10 mm, is wider"),
        ({"kind": "well", "radius": 12.0}, PUCK, 'leave the radius out, or take wall = "gap"'),
        ({"kind": "well", "radius": 4.0}, {"shape": "half_space"}, "a half_space is not"),
        ({"kind": "well", "radius": 80.0}, {}, "a ellipsoid has no flat base"),
        ({"kind": "plate"}, {}, "a ellipsoid has no flat base"),
        ({"kind": "well", "radius": 5.0, "wall": "bonded", "friction": 0.1}, SLAB, "support.friction = 0.1: nothing"),
        ({"kind": "bowl"}, SLAB, "there is none of a slab"),
    ],
)
def test_refusals_name_key_value_and_choices(support, specimen, said):
    with pytest.raises(ValueError) as refused:
        BACKEND.check(case(support, specimen))
    assert said in str(refused.value)


def test_keys():
    """A friction in the table or as a value is one task; knobs of other supports and neutral ones are in no key."""

    def key(support, **values):
        return run_key(BACKEND, *BACKEND.canonical({**VALUES, **values}, case(support)))

    assert key(plate(0.3)) == key(plate(), plate_friction=0.3) != key(plate())
    assert key({"kind": "bonded"}) == key({"kind": "bonded"}, plate_friction=0.3, substrate_compliance=0.0)
    assert key({"kind": "bonded"}) != key({"kind": "bonded"}, substrate_compliance=1.0)
    assert key({"kind": "fixed"}) == key({"kind": "fixed"}, substrate_compliance=1.0)
    wells = [key({"kind": "well", "radius": r, **more}) for r in (5.0, 6.0) for more in ({}, {"base": "slip"})]
    assert len(set(wells)) == 4
    values, at = BACKEND.canonical(VALUES, case({"kind": "well", "radius": 5.0}))
    assert BACKEND.canonical(values, at) == (values, at)


def test_a_well_gives_a_slab_places():
    """A slab without end is alike everywhere, one in a well is not."""
    with pytest.raises(ValueError, match="beside the flat top"):
        BACKEND.check(Case("beside", Programme.ramp((1.0,)), {**case({"kind": "well", "radius": 5.0}).settings,
                                                              "point": [5.5, 0.0]}))  # fmt: skip
    BACKEND.check(Case("beside", Programme.ramp((1.0,)), {**case(plate()).settings, "point": [5.5, 0.0]}))


def test_a_diagnosis_may_try_a_plate():
    def found(kind, specimen=SLAB):
        return BACKEND.variants(case({"kind": kind}, specimen).settings)

    assert set(found("bonded")) == {"plate"} and set(found("plate")) == {"bonded"}
    assert found("bonded")["plate"]["group"] == "plate"
    assert found("bonded")["plate"]["description"] == "on a plate, where it slides instead of bonded to a stiff base"
    assert set(found("fixed", {})) == {"bowl"} and set(found("bowl", {})) == {"held"}
    assert "substrate_compliance" not in BACKEND.plausible(case({"kind": "bonded"}).settings)
    assert BACKEND.plausible(case({"kind": "fixed"}).settings)["substrate_compliance"] is None
    assert BACKEND.nominal(case(plate(0.3)).settings) == {"plate_friction": 0.3}


STUDY = """
[study]
title = "A slab on a plate"
seed = 1
[backend]
use = "fem_backend.backend:BACKEND"
[backend.settings]
specimen = {{ shape = "slab", thickness = 6.0 }}
support = {{ kind = "plate", friction = {friction} }}
[parameters]
mu = {{ low = "6 kPa", high = "20 kPa" }}
D1 = {{ value = 4.0 }}
plate_friction = {{ low = 0.0, high = 1.0 }}
[[experiments]]
name = "middle"
role = "fit"
data = "middle.csv"
noise = {{ Fz = "0.2 mN", contact = "0 mm" }}
"""


def test_a_study_may_open_the_friction(tmp_path):
    depth = np.linspace(0.0, 1.5, 16)
    rows = "\n".join(f"{d:.4f},{0.12 * d**1.5:.6f}" for d in depth)
    (tmp_path / "middle.csv").write_text(f"depth_mm,Fz_N\n{rows}\n")
    (tmp_path / "study.toml").write_text(STUDY.format(friction=0.2))
    said = "\n".join(check_lines(load_study(tmp_path / "study.toml"), tmp_path / "results", False))
    assert "plate_friction: 0 to 1" in said and 'support.kind = "plate"' in said
    (tmp_path / "study.toml").write_text(STUDY.format(friction=-0.2))
    with pytest.raises(StudyError, match=r"support\.friction = -0\.2: must be >= 0"):
        check_lines(load_study(tmp_path / "study.toml"), tmp_path / "results", False)
