"""What lies in the results folder beside the store: results.json, runs.csv and posterior.csv."""

from __future__ import annotations

import csv
import io
import itertools
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rso.core import disk
from rso.core.plain_results import RUN_STAGES, written_cell
from rso.core.plain_results import plainly as plainly
from rso.core.plain_results import write_results as write_results
from rso.inference import Determination
from rso.study.errors import StudyError

POSTERIOR_FILE = "posterior.csv"
OWNER_FILE = "study"  # file of a results folder that says whose they are
STORE_FILE = "runs.sqlite"  # see rso.evaluation.store


def earlier(path: Path, begun: Mapping[str, Any]) -> dict[str, Any] | None:
    """Results that an earlier call left for the same study, data and backend as those that are `begun`; else None."""
    try:
        found = disk.read_json(path)
        same = all(found[k] == begun[k] for k in ("schema", "outputs"))
        same &= _as_stated(found["parameters"]) == _as_stated(begun["parameters"])
        same &= all(found["backend"][k] == begun["backend"][k] for k in ("name", "numerics"))
        same &= all(found["provenance"][k] == begun["provenance"][k] for k in ("rso", "study_sha256", "data_sha256"))
        return found if same and found["stage"] in RUN_STAGES and isinstance(found["timings"], dict) else None
    except (OSError, ValueError, LookupError, TypeError):  # there is none, or somebody wrote something else there
        return None


def finished_results(path: Path, schema: int) -> dict[str, Any]:
    """What lies in a file of results; FileNotFoundError where there is none, ValueError for what is damaged or of
    another version."""
    try:
        found = disk.read_json(path)
    except ValueError as error:
        raise ValueError(f"{path}: is damaged ({error}); run the study again") from error
    if not isinstance(found, dict) or found.get("schema") != schema:
        other = found.get("schema") if isinstance(found, dict) else None
        raise ValueError(f"{path}: has schema {other}, this version reads {schema}; run the study again")
    return found


def _as_stated(parameters: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Without the ranges that a search has widened."""
    return [{k: v for k, v in p.items() if k not in ("low", "high")} for p in parameters]


def claim(folder: Path, study: Path) -> None:
    """Note whose results a folder holds; StudyError where they are those of another study that still exists.

    The study file is noted as it is found from the folder, so that both may be moved together.
    """
    owner, mine = _owner(folder), _seen_from(folder, study)
    if owner and owner != mine and (folder / owner).exists():
        words = f"{folder} holds the results of another study, {os.path.normpath(folder / owner)}"
        raise StudyError([f"{study}: {words}: choose another --out; --store {folder} shares its simulations"])
    if owner != mine:
        folder.mkdir(parents=True, exist_ok=True)
        disk.replace(folder / OWNER_FILE, mine + "\n")


def may_be_moved(folder: Path, study: Path, inputs: Iterable[Path]) -> None:
    """StudyError unless a folder that is there holds results, those of this study, and none of its `inputs`."""
    owner = _owner(folder)
    others = owner and owner != _seen_from(folder, study) and (folder / owner).exists()
    inside = [f for f in (study, *inputs) if f.resolve().is_relative_to(folder.resolve())]
    if others:
        why = f"holds the results of another study, {os.path.normpath(folder / owner)}"
    elif inside:
        why = f"holds {inside[0]}, from which the study is read"
    elif not (owner or (folder / STORE_FILE).is_file()) and any(folder.iterdir()):
        why = f"is no folder of results: it has neither {STORE_FILE} nor the note {OWNER_FILE!r}"
    else:
        return
    raise StudyError(
        [f"{study}: --fresh moves no folder but that of this study's results: {folder} {why}: choose another --out"]
    )


def _owner(folder: Path) -> str:
    """The study file whose results a folder holds, as it is found from there; empty where nothing says so."""
    try:
        return disk.read_bytes(folder / OWNER_FILE, 10_000).decode("utf-8").strip()
    except (OSError, ValueError):
        return ""


def _seen_from(folder: Path, study: Path) -> str:
    return os.path.relpath(study.absolute(), folder)


def write_draws(path: Path, determination: Determination | None) -> None:
    """Draws of the posterior, one a row, one column a parameter in its unit; none where they are not to be trusted."""
    draws = None if determination is None else determination.draws
    if determination is None or draws is None or not draws.enough:
        path.unlink(missing_ok=True)  # those of an earlier state of the study
        return
    box = determination.misfit.model.box
    rows = (",".join(f"{v:.9g}" for v in row) for row in box.from_unit(draws.X))
    disk.replace(path, "\n".join([",".join(box.names), *rows]) + "\n")


def write_runs(path: Path, found: Mapping[str, Any], units: Mapping[str, str]) -> None:
    """All runs as a table: state, values with the units of their knobs, outputs; empty cells without an answer."""
    rows = [
        {k: r[k] for k in ("key", "purpose", "state", "cause", "reason", "wall_s", "cpu_s")}
        | {f"{n} [{units.get(n, '')}]": v for n, v in r["values"].items()}
        | r["outputs"]
        for r in found["runs"]
    ]
    table = [{written_cell(k): written_cell(v) for k, v in row.items()} for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(itertools.chain(*table))), lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: "" if v != v else v for k, v in row.items()} for row in table)
    disk.replace(path, text.getvalue())
