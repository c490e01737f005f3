"""Layers with laws of their own: columns against the energy, stacks of one material, knobs, keys, refusals."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly, indentation
from fem_backend.simulation.experiment import read_settings
from fem_backend.solver.load_steps import Instant
from rso.contract import Case, Programme, SimulationFailed

SLAB = {"shape": "slab", "thickness": 6.0}
SOFT = {"mu": 0.01, "D1": 5.8}


def layered(specimen, *layers):
    return {**specimen, "layers": [{"thickness": t, **layer} for t, layer in layers]}


def curve(specimen, values=SOFT, programme=None, **settings):
    """The response under a ball on a bonded base, coarse, unless said otherwise."""
    usual = {"indenter": {"shape": "sphere", "radius": 3.0}, "support": {"kind": "bonded"}, "mesh": {"level": "coarse"}}
    case = Case("a", programme or Programme.ramp((0.75, 1.5)), {"specimen": specimen, **usual, **settings})
    return BACKEND(values, case)


def confined_stress(law, mu, D1, stretch):
    """Nominal stress (MPa) of F = diag(1, 1, λ) by central differences of the textbook energies, not of the code's."""

    def energy(x):
        i1 = x ** (-2.0 / 3.0) * (2.0 + x * x)
        iso = 0.5 * mu * (i1 - 3.0)
        if "C20" in law:
            iso = iso + law["C20"] * (i1 - 3.0) ** 2
        if "alpha" in law:
            a = law["alpha"]
            iso = 2.0 * mu / a**2 * (2.0 * x ** (-a / 3.0) + x ** (2.0 * a / 3.0) - 3.0)
        return iso + (x - 1.0) ** 2 / D1

    h = 1e-6
    return (energy(stretch + h) - energy(stretch - h)) / (2.0 * h)


def column_force(layers, travel, area):
    """Force (N) of layers (law, μ, D₁, thickness) in series: one stress, and shortenings that sum to the travel."""

    def shortening(stress):
        out = 0.0
        for law, mu, D1, thickness in layers:
            low, high = 0.05, 1.0
            for _ in range(80):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if confined_stress(law, mu, D1, middle) < -stress else (low, middle)
            out += thickness * (1.0 - low)
        return out

    low, high = 0.0, 10.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if shortening(middle) < travel else (low, middle)
    return low * area


def test_a_confined_column_of_three_laws_has_the_force_of_its_energies():
    """A puck that fills its well under a plate that slips: strains are uniaxial in each layer, so elements are exact.

    The plate yields to its penalty, by about 1e-5 of the travel after one augmentation.
    """
    puck = {"shape": "cylinder", "radius": 4.0, "height": 6.0}
    layers = (1.5, {"material": {"law": "yeoh"}}), (2.0, {"ratio": 3.0, "material": {"law": "ogden"}})
    values = {"mu": 0.02, "D1": 20.0, "layer_mu": 0.05, "layer_D1": 30.0, "layer_C20": 0.4, "layer2_alpha": 8.0}
    well = {"kind": "well", "base": "slip", "wall": "slip"}
    found = curve(layered(puck, *layers), values, Programme.ramp((0.6, 1.8)), indenter={"shape": "plate"}, support=well)
    # the second has K/mu of the rest: D1 = 20 · 0.02 / 0.06
    parts = [({"C20": 0.4}, 0.05, 30.0, 1.5), ({"alpha": 8.0}, 0.06, 20.0 / 3.0, 2.0), ({}, 0.02, 20.0, 2.5)]
    wanted = [column_force(parts, s, 16.0 * np.pi) for s in (0.6, 1.8)]
    assert found.channels["Fz"] == pytest.approx(wanted, rel=2e-4)
    plain = column_force([({}, *p[1:]) for p in parts], 1.8, 16.0 * np.pi)
    assert plain < 0.9 * wanted[1]  # the laws are told apart


def test_a_stack_of_one_law_is_the_plain_body():
    """Yeoh's law in two layers and the rest, each with its own knobs, on one mesh: to round-off."""
    stack = layered(SLAB, (1.0, {"material": {"law": "yeoh"}}), (1.5, {"material": {"law": "yeoh"}}))
    settings = {"indenter": {"shape": "sphere", "radius": 3.0}, "support": {"kind": "bonded"}}
    settings |= {"material": {"law": "yeoh"}, "mesh": {"level": "coarse"}}
    own, plain = (read_settings({**settings, "specimen": body}) for body in (stack, SLAB))
    values = {**SOFT, "C20": 3e-3, "layer_C20": 3e-3, "layer2_C20": 3e-3}
    knobs = BACKEND.knobs(values, own)
    placed = assembly.placement_of(own, knobs)
    model = assembly.model_for(own, knobs, placed, None)
    instants = [Instant(s, s, True) for s in (1.0, 2.0)]
    one, two = (
        indentation.simulate_indentation(s, knobs, assembly.placement_of(s, knobs), model, instants)
        for s in (own, plain)
    )
    assert one.system is not None and len(set(one.system.material.of)) == 3
    assert one.Fz == pytest.approx(two.Fz, rel=1e-9)


HISTORIES = {"": {}, "prony": {"prony_g": 0.4, "prony_tau": 2.0}, "mullins": {"mullins": 0.4}}
DAILY = {("neo_hookean", "prony"), ("mooney_rivlin", "mullins"), ("yeoh", "prony"), ("ogden", "mullins")}


@pytest.mark.parametrize(
    "law, history",
    [
        pytest.param(law, h, marks=() if not h or (law, h) in DAILY else pytest.mark.verification)
        for law in ("neo_hookean", "mooney_rivlin", "yeoh", "ogden")
        for h in HISTORIES
    ],
)
def test_a_law_of_its_own_that_says_the_same_as_a_ratio_does_the_same(law, history):
    """Every law at its neutral constants is neo-Hookean, elastic or not."""
    programme = Programme((0.0, 1.0, 3.0, 4.0), (0.0, 1.2, 1.2, 0.6), (0.6, 1.2), (2.0,))
    stiff, own = ({"ratio": 4.0}, {"ratio": 4.0, "material": {"law": law}})
    one, two = (curve(layered(SLAB, (0.8, x)), {**SOFT, **HISTORIES[history]}, programme) for x in (stiff, own))
    assert two.channels["Fz"] == pytest.approx(one.channels["Fz"], rel=1e-7)


def test_a_law_of_its_own_in_space():
    """A block has tetrahedra: the same cells, the same answers."""
    block = {"shape": "block", "size": [8.0, 8.0, 5.0]}
    stiff, own = ({"ratio": 4.0}, {"ratio": 4.0, "material": {"law": "yeoh"}})
    one, two = (curve(layered(block, (1.5, x)), programme=Programme.ramp((0.5,))) for x in (stiff, own))
    assert two.channels["Fz"] == pytest.approx(one.channels["Fz"], rel=1e-8)
    more = curve(layered(block, (1.5, own)), {**SOFT, "layer_C20": 0.3}, Programme.ramp((0.5,)))
    assert more.channels["Fz"][0] > 1.02 * two.channels["Fz"][0]


def test_derivatives_by_the_constants_of_layers():
    """Central differences of whole runs; mu by Euler's identity over all moduli."""
    body = layered(SLAB, (1.0, {"material": {"law": "yeoh"}}), (1.0, {"ratio": 2.0, "material": {"law": "ogden"}}))
    values = {**SOFT, "layer_mu": 0.03, "layer_D1": 3.0, "layer_C20": 0.01, "layer2_alpha": 6.0}
    found = curve(body, values)
    assert set(found.gradients) == set(values)
    for name, value in values.items():
        h = 2e-3 * value
        low, high = (curve(body, {**values, name: value + d}).channels["Fz"] for d in (-h, h))
        assert found.gradients[name]["Fz"] == pytest.approx((high - low) / (2.0 * h), rel=2e-3), name


def test_similarity_of_stiffness_counts_the_moduli_of_layers():
    body = layered(SLAB, (1.0, {"material": {"law": "yeoh"}}))
    values = {**SOFT, "layer_mu": 0.03, "layer_D1": 3.0, "layer_C20": 0.01}
    powers = {"mu": 1, "D1": -1, "layer_mu": 1, "layer_D1": -1, "layer_C20": 1}
    stiff = {k: 7.0 ** powers[k] * v for k, v in values.items()}
    assert curve(body, stiff).channels["Fz"] == pytest.approx(7.0 * curve(body, values).channels["Fz"], rel=1e-8)


def test_a_layer_whose_law_softens_is_no_answer():
    """Yeoh with C20 < 0 alone turns down where the ball stretches the layer; the rest is neo-Hookean."""
    body = layered(SLAB, (1.0, {"material": {"law": "yeoh"}}))
    assert curve(body, {**SOFT, "layer_C20": -1e-6}).channels["Fz"].shape == (2,)
    with pytest.raises(SimulationFailed) as failed:
        curve(body, {**SOFT, "layer_C20": -2e-3})
    assert failed.value.cause == "inadmissible" and "Drucker" in str(failed.value)


def test_only_the_knobs_that_layers_have_enter_the_key():
    def key(body, **values):
        case = Case("a", Programme.ramp((1.0,)), {"specimen": body, "support": {"kind": "bonded"}})
        return BACKEND.canonical({**SOFT, **values}, case)

    plain = layered(SLAB, (1.0, {"ratio": 2.0}))
    own = layered(SLAB, (1.0, {"ratio": 2.0, "material": {"law": "yeoh"}}))
    assert key(plain, layer_mu=0.03, layer_C20=1.0) == key(plain)
    assert key(plain)[1].settings["specimen"]["layers"] == [{"thickness": 1.0, "ratio": 2.0}]
    assert key(own, layer_alpha=3.0, layer2_mu=0.1, layer_C20=0.0) == key(own) != key(plain)
    assert key(own, layer_C20=1e-3) != key(own)
    assert BACKEND.plausible({"specimen": own})["layer_alpha"] is None
    assert "layer_C20" not in BACKEND.plausible({"specimen": own})


@pytest.mark.parametrize(
    ("layers", "words"),
    [
        ([{"thickness": 1.0, "material": {"law": "rubber"}}], "specimen.layers.material.*rubber.*yeoh"),
        ([{"thickness": 1.0, "material": {"law": "linear_elastic"}}], "layers.material.law.*finite strain"),
        ([{"thickness": 1.0, "material": {"law": "yeoh", "prony": [[0.3, 1.0]]}}], "layers.material.*prony"),
        ([{"thickness": 1.0, "material": 3}], "layers.material = 3: a table"),
        ([{"thickness": 1.0}], "specimen.layers.ratio"),
        ([{"thickness": 0.5, "material": {"law": "yeoh"}}] * 4, "layers.material.*number 4"),
    ],
)
def test_what_is_no_law_of_a_layer_is_refused_by_name(layers, words):
    with pytest.raises(ValueError, match=words):
        read_settings({"specimen": {**SLAB, "layers": layers}})


def test_a_layer_of_finite_strain_on_a_linear_body_is_not_modelled():
    body = layered(SLAB, (1.0, {"material": {"law": "yeoh"}}))
    with pytest.raises(SimulationFailed, match="linear_elastic"):
        curve(body, material={"law": "linear_elastic"})


def test_what_is_said_names_the_law():
    body = layered(SLAB, (0.5, {"ratio": 5.0, "material": {"law": "mooney_rivlin"}}))
    assert "0.5 mm (mooney rivlin, 5 times as stiff)" in read_settings({"specimen": body}).specimen.described


@pytest.mark.parametrize("body", [SLAB, {"shape": "block", "size": [8.0, 8.0, 6.0]}], ids=["meridian", "space"])
def test_a_ratio_may_come_from_the_settings_or_from_its_knob(body):
    """One of them may be 1, or their product: a meridian meets the interface in any case, a grid in space is cut."""

    def force(ratio, knob):
        found = curve(layered(body, (1.0, {"ratio": ratio})), {**SOFT, "layer_ratio": knob}, Programme.ramp((0.5,)))
        return found.channels["Fz"][0], found.error["Fz"][0]

    (knob, off), (settings, other) = force(1.0, 4.0), force(4.0, 1.0)
    assert knob == pytest.approx(settings, abs=1e-9 if body is SLAB else off + other)
    (product, off), (plain, other) = force(2.0, 0.5), force(1.0, 1.0)
    assert product == pytest.approx(plain, abs=off + other)  # on another grid
