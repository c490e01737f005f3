"""specimens.json: each specimen by its own results, and each parameter over all of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

import rso
from rso.calibration.exit_codes import EXIT_DONE
from rso.calibration.plan import Plan
from rso.core import disk
from rso.core.distributions import chi2_cdf
from rso.core.plain_results import plainly, write_results, written_cell
from rso.core.symbols import symbol, unit_text
from rso.core.units import people
from rso.inference.intervals import CREDIBLE_LEVEL
from rso.inference.random_effects import (
    RandomEffects,
    SpecimenLikelihood,
    deleted_residuals,
    likelihood_of_profile,
    outliers,
    random_effects,
)
from rso.inference.rules import RULES
from rso.study.input_sizes import stated_size

SPECIMENS_SCHEMA = 1  # of specimens.json; raised when keys change their meaning
SPECIMENS_FILE = "specimens.json"
SPECIMENS_FOLDER = "specimens"  # below that of the results
EXIT_STOPPED = 3  # as that of failed runs: some specimens have no answer
SMALL_Q_CHANCE = 0.05  # probability of a Q as small: errors of the specimens are not their own
MIN_SPECIMENS_FOR_SCATTER = 5  # of fewer the scatter is hardly known
INTERVAL_END_NAMES = ("low", "high")

MAX_NAMED_IN_SENTENCE = 4  # specimens that a sentence names
SHARED_ERRORS_NOTE = (
    "Errors that all specimens share are in no interval of the mean, as that of one load cell or one indenter. More "
    "specimens do not average them out. The tables noise and [uncertainty] of the study state them"
)

Found = Mapping[str, Any]


def folder_of(folder: Path, specimen: str) -> Path:
    """Where the results of a specimen lie."""
    return folder / SPECIMENS_FOLDER / specimen


def population_summary(
    plans: Sequence[Plan],
    folder: Path,
    stopped: Mapping[str, str],
    own: Mapping[str, Mapping[str, str]],
    notes: Mapping[str, str],
    command: str,
) -> dict[str, Any]:
    """The whole of specimens.json, from what lies in the folders of the specimens.

    `stopped` are specimens without an answer and why, `own` what the study says of each alone.
    """
    study = plans[0].study
    found = {p.study.specimen: specimen_results(folder, p.study.specimen, p.study.sha256) for p in plans}
    rows = [_specimen(p, found[p.study.specimen], stopped, own, notes) for p in plans]
    _count_runs(rows, [found[r["name"]] for r in rows])
    names = list(dict.fromkeys(a.name for p in plans for a in p.resolved.axes))
    population = [_population(name, plans, found, rows) for name in names]
    states = [r["state"] for r in rows]
    counts = {"specimens": len(rows), **{s: states.count(s) for s in ("done", "stopped", "missing")}}
    counts["runs"] = len({run["key"] for f in found.values() if f for run in f["runs"]})
    code, reason = _ended(rows)
    return plainly(
        {
            "schema": SPECIMENS_SCHEMA,
            "study": {
                "title": study.study.title.removesuffix(f": {study.specimen}"),
                "file": study.file.name,
                "seed": study.study.seed,
                "units": study.study.units,
            },
            "level": CREDIBLE_LEVEL,
            "specimens": rows,
            "population": population,
            "words": [p["words"] for p in population],
            "warnings": _warnings(rows, population),
            "counts": counts,
            "exit_code": code,
            "exit_reason": reason,
            "provenance": {
                "rso": rso.__version__,
                "command": command,
                "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            },
        }
    )


def specimen_results(folder: Path, specimen: str, sha256: str) -> Found | None:
    """results.json of a specimen as far as it was written for the study of this hash; None where there is none."""
    try:
        found: Found = disk.read_json(folder_of(folder, specimen) / "results.json")
        return found if found["provenance"]["study_sha256"] == sha256 else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def is_finished(found: Found | None) -> bool:
    """Whether results are those of a whole run."""
    return found is not None and found.get("stage") == "validate" and found.get("exit_code") is not None


def write_summary(folder: Path, found: Found) -> list[Path]:
    """Write specimens.json, and as tables specimens.csv and population.csv; the files."""
    import pandas as pd  # 0.4 s, which `rso check` does without

    folder.mkdir(parents=True, exist_ok=True)
    write_results(folder / SPECIMENS_FILE, found)
    paths = [folder / SPECIMENS_FILE]
    for name, rows in (("specimens", wide_rows(found)), ("population", population_rows(found))):
        safe = [{written_cell(k): written_cell(v) for k, v in row.items()} for row in rows]
        table = pd.DataFrame(safe).to_csv(index=False, lineterminator="\n")
        paths.append(disk.replace(folder / f"{name}.csv", table))
    return paths


def wide_rows(found: Found) -> list[dict[str, Any]]:
    """A row for each specimen: state, what is its own, and of each parameter value, ends, verdict, outlier."""
    own = list(dict.fromkeys(k for s in found["specimens"] for k in s["own"]))
    rows = []
    for s in found["specimens"]:
        row: dict[str, Any] = {"specimen": s["name"], "state": s["state"], **{k: s["own"].get(k, "") for k in own}}
        for p in s["parameters"]:
            n, unit = p["parameter"], p["unit"]
            low, high = p["interval"]
            row |= {f"{n} [{unit}]": p["value"], f"{n} low": low, f"{n} high": high, f"{n} verdict": p["verdict"]}
            row |= {f"{n} bounded": p["bounded"], f"{n} outlier": p["outlier"]}
        rows.append(row | {"p_value": s["p_value"], "exit_code": s["exit_code"], "reason": s["reason"]})
    return rows


def population_rows(found: Found) -> list[dict[str, Any]]:
    """A row for each parameter over all specimens."""
    keys = ("parameter", "unit", "scale", "mean", "tau", "i2", "q", "q_p_value", "both_sides", "one_side")
    rows = []
    for p in found["population"]:
        ends = {
            f"{k} {e}": p[k][n]
            for k in ("interval", "tau_interval", "prediction")
            for n, e in enumerate(INTERVAL_END_NAMES)
        }
        rows.append({k: p[k] for k in keys} | ends | {"outliers": "; ".join(p["outliers"])})
    return rows


# ------------------------------------------------------------------------------------------------------ specimens


def _specimen(
    plan: Plan,
    found: Found | None,
    stopped: Mapping[str, str],
    own: Mapping[str, Mapping[str, str]],
    notes: Mapping[str, str],
) -> dict[str, Any]:
    name = plan.study.specimen
    known = (found or {}).get("identification")
    done = is_finished(found) and known is not None
    state = "done" if done else "stopped" if name in stopped or is_finished(found) else "missing"
    reason = stopped.get(name) or (found or {}).get("exit_reason") or ""
    if not reason and state == "stopped" and found:
        reason = next((w for w in found["warnings"] if w.startswith("identification")), "nothing was identified")
    return {
        "name": name,
        "folder": f"{SPECIMENS_FOLDER}/{name}",
        "state": state,
        "reason": reason,
        "exit_code": found.get("exit_code") if found else None,
        "note": notes.get(name, ""),
        "own": dict(own.get(name, {})),
        "runs": 0,
        "new_runs": 0,
        "p_value": known["p_value"] if done and known else None,
        "warnings": len(found["warnings"]) if found else 0,
        "parameters": _parameters(plan, known if done else None),
    }


def _parameters(plan: Plan, known: Found | None) -> list[dict[str, Any]]:
    rows = []
    units = {p.name: p.unit for p in plan.backend.parameters}
    blank = {"residual": None, "p_value": None, "outlier": False}
    for p in known["parameters"] if known else ():
        cut = set(p["bounds"])
        bounded = {0: "both", 2: "neither"}.get(len(cut)) or ("upper" if "lower" in cut else "lower")
        kept = {k: p[k] for k in ("parameter", "value", "interval", "verdict")}
        rows.append({**kept, "unit": units[p["parameter"]], "bounded": bounded, **blank})
    for name, value in plan.resolved.fixed.items():
        rows.append(
            {
                "parameter": name,
                "value": value,
                "interval": [None, None],
                "verdict": "fixed",
                "unit": units[name],
                "bounded": "both",
                **blank,
            }
        )
    return rows


def _count_runs(rows: Sequence[dict[str, Any]], found: Sequence[Found | None]) -> None:
    """Simulations of each specimen, and those that it was the first to have."""
    seen: set[str] = set()
    for row, one in zip(rows, found, strict=True):
        keys = {run["key"] for run in one["runs"]} if one else set()
        row["runs"], row["new_runs"] = len(keys), len(keys - seen)
        seen |= keys


# ------------------------------------------------------------------------------------------------------ population


def _population(
    name: str, plans: Sequence[Plan], found: Mapping[str, Found | None], rows: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """A parameter over all specimens; residuals and outliers are noted in the rows of the specimens."""
    axes = [a for p in plans for a in p.resolved.axes if a.name == name]
    log = all(a.low > 0 for a in axes)
    unit = axes[0].parameter.unit
    likelihoods: dict[str, SpecimenLikelihood] = {}
    left_out: list[str] = []
    alike, moves = errors_alike(plans), list[dict[SharedInput, float]]()
    for row in rows:
        one = found[row["name"]]
        block = next((p for p in _identified(one) if p["parameter"] == name), None) if row["state"] == "done" else None
        if block is None or one is None:
            continue
        made = _likelihood(block, log)
        if made is None:
            left_out.append(row["name"])
            continue
        moved, share = _moves_alike(one["identification"], name, alike, log)
        likelihoods[row["name"]] = made.without(share)
        if made.closed:
            moves.append(moved)
    # one error moves the mean by the mean of what it moves each specimen by, as far as that is known; several errors
    # are independent
    each = [[m[e] for m in moves if e in m] for e in alike]
    shared = math.hypot(*(float(np.mean(known)) for known in each if known))
    marked = _mark(name, likelihoods, rows)
    every = list(likelihoods.values())
    effects = random_effects(every, CREDIBLE_LEVEL, shared=shared) if any(s.closed for s in every) else None
    refuted = [r["name"] for r in rows if r["name"] in likelihoods and _is_refuted(r)]
    block = {
        "parameter": name,
        "unit": unit,
        "scale": "log" if log else "linear",
        **_numbers(effects, log),
        "shared": shared,
        "left_out": left_out,
        "outliers": marked,
        "without_outliers": _without(likelihoods, marked, log, shared)[0],
        "refuted": refuted,
        "without_doubtful": _without(likelihoods, {*marked, *refuted}, log, shared),
    }
    return {**block, "words": population_words(block)}


SharedInput = tuple[str, str]
"""Name of an uncertain input and the experiments that state it, as results have them."""
CALIBRATION: SharedInput = ("calibration", "")


def errors_alike(plans: Sequence[Plan]) -> tuple[SharedInput, ...]:
    """Stated errors that are the same in all specimens: the calibration, and inputs whose stated sizes and uncertainty
    are the same for all.

    A size that each specimen has for itself, such as its own thickness, was measured for each.
    """
    stated: dict[SharedInput, list[tuple[object, ...]]] = {}
    for p in plans:
        fitted = [e.name for e in p.study.experiments if e.name in p.case_of]
        for i in p.resolved.inputs:
            own = [e for e in fitted if not i.experiments or e in i.experiments]
            sizes = [stated_size(p.backend, p.study.settings_of(e), p.resolved.fixed, i) for e in own]
            stated.setdefault((i.parameter.name, ", ".join(i.experiments)), []).append((i.uncertainty, *sizes))
    return (CALIBRATION, *(k for k, each in stated.items() if len(each) == len(plans) and len(set(each)) == 1))


def _moves_alike(
    known: Found, name: str, alike: Sequence[SharedInput], log: bool
) -> tuple[dict[SharedInput, float], float]:
    """What each of these errors moves a parameter of one specimen by, and their share of its variance.

    Results of a program that did not keep it are without the calibration: nothing is known of it then.
    """
    blocks = {(r["input"], r["experiment"]): r for r in known.get("inputs") or ()}
    if "calibration" in known:
        blocks[CALIBRATION] = known["calibration"] or {"moves": {name: 0.0}, "share": {name: 0.0}}
    moves, share = {}, 0.0
    for e in alike:
        relative = blocks[e]["moves"].get(name) if e in blocks else None
        if relative is not None and relative > -1.0:
            moves[e] = math.log1p(relative) if log else relative * known["values"][name]
            share += blocks[e]["share"].get(name) or 0.0
    return moves, share


def _without(
    likelihoods: Mapping[str, SpecimenLikelihood], names: Collection[str], log: bool, shared: float
) -> tuple[float | None, float | None, float | None]:
    """Mean without these specimens and the ends of its interval; None where none of them counts or too few are left."""
    rest = [s for n, s in likelihoods.items() if n not in names]
    if not names or not any(s.closed for s in rest):
        return None, None, None
    effects = random_effects(rest, CREDIBLE_LEVEL, shared=shared)
    return _back(effects.mean, log), *_ends(effects.interval, log)


def _is_refuted(row: Found) -> bool:
    """Whether the model misses the data of a specimen by more than their errors."""
    return row["p_value"] is not None and row["p_value"] < RULES.refuted_fit_chance


def _identified(found: Found | None) -> Sequence[Found]:
    known = (found or {}).get("identification") or {}
    return known.get("parameters") or ()


def _likelihood(block: Found, log: bool) -> SpecimenLikelihood | None:
    """What a specimen says, by the profile that its results keep, of ln θ or θ."""
    at, rise = (np.array([np.nan if v is None else v for v in block["profile"][k]], float) for k in ("values", "rise"))
    good = np.isfinite(at) & np.isfinite(rise) & ((at > 0) | (not log))
    at, rise = at[good], rise[good]
    low, high = block["interval"]
    if len(at) < 3 or low is None or high is None:
        return None
    if log:
        at, low, high = np.log(at), math.log(low), math.log(high)
    order = np.argsort(at)
    bounds = "lower" in block["bounds"], "upper" in block["bounds"]
    return likelihood_of_profile(at[order], rise[order], (low, high), bounds, CREDIBLE_LEVEL)


def _mark(name: str, likelihoods: Mapping[str, SpecimenLikelihood], rows: Sequence[dict[str, Any]]) -> list[str]:
    """Residuals and outliers into the rows; names of the outliers."""
    residuals = deleted_residuals(list(likelihoods.values()))
    marked = []
    for n, r, out in zip(likelihoods, residuals, outliers(residuals), strict=True):
        row = next(row for row in rows if row["name"] == n)
        block = next(p for p in row["parameters"] if p["parameter"] == name)
        if r is not None:
            block.update(residual=r[0], p_value=r[1], outlier=out)
        marked += [n] if out else []
    return marked


def _numbers(e: RandomEffects | None, log: bool) -> dict[str, Any]:
    if e is None:
        keys = ("mean", "tau", "q", "q_p_value", "i2")
        none = dict.fromkeys(keys), {k: (None, None) for k in ("interval", "tau_interval", "prediction")}
        return {**none[0], **none[1], "both_sides": 0, "one_side": 0}
    return {
        "mean": _back(e.mean, log),
        "interval": _ends(e.interval, log),
        "tau": e.tau if e.used > 1 else None,
        "tau_interval": e.tau_interval or (None, None),
        "prediction": _ends(e.prediction, log),
        "q": e.q if e.used > 1 else None,
        "q_p_value": e.q_p_value,
        "i2": e.i2,
        "both_sides": e.used,
        "one_side": e.one_sided,
    }


def _back(x: float, log: bool) -> float:
    return math.exp(min(x, 700.0)) if log else x


def _ends(interval: tuple[float, float] | None, log: bool) -> tuple[float | None, float | None]:
    return (None, None) if interval is None else (_back(interval[0], log), _back(interval[1], log))


def population_words(p: Found) -> str:
    """What the specimens say together of a parameter."""
    letter, count = symbol(p["parameter"]), p["both_sides"]
    if p["mean"] is None:
        return f"Of {letter} no specimen gives both ends of an interval: nothing is said of their mean."
    label, factor = people(p["unit"], abs(p["mean"]))
    behind = f" {unit_text(label)}" if unit_text(label) else ""

    def number(x: float) -> str:
        return f"{x * factor:.3g}"

    what = "median" if p["scale"] == "log" else "mean"
    of = f"{count} specimen" + ("s" if count > 1 else "")
    if count < 2:
        return f"{letter} is known of one specimen alone, {number(p['mean'])}{behind}: its scatter is not known."
    low, high = p["interval"]
    said = f"The {what} {letter} of {of} is {number(p['mean'])}{behind} ({number(low)} to {number(high)}). "
    if p["shared"]:
        size = f"{100 * math.expm1(p['shared']):.2g} %" if p["scale"] == "log" else f"{number(p['shared'])}{behind}"
        said += f"Of that, stated errors that all specimens share make ±{size}, one standard deviation. "
    said += _scatter_words(p, number, behind)
    if p["prediction"][0] is not None:
        a, b = p["prediction"]
        said += f" The next specimen is expected between {number(a)} and {number(b)}{behind}."
    return said + _doubt_words(p, what, number, behind)


def _doubt_words(p: Found, what: str, number: Any, behind: str) -> str:
    """Which specimens that count may not belong to the others, and the mean without them."""
    outliers, refuted = p["outliers"], [n for n in p["refuted"] if n not in p["outliers"]]
    count = len(outliers) + len(refuted)
    if not count:
        return ""
    of, lie = ("Specimens", "lie") if len(outliers) > 1 else ("Specimen", "lies")
    said = f" {of} {_few(outliers)} {lie} far from the others." if outliers else ""
    said += f" The model misses the data of {_few(refuted)}." if refuted else ""
    mean, low, high = p["without_doubtful"]
    them = "them" if count > 1 else "it"
    if mean is None or low is None:
        return f"{said} Without {them} too few are left."
    return f"{said} Without {them} the {what} is {number(mean)}{behind} ({number(low)} to {number(high)})."


def _scatter_words(p: Found, number: Any, behind: str) -> str:
    """How much specimens differ, and whether more than their errors explain."""
    low, high = p["tau_interval"]

    def size(x: float) -> str:
        return f"{100 * math.expm1(min(x, 50.0)):.2g} %" if p["scale"] == "log" else f"{number(x)}{behind}"

    if not p["tau"] or low is None:  # none is as likely, or specimens agree better than their errors allow
        most = "" if high is None else f"; the data allow a scatter of up to {size(high)}"
        return f"Their differences are no larger than their errors{most}."
    sure = "" if p["q_p_value"] is None or p["q_p_value"] < 0.05 else "; errors alone might explain it"
    return f"Specimens scatter by {size(p['tau'])} ({size(low)} to {size(high)}){sure}."


def _warnings(rows: Sequence[Found], population: Sequence[Found]) -> list[str]:
    said = []
    stopped = [f"{r['name']}: {r['reason'] or 'no reason is known'}" for r in rows if r["state"] == "stopped"]
    said += [f"specimen {text}" for text in stopped]
    missing = [r["name"] for r in rows if r["state"] == "missing"]
    said += [f"not run yet: {_few(missing)}"] if missing else []
    for p in population:
        letter = symbol(p["parameter"])
        if p["left_out"]:
            said.append(f"{letter}: {_few(p['left_out'])} left out, for nothing bounds it there but the range searched")
        if p["one_side"]:
            ones = [r["name"] for r in rows for q in r["parameters"] if _one_side(q, p["parameter"])]
            said.append(f"{letter}: {_few(ones)} bounded on one side, which counts by the likelihood of that side")
        if p["outliers"]:
            said.append(f"{letter}: {_few(p['outliers'])} outlying (p < 0.05 over all specimens), not left out")
        if 1 < p["both_sides"] < MIN_SPECIMENS_FOR_SCATTER:
            said.append(f"{letter}: a scatter from {p['both_sides']} specimens is hardly known; see its interval")
        if p["q"] is not None and (p_low := float(chi2_cdf(p["q"], p["both_sides"] - 1))) < SMALL_Q_CHANCE:
            said.append(
                f"{letter}: specimens agree better than their errors allow (p = {p_low:.2g}): these are shared by all, "
                "or overstated. What is shared does not average out, and the interval of the mean is then too narrow"
            )
    refuted = [r["name"] for r in rows if _is_refuted(r)]
    if refuted:
        said.append(f"the model misses the data (p < 0.01) of {_few(refuted)}: what their parameters mean is open")
    lacking = any(p["mean"] is not None and not p["shared"] for p in population)
    return [*said, SHARED_ERRORS_NOTE] if lacking else said


def _one_side(block: Found, name: str) -> bool:
    return bool(block["parameter"] == name and block["bounded"] in ("lower", "upper"))


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - MAX_NAMED_IN_SENTENCE} more" if len(names) > MAX_NAMED_IN_SENTENCE else ""
    return f"{', '.join(names[:MAX_NAMED_IN_SENTENCE])}{more}"


def _ended(rows: Sequence[Found]) -> tuple[int, str | None]:
    lost = [r for r in rows if r["state"] == "stopped"]
    if lost:
        first = f"the first is {lost[0]['name']}: {lost[0]['reason']}"
        return EXIT_STOPPED, f"{len(lost)} of {len(rows)} specimens have no answer; {first}"
    codes = [r for r in rows if r["exit_code"]]
    if codes:
        worst = codes[0]
        return int(worst["exit_code"]), f"specimen {worst['name']}: {worst['reason']}" + (
            f" ({len(codes)} specimens end so)" if len(codes) > 1 else ""
        )
    return EXIT_DONE, None
