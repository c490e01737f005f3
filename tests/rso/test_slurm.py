"""Job arrays through submitit: as processes of this machine, and by a stand-in for the commands of SLURM."""

import json
import os
import signal
import stat
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import dummy_backend as dummy
import pytest
import sample_studies as studies
from test_running import SOURCE, bits, task

from rso.cli import main
from rso.evaluation import ArraySettings, Crashed, Done, Failed, WorkersCannotStart, open_slurm, run_all
from rso.evaluation.store import RunStore

HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def jobs_find_the_tests(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), *sys.path]))


def run(folder, tasks, executor, **options):
    with RunStore(folder) as store:
        return run_all(dummy.BACKEND, tasks, store, executor, **options)


def test_without_submitit_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "submitit", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(WorkersCannotStart, match=r"pip install 'rso\[slurm\]'"):
        with open_slurm(tmp_path, 1, ArraySettings(), SOURCE):
            pass


@pytest.mark.parametrize(
    ("dispatch", "words"),
    [
        ('engine = "dask"\nslurm = { partition = "fast" }', 'it needs engine = "slurm"'),
        ('engine = "slurm"\nslurm = { walltime = "1 mm" }', "dispatch.slurm.walltime"),
        ('engine = "slurm"\nslurm = { partitoin = "fast" }', "did you mean 'partition'"),
        ('engine = "slurm"\nslurm = { runs_per_job = 0 }', "dispatch.slurm.runs_per_job"),
        ('engine = "slurm"\naddress = "tcp://head:8786"', 'it needs engine = "dask"'),
    ],
)
def test_bad_keys_are_refused_by_name(tmp_path, capsys, dispatch, words):
    studies.write(tmp_path, dispatch=dispatch)
    assert main(["check", "--trust", str(tmp_path)]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


# ----------------------------------------------------------------------------------- jobs as processes of this machine

pytest.importorskip("submitit")
LOCAL = ArraySettings(here=True, minutes=5.0)


def test_the_same_bits_as_everywhere(tmp_path):
    """Done, failed, crashed, with an artefact that must travel, and one process that kills itself."""
    tasks = [task(x, do={2: "fail", 3: "crash", 5: "kill"}.get(x, ""), mesh=f"fine@{tmp_path}/log") for x in range(6)]
    with open_slurm(tmp_path / "slurm", 2, ArraySettings(here=True, runs_per_job=3), SOURCE) as executor:
        outcomes = run(tmp_path / "far", tasks, executor, retries=0)
    kinds = {2: Failed, 3: Crashed, 5: Crashed}
    assert [type(o) for o in outcomes] == [kinds.get(x, Done) for x in range(6)]
    assert "ZeroDivisionError: a bug" in outcomes[3].reason and "signal SIGKILL" in outcomes[5].reason
    with ThreadPoolExecutor(1) as near:
        reference = run(tmp_path / "near", [t for x, t in enumerate(tasks) if x not in (3, 5)], near)
    assert bits([o for x, o in enumerate(outcomes) if x not in (3, 5)]) == bits(reference)
    assert outcomes[2].partial is not None and outcomes[2].history == ({"step": 1, "residual": 0.1},)
    assert not list((tmp_path / "slurm" / "answers").iterdir())  # all of them are in the store


def test_a_run_out_of_time_costs_itself_alone(tmp_path):
    tasks = [task(x, sleep_s=60.0 if x == 1 else 0.0) for x in range(3)]
    with open_slurm(tmp_path / "slurm", 1, ArraySettings(here=True, runs_per_job=3), SOURCE, 3.0) as executor:
        outcomes = run(tmp_path, tasks, executor, retries=0)
    assert [type(o) for o in outcomes] == [Done, Crashed, Done]
    assert "stopped after the time-out of 3 s" in outcomes[1].reason


def test_a_job_out_of_time_keeps_what_it_had_answered(tmp_path, monkeypatch):
    """Its wall time is over in the second run: the first is done, the other two are crashes that say so."""
    monkeypatch.setattr("rso.evaluation.slurm.LOST_ANSWER_S", 0.5)
    tasks = [task(x, sleep_s=0.0 if x == 0 else 60.0) for x in range(3)]
    settings = ArraySettings(here=True, runs_per_job=3, minutes=12 / 60)
    with open_slurm(tmp_path / "slurm", 1, settings, SOURCE) as executor:
        outcomes = run(tmp_path, tasks, executor, retries=0)
    assert [type(o) for o in outcomes] == [Done, Crashed, Crashed]
    assert "before it had an answer of this run" in outcomes[1].reason and "timed-out" in outcomes[1].reason
    log = outcomes[1].reason.splitlines()[0].rpartition(" ")[2]
    assert Path(log).is_file()  # kept, since it is named


def test_what_was_computed_outlives_a_killed_parent(tmp_path):
    """kill -9 of the process that waits: its jobs go on, and the next process takes their answers over."""
    log = str(tmp_path / "log")
    script = textwrap.dedent(
        f"""
        import test_slurm as t
        tasks = [t.task(x, sleep_s=1.0, log={log!r}) for x in range(2)]
        with t.open_slurm(t.Path({str(tmp_path / "slurm")!r}), 2, t.LOCAL, t.SOURCE) as executor:
            t.run({str(tmp_path / "results")!r}, tasks, executor)
        """
    )
    parent = subprocess.Popen([sys.executable, "-c", script])
    until(lambda: dummy.calls(log, "begin") == 2)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    until(lambda: len(list((tmp_path / "slurm" / "answers").glob("*.json"))) == 2)
    tasks = [task(x, sleep_s=1.0, log=log) for x in range(3)]
    with open_slurm(tmp_path / "slurm", 2, LOCAL, SOURCE) as executor:
        outcomes = run(tmp_path / "results", tasks, executor)
    assert all(isinstance(o, Done) for o in outcomes)
    assert dummy.calls(log, "begin") == 3  # each once


def test_answers_that_are_not_ours_are_computed_again(tmp_path):
    log = str(tmp_path / "log")
    with open_slurm(tmp_path / "slurm", 1, LOCAL, SOURCE) as executor:
        run(tmp_path / "one", [task(1.0, log=log)], executor)
        (answer,) = (tmp_path / "slurm" / "answers").iterdir()
        answer.write_text('{"state": "done"')
        outcomes = run(tmp_path / "two", [task(1.0, log=log)], executor)
    assert isinstance(outcomes[0], Done) and dummy.calls(log, "begin") == 2


@pytest.mark.verification
def test_a_study_by_its_file(tmp_path):
    results = {}
    for name, dispatch in (
        ("far", 'engine = "slurm"\nslurm = { here = true, runs_per_job = 8 }'),
        ("near", "jobs = 1"),
    ):
        studies.write(tmp_path / name, **studies.QUICK, dispatch=dispatch)
        assert main(["run", str(tmp_path / name)]) in (0, 4)
        results[name] = studies.timeless(studies.read(tmp_path / name))
        results[name]["provenance"].pop("study_sha256")
    assert json.dumps(results["far"]) == json.dumps(results["near"])


# ----------------------------------------------------------------------------------------- a stand-in for the commands

SBATCH = """#!{python}
import os, re, subprocess, sys
text, place = open(sys.argv[1]).read(), {place!r}
number = str(100 + len(os.listdir(place)))
open(f"{{place}}/{{number}}", "w").write(text)
array = re.search(r"--array=0-(\\d+)%(\\d+)", text)
for k in range(int(array[1]) + 1) if array else [None]:
    own = {{"SLURM_JOB_ID": number, "SLURM_NTASKS": "1"}}
    if k is not None:
        own |= {{"SLURM_ARRAY_JOB_ID": number, "SLURM_ARRAY_TASK_ID": str(k)}}
    log = re.search(r"--error=(\\S+)", text)[1].replace("%A", number).replace("%a", str(k)).replace("%j", number)
    with open(log.replace("%t", "0"), "w") as err:
        subprocess.Popen(["bash", sys.argv[1]], env={{**os.environ, **own}}, stdout=err, stderr=err)
print(f"Submitted batch job {{number}}")
"""
SRUN = """#!/bin/bash
while [[ "$1" == -* ]]; do if [[ "$1" == --*=* || "$1" == --unbuffered ]]; then shift; else shift 2; fi; done
exec "$@"
"""
SACCT = """#!{python}
import os, sys
print("JobID|State|NodeList")
for number in os.listdir({place!r}):
    for k in range(8):
        print(f"{{number}}_{{k}}|{{'OUT_OF_MEMORY' if os.path.exists({place!r} + '-killed') else 'RUNNING'}}|n1")
"""


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """A folder of submitted scripts, and commands that run them here at once."""
    commands, place = tmp_path / "bin", tmp_path / "submitted"
    commands.mkdir(), place.mkdir()
    for name, text in {"sbatch": SBATCH, "srun": SRUN, "sacct": SACCT, "scancel": "#!/bin/true\n"}.items():
        if "{" in text and name != "srun":
            text = text.format(python=sys.executable, place=str(place))
        (commands / name).write_text(text)
        (commands / name).chmod(stat.S_IRWXU)
    monkeypatch.setenv("PATH", f"{commands}{os.pathsep}{os.environ['PATH']}")
    return place


def test_one_array_with_what_was_asked_for(tmp_path, cluster):
    settings = ArraySettings(
        minutes=30.2, partition="fast", account="p1", memory_gb=1.5, setup=("echo here",), options={"licenses": "a:1"}
    )
    with open_slurm(tmp_path / "slurm", 3, settings, SOURCE) as executor:
        outcomes = run(tmp_path, [task(x) for x in range(5)], executor)
    assert all(isinstance(o, Done) for o in outcomes)
    (script,) = cluster.iterdir()
    lines = script.read_text().splitlines()
    for asked in ("array=0-4%3", "time=31", "partition=fast", "account=p1", "mem=1536M", "licenses=a:1"):
        assert f"#SBATCH --{asked}" in lines
    assert "echo here" in lines


def test_a_job_that_slurm_kills_is_named_with_its_state(tmp_path, cluster, monkeypatch):
    monkeypatch.setattr("rso.evaluation.slurm.LOST_ANSWER_S", 0.5)
    Path(f"{cluster}-killed").touch()
    tasks = [task(x, sleep_s=8.0) for x in range(2)]
    with open_slurm(tmp_path / "slurm", 2, ArraySettings(), SOURCE) as executor:
        outcomes = run(tmp_path, tasks, executor, retries=0)
    assert [type(o) for o in outcomes] == [Crashed, Crashed]
    assert "(OUT_OF_MEMORY)" in outcomes[0].reason


def test_what_sbatch_refuses_ends_the_run_with_its_words(tmp_path, cluster):
    (tmp_path / "bin" / "sbatch").write_text("#!/bin/bash\necho 'invalid partition specified: fast' >&2\nexit 1\n")
    with pytest.raises(WorkersCannotStart, match="invalid partition specified: fast"):
        with open_slurm(tmp_path / "slurm", 1, ArraySettings(partition="fast"), SOURCE) as executor:
            run(tmp_path, [task(1.0)], executor)


def until(condition, most_s=60.0):
    start = time.monotonic()
    while not condition():
        assert time.monotonic() - start < most_s
        time.sleep(0.1)
