"""What may be otherwise than a study says suits the size of its specimen."""

import re

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.simulation import experiment
from fem_backend.supports.bonded import Bonded
from fem_backend.supports.bowl import BowlSupport
from fem_backend.supports.fixed import Fixed
from rso.contract import Case, Programme, SimulationFailed

BENCH = "specimen and ball on the bench: callipers, a micrometer, a balance"
ALIGNED = "ink on the ball and a level on the holder"
GAUGES = {
    "delta_a": (BENCH, 0.1),
    "delta_b": (BENCH, 0.1),
    "delta_c": (BENCH, 0.1),
    "delta_R": (BENCH, 0.01),
    "offset_x": (ALIGNED, 0.1),
    "offset_y": (ALIGNED, 0.1),
    "tilt_x": (ALIGNED, 0.1),
    "tilt_y": (ALIGNED, 0.1),
    "weight": (BENCH, 2e-7),
}
LENGTHS = ("delta_a", "delta_b", "delta_c", "delta_R", "offset_x", "offset_y")


@pytest.mark.parametrize("k", [1.0, 0.1, 5.0])
def test_gauges_are_as_fine_beside_a_small_body_as_beside_a_large_one(k):
    """Their resolution keeps its share of what is plausible."""
    settings = {
        "specimen": {"shape": "ellipsoid", "semi_axes": [60.0 * k, 35.0 * k, 35.0 * k]},
        "indenter": {"shape": "sphere", "radius": 3.0 * k},
        "support": {"kind": "fixed"},
    }
    found, ranges = BACKEND.gauges(settings), BACKEND.plausible(settings)
    declared = {p.name: p.plausible for p in BACKEND.parameters}
    for name, (words, fine) in GAUGES.items():
        factor = k if name in LENGTHS else 1.0
        assert found[name][0] == words
        np.testing.assert_allclose(found[name][1], factor * fine, rtol=1e-12)
        np.testing.assert_allclose(ranges.get(name, declared[name]), np.multiply(factor, declared[name]), rtol=1e-12)
    assert k != 1.0 or found == GAUGES


SLAB = {"shape": "slab", "thickness": 4.0}
PUCK = {"shape": "cylinder", "radius": 10.0, "height": 8.0}


@pytest.mark.parametrize(
    ("specimen", "kind", "tried"),
    [
        ({"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}, "fixed", {"bowl"}),
        ({"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}, "bowl", {"held"}),
        (SLAB, "fixed", set()),
        (SLAB, "bonded", set()),
        (PUCK, "fixed", set()),
        (PUCK, "bonded", set()),
    ],
)
def test_a_support_that_is_the_same_under_another_name_is_not_tried(specimen, kind, tried):
    """A flat specimen that is held is held at its base: that is the one bonded to a stiff base."""
    found = BACKEND.variants({"specimen": specimen, "support": {"kind": kind}})
    assert tried <= set(found) and not {"held", "bonded"} & set(found) - tried


def test_what_is_held_tells_supports_apart():
    """Of an ellipsoid one that holds the lower half and one that holds nothing, or only z, are two."""
    body, puck = experiment.read_settings({}).specimen, experiment.read_settings({"specimen": PUCK}).specimen

    class Half(Fixed):
        def held(self, specimen, X, surface):
            return super().held(specimen, X, surface) & np.array([False, False, True])

    class Group(Bonded):
        group = "elsewhere"

    assert Fixed().same(Bonded(), puck) and Bonded().same(Fixed(), puck) and Fixed().same(Fixed(), body)
    assert not Fixed().same(Half(), body) and not Fixed().same(Half(), puck)
    assert not Fixed().same(BowlSupport(), body) and not BowlSupport().same(Fixed(), body)
    assert not Fixed().same(Group(), puck)  # it has knobs of its own: it does more than to hold


AXIS = "of revolution: solved on its meridian"
BESIDE = "the specimen is of revolution, its test is not: {} of it is solved in space"


@pytest.mark.parametrize(
    ("settings", "values", "words"),
    [
        ({"specimen": PUCK}, {}, AXIS),
        ({"specimen": {"shape": "sphere", "radius": 20.0}}, {}, AXIS),
        ({"specimen": PUCK}, {"fibre": 0.5}, BESIDE.format("a quarter")),
        ({"specimen": PUCK, "point": [0.0, 2.0]}, {}, BESIDE.format("half")),
        ({"specimen": PUCK}, {"tilt_x": 2.0, "tilt_y": 1.0}, BESIDE.format("all")),
        ({"specimen": SLAB, "point": [3.0, 2.0]}, {}, AXIS),  # all its places are alike
        ({}, {}, None),
        ({"point": [3.0, 2.0]}, {}, None),
        ({"specimen": PUCK}, {"offset_x": 50.0}, None),  # beside it: the run says why
    ],
)
def test_how_much_of_a_body_of_revolution_is_modelled_is_said(settings, values, words):
    """By symmetry: fibres along x leave two planes, a place on y one, a tilt about both axes none."""
    case = Case("case", Programme.ramp((0.5,)), settings)
    assert BACKEND.reduction({"mu": 0.01, "D1": 5.0, **values}, case) == words


def test_what_is_said_of_friction_and_forces_holds_for_every_indenter():
    flat = {"specimen": SLAB, "indenter": {"shape": "flat", "radius": 2.0, "fillet": 0.1}}
    said = [*BACKEND.prevented(), *BACKEND.tests(flat), *(words for words, _ in BACKEND.gauges(flat).values())]
    said += [v["description"] for v in BACKEND.variants(flat).values()]
    absent = [name for name, range_ in BACKEND.plausible(flat).items() if range_ is None]
    said += [f"{p.label} {p.description}" for p in BACKEND.parameters if p.name not in absent]
    said += [f"{level['title']} {level['description']}" for rung in BACKEND.levels(flat) for level in rung]
    assert len(said) > 20 and "flat end" in " ".join(said)
    assert not [words for words in said if re.search(r"\b(ball|[Hh]ertz\w*)\b", words)]


@pytest.mark.parametrize("thickness", [1.0, 4.0])
def test_every_skin_that_is_plausible_on_a_thin_slab_is_one_it_can_have(thickness):
    settings = {
        "specimen": {"shape": "slab", "thickness": thickness},
        "support": {"kind": "bonded"},
        "mesh": {"level": "coarse"},
        "derivatives": False,
    }
    low, high = BACKEND.plausible(settings)["skin_thickness"]
    assert 0.0 < low < high
    case = Case("a", Programme.ramp((0.1 * thickness,)), settings)
    assert BACKEND({"mu": 0.01, "D1": 5.0, "skin_ratio": 3.0, "skin_thickness": high}, case).channels["Fz"][0] > 0.0
    thick = {"mu": 0.01, "D1": 5.0, "skin_ratio": 3.0, "skin_thickness": 1.2 * high}
    with pytest.raises(SimulationFailed, match="skin thickness"):  # no more can be had
        BACKEND(thick, case)


@pytest.mark.parametrize("upper", [0.1, 0.5, 2.0, 3.9])
@pytest.mark.parametrize(
    "body",
    [
        {"shape": "slab", "thickness": 4.0},
        {"shape": "cylinder", "radius": 10.0, "height": 4.0},
        {"shape": "block", "size": [20.0, 20.0, 4.0]},
    ],
)
def test_the_error_of_a_layer_leaves_something_of_it_and_of_what_is_below(body, upper):
    settings = {"specimen": {**body, "layers": [{"thickness": upper, "ratio": 3.0}]}, "support": {"kind": "bonded"}}
    declared = {p.name: p.plausible for p in BACKEND.parameters}
    low, high = (declared | BACKEND.plausible(settings))["delta_layer"]
    assert upper + low > 0.5 * upper
    assert upper + high < 4.0
    assert high == -low > 0.0
