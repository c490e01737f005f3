"""Runs on a real Dask cluster of this machine; without Dask only what is said then."""

import json
import os
import signal
import sys
import time
from pathlib import Path

import dummy_backend as dummy
import pytest
import sample_studies as studies
from test_running import SOURCE, bits, task

from rso.cli import main
from rso.evaluation import Crashed, Done, Failed, WorkersCannotStart, open_cluster, run_all
from rso.evaluation.store import RunStore

HERE = Path(__file__).parent


def run(folder, tasks, executor, **options):
    with RunStore(folder) as store:
        return run_all(dummy.BACKEND, tasks, store, executor, **options)


def test_without_dask_it_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(WorkersCannotStart, match=r"needs Dask .*pip install 'rso\[dask\]'"), open_cluster(None, 1):
        pass
    studies.write(tmp_path, dispatch='engine = "dask"')
    assert main(["run", str(tmp_path)]) == 1
    assert "pip install 'rso[dask]'" in capsys.readouterr().err


def test_an_address_without_dask_is_refused(tmp_path, capsys):
    studies.write(tmp_path, dispatch='address = "tcp://head:8786"')
    assert main(["check", "--trust", str(tmp_path)]) == 2
    assert 'it needs engine = "dask"' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("address", "warned"),
    [
        ("tcp://head:8786", True),
        ("head:8786", True),
        ("ws://head:8786", True),
        ("tls://head:8786", False),
        ("wss://head:8786", False),
        (None, False),
    ],
)
@pytest.mark.parametrize("trust", [[], ["--trust"]])
def test_check_warns_of_a_scheduler_that_anybody_may_use(tmp_path, capsys, address, warned, trust):
    said = "" if address is None else f'\naddress = "{address}"'
    studies.write(tmp_path, dispatch=f'engine = "dask"{said}')
    assert main(["check", *trust, str(tmp_path)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert ("whoever reaches that scheduler can run code as you" in shown) == warned


# ------------------------------------------------------------------------------------------------------ a real cluster


@pytest.fixture(scope="module")
def local():
    pytest.importorskip("distributed")
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as scheduler:
        yield scheduler.scheduler_address


@pytest.mark.verification
def test_the_same_bits_as_everywhere(local, tmp_path):
    """Done, failed, crashed, with an artefact that no worker has, and one worker of the backend that kills itself."""
    tasks = [task(x, do={2: "fail", 3: "crash", 5: "kill"}.get(x, ""), mesh=f"fine@{tmp_path}/log") for x in range(8)]
    with open_cluster(local, 2, SOURCE) as executor:
        outcomes = run(tmp_path / "far", tasks, executor, retries=0)
        good = [t for t, o in zip(tasks, outcomes, strict=True) if isinstance(o, Done)]
        stored = run(tmp_path / "far", good, executor)
    kinds = {2: Failed, 3: Crashed, 5: Crashed}
    assert [type(o) for o in outcomes] == [kinds.get(x, Done) for x in range(8)]
    assert "ended by signal SIGKILL" in outcomes[5].reason
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as near:
        reference = run(tmp_path / "near", [t for x, t in enumerate(tasks) if x not in (3, 5)], near)
    assert bits([o for x, o in enumerate(outcomes) if x not in (3, 5)]) == bits(reference)
    assert bits(stored) == bits([o for o in reference if isinstance(o, Done)])
    assert dummy.calls(str(tmp_path / "log"), "make fine") == 2  # once far, once near


@pytest.mark.verification
def test_a_time_out_costs_one_run_and_no_worker(local, tmp_path):
    with open_cluster(local, 2, SOURCE, timeout_s=1.0) as executor:
        outcomes = run(tmp_path, [task(x, sleep_s=30.0 if x == 1 else 0.0) for x in range(4)], executor, retries=0)
    assert [type(o) for o in outcomes] == [Done, Crashed, Done, Done]
    assert "stopped after the time-out of 1 s" in outcomes[1].reason


@pytest.mark.verification
def test_a_worker_of_the_cluster_killed_on_the_way_costs_nothing(local, tmp_path):
    from distributed import Client

    log = str(tmp_path / "log")
    tasks = [task(x, sleep_s=0.3, log=log) for x in range(12)]
    with Client(local) as client, open_cluster(local, 2, SOURCE) as executor:
        pids = list(client.run(os.getpid).values())

        def watch(event):
            if pids and type(event).__name__ == "Finished":
                os.kill(pids.pop(), signal.SIGKILL)

        outcomes = run(tmp_path / "results", tasks, executor, watch=watch)
    assert not pids or len(pids) == 0
    assert all(isinstance(o, Done) for o in outcomes)
    assert 12 <= dummy.calls(log, "begin") <= 12 + 4  # what ran there was begun again


@pytest.mark.verification
def test_a_whole_study_by_its_file(local, tmp_path):
    os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    results = {}
    for name, dispatch in (("far", f'engine = "dask"\naddress = "{local}"'), ("near", "jobs = 1")):
        studies.write(tmp_path / name, dispatch=dispatch)
        assert main(["run", str(tmp_path / name)]) == 0
        results[name] = studies.timeless(studies.read(tmp_path / name))
        results[name]["provenance"].pop("study_sha256")
    assert json.dumps(results["far"]) == json.dumps(results["near"])


@pytest.mark.verification
def test_no_scheduler_there(tmp_path, capsys, monkeypatch):
    pytest.importorskip("distributed")
    import rso.evaluation.cluster as room

    monkeypatch.setattr(room, "CONNECTION_TIMEOUT_S", 2.0)
    studies.write(tmp_path, dispatch='engine = "dask"\naddress = "tcp://127.0.0.1:1"')
    start = time.monotonic()
    assert main(["run", str(tmp_path)]) == 1
    assert "no Dask scheduler at tcp://127.0.0.1:1" in capsys.readouterr().err and time.monotonic() - start < 30
