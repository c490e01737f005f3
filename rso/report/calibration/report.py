"""The report of a study: its results as a document, with its figures, as HTML and PDF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from rso.core import disk
from rso.report.calibration.figures import draw
from rso.report.calibration.numbers import report
from rso.report.language import PageOptions, own_words, write_page


def render(results: Mapping[str, Any], folder: Path, **options: Unpack[PageOptions]) -> list[Path]:
    """Write report.html and report.pdf into `folder` from the documented layout of results.json; list of files.

    The same results give the same bytes. A study that is not complete gives a report that says what is missing; a
    diagnosis that lies in the folder is shown, too.  In another `language` the files are report.de.html and
    report.de.pdf; sentences that have no template in it stay English and are added to `untranslated`.  ValueError for a
    language that there is none of.
    """
    results = with_files(results, folder)
    return write_page(report(results), lambda n: draw(results, n), folder, "report", own_words(results), options)


def with_files(results: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """The results with what other files of their folder add: a diagnosis, the deformed body, draws of the posterior."""
    return _with_draws(_with_body(_with_diagnosis(results, folder), folder), folder)


def _with_diagnosis(results: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """A run writes its results again, without what a diagnosis has put into them."""
    path = folder / "diagnosis.json"
    if results.get("diagnosis") or not path.exists():
        return results
    try:
        found = disk.read_json(path)["diagnosis"]
    except (OSError, ValueError, KeyError, TypeError):
        return results
    return {**results, "diagnosis": found}


def _with_body(results: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """With the deformed body that a run has left in the folder."""
    path = folder / "deformed.json"
    if results.get("deformed") or not path.exists():
        return results
    try:
        return {**results, "deformed": disk.read_json(path)}
    except (OSError, ValueError):
        return results


def _with_draws(results: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """With the draws of the posterior that a run has left in the folder, by parameter."""
    path = folder / "posterior.csv"
    if results.get("draws") or not path.exists():
        return results
    try:
        head, *rows = disk.read_bytes(path).decode("utf-8").splitlines()
        values = np.array([[float(v) for v in row.split(",")] for row in rows])
        return {**results, "draws": dict(zip(head.split(","), values.T, strict=True))}
    except (OSError, ValueError):
        return results
