"""What backends may offer: every protocol with a toy backend that has it (docs/adding.md) and one that lacks it."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import rso.contract
from rso.calibration.cost_model import UNKNOWN_SIMULATION_S, Pace, _cost
from rso.contract import (
    CAPABILITIES,
    Backend,
    Case,
    Fingerprint,
    Parameter,
    Programme,
    Response,
    capability,
    lacking,
    run_key,
    unfit,
)
from rso.contract.capabilities import members
from rso.discrepancy.library.effects import catalogue
from rso.discrepancy.library.test_plan import Experiment, _depth_of_mean
from rso.discrepancy.study_diagnosis import _powered
from rso.evaluation.adapters import load_backend
from rso.study.new_study import NewTest, study_text

ROOT = Path(__file__).parents[2]
SETTINGS = {"thickness": 5.0, "radius": 2.0}
CASE = Case("case", Programme.ramp((0.5, 1.0)), SETTINGS)
U = np.array([0.5, 1.0])
VALUES = {"mu": 0.01}
ASKED = {  # what rso hands over, and a look at the answer
    "plausible": ((SETTINGS, {"C01"}), lambda v: v == {"delta_t": (-0.25, 0.25), "C20": None}),
    "dimensions": ((SETTINGS,), lambda v: v == {"delta_t": SETTINGS["thickness"]}),
    "nominal": ((SETTINGS,), lambda v: v == {"friction": 0.0}),
    "physical": ((), lambda v: v["weight"][0] < v["weight"][1]),
    "ordinary": ((), lambda v: list(v) == ["mu * D1 <= 3"]),
    "variants": ((SETTINGS,), lambda v: {"description", "settings", "group"} <= v["loose"].keys()),
    "levels": ((SETTINGS,), lambda v: [level["name"] for rung in v for level in rung] == ["layer", "yeoh"]),
    "closed_form": ((VALUES, CASE), lambda v: np.allclose(v.channels["Fz"], [0.08, 0.16])),
    "formulas": ((VALUES, CASE), lambda v: np.allclose(v[0].force, [0.08, 0.16]) and v[0].invalid[0] != ""),
    "start": ((CASE, U, 0.16 * U), lambda v: np.isclose(v["mu"][1], 0.01)),
    "hertz": ((SETTINGS, U, 0.16 * U), lambda v: np.isclose(v["mu"], 0.01)),
    "exponents": ((SETTINGS,), lambda v: v[0] == 1.0),
    "cost": ((VALUES, CASE), lambda v: v == 8.0),
    "resolution": ((SETTINGS, 1.0, ("mu",)), lambda v: v["coarse"] > v["fine"]),
    "reduction": ((VALUES, CASE), lambda v: v == "of revolution: solved on its meridian"),
    "refused": ((VALUES, CASE), lambda v: v is None),
    "deep": ((SETTINGS,), lambda v: v == 4.0),
    "tests": ((SETTINGS,), lambda v: v == {"a cylinder of twice the radius": {"radius": 4.0}}),
    "marks": ((SETTINGS,), lambda v: all(len(at) == 2 for places in v.values() for at in places)),
    "prevented": ((), lambda v: v == {"the tests again with oil": ("friction",)}),
    "setting_unit": ((SETTINGS, ("thickness",)), lambda v: v == "mm"),
    "gauges": ((SETTINGS,), lambda v: v["delta_t"][1] == 0.02),
    "sketch": ((SETTINGS, 1.0), lambda v: v.words and v.drawn[0].role == "specimen"),
    "deformed": ((VALUES, CASE), lambda v: v.frames[-1].travel == 1.0 and list(v.frames[-1].fields) == list(v.units)),
    "derived": ((SETTINGS, ("mu",)), lambda v: v[0].name == "E" and v[0].of({"mu": np.array([2.0])})[0] == 6.0),
    "options": ((), lambda v: [o.name for o in v] == ["thickness"]),
    "first_settings": (({"thickness": (5.0,)}, [1.0]), lambda v: v["thickness"].value == 5.0 and v["base"].guess),
    "first_parameters": ((SETTINGS, U, U), lambda v: v["mu"].value.keys() == {"low", "high", "scale"}),
}
BY_NAME = {kind.__name__: kind for kind in CAPABILITIES}


def example():
    """The class of docs/adding.md."""
    block = re.search(r"```python\n(.*?)```", (ROOT / "docs/adding.md").read_text("utf-8"), re.DOTALL)[1]
    names: dict = {}
    exec(block, names)
    return names["Slab"], block


SLAB, BLOCK = example()


class Bare:
    """What every backend has, and nothing else."""

    name, numerics, parameters, channels = "bare", 1, (), {"time": "s", "travel": "mm", "Fz": "N"}

    def check(self, case): ...

    def canonical(self, values, case):
        return dict(values), case

    def recipes(self, values, case):
        return {}

    def make(self, recipe):
        return b""

    def __call__(self, values, case):
        u = np.array(case.programme.asked_mm)
        return Response({"time": u, "travel": u, "Fz": u}, self.channels)


@pytest.mark.parametrize("name", BY_NAME)
def test_a_backend_has_or_lacks_each(name):
    kind = BY_NAME[name]
    toy, bare = SLAB(), Bare()
    assert capability(toy, kind) is toy and capability(bare, kind) is None
    assert lacking(bare, kind) == list(members(kind)) and not lacking(bare, Backend)
    for member in members(kind):
        if member in ASKED:
            arguments, right = ASKED[member]
            assert right(getattr(toy, member)(*arguments))
        off = type("Off", (SLAB,), {member: None})()  # taken back by a subclass
        assert capability(off, kind) is None


@pytest.mark.parametrize("name", BY_NAME)
def test_each_is_described_shown_to_the_outside_and_has_an_example(name):
    kind = BY_NAME[name]
    assert getattr(rso.contract, name) is kind and name in rso.contract.__all__
    assert "without it" in kind.__doc__ or name in ("ClosedForm", "Fingerprint")
    assert f"# {name}" in BLOCK
    for member in members(kind):
        assert getattr(kind, member).__doc__


def test_the_finite_elements_and_the_example_offer_all_and_fit():
    backend = load_backend("fem_backend.backend:BACKEND")
    assert [k.__name__ for k in CAPABILITIES if capability(backend, k) is None] == [
        "FilledInputs",
        "FreeCurves",
        "Fingerprint",
    ]
    assert unfit(backend) == unfit(SLAB()) == unfit(Bare()) == []


TOY = """
import sys
sys.path.insert(0, {here!r})
from test_capabilities import Bare

class Toy(Bare):
    {body}

BACKEND = Toy()
"""


def loaded(folder, body):
    """A bare backend with one member more, loaded as a study loads it; modules have a name each."""
    name = f"toy_{abs(hash(body))}"
    (folder / f"{name}.py").write_text(TOY.format(here=str(Path(__file__).parent), body=body))
    return load_backend(f"{name}:BACKEND", base=folder)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (
            "def variants(self): return {}",
            r"variants \(rso.contract.Variants\) is asked as variants\(settings\), but its",
        ),
        (
            "def plausible(self, settings): return {}",
            r"asked as plausible\(settings, given\).* arguments are \(settings\)",
        ),
        ("def cost(self, values, case, more): return 1.0", r"cost \(rso.contract.CostModel\)"),
        ("levels = 3", r"levels \(rso.contract.ModelHierarchy\) must be a method levels\(settings\), not int"),
        ("lean = 'cheap'", r"lean \(rso.contract.LeanSettings\) must be a table of settings, not str"),
    ],
)
def test_a_member_that_cannot_be_asked_is_an_error_when_loaded(tmp_path, body, said):
    with pytest.raises(ValueError, match=said):
        loaded(tmp_path, body)


@pytest.mark.parametrize(
    "body", ["def variants(self, s, more=1): return {}", "def variants(self, *a): return {}", "variants = None"]
)
def test_what_can_be_asked_is_loaded_whatever_its_arguments_are_called(tmp_path, body):
    assert loaded(tmp_path, body).name == "bare"


def test_a_key_holds_a_fingerprint_where_there_is_one():
    marked = type("Marked", (Bare,), {"fingerprint": "2026"})()
    empty = type("Empty", (Bare,), {"fingerprint": ""})()
    assert run_key(Bare(), {}, CASE) == run_key(empty, {}, CASE) != run_key(marked, {}, CASE)
    assert capability(marked, Fingerprint).fingerprint == "2026"


def test_a_cost_is_guessed_without_one():
    priced = type("Priced", (Bare,), {"cost": lambda self, values, case: 3.0})()
    assert _cost(Bare(), {}, CASE) == UNKNOWN_SIMULATION_S and _cost(priced, {}, CASE) == 3.0
    assert "kind of model" in Pace(priced, 1.0).basis and "kind of model" not in Pace(Bare(), 1.0).basis


def test_the_depth_of_a_mean_force_goes_by_the_exponent_of_the_indenter():
    u = np.array([1.0, 3.0])
    e = Experiment("a", "fit", None, None, ("Fz",), SETTINGS, 0.5)
    (flat,), (rounded,) = _powered(SLAB(), [e]), _powered(Bare(), [e])
    assert _depth_of_mean(u, flat.power) == 2.0
    assert _depth_of_mean(u, rounded.power) ** 1.5 == pytest.approx(np.mean(u**1.5))


def test_effects_are_those_of_the_settings_where_the_backend_says_so():
    knobs = (
        Parameter("delta_t", "error of the thickness", "mm", -9.0, 9.0, 0.0, 0.0, plausible=(-1.0, 1.0)),
        Parameter("C20", "stiffening", "MPa", 0.0, 9.0, 0.0, 0.0, plausible=(0.0, 1.0)),
        Parameter("friction", "friction", "1", 0.0, 1.0, 0.0, 0.0, plausible=(0.0, 0.6)),
    )
    settings = {**SETTINGS, "friction": 0.2}
    found = []
    for kind in (SLAB, Bare):
        backend = type("Toy", (kind,), {"parameters": knobs})()
        every = catalogue(backend, settings, {}, ["C01"])
        found.append({e.name: e.size for e in every if e.family == "model"})
    said, bare = found
    assert said.keys() == {"delta_t", "friction", "loose"} and bare.keys() == {"delta_t", "C20", "friction"}
    assert (said["delta_t"].high, bare["delta_t"].high) == (0.25, 1.0)
    assert (said["friction"].neutral, bare["friction"].neutral) == (0.2, 0.0)


# ------------------------------------------------------------------------------------------------ asked in one way


def untyped(source):
    """Lines of a source that ask a backend for what it may have by getattr or hasattr."""
    calls = (n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name))
    return [n.lineno for n in calls if n.func.id in ("getattr", "hasattr") and "backend" in ast.unparse(n.args[0])]


def test_no_backend_is_asked_untyped():
    found = {str(p.relative_to(ROOT)): untyped(p.read_text("utf-8")) for p in (ROOT / "rso").rglob("*.py")}
    assert {path for path, lines in found.items() if lines} == {"rso/contract/capabilities.py"}  # where it is asked


@pytest.mark.parametrize("source", ["getattr(backend, 'lean', {})", "if hasattr(plan.backend, 'cost'): pass"])
def test_an_untyped_question_is_caught(source):
    assert untyped(source) == [1]
    assert untyped("capability(backend, CostModel)\ngetattr(self, name)") == []


def test_a_study_begins_by_the_backend_that_can(tmp_path):
    (tmp_path / "a.csv").write_text("depth_mm,Fz_N\n" + "".join(f"{0.1 * k:.1f},{0.001 * k}\n" for k in range(20)))
    test, files = NewTest({"thickness": (5.0,)}), [str(tmp_path / "a.csv")]

    class Declared(SLAB):
        parameters = (Parameter("delta_t", "error of the thickness", "mm", -1.0, 1.0, default=0.0, neutral=0.0),)

    text = study_text(tmp_path / "study.toml", Declared(), test, files)
    assert '[backend.settings]\nthickness = 5.0\nbase = "glued"  # <- or slip\n\n[parameters]\nmu = { low' in text
    assert '# delta_t = "20 µm"  # <- if measured with care' in text
    with pytest.raises(ValueError, match="'bare' begins no study"):
        study_text(tmp_path / "study.toml", Bare(), test, files)


def test_a_record_that_no_value_explains_is_named(tmp_path):
    class Refusing(SLAB):
        def first_parameters(self, settings, depth, force):
            raise ValueError("which is none")

    (tmp_path / "a.csv").write_text("depth_mm,Fz_N\n" + "".join(f"{0.1 * k:.1f},{0.001 * k}\n" for k in range(20)))
    with pytest.raises(ValueError, match=r"a\.csv: which is none"):
        study_text(tmp_path / "study.toml", Refusing(), NewTest({"thickness": (5.0,)}), [str(tmp_path / "a.csv")])
