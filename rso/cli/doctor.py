"""`rso doctor`: whether this machine can run studies, and how fast a simulation is here."""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import json
import os
import platform
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import rso
from rso.cli import output
from rso.cli.output import Mark

EXAMINED_LIBRARIES = ("numpy", "scipy", "numba", "scikit-fem", "scikit-learn", "pandas", "pymoo", "matplotlib")
MIN_DISK_BYTES, MIN_MEMORY_BYTES = 1e9, 2e9  # bytes: results of a study with its meshes; a simulation on a usual mesh


def doctor(options: argparse.Namespace) -> int:
    """Print what was found; 1 where something that every study needs does not work."""
    found: list[tuple[Mark, str]] = []
    for mark, text in examined(not options.fast):
        found.append((mark, text))
        if not options.json:
            output.marked_line(mark, text)
    if options.json:
        print(json.dumps([{"state": mark, "text": text} for mark, text in found], indent=1, ensure_ascii=False))
    return 1 if any(mark == "bad" for mark, _ in found) else 0


def examined(simulate: bool) -> Iterator[tuple[Mark, str]]:
    """A mark and a line for each thing that was looked at."""
    yield "good", f"rso {rso.__version__} in {Path(rso.__file__).parent}"
    yield (
        "good" if sys.version_info >= (3, 11) else "bad",
        f"Python {platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores",
    )
    for name in EXAMINED_LIBRARIES:
        try:
            yield "good", f"{name} {importlib.metadata.version(name)}"
        except importlib.metadata.PackageNotFoundError:
            yield "bad", f"{name} is not installed: pip install {name}"
    fast = importlib.util.find_spec("pypardiso") is not None
    yield (
        ("good", "fast solver (MKL Pardiso) is installed")
        if fast
        else ("open", "no fast solver: simulations in three dimensions take longer; pip install 'rso[fast]'")
    )
    pdf = importlib.util.find_spec("typst") is not None
    yield ("good", "PDF reports can be written") if pdf else ("open", "no PDF reports: pip install 'rso[pdf]'")
    yield from _room()
    if simulate:
        yield _simulation()


def _room() -> Iterator[tuple[Mark, str]]:
    free = shutil.disk_usage(".").free
    yield "good" if free > MIN_DISK_BYTES else "open", f"{free / 1e9:.1f} GB free on the disk of this folder"
    if not os.access(".", os.W_OK):
        yield "bad", f"{Path.cwd()} is not writable: results go beside a study, or to --out FOLDER"
    if hasattr(os, "sysconf"):
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        yield "good" if memory > MIN_MEMORY_BYTES else "open", f"{memory / 1e9:.1f} GB of memory"


def _simulation() -> tuple[Mark, str]:
    """One simulation of the first worked study, with its time."""
    from rso.calibration.plan import make_plan
    from rso.cli.example import examples
    from rso.study.loader import load_study

    try:
        import numpy as np

        name, folder = next(iter(examples().items()))
        plan = make_plan(load_study(folder))
        values = plan.values(np.full(plan.box.d, 0.5))
        plan.backend(values, plan.cases[0])  # compiles what was not compiled before
        begun = time.perf_counter()
        plan.backend(values, plan.cases[0])
        return "good", f"a simulation of the example {name} takes {time.perf_counter() - begun:.2g} s"
    except Exception as error:  # whatever it is, the machine cannot simulate: that is what was asked
        return "bad", f"a simulation fails here: {type(error).__name__}: {error}"
