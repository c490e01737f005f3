"""`import rso`: the same answers as from the command line, models that are functions, and runs made elsewhere."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import indentation_backend
import numpy as np
import pandas as pd
import pytest
import sample_studies
from sample_studies import D1, MU, QUICK, THICKNESS

import rso

PUBLIC = [
    "AskedRun", "Backend", "Case", "FreeCurve", "FunctionModel", "Parameter", "ParetoResult", "ParetoStudy",
    "Programme", "Response", "RunResult", "SimulationFailed", "SpecimensResult", "SpecimensStudy", "StudyError",
    "Workspace", "fit", "indent", "load", "model", "pareto", "specimens",
]  # fmt: skip


@rso.model(parameters={"k": (0.1, 10.0, "N/mm"), "n": (1.0, 2.0)})
def stiffening(travel, k, n):
    return k * travel**n


DEPTHS = np.linspace(0.1, 2.0, 20)
STUDY = """[study]
title = "Spring"
seed = 3
[backend]
use = "__main__:stiffening"
[parameters]
k = { low = 0.5, high = 5.0 }
n = { low = 1.0, high = 2.0 }
[[experiments]]
name = "pull"
role = "fit"
data = "pull.csv"
noise = { Fz = "0.01 N", contact = "0 mm", gain = 0, correlation = "0 mm" }
[doe]
runs = 8
held_out = 1
[sensitivity]
sobol = false
[search]
repair = false
population = 12
generations = 5
candidates = 1
[report]
html = false
pdf = false
"""


@pytest.fixture
def spring(tmp_path):
    """A folder with a study of the spring k = 2, n = 1.5."""
    noise = 0.01 * np.random.default_rng(0).standard_normal(20)
    table = pd.DataFrame({"depth_mm": DEPTHS, "Fz_N": 2.0 * DEPTHS**1.5 + noise})
    table.to_csv(tmp_path / "pull.csv", index=False)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def test_the_public_names_are_these():
    assert sorted(rso.__all__) == PUBLIC == sorted(__import__("rso.api").api.__all__)
    assert all(getattr(rso, name).__doc__ for name in PUBLIC)


def test_importing_it_loads_nothing_heavy():
    code = "import sys, rso; print(sorted({'numpy', 'pandas', 'pymoo'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="fitt"):
        _ = rso.fitt


def test_a_function_in_this_process_is_identified(spring):
    said = []
    result = rso.load(spring, backend=stiffening).run(progress=said.append)
    table = result.parameters
    assert said[0].startswith("design")
    assert table.loc["k", "low"] < 2.0 < table.loc["k", "high"] and table.loc["n", "low"] < 1.5 < table.loc["n", "high"]
    assert list(table["verdict"]) == ["determined", "determined"] and table.loc["k", "unit"] == "N/mm"
    assert result.exit_code == 0 and result.exit_reason is None
    assert set(result.runs["state"]) == {"done"} and len(result.runs) >= 9
    curves = result.curves
    best = curves[curves["what"] == "main 1"]
    assert len(curves[curves["what"] == "measured"]) == 20
    np.testing.assert_allclose(best["value"], 2.0 * best["depth"] ** 1.5, rtol=0.02)
    assert result.candidates["verified"].all() and (result.candidates["nrmse pull"] < 0.01).all()


def test_what_was_computed_is_not_computed_again(spring):
    calls = []

    @rso.model(parameters={"k": (0.1, 10.0, "N/mm"), "n": (1.0, 2.0)}, name="counted")
    def counted(travel, k, n):
        calls.append(k)
        return k * travel**n

    first = rso.load(spring, backend=counted).run()
    done = len(calls)
    again = rso.load(spring, backend=counted)
    assert again.run().parameters.equals(first.parameters) and len(calls) == done > 8
    assert again.result.parameters.equals(first.parameters)


def test_the_command_line_and_python_agree(tmp_path):
    study = sample_studies.write(tmp_path, **QUICK)
    result = rso.load(study).run(jobs=1)
    assert sample_studies.command("run", study, "--out", tmp_path / "other").returncode == result.exit_code
    other = json.loads((tmp_path / "other" / "results.json").read_text())
    for key in ("parameters", "searches", "identification", "warnings"):
        assert json.loads(json.dumps(result.data[key])) == other[key]


def test_runs_made_elsewhere_lead_to_the_same_answer(spring, tmp_path):
    """Every batch is asked for and told, up to the end: candidates and intervals are those of a plain run."""
    study = rso.load(spring, backend=stiffening, folder=tmp_path / "told")
    batches = []
    while runs := study.ask():
        batches.append(len(runs))
        study.tell([(run, {"Fz": run.values["k"] * run.travel ** run.values["n"]}) for run in runs])
        assert len(batches) < 30
    told, plain = study.run(), rso.load(spring, backend=stiffening, folder=tmp_path / "run").run()
    assert batches[0] > 5 and len(batches) > 1
    pd.testing.assert_frame_equal(told.parameters, plain.parameters)
    pd.testing.assert_frame_equal(told.candidates, plain.candidates)


def test_some_of_a_batch_may_be_told(spring):
    study = rso.load(spring, backend=stiffening)
    whole, some = len(study.ask()), study.ask(5)
    study.tell([(run, {"Fz": run.values["k"] * run.travel ** run.values["n"]}) for run in some])
    assert len(some) == 5 and len(study.ask()) == whole - 5 > 0
    assert not {r.key for r in some} & {r.key for r in study.ask()}


def test_a_run_without_an_answer_is_a_failure_and_no_number(spring):
    study = rso.load(spring, backend=stiffening)
    runs = study.ask()
    answers = [(r, {"Fz": r.values["k"] * r.travel ** r.values["n"]}) for r in runs[1:]]
    study.tell([*answers, (runs[0], rso.SimulationFailed("step_limit", "it broke"))])
    result = study.run()
    lost = result.runs[result.runs["state"] == "failed"]
    assert list(lost["reason"]) == ["it broke"] and lost.filter(like="pull:").isna().all(axis=None)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ({}, "pull: the answer lacks Fz"),
        ({"Fy": [1.0]}, "pull: channel 'Fy' is not declared; the backend has time, travel, Fz"),
        ({"Fz": [1.0, 2.0]}, "channel 'Fz' has shape"),
    ],
)
def test_a_bad_answer_is_refused_and_nothing_is_stored(spring, answer, words):
    study = rso.load(spring, backend=stiffening)
    runs = study.ask()
    good = {"Fz": runs[0].values["k"] * runs[0].travel}
    with pytest.raises(ValueError, match=words):
        study.tell([(runs[0], good), (runs[1], answer)])
    assert len(study.ask()) == len(runs)


def test_a_model_is_still_a_function_and_a_backend():
    assert stiffening(travel=2.0, k=3.0, n=1.0) == 6.0
    case = rso.Case("one", rso.Programme.ramp((1.0, 2.0)), {})
    np.testing.assert_allclose(stiffening({"k": 3.0, "n": 2.0}, case).channels["Fz"], [3.0, 12.0])


def test_a_model_may_have_time_settings_and_several_channels():
    @rso.model(parameters=[rso.Parameter("k", "stiffness", "N/mm", 0.0, 9.0)], channels={"Fz": "N", "Fx": "N"})
    def dashpot(travel, time, settings, k):
        return {"Fz": k * travel + settings["eta"] * time, "Fx": 0.0}

    programme = rso.Programme((0.0, 2.0, 4.0), (0.0, 2.0, 0.0), (1.0, 2.0), (3.5,))
    r = dashpot({"k": 1.0}, rso.Case("c", programme, {"eta": 10.0}))
    np.testing.assert_allclose(r.channels["time"], [1.0, 2.0, 3.0, 3.5])
    np.testing.assert_allclose(r.channels["travel"], [1.0, 2.0, 1.0, 0.5])
    np.testing.assert_allclose(r.channels["Fz"], [11.0, 22.0, 31.0, 35.5])
    np.testing.assert_allclose(r.channels["Fx"], 0.0)


@pytest.mark.parametrize("programme", [
    rso.Programme((0, 8, 16), (0, 4, 0), (1, 2, 3, 4), (12,)),
    rso.Programme((0, 3, 5, 9), (0, 3, 3, 1), (1.5, 3)),
])  # fmt: skip
def test_passages_are_those_of_the_finite_element_model(programme):
    from fem_backend.backend import passages as of_the_model

    expected = [(i.time, i.travel) for i in of_the_model(programme) if i.asked]
    got = list(zip(*programme.passages(), strict=True))
    assert [g for g in got if g in expected] == expected


@pytest.mark.parametrize(
    ("parameters", "function", "words"),
    [
        ({"k": (0, 1)}, lambda travel, q: q, "argument 'q' is no declared parameter"),
        ({"k": (0, 1)}, lambda travl, k: k, "none of travel, time, settings; did you mean 'travel'"),
        ({"k": (0, 1), "m": (0, 1)}, lambda travel, k: k, "parameter 'm' is no argument"),
        ({"k": (1, 0)}, lambda travel, k: k, "low < high"),
        ({"k": 3}, lambda travel, k: k, "parameter 'k' = 3"),
    ],
)
def test_a_function_that_does_not_fit_its_parameters_is_refused(parameters, function, words):
    with pytest.raises(ValueError, match=words):
        rso.model(parameters=parameters)(function)


def test_what_a_function_returns_must_be_its_channels():
    two = rso.model(parameters={"k": (0, 1)}, channels={"Fz": "N", "Fx": "N"})(lambda travel, k: k * travel)
    with pytest.raises(ValueError, match="a mapping of Fz, Fx"):
        two({"k": 1.0}, rso.Case("one", rso.Programme.ramp((1.0,)), {}))
    with pytest.raises(ValueError, match="has no argument `settings`"):
        two.check(rso.Case("one", rso.Programme.ramp((1.0,)), {"eta": 1}))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda s: s + 1j, "'Fz' holds complex numbers"),
        (lambda s: s[:-1], r"'Fz' has shape \(1,\), expected \(2,\)"),
        (lambda s: s[:, None], r"'Fz' has shape \(2, 1\)"),
        (lambda s: None, "returned None as Fz"),
        (lambda s: "soft", "'Fz' holds text"),
    ],
)
def test_what_is_no_number_at_each_travel_is_refused(answer, words):
    case = rso.Case("c", rso.Programme.ramp((1.0, 2.0)))
    with pytest.raises(ValueError, match=words):
        rso.model(parameters={"k": (0.1, 10.0)})(lambda travel, k: answer(travel))({"k": 2.0}, case)
    good = rso.model(parameters={"k": (0.1, 10.0)})(lambda travel, k: k)({"k": 2.0}, case)
    np.testing.assert_array_equal(good.channels["Fz"], [2.0, 2.0])


def test_a_changed_function_has_other_runs():
    make = rso.model(parameters={"k": (0, 1)}, name="same")
    one, other = make(lambda travel, k: k * travel), make(lambda travel, k: 2 * k * travel)
    assert one.fingerprint != other.fingerprint


@pytest.mark.parametrize(("text", "words"), [('{"schema": 1, "study', "is damaged"), ('{"schema": 999}', "schema 999")])
def test_results_that_cannot_be_read_are_named(spring, text, words):
    study = rso.load(spring, backend=stiffening)
    study.folder.mkdir(parents=True, exist_ok=True)
    (study.folder / "results.json").write_text(text)
    with pytest.raises(ValueError, match=rf"results\.json: .*{words}"):
        _ = study.result


def test_no_backend_is_refused(spring):
    with pytest.raises(ValueError, match="is not a backend"):
        rso.load(spring, backend=42)


def test_a_layer_of_the_tests_as_an_object(tmp_path):
    """Any backend object stands in for the one that the file names."""
    study = sample_studies.write(tmp_path, **QUICK)
    layer = dataclasses.replace(indentation_backend.BACKEND, name="another")
    result = rso.load(study, backend=layer).run()
    assert result.data["backend"]["name"] == "another"
    h = np.array([0.8, 2.0])
    F = indentation_backend.force(MU, D1, h, THICKNESS)
    curves = result.curves[result.curves["what"] == "measured"]
    np.testing.assert_allclose(np.interp(h, curves["depth"], curves["value"]), F, rtol=0.02)


SLAB = {"specimen": {"shape": "slab", "thickness": 6.0}, "indenter": {"shape": "sphere", "radius": 3.0}}


def test_one_indentation_is_that_of_the_program():
    """The same request through `python -m fem_backend` and by one call, with units of its own."""
    from fem_backend.backend import BACKEND

    r = rso.indent([0.2, 0.4], **SLAB, mu="10 kPa", D1=5.8, settings={"mesh": {"level": "coarse"}})
    case = rso.Case("other", rso.Programme.ramp((0.2, 0.4)), {**SLAB, "mesh": {"level": "coarse"}})
    np.testing.assert_array_equal(r.channels["Fz"], BACKEND({"mu": 0.01, "D1": 5.8}, case).channels["Fz"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mu": "1 mm"}, "mu: '1 mm'"),
        ({"nu": 0.3}, "has no such parameter; Poisson's ratio follows from mu and D1"),
        ({"E": "30 kPa"}, "has no such parameter; Young's modulus follows from mu and D1"),
        ({"Mu": 0.01}, "has no such parameter; did you mean 'mu'"),
        ({"specimen": {"shape": "slap"}}, "did you mean 'slab'"),
        ({"settings": {"indenter": {}}}, "indenter is given twice"),
    ],
)
def test_bad_input_of_an_indentation_is_named(change, words):
    with pytest.raises(ValueError, match=words):
        rso.indent([0.2], **{**SLAB, "mu": 0.01, "D1": 5.8, **change})


@pytest.mark.parametrize("depths", ["0.5 mm", ["0.5 mm"], [], [0.5, np.nan], None, [[0.1], [0.2]]])
def test_depths_that_are_no_numbers_are_named(depths):
    with pytest.raises(ValueError, match=r"depths = .*in mm"):
        rso.indent(depths, **SLAB, mu=0.01, D1=5.8)


@pytest.mark.parametrize("depths", [[0.4, 0.2], [0.2, 0.2, 0.4], [0.0, 0.2], [-0.2, 0.2]])
def test_depths_that_an_answer_could_not_stand_beside_are_named(depths):
    """Forces come one for each depth as given: no order is mended, no depth dropped."""
    with pytest.raises(ValueError, match=r"depths\[\d\] = .* mm: .*increase"):
        rso.indent(depths, **SLAB, mu=0.01, D1=5.8)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ((DEPTHS, DEPTHS), "data is a tuple: .*depth_mm"),
        (np.c_[DEPTHS, DEPTHS], "data is a ndarray: .*depth_mm"),
        ({"depth_mm": DEPTHS, "Fz_N": DEPTHS[1:]}, "'depth_mm', 'Fz_N' make no table: .*same length"),
    ],
)
def test_a_curve_that_is_no_table_is_named(tmp_path, data, words):
    with pytest.raises(ValueError, match=words):
        rso.fit(data, **SLAB, folder=tmp_path)


def test_arrays_by_name_are_a_table(tmp_path, monkeypatch):
    import rso.api.shortcuts as shortcuts

    for folder, kind in (("mapping", dict), ("frame", pd.DataFrame)):
        monkeypatch.setattr(shortcuts, "load", lambda path: type("Stub", (), {"run": lambda self, **k: path})())
        rso.fit(kind({"depth_mm": DEPTHS, "Fz_N": 0.05 * DEPTHS**1.5}), **SLAB, folder=tmp_path / folder)
    mapping, frame = ((tmp_path / name / "curve.csv").read_bytes() for name in ("mapping", "frame"))
    assert mapping == frame


def test_a_fit_writes_a_study_that_can_be_run(tmp_path, monkeypatch):
    """Without simulations: the study that a fit writes, its ranges and its data."""
    import rso.api.shortcuts as shortcuts

    found = {}

    class Stub:
        def __init__(self, path):
            found["study"] = rso.load(path).study

        def run(self, **options):
            return options

    monkeypatch.setattr(shortcuts, "load", Stub)
    curve = pd.DataFrame({"depth_mm": DEPTHS, "Fz_N": 0.05 * DEPTHS**1.5})
    known = {"delta_thickness": "0.1 mm"}
    rso.fit(curve, **SLAB, parameters={"mu": ("4 kPa", "20 kPa")}, uncertainty=known, folder=tmp_path / "fit", jobs=1)
    study = found["study"]
    assert study.parameters["mu"].low == "4 kPa" and "D1" in study.parameters  # the backend's own guess
    assert study.backend.settings["specimen"]["thickness"] == 6.0 and study.uncertainty == known
    with pytest.raises(ValueError, match="parameters: mu = "):
        rso.fit(curve, **SLAB, parameters={"mu": (1, 2, 3)}, folder=tmp_path / "other")
    with pytest.raises(ValueError, match="there is no such file"):
        rso.fit(tmp_path / "none.csv", **SLAB)


def test_the_example_of_the_documentation_runs(tmp_path):
    """docs/examples/own_model.py in a process of its own; the other one takes two minutes and is run by hand."""
    script = Path(__file__).parents[2] / "docs" / "examples" / "own_model.py"
    done = subprocess.run([sys.executable, script, tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "the same from runs made elsewhere: True" in done.stdout and (tmp_path / "own_model.svg").exists()


def test_a_failure_without_a_known_cause_names_the_causes():
    with pytest.raises(ValueError, match=r"unknown cause 'no root found'; choose one of inversion, contact"):
        rso.SimulationFailed("no root found")
