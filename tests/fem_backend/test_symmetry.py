"""What must not change an answer, and what must only change its sign: symmetry, turning, effects that are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fem_backend import meshing
from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly
from fem_backend.specimens.ellipsoid import Ellipsoid
from rso.contract import Case, Programme

SMALL = {"mesher": "mapped", "n": 6, "slip": 0.3}
slow = pytest.mark.verification  # whole bodies with a history; the same property is seen on a quicker case every time
VALUES = {"mu": 0.01, "D1": 5.8}
CHANNELS = ("Fx", "Fy", "Fz", "uz_max", "bulge", "peak_pressure", "slipping")


def force(result) -> np.ndarray:
    """Forces (3, k) N."""
    return np.array([result.channels[k] for k in ("Fx", "Fy", "Fz")])


# ---------------------------------------------------------------------------------------------- quarter, half, whole


@pytest.mark.parametrize(
    "knobs,table",
    [
        pytest.param({}, {}, id="plain"),
        pytest.param({"friction": 0.3}, {}, id="friction", marks=slow),
        pytest.param(
            {"prony_g": 0.4, "prony_tau": 1.0, "mullins": 0.3, "skin_ratio": 2.0}, {}, id="memory", marks=slow
        ),
        pytest.param({"fibre": 5e-3, "weight": 1e-5, "cavity": 1.0}, {}, id="fibre and weight"),
        pytest.param({"bowl_friction": 0.0}, {"support": {"kind": "bowl", "clearance": 0.5}}, id="bowl", marks=slow),
    ],
)
def test_quarter_half_and_whole_are_one_body(make_bench, knobs, table):
    """Symmetric loads: the parts of the body give the forces of the whole of it.

    To the tolerance of equilibrium: 1e-9 where it stands alone, but bodies with a history go through states converged
    to 1e-4 and those with weight start from a sag converged to 1e-6.
    """
    quarter = make_bench(knobs, **table)
    assert quarter.placement.planes == (True, True)
    answers = []
    for planes in ((True, True), (True, False), (False, False)):
        placement = replace(quarter.placement, planes=planes)
        built = assembly.model_for(quarter.settings, quarter.knobs, placement, None)
        answers.append(replace(quarter, placement=placement, model=built).solve([1.0]))
    exact = not (knobs.get("prony_g") or knobs.get("weight") or knobs.get("friction"))
    first = answers[0]
    for other in answers[1:]:
        size = np.abs(first.Fz).max()
        np.testing.assert_allclose(force(other), force(first), rtol=0, atol=(1e-8 if exact else 1e-6) * size)
        for name in ("uz_max", "bulge", "peak_pressure", "slipping"):
            np.testing.assert_allclose(other.channels[name], first.channels[name], rtol=2e-6, atol=1e-7, err_msg=name)
    np.testing.assert_array_equal(first.channels["Fx"], 0.0)  # by symmetry, not by round-off


def test_the_parts_are_parts(make_bench):
    """Negative control: the whole body has four times the volume of the quarter."""
    b = make_bench()
    whole = assembly.model_for(b.settings, b.knobs, replace(b.placement, planes=(False, False)), None)
    np.testing.assert_allclose(whole.body.w.sum(), 4 * b.model.body.w.sum(), rtol=1e-12)


# ---------------------------------------------------------------------------------------------- turned


@pytest.mark.parametrize(
    "knobs",
    [
        pytest.param({}, id="plain", marks=slow),
        pytest.param({"friction": 0.3}, id="friction", marks=slow),
        pytest.param({"fibre": 5e-3, "fibre_angle": 20.0}, id="fibre"),
        pytest.param({"tilt_x": 3.0}, id="tilt", marks=slow),
    ],
)
def test_body_turned_by_ninety_degrees_gives_turned_forces(make_bench, knobs):
    """(x, y) → (−y, x): semi-axes swapped, point, fibres and tilts turned; on the turned mesh the same to round-off."""
    point, table = (6.0, 4.0), {"direction": "normal"}
    one = make_bench(knobs, point=list(point), **table)
    turned = dict(knobs)
    if "fibre" in knobs:
        turned["fibre_angle"] = knobs["fibre_angle"] + 90.0
    if "tilt_x" in knobs:
        turned = {"tilt_y": turned.pop("tilt_x")}
    axes = one.settings.specimen.semi_axes[[1, 0, 2]]
    two = make_bench(turned, point=[-point[1], point[0]], specimen={"semi_axes": axes.tolist()}, **table)
    quarter = meshing.make_mesh(one.settings.recipe)
    mesh = meshing.Mesh(quarter.vertices[:, [1, 0, 2]], quarter.tets[:, [0, 2, 1, 3]])
    fine = replace(two.settings, point=assembly.fine_at(two.settings, two.knobs, two.placement))
    built = assembly.build_model(fine, mesh, Ellipsoid(*axes), two.placement.planes, not knobs.get("friction"))
    a, b = force(one.solve([1.0])), force(replace(two, model=built).solve([1.0]))
    np.testing.assert_allclose(b, [-a[1], a[0], a[2]], rtol=0, atol=1e-7 * np.abs(a).max())
    assert np.all(np.abs(a[:2]) > 1e-3 * np.abs(a).max())  # off the top there is something to turn
    assert np.abs(b - a).max() > 1e-3 * np.abs(a).max()  # negative control


# ---------------------------------------------------------------------------------------------- signs


GRADED = {"mesher": "mapped", "n": 8, "slip": 0.5}  # on the small mesh a contact within an element feels no slope


@pytest.mark.parametrize(
    "knob,size,odd,table",
    [
        ("offset_x", 1.5, "Fx", {}),
        pytest.param("offset_y", 1.0, "Fy", {}, marks=slow),
        pytest.param("tilt_y", 4.0, "Fx", {}, marks=slow),
        # round about x it would be the same body
        pytest.param("tilt_x", 4.0, "Fy", {"specimen": {"semi_axes": [60.0, 45.0, 35.0]}}, marks=slow),
        pytest.param(
            "offset_x", 1.5, "Fx", {"support": {"kind": "bowl", "clearance": 0.5, "friction": 0.0}}, marks=slow
        ),
    ],
)
def test_misalignment_changes_the_sign_of_the_sideways_force_only(make_bench, knob, size, odd, table):
    plus, minus = (make_bench({knob: s * size}, GRADED, **table).solve([0.8]).channels for s in (1, -1))
    size = abs(plus["Fz"][0])
    for name in CHANNELS:
        sign = -1.0 if name == odd else 1.0
        np.testing.assert_allclose(minus[name], sign * plus[name], rtol=1e-6, atol=1e-7 * size, err_msg=name)
    assert abs(plus[odd][0]) > 1e-3 * size
    assert plus[{"Fx": "Fy", "Fy": "Fx"}[odd]][0] == 0.0  # the other plane of symmetry is left


@pytest.mark.parametrize("knob", [pytest.param("offset_x", marks=pytest.mark.verification), "tilt_y"])
def test_force_has_no_jumps_in_the_misalignment(make_bench, knob):
    """Second differences at steps of a thousandth: facets that come into reach bring no jump, nor do moving elements.

    How the mesh shows in a wider range is for finer meshes (verification set).
    """
    x = np.linspace(0.4, 0.402, 3)
    F = np.array([force(make_bench({knob: v}, GRADED).solve([0.8]))[:, 0] for v in x])
    assert np.abs(np.diff(F, 2, axis=0)).max() < 1e-7 * F[0, 2], np.diff(F, 2, axis=0) / F[0, 2]
    assert np.abs(np.diff(F, axis=0)).max() > 1e-6 * F[0, 2]  # negative control: first differences are seen


@pytest.mark.verification
def test_a_misaligned_ball_meets_elements_as_fine_as_one_that_was_asked_there(make_bench):
    """Misaligned by 5 mm and asked for at 5 mm is one experiment; so is a tilt and the same path seen by the body.

    The fine elements go with the first contact, up-slope of the asked point by less than an element.  Held at the asked
    point they missed half of Fx.
    """
    coarse = {"level": "coarse"}
    at, off = make_bench(mesh=coarse, point=[5.0, 0.0]), make_bench({"offset_x": 5.0}, coarse)
    a, b = force(at.solve([2.0]))[:, 0], force(off.solve([2.0]))[:, 0]
    # elements lie otherwise under the ball by a tenth of their size: some per cent of Fx, 0.1 % of Fz
    np.testing.assert_allclose(b, a, rtol=4e-2, atol=1e-12 * a[2])
    np.testing.assert_allclose(b[2], a[2], rtol=2e-3)
    np.testing.assert_allclose(assembly.fine_at(off.settings, off.knobs, off.placement), [5.0, 0.0], atol=0.5)
    assert assembly.fine_at(at.settings, at.knobs, at.placement) == (5.0, 0.0)
    tilted = make_bench({"tilt_y": 6.0})
    fine = assembly.fine_at(tilted.settings, tilted.knobs, tilted.placement)
    np.testing.assert_allclose(fine, tilted.placement.contact[:2], atol=1e-9)
    assert abs(fine[0]) > 1.0 and fine[1] == 0.0


# ---------------------------------------------------------------------------------------------- effects that are off

OFF = {
    "skin": {"skin_ratio": 1.0, "skin_thickness": 0.7},
    "skin without thickness": {"skin_ratio": 3.0, "skin_thickness": 0.0},
    "inclusion": {"inclusion_ratio": 1.0, "inclusion_radius": 4.0, "inclusion_x": 2.0},
    "cavity": {"cavity": 0.0},
    "fibre": {"fibre": 0.0, "fibre_k2": 2.0, "fibre_angle": 33.0},
    "prony": {"prony_g": 0.0, "prony_tau": 2.0, "prony_g2": 0.0, "prony_tau2": 3.0},
    "mullins": {"mullins": 0.0, "mullins_m": 0.3},
    "friction": {"friction": 0.0},
    "adhesion": {"adhesion": 0.0, "adhesion_range": 0.5},
    "weight": {"weight": 0.0},
    "law": {"C01": 0.0, "C20": 0.0, "C30": 0.0, "alpha": 2.0},
    "mounting": {"offset_x": 0.0, "offset_y": -0.0, "tilt_x": 0.0, "tilt_y": 0.0, "delta_R": 0.0, "delta_a": 0.0},
    "bowl": {"bowl_clearance": 3.0, "bowl_friction": 0.7},
}


@pytest.fixture(scope="module")
def run():
    def call(values=None, **settings):
        return BACKEND({**VALUES, **(values or {})}, Case("c", Programme.ramp((0.5, 1.0)), {"mesh": SMALL, **settings}))

    return call


@pytest.fixture(scope="module")
def plain(run):
    return run()


def same_bits(answer, plain):
    for name, channel in plain.channels.items():
        assert answer.channels[name].tobytes() == channel.tobytes(), name


@pytest.mark.parametrize("skin", ["skin", "skin without thickness"])
def test_effects_that_are_off_change_no_bit(run, plain, skin):
    """All at once, as called (the canonical form would drop them before)."""
    others = {k: v for effect, knobs in OFF.items() if not effect.startswith("skin") for k, v in knobs.items()}
    same_bits(run({**others, **OFF[skin]}), plain)


@pytest.mark.verification
@pytest.mark.parametrize("effect", OFF)
def test_effect_that_is_off_changes_no_bit(run, plain, effect):
    """Each alone."""
    same_bits(run(OFF[effect]), plain)


NEARLY_OFF = {
    "skin_ratio": (1.0 + 1e-6, {"skin_thickness": 2.0}),
    "inclusion_ratio": (1.0 + 1e-6, {}),
    "cavity": (1e-3, {}),
    "fibre": (1e-8, {}),
    "fibre across no plane": (1e-8, {"fibre_angle": 30.0}),
    "prony_g": (1e-7, {}),
    "mullins": (1e-7, {}),
    "friction": (1e-7, {}),
    "adhesion": (1e-10, {}),
    "weight": (1e-12, {}),
    "C01": (1e-9, {}),
    "C30": (1e-9, {}),
    "alpha": (2.0 + 1e-6, {}),
    "offset_x": (1e-6, {}),
    "tilt_y": (1e-6, {}),
    "delta_R": (1e-6, {}),
    "delta_b": (1e-6, {}),
}


# One of each kind every time: other elements, another symmetry, another path, another solver.
QUICK = ("skin_ratio", "fibre across no plane", "prony_g", "friction", "weight", "offset_x")


@pytest.mark.parametrize("effect", [pytest.param(e, marks=() if e in QUICK else slow) for e in NEARLY_OFF])
def test_effect_that_is_nearly_off_changes_next_to_nothing(run, plain, effect):
    """No jump at neutral, although another solver, another symmetry or another path is taken there."""
    value, others = NEARLY_OFF[effect]
    answer = run({effect.split()[0]: value, **others})
    np.testing.assert_allclose(answer.channels["Fz"], plain.channels["Fz"], rtol=2e-6)
    assert np.all(np.abs(answer.channels["Fx"]) < 1e-5 * plain.channels["Fz"])
