"""`ladder.json`: a selection as plain data (layout in docs/results.md)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import rso
from rso import model_selection
from rso.calibration import result_files
from rso.calibration.plan import Plan
from rso.calibration.predictive_check import Channel, PredictiveCheck
from rso.calibration.readings import curve_label
from rso.calibration.results import data_hashes
from rso.calibration.stated_settings import exact_dimensions
from rso.core.digits import significant
from rso.inference.error_model import shares
from rso.inference.predictive_test import chi2_limit
from rso.inference.verdict import physical
from rso.model_selection import CurveError, Goodness, GoodnessOfFit, Judged
from rso.model_selection.study_ladder import FittedLevel, LadderFit
from rso.study.cases import sketches

LADDER_FILE, LADDER_SCHEMA = "ladder.json", 2  # raised when keys of the file change their meaning
LENIENT_ERRORS_P = 0.999  # of perfect models leave more than this: the stated errors are larger than the data show


def ladder_data(plan: Plan, found: LadderFit, command: str) -> dict[str, Any]:
    """Everything that the page shows and the decision rests on, as strict JSON data."""
    climb, table = found.climb, plan.study.ladder
    rung_of = {v.name: n for n, rung in enumerate(found.rungs) for v in rung}
    title_of = {v.name: v.label for rung in found.rungs for v in rung}
    alarm = f"{100 * (1 - table.confidence):.3g}"
    return result_files.plainly(
        {
            "schema": LADDER_SCHEMA,
            "study": {
                "title": plan.study.study.title,
                "file": plan.study.file.name,
                "seed": plan.seed,
                "units": plan.study.study.units,
            },
            "sketches": sketches(plan.study, plan.backend),
            "rule": model_selection.SELECTION_RULE.format(alarm=alarm),
            "confidence": table.confidence,
            "draws": table.draws,
            "chosen": climb.chosen,
            "adequate": climb.adequate,
            "rivals": list(climb.rivals),
            "words": climb.words,
            "warnings": ladder_warnings(plan, found),
            "stated_inputs": [i.name for i in plan.resolved.inputs],
            "exact_inputs": exact_dimensions(plan),
            "start": _start(plan, found),
            "steps": [
                {"level": s.name, "title": title_of[s.name], "rung": s.rung, "verdict": s.verdict, "words": s.words}
                for s in climb.steps
            ],
            "levels": [_level(plan, found, j, rung_of[j.level.name]) for j in climb.judged],
            "counts": {"runs": len(found.cost)},
            "timings": {"wall": found.seconds, "fe_cpu": sum(found.cost.values())},
            "provenance": {
                "rso": rso.__version__,
                "backend": plan.backend.name,
                "numerics": plan.backend.numerics,
                "command": command,
                "finished": datetime.now(UTC).isoformat(timespec="seconds"),
                "data_sha256": data_hashes(plan.study),
            },
        }
    )


def ladder_warnings(plan: Plan, found: LadderFit) -> list[str]:
    """What a reader must know before believing the decision."""
    climb = found.climb
    said: list[str] = []
    if climb.chosen is None:
        return said
    j = climb.of(climb.chosen)
    assert j.goodness is not None
    t = j.goodness.checks[0]
    if t.p_value > LENIENT_ERRORS_P * (1 - 1 / (plan.study.ladder.draws + 1)):
        said.append(
            f"the fitted curves leave χ² = {significant(t.chi2, 3)}, a perfect model "
            f"{significant(t.expected, 3)} on average. The stated "
            "errors are larger than the curves show, so the ladder may stop too early"
        )
    for check in found.validation.get(climb.chosen, ()):
        if check.test is None:
            said.append(f"validation: whether {j.level.label} predicts {check.experiment} is open: {check.why}")
        for row in _validated(plan, check):
            if row["verdict"] is not None and not row["verdict"]["passes"]:
                said.append(
                    f"validation: {j.level.label} misses {row['curve']} (χ² = {significant(row['chi2'], 3)} "
                    f"for {row['points']} readings, NRMSE {100 * row['nrmse']:.3g} %), which it was not fitted to. "
                    "With count_validation in [ladder] that curve counts in the decision"
                )
    failing = {s.name for s in climb.steps if s.verdict == "fails"}
    told = ((v, g) for v in climb.judged if v.level.name in failing and (g := v.if_remembering) and g.passes)
    for v, goodness in itertools.islice(told, 1):
        said.append(
            f"{v.level.label} is rejected because its residuals are autocorrelated. If the noise itself is "
            f"autocorrelated (an amplifier's filter), it is good enough (p = {goodness.p_value:.2g}) and a richer "
            "model fits noise. Repeats, or noise.correlation, would decide"
        )
    bad = [v.level.name for v in climb.judged if v.detail and not v.detail.settled]
    said += [f"{v.level.name}: {text}" for v in climb.judged if v.detail for text in v.detail.lost]
    said += [f"{n}: the recomputed most likely curve is not yet its prediction" for n in bad]
    return said


def _start(plan: Plan, found: LadderFit) -> dict[str, Any] | None:
    if found.start is None:
        return None
    units = {p.name: p.unit for p in plan.backend.parameters}
    own = {a.name: (a.low, a.high) for a in plan.resolved.axes}
    rows = [
        {
            "parameter": k,
            "unit": units[k],
            "low": low,
            "value": value,
            "high": high,
            "study": list(own[k]) if k in own else None,
        }
        for k, (low, value, high) in found.start.items()
    ]
    return {"used": plan.study.ladder.ranges == "start", "parameters": rows}


def _level(plan: Plan, found: LadderFit, j: Judged, rung: int) -> dict[str, Any]:
    head = {
        "name": j.level.name,
        "title": j.level.label,
        "rung": rung,
        "description": j.level.description,
        "onto": j.onto,
        "settings": dict(j.level.settings),
        "closed_form": j.level.closed_form,
        "problem": j.problem or None,
    }
    if j.problem:
        return head
    d: FittedLevel = j.detail
    best = d.determination
    own = {a.name for a in j.added}
    rows = []
    for k, known in enumerate(best.known):
        low, high = physical(d.axes.box, k, known.profile_interval)
        rows.append(
            {
                "name": known.name,
                "parameter": d.axes.knob[known.name],
                "unit": d.axes.box.units[k],
                "range": [d.axes.box.low[k], d.axes.box.high[k]],
                "value": known.value,
                "interval": [low, high],
                "verdict": known.verdict.word,
                "added": known.name in own,
                "sd_log": known.sd_log,
                "story": known.story,
                "reason": known.reason,
            }
        )
    g, elsewhere = j.goodness, found.validation.get(j.level.name, ())
    assert g is not None
    errors = [_error(e) | {"parts": shares(data)} for e, data in zip(g.errors, d.data, strict=True)]
    return head | {
        "parameters": rows,
        "values": d.axes.physical(d.values),
        "verdict": _verdict(g),
        "fitted": _test(g.checks[0]) | {"p_analytic": d.determination.p_value},
        "selected": _test(g.checks[1]) if len(g.checks) > 1 else None,
        "validated": [row for v in elsewhere for row in _validated(plan, v)],
        "errors": errors,
        "log_evidence": j.log_evidence,
        "agreement": d.agreement,
        "similarity": d.axes.group.why,
        "runs": d.runs,
        "cpu_s": d.cpu_s,
        "curves": [
            {
                "name": v.name,
                "experiment": p.experiment,
                "channel": p.channel,
                "role": role,
                "unit": v.unit,
                "depth": v.depth,
                **({} if p.since is None else {"since": p.since}),
                "measured": v.value,
                "sigma": v.sigma,
                "predicted": f,
                "numerical_error": e,
            }
            for v, p, role, f, e in zip(d.data, d.places, d.roles, d.predicted, d.errors, strict=True)
        ],
    }


def _validated(plan: Plan, v: PredictiveCheck) -> list[dict[str, Any]]:
    """A row for each curve of an experiment that took no part."""
    if v.test is None:
        every = plan.study.experiment(v.experiment).compared
        return [{"curve": curve_label(plan, v.experiment, c), "verdict": None, "why": v.why} for c in every]
    return [_curve(plan, v.experiment, c) for c in v.channels]


def _curve(plan: Plan, experiment: str, c: Channel) -> dict[str, Any]:
    confidence, t = plan.study.ladder.confidence, c.test
    assert t is not None  # the experiment has one
    return {
        "curve": curve_label(plan, experiment, c.kept.channel),
        "chi2": t.chi2,
        "expected": float(t.points),
        "limit": chi2_limit(t.points, confidence, t.freedom),
        "p_value": t.p_value,
        "points": t.points,
        "nrmse": c.metrics.nrmse,
        "verdict": {"passes": t.p_value >= 1.0 - confidence, "p_value": t.p_value, "share": 1.0 - confidence},
        "why": None,
    }


def _verdict(g: Goodness) -> dict[str, Any]:
    return {"passes": g.passes, "p_value": g.p_value, "share": g.share}


def _error(e: CurveError) -> dict[str, Any]:
    return {"curve": e.name, "role": e.role, "nrmse": e.nrmse, "threshold": e.limit, "p_value": e.p_value}


def _test(t: GoodnessOfFit) -> dict[str, Any]:
    return {"chi2": t.chi2, "expected": t.expected, "limit": t.limit, "p_value": t.p_value, "points": t.points}


def write_ladder(folder: Path, found: Mapping[str, Any]) -> Path:
    """Write ladder.json at once or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LADDER_FILE
    result_files.write_results(path, found)
    return path
