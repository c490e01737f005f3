"""What the backend refuses, by name: a setting or a value is modelled or an error, never ignored."""

import dataclasses
import json
import re

import numpy as np
import pytest

from fem_backend import meshing
from fem_backend.accuracy import calibration
from fem_backend.backend import BACKEND
from fem_backend.laws import LAWS
from fem_backend.meshing import LIMIT_LEVEL
from fem_backend.simulation.experiment import MARKS, read_settings
from fem_backend.simulation.knobs import Knobs
from rso.contract import Case, Programme, Segment, SimulationFailed

MESH = {"mesher": "mapped", "n": 6, "slip": 0.3}
VALUES = {"mu": 0.01, "D1": 5.8}
BOWL = {"support": {"kind": "bowl"}}
FLAT = {"shape": "flat", "radius": 2.0, "fillet": 0.2}
SKIN = {"skin_ratio": 2.0, "skin_thickness": 0.5}
LAYERED = {"shape": "slab", "layers": [{"thickness": 1.0, "ratio": 5.0}]}
WIDE = {"shape": "flat", "radius": 3.0, "fillet": 1.0}
CONE = {"shape": "cone", "half_angle": 60.0, "tip_radius": 1.0}


def led(force):
    return Programme(segments=(Segment("force", rate=force, to_N=force),), asked_N=(force,))


IN_SPACE = {"support": {"kind": "bonded"}, "mesh": {"level": "coarse"}}
ROUND = {"specimen": {"shape": "sphere", "radius": 35.0}}


def case(asked=(0.5, 1.0), **settings) -> Case:
    return Case("case", Programme.ramp(asked), {"mesh": MESH, **settings})


@pytest.mark.parametrize(
    "settings,words",
    [
        ({"colour": "red"}, ["'colour'", "specimen", "indenter", "support", "material", "point", "mesh", "solver"]),
        ({"specimen": {"shape": "cube"}}, ["specimen.shape", "'cube'", "ellipsoid"]),
        ({"specimen": {"size": 3}}, ["specimen.shape is missing", "size belongs to block", "'ellipsoid'"]),
        ({"specimen": "ellipsoid"}, ["specimen", "'ellipsoid'", "table"]),
        ({"specimen": {"semi_axes": [60, 35]}}, ["specimen.semi_axes", "3 finite"]),
        ({"specimen": {"semi_axes": [60, 35, 0]}}, ["specimen.semi_axes", "mm", "positive"]),
        ({"specimen": {"semi_axes": [60, 35, float("nan")]}}, ["specimen.semi_axes", "finite"]),
        ({"specimen": {"semi_axes": [60, 35, "35"]}}, ["specimen.semi_axes", "finite"]),
        ({"specimen": {"semi_axes": 60}}, ["specimen.semi_axes", "3 finite"]),
        ({"indenter": {"shape": "wedge"}}, ["indenter.shape", "'wedge'", "sphere"]),
        ({"indenter": {"radius": -3}}, ["indenter.radius", "-3", "mm", "positive"]),
        ({"indenter": {"radius": True}}, ["indenter.radius", "True"]),
        ({"indenter": {"radius": 30.0}}, ["indenter.radius", "30.0", "mm"]),
        ({"support": {"kind": "glue"}}, ["support.kind", "'glue'", "fixed", "bowl"]),
        ({"support": {"kind": "bowl", "clearance": 0}}, ["support.clearance", "0", "positive"]),
        ({"support": {"kind": "bowl", "friction": -0.1}}, ["support.friction", "-0.1", ">= 0"]),
        ({"support": {"kind": "bowl", "depth": 3}}, ["support.depth", "3", "clearance", "friction"]),
        ({"support": {"kind": "fixed", "clearance": 1.0}}, ["support.clearance", "1.0", "kind"]),
        ({"material": {"law": "hooke"}}, ["material.law", "'hooke'", *LAWS.members]),
        ({"material": {"ogden": [[4.0, 0.5]]}}, ["material.ogden", "neo_hookean", "ogden"]),
        ({"material": {"law": "ogden", "ogden": [[4.0, 1.0]]}}, ["material.ogden", "less than 1"]),
        ({"material": {"law": "ogden", "ogden": [[0.0, 0.3]]}}, ["material.ogden", "not be 0"]),
        ({"material": {"law": "ogden", "ogden": [[4.0, 0.1]] * 3}}, ["material.ogden", "at most two"]),
        ({"material": {"prony": [[0.5, 1.0], [0.5, 9.0]]}}, ["material.prony", "below 1"]),
        ({"material": {"prony": [[0.5, 0.0]]}}, ["material.prony", "tau > 0"]),
        ({"material": {"prony": [0.5, 1.0]}}, ["material.prony", "2 finite"]),
        ({"indenter": {"shaft": 1}}, ["indenter.shaft", "1", "true or false"]),
        ({"specimen": {"cavity": [1, 2]}}, ["specimen.cavity", "3 finite"]),
        ({"indenter": {"radius": "3 mm"}}, ["indenter.radius = '3 mm': 1 finite", "without quotes", "in mm"]),
        ({"specimen": {"semi_axes": ["6 cm", 35, 35]}}, ["specimen.semi_axes", "'6 cm'", "without quotes", "in mm"]),
        ({"profile": [[1.0]]}, ["profile", "2 finite"]),
        ({"profile": 3}, ["profile", "3", "list of [x, y]"]),
        ({"profile": [[10.0, 0.0], [50.0, 30.0]]}, ["profile", "(50, 30) mm", "60 and 35 mm"]),
        ({"earlier": -1}, ["earlier", "-1", "mm", "at least 0"]),
        ({"material": {"law": ["neo_hookean"]}}, ["material.law", "neo_hookean"]),
        ({"point": [49.0, 0.0]}, ["point", "[49.0, 0.0]", "mm", "top", "0.8"]),
        ({"point": [40.0, 17.0]}, ["point", "[40.0, 17.0]", "mm", "top"]),
        ({"point": 0.0}, ["point", "2 finite"]),
        ({"direction": "sideways"}, ["direction", "'sideways'", "vertical", "normal"]),
        ({"unload": "yes"}, ["unload", "'yes'", "true or false"]),
        ({"solver": "mumps"}, ["solver", "'mumps'", "auto", "pardiso", "superlu"]),
        ({"mesh": {"mesher": "gmsh"}}, ["mesh.mesher", "'gmsh'", "tetwild", "mapped"]),
        ({"mesh": {"level": "ultra"}}, ["mesh.level", "'ultra'", "coarse", "standard", "fine"]),
        ({"mesh": {"mesher": "mapped", "n": 3}}, ["mesh.n", "3", "4 to 40"]),
        ({"mesh": {"mesher": "mapped", "n": 8.0}}, ["mesh.n", "8.0", "integer"]),
        ({"mesh": {"mesher": "mapped", "n": 8, "slip": 0.9}}, ["mesh.slip", "0.9", "0 to 0.8"]),
        ({"mesh": {"follows": 99}}, ["mesh.follows = 99: unknown; choose from mesher, level, n, slip"]),
        ({"mesh": {"follows": True}}, ["mesh.follows = True: unknown"]),
        ({"support": {"kind": "bowl", "rolling": 5}}, ["support.rolling = 5: unknown", "kind, clearance, friction"]),
        ({"support": {"kind": "fixed", "rolling": 3}}, ["support.rolling = 3: unknown"]),
        ({"mesh": {"size": 1.0}}, ["mesh.size", "1.0", "mesher", "level"]),
        ({"mesh": {**MESH, "level": "coarse"}}, ["mesh.level = 'coarse'", "tetwild", '"mapped"', "n, slip"]),
        ({"mesh": {"n": 9}}, ["mesh.n = 9", '"mapped"', '"tetwild"', "level"]),
        ({"mesh": {"mesher": "tetwild", "slip": 0.5}}, ["mesh.slip = 0.5", '"mapped"', '"tetwild"', "level"]),
        ({"profile": [[5, 0], [5.000001, 0]]}, ["profile", "[5.0, 0.0]", "[5.000001, 0.0]", "uz(5,0)"]),
        ({"profile": [[5, 1], [4, 1], [5, 1]]}, ["profile", "[5.0, 1.0]", "uz(5,1)"]),
        ({"support": "bowl"}, ["support = 'bowl'", "table", "kind, clearance, friction"]),
    ],
)
def test_wrong_setting_is_refused_by_name_with_the_choices(settings, words):
    with pytest.raises(ValueError) as refused:
        BACKEND.check(case(**settings))
    for word in words:
        assert word in str(refused.value), (word, str(refused.value))


@pytest.mark.parametrize(
    "settings",
    [
        {"mesh": {**MESH, "level": "ultra"}},
        {"mesh": {"mesher": "tetwild", "level": "coarse", "n": "many"}},
        {"speed": "blue"},
        {"speed": "0 mm/s"},
        {"speed": "1e-999 mm/min"},
        {"speed": float("inf")},
    ],
)
def test_setting_without_influence_is_refused_when_it_is_nonsense(settings):
    with pytest.raises(ValueError):
        BACKEND.check(case(**settings))


@pytest.mark.parametrize(
    "key",
    [
        "speed",
        "earlier",
        "indenter.radius",
        "specimen.semi_axes",
        "point",
        "profile",
        "mesh.slip",
        "support.clearance",
        "material.prony",
        "mesh.n",
    ],
)
def test_whole_numbers_too_large_for_a_float_are_refused(key):
    huge = 10**400
    settings = {
        "speed": {"speed": huge},
        "earlier": {"earlier": huge},
        "indenter.radius": {"indenter": {"radius": huge}},
        "specimen.semi_axes": {"specimen": {"semi_axes": [huge, 35, 35]}},
        "point": {"point": [0, -huge]},
        "profile": {"profile": [[huge, 0.0]]},
        "mesh.slip": {"mesh": {**MESH, "slip": huge}},
        "support.clearance": {"support": {"kind": "bowl", "clearance": huge}},
        "material.prony": {"material": {"prony": [[0.1, huge]]}},
        "mesh.n": {"mesh": {**MESH, "n": huge}},
    }[key]
    with pytest.raises(ValueError, match=re.escape(key)):
        BACKEND.check(case(**settings))
    with pytest.raises(ValueError, match=r"mu = 1000.* is too large"):
        BACKEND({**VALUES, "mu": huge}, case())


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"point": [0, -0.0], "direction": "normal", "speed": "30 mm/min", "unload": False},
        {"specimen": {"semi_axes": [60, 35, 35]}, "material": {"law": "linear_elastic"}, "solver": "superlu"},
        {"point": [47.0, 0.0], "direction": "normal", "unload": True, "profile": [[10, 0]], "earlier": 3.0},
        {"support": {"kind": "bowl", "clearance": 0.5, "friction": 0.0}, "indenter": {"shaft": True}},
        {"material": {"law": "ogden", "ogden": [[-2.0, 0.5]], "prony": [[0.2, 5.0], [0.1, 50.0]]}},
    ],
)
def test_good_settings_are_taken(settings):
    """Negative control of the refusals."""
    BACKEND.check(case(**settings))


def test_marks_of_the_canonical_form_are_offered_to_nobody():
    """They are numbers of revisions: what the backend writes itself is read again, what a study made up is not."""
    follows, rolling, mended = ({k: MARKS[k]} for k in ("follows", "rolling", "mended"))
    BACKEND.check(case(mesh={**MESH, **follows}, support={"kind": "bowl", **rolling}, specimen=mended))
    for settings in ({"mesh": {"folows": 1}}, {"support": {"kind": "bowl", "roling": 3}}, {"specimen": {"mendd": 1}}):
        with pytest.raises(ValueError) as refused:
            BACKEND.check(case(**settings))
        assert not {"follows", "rolling", "mended"} & set(re.findall(r"\w+", str(refused.value)))


@pytest.mark.parametrize(
    "values,settings,programme,marked",
    [
        ({"weight": 1e-5, "cavity": 1.0}, {}, Programme.ramp((1.0,)), True),
        ({"weight": 1e-5}, {}, Programme.ramp((1.0,)), False),
        ({"adhesion": 1e-4}, {}, Programme.ramp((1.0,)), True),
        ({"prony_g": 0.3}, {}, Programme((0.0, 1.0, 2.0), (0.0, 1.0, 1.0), (1.0,), (2.0,)), True),
        ({"prony_g": 0.3}, {}, Programme((0.0, 1.0, 2.0), (0.0, 1.0, 0.0), (1.0,)), False),
        ({}, {**BOWL, "specimen": {"semi_axes": [30.0, 24.0, 21.0]}}, Programme.ramp((1.0,)), True),
        ({}, BOWL, Programme.ramp((1.0,)), False),
        ({}, {"material": {"law": "linear_elastic"}}, Programme.ramp((1.0,)), True),
        ({}, {}, Programme.ramp((4.6,)), True),
        ({}, {}, Programme.ramp((4.5,)), False),
        ({}, {**ROUND, "indenter": CONE}, Programme.ramp((0.1,)), True),
        ({}, {**ROUND, "indenter": FLAT}, Programme.ramp((0.1,)), True),
        ({}, {**ROUND, "indenter": {"shape": "sphere"}}, Programme.ramp((0.1,)), True),
        ({}, {**ROUND, "indenter": {"shape": "sphere"}}, Programme.ramp((2.0,)), False),
        # an elastic run ends where it is asked last, so that decides how small its contact is
        ({}, {**ROUND, "indenter": {"shape": "sphere"}}, Programme((0.0, 1.0), (0.0, 2.0), (0.1,)), True),
        ({}, {"indenter": {**CONE, "tip_radius": 2.0}}, Programme.ramp((0.1,)), False),
        ({}, {**IN_SPACE, "specimen": {"shape": "block"}}, Programme.ramp((0.1,)), True),
        ({}, {**IN_SPACE, "specimen": {"shape": "block"}}, Programme.ramp((3.1,)), False),
        ({"tilt_y": 2.0}, {**IN_SPACE, "specimen": {"shape": "slab"}}, Programme.ramp((0.1,)), True),
        ({}, {**IN_SPACE, "specimen": {"shape": "block"}}, led(1e-4), True),
        ({}, {**IN_SPACE, "specimen": {"shape": "block"}}, led(10.0), True),
        # large strains, as at 3.1 mm, are compared with a coarser mesh; flat ends have no errors of their own
        ({}, {**IN_SPACE, "specimen": {"shape": "block"}}, Programme.ramp((2.0,)), True),
        ({}, {**IN_SPACE, "specimen": {"shape": "block"}, "indenter": WIDE}, Programme.ramp((2.0,)), False),
        (
            {"skin_ratio": 2.0},
            {**IN_SPACE, "specimen": {"shape": "block"}, "indenter": WIDE},
            Programme.ramp((2.0,)),
            True,
        ),
        ({}, {**IN_SPACE, "specimen": {"shape": "slab"}}, Programme.ramp((2.0,)), False),
        ({}, {**IN_SPACE, "specimen": LAYERED}, Programme.ramp((2.0,)), False),
        ({"tilt_y": 2.0}, {**IN_SPACE, "specimen": LAYERED, "indenter": WIDE}, Programme.ramp((2.0,)), True),
        ({"tilt_y": 2.0}, {**IN_SPACE, "specimen": {"shape": "slab"}}, Programme.ramp((2.0,)), True),
        ({}, ROUND, Programme(segments=(Segment("force", rate=0.1, to_N=0.1),), asked_N=(0.1,)), True),
        ({}, {}, Programme(segments=(Segment("force", rate=0.1, to_N=0.1),), asked_N=(0.1,)), False),
    ],
)
def test_answers_that_were_mended_have_another_key(values, settings, programme, marked):
    """What was stored before is not taken for them; every other key is the old one."""
    at = BACKEND.canonical({**VALUES, **values}, Case("case", programme, {"mesh": MESH, **settings}))[1]
    assert ("mended" in at.settings["specimen"]) is marked
    BACKEND.check(at)


def test_nothing_said_is_the_standard_case():
    s = read_settings({})
    sizes = (s.specimen.a, s.specimen.b, s.specimen.c, s.indenter.R)
    assert (*sizes, s.law, s.support.name) == (
        60.0,
        35.0,
        35.0,
        3.0,
        "neo_hookean",
        "fixed",
    )
    assert (s.point, s.direction, s.indenter.shaft, s.earlier, s.profile) == ((0.0, 0.0), "vertical", False, 0.0, ())
    assert s.recipe == read_settings({"mesh": {"mesher": "tetwild", "level": "standard"}}).recipe


def test_settings_are_read_and_not_changed():
    settings = {"mesh": dict(MESH), "speed": 1.0}
    read_settings(settings)
    assert settings == {"mesh": MESH, "speed": 1.0}


def test_mesh_is_finer_for_a_smaller_ball():
    """Sizes near the contact go with R, those of the body stay; no template fits these balls."""
    settings = [read_settings({"indenter": {"radius": R}}) for R in (4.0, 2.0)]
    recipes = [json.loads(s.recipe) for s in settings]
    size = [{k: v * 60.0 / r["semi_axes"][0] for k, v in r["sizing"].items()} for r in recipes]  # for a = 60 mm
    for name, factor in (("h0", 0.5), ("r0", 0.5), ("lift", 0.5), ("hmax", 1.0)):
        np.testing.assert_allclose(size[1][name], factor * size[0][name], rtol=1e-11)
    assert recipes[1]["sizing"]["growth"] == recipes[0]["sizing"]["growth"]
    np.testing.assert_allclose([s.h0 for s in settings], [x["h0"] for x in size], rtol=1e-11)


def test_similar_specimens_share_one_mesh():
    """Made for each size by itself, that of a small specimen had a fourth of the elements below the ball."""

    def recipe(k: float) -> str:
        table = {"semi_axes": [30.0 * k, 24.0 * k, 21.0 * k]}
        return read_settings({"specimen": table, "indenter": {"radius": 3.0 * k}}).recipe

    assert recipe(1.0) == recipe(2.0) == recipe(1.0 / 30.0) == recipe(0.7)
    assert json.loads(recipe(0.1))["semi_axes"] == [30.0, 24.0, 21.0]


def test_a_mesh_of_a_similar_body_is_that_of_the_specimen(monkeypatch):
    """Forces of a specimen of half the size are a fourth at half the depth; the mesh is one for both."""
    monkeypatch.setattr(meshing, "cached", lambda recipe: meshing.mapped_quarter(meshing.nominal_body(recipe), 6, 0.3))
    force = []
    for k in (1.0, 0.5):
        table = {"specimen": {"semi_axes": [30.0 * k, 24.0 * k, 21.0 * k]}, "indenter": {"radius": 3.0 * k}}
        table |= {"derivatives": False}
        force.append(BACKEND({"mu": 0.01, "D1": 5.8}, Case("c", Programme.ramp((k,)), table)).channels["Fz"])
    np.testing.assert_allclose(force[1], force[0] / 4.0, rtol=1e-8)


@pytest.mark.parametrize("level", meshing.TEMPLATE_SIZINGS)
def test_the_reference_specimen_has_a_mesh_that_is_the_same_everywhere(level):
    recipe = json.loads(read_settings({"mesh": {"level": level}}).recipe)
    assert recipe["mesher"] == "template" and recipe["level"] == level


# ---------------------------------------------------------------------------------------------- programme and values


def test_travel_through_the_whole_body_is_refused_before_any_mesh():
    with pytest.raises(ValueError, match=r"travel 71 mm: less than 70 mm"):
        BACKEND.check(case((1.0, 71.0)))
    BACKEND.check(case((1.0, 69.0)))


@pytest.mark.parametrize("travel,word", [((1.0, 0.0), "starts at 0"), ((0.1, 1.0), "starts at 0")])
def test_programme_starts_at_contact_and_stays_in_the_body(travel, word):
    programme = Programme(tuple(float(k) for k in range(len(travel))), travel, (0.5,))
    with pytest.raises(ValueError, match=word):
        BACKEND.check(Case("case", programme, {"mesh": MESH}))


def test_every_knob_has_bounds_that_are_enforced():
    assert {p.name for p in BACKEND.parameters} == {f.name for f in dataclasses.fields(Knobs)}
    for p in BACKEND.parameters:
        for bad in (p.low - 1.0, 2 * p.high + 1.0, float("nan")):
            with pytest.raises(ValueError, match=rf"{p.name} = .*{re.escape(p.unit)}"):
                BACKEND({**VALUES, p.name: bad}, case())


def test_nearly_incompressible_beyond_the_verified_range_is_not_supported():
    with pytest.raises(SimulationFailed) as failed:
        BACKEND({"mu": 1.0, "D1": 1e-3}, case())
    assert failed.value.cause == "not_supported" and "2000" in failed.value.reason and "1000" in failed.value.reason


# ---------------------------------------------------------------------------------------------- keys and channels


def test_what_has_no_influence_is_not_in_the_canonical_case():
    plain = BACKEND.canonical(VALUES, case())[1]
    same = [
        case(speed="30 mm/min", direction="normal", point=[0.0, 0.0], solver="superlu"),
        case(specimen={"semi_axes": [60, 35, 35]}, indenter={"radius": 3}, support={}, material={}),
        Case("case", Programme((0.0, 3.0, 9.0), (0.0, 1.0, 2.0), (0.5, 1.0)), {"mesh": MESH}),
    ]
    for other in same:
        assert BACKEND.canonical(VALUES, other)[1].to_json() == plain.to_json()
    for other in (case(indenter={"radius": 2.9}), case(material={"law": "linear_elastic"}), case((0.5, 1.1))):
        assert BACKEND.canonical(VALUES, other)[1].to_json() != plain.to_json()


@pytest.mark.parametrize(
    "one,other",
    [
        ({}, {"mesher": "tetwild"}),
        ({"mesher": "mapped"}, {"mesher": "mapped", "n": 12, "slip": 0.55}),
        ({"level": "fine"}, {"mesher": "tetwild", "level": "fine"}),
    ],
)
def test_equal_meshes_have_equal_keys(one, other):
    a, b = (Case("case", Programme.ramp((1.0,)), {"mesh": m}) for m in (one, other))
    assert BACKEND.recipes(VALUES, a) == BACKEND.recipes(VALUES, b)
    assert BACKEND.canonical(VALUES, a)[1].to_json() == BACKEND.canonical(VALUES, b)[1].to_json()


@pytest.fixture(scope="module")
def response():
    return BACKEND(VALUES, case())


def test_channels_of_the_top_by_symmetry(response):
    assert np.all(response.channels["Fx"] == 0) and np.all(response.channels["Fy"] == 0)
    assert np.all(response.channels["Fz"] > 0)
    np.testing.assert_array_equal(response.channels["travel"], [0.5, 1.0])
    assert response.info["nodes"] > 500 and response.info["cpu_s"] > 0
    np.testing.assert_allclose(response.info["reaction_Fz"], response.channels["Fz"], rtol=1e-6)


def test_stated_error_covers_the_error_of_a_coarse_mapped_mesh(response):
    """0.0844 N at 1 mm is the force of the fine level and of an independent code to 0.3 %."""
    assert abs(response.channels["Fz"][1] - 0.0844) < 3 * response.error["Fz"][1]


def test_time_is_that_of_the_programme():
    programme = Programme((0.0, 1.0, 3.0), (0.0, 0.5, 1.0), (0.5, 0.75))
    r = BACKEND(VALUES, Case("case", programme, {"mesh": MESH}))
    np.testing.assert_allclose(r.channels["time"], [1.0, 2.0], rtol=1e-15)


def test_time_of_a_travel_that_is_held_is_that_of_its_passage():
    programme = Programme((0.0, 1.0, 3.0), (0.0, 0.5, 0.5), (0.5,))
    r = BACKEND(VALUES, Case("case", programme, {"mesh": MESH}))
    np.testing.assert_allclose(r.channels["time"], [1.0], rtol=1e-15)


def test_response_names_the_solver_used():
    pytest.importorskip("pypardiso")
    assert BACKEND(VALUES, case((0.5,), solver="superlu")).info["solver"] == "superlu"


def test_settings_without_a_mesh_are_a_failed_run():
    """The accepted range of n and slip holds combinations whose straight-sided mesh is not the body."""
    bad = case((0.5,), mesh={"mesher": "mapped", "n": 6, "slip": 0.6})
    BACKEND.check(bad)
    with pytest.raises(SimulationFailed) as failed:
        BACKEND.make(BACKEND.recipes(VALUES, bad)["mesh"])
    assert failed.value.cause == "bad_geometry"
    with pytest.raises(SimulationFailed):
        BACKEND(VALUES, bad)


def test_levels_exist_for_every_stated_error():
    """Grids have no level limit."""
    for c in calibration.calibrated_pairs().values():
        limit = set() if c.only_in_space else {LIMIT_LEVEL}
        assert set(c.level) == {*meshing.TEMPLATE_SIZINGS, *limit}
        assert {name for name, level in c.level.items() if level.extrapolated != 1.0} == limit


@pytest.mark.parametrize("point", [[0.0, 0.0], [20.0, 0.0], [40.0, 5.0]])
def test_marks_that_a_camera_could_follow_lie_on_the_body_beside_the_ball(point):
    settings = {"specimen": {"semi_axes": [60.0, 35.0, 35.0]}, "indenter": {"radius": 3.0}, "point": point}
    for line in BACKEND.marks(settings).values():
        away = np.array(line) - point
        assert len(line) >= 6 and np.linalg.norm(away, axis=1).min() > 3.0  # a ball of 3 mm pressed in to its equator
        BACKEND.check(Case("marks", Programme.ramp((1.0,)), {**settings, "profile": line}))


BLOCK = {**IN_SPACE, "specimen": {"shape": "block"}, "indenter": {"shape": "sphere", "radius": 3.0}}


@pytest.mark.parametrize(
    "values,settings,programme",
    [
        ({}, {**BLOCK, "earlier": 4.0}, Programme.ramp((0.05, 0.1))),  # nothing softens
        ({}, {**BLOCK, "earlier": 6.5}, Programme.ramp((0.05, 0.1))),
        ({"mullins": 0.5}, {**BLOCK, "earlier": 4.0}, Programme.ramp((0.05, 0.1))),
        ({}, BLOCK, Programme((0.0, 1.0), (0.0, 6.5), (1.0,))),  # an elastic run ends where it is asked last
        ({"friction": 0.3}, BLOCK, Programme((0.0, 1.0), (0.0, 6.5), (1.0,))),
    ],
)
def test_a_canonical_run_is_its_own(values, settings, programme):
    """What is run is the canonical case: its key says how that is meshed, whatever was dropped."""
    kept, once = BACKEND.canonical({**VALUES, **values}, Case("case", programme, settings))
    assert BACKEND.canonical(kept, once) == (kept, once)


def test_a_small_contact_that_sticks_keeps_its_grid():
    """It is wider than the contact of a ball of the same depth that does not: finer elements would lie within it."""
    sticking, at = {**VALUES, "adhesion": 1e-3, "adhesion_range": 0.5}, Case("case", Programme.ramp((0.01,)), BLOCK)
    assert BACKEND.recipes(sticking, at)["mesh"] == read_settings(BLOCK).recipe
    assert BACKEND.recipes(VALUES, at)["mesh"] != read_settings(BLOCK).recipe
    assert BACKEND.canonical(sticking, at)[1].settings["specimen"].get("mended") != MARKS["mended"]
    without, with_it = (BACKEND.resolution(BLOCK, 0.01, given) for given in ((), ("adhesion",)))
    assert all(with_it[level] > without[level] for level in without)
