"""What `[next]` asks is checked as a whole before a simulation of it runs, and by `rso check`."""

from concurrent.futures import Executor

import pytest
import sample_studies as studies

from rso.calibration.plan import make_plan
from rso.cli.checking import check_lines
from rso.evaluation.store import RunStore
from rso.next_experiment.study_design import run_next
from rso.study.errors import StudyError
from rso.study.loader import load_study

GOOD = 'name = "a"\nnoise = { Fz = "2 mN" }'
MARKS = 'name = "m"\nmarks = [[0, 5]]\ndepths = [1, 2]'
WRONG = {  # the table, key and words of what is said
    "nobody": ("truths = { nope = [1] }", ["next.truths.nope", "not searched for", "D1, mu"]),
    "fixed": ("truths = { radius = [3] }", ["next.truths.radius", "not searched for"]),
    "another unit": ('truths = { mu = ["1 mm"] }', ["next.truths.mu", "'1 mm'", "MPa"]),
    "text": ('truths = { mu = ["soft"] }', ["next.truths.mu", "'soft'"]),
    "out of range": ('truths = { mu = ["10 kPa", "30 kPa"] }', ["next.truths.mu", "values from 0.006 to 0.02 MPa"]),
    "none": ("truths = { mu = [] }", ["next.truths.mu", "values from"]),
    "a profile with the noise of a force": (
        f'[[next.experiments]]\n{MARKS}\nnoise = {{ Fz = "2 mN" }}',
        ["next.experiments[0].noise", "noise.uz"],
    ),
    "a force with the noise of a profile": (
        '[[next.experiments]]\nname = "a"\nnoise = { uz = "10 um" }',
        ["next.experiments[0].noise", "noise.Fz"],
    ),
    "one of two channels": (
        f'[[next.experiments]]\n{GOOD.replace("{ ", "{ Fx = 0.0, ")}\nchannels = ["Fz", "Fx"]',
        ["next.experiments[0].noise", "noise.Fx"],
    ),
    "no force": (
        f'[[next.experiments]]\n{GOOD}\nchannels = ["uz_max"]',
        ["next.experiments[0].channels", "'uz_max'", "choose from Fx, Fz"],
    ),
    "no speed": (
        f"[[next.experiments]]\n{GOOD}\nsettings = {{ speed = 0 }}",
        ["next.experiments[0]", "speed = 0", "positive"],
    ),
    "up": (f'[[next.experiments]]\n{GOOD}\nsettings = {{ speed = "-1 mm/s" }}', ["next.experiments[0]", "positive"]),
    "a tiny depth": (f"[[next.experiments]]\n{GOOD}\ndepth = 1e-9\nstep = 1e-10", ["next.experiments[0]", "asked_mm"]),
    "a tiny step": (f"[[next.experiments]]\n{GOOD}\nstep = 1e-8", ["next.experiments[0]", "more than 1000 readings"]),
}


class Refusing(Executor):
    """Runs nothing."""

    def submit(self, *_, **__):
        raise AssertionError("a simulation was asked for")


def study(folder, table):
    return load_study(studies.write(folder, next=f"draws = 10\n{table}"))


@pytest.mark.parametrize("what", WRONG)
def test_it_is_refused_before_any_simulation_and_by_a_check(tmp_path, what):
    table, words = WRONG[what]
    for call in (
        lambda loaded: check_lines(loaded, tmp_path / "results", trust=True),
        lambda loaded: run_next(make_plan(loaded), store, Refusing()),
    ):
        with RunStore(tmp_path / "store") as store, pytest.raises(StudyError) as caught:
            call(study(tmp_path, table))
        for word in words:
            assert word in str(caught.value), str(caught.value)


def test_all_that_is_wrong_is_said_at_once(tmp_path):
    tables = ("truths = { nope = [1] }", MARKS, f"{GOOD}\nchannels = ['time']")
    wrong = "\n[[next.experiments]]\n".join(tables)
    with pytest.raises(StudyError) as caught:
        check_lines(study(tmp_path, wrong), tmp_path / "results", trust=True)
    assert len(caught.value.problems) == 4  # this backend has no marks either


@pytest.mark.parametrize(
    "table",
    [
        "truths = { D1 = [20, 100] }",
        f"[[next.experiments]]\n{GOOD}",
        '[[next.experiments]]\nname = "a"\nnoise = { gain = "1 %" }\nchannels = ["Fx", "Fz"]',
    ],
)
def test_what_can_be_asked_is_called_good(tmp_path, table):
    assert any("good" in line for line in check_lines(study(tmp_path, table), tmp_path / "results", trust=True))


@pytest.mark.parametrize("noise", ['uz = "10 um"', 'gain = "1 %"', 'Fz = "2 mN", uz = "10 um"'])
def test_a_profile_with_errors_of_its_own_is_called_good(tmp_path, monkeypatch, noise):
    monkeypatch.setattr(studies.indentation_backend, "MARKED", studies.Marked(), raising=False)
    table = f"[[next.experiments]]\n{MARKS}\nnoise = {{ {noise} }}"
    path = studies.write(tmp_path, next=table, backend='use = "indentation_backend:MARKED"')
    assert any("good" in line for line in check_lines(load_study(path), tmp_path / "results", trust=True))
