"""A thousand mutated study and data files: never a traceback, never a hang, exit code 2 exactly where one is wrong."""

import contextlib
import io
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import fuzzing
import pytest

from rso.cli import main

HERE = Path(__file__).parent
FAST, ALL = 60, 1000
LIMIT_S = 5
CHECK = ["check", "--trust"]


@contextlib.contextmanager
def at_most(seconds: int) -> Iterator[None]:
    """TimeoutError where the block hangs; also in pure Python loops."""

    def ring(*_: object) -> None:
        raise AssertionError(f"no answer after {seconds} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def verdict(folder: Path) -> tuple[int, str, str]:
    """Exit code, output and errors of `rso check`, in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), at_most(LIMIT_S):
        code = main([*CHECK, str(folder)])
    return code, out.getvalue(), err.getvalue()


def check(n: int, folder: Path) -> None:
    name, right = fuzzing.case(n, folder)
    code, out, err = verdict(folder)
    what = f"case {n} ({name}), exit code {code}: {out[:300]} {err[:600]}"
    assert code in right, what
    assert "Traceback" not in out + err, what
    assert (err == "") == (code == 0), what
    assert code == 0 or str(folder) in err, what  # every message names the file
    assert all(len(line) < 1500 for line in err.splitlines()), what  # and shows no more of it than helps
    assert not (folder / "results").exists(), what


@pytest.mark.parametrize("n", range(FAST))
def test_mutated_files(tmp_path, n):
    check(n, tmp_path / "study")


@pytest.mark.verification
@pytest.mark.parametrize("first", range(FAST, ALL, 94))
def test_mutated_files_by_the_thousand(tmp_path, first):
    for n in range(first, min(first + 94, ALL)):
        check(n, tmp_path / "study")


@pytest.mark.parametrize("n", [3, *(pytest.param(n, marks=pytest.mark.verification) for n in (9, 27))])
def test_mutated_files_in_a_process(tmp_path, n):
    name, right = fuzzing.case(n, tmp_path / "study")
    done = subprocess.run(
        [sys.executable, "-m", "rso.cli", *CHECK, str(tmp_path / "study")],
        env={**os.environ, "PYTHONPATH": str(HERE)},
        capture_output=True,
        text=True,
        timeout=4 * LIMIT_S,
    )
    assert done.returncode in right and "Traceback" not in done.stderr, (name, done)


def test_the_study_that_is_mutated_is_good(tmp_path):
    """Else every mutation would be refused, whatever it does."""
    fuzzing.case(0, tmp_path)
    (tmp_path / "top.csv").write_text(fuzzing.studies.measured())
    fuzzing.write(tmp_path, fuzzing.base())
    code, out, err = verdict(tmp_path)
    assert (code, err) == (0, "") and "good" in out


@pytest.mark.parametrize("digits", [400, pytest.param(4000, marks=pytest.mark.verification)])
def test_whole_numbers_too_large_for_a_float_are_refused_wherever_they_stand(tmp_path, digits):
    (tmp_path / "top.csv").write_text(fuzzing.studies.measured())
    fuzzing.write(tmp_path, fuzzing.full())
    assert verdict(tmp_path)[0] == 0  # as it is, it is good
    for place in list(fuzzing.places(fuzzing.full())):
        for value in (10**digits, -(10**digits)):
            study = fuzzing.full()
            fuzzing.put(study, place, value)
            fuzzing.write(tmp_path, study)
            code, out, err = verdict(tmp_path)
            assert (code, "Traceback" in out + err) == (2, False), (place, code, out, err[:300])
            assert all(len(line) < 1500 for line in err.splitlines()), place


# ------------------------------------------------------------------------------------------------------ trust


@pytest.mark.parametrize("backend", ['use = "mine:BACKEND"', 'command = ["./mine.sh", "--deck", "a"]'])
def test_a_study_is_data_foreign_code_runs_only_when_told_to(tmp_path, capsys, backend):
    trace = tmp_path / "was run"
    (tmp_path / "mine.py").write_text(f"open({str(trace)!r}, 'w').close()\n")
    (tmp_path / "mine.sh").write_text(f"#!/bin/sh\ntouch {str(trace)!r}\n")
    (tmp_path / "mine.sh").chmod(0o755)
    fuzzing.studies.write(tmp_path, backend=backend)
    before = list(sys.path)
    assert main(["check", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert "good as far as this can be said without its backend" in said.out and "--trust" in said.out
    assert not trace.exists() and sys.path == before
    assert main(["status", str(tmp_path)]) == 0 and not trace.exists()
    assert main(["check", "--trust", str(tmp_path)]) == 2  # neither is a backend: but now it was asked
    assert trace.exists()


def test_the_own_backend_needs_no_trust_and_imports_nothing_from_the_study(tmp_path):
    """A study's folder may hold modules with the names of libraries."""
    fuzzing.studies.write(tmp_path, backend='use = "fem_backend.backend:BACKEND"', backend__settings=None)
    for name in ("pypardiso", "fem_backend", "numpy", "pint"):
        (tmp_path / f"{name}.py").write_text(f"raise SystemExit('{name} of the study was imported')\n")
    done = subprocess.run(
        [sys.executable, "-c", "import sys; from rso.cli import main; sys.exit(main(sys.argv[1:]))", "check", tmp_path],
        capture_output=True,
        text=True,
        cwd="/",
        timeout=120,
    )
    assert "of the study was imported" not in done.stdout + done.stderr and "Traceback" not in done.stderr
    assert done.returncode in (0, 2)  # its settings are none of this test's business
