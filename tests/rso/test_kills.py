"""``kill -9`` of the parent or a worker at 20 random moments, also while a mesh is made: the results are the same."""

import os
import random
import signal
import subprocess
import time
from pathlib import Path

import pytest
import sample_studies as studies
import test_cli

from rso.cli import main

pytestmark = pytest.mark.verification
KILLS = 20  # at least so many; each with a start of Python


def write(folder: Path, **changes: str) -> None:
    settings = f"thickness = 8\nsleep_s = 0.1\nmake_s = 0.8\nlog = {str(folder / 'calls')!r}"
    use = 'use = "meshed_backend:BACKEND"'
    studies.write(folder, backend=use, backend__settings=settings, doe="runs = 20\nheld_out = 4\nreduce = false")


def children(pid: int) -> list[int]:
    """Living children of a process."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = stat.read_text().rsplit(")", 1)[1].split()[:2]
        except OSError:
            continue
        if int(parent) == pid and state != "Z":
            found.append(int(stat.parent.name))
    return found


def lines(folder: Path) -> list[str]:
    log = folder / "calls"
    return log.read_text().splitlines() if log.exists() else []


def started(folder: Path) -> subprocess.Popen:
    return subprocess.Popen(
        test_cli.command("run", folder, "--jobs", 2),
        env=test_cli.environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def comparable(folder: Path) -> dict:
    """Results without times and without the keys, which hold the path of the log."""
    found = studies.timeless(studies.read(folder))
    return test_cli._bare(found, ("backend", "provenance", "experiments"))


def test_twenty_deaths_change_nothing(tmp_path):
    rng = random.Random(20)
    reference, folder = tmp_path / "reference", tmp_path / "killed"
    for f in (reference, folder):
        write(f)
    assert main(["run", str(reference), "--jobs", "1"]) in (0, 4)
    deaths = {"parent": 0, "worker": 0, "while making": 0}
    end = time.monotonic() + 900
    while deaths["parent"] + deaths["worker"] < KILLS and time.monotonic() < end:
        had = len(lines(folder))
        process = started(folder)
        while process.poll() is None and len(lines(folder)) == had:
            time.sleep(0.005)  # not before it computes: start-up alone would take most of the moments
        for _ in range(rng.choice((1, 1, 2))):
            time.sleep(rng.uniform(0.0, 0.5))
            making = lines(folder)[-1:] == ["make"]
            workers = children(process.pid)
            who = "worker" if workers and rng.random() < 0.4 else "parent"
            if process.poll() is None:
                os.kill(rng.choice(workers) if who == "worker" else process.pid, signal.SIGKILL)
                deaths[who] += 1
                deaths["while making"] += making
        process.kill()
        assert b"Traceback" not in process.communicate()[1]
        if process.returncode == 0 or (folder / "results" / "results.json").exists():
            stage = studies.read(folder)["stage"]
            if stage == "validate":  # it came to its end: go on killing in a study of its own
                assert comparable(folder) == comparable(reference)
                folder = tmp_path / f"killed {sum(deaths.values())}"
                write(folder)
    assert deaths["parent"] >= 5 and deaths["worker"] >= 3 and deaths["while making"] >= 1, deaths
    assert main(["run", str(folder), "--jobs", "2"]) in (0, 4)
    assert comparable(folder) == comparable(reference)
    assert not list((folder / "results" / "objects").glob("tmp-*"))
