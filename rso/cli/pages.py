"""`rso open` and `rso plot`: the pages of a study in a browser, one figure as a file."""

from __future__ import annotations

import argparse
import shlex
import webbrowser
from pathlib import Path
from typing import Any

from rso.cli import output
from rso.study.errors import choices_text

OPENED_PAGES = ("report", "specimens", "diagnosis", "ladder", "next")


def open_page(options: argparse.Namespace, folder: Path) -> int:
    """Show a page of a study in the browser; 2 where it has not been written."""
    there = [name for name in OPENED_PAGES if (folder / f"{name}.html").is_file()]
    name = options.page or next(iter(there), "report")
    path = folder / f"{name}.html"
    if not path.is_file():
        command = {"report": "run", "specimens": "run", "diagnosis": "diagnose"}.get(name, name)
        output.complain(f"{path}: is not there; write it first: rso {command} {shlex.quote(str(options.study))}")
        return 2
    output.say(path)
    if not webbrowser.open(path.resolve().as_uri()):
        output.say("  no browser was found: open this file in one")
    return 0


def _before_a_run(path: Path) -> dict[str, Any]:
    """What a study shows of itself before its first run: the sketches of its experiments."""
    from rso.calibration.plan import make_plan
    from rso.study.cases import sketches
    from rso.study.loader import load_study

    plan = make_plan(load_study(path))
    return {"sketches": sketches(plan.study, plan.backend)}


def plot(options: argparse.Namespace, folder: Path) -> int:
    """Write a figure of the report as SVG, PDF or PNG; without a name list them; 2 for what is not there.

    What is modelled is drawn of a study that has not run, too.
    """
    from rso.calibration.result_files import finished_results
    from rso.calibration.results import RUN_SCHEMA
    from rso.report.picture_files import captions, written

    try:
        found: dict[str, Any] | None = finished_results(folder / "results.json", RUN_SCHEMA)
    except OSError:
        found = _before_a_run(options.study) if options.figure == "sketch" else None
    except ValueError as error:  # damaged, or of another version
        output.complain(error)
        return 2
    if found is None:
        again = shlex.quote(str(options.study))
        output.complain(f"{folder}: has no results; run the study first: rso run {again}")
        return 2
    known = captions(found)
    if options.figure is None:
        output.say("figures; rso plot STUDY FIGURE writes one:")
        output.lines([f"  {name}: {text}" for name, text in known.items()])
        return 0
    if options.figure not in known:
        output.complain(f"figure {options.figure!r} is unknown; {choices_text(options.figure, known)}")
        return 2
    try:
        output.say(written(found, options.figure, options.to or Path(f"{options.figure}.svg")))
    except ValueError as error:
        output.complain(error)
        return 2
    return 0
