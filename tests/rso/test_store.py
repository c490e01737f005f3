import hashlib
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from rso.contract import Case, Programme, Response
from rso.evaluation.store import Crashed, Done, Failed, RunStore, StoreError

CASE = Case("ball", Programme.ramp((1.0, 2.0)), {"radius": 3.0, "support": {"kind": "fixed"}}, {"mesh": "ab" * 32})
VALUES = {"mu": 0.01, "D1": 5.8}


def awkward_response(rng=None, n=50):
    """Doubles that a careless text format would change: subnormal, -0.0, largest, one bit apart, random bits."""
    rng = rng or np.random.default_rng(1)
    special = [5e-324, -0.0, np.finfo(float).max, np.nextafter(0.1, 1.0), 1 / 3, 2.0**-1074, 1e16 + 2]
    force = np.concatenate([special, rng.standard_normal(n - len(special)) * 10.0 ** rng.integers(-300, 300, n - 7)])
    return Response(
        {"time": np.arange(n), "travel": np.linspace(0, 1, n), "Fz": force},
        {"time": "s", "travel": "mm", "Fz": "N"},
        {"Fz": np.abs(force) * 1e-9},
        {"mu": {"Fz": rng.standard_normal(n)}},
        {"cpu_s": 0.1, "iterations": [3, 4], "version": "1.0"},
    )


def assert_same_bits(a: Response, b: Response) -> None:
    for part in ("channels", "error"):
        x, y = getattr(a, part), getattr(b, part)
        assert list(x) == list(y)
        assert all(x[k].tobytes() == y[k].tobytes() and x[k].shape == y[k].shape for k in x)
    assert {k: {c: v.tobytes() for c, v in g.items()} for k, g in a.gradients.items()} == {
        k: {c: v.tobytes() for c, v in g.items()} for k, g in b.gradients.items()
    }
    assert (a.units, a.info) == (b.units, b.info)


def test_done_and_failed_come_back_bit_for_bit_after_reopening(tmp_path):
    response, partial = awkward_response(), awkward_response(np.random.default_rng(2))
    history = ({"step": 1, "residual": 0.1}, {"step": 2, "residual": 1 / 3})
    with RunStore(tmp_path / "new" / "folder") as store:
        assert store.get("k1") is None
        store.put_done(Done("k1", VALUES, CASE, response, 1.5, 1.25))
        store.put_failed(Failed("k2", VALUES, CASE, "contact", "lost", partial, history, 0.5, 0.25))
        store.put_failed(Failed("k3", VALUES, CASE, "inversion", "no step"))
    with RunStore(tmp_path / "new" / "folder") as store:
        done, failed, bare = (store.get(k) for k in ("k1", "k2", "k3"))
    assert isinstance(done, Done)
    assert_same_bits(done.response, response)
    assert (done.key, done.values, done.wall_s, done.cpu_s) == ("k1", VALUES, 1.5, 1.25)
    assert done.case.to_json() == CASE.to_json() | {"objects": str(tmp_path / "new" / "folder" / "objects")}
    assert isinstance(failed, Failed)
    assert_same_bits(failed.partial, partial)
    assert (failed.cause, failed.reason, failed.history, failed.cpu_s) == ("contact", "lost", history, 0.25)
    assert (bare.partial, bare.history) == (None, ())


def test_the_comparison_of_bits_sees_one_bit():  # negative control
    a = awkward_response()
    changed = dict(a.channels) | {"Fz": np.where(np.arange(50) == 4, np.nextafter(1 / 3, 1), a.channels["Fz"])}
    with pytest.raises(AssertionError):
        assert_same_bits(a, Response(changed, a.units, a.error, a.gradients, a.info))


def test_what_is_stored_is_never_changed(tmp_path):
    with RunStore(tmp_path) as store:
        store.put_done(Done("k", VALUES, CASE, awkward_response(), 1.0, 1.0))
        store.put_failed(Failed("k", VALUES, CASE, "contact", "later"))
        assert isinstance(store.get("k"), Done)


def test_crashes_are_kept_apart_and_counted(tmp_path):
    with RunStore(tmp_path) as store:
        for attempt in (1, 2):
            store.put_crashed(Crashed("a", VALUES, CASE, f"bug {attempt}"))
        store.put_crashed(Crashed("b", VALUES, CASE, "bug"))
        assert store.get("a") is None and store.get("b") is None
        store.put_done(Done("b", VALUES, CASE, awkward_response(), 1.0, 1.0))
        store.put_failed(Failed("c", VALUES, CASE, "contact", "lost"))
        rows = {r.key: r for r in store.rows()}
    assert {k: (r.state, r.attempts, r.reason, r.cause) for k, r in rows.items()} == {
        "a": ("crashed", 2, "bug 2", None),
        "b": ("done", 2, None, None),
        "c": ("failed", 1, "lost", "contact"),
    }
    assert all(r.values == VALUES and r.name == "ball" for r in rows.values())


def test_artefacts_by_content(tmp_path):
    with RunStore(tmp_path) as store:
        assert store.artefact("fine mesh") is None
        sha = store.put_artefact("mesh", "fine mesh", b"points")
        assert store.put_artefact("mesh", "same mesh in other words", b"points") == sha
        path = tmp_path / "objects" / sha[:2] / sha
        assert path.read_bytes() == b"points"
        assert store.artefact("fine mesh") == sha
        path.write_bytes(b"pointz")
        with pytest.raises(StoreError, match=r"another hash.*delete it"):
            store.artefact("fine mesh")
        path.unlink()
        assert store.artefact("fine mesh") is None


def test_left_over_temporary_files_go_and_the_rest_stays(tmp_path):
    with RunStore(tmp_path) as store:
        sha = store.put_artefact("mesh", "recipe", b"points")
    (tmp_path / "objects" / "tmp-1-dead").write_bytes(b"half")
    with RunStore(tmp_path, read_only=True):
        assert (tmp_path / "objects" / "tmp-1-dead").exists()  # a reader may meet a living writer
    with RunStore(tmp_path) as store:
        assert store.artefact("recipe") == sha
    assert sorted(p.name for p in (tmp_path / "objects").iterdir()) == [sha[:2]]


def test_reader_beside_a_writer(tmp_path):
    with pytest.raises(StoreError, match=r"runs\.sqlite does not exist: nothing has been run"):
        RunStore(tmp_path, read_only=True).__enter__()
    with RunStore(tmp_path) as writer, RunStore(tmp_path, read_only=True) as reader:
        assert reader.rows() == []
        writer.put_done(Done("k", VALUES, CASE, awkward_response(), 1.0, 1.0))
        assert [r.key for r in reader.rows()] == ["k"]
        with pytest.raises(StoreError, match="read-only"):
            reader.put_crashed(Crashed("k", VALUES, CASE, "bug"))


def test_two_writers_at_once(tmp_path):
    with RunStore(tmp_path), pytest.raises(StoreError, match=f"in use by process {os.getpid()}"):
        RunStore(tmp_path).__enter__()
    with RunStore(tmp_path):
        pass  # the refused one left no lock behind


HOLDER = """
import sys, time
from rso.evaluation.store import RunStore
with RunStore(sys.argv[1]):
    print("in", flush=True)
    time.sleep(60)
"""


def test_lock_of_another_process_names_it_and_dies_with_it(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"in\n"
        with pytest.raises(StoreError, match=f"in use by process {other.pid}:"):
            RunStore(tmp_path).__enter__()
        other.kill()
        other.wait()
        with RunStore(tmp_path) as store:
            assert store.rows() == []


DIES_WHILE_STARTING_A_WORKER = """
import os, sys, time
from rso.evaluation.store import RunStore
RunStore(sys.argv[1]).__enter__()
if os.fork() == 0:  # holds what its parent held until it becomes another program
    time.sleep(0.5)
os._exit(0)
"""


def test_the_lock_of_a_process_that_has_ended_is_waited_for(tmp_path):
    subprocess.run([sys.executable, "-c", DIES_WHILE_STARTING_A_WORKER, str(tmp_path)], check=True)
    start = time.monotonic()
    with RunStore(tmp_path):
        assert time.monotonic() - start > 0.1  # it was held: the test sees the case it is made for


WRITER = """
import sys
from rso.contract import Case, Programme, Response
from rso.evaluation.store import Done, RunStore
case = Case("c", Programme.ramp((1.0,)))
response = Response({"time": [0.1] * 200, "travel": [0.2] * 200}, {"time": "s", "travel": "mm"})
with RunStore(sys.argv[1]) as store:
    for i in range(int(sys.argv[2]), 10**6):
        sha = store.put_artefact("mesh", f"recipe {i}", str(i).encode())
        store.put_done(Done(str(i), {"x": i}, case, response, 1.0, 1.0))
        print(i, flush=True)
"""


def test_kill_9_at_random_moments_loses_nothing_that_was_committed(tmp_path):
    rng, committed = np.random.default_rng(3), -1
    for _ in range(6):
        command = [sys.executable, "-c", WRITER, str(tmp_path), str(committed + 1)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            writer.stdout.readline()
            time.sleep(rng.uniform(0.0, 0.06))
            writer.send_signal(signal.SIGKILL)
            rest = writer.stdout.read().split()
        committed = max(committed + 1, *map(int, rest)) if rest else committed + 1
        with RunStore(tmp_path) as store:
            keys = {int(r.key) for r in store.rows()}
            assert keys >= set(range(committed + 1))
            assert max(keys) <= committed + 1  # at most the one that was not announced any more
            committed = max(keys)
            assert all(store.artefact(f"recipe {i}") for i in keys)
            assert store.get(str(committed)).response.channels["time"][0] == 0.1
        assert not list((tmp_path / "objects").glob("tmp-*"))
    assert committed > 6


DAMAGE = {
    "another file": lambda b: b"no database at all" * 100,
    "cut off": lambda b: b[:5000],
    "overwritten": lambda b: b[:4096] + b"\xff" * (len(b) - 4096),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damaged_file(tmp_path, damage):
    rng = np.random.default_rng(0)
    with RunStore(tmp_path) as store:
        for i in range(20):
            store.put_done(Done(str(i), VALUES, CASE, awkward_response(rng), 1.0, 1.0))
    file = tmp_path / "runs.sqlite"
    file.write_bytes(damage(file.read_bytes()))
    for read_only in (True, False):
        with pytest.raises(StoreError, match=r"runs\.sqlite is damaged .*(restore a copy, or move it aside)"):
            RunStore(tmp_path, read_only=read_only).__enter__()


def test_damaged_response(tmp_path):
    with RunStore(tmp_path) as store:
        store.put_done(Done("k", VALUES, CASE, awkward_response(), 1.0, 1.0))
    db = sqlite3.connect(tmp_path / "runs.sqlite")
    blob = bytearray(db.execute("SELECT response FROM runs").fetchone()[0])
    blob[len(blob) // 2] ^= 1
    db.execute("UPDATE runs SET response = ?", (bytes(blob),))
    db.commit()
    db.close()
    with RunStore(tmp_path) as store, pytest.raises(StoreError, match="damaged"):
        store.get("k")


def test_other_schema_and_foreign_file(tmp_path):
    with RunStore(tmp_path):
        pass
    db = sqlite3.connect(tmp_path / "runs.sqlite")
    db.execute("PRAGMA user_version = 7")
    db.close()
    with pytest.raises(StoreError, match="has schema 7; this version of rso reads schema 1"):
        RunStore(tmp_path).__enter__()
    (tmp_path / "foreign").mkdir()
    db = sqlite3.connect(tmp_path / "foreign" / "runs.sqlite")
    db.execute("CREATE TABLE t (x)")
    db.close()
    before = (tmp_path / "foreign" / "runs.sqlite").read_bytes()
    with pytest.raises(StoreError, match="is not a store of rso"):
        RunStore(tmp_path / "foreign").__enter__()
    assert (tmp_path / "foreign" / "runs.sqlite").read_bytes() == before


def test_a_store_whose_maker_was_killed_at_once_is_empty_and_goes_on(tmp_path):
    (tmp_path / "runs.sqlite").touch()
    with pytest.raises(StoreError, match=r"is empty: .* nothing has been run yet"):
        RunStore(tmp_path, read_only=True).__enter__()
    with RunStore(tmp_path) as store:
        assert store.rows() == []


def test_file_in_place_of_the_folder(tmp_path):
    (tmp_path / "results").write_text("a file")
    with pytest.raises(StoreError, match="cannot be used"):
        RunStore(tmp_path / "results").__enter__()


@pytest.fixture
def nobody():
    """Root may write anywhere: be someone else for a while."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    yield
    os.seteuid(0)


def test_read_only_folder(nobody):
    with tempfile.TemporaryDirectory() as name:  # not tmp_path: its parents are closed to others
        folder = Path(name)
        with RunStore(folder) as store:
            store.put_done(Done("k", VALUES, CASE, awkward_response(), 1.0, 1.0))
        for path in (*folder.iterdir(), folder):
            path.chmod(0o555 if path.is_dir() else 0o444)
        with pytest.raises(StoreError, match=r"(?i)cannot be used .*(permission denied|readonly).* writable"):
            RunStore(folder).__enter__()
        with RunStore(folder, read_only=True) as store:  # an archive can still be read
            assert isinstance(store.get("k"), Done)
        folder.chmod(0o755)
        (folder / "objects").chmod(0o755)


def test_full_disk_keeps_what_was_stored(tmp_path):
    rng = np.random.default_rng(0)
    with RunStore(tmp_path) as store:
        store.put_done(Done("first", VALUES, CASE, awkward_response(rng), 1.0, 1.0))
        store._db.execute("PRAGMA max_page_count = 20")
        with pytest.raises(StoreError, match=r"full.*Finished runs stay stored"):
            for i in range(100):
                store.put_done(Done(str(i), VALUES, CASE, awkward_response(rng, 500), 1.0, 1.0))
        assert isinstance(store.get("first"), Done)
    with RunStore(tmp_path) as store:
        store.put_done(Done("later", VALUES, CASE, awkward_response(rng), 1.0, 1.0))
        assert {"first", "later"} <= {r.key for r in store.rows()}


def test_a_failed_write_leaves_the_store_usable(tmp_path):
    with RunStore(tmp_path) as store:
        sha = hashlib.sha256(b"points").hexdigest()
        (tmp_path / "objects" / sha[:2]).write_text("a file where a folder must be")
        with pytest.raises(StoreError, match="cannot be used"):
            store.put_artefact("mesh", "recipe", b"points")
        assert store.artefact("recipe") is None
        store.put_done(Done("k", VALUES, CASE, awkward_response(), 1.0, 1.0))
    with RunStore(tmp_path) as store:
        assert isinstance(store.get("k"), Done)


def test_closed_store(tmp_path):
    with pytest.raises(StoreError, match="not open"):
        RunStore(tmp_path).get("k")
