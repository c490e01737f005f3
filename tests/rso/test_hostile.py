"""Study folders, stores and backends of strangers: nothing of theirs runs, is overwritten or is believed unasked."""

import json
import os
import shlex
import shutil
import sqlite3
import subprocess
import sys
import time
import zlib
from pathlib import Path

import hostile_calls as calls
import numpy as np
import pytest
import sample_studies as studies

from rso.api import workspace
from rso.api.workspace import executor
from rso.calibration.plan import source_of
from rso.calibration.result_files import write_runs
from rso.cli import commands, main
from rso.contract import Case, Programme, Response
from rso.core import disk
from rso.core.printable import as_one_entry, printable
from rso.evaluation import Source, WorkerDied, WorkerPool, load_backend
from rso.evaluation.artefact_files import keep_artefact
from rso.evaluation.fingerprints import fingerprint_of
from rso.evaluation.store import Done, RunStore, StoreError
from rso.study.confusable_text import drawn, look_alikes, too_deep
from rso.study.loader import load_study

HERE = Path(__file__).parent
CASE = Case("c", Programme.ramp((1.0,)))


def command(*arguments, folder="/", **options):
    """`python -P -m rso.cli` in a process of its own, started in a folder."""
    return subprocess.run(
        [sys.executable, "-P", "-m", "rso.cli", *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        **options,
    )


# ------------------------------------------------------------------------------------------------------ workers

SHADOWED = ("socket", "selectors", "random", "tempfile", "signal", "pickle", "multiprocessing", "numpy", "rso")


def test_modules_of_the_folder_a_worker_is_started_in_are_not_imported(tmp_path):
    for name in SHADOWED:
        (tmp_path / f"{name}.py").write_text("raise SystemExit('executed')\n")
    code = (
        "from rso.evaluation import Source, WorkerPool\nimport math\n"
        "with WorkerPool(1, source=Source('dummy_backend:BACKEND')) as pool: "
        "print(pool.submit(math.sqrt, 4.0).result())"
    )
    environment = {**os.environ, "PYTHONPATH": str(HERE)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "2.0\n"), done.stderr
    bad = subprocess.run([sys.executable, "-c", "import socket"], cwd=tmp_path, capture_output=True, text=True)
    assert "executed" in bad.stderr  # the trap works where nobody minds


@pytest.mark.parametrize("fork", [calls.fork_and_return, calls.fork_and_fail])
def test_a_copy_of_the_worker_answers_nothing(fork):
    with WorkerPool(1) as pool:
        futures = [pool.submit(fork if k % 3 == 0 else calls.same, k) for k in range(20)]
        assert [f.result() for f in futures] == list(range(20))


def test_an_answer_to_another_call_is_taken_for_none():
    with WorkerPool(1) as pool:
        with pytest.raises(WorkerDied, match="answered another call"):
            pool.submit(calls.answer_for_another, 1).result()
        assert pool.submit(calls.same, 2).result() == 2  # by a new worker


def test_what_a_worker_leaves_behind_ends_with_it(tmp_path):
    file = tmp_path / "pid"
    with WorkerPool(1) as pool:
        pool.submit(calls.leave_a_copy, str(file)).result()
        while not file.exists() or not file.read_text():
            time.sleep(0.01)
    deadline = time.monotonic() + 10.0
    while _lives(file.read_text()):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _lives(process: str) -> bool:
    try:
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False


@pytest.mark.parametrize(
    ("backend", "dispatch", "limit"),
    [
        ('use = "a:B"\ntimeout = "2 s"', "jobs = 1", 2.0),
        ('use = "a:B"\ntimeout = "2 s"', 'timeout = "1 s"', 1.0),
        ('use = "a:B"', 'timeout = "3 s"', 3.0),
        ('use = "a:B"', "jobs = 1", None),
        ('command = ["a"]\ntimeout = "2 s"', "jobs = 1", None),
    ],
)
def test_the_time_out_of_a_backend_holds_for_an_object_too(tmp_path, backend, dispatch, limit):
    study = load_study(studies.write(tmp_path, backend=backend, dispatch=dispatch))
    with executor(study.dispatch, 1, source_of(study), tmp_path) as pool:
        assert pool._timeout_s == limit  # a command is stopped by its own adapter


# ------------------------------------------------------------------------------------------------------ answers


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.array([1j, 2j]), "complex numbers"),
        ([1 + 0j, 2], "complex numbers"),
        (["1", "2"], "text"),
        ([True, False], "truth values"),
        (np.ma.array([1.0, 2.0], mask=[True, False]), "masked"),
        ([None, 1.0], "no number"),
        ([{}, 1.0], "a number is expected"),
        ([1.0, 10**400], "too large"),
        ([np.nan, 1.0], "no number"),
    ],
)
def test_only_real_numbers_are_an_answer(value, words):
    units = {"time": "s", "travel": "mm", "Fz": "N"}
    good = {"time": [0.0, 1.0], "travel": [0.0, 1.0]}
    with pytest.raises(ValueError, match=words):
        Response({**good, "Fz": value}, units)
    if words != "no number":
        with pytest.raises(ValueError, match=words):
            Response({**good, "Fz": [0.0, 1.0]}, units, gradients={"mu": {"Fz": value}})
    integers = Response({**good, "Fz": np.array([1, 2], dtype=object)}, units).channels["Fz"]
    assert integers.dtype == float and integers.tolist() == [1.0, 2.0]


def test_a_changed_helper_of_a_backend_is_another_backend(tmp_path):
    main_file, helper = tmp_path / "mine.py", tmp_path / "helper.py"
    main_file.write_text("def f():\n    import helper, part.inner\n    return open('table.csv')\n")
    assert fingerprint_of(str(main_file)) == disk_hash(main_file)  # alone as it always was: keys stay
    found = {fingerprint_of(str(main_file))}
    helper.write_text("A = 1\n")
    (tmp_path / "part").mkdir()
    for file, texts in (
        (helper, ["A = 2\n", "from far import B\n", "import importlib\nimportlib.import_module('named')\n"]),
        (tmp_path / "part" / "__init__.py", ["", "C = 1\n"]),
        (tmp_path / "part" / "inner.py", ["from . import near\n", "from .near import *\n"]),
        (tmp_path / "part" / "near.py", ["D = 1\n", "D = 2\n"]),
        (tmp_path / "named.py", ["E = 1\n", "E = 2\nimport mine\n"]),
    ):
        for text in texts:
            file.write_text(text)
            found.add(fingerprint_of(str(main_file)))
    assert len(found) == 1 + 3 + 2 + 2 + 2 + 2
    before = fingerprint_of(str(main_file))
    (tmp_path / "unrelated.py").write_text("F = 1\n")
    assert fingerprint_of(str(main_file)) == before


def disk_hash(file: Path) -> str:
    import hashlib

    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_helpers_enter_the_fingerprint_of_objects_and_commands(tmp_path):
    script = (
        "import sys, json\nimport aid_of_it\n"
        "print(json.dumps({'name': 'x', 'numerics': 1, 'channels': {}, 'parameters': []}))\n"
    )
    (tmp_path / "driver.py").write_text(script)
    prints = []
    for text in ("A = 1\n", "A = 2\n"):
        (tmp_path / "aid_of_it.py").write_text(text)
        prints.append(load_backend(command=[sys.executable, "driver.py"], base=tmp_path).fingerprint)
    assert prints[0] != prints[1]


@pytest.mark.parametrize("text", ["raise SystemExit(3)", "1 / 0", "def :", "import nowhere_at_all"])
def test_a_module_that_cannot_be_imported_is_told_in_words(tmp_path, capsys, text):
    (tmp_path / "unfit.py").write_text(text)
    sys.modules.pop("unfit", None)
    studies.write(tmp_path, backend='use = "unfit:BACKEND"')
    with pytest.raises(ValueError, match="'unfit'"):
        Source("unfit:BACKEND", base=str(tmp_path)).load()
    assert main(["check", "--trust", str(tmp_path)]) == 2 and "unfit" in capsys.readouterr().err


# ------------------------------------------------------------------------------------------------------ store


def response(force: float) -> Response:
    return Response({"time": [1.0], "travel": [1.0], "Fz": [force]}, {"time": "s", "travel": "mm", "Fz": "N"})


def stored(folder: Path) -> Path:
    with RunStore(folder) as store:
        for k in range(3):
            store.put_done(Done(f"key{k}", {"x": float(k)}, CASE, response(k + 1.0), 1, 1.0))
    return folder / "runs.sqlite"


def changed(file: Path, *statements: str) -> None:
    with sqlite3.connect(file) as db:
        for statement in statements:
            db.execute(statement)
    db.close()


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE runs SET response = (SELECT response FROM runs WHERE key = 'key1') WHERE key = 'key0'",
        "UPDATE runs SET \"values\" = '{\"x\": 7.0}' WHERE key = 'key0'",
        "UPDATE runs SET wall_s = 3.0 WHERE key = 'key0'",
        "UPDATE runs SET state = 'failed', cause = 'contact', reason = 'x', history = '[]' WHERE key = 'key0'",
        "UPDATE runs SET key = CASE key WHEN 'key0' THEN 'key9' ELSE key END; ",
    ],
)
def test_a_row_that_is_not_the_one_that_was_stored_is_refused(tmp_path, statement):
    file = stored(tmp_path)
    changed(file, statement)
    key = "key9" if "key9" in statement else "key0"
    with RunStore(tmp_path, read_only=True) as store:
        assert store.get("key2").response.channels["Fz"] == [3.0]
        with pytest.raises(StoreError, match=rf"{key} is not as it was stored.*restore a copy"):
            store.get(key)


def test_rows_of_an_older_version_stay_valid(tmp_path):
    file = stored(tmp_path)
    changed(file, "ALTER TABLE runs DROP COLUMN checksum")
    with RunStore(tmp_path, read_only=True) as store:
        assert store.get("key1").response.channels["Fz"] == [2.0]
    with RunStore(tmp_path) as store:
        store.put_done(Done("key3", {"x": 3.0}, CASE, response(4.0), 1.0, 1.0))
        assert [store.get(f"key{k}").response.channels["Fz"][0] for k in range(4)] == [1.0, 2.0, 3.0, 4.0]
    changed(file, "UPDATE runs SET wall_s = 2.0")
    with RunStore(tmp_path) as store:
        assert store.get("key0").wall_s == 2.0
        with pytest.raises(StoreError, match="checksum"):
            store.get("key3")


@pytest.mark.parametrize(
    "text",
    [
        b" " * (100 * 1024 * 1024),
        b'{"channels": ' + b"[" * 200_000,
        b"[1, 2]",
        b"{}",
        b'{"channels": 3, "units": []}',
        b"nul",
        b'{"channels": {"time": ["x"], "travel": [1]}, "units": {}}',
    ],
)
def test_a_stored_answer_that_is_none_is_damage_in_words(tmp_path, text):
    file = stored(tmp_path)
    with sqlite3.connect(file) as db:
        db.execute("UPDATE runs SET checksum = NULL, response = ? WHERE key = 'key0'", (zlib.compress(text, 9),))
    db.close()
    with RunStore(tmp_path) as store, pytest.raises(StoreError, match=r"damaged \(run key0"):
        store.get("key0")


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("cpu_s", "soon"),
        ("wall_s", b"1"),
        ("cpu_s", 1e999),
        ('"values"', "[]"),
        ('"values"', '{"x": "a"}'),
        ('"values"', "[" * 9000),
        ("reason", b"\xff"),
        ("cause", b"\xff"),
        ("history", "[3]"),
    ],
)
def test_what_a_row_says_of_its_run_is_of_the_kind_that_was_stored(tmp_path, column, value):
    file = stored(tmp_path)
    with sqlite3.connect(file) as db:
        if column in ("reason", "cause", "history"):
            db.execute("UPDATE runs SET state = 'failed', cause = 'c', reason = 'r', history = '[]' WHERE key = 'key0'")
        db.execute(f"UPDATE runs SET checksum = NULL, {column} = ? WHERE key = 'key0'", (value,))
    db.close()
    with RunStore(tmp_path, read_only=True) as store, pytest.raises(StoreError, match=r"damaged \(run key0"):
        store.get("key0")


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE VIEW more AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT * FROM n",
        "CREATE TRIGGER t AFTER INSERT ON runs BEGIN DELETE FROM runs; END",
        "CREATE TABLE other (a)",
        "ALTER TABLE runs ADD COLUMN computed AS (hex(key))",
    ],
)
def test_a_database_that_computes_is_no_store(tmp_path, statement):
    changed(stored(tmp_path), statement)
    for read_only in (True, False):
        with pytest.raises(StoreError, match="which no store of rso has"):
            RunStore(tmp_path, read_only=read_only).__enter__()


# ------------------------------------------------------------------------------------------------------ links

VICTIM = "mine, and not to be touched\n"


@pytest.mark.parametrize(
    "name", ["runs.lock", "runs.sqlite", "runs.sqlite-wal", "runs.sqlite-shm", "objects", "objects/ab"]
)
@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_a_store_is_not_written_through_links(tmp_path, name, link):
    folder, victim = tmp_path / "results", tmp_path / "victim"
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    if name.startswith("objects"):
        if link is os.link:
            pytest.skip("folders have one name")
        victim.mkdir()
        name = name.replace("ab", disk_sha(b"mesh")[:2])
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
    else:
        victim.write_text(VICTIM)
    link(victim, folder / name)
    with pytest.raises(StoreError, match=r"is a symbolic link|is one of 2 names"), RunStore(folder) as store:
        store.put_artefact("mesh", "recipe", b"mesh")
    assert not list(victim.iterdir()) if victim.is_dir() else victim.read_text() == VICTIM


def disk_sha(data: bytes) -> str:
    import hashlib

    return hashlib.sha256(data).hexdigest()


WRITTEN = (
    "results.json",
    "runs.csv",
    "posterior.csv",
    "report.html",
    "report.pdf",
    "study",
    "surrogates.npz",
    "surrogates.json",
    "x.tmp",
)


def test_a_run_overwrites_nothing_that_links_in_its_folder_lead_to(tmp_path, monkeypatch):
    folder, victims = tmp_path / "study" / "results", tmp_path / "victims"
    studies.write(
        tmp_path / "study",
        parameters='mu = { low = "6 kPa", high = "20 kPa", scale = "log" }\nD1 = { value = 60 }',
        doe="runs = 8\nheld_out = 1",
        sensitivity="sobol = false\nlocal = false",
        report="html = true\npdf = false",
    )
    monkeypatch.setattr(workspace, "executor", lambda *_: studies.Inline())  # workers write nothing there
    folder.mkdir()
    victims.mkdir()
    names = [*WRITTEN, *(f"{n}.tmp" for n in WRITTEN), *(f"{n}.part" for n in WRITTEN), "results.tmp", "study.tmp"]
    names += [f".{n}.{os.getpid()}.part" for n in WRITTEN]
    for name in dict.fromkeys(names):
        (victims / name).write_text(VICTIM)
        (folder / name).symlink_to(victims / name)
    assert main(["run", str(tmp_path / "study"), "--jobs", "1"]) in (0, 3, 4)
    assert {p.read_text() for p in victims.iterdir()} == {VICTIM}
    assert json.loads((folder / "results.json").read_text())["study"]["title"] == "Layer"
    assert not (folder / "results.json").is_symlink()


def test_a_results_folder_that_is_a_link_is_followed_only_when_named(tmp_path, capsys):
    studies.write(tmp_path / "study")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "study" / "results").symlink_to(tmp_path / "elsewhere")
    assert main(["run", str(tmp_path / "study")]) == 2
    assert "is a symbolic link" in capsys.readouterr().err and not list((tmp_path / "elsewhere").iterdir())


def test_a_file_is_replaced_whole_and_read_only_where_it_is_one(tmp_path):
    file = tmp_path / "a.json"
    disk.replace(file, "1")
    assert disk.read_json(file) == 1 and file.stat().st_mode & 0o444
    for text in ("[" * 200_000, "{", ""):
        disk.replace(file, text)
        with pytest.raises(ValueError):
            disk.read_json(file)
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    with open(tmp_path / "sparse", "wb") as f:
        f.truncate(10**12)
    for name in ("pipe", "zero", "sparse", ".", "none"):
        with pytest.raises(OSError):
            disk.read_bytes(tmp_path / name)
    with pytest.raises(OSError, match=r"sub'?$"):
        (tmp_path / "sub").mkdir()
        disk.replace(tmp_path / "sub", "1")
    (tmp_path / ".a.json.999999999.part").touch()
    (tmp_path / f".a.json.{os.getpid()}.part").touch()
    disk.without_leftovers(tmp_path)
    assert [p.name for p in tmp_path.glob(".*")] == [f".a.json.{os.getpid()}.part"]


# ------------------------------------------------------------------------------------------------------ what is shown

BAD = "\x1b[2J\x1b]0;t\x07\r\x9b31m\u202e\u200b\u2028\ud800"


def test_only_what_is_seen_reaches_a_terminal():
    shown = printable(BAD)
    assert shown.isprintable() and shown.startswith("\\x1b[2J\\x1b]0;t\\x07\\x0d\\x9b31m\\u202e")
    assert printable("μ = 3 kPa\n\tν ≤ 0.5, 1 mm") == "μ = 3 kPa\n\tν ≤ 0.5, 1 mm"
    assert as_one_entry("a\nrso: forged\n  own") == "a\n    rso: forged\n  own"


@pytest.mark.parametrize(
    "change",
    [
        {"study": f"title = {json.dumps('A' + BAD[:8])}\nseed = 0"},
        {"study": 'title = "A\\n\\nrso: forged"\nseed = 0'},
        {"study": f'title = "A"\nseed = 0\n{json.dumps(BAD[:8])} = 1'},
        {"search": f"targets = [{{ experiment = {json.dumps('top' + BAD[:8])}, depth = 1 }}]"},
        {"backend__settings": 'thickness = 8\n"a\\nrso: forged" = 3'},
        {"[experiments]": 'name = "top"\nrole = "fit"\ndata = "a\\nrso: forged.csv"'},
        {"[experiments]": 'name = "top"\nrole = "fit"\ndata = "top.csv"\nmounting = "a\\u001b[1m"'},
    ],
)
def test_no_text_of_a_study_moves_the_cursor_or_forges_a_line(tmp_path, capsys, change):
    studies.write(tmp_path, **change)
    assert main(["check", "--trust", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert printable(said.out + said.err) == said.out + said.err
    assert not any(line.startswith("rso: forged") for line in said.err.splitlines())


def test_a_long_word_of_the_command_line_is_shown_in_part(capsys):
    assert main(["keys", "x" * 5000]) == 2
    assert "there is no table 'xxx" in (said := capsys.readouterr().err) and len(said) < 600


def test_a_path_of_the_command_line_is_shown_as_text(tmp_path, capsys):
    assert main(["check", str(tmp_path / "\x1b[31m\nrso: forged")]) == 2
    said = capsys.readouterr().err
    assert "\x1b" not in said and "\nrso: forged" not in said


@pytest.mark.parametrize(("command", "code"), [("status", 0), ("report", 2)])
def test_a_folder_whose_name_holds_a_line_is_one_line(tmp_path, capsys, command, code):
    studies.write(tmp_path)
    assert main([command, str(tmp_path), "--out", str(tmp_path / "a\nrso: forged")]) == code
    said = capsys.readouterr()
    assert "a\n    rso: forged" in said.out + said.err and "\nrso: forged" not in said.out + said.err


def test_cells_of_runs_are_no_formulas(tmp_path):
    run = {
        "key": "k",
        "purpose": "design",
        "state": "crashed",
        "cause": "@SUM(A1)",
        "reason": '=cmd|"/c calc"!A1',
        "wall_s": -1.0,
        "cpu_s": 1.0,
        "values": {"=mu": -0.5},
        "outputs": {"+Fz": -2.0},
    }
    write_runs(
        tmp_path / "runs.csv",
        {"parameters": [{"name": "=mu", "unit": "MPa"}], "runs": [run, run | {"reason": " -1+1"}]},
        {"=mu": "MPa"},
    )
    import csv

    rows = list(csv.reader((tmp_path / "runs.csv").open()))
    texts = [c for row in rows for c in row if not _number(c)]
    assert not any(c.lstrip().startswith(("=", "+", "-", "@")) for c in texts)
    assert "-0.5" in rows[1] and "-2.0" in rows[1]  # numbers stay numbers


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize(
    ("one_name", "other"),
    [
        ("top", "Top"),
        ("top", "tоp"),
        ("top", "top "),
        ("A 1", "А1"),
        ("Η", "H"),
        ("top", "ｔop"),
        ("side b", "sideb"),
        ("l1", "ll"),
    ],
)
def test_names_that_look_alike_are_told_apart_or_refused(tmp_path, capsys, one_name, other):
    assert drawn(one_name) == drawn(other)
    again = f'name = "{other}"\nrole = "validate"\ndata = "side.csv"'
    studies.write(
        tmp_path,
        experiments=f'name = "{one_name}"\nrole = "fit"\ndata = "top.csv"\n[[experiments]]\n{again}',
        search=None,
    )
    (tmp_path / "side.csv").write_text(studies.measured(noise=2e-5))
    assert main(["check", "--trust", str(tmp_path)]) == 2
    assert "looks like" in capsys.readouterr().err


def test_names_that_differ_to_the_eye_are_different():
    names = [
        "top",
        "tip",
        "point 1 12",
        "point 11 2",
        "point_1",
        "point 1.",
        "mu",
        "nu",
        "μ",
        "β",
        "ä",
        "a",
        "x-1",
        "x+1",
    ]
    assert list(look_alikes(names)) == []
    assert too_deep({"a": {"b": [1, {"c": 2}]}}, 4) is None and too_deep({"z": 1, "a": {"b": [1, {"c": 2}]}}, 2) == "a"


def test_keys_of_thousands_of_parts_are_refused_in_words(tmp_path, capsys):
    for line in (".".join(["a"] * 2000) + " = 1", "a = " + "[" * 300 + "]" * 300):
        studies.write(tmp_path, backend__settings=f"thickness = 8\n{line}")
        assert main(["check", "--trust", str(tmp_path)]) == 2
        assert "nested more than 64 deep" in capsys.readouterr().err


# ------------------------------------------------------------------------------------------------------ streams


# Others are tried with every command in tests/verification/test_hostile_inputs.py.
@pytest.mark.parametrize("closed", ["<&- >&- 2>&-", "> /dev/full", "| true"])
def test_closed_and_full_streams(tmp_path, closed):
    line = f"set -o pipefail; {sys.executable} -P -m rso.cli keys {closed}"
    done = subprocess.run(["bash", "-c", line], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert "Traceback" not in done.stderr and "Exception ignored" not in done.stderr, done.stderr
    assert done.returncode == (130 if "|" in closed else 1 if "full" in closed else 0), done


@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>{err}"])
def test_workers_of_a_command_without_streams_work(tmp_path, closed):
    code = (
        "from rso.cli import _open_streams\n_open_streams()\n"
        "from rso.evaluation import WorkerPool\nimport math, pathlib, sys\n"
        "with WorkerPool(1) as pool: pathlib.Path(sys.argv[1]).write_text(str(pool.submit(math.sqrt, 4.0).result()))"
    )
    answer, err = tmp_path / "answer", tmp_path / "err"
    line = f"{shlex.join([sys.executable, '-P', '-c', code, str(answer)])} {closed.format(err=err)}"
    done = subprocess.run(["bash", "-c", line], cwd="/", capture_output=True, text=True, timeout=60)
    said = done.stderr + (err.read_text() if err.exists() else "")
    assert (done.returncode, answer.read_text(), said) == (0, "2.0", "")


def test_a_fault_of_the_program_is_one_message(tmp_path, capsys, monkeypatch):
    def fault(options, command):
        raise LookupError("a fault\nrso: forged")

    monkeypatch.setattr(commands, "keys", fault)
    assert main(["keys"]) == 1
    said = capsys.readouterr().err
    assert "LookupError: a fault" in said and "\nrso: forged" not in said and "Traceback" not in said
    monkeypatch.setenv("RSO_TRACEBACK", "1")
    with pytest.raises(LookupError):
        main(["keys"])


# ------------------------------------------------------------------------------------------------------ shared folders


def test_objects_of_a_folder_that_others_may_write_to_are_not_believed(tmp_path):
    content, folder = b"mesh", tmp_path / "objects"
    sha = disk_sha(content)
    keep_artefact(folder, sha, content)
    assert (folder / sha[:2] / sha).read_bytes() == content
    (folder / sha[:2] / sha).write_bytes(b"cut")
    keep_artefact(folder, sha, content)
    assert (folder / sha[:2] / sha).read_bytes() == content
    folder.chmod(0o777)
    with pytest.raises(PermissionError, match="others may write"):
        keep_artefact(folder, sha, content)
    folder.chmod(0o700)
    (tmp_path / "link").symlink_to(folder)
    with pytest.raises(PermissionError, match="is a link"):
        keep_artefact(tmp_path / "link", sha, content)


# ------------------------------------------------------------------------------------------------------ machines


@pytest.fixture(scope="module")
def read_only(tmp_path_factory):
    """A copy of the program in which nothing can be kept beside the code, whoever one is."""
    root = tmp_path_factory.mktemp("code")
    for package in ("rso", "fem_backend"):
        shutil.copytree(HERE.parents[1] / package, root / package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [p for p in root.rglob("*") if p.is_dir()]:
        (folder / "__pycache__").touch()
    return root


KERNEL = """
import os, sys
from rso.cli import main
code = main(sys.argv[1:])
if code == 0:
    from fem_backend.contact import pointwise
    made, folder = pointwise.facet_points.dispatcher, os.environ.get("NUMBA_CACHE_DIR")
    print("kept", folder is not None and made.stats.cache_path.startswith(folder))
sys.exit(code)
"""


@pytest.mark.parametrize("temporary", ["there", "nowhere"])
def test_read_only_code_without_a_home_runs(tmp_path, read_only, temporary):
    """With a temporary folder of its own for compiled code, which is gone afterwards; with none it keeps nothing."""
    (tmp_path / "there").mkdir()
    studies.write(tmp_path / "study")
    # Python goes on to /tmp and to where it stands unless it is told otherwise.
    nowhere = "import tempfile\ntempfile._candidate_tempdir_list = lambda: ['/dev/null']\n"
    (tmp_path / "sitecustomize.py").write_text(nowhere if temporary == "nowhere" else "")
    around = {
        "PYTHONPATH": f"{read_only}{os.pathsep}{tmp_path}",
        "HOME": "/dev/null",
        "PYTHONDONTWRITEBYTECODE": "1",
        "TMPDIR": str(tmp_path / temporary),
    }
    kept = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")}
    line = [sys.executable, "-P", "-c", KERNEL, "status", str(tmp_path / "study")]
    done = subprocess.run(line, cwd="/", env=kept | around, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert "not started" in done.stdout
    assert done.stdout.splitlines()[-1] == f"kept {temporary == 'there'}"
    assert list((tmp_path / "there").iterdir()) == []


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("MPLBACKEND", "nowhere"),
        ("MPLCONFIGDIR", "/dev/null"),
        pytest.param("COLUMNS", "-1", marks=pytest.mark.verification),
    ],
)
def test_figures_are_drawn_whatever_a_machine_says_of_windows(name, value):
    code = "from rso.cli import main\nmain(['keys', 'study'])\nfrom rso.report import canvas\nprint('drawn')"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], cwd="/", env={**os.environ, name: value}, capture_output=True, text=True
    )
    assert done.stdout.endswith("drawn\n") and "Traceback" not in done.stderr, done.stderr


@pytest.mark.parametrize("epoch", ["x", "", "1.5", "-1", "1700000000"])
def test_a_date_of_builds_that_is_none_ends_no_command(epoch):
    """numpy.f2py, which scipy's imports load, reads SOURCE_DATE_EPOCH as a whole number."""
    code = "import rso, numpy.f2py, os; print(os.environ.get('SOURCE_DATE_EPOCH'))"
    around = {**os.environ, "SOURCE_DATE_EPOCH": epoch, "PYTHONPATH": str(HERE.parents[1])}
    done = subprocess.run([sys.executable, "-P", "-c", code], env=around, capture_output=True, text=True, timeout=60)
    kept = epoch if epoch.removeprefix("-").isdecimal() else None
    assert (done.returncode, done.stdout.strip()) == (0, str(kept)), done.stderr
