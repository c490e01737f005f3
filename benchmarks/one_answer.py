"""The same study by `run`, `ladder`, `next` and `diagnose`: intervals, noise and p side by side.

    python benchmarks/one_answer.py STUDY.toml [LEVEL]

The four commands must have been run before (their JSON files lie in the folder of results); LEVEL is the level of the
ladder whose model is the study's own, by default `neo_hooke`.  Of `diagnose` it is the base model.  Printed are the
largest differences of the ends of each interval from those of `run`, over the width of that of `run`.
"""

import json
import math
import sys
from pathlib import Path

WAYS = ("run", "ladder", "next", "diagnose")


def of_run(folder: Path) -> dict:
    """Interval of each parameter, χ², p, and the errors of each curve by part, as `rso run` has them."""
    known = json.loads((folder / "results.json").read_text("utf-8"))["identification"]
    return {
        "intervals": {p["parameter"]: p["interval"] for p in known["parameters"]},
        "sd": {p["parameter"]: p["sd_log"] for p in known["parameters"]},
        "chi2": known["chi2"],
        "p": known["p_value"],
        "errors": {d["experiment"]: d.get("errors") for d in known["data"]},
    }


def of_ladder(folder: Path, name: str) -> dict:
    """The same of a level of `rso ladder`; its p is that of χ² by its distribution, not by simulated data sets."""
    level = next(v for v in json.loads((folder / "ladder.json").read_text("utf-8"))["levels"] if v["name"] == name)
    return {
        "intervals": {p["parameter"]: p["interval"] for p in level["parameters"]},
        "sd": {p["parameter"]: p.get("sd_log") for p in level["parameters"]},
        "chi2": level["fitted"]["chi2"],
        "p": level["fitted"]["p_analytic"],
        "errors": {d["curve"]: d.get("parts") for d in level["errors"]},
    }


def of_next(folder: Path) -> dict:
    """The same of all experiments together in `rso next`."""
    every = json.loads((folder / "next.json").read_text("utf-8"))
    fit = every["fits"][-1]
    return {
        "intervals": {p["name"]: p["interval"] for p in fit["parameters"]},
        "sd": {p["name"]: p["sd_log"] for p in fit["parameters"]},
        "chi2": fit["chi2"],
        "p": fit["p_value"],
        "errors": fit.get("errors") or {},
    }


def of_diagnosis(folder: Path) -> dict:
    """The same of the base model of `rso diagnose`, by the errors that all analyses share."""
    base = json.loads((folder / "diagnosis.json").read_text("utf-8")).get("base_model") or {}
    return {
        "intervals": {k: v["interval"] for k, v in (base.get("parameters") or {}).items()},
        "sd": {k: v["sd_log"] for k, v in (base.get("parameters") or {}).items()},
        "chi2": base.get("chi2"),
        "p": base.get("p_value"),
        "errors": base.get("errors") or {},
    }


def table(found: dict[str, dict]) -> list[str]:
    """Rows of the table in Markdown, one a way."""
    names = list(found["run"]["intervals"])
    rows = ["| | " + " | ".join(f"{n} low | {n} high | {n} sd ln" for n in names) + " | χ² | p |"]
    rows.append("|---|" + "---|" * (3 * len(names) + 2))
    for way, v in found.items():
        cells = [way]
        for n in names:
            ends = v["intervals"].get(n, (math.nan, math.nan))
            sd = v["sd"].get(n)
            cells += [f"{e:.5g}" for e in ends] + ["" if sd is None else f"{sd:.3g}"]
        cells += ["" if v[k] is None else f"{v[k]:.4g}" for k in ("chi2", "p")]
        rows.append("| " + " | ".join(cells) + " |")
    return rows


def apart(found: dict[str, dict]) -> list[str]:
    """By how much the ends of each interval differ from those of `rso run`, in ln and over the width there."""
    rows = []
    for way in WAYS[1:]:
        for n, (low, high) in found["run"]["intervals"].items():
            if n in found[way]["intervals"]:
                a, b = found[way]["intervals"][n]
                width = math.log(high / low)
                off = [100 * math.log(x / y) / width for x, y in ((a, low), (b, high))]
                rows.append(f"{way}: {n} {off[0]:+.1f} %, {off[1]:+.1f} % of the width")
    return rows


if __name__ == "__main__":
    study, level = Path(sys.argv[1]), (sys.argv[2] if len(sys.argv) > 2 else "neo_hooke")
    folder = study.parent / "results"
    found = {
        "run": of_run(folder),
        "ladder": of_ladder(folder, level),
        "next": of_next(folder),
        "diagnose": of_diagnosis(folder),
    }
    print("\n".join(table(found)))
    print("\n".join(apart(found)))
    for way, v in found.items():
        for curve, parts in v["errors"].items():
            if parts:
                print(f"{way}: {curve}: " + ", ".join(f"{k} {100 * s:.3g} %" for k, s in parts.items()))
