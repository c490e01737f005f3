"""Every way of not having an answer: its cause class, its words, and what was reached."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.indenters.sphere import Sphere
from fem_backend.solver import load_steps, newton
from fem_backend.solver.load_steps import Control, Stopped
from rso.contract import CAUSES, Case, Programme, SimulationFailed

SMALL = {"mesher": "mapped", "n": 6, "slip": 0.3}
VALUES = {"mu": 0.01, "D1": 5.8}


def failed(values, asked=(0.5, 1.0), **settings) -> SimulationFailed:
    with pytest.raises(SimulationFailed) as caught:
        BACKEND({**VALUES, **values}, Case("c", Programme.ramp(tuple(asked), 1.0), {"mesh": SMALL, **settings}))
    assert caught.value.cause in CAUSES
    return caught.value


# ---------------------------------------------------------------------------------------------- values


@pytest.mark.parametrize(
    "values,settings,words",
    [
        ({"delta_c": -36.0}, {}, ["delta_c = -36", "semi-axes", "-1", "larger than 7 mm"]),
        ({"delta_R": -3.0}, {}, ["delta_R = -3 mm", "indenter of 0 mm", "larger than 0", "at most 21 mm"]),
        ({"delta_R": 20.0}, {}, ["delta_R = 20 mm", "indenter of 23 mm", "at most 21 mm"]),
        ({"offset_x": 70.0}, {}, ["mm"]),
        ({"delta_a": -40.0}, {"point": [25.0, 0.0]}, ["point", "25", "not above"]),
        ({"inclusion_ratio": 3.0, "inclusion_radius": 50.0}, {}, ["inclusion"]),
        ({"inclusion_ratio": 3.0, "inclusion_x": 59.0}, {}, ["inclusion"]),
        ({"cavity": 9.0}, {}, ["cavity"]),
        ({}, {"mesh": {"mesher": "mapped", "n": 6, "slip": 0.6}}, ["mesh", "volume"]),
        ({"delta_a": -20.0}, {"profile": [[50.0, 0.0]]}, ["profile"]),
    ],
)
def test_bad_geometry(values, settings, words):
    failure = failed(values, **settings)
    assert failure.cause == "bad_geometry" and failure.partial is None
    for word in words:
        assert word in failure.reason, failure.reason


@pytest.mark.parametrize("values", [{"delta_c": -0.68}, {"delta_R": 0.39}])
def test_a_specimen_as_flat_as_settings_may_say_has_all_errors_that_are_plausible(values):
    """A ball of half its smallest semi-axis: a pad that is thinner still is no other body."""
    flat = {"specimen": {"semi_axes": [20.0, 16.0, 8.0]}, "indenter": {"radius": 4.0}, "mesh": SMALL}
    own = BACKEND.plausible(flat)
    for name, value in values.items():
        assert own[name][0] <= value <= own[name][1]
    case = Case("c", Programme.ramp((0.5,), 1.0), flat)
    plain, other = BACKEND(VALUES, case), BACKEND({**VALUES, **values}, case)
    assert other.channels["Fz"][0] > plain.channels["Fz"][0]  # a thinner pad, or a wider ball, is stiffer


@pytest.mark.parametrize(
    "values,settings",
    [
        ({"prony_g": 0.6, "prony_g2": 0.5}, {}),
        ({"prony_g": 0.5, "prony_g2": 0.3, "prony_g3": 0.2}, {}),
        ({"prony_g": 0.5}, {"material": {"prony": [[0.6, 1.0]]}}),
    ],
)
def test_prony_shares_that_leave_nothing_are_inadmissible(values, settings):
    failure = failed(values, **settings)
    assert failure.cause == "inadmissible" and "Prony" in failure.reason and "1" in failure.reason


@pytest.mark.parametrize(
    "values,law",
    [
        ({"C01": 1e-3, "C20": 1e-3}, "neo_hookean"),
        ({"C30": 1e-3, "alpha": 3.0}, "neo_hookean"),
        ({"C01": 1e-3}, "yeoh"),
        ({"alpha": 3.0}, "mooney_rivlin"),
        ({"C20": 1e-3}, "linear_elastic"),
        ({"fibre": 1e-3}, "linear_elastic"),
        ({"prony_g": 0.1}, "linear_elastic"),
        ({"mullins": 0.1}, "linear_elastic"),
    ],
)
def test_laws_that_do_not_combine_are_not_supported(values, law):
    failure = failed(values, material={"law": law})
    assert failure.cause == "not_supported" and "law" in failure.reason


@pytest.mark.parametrize(
    "values,settings", [({}, {"point": [20.0, 0.0]}), ({"tilt_y": 2.0}, {}), ({"offset_y": 1.0}, {})]
)
def test_small_strains_of_a_body_that_may_turn_are_not_supported(values, settings):
    """sym ∇u of a rotation by θ is θ²/2: it resists being turned, and forces are wrong by as much as they are."""
    bowl = {"material": {"law": "linear_elastic"}, "support": {"kind": "bowl", "friction": 0.0}, **settings}
    failure = failed(values, **bowl)
    assert failure.cause == "not_supported"
    for word in ("linear_elastic", "bowl", "neo_hookean"):
        assert word in failure.reason
    case = Case("c", Programme.ramp((0.5,)), {"mesh": SMALL, **bowl})
    assert BACKEND.refused({**VALUES, **values}, case) == failure.reason
    for other in ({"material": {}}, {"support": {}}, {"point": [0.0, 0.0]} if not values else {"material": {}}):
        assert BACKEND.refused({**VALUES, **values}, replace(case, settings={**case.settings, **other})) is None


@pytest.mark.parametrize(
    "values,law", [({"C01": 1e-3}, "mooney_rivlin"), ({"alpha": 3.0}, "ogden"), ({"C20": 1e-4}, "yeoh")]
)
def test_a_knob_switches_its_law_on(values, law):
    """Negative control: the law named in the settings or not, the same answer."""
    answers = [
        BACKEND({**VALUES, **values}, Case("c", Programme.ramp((0.5,)), {"mesh": SMALL, "material": {"law": name}}))
        for name in ("neo_hookean", law)
    ]
    np.testing.assert_array_equal(answers[0].channels["Fz"], answers[1].channels["Fz"])


# ---------------------------------------------------------------------------------------------- runs that end early


def test_what_was_reached_comes_with_the_failure():
    """10.5 mm into elements of 5 mm: the curve so far is that of a run that ends there, within what both state."""
    failure = failed({}, (0.5, 1.0, 10.5))
    assert failure.cause in ("inversion", "step_limit", "instability", "contact")
    assert failure.history and {"iteration", "residual"} == set(failure.history[0])
    assert failure.__cause__ is None and failure.__context__ is None  # no state of the solver travels with it
    reached = failure.partial.channels
    assert reached["travel"].tolist() == [0.5, 1.0]
    whole = BACKEND(VALUES, Case("c", Programme.ramp((0.5, 1.0), 1.0), {"mesh": SMALL}))
    for name in ("Fz", "uz_max"):
        off, stated = np.abs(reached[name] - whole.channels[name]), failure.partial.error[name] + whole.error[name]
        assert np.all(off <= stated), name
    assert "mm" in failure.reason


@pytest.mark.parametrize(
    "values", [{"prony_g": 0.2}, {"friction": 0.3}, {"mullins": 0.3}], ids=["prony", "friction", "mullins"]
)
def test_what_a_path_reached_comes_with_the_failure(values, brittle):
    failure = failed(values, (0.25, 0.5, 3.0))
    assert failure.cause == "inversion" and failure.history
    reached = failure.partial.channels
    assert reached["travel"].tolist() == [0.25, 0.5]
    whole = BACKEND({**VALUES, **values}, Case("c", Programme.ramp((0.25, 0.5), 1.0), {"mesh": SMALL})).channels
    for name, channel in whole.items():
        np.testing.assert_allclose(reached[name], channel, rtol=1e-9, err_msg=name)


@pytest.fixture
def brittle(monkeypatch):
    """Elements that turn over beyond some displacement, whatever the step."""
    true = newton.evaluate_system

    def evaluate(system, u, load):
        if u[:, 2].min() < -0.6:
            raise newton.stress.Inverted("element 7 is inside out")
        return true(system, u, load)

    monkeypatch.setattr(newton, "evaluate_system", evaluate)


def test_inversion_is_said_where_no_step_is_small_enough(small, brittle):
    with pytest.raises(Stopped) as stopped:
        small.solve([0.5, 2.0])
    assert stopped.value.cause == "inversion" and [p.travel for p in stopped.value.points] == [0.5]
    assert stopped.value.counters.cutbacks > 2


def test_a_run_that_fails_is_tried_once_more_in_shorter_steps(small, monkeypatch):
    """Whatever the steps the answer is that of the run that does not fail; a second failure is one."""
    true, tried = load_steps.follow_travel, []

    def travel(system, start, asked, control, *rest):
        tried.append(control.first)
        if len(tried) in fails:
            raise Stopped("instability", "no", [], (), rest[0])
        return true(system, start, asked, control, *rest)

    fails = {1}
    monkeypatch.setattr(load_steps, "follow_travel", travel)
    other = small.solve([0.5, 1.0])
    assert len(tried) == 2 and tried[1] < tried[0]
    tried.clear()
    fails = {1, 2}
    with pytest.raises(Stopped):
        small.solve([0.5, 1.0])
    assert len(tried) == 2
    monkeypatch.setattr(load_steps, "follow_travel", true)
    np.testing.assert_allclose(other.Fz, small.solve([0.5, 1.0]).Fz, rtol=1e-8)


def test_indefinite_tangent_is_an_instability(small, monkeypatch):
    """A matrix that no shift repairs."""

    def refuse(data):
        raise newton.NotPositiveDefinite("negative pivot")

    broken = replace(small, model=replace(small.model, factor=refuse))
    with pytest.raises(Stopped) as stopped:
        broken.solve([0.5])
    assert stopped.value.cause == "instability" and stopped.value.points == []


@pytest.fixture
def clock(monkeypatch):
    """Process time that goes on by one second whenever somebody looks."""
    ticks = itertools.count()
    monkeypatch.setattr(newton.time, "process_time", lambda: float(next(ticks)))


@pytest.mark.parametrize("knobs", [{}, {"prony_g": 0.2}, {"friction": 0.2}, {"weight": 1e-5}])
def test_time_limit_ends_a_run_and_keeps_what_was_reached(make_bench, clock, knobs):
    """Enough for the first asked travel, not for the third."""
    b = make_bench(knobs)
    with pytest.raises(Stopped) as stopped:
        b.solve([0.25, 1.0, 3.0], control=replace(Control(), time_limit_s=16.0))
    assert stopped.value.cause == "time_limit", str(stopped.value)
    assert len(stopped.value.points) < 3
    assert len(b.solve([0.25], control=replace(Control(), time_limit_s=1e9)).Fz) == 1  # negative control


def test_time_limit_is_not_mistaken_for_a_difficult_step(small, clock):
    """No cut-backs are tried when the time is over."""
    with pytest.raises(Stopped) as stopped:
        small.solve([3.0], control=replace(Control(), time_limit_s=4.0))
    assert stopped.value.cause == "time_limit" and stopped.value.counters.cutbacks <= 1


def test_step_limit_after_the_cut_backs_that_the_control_allows(small, monkeypatch):
    def never(*arguments, **more):
        raise newton.NotConverged("contact", "no", (1.0, 0.5))

    for knobs in ({}, {"prony_g": 0.3}):
        b = small.other(**knobs)
        with monkeypatch.context() as patch, pytest.raises(Stopped) as stopped:
            patch.setattr(newton, "solve", never)
            b.solve([1.0])
        assert stopped.value.cause == "step_limit" and 2 < stopped.value.counters.cutbacks < 12
        assert stopped.value.history == (1.0, 0.5) and load_steps.Stopped is Stopped


@pytest.mark.parametrize(
    ("values", "law"),
    [
        ({"C01": 0.012}, "mooney_rivlin"),
        ({"C01": -0.006}, "mooney_rivlin"),
        ({"C20": -2e-3}, "yeoh"),
        ({"C20": -4e-3}, "yeoh"),
    ],
)
def test_a_law_that_softens_over_the_stretches_reached_is_no_material(values, law):
    """Pressed less deep than to where the body gave way such a run returned a force, with nothing said."""
    failure = failed(values, (0.2, 1.0, 1.65), material={"law": law})
    assert failure.cause == "inadmissible" and "Drucker" in failure.reason and " mm" in failure.reason
    case = Case("c", Programme.ramp((0.2,), 1.0), {"mesh": SMALL, "material": {"law": law}})
    whole = BACKEND({**VALUES, **values}, case)
    np.testing.assert_allclose(failure.partial.channels["Fz"][0], whole.channels["Fz"][0], rtol=1e-8)
    assert failure.partial.channels["travel"].max() < 1.65


@pytest.mark.parametrize(
    ("values", "material"),
    [
        ({"C01": -0.01}, {"law": "mooney_rivlin"}),
        ({"C20": -2e-2}, {"law": "yeoh"}),
        ({}, {"law": "ogden", "ogden": [[8.0, -0.9]]}),
    ],
)
def test_a_law_that_cannot_reach_the_depth_is_refused_before_anything_is_meshed(values, material, monkeypatch):
    """By a strain that Hertz's contact reaches; what can be reached is not refused, and a skin forbids to foretell."""
    monkeypatch.setattr(
        "fem_backend.simulation.assembly.build_model", lambda *a, **k: pytest.fail("something was built")
    )
    at = {"mesh": SMALL, "material": material}
    case = Case("c", Programme.ramp((1.0, 2.0), 1.0), at)
    failure = failed(values, (1.0, 2.0), material=material)
    assert failure.cause == "inadmissible" and failure.partial is None and " mm" in failure.reason
    assert BACKEND.refused({**VALUES, **values}, case) == failure.reason
    shallow = Case("c", Programme.ramp((0.02,), 1.0), at)
    assert BACKEND.refused({**VALUES, **values}, shallow) is None
    assert BACKEND.refused({**VALUES, **values, "skin_ratio": 3.0}, case) is None


def test_a_neo_hookean_body_is_strained_more_than_is_foretold():
    """The oracle is the run: what is foretold must be reached, but is no idle bound."""
    case = Case("c", Programme.ramp((0.5, 1.0, 2.0, 3.5), 1.0), {"mesh": {"level": "coarse"}, "derivatives": False})
    for point in BACKEND.solve(VALUES, case).result.points:
        F = point.evaluation.H.reshape(-1, 3, 3) + np.eye(3)
        shortest = np.sqrt(np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F)[:, 0].min())
        assert 1.0 < -np.log(shortest) / Sphere(3.0).strain(point.travel) < 1.7


@pytest.mark.parametrize("values", [{}, {"friction": 0.3}, {"D1": 139.0}], ids=["incompressible", "friction", "soft"])
def test_small_strains_end_where_the_body_would_turn_over(values):
    """Beyond, forces fell with depth and were called done; before, the curve is kept."""
    failure = failed(values, (1.0, 2.0, 8.0), material={"law": "linear_elastic"})
    assert failure.cause == "inadmissible" and "det(I + grad u)" in failure.reason and " mm" in failure.reason
    assert failure.partial.channels["travel"].tolist() == [1.0, 2.0]
    case = Case("c", Programme.ramp((8.0,), 1.0), {"mesh": SMALL, "material": {"law": "linear_elastic"}})
    assert "small-strain" in BACKEND.refused({**VALUES, **values}, case)
    assert BACKEND.refused({**VALUES, **values}, replace(case, programme=Programme.ramp((1.0,), 1.0))) is None


@pytest.mark.parametrize(
    ("values", "law"),
    [({"C01": 0.002}, "mooney_rivlin"), ({"C20": 1e-3}, "yeoh"), ({"alpha": -3.0}, "ogden"), ({"alpha": 1.2}, "ogden")],
)
def test_stable_laws_answer(values, law):
    case = Case("c", Programme.ramp((0.4, 0.8), 1.0), {"mesh": SMALL, "material": {"law": law}})
    assert BACKEND({**VALUES, **values}, case).channels["Fz"].min() > 0.0
