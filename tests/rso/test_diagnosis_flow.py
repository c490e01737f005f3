"""What flows through a body: its rests are simulated at every size pressed, and a network is like it at one size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from diagnosis_backend import run

from rso.contract import Case, Parameter, Programme, Response, drop_neutral, knob, parameters_of
from rso.data import Measurement, Noise, Repeat
from rso.discrepancy import Base, Experiment, build_library, catalogue, diagnose, make_test_plan
from rso.discrepancy.evidence.any_network import distance
from rso.discrepancy.evidence.attribution import set_up
from rso.discrepancy.library.interpolation import late
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.simulations import rests_at

MU, MORE, FLOW, PEAK = 0.012, 0.5, 0.4, 3.0


@dataclass(frozen=True)
class SoakedKnobs:
    mu: float = knob("shear modulus", "MPa", 1e-5, 10.0)
    more: float = knob("what liquid adds", "1", 0.0, 5.0, neutral=0.0, group="flow", plausible=(0.03, 1.0))
    flow: float = knob("how quickly it leaves", "mm^2/s", 0.0, 1e6, default=1.0, group="flow", plausible=(0.02, 20.0))
    g: float = knob("relaxing share", "1", 0.0, 0.9, neutral=0.0, group="relaxation", plausible=(0.03, 0.6))
    tau: float = knob("relaxation time", "s", 1e-3, 1e3, default=3.0, group="relaxation", plausible=(0.3, 100.0))


def soaked(values: Mapping[str, float], t: np.ndarray, u: np.ndarray, radius: float) -> np.ndarray:
    """Fz (n,): μ u^1.5 (1 + more exp(−√(flow t)/(2 R))) · (1 − g + g e^{−t/τ}), t since contact."""
    more, flow = values.get("more", 0.0), values.get("flow", 1.0)
    g, tau = values.get("g", 0.0), values.get("tau", 3.0)
    left = 1.0 - g * -np.expm1(-t / tau)
    return values["mu"] * u**1.5 * (1.0 + more * np.exp(-np.sqrt(flow * t) / (2.0 * radius))) * left


@dataclass(frozen=True)
class Soaked:
    """Backend of `rso.contract` with `R` (mm) as its only setting."""

    name: str = "soaked toy"
    numerics: int = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return parameters_of(SoakedKnobs)

    @property
    def channels(self) -> Mapping[str, str]:
        return {"time": "s", "travel": "mm", "Fz": "N"}

    def check(self, case: Case) -> None: ...

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        v, programme = drop_neutral(self.parameters, values), case.programme
        for size, shape in (("more", "flow"), ("g", "tau")):
            if size not in v:
                v.pop(shape, None)
        if not {"more", "g"} & set(v):
            programme = Programme.ramp(programme.asked_mm, 1.0)
        return v, Case(case.name, programme, case.settings)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        return {}

    def make(self, recipe: str) -> bytes:
        raise ValueError("no artefacts")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        p = case.programme
        deep = np.array(p.asked_mm)
        moments = [np.interp(deep, p.travel_mm[:2], p.time_s[:2]), p.asked_s]
        t = np.unique(np.concatenate(moments).round(12))
        u = np.interp(t, p.time_s, p.travel_mm)
        F = soaked(values, t, u, case.settings["R"])
        return Response({"time": t, "travel": u, "Fz": F}, self.channels, {"Fz": 1e-3 * F})


BODY = Soaked()


def held(radius: float, speed: float, truth: Mapping[str, float], seed: int = 0, white: float = 1e-4) -> Experiment:
    """Three repeats of a ramp and a rest of 60 s."""
    rng, ramp = np.random.default_rng(seed), PEAK / speed
    t = np.concatenate([np.linspace(ramp / 30.0, ramp, 30), ramp + np.geomspace(0.05, 60.0, 60)])
    u = np.minimum(t * speed, PEAK)
    segment = np.where(t > ramp, "hold", "loading")
    F = soaked(truth, t, u, radius)
    repeats = tuple(
        Repeat(
            str(k),
            u,
            t,
            {"Fz": F * (1 + 2e-3 * rng.standard_normal()) + white * rng.standard_normal(len(t))},
            {},
            segment,
        )
        for k in range(3)
    )
    measurement = Measurement(Path("held"), "force", repeats, ())
    noise = Noise(Fz=white, gain=2e-3)
    return Experiment(f"R{radius:g} v{speed:g}", "fit", measurement, noise, ("Fz",), {"R": radius}, speed)


def library_of(*experiments: Experiment):
    base = Base(BODY, "mu", MU, 0.5 * MU, 2.0 * MU, (), {}, {})
    effects = tuple(e for e in catalogue(BODY, {}, {}, ("mu",)) if e.name in ("more", "g", "offset", "lag"))
    return build_library(base, make_test_plan(experiments), effects, lambda tasks: run(tasks, BODY))


FLOWS = {"mu": MU, "more": MORE, "flow": FLOW}
RELAXES = {"mu": 1.4 * MU, "g": 0.3, "tau": 6.0}
EACH = {"two radii": ((1.0, 0.5), (3.0, 0.5)), "one": ((2.0, 0.5),)}


@pytest.fixture(scope="module")
def plans():
    return {name: library_of(*(held(R, v, FLOWS) for R, v in each)) for name, each in EACH.items()}


def test_a_rest_is_that_of_the_body_at_every_radius_and_rate():
    """Of a size and a rate between nodes: 3 % of what flows, nowhere exponential."""
    library = library_of(held(1.0, 0.2, FLOWS, white=0.0), held(3.0, 2.0, FLOWS, white=0.0))
    (effect,) = (e for e in library.effects if e.name == "more")
    got = MU * predict(library, [effect], np.array([[MORE, np.log(FLOW)]]), MU)[0][0]
    for test, _, at in library.plan.rows():
        radius = library.plan.experiments[test.experiment].settings["R"]
        u = np.minimum(test.depth, PEAK)
        want = soaked(FLOWS, test.time, u, radius)
        flowing = want - soaked({"mu": MU}, test.time, u, radius)
        np.testing.assert_allclose(got[at][test.held], want[test.held], rtol=0, atol=0.03 * flowing.max())


def test_what_flows_has_all_nodes_at_every_place_and_a_rest_at_each(plans):
    library = plans["two radii"]
    tables = [here.effects["more"] for here in library.places]
    assert len({len(t.nodes.points) for t in tables}) == 1
    assert all(len(rests_at(library.plan, k)) == 1 for k in range(2))
    assert not np.allclose(tables[0].rests, tables[1].rests, atol=0.02)
    assert library.places[0].effects["g"].rests is None


def test_twice_the_speed_is_half_the_rate(plans):
    (effect,) = (e for e in plans["one"].effects if e.name == "more")
    np.testing.assert_allclose(late(effect, 2.0), [0.0, -np.log(2.0)])
    (other,) = (e for e in plans["one"].effects if e.name == "g")
    np.testing.assert_allclose(late(other, 2.0), [0.0, np.log(2.0)])


def test_a_network_of_times_is_like_it_at_one_radius_alone(plans):
    found = {}
    for name, library in plans.items():
        shared = set_up(library, library.plan.values())
        (effect,) = (e for e in library.effects if e.name == "more")
        found[name] = distance(shared, effect, np.array([MORE, np.log(FLOW)]), MU)
    assert found["one"] < 4.0 < found["two radii"]


@pytest.mark.parametrize("each", [pytest.param("two radii", marks=pytest.mark.verification), "one"])
def test_the_verdict_names_both_where_nothing_tells_them_apart(each, plans):
    named = set(diagnose(plans[each], 0, nulls=100).named)
    assert named == ({"more", "g"} if each == "one" else {"more"})


@pytest.mark.verification
def test_a_network_is_not_taken_for_a_flow():
    found = diagnose(library_of(*(held(R, v, RELAXES) for R, v in EACH["two radii"])), 0, nulls=100)
    assert found.named[0] == "g" and "more" not in found.named
