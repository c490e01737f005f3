"""What goes wrong around a study, not in it: disks, folders, stores, second runs, backends that promise too much."""

import json
import os
import resource
import shutil
import subprocess
from pathlib import Path

import indentation_backend
import pytest
import sample_studies as studies
import test_cli

from rso.cli import main
from rso.evaluation.store import RunStore, StoreError, set_aside

HERE = Path(__file__).parent
QUICK = studies.QUICK


def rso(*arguments: object, largest_file: int | None = None, cwd: Path | None = None) -> subprocess.CompletedProcess:
    """The command line in a process of its own, in which no file may grow beyond a size (bytes): a full disk."""

    def limit() -> None:
        if largest_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))

    return subprocess.run(
        test_cli.command(*arguments),
        env=test_cli.environment(),
        capture_output=True,
        text=True,
        preexec_fn=limit,
        timeout=120,
        cwd=cwd,
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study that was run, and its results."""
    folder = tmp_path_factory.mktemp("finished")
    studies.write(folder, **QUICK)
    assert main(["run", str(folder), "--jobs", "1"]) == 0
    return folder, studies.read(folder)


# ------------------------------------------------------------------------------------------------------ disks, folders


@pytest.mark.parametrize("largest_file", [1, pytest.param(60_000, marks=pytest.mark.verification)])
def test_full_disk_then_room_again(tmp_path, finished, largest_file, here):
    studies.write(tmp_path, **QUICK)
    full = rso("run", tmp_path, "--jobs", 1, largest_file=largest_file)
    assert full.returncode == 1 and "Traceback" not in full.stderr, full.stderr
    assert "disk" in full.stderr and "Finished runs stay stored" in full.stderr
    stored = 0
    if (tmp_path / "results" / "runs.sqlite").exists() and largest_file > 4096:
        with RunStore(tmp_path / "results", read_only=True) as store:
            stored = len(store.rows())
    assert main(["run", str(tmp_path), "--jobs", "1"]) == 0
    assert studies.timeless(studies.read(tmp_path)) == studies.timeless(finished[1])
    assert studies.read(tmp_path)["counts"]["from_store"] >= stored


def test_a_folder_that_cannot_be_written(tmp_path, capsys):
    studies.write(tmp_path)
    blocked = tmp_path / "results"
    blocked.write_text("a file where the folder must be")
    for command in ("run", "status", "report"):
        assert main([command, str(tmp_path)]) in (1, 2)
        assert str(blocked) in capsys.readouterr().err, command
    for fresh in ([], ["--fresh"]):
        assert main(["run", str(tmp_path), "--out", "/proc/nowhere/results", *fresh]) == 1
        assert "/proc/nowhere" in capsys.readouterr().err
    assert blocked.read_text() == "a file where the folder must be"


# ------------------------------------------------------------------------------------------------------ damage


def _spoil(name: str, folder: Path) -> None:
    store, results = folder / "runs.sqlite", folder / "results.json"
    raw = store.read_bytes()
    match name:
        case "store cut":
            store.write_bytes(raw[: len(raw) // 2])
        case "store overwritten":
            store.write_bytes(raw[:100] + os.urandom(len(raw) - 100))
        case "store of others":
            store.write_bytes(b"PK\x03\x04" + bytes(2000))
        case "results cut":
            results.write_bytes(results.read_bytes()[:1000])
        case "results of others":
            results.write_text('{"stage": 3, "schema": []}')
        case "results a list":
            results.write_text("[1, 2, 3]")
        case "results binary":
            results.write_bytes(os.urandom(1000))
        case "results a folder":
            results.unlink()
            results.mkdir()


DAMAGES = [
    "store cut",
    "store overwritten",
    "store of others",
    "results cut",
    "results of others",
    "results a list",
    "results binary",
    "results a folder",
]


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_is_told_in_words_and_nothing_is_deleted(tmp_path, capsys, finished, name, here):
    shutil.copytree(finished[0], tmp_path, dirs_exist_ok=True)
    folder = tmp_path / "results"
    _spoil(name, folder)
    before = {p.name: p.stat().st_size for p in folder.iterdir()}
    # What a call that goes on finds in results.json is nothing or everything: two damages stand for all.
    goes_on = name.startswith("store") or name in ("results cut", "results a folder")
    for command in ("status", "report", "run")[: 3 if goes_on else 2]:
        capsys.readouterr()
        code = main([command, str(tmp_path)])
        said = capsys.readouterr()
        if name.startswith("store") and command != "report":
            assert code == 1 and "runs.sqlite" in said.err and "damaged" in said.err
            assert "restore a copy, or move it aside" in said.err
        elif command == "report" and name.startswith("results"):
            assert code == 2 and "results.json" in said.err and "run the study" in said.err
        elif name == "results a folder" and command == "run":
            assert code == 1 and "results.json" in said.err
        else:
            assert code in (0, 4)
    after = {p.name for p in folder.iterdir()}
    assert after >= before.keys()
    aside = set_aside(folder)  # and there is a way out: what --fresh does
    assert {p.name for p in aside.iterdir()} >= before.keys()
    with RunStore(folder) as store:
        assert store.rows() == []


# ------------------------------------------------------------------------------------------------------ two at once


def test_a_second_run_and_fresh_are_refused_while_the_first_goes_on(tmp_path, capsys, here):
    test_cli.sleepy(tmp_path, 60)
    first = test_cli.begun(tmp_path)
    for more in ([], ["--fresh"]):
        assert main(["run", str(tmp_path), *more]) == 1
        assert f"is in use by process {first.pid}" in capsys.readouterr().err
    assert [p.name for p in tmp_path.glob("results*")] == ["results"]
    assert main(["status", str(tmp_path)]) == 0  # reading needs no lock
    first.kill()
    first.communicate()
    test_cli.sleepy(tmp_path, 0)
    assert main(["run", str(tmp_path), "--fresh", "--jobs", "1"]) == 0
    assert len(list(tmp_path.glob("results*"))) == 2


def test_two_asides_in_one_second_have_two_names(tmp_path):
    names = set()
    for _ in range(3):
        with RunStore(tmp_path / "results"):
            with pytest.raises(StoreError, match=f"in use by process {os.getpid()}"):
                set_aside(tmp_path / "results")
        names.add(set_aside(tmp_path / "results"))
    assert len(names) == 3 and not (tmp_path / "results").exists()


# ------------------------------------------------------------------------------------------------------ resuming


def test_resuming_a_complete_study_keeps_its_times_and_its_results_meanwhile(tmp_path, finished, monkeypatch, here):
    folder, first = finished
    again = tmp_path / "again"
    shutil.copytree(folder, again)
    results = again / "results" / "results.json"
    seen = []

    def watched(bench, values):
        seen.append(json.loads(results.read_text())["stage"])
        return run(bench, values)

    from rso.calibration import stages

    run = stages.Runner.run
    monkeypatch.setattr(stages.Runner, "run", watched)
    assert main(["run", str(again), "--jobs", "1"]) == 0
    second = json.loads(results.read_text())
    assert set(seen) == {"validate"}  # never less than was known
    assert second["timings"] == first["timings"]
    assert second["provenance"] == first["provenance"]
    assert second["counts"]["from_store"] == second["counts"]["fe_runs"]
    # Another study in the same folder: its results are not those.
    (again / "study.toml").write_text(studies.text(**{**QUICK, "study": 'title = "Other"\nseed = 1'}))
    assert main(["run", str(again), "--jobs", "1"]) == 0
    third = json.loads(results.read_text())
    assert third["study"]["title"] == "Other" and third["timings"] != first["timings"]


def test_wall_time_of_an_interrupted_study_adds_up(tmp_path, monkeypatch, here):
    from rso.calibration import search_stage

    studies.write(tmp_path, **QUICK)
    propose = search_stage.propose_all

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(search_stage, "propose_all", interrupted)
    assert main(["run", str(tmp_path), "--jobs", "1"]) == 130
    before = studies.read(tmp_path)
    assert before["stage"] == "sensitivity"
    monkeypatch.setattr(search_stage, "propose_all", propose)
    assert main(["run", str(tmp_path), "--jobs", "1"]) == 0
    after = studies.read(tmp_path)
    assert all(after["timings"][k] > before["timings"][k] for k in ("design", "surrogates", "total"))
    stages = sum(v for k, v in after["timings"].items() if k not in ("total", "fe_cpu"))
    assert after["timings"]["total"] == pytest.approx(stages, rel=1e-6)


# ------------------------------------------------------------------------------------------------------ promises


POOR = """
import dataclasses
from collections.abc import Mapping
import numpy as np
from indentation_backend import Layer
from rso.contract import Response

@dataclasses.dataclass(frozen=True)
class Poor(Layer):
    name: str = "poor"
    lack: str = {lack!r}

    def __call__(self, values, case):
        r = Layer.__call__(self, values, case)
        channels, units = dict(r.channels), dict(self.channels)
        if self.lack == "channel":
            del channels["uz_max"], units["uz_max"]
        if self.lack == "unit":
            units["Fz"] = "mN"
        if self.lack == "travel":
            channels = {{k: v[:-1] for k, v in channels.items()}}
        return Response(channels, units)

BACKEND = Poor()
"""


@pytest.mark.parametrize(
    ("lack", "words"),
    [
        ("channel", "the response lacks uz_max, which poor declares; it holds Fx, Fz, time, travel"),
        ("unit", "the response has Fz in mN, poor declares N"),
        ("travel", "asked were"),
    ],
)
def test_a_response_that_lacks_what_was_declared_is_a_crash_in_words(tmp_path, capsys, lack, words):
    module = f"poor_{lack}"
    (tmp_path / f"{module}.py").write_text(POOR.format(lack=lack))
    studies.write(tmp_path, **QUICK, backend=f'use = "{module}:BACKEND"')
    assert main(["run", str(tmp_path), "--jobs", "1"]) == 3
    said = capsys.readouterr()
    assert words in said.out and "Traceback" not in said.out + said.err and "KeyError" not in said.out
    with RunStore(tmp_path / "results", read_only=True) as store:
        assert {r.state for r in store.rows()} == {"crashed"}  # not stored as an answer


def test_a_stored_response_from_before_a_channel_was_added_is_computed_again(tmp_path):
    """The backend learned to return one more channel; its other answers, and so its `numerics`, are the same."""
    (tmp_path / "grown.py").write_text(POOR.format(lack="channel").replace('"poor"', '"grown"'))
    studies.write(tmp_path, backend='use = "grown:BACKEND"', doe="runs = 8\nheld_out = 1")
    from rso.calibration.plan import make_plan
    from rso.evaluation import Task, run_all
    from rso.study.loader import load_study

    plan = make_plan(load_study(tmp_path))
    values = {"mu": 0.01, "D1": 50.0}
    (task,) = plan.tasks(values)
    assert task.needs == {"Fz", "Fx", "uz_max"}
    without = Task(values, task.case)
    with RunStore(tmp_path / "results") as store:
        (old,) = run_all(plan.backend, [without], store, studies.Inline())
        assert "uz_max" not in old.response.channels
        object.__setattr__(plan.backend, "lack", "")
        (new,) = run_all(plan.backend, [task], store, studies.Inline())
        assert new.key == old.key and "uz_max" in new.response.channels
        assert "uz_max" in store.get(new.key).response.channels  # the next study has it at once


# ------------------------------------------------------------------------------------------------------ what is printed


HOSTILE = '<script>alert(1)</script><img src=x onerror=alert(2)> #let x = 1; $x$ *a* _b_ @c `d` \\\\ \\" &amp; [e](f)'


def test_reports_escape_what_they_print(tmp_path, here):
    (tmp_path / "top.csv").write_text(f"# note {HOSTILE}\n" + studies.measured())
    settings = f'thickness = 8\nfail_below = 0.007\nremark = "{HOSTILE}"'
    experiment = studies.SECTIONS["[experiments]"]
    studies.write(
        tmp_path,
        study=f'title = "{HOSTILE}"\nseed = 0',
        backend__settings=settings,
        experiments=experiment,
        **{**QUICK, "report": "html = true\npdf = true", "doe": "runs = 12\nheld_out = 1\nreduce = false"},
    )
    assert main(["run", str(tmp_path), "--jobs", "1"]) in (0, 3, 4)
    page = (tmp_path / "results" / "report.html").read_text(encoding="utf-8")
    assert "&lt;script&gt;alert(1)" in page
    for raw in ("<script>alert", "<img src=x", "onerror=alert(2)>"):
        assert raw not in page
    assert (tmp_path / "results" / "report.pdf").read_bytes().startswith(b"%PDF")


def test_the_layer_is_what_these_tests_think_it_is():
    """Negative control: without the mischief every channel that is declared is returned."""
    assert set(indentation_backend.BACKEND.channels) == {"time", "travel", "Fx", "Fz", "uz_max"}
