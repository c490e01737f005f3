"""Commands × damaged inputs: a documented exit code, one message, never a traceback, and nothing else is touched.

RSO_HOSTILE="first last" looks at other cases than the usual ones.
"""

import contextlib
import hashlib
import io
import os
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from concurrent.futures import Future
from pathlib import Path

import damages
import matplotlib.figure  # noqa: F401  # before any case: an import that fails would fail for all that follow
import pytest
import sample_studies as studies
import test_diagnosis_study as toy

import rso.evaluation
from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing import recipes
from rso.api import workspace
from rso.cli import commands, main
from rso.core.printable import printable

pytestmark = pytest.mark.verification

FIRST, LAST = map(int, os.environ.get("RSO_HOSTILE", "0 2000").split())
CHUNK, CACHES, PROCESSES = 50, 100, 51
RSO = Path(studies.__file__).parent
RECIPES = [recipes.mapped_recipe(EllipsoidShape(60.0, 35.0, c), 6, 0.3) for c in (35.0, 30.0)]
CODES = {0, 1, 2, 3, 4, 5, 6, 7, 130}  # README
COMPUTES = ("run", "diagnose", "ladder", "next", "blind")
PATIENCE_S = 20  # of a command that computes nothing; one that computes is interrupted before, which is no fault


class Unable(studies.Inline):
    """Every simulation crashes: the finite elements of a laboratory are none of this test's business."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(rso.evaluation.WorkerDied("no machine"))
        return future


@pytest.fixture(scope="session")
def bases(tmp_path_factory):
    """Good folders with everything that every command finds and leaves."""
    folder = tmp_path_factory.mktemp("bases")
    damages.layer(folder / "layer")
    damages.one(folder / "one")
    toy.write(folder / "toy")
    damages.bench(folder / "laboratory")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workspace, "executor", lambda *_, **__: studies.Inline())
        for name, command in (
            ("layer", "run"),
            ("one", "run"),
            ("one", "ladder"),
            ("one", "next"),
            ("toy", "diagnose"),
        ):
            assert main([command, str(folder / name)]) == 0, (name, command)
    return folder


def outside(folder: Path) -> dict[str, str]:
    """What a case may not change: everything but the results, and what it was told to write."""
    found = {}
    for at, _, names in os.walk(folder):
        parts = Path(at).relative_to(folder).parts
        if parts[:1] == ("made",) or (parts[:1] == ("study",) and parts[1:] and parts[1].startswith("results")):
            continue
        for name in names:
            path = Path(at) / name
            mode = path.lstat().st_mode
            content = (
                os.readlink(path).encode() if stat.S_ISLNK(mode) else path.read_bytes() if stat.S_ISREG(mode) else b""
            )
            found[str(path.relative_to(folder))] = f"{stat.S_IFMT(mode)} {hashlib.sha256(content).hexdigest()}"
    return found


def called(case: damages.Case) -> tuple[int, str, str]:
    """Exit code, output and errors of a command in this process."""
    out, err = io.StringIO(), io.StringIO()
    computes = case.arguments[0] in COMPUTES

    def ring(*_):
        if computes:
            raise KeyboardInterrupt
        raise AssertionError(f"no answer after {PATIENCE_S} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(PATIENCE_S // 2 if computes else PATIENCE_S)
    path = list(sys.path)
    try:
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            patch.setattr(workspace, "executor", lambda *_, **__: studies.Inline())
            patch.setattr(rso.evaluation, "WorkerPool", lambda *_, **__: Unable())
            patch.setattr(tempfile, "tempdir", None)
            for name, value in case.environment.items():
                patch.delenv(name, raising=False) if value is None else patch.setenv(name, value)
            code = main(list(case.arguments))
    except SystemExit as end:
        code = end.code
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        sys.path[:] = path
    return code, out.getvalue(), err.getvalue()


def faults(n: int, bases: Path, folder: Path) -> str | None:
    """What is wrong with how a case ends, or None."""
    case = damages.case(n, bases, folder)
    before = outside(folder)
    code, out, err = called(case)
    return judged(f"case {n} ({case.name}): {case.arguments} {case.environment}", code, out, err, folder, before)


def judged(
    name: str, code: int, out: str, err: str, folder: Path, before: dict[str, str], quiet: bool = False
) -> str | None:
    """What is wrong with an exit code and what was printed, or None; `quiet` where nobody can read it."""
    said, pages = out + err, [p.read_text("utf-8", "replace") for p in folder.rglob("*.html") if p.is_file()]
    wrong = {
        f"exit code {code}": code not in CODES,
        "no message": code != 0 and not said.strip() and not quiet,
        "a traceback": "Traceback" in said or "Exception ignored" in said,
        "a fault of the program": "a fault of the program" in said,
        "unseen characters": printable(said) != said,
        "a forged line": any(line.startswith("rso: forged") for line in said.splitlines()),
        "a line without end": any(len(line) > 1500 for line in err.splitlines()),
        "other files changed": outside(folder) != before,
        "text in a page that runs": any("<script>alert(1)" in page for page in pages),
    }
    found = [what for what, is_so in wrong.items() if is_so]
    return f"{name}: {found} {said[-700:]}" if found else None


@pytest.mark.parametrize("first", range(FIRST, LAST, CHUNK))
def test_every_command_ends_in_words_whatever_it_is_given(tmp_path, bases, first):
    found = [f for n in range(first, min(first + CHUNK, LAST)) if (f := faults(n, bases, tmp_path / "case"))]
    assert not found, "\n\n".join([f"{len(found)} of {CHUNK}", *found])


@pytest.mark.parametrize("first", range(0, CACHES, 50))
def test_a_damaged_mesh_cache_is_never_believed(tmp_path, monkeypatch, first):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "victim").write_text(damages.VICTIM)
    mesh, _ = (recipes.cached(r) for r in RECIPES)
    file, other = (recipes.cache() / f"{hashlib.sha256(r.encode()).hexdigest()}.npz" for r in RECIPES)
    good = file.read_bytes()
    for n in range(first, first + 50):
        kind = damages.cache(n, file, other)
        found = recipes.cached(RECIPES[0])
        assert found.to_bytes() == mesh.to_bytes(), (n, kind)
        assert (tmp_path / "victim").read_text() == damages.VICTIM, (n, kind)
        shutil.rmtree(file) if file.is_dir() and not file.is_symlink() else file.unlink(missing_ok=True)
        file.write_bytes(good)
        file.chmod(0o600)


@pytest.mark.parametrize("first", range(0, PROCESSES, 17))
def test_every_process_ends_in_words_wherever_it_is_started(tmp_path, bases, first):
    found = []
    for n in range(first, min(first + 17, PROCESSES)):
        folder = tmp_path / "case"
        shell, case = damages.process(n, bases, folder)
        before = outside(folder)
        line = shell.format(shlex.join([sys.executable, "-P", "-m", "rso.cli", *case.arguments]))
        around = {
            **os.environ,
            # An empty entry is the working folder, and without one Python itself does not start.
            "PYTHONPATH": os.pathsep.join(filter(None, [str(RSO), os.environ.get("PYTHONPATH", "")])),
            **case.environment,
        }
        around = {k: v for k, v in around.items() if v is not None}
        if "gone" in line:
            before = {k: v for k, v in before.items() if not k.startswith("gone")}
        whole = ["/bin/bash", "-c", f"set -o pipefail; {line}"]
        done = subprocess.run(
            whole, cwd=folder, env=around, capture_output=True, text=True, errors="replace", timeout=120
        )
        quiet = "2>" in shell
        name = f"process {n}: {shell} {case.arguments} {case.environment}"
        found.append(judged(name, done.returncode, done.stdout, done.stderr, folder, before, quiet))
    assert not any(found), "\n\n".join(filter(None, found))


def _unforeseen(options, command):
    raise LookupError("a fault")


def _raw(options, command):
    sys.stdout.stream.write("\x1b[2J")
    return 0


def _careless(options, command):
    folder = options.study if options.study.is_dir() else options.study.parent
    (folder.parent / "victim").write_text("written over")
    return 0


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (_unforeseen, "a fault of the program"),
        (_raw, "unseen characters"),
        (_careless, "other files changed"),
        (lambda *_: 9, "exit code 9"),
        (lambda *_: 2, "no message"),
    ],
)
def test_what_is_looked_for_is_found(tmp_path, bases, monkeypatch, call, what):
    """The same case is without fault, and with it when the command is replaced by one that has it."""
    n = next(
        n
        for n in range(1000)
        if damages.case(n, bases, tmp_path / "case").arguments[0] == "status"
        and (tmp_path / "case" / "study" / "study.toml").is_file()
    )
    assert faults(n, bases, tmp_path / "case") is None
    monkeypatch.setattr(commands, "status", call)
    assert what in faults(n, bases, tmp_path / "case")
