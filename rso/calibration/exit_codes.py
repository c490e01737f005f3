"""How a study ends: its exit code and, where that is not 0, the reason in one sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rso.core.units import spaced

# Documented in docs/cli.md; of several that apply the first in the order of :func:`exit_code_of` counts.
EXIT_DONE, EXIT_FAILED_RUNS, EXIT_NOT_VERIFIED, EXIT_NOT_DETERMINED, EXIT_NOT_MET, EXIT_NOT_VALID = 0, 3, 4, 5, 6, 7

Results = Mapping[str, Any]


def exit_code_of(found: Results, require: Sequence[str], strict: bool) -> tuple[int, str | None]:
    """Exit code of finished results and its reason, the first that applies of 4, 6, 5, 7 (`strict`) and 3.

    4: a candidate's rerun does not agree with its prediction; 6: no candidate of a search meets its targets and
    constraints; 5: a parameter in `require` is not determined; 7: an experiment kept for the end is not predicted;
    3: runs failed.
    """
    tried = [
        (EXIT_NOT_VERIFIED, unverified(found)),
        (EXIT_NOT_MET, unmet(found)),
        (EXIT_NOT_DETERMINED, _undetermined(found, require)),
        (EXIT_NOT_VALID, _invalid(found) if strict else None),
        (EXIT_FAILED_RUNS, _failed(found)),
    ]
    return next(((code, reason) for code, reason in tried if reason), (EXIT_DONE, None))


def unverified(found: Results) -> str | None:
    """Why a search is not verified: by the first candidate that is not, the output, its difference and tolerance."""
    for search in found["searches"]:
        bad = [c for c in search["candidates"] if not c["verified"]]
        if search["verified"] or not bad:
            continue
        c, tolerance = bad[0], found["verify"]["tolerance"]
        count = f"{len(bad)} of {len(search['candidates'])} candidates of search {search['name']!r} not verified"
        if c["state"] != "done":
            key = next((r for r in found["runs"] if r["values"] == c["values"] and r["state"] != "done"), None)
            why = f": {key['reason']}" if key and key["reason"] else ""
            return f"{count}: the rerun of {c['name']} {c['state']}{why}"
        o = next((o for o in c["outputs"] if o["output"] == c["worst"]), None)
        if o is None:
            return f"{count}: {search['story']}"
        unit = spaced(next((u["unit"] for u in found["outputs"] if u["id"] == o["output"]), ""))
        return (
            f"{count}: of {c['name']} {o['output']} was predicted as {o['predicted']:.5g}{unit} and recomputed as "
            f"{o['recomputed']:.5g}{unit}, which differs by {100 * c['agreement']:.2g} %; verify.tolerance is "
            f"{100 * tolerance:.2g} %"
        )
    return None


def unmet(found: Results) -> str | None:
    """What the closest candidate misses in the first search of which none meets all targets and constraints."""
    for search in found["searches"]:
        if search["met"]:
            continue
        done = [c for c in search["candidates"] if c["state"] == "done"]
        near = found["closest"] or {}
        c = next((c for c in done if c["name"] == near.get("candidate")), done[0] if done else None)
        head = f"no candidate of search {search['name']!r} meets every target and constraint"
        return f"{head}: {shortfalls(c)}" if c else f"{head}: none of its reruns has an answer"
    return None


def shortfalls(candidate: Mapping[str, Any]) -> str:
    """'of main 1 Fz of top at 2 mm = 1 N is missed by +0.3 N (tolerance 0.01 N); …'."""
    return f"of {candidate['name']} {'; '.join(d['words'] for d in candidate['demands'] if not d['met'])}"


def _undetermined(found: Results, require: Sequence[str]) -> str | None:
    open_ones = [n for n in require if not found["determined"][n]["determined"]]
    if not open_ones:
        return None
    story = found["determined"][open_ones[0]]["story"].rstrip(".")
    return f"{' and '.join(open_ones)}, required by identify.require, not determined: {story}"


def _invalid(found: Results) -> str | None:
    """What is not predicted of the experiments kept for the end, or cannot be said to be."""
    kept = [e["name"] for e in found["experiments"] if e["role"] == "validate"]
    told = {v["experiment"]: v for v in found["predictions"]}
    for name in kept:
        v = told.get(name)
        if v is None or v["verdict"] is None:
            why = v["why"] if v else "nothing could be identified by which to predict it"
            return f"whether the validation {name!r} is predicted cannot be said: {why}"
        if v["verdict"] == "no":
            missed = [c["channel"] for c in v["channels"] if c["missed"]]
            by = f" ({', '.join(missed)} missed)" if missed else ""
            return f"the validation {name!r} is not predicted{by}: p = {v['p_value']:.2g}, at least 0.05 is needed"
    return None


def _failed(found: Results) -> str | None:
    """How many runs have no answer, and the first reason.

    Those beyond the ranges were made to find that out, those of before belong to another version of the study.
    """
    beyond = {("failed", "repair"), ("failed", "interval"), ("failed", "stored")}
    lost = {r["key"]: r for r in found["runs"] if r["state"] != "done" and (r["state"], r["purpose"]) not in beyond}
    if not lost:
        return None
    first = next(iter(lost.values()))
    states = [r["state"] for r in lost.values()]
    count = " and ".join(f"{states.count(s)} {s}" for s in ("failed", "crashed") if s in states)
    return f"{count} of {len({r['key'] for r in found['runs']})} simulations; the first: {first['reason']}"
