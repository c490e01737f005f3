"""`rso status`: how far a study is, what it has found, where the report lies, and what to do next."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rso.cli import output
from rso.cli.answer import condensed, number_text, verdict_lines
from rso.core import disk
from rso.core.symbols import symbol, unit_text
from rso.core.units import people

MAX_LOST_RUN_LINES = 5  # runs without an answer
STATUS_PAGES = ("report", "diagnosis", "ladder", "next")


def report_status(options: argparse.Namespace, file: Path, folder: Path, store: Path) -> int:
    """Print the state of a study; always 0, for a study that has not been run is no error."""
    found = _results(folder)
    runs = _runs(found, store) if folder.exists() else []
    count = {state: sum(r["state"] == state for r in runs) for state in ("done", "failed", "crashed")}
    pages = [folder / f"{name}.html" for name in STATUS_PAGES if (folder / f"{name}.html").is_file()]
    then = _next(found, folder, options)
    if options.json:
        told = {"study": str(file), "results": str(folder), **condensed(found), "runs": count}
        print(json.dumps({**told, "pages": [str(p) for p in pages], "next": then}, indent=1, ensure_ascii=False))
        return 0
    if not folder.exists():
        output.say(f"{file}: not started ({folder} does not exist)")
    else:
        _told(found, file, runs, count, (folder / "results.json").is_file(), then)
    for page in pages:
        output.say(f"  page: {page}")
    output.say(f"  next: {then}")
    return 0


def _told(
    found: Mapping[str, Any],
    file: Path,
    runs: Sequence[Mapping[str, Any]],
    count: Mapping[str, int],
    broken: bool,
    then: str,
) -> None:
    """Print them; `broken`: there are results that cannot be read where none are `found`."""
    output.bold(str((found.get("study") or {}).get("title") or file))
    every = ", ".join(f"{state}: {n}" for state, n in count.items())
    if not found and broken:
        output.say(f"  results.json is damaged; {then} writes it again from the stored simulations")
    elif found.get("exit_code") is None:
        stage = found.get("stage")
        output.say(f"  not finished; {f'last finished stage: {stage}' if stage else 'no stage is finished'}")
    for mark, text in verdict_lines(found):
        output.marked_line(mark, text)
    if found.get("exit_code"):
        output.lines([f"  exit code {found['exit_code']}: {found.get('exit_reason')}"])
    output.say(f"  simulations, {every}")
    lost = [r for r in runs if r["state"] != "done"]
    units = {p["name"]: p.get("unit", "") for p in found.get("parameters") or ()}
    for run in lost[:MAX_LOST_RUN_LINES]:
        reason = next(iter(str(run.get("reason") or "").splitlines()), "no reason given")
        output.lines([f"  {run['state']} {run['key'][:12]} ({_values(run['values'], units)}): {reason}"])
    if len(lost) > MAX_LOST_RUN_LINES:
        output.say(f"  and {len(lost) - MAX_LOST_RUN_LINES} more without an answer: runs.csv has all of them")


def _values(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    """Values of the study's parameters in the units that people use; of all, where nobody knows which these are."""
    each = []
    for name, value in values.items():
        if not units or name in units:
            label, factor = people(units.get(name, ""), abs(value))
            each.append(f"{symbol(name)} = {number_text(value * factor, 3)} {unit_text(label)}".strip())
    return ", ".join(each)


def _results(folder: Path) -> Mapping[str, Any]:
    try:
        found = disk.read_json(folder / "results.json")
        return found if isinstance(found, dict) and "stage" in found else {}
    except (OSError, ValueError):
        return {}


def _runs(found: Mapping[str, Any], store: Path) -> list[Mapping[str, Any]]:
    """Every run that is stored, or in results that came without their store; StoreError where it is damaged."""
    if found.get("runs") and not (store / "runs.sqlite").exists():  # see rso.evaluation.store
        return list(found["runs"])
    from rso.evaluation.store import RunStore

    with RunStore(store, read_only=True) as known:
        return [{"key": r.key, "state": r.state, "values": dict(r.values), "reason": r.reason} for r in known.rows()]


def _next(found: Mapping[str, Any], folder: Path, options: argparse.Namespace) -> str:
    """The command that helps most now."""
    study = shlex.quote(str(options.study))
    if Path(options.study).absolute() == folder.absolute():  # results without their study
        return f"rso open {study}"
    where = f" --out {shlex.quote(str(options.out))}" if options.out else ""
    if not folder.exists():
        return f"rso check {study}, then rso run {study}{where}"
    if found.get("exit_code") is None:
        return f"rso run {study}{where}"
    marks = [mark for mark, _ in verdict_lines(found)]
    if "bad" in marks and not (folder / "diagnosis.json").is_file():
        return f"rso diagnose {study}{where}"
    if "open" in marks and not (folder / "next.json").is_file():
        return f"rso next {study}{where}"
    return f"rso open {study}{where}"
