"""Exact similarity: all moduli times k, all forces times k, nothing else, whatever acts (Buckingham).

This is what `rso.core.similarity` saves runs by; the penalties, the springs and the tolerances must scale too.
"""

from __future__ import annotations

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly
from rso.contract import Case, Programme

SMALL = {"mesher": "mapped", "n": 6, "slip": 0.3}
VALUES = {"mu": 0.01, "D1": 5.8}
MODULI = ("mu", "C01", "C20", "C30", "fibre", "weight", "adhesion")  # D1 is one over a modulus
FORCES = ("Fx", "Fy", "Fz", "peak_pressure")
BOWL = {"support": {"kind": "bowl", "clearance": 0.5, "friction": 0.0}}
CASES = {
    "neo_hookean": ({}, {}),
    "linear_elastic": ({}, {"material": {"law": "linear_elastic"}}),
    "mooney_rivlin": ({"C01": 2e-3}, {}),
    "yeoh": ({"C20": 1e-3, "C30": 1e-4}, {}),
    "ogden": ({"alpha": 6.0}, {"material": {"law": "ogden", "ogden": [[-3.0, 0.3]]}}),
    "fibre": ({"fibre": 5e-3, "fibre_k2": 2.0, "fibre_angle": 90.0}, {}),
    "friction": ({"friction": 0.3}, {}),
    "bowl": ({}, BOWL),
    "bowl with friction": ({}, {"support": {"kind": "bowl", "clearance": 0.5, "friction": 0.2}}),
    "prony": ({"prony_g": 0.4, "prony_tau": 1.0, "prony_g2": 0.1}, {}),
    "mullins": ({"mullins": 0.5}, {}),
    "mullins, travelled before": ({"mullins": 0.5}, {"earlier": 1.5}),
    "adhesion": ({"adhesion": 1e-4}, {}),
    "weight": ({"weight": 1e-5}, {}),
    "weight in a bowl": ({"weight": 1e-5}, BOWL),
    "zones": ({"skin_ratio": 3.0, "inclusion_ratio": 0.2, "cavity": 1.0}, {}),
    "misaligned": ({"offset_x": 1.0, "tilt_x": 2.0}, {}),
    "off the top": ({}, {"point": [12.0, 0.0], "direction": "normal"}),
    "all of it": (
        {"friction": 0.2, "prony_g": 0.3, "mullins": 0.4, "skin_ratio": 2.0, "C20": 1e-3, "weight": 1e-5},
        {},
    ),
}


def run(values, settings):
    programme = Programme((0.0, 1.0, 2.0), (0.0, 1.0, 0.5), (0.75, 1.0), (2.0,))
    return BACKEND({**VALUES, **values}, Case("c", programme, {"mesh": SMALL, "derivatives": False, **settings}))


def scaled(values, k):
    given = {**VALUES, **values}
    return {n: v * k if n in MODULI else v / k if n == "D1" else v for n, v in given.items()}


@pytest.mark.parametrize(
    "what, k",
    [
        *((what, 8.0) for what in CASES),
        *(pytest.param(what, 7.3, marks=() if what == "all of it" else pytest.mark.verification) for what in CASES),
    ],
)
def test_similarity_is_exact(what, k):
    """μ, D₁ and all that has a stress in it, by 7.3: the same but for round-off; by a power of two: every iteration."""
    values, settings = CASES[what]
    one, two = run(values, settings), run(scaled(values, k), settings)
    assert len(one.channels["Fz"]) == 4 and one.channels["Fz"][1] > 0
    for name, channel in one.channels.items():
        factor = k if name in FORCES else 1.0
        size = np.abs(channel).max()
        np.testing.assert_allclose(two.channels[name] / factor, channel, rtol=1e-9, atol=1e-9 * size, err_msg=name)
    for name in ("iterations", "steps", "cutbacks", "halvings") if k == 8.0 else ():  # else round-off may decide
        assert one.info[name] == two.info[name], name


@pytest.mark.parametrize("knob", ["C20", "fibre", "weight", "adhesion"])
def test_a_modulus_left_behind_is_seen(knob):
    """Negative control: everything scaled but one."""
    values = {"C20": 1e-3, "fibre": 5e-3, "weight": 1e-5, "adhesion": 1e-4}
    k = 7.3
    one, two = run(values, {}), run(scaled(values, k) | {knob: values[knob]}, {})
    assert np.abs(two.channels["Fz"] / k / one.channels["Fz"] - 1).max() > 1e-4


def test_a_penalty_that_does_not_scale_is_seen(graded, to_two, monkeypatch):
    """Negative control: the same ε for the stiffer body."""
    k = 3.7
    monkeypatch.setattr(assembly, "BODY_PENALTY_RATIO", assembly.BODY_PENALTY_RATIO / k)
    two = graded.other(mu=k * graded.knobs.mu, D1=graded.knobs.D1 / k).solve([1.0, 2.0])
    assert np.abs(two.Fz / k / to_two.Fz - 1).max() > 1e-4


@pytest.mark.parametrize("k", [2.0, 1e-3])
def test_similarity_of_lengths(make_bench, k):
    """As many times as large in every length, down to a cell under a probe: forces by the square, on a mesh alike."""

    def at(k):
        table = {"specimen": {"semi_axes": [60 * k, 35 * k, 35 * k]}, "indenter": {"radius": 3.0 * k}}
        return make_bench(
            {
                "weight": 1e-5 / k,
                "adhesion": 1e-4 * k,
                "adhesion_range": 0.2 * k,
                "skin_ratio": 2.0,
                "skin_thickness": 0.5 * k,
            },
            **table,
        ).solve([0.5 * k, 1.0 * k])

    one, two = at(1.0), at(k)
    np.testing.assert_allclose(two.Fz, k * k * one.Fz, rtol=1e-6)  # merged nodes have an absolute tolerance
    np.testing.assert_allclose(two.channels["contact_area"], k * k * one.channels["contact_area"], rtol=1e-5)
    np.testing.assert_allclose(two.channels["peak_pressure"], one.channels["peak_pressure"], rtol=1e-5)


@pytest.mark.verification
@pytest.mark.parametrize("k", [8.0, 1e-2])
def test_similarity_of_lengths_of_a_body_that_may_turn(k):
    """The lip of the bowl and the steps of what rolls there, too; forces to what merged nodes leave."""

    def at(k):
        table = {
            "specimen": {"semi_axes": [60.0 * k, 35.0 * k, 35.0 * k]},
            "indenter": {"radius": 3.0 * k},
            "support": {"kind": "bowl", "clearance": 2.0 * k, "friction": 0.0},
            "point": [20.0 * k, 0.0],
            "mesh": SMALL,
            "derivatives": False,
        }
        return BACKEND(VALUES, Case("c", Programme.ramp((1.0 * k, 2.0 * k), k), table))

    one, two = at(1.0), at(k)
    np.testing.assert_allclose(two.channels["Fz"], k * k * one.channels["Fz"], rtol=1e-5)
    np.testing.assert_allclose(two.channels["bulge"], k * one.channels["bulge"], rtol=1e-5)


@pytest.mark.parametrize(
    "values, settings",
    [
        ({"adhesion": 1e-4, "skin_ratio": 2.0, "inclusion_ratio": 5.0, "prony_g": 0.3, "prony_tau": 1e-6}, {}),
        ({"cavity": 1.0}, {}),
        ({}, {"support": {"kind": "bowl"}}),
    ],
)
def test_lengths_that_nobody_states_go_with_the_specimen(values, settings):
    """Range of the adhesion, thickness of the skin, radius and depth of the inclusion, a cavity, the clearance."""

    def at(k):
        body = {"specimen": {"semi_axes": [60.0 * k, 35.0 * k, 35.0 * k]}, "indenter": {"radius": 3.0 * k}}
        given = {**VALUES, **values, **({"adhesion": values["adhesion"] * k} if "adhesion" in values else {})}
        programme = Programme.ramp((0.5 * k, 1.0 * k), k)
        return BACKEND(given, Case("c", programme, {"mesh": SMALL, **body, **settings})).channels["Fz"]

    usual = at(1.0)
    for k in (1e-3, 20.0):  # merged nodes have an absolute tolerance
        np.testing.assert_allclose(at(k), k * k * usual, rtol=1e-6, err_msg=str(k))
