"""`rso compare A B`: two runs side by side, and what differs between the studies behind them."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rso.cli import output
from rso.cli.answer import condensed, estimate_text, interval_in_unit
from rso.core.symbols import symbol


def compare(options: argparse.Namespace) -> int:
    """Print both answers and whether their intervals overlap; 2 where one has no results."""
    from rso.calibration.result_files import finished_results
    from rso.calibration.results import RUN_SCHEMA

    found = []
    for place in (options.first, options.second):
        try:
            found.append(finished_results(results_of(place), RUN_SCHEMA))
        except OSError:
            output.complain(f"{place}: has no results; run it first: rso run {place}")
            return 2
        except ValueError as error:  # damaged, or of another version
            output.complain(str(error))
            return 2
    one, other = map(condensed, found)
    unlike = study_differences(*found)
    if options.json:
        apart = [name for name, a, b in _rows(one, other) if _apart(a, b)]
        told = {"first": one, "second": other, "disjoint": apart, "differences": unlike}
        print(json.dumps(told, indent=1, ensure_ascii=False))
        return 0
    output.say(f"A: {one['title']} ({options.first})")
    output.say(f"B: {other['title']} ({options.second})")
    print()
    for name, a, b in _rows(one, other):
        text = f"{symbol(name)}: A {_told(a)}; B {_told(b)}"
        if a and b and a.get("verdict") == b.get("verdict") == "fixed":
            same = a["value"] == b["value"]
            output.marked_line("good" if same else "open", f"{text}: {'the same' if same else 'not the same'}")
        elif a is None or b is None or not (a["interval"] and b["interval"]):
            output.marked_line("open", f"{text}: one of them has no interval")
        elif _apart(a, b):
            output.marked_line("bad", f"{text}: the intervals do not overlap")
        elif not (_determined(a) and _determined(b)):
            output.marked_line("open", f"{text}: they overlap")
        else:
            output.marked_line("good", f"{text}: the intervals overlap")
    print()
    output.say("What differs:" if unlike else "Data, settings, ranges and method are the same.")
    output.lines([f"  {text}" for text in unlike])
    return 0


def results_of(place: Path) -> Path:
    """results.json of a study file, of its folder, or of a folder of results."""
    if place.is_file():
        return place if place.suffix == ".json" else place.parent / "results" / "results.json"
    inside = place / "results.json"
    return inside if inside.is_file() else place / "results" / "results.json"


def study_differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Data, roles, settings, readings, ranges and method that are not the same, a sentence each.

    Where none of these differs and the study files do, that is said: not all of a study is in its results.
    """
    said = [*_unlike_programs(one, other)]
    data = [_hashes(r) for r in (one, other)]
    if data[0] != data[1]:
        both = len(set(data[0]) & set(data[1]))
        said.append(f"data: {len(data[0])} and {len(data[1])} files, {both} of them the same")
    fitted = [sorted(e["name"] for e in r.get("experiments") or () if e.get("role") == "fit") for r in (one, other)]
    if fitted[0] != fitted[1]:
        said.append(f"fitted experiments: {', '.join(fitted[0])}; {', '.join(fitted[1])}")
    said += [*_unlike_settings(one, other), *_unlike_readings(one, other, data[0] == data[1])]
    method = ["Gauss–Newton" if r.get("descent") else "response surfaces" for r in (one, other)]
    if method[0] != method[1]:
        said.append(f"method: {method[0]}; {method[1]}")
    ranges = [{p["name"]: p for p in r.get("parameters") or ()} for r in (one, other)]
    for name in sorted(set(ranges[0]) | set(ranges[1])):
        each = [_range(r.get(name)) for r in ranges]
        if each[0] != each[1]:
            said.append(f"{symbol(name)}: {each[0]}; {each[1]}")
    hashes = [(r.get("provenance") or {}).get("study_sha256") for r in (one, other)]
    if not said and hashes[0] != hashes[1]:
        said.append("the study files, in a key that results do not hold: see the files")
    return said


def _unlike_programs(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    """Other models, or versions of the program."""
    models = [r.get("backend") or {} for r in (one, other)]
    each = [f"{b.get('name')} (numerics {b.get('numerics')})" for b in models]
    if each[0] != each[1]:
        yield f"model: {each[0]}; {each[1]}"
    versions = [(r.get("provenance") or {}).get("rso") for r in (one, other)]
    if versions[0] != versions[1]:
        yield f"version of rso: {versions[0]}; {versions[1]}"


def _unlike_settings(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Settings of experiments of one name, once where several differ alike."""
    said: dict[str, list[str]] = {}
    pairs = _common_experiments(one, other)
    for name, *both in pairs:
        a, b = (dict(_leaves(e.get("settings") or {})) for e in both)
        for key in sorted({*a, *b}):
            if a.get(key) != b.get(key):
                each = [json.dumps(v[key], ensure_ascii=False) if key in v else "not stated" for v in (a, b)]
                said.setdefault(f"settings.{key}: {each[0]}; {each[1]}", []).append(name)
    return [words if len(names) == len(pairs) else f"{', '.join(names)}: {words}" for words, names in said.items()]


def _unlike_readings(one: Mapping[str, Any], other: Mapping[str, Any], same_files: bool) -> Iterator[str]:
    """Where the same files are read in another way, or their errors are taken to be others."""
    for name, *both in _common_experiments(one, other):
        a, b = (e.get("measured") or {} for e in both)
        if same_files and any(a.get(k) != b.get(k) for k in ("depth", "value")):
            yield f"{name}: the readings, though the files are the same"
        elif same_files and a.get("sigma") != b.get("sigma"):
            yield f"{name}: the errors of the readings"


def _common_experiments(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    own, its = ({e["name"]: e for e in r.get("experiments") or ()} for r in (one, other))
    return [(name, own[name], its[name]) for name in own if name in its]


def _leaves(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Values within tables by their keys with dots."""
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _range(p: Mapping[str, Any] | None) -> str:
    if p is None:
        return "absent"
    if p.get("fixed") is not None:
        return f"fixed at {estimate_text(p['fixed'], (p['fixed'],) * 2, p['unit'])}"
    return f"searched from {interval_in_unit((p['low'], p['high']), p['unit'])}"


def _hashes(found: Mapping[str, Any]) -> list[str]:
    return sorted(((found.get("provenance") or {}).get("data_sha256") or {}).values())


def _rows(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    # What follows from a fixed value is compared by that value.
    derived = [{n: q for n, q in r["derived"].items() if not q.get("follows_from")} for r in (one, other)]
    every = [{**r["parameters"], **d} for r, d in zip((one, other), derived, strict=True)]
    names = dict.fromkeys([*every[0], *every[1]])
    return [(n, every[0].get(n), every[1].get(n)) for n in names]


def _determined(row: Mapping[str, Any]) -> bool:
    return bool(row.get("verdict") == "determined" or row.get("known"))


def _told(row: Mapping[str, Any] | None) -> str:
    if row is None or row["value"] is None:
        return "–"
    if not row["interval"]:
        return f"{estimate_text(row['value'], (row['value'],) * 2, row['unit'])} ({row.get('verdict', 'no interval')})"
    interval = interval_in_unit(row["interval"], row["unit"])
    if _determined(row):
        return f"{estimate_text(row['value'], row['interval'], row['unit'])} ({interval})"
    return f"{interval}, not determined"


def _apart(a: Mapping[str, Any] | None, b: Mapping[str, Any] | None) -> bool:
    if a is None or b is None or not (a["interval"] and b["interval"]):
        return False
    return bool(max(a["interval"][0], b["interval"][0]) > min(a["interval"][1], b["interval"][1]))
