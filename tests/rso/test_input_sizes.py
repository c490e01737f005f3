"""[uncertainty] beside the sizes that it belongs to: which there are, which tests feel them, and what cannot be."""

import json

import indentation_backend
import numpy as np
import pytest
import sample_studies as studies

import rso
from rso.calibration.input_sides import touched
from rso.calibration.plan import make_plan
from rso.calibration.stated_settings import exact_dimensions
from rso.calibration.uncertain_inputs import count, said_of_inputs
from rso.cli import main
from rso.contract import Parameter, capability
from rso.contract.capabilities import Gauges, StatedDimensions
from rso.core.default_backend import DEFAULT_BACKEND
from rso.evaluation.adapters import load_backend
from rso.evaluation.joint import BACKEND_SETTING, joint
from rso.report.model_selection.report import report as ladder_page
from rso.report.optimal_design.report import report as next_page
from rso.study.deck_table import deck_parameter
from rso.study.dimensions import dimension_errors
from rso.study.errors import StudyError, choices_text
from rso.study.loader import load_study
from rso.study.schema import ParameterTable

SLAB = 'specimen = { shape = "slab", thickness = 8.0 }'
BALL = 'indenter = { shape = "sphere", radius = 3.0 }'
PUCK = 'specimen = { shape = "cylinder", radius = 10.0, height = 12.0 }'
PLATE = 'indenter = { shape = "plate" }'
BONDED = 'support = { kind = "bonded" }'
ONE = 'mu = { low = "6 kPa", high = "20 kPa", scale = "log" }\nD1 = { value = 60 }'
LOUD = studies.SECTIONS["[experiments]"].replace("0.02 mN", "2 mN")


def test_study(tmp_path, settings, tests, uncertainty="", more=""):
    """A study of finite elements: settings of the backend, and of each test by its name."""
    for k, name in enumerate(tests):
        (tmp_path / f"{name}.csv").write_text(studies.measured(thickness=8.0 - k))
    r = np.linspace(0.0, 4.0, 41)
    (tmp_path / "tip.csv").write_text("r_mm,z_mm\n" + "".join(f"{a!r},{a * a / 6!r}\n" for a in r.tolist()))
    text = (
        '[study]\ntitle = "sizes"\nseed = 0\n[backend]\nuse = "fem_backend.backend:BACKEND"\n[backend.settings]\n'
        + "\n".join(settings)
        + f'\nmesh = {{ level = "coarse" }}\n{more}\n[parameters]\nmu = {{ low = "4 kPa", high = "25 kPa" }}\n'
        + f"D1 = {{ value = 10 }}\n[uncertainty]\n{uncertainty}\n"
    )
    for name, own in tests.items():
        text += f'[[experiments]]\nname = "{name}"\nrole = "fit"\ndata = "{name}.csv"\n{own}\n'
    file = tmp_path / "study.toml"
    file.write_text(text)
    return file


test_study.__test__ = False


def planned(*arguments, **more):
    return make_plan(load_study(test_study(*arguments, **more)))


BODY = [SLAB, BALL, BONDED]


@pytest.mark.parametrize(
    ("settings", "dimensions"),
    [
        (BODY, ["delta_thickness", "delta_R"]),
        (
            [SLAB.replace(" }", ", layers = [{ thickness = 2.0, ratio = 3.0 }] }"), BALL, BONDED],
            ["delta_thickness", "delta_layer", "delta_R"],
        ),
        ([PUCK, PLATE, BONDED], ["delta_radius", "delta_height"]),
        (
            [SLAB, BALL, 'support = { kind = "well", radius = 9.0, base = "bonded", wall = "slip" }'],
            ["delta_thickness", "delta_well", "delta_R"],
        ),
        ([SLAB, 'indenter = { shape = "profile", file = "tip.csv" }', BONDED], ["delta_thickness", "profile_scale"]),
        (
            [SLAB, 'indenter = { shape = "cone", half_angle = 60.0, tip_radius = 0.5 }', BONDED],
            ["delta_thickness", "delta_half_angle", "delta_tip_radius"],
        ),
        (
            [SLAB, 'indenter = { shape = "flat", radius = 2.0, fillet = 0.3 }', BONDED],
            ["delta_thickness", "delta_punch_radius", "delta_punch_fillet"],
        ),
    ],
)
def test_every_stated_size_counts_as_exact_until_it_is_stated(tmp_path, settings, dimensions):
    """Of a share of a size (a scale) too, which is 1 where it is right, and of what carries the specimen."""
    plan = planned(tmp_path, settings, {"a": ""})
    assert set(exact_dimensions(plan)) == set(dimensions)
    sizes = capability(plan.backend, StatedDimensions).dimensions(plan.study.settings_of("a"))
    assert set(dimensions) <= set(sizes)


def test_of_several_backends_each_has_its_own(tmp_path):
    other = f'[backends.puck]\nuse = "fem_backend.backend:BACKEND"\n[backends.puck.settings]\n{PUCK}\n{PLATE}\n{BONDED}'
    plan = planned(tmp_path, BODY, {"ball": "", "plate": 'backend = "puck"'}, more=other)
    assert set(exact_dimensions(plan)) == {"delta_thickness", "delta_R", "delta_radius", "delta_height"}


def test_what_the_first_of_several_backends_cannot_say_a_further_one_may():
    @rso.model(parameters={"k": (0.1, 10.0, "N/mm")})
    def spring(travel, k):
        return k * travel

    class Gauged(indentation_backend.Layer):
        def gauges(self, settings):
            return {"radius": ("callipers", 0.01)}

    both = joint(spring, {"layer": Gauged()})
    found = capability(both, Gauges)
    assert found.gauges({"backend": "layer"}) == {"radius": ("callipers", 0.01)} and found.gauges({}) == {}
    assert capability(joint(spring, {"other": spring}), Gauges) is None


TWO = {"ball": "", "plate": f"settings = {{ {PUCK}, {PLATE} }}"}


def test_a_test_that_does_not_feel_a_size_is_not_simulated_for_it(tmp_path):
    """A plate has no radius: the key of its run has none, and so it is for every backend and every effect."""
    plan = planned(tmp_path, BODY, TWO, "delta_R = 0.05\ndelta_height = 0.1")
    assert count(plan) == 2 + 2 * 1 + 2 * 1
    said = [line for line in said_of_inputs(plan) if "±" in line]
    assert said[0].endswith("; in 'ball'") and "±50 µm of 3 mm" in said[0]
    assert said[1].endswith("; in 'plate'") and "of 12 mm" in said[1]


def test_what_tests_share_is_said_and_that_sizes_differ(tmp_path):
    thin = f"settings = {{ {SLAB.replace('8.0', '5.0')} }}"
    plan = planned(tmp_path, BODY, {"tall": "", "thin": thin}, "delta_thickness = 0.1\ndelta_R = 0.02")
    *each, said = said_of_inputs(plan)
    assert [line.endswith("; one error in 'tall' and 'thin'") for line in each] == [True] * 2
    assert "delta_thickness is one error in tests that state several sizes: 8 mm in 'tall', 5 mm in 'thin'" in said
    assert 'have an error each: then write uncertainty = { delta_thickness = "…" } under each' in said
    own = {n: f"{t}\nuncertainty = {{ delta_thickness = 0.1 }}" for n, t in (("tall", ""), ("thin", thin))}
    apart = said_of_inputs(planned(tmp_path, BODY, own, "delta_R = 0.02"))
    assert [line.endswith(f"; in {n!r}") for line, n in zip(apart[1:], ("tall", "thin"), strict=False)] == [True] * 2


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            'delta_thickness = "20 mm"',
            ("delta_thickness = '20 mm'", "not below the size itself, 8 mm", "usual is 32 µm"),
        ),
        ("delta_R = 3.0", ("delta_R = 3.0", "not below the size itself, 3 mm", "usual is 10 µm")),
        ('delta_R = "-1 um"', ("delta_R = '-1 um'", "above 0 is expected, such as '50 µm'", "counts as exact")),
        ('delta_R = "0 mm"', ("delta_R = '0 mm'", "above 0 is expected, such as '50 µm'")),
        ('delta_R = "3 kPa"', ("delta_R = '3 kPa'", "'kPa' is not a unit of the kind 'mm'")),
    ],
)
def test_an_uncertainty_that_cannot_be_is_refused_with_what_is_usual(tmp_path, table, words):
    with pytest.raises(StudyError) as error:
        planned(tmp_path, BODY, {"a": ""}, table)
    assert "study.toml:" in str(error.value) and all(w in str(error.value) for w in words)


def test_a_large_uncertainty_is_remarked_upon_and_a_side_that_is_not_modelled(tmp_path):
    lines = said_of_inputs(planned(tmp_path, BODY, {"a": ""}, "delta_thickness = 7.0"))
    assert any("±7 mm is 88 % of the 8 mm" in line and "usual is 32 µm" in line for line in lines)
    assert any("one standard uncertainty less (delta_thickness = -7 mm" in line for line in lines)
    assert len(said_of_inputs(planned(tmp_path, BODY, {"a": ""}, "delta_thickness = 2.0"))) == 2


class Hollow(indentation_backend.Layer):
    """A layer that knows the size of its sphere, and refuses small ones."""

    least = 2.8

    def dimensions(self, settings):
        return {"radius": 3.0}

    def refused(self, values, case):
        return "the sphere is too small" if values.get("radius", 3.0) < self.least else None


def run(tmp_path, monkeypatch, uncertainty):
    monkeypatch.setattr(indentation_backend, "BACKEND", Hollow())
    changes = {**studies.QUICK, "parameters": ONE, "[experiments]": LOUD, "uncertainty": uncertainty}
    return studies.run(tmp_path, **changes)


def test_a_refused_side_is_not_run_and_said(tmp_path, monkeypatch):
    results = run(tmp_path, monkeypatch, "radius = 0.3")
    (said,) = [w for w in results["warnings"] if w.startswith("uncertainty:")]
    assert "radius has no simulation with one standard uncertainty less (the sphere is too small)" in said
    assert "the other side alone counts" in said and results["counts"]["failed"] == 0
    assert results["identification"]["inputs"]


def test_a_side_that_has_no_key_is_no_fault_of_the_program(tmp_path, monkeypatch):
    """A backend may refuse values already where it says which of them count."""

    def canonical(self, values, case):
        if values.get("radius", 3.0) < 2.8:
            raise ValueError("radius: there is no such sphere")
        return indentation_backend.Layer.canonical(self, values, case)

    monkeypatch.setattr(Hollow, "canonical", canonical, raising=False)
    results = run(tmp_path, monkeypatch, "radius = 0.3")
    (said,) = [w for w in results["warnings"] if w.startswith("uncertainty:")]
    assert "one standard uncertainty less (radius: there is no such sphere)" in said


def test_a_run_warns_of_a_large_uncertainty(tmp_path, monkeypatch):
    monkeypatch.setattr(Hollow, "least", 0.0)
    results = run(tmp_path, monkeypatch, "radius = 1.5")
    (said,) = [w for w in results["warnings"] if w.startswith("uncertainty:")]
    assert "±1.5 mm is 50 % of the 3 mm" in said and "a hundredth of it would be 30 µm" in said


def test_settings_that_cannot_be_read_are_what_is_wrong(tmp_path):
    """Sizes of a body are asked of settings that are right."""
    for table, wrong in (("delta_R = 0.02", "thickness = -8.0"), ("delta_q = 1", "delta_q = 1: no input")):
        with pytest.raises(StudyError) as error:
            planned(tmp_path, [SLAB.replace("8.0", "-8.0"), BALL, BONDED], {"a": ""}, table)
        assert wrong in str(error.value)


def test_of_many_names_those_of_the_study_come_first_and_eight_at_most(tmp_path):
    with pytest.raises(StudyError) as error:
        planned(tmp_path, BODY, {"a": ""}, "delta_thicknes = 0.1")
    text = str(error.value)
    listed = text.split("choose from ")[1].split(" and ")[0].split(", ")
    assert (
        listed[:2] == ["delta_thickness", "delta_R"] and len(listed) == 8 and "did you mean 'delta_thickness'?" in text
    )
    assert text.endswith("more: python -m fem_backend --schema lists them")
    names = [f"name_{k}" for k in range(40)]
    assert choices_text("name_7", names, first=["name_39"]).startswith("did you mean 'name_39'? choose from name_39, ")
    assert choices_text("nam", ["mu", "D1"], first=["mu"]) == "choose from mu, D1"


SPRING = """import rso

@rso.model(parameters={"E": (1e-3, 10.0, "MPa"), "R": (0.1, 20.0, "mm")})
def press(travel, E, R):
    return 16 / 9 * E * R**0.5 * travel**1.5
"""


def test_a_fixed_value_of_any_backend_may_be_uncertain(tmp_path, monkeypatch):
    """A function of one's own: the ball was one standard uncertainty larger than stated. E goes with R^(-1/2)."""
    (tmp_path / "half_space_of_sizes.py").write_text(SPRING)
    monkeypatch.syspath_prepend(str(tmp_path))
    h = np.linspace(0.1, 2.0, 20)
    F = 16 / 9 * 0.03 * 3.2**0.5 * h**1.5 + 1e-4 * np.random.default_rng(0).standard_normal(20)
    rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(h.tolist(), F.tolist(), strict=True))
    changes = {
        **studies.QUICK,
        "backend": 'use = "half_space_of_sizes:press"',
        "backend.settings": None,
        "parameters": 'E = { low = "10 kPa", high = "60 kPa", scale = "log" }\nR = { value = "3 mm" }',
        "[experiments]": studies.SECTIONS["[experiments]"].replace("0.02 mN", "0.1 mN"),
        "uncertainty": 'R = "0.2 mm"',
    }
    file = studies.write(tmp_path, **changes)
    (tmp_path / "top.csv").write_text("depth_mm,Fz_N\n" + rows)
    assert said_of_inputs(make_plan(load_study(file)))[0] == "  R: ±0.2 mm of 3 mm"
    found = studies.run(tmp_path, **changes)["identification"]
    low, high = found["parameters"][0]["interval"]
    assert low < 0.03 < high
    # 90 % of a standard uncertainty of ½ · 0.2 / 3
    assert 0.5 * np.log(high / low) == pytest.approx(1.645 * 0.5 * 0.2 / 3.0, rel=0.05)


def test_a_fixed_value_of_a_deck_may_be_off_by_as_much_as_itself():
    for value, bounds in (("3 mm", (0.0, 6.0)), (-2.0, (-4.0, 0.0))):
        declared, (low, high) = deck_parameter("R", ParameterTable(value=value))
        assert (declared.low, declared.high) == bounds and low == high


def test_what_a_new_study_offers_as_a_comment_can_be_stated_as_it_is(tmp_path):
    """Also of a scale, which has no unit."""
    test_study(tmp_path, BODY, {"a": ""}).unlink()
    file = tmp_path / "study.toml"
    body = ["--slab", "8", "--profile", str(tmp_path / "tip.csv"), "--out", str(file)]
    assert main(["new", str(tmp_path / "a.csv"), *body]) == 0
    lines = file.read_text("utf-8").splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith("# [uncertainty]"))
    assert '# profile_scale = "1 %"  # <- if measured with care' in lines[begin + 1 :]
    lines[begin : begin + 3] = [line.removeprefix("# ") for line in lines[begin : begin + 3]]
    file.write_text("\n".join(lines) + "\n", "utf-8")
    assert [i.name for i in make_plan(load_study(file)).resolved.inputs] == ["delta_thickness", "profile_scale"]


class Gauged(Hollow):
    """One whose sphere can be measured."""

    least = 0.0

    def plausible(self, settings, given):
        return {"radius": (2.9, 3.1)}

    def gauges(self, settings):
        return {"radius": ("callipers", 0.01)}


def test_ladder_and_next_say_what_counts_as_exact(tmp_path, monkeypatch):
    monkeypatch.setattr(indentation_backend, "BACKEND", Gauged())
    tables = {
        "ladder": 'levels = [{ name = "study" }]\nruns = 8\ndraws = 99',
        "next": "truths = { mu = [0.012] }\nruns = 8\ndraws = 10",
    }
    file = studies.write(tmp_path, **{**studies.QUICK, "parameters": ONE, "[experiments]": LOUD, **tables})
    for way, page in (("ladder", ladder_page), ("next", next_page)):
        done = studies.command(way, file)
        assert done.returncode == 0, done.stderr
        found = json.loads((tmp_path / f"results/{way}.json").read_text("utf-8"))
        assert found["exact_inputs"] == ["radius"] and found["stated_inputs"] == []
        assert "count as exact. The table [uncertainty] of the study says how well they are known: radius." in str(
            page(found)
        )


def test_a_side_beyond_the_bounds_makes_no_other_test_feel_an_input(tmp_path):
    """The friction of a plate cannot be negative: that says nothing of a test whose specimen is bonded.

    Nor does that test, which states none, state another than the usual one.
    """
    tests = {kind: f'settings = {{ support = {{ kind = "{kind}" }} }}' for kind in ("plate", "bonded")}
    plan = planned(tmp_path, [SLAB, BALL], tests, "plate_friction = 0.1")
    (one,) = plan.resolved.inputs
    assert touched(plan, one) == (plan.case_of["plate"],)
    assert any("; in 'plate'" in line for line in said_of_inputs(plan))


def test_a_further_backend_that_names_no_sizes_keeps_the_errors_of_its_gauges():
    """Of one that names none they are told by what is 0 where nothing is said, beside whichever first backend."""

    class Gauged(indentation_backend.Layer):
        @property
        def parameters(self):
            off = Parameter("off", "an error", "mm", -1.0, 1.0, default=0.0, plausible=(-0.1, 0.1))
            return (*super().parameters, off)

        def gauges(self, settings):
            return {"off": ("callipers", 0.01)}

    both = joint(load_backend(DEFAULT_BACKEND), {"layer": Gauged()})
    assert dimension_errors(both, {BACKEND_SETTING: "layer"}) == dimension_errors(Gauged(), {}) != {}


def test_the_size_of_what_a_table_states_is_that_of_the_table(tmp_path):
    """Not the usual friction of a bowl, 0.2."""
    body = ['specimen = { shape = "ellipsoid", semi_axes = [60, 35, 35] }', BALL]
    bowl = 'support = { kind = "bowl", friction = 0.5 }'
    plan = planned(tmp_path, [*body, bowl], {"a": ""}, "bowl_friction = 0.25")
    assert any("is 50 % of the 0.5" in line for line in said_of_inputs(plan))
    with pytest.raises(StudyError, match=r"not below the size itself, 0\.5"):
        planned(tmp_path, [*body, bowl], {"a": ""}, "bowl_friction = 0.6")
