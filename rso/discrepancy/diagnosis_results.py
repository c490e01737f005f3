"""A diagnosis as plain data: the documented block of results.json, and what figures and tables need beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from rso.discrepancy.diagnosis import Cause, Diagnosis
from rso.discrepancy.evidence.detectable import Detectable
from rso.discrepancy.evidence.gaussian_mixture import Posterior
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.marginal_ranges import calibrated_deviation
from rso.discrepancy.evidence.residual_test import ResidualScore
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS
from rso.discrepancy.evidence.shrinkage import predicted
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.simulations import Base
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import HELD_BRANCH, LOADING_BRANCH, Test, TestPlan
from rso.discrepancy.next_test import NextTest, next_tests
from rso.discrepancy.rerun import RerunCheck
from rso.discrepancy.wording import diagnosis_sentences
from rso.evaluation import Task

DIAGNOSIS_SCHEMA = 1  # of diagnosis.json; raised when keys change their meaning
MAX_LISTED_REGIONS = 8  # of the data, those off by most: a reader looks at no more
# root of the sum of squares over the noise of a force that has a sign; times it
MIN_SIGNED_FORCE_TO_NOISE, MAX_MIRRORED_PROJECTION = 20.0, -0.5
N_LEADING_HYPOTHESES = 4  # hypotheses of one effect whose signatures are told
Run = Callable[[Sequence[Task]], list[Any]]


def diagnosis_data(
    library: Library,
    d: Diagnosis,
    visible: Sequence[Detectable],
    run: Run | None,
    title: str,
    checked: Sequence[RerunCheck] = (),
) -> dict[str, Any]:
    """Everything of a diagnosis: `diagnosis` is the block of results.json, the rest serves the report.

    `visible` is what the plan can see, `run` simulates candidates of the next test, `checked` are the rounds in which
    finalists were recomputed.
    """
    plan = library.plan.seen()
    tests = _next(library, d, run) if d.verdict in ("ambiguous", "partly") or len(d.named) > 1 else []
    found = {
        "schema": DIAGNOSIS_SCHEMA,
        "title": title,
        "units": _units(library.base),
        "fixed": dict(library.base.fixed),
        "ranges": {a.name: list(a.kept) for a in library.base.axes if a.kept},
        "modulus": {"name": library.base.modulus, "low": library.base.low, "high": library.base.high},
        "diagnosis": diagnosis_block(d, visible, tests),
        "experiments": [_experiment(e) for e in library.plan.experiments],
        "noise": {
            c: {
                "white": v.white,
                "correlated": v.correlated,
                "length_mm": v.length,
                "gain": v.gain,
                "contact_mm": v.contact,
                "depth_mm": v.depth,
                "source": v.source,
                "expected": {"gain": v.expected[0], "contact_mm": v.expected[1]},
                "repeats": {"gain": v.shown[0], "contact_mm": v.shown[1]},
            }
            for c, v in d.bench.levels.items()
        },
        "trusted": {
            e.name: {"sd": sd, "unit": e.size.unit, "stated": e.known is not None}
            for e in library.effects
            if (sd := calibrated_deviation(e)) is not None
        },
        "effects": [_effect(e) for e in library.effects],
        "probabilities": dict(sorted(d.probabilities.items(), key=lambda v: -v[1])[:20]),
        "sensitivity": d.sensitivity,
        "held_out": [{"experiment": h.experiment, "gain": h.gain} for h in d.held_out],
        "checks": [
            {"hypothesis": c.hypothesis, "returned": c.returned, "in_set": c.in_set, "no_gap": c.no_gap, "n": c.n}
            for c in d.checks
        ],
        "power": [{"effect": v.effect.name, "power": v.power} for v in visible],
        "residuals": residual_panels(plan, d),
        "signatures": signature_panels(library, d),
        "rerun": [asdict(c) for c in checked],
        "failed_runs": list(library.failed),
        "notes": list(library.plan.notes),
        "mirrored": mirrored_channels(plan, d),
    }
    return found | {"words": diagnosis_sentences(found)}


def mirrored_channels(plan: TestPlan, d: Diagnosis) -> list[dict[str, Any]]:
    """Lateral forces that are those of the base model times a number below −0.5, where that has some to show."""
    y, f = plan.values(), d.fits["none"]
    out: dict[tuple[str, str], tuple[float, float, float]] = {}
    for item, c, at in plan.rows():
        if c in ("Fx", "Fy"):
            name = plan.experiments[item.experiment].name
            fy, ff, noise = out.get((name, c), (0.0, 0.0, 0.0))
            more = ff + float(f[at] @ f[at]), max(noise, float(np.max(d.reading[at])))
            out[name, c] = fy + float(f[at] @ y[at]), *more
    return [
        {"experiment": name, "channel": c, "times": fy / ff}
        for (name, c), (fy, ff, noise) in out.items()
        if ff > (MIN_SIGNED_FORCE_TO_NOISE * noise) ** 2 and fy / ff < MAX_MIRRORED_PROJECTION
    ]


def diagnosis_block(d: Diagnosis, visible: Sequence[Detectable], tests: Sequence[NextTest]) -> dict[str, Any]:
    """The block `diagnosis` of results.json."""
    return {
        "verdict": d.verdict,
        "gap": {
            "p_value": d.p_value,
            "size_over_noise": d.size_over_noise,
            "statistic": d.statistic,
            "threshold": d.threshold,
        },
        "left": d.left,
        "remainder": None if d.remainder is None else _remainder(d.remainder),
        "odd": None if d.odd is None else {"experiment": d.odd[0], "probability": d.odd[1]},
        "jumps": _jumps(d),
        "hum": {
            "there": d.hum.there,
            "log10_p": d.hum.log10_p,
            "frequency": d.hum.frequency,
            "amplitude": d.hum.amplitude,
            "channel": d.hum.channel,
            "along": d.hum.along,
        },
        "where": _regions(d),
        "where_threshold": d.where.threshold,
        "causes": [_cause(d.bench.library.plan, c) for c in d.causes],
        "chosen": [e.name for e in d.chosen.effects],
        "ambiguous_with": [list(d.named)] if _rivals(d) else [],
        "shrinkage": _shrinkage(d),
        "parameters": {
            when: {k: {"low": v[0], "median": v[1], "high": v[2]} for k, v in p.items()}
            for when, p in d.parameters.items()
        },
        "reach": _reach(d),
        "detectable": [_detectable(v) for v in visible],
        "next_test": [_next_test(t) for t in tests],
    }


def _remainder(r: ResidualScore) -> dict[str, Any]:
    """What the leading hypothesis leaves, and what that looks like."""
    return {
        "of": r.of,
        "there": r.there,
        "score": r.score,
        "threshold": r.threshold,
        "looks_like": r.effect.name if r.effect else None,
    }


def _jumps(d: Diagnosis) -> dict[str, Any]:
    """Sudden changes of a record, and the crack if there is one."""
    j, c = d.jumps, d.jumps.crack
    return {
        "sudden": j.sudden,
        "skewed": j.skewed,
        "t": j.t,
        "z": j.z,
        "experiment": j.experiment,
        "size": j.size,
        "depths": list(j.depths),
        "crack": None if c is None else asdict(c),
    }


def _regions(d: Diagnosis) -> list[dict[str, Any]]:
    """Where the gap lies: the most conspicuous regions of the data."""
    return [
        {
            "experiment": r.experiment,
            "channel": r.channel,
            "region": r.region,
            "z": r.z,
            "sign": "+" if r.z > 0 else "-",
            "amplitude": r.amplitude,
            "amplitude_sd": r.amplitude_sd,
            "of_largest": r.of_largest,
            "share": r.share,
            "beyond_noise": abs(r.z) > d.where.threshold,
        }
        for r in d.where.regions[:MAX_LISTED_REGIONS]
    ]


def _cause(plan: TestPlan, c: Cause) -> dict[str, Any]:
    """A named cause: what it is, its probability, its size with an interval."""
    return {
        "effect": c.effect.name,
        "cause": c.effect.source,
        "description": c.effect.description,
        "family": c.effect.family,
        "probability": c.probability,
        "size": c.size,
        "interval": list(c.interval),
        "unit": c.effect.size.unit,
        "neutral": c.effect.size.neutral,
        "railed": c.railed,
        "like_a_modulus": c.effect.like_a_modulus,
        "like_a_body": c.effect.like_a_body,
        "like_a_spot": c.effect.like_a_spot,
        "flows": c.effect.flows,
        **({"each": _each(plan, c)} if c.each else {}),
        **({"otherwise": dict(zip(("probability", "low", "high"), c.otherwise, strict=True))} if c.otherwise else {}),
        "shape": [
            {"knob": k.name, "unit": k.unit, "size": mid, "interval": [low, high]}
            for k, (low, mid, high) in zip(c.effect.shape, c.shape, strict=False)
        ],
    }


def _shrinkage(d: Diagnosis) -> dict[str, Any]:
    """How far the cause closes the gap on experiments that were left out, in all and by curve."""
    s = d.shrinkage
    return {
        "held_out": [c.curve for c in s.curves],
        "before": s.before,
        "refit_only": s.refit_only,
        "with_cause": s.with_cause,
        "noise_floor": s.floor,
        "floor_error": s.floor_error,
        "closed": s.closed,
        "interval": None if s.interval is None else list(s.interval),
        "how": s.how,
        "curves": [
            {
                "curve": c.curve,
                "unit": c.unit,
                "before": c.before,
                "refit_only": c.refit_only,
                "with_cause": c.with_cause,
                "rms": list(c.rms),
                "p_values": list(c.p_values),
                "cause": list(c.cause),
            }
            for c in s.curves
        ],
        "fitted": None if s.fitted is None else dict(s.fitted),
    }


def _reach(d: Diagnosis) -> dict[str, Any]:
    """How far unseen effects may move each parameter."""
    return {
        k: {
            "low": r.whole[0],
            "high": r.whole[2],
            "low_with": r.low_with,
            "high_with": r.high_with,
            "by": list(r.by),
            "without": None if r.without is None else dict(zip(("low", "median", "high"), r.without, strict=True)),
        }
        for k, r in d.reach.items()
    }


def _detectable(v: Detectable) -> dict[str, Any]:
    """The smallest size of an effect that these tests show, and what it is confused with."""
    return {
        "effect": v.effect.name,
        "unit": v.effect.size.unit,
        "smallest_visible": v.value,
        "visible": v.limit is not None,
        "confused_with": list(v.confused_with),
        "confounded_with": list(v.confused_with),
        "recognised": v.recognised,
    }


def _next_test(t: NextTest) -> dict[str, Any]:
    """A test that may decide: what it is expected to show, and its price."""
    return {
        "test": t.test,
        "chance": t.chance,
        "information": t.information,
        "price": t.price,
        "separates": list(t.separates),
        "distance": t.distance,
        "resolves": t.resolves,
        "pairs": t.pairs,
        "note": t.note,
    }


def _each(plan: TestPlan, c: Cause) -> list[dict[str, Any]]:
    """What every test has of a cause that scatters, with its standard deviation."""
    return [
        {"experiment": plan.experiments[t.experiment].name, "label": t.label, "value": value, "sd": sd}
        for t, (value, sd) in zip(plan.tests, c.each, strict=True)
    ]


def _rivals(d: Diagnosis) -> bool:
    """Whether the named effects are rivals: each for itself, not together, and none sure."""
    several = d.verdict == "partly" and len(d.causes) > 1 and len(d.chosen.effects) == 1
    doubtful = several and (d.causes[0].effect.flows or d.causes[0].probability < DIAGNOSIS_SETTINGS.rules.sure)
    return d.verdict == "ambiguous" or doubtful


def _next(library: Library, d: Diagnosis, run: Run | None) -> list[NextTest]:
    """Tests that separate the named effects, each alone; two that were chosen together stand together."""
    effects = {e.name: (e,) for e in library.effects}
    scatter = {c.effect.name: c.size for c in d.causes if c.effect.family == "scatter"}
    alive: dict[str, tuple[tuple[Effect, ...], Posterior]] = {
        n: (effects[n], d.posteriors[n]) for n in d.named if n in d.posteriors and n in effects
    }
    plain_library = replace(library, plan=library.plan.seen())
    probability = {c.effect.name: c.probability for c in d.causes if c.effect.name in alive}
    both = [e.name for e in d.chosen.effects]
    if len(both) > 1:
        alive = {n: v for n, v in alive.items() if n not in both}
        alive[d.chosen.name] = (d.chosen.effects, d.posteriors[d.chosen.name])
        least = min(c.probability for c in d.causes if c.effect.name in both)
        probability = {n: p for n, p in probability.items() if n in alive} | {d.chosen.name: least}
    return next_tests(plain_library, d.bench, alive, probability, run, scatter)


def residual_panels(plan: TestPlan, d: Diagnosis) -> list[dict[str, Any]]:
    """By test and channel: depth, branch, residual against each fitted model, standard deviation of a reading; readings
    of a hold for themselves, with the time `since` the indenter came to rest.

    Gain and contact of each test, as fitted with the chosen hypothesis, are taken out of every residual.
    """
    y = plan.values()
    left = {name: y - f - d.taken for name, f in d.fits.items()}
    return [
        {
            **head,
            "measured": y[k].tolist(),
            "sd": d.reading[k].tolist(),
            "residual": {name: r[k].tolist() for name, r in left.items()},
        }
        for head, k in _parts(plan)
    ]


def signature_panels(library: Library, d: Diagnosis) -> list[dict[str, Any]]:
    """By test and channel, as the residuals: what each leading hypothesis, fitted for itself, adds to the base model as
    fitted."""
    seen = replace(library, plan=library.plan.seen())
    fits = {
        h.name: d.fits[h.name]
        if h.name in d.fits
        else predicted(seen, h.effects, d.posteriors[h.name], d.bench.modulus)
        for h in leading_hypotheses(d)
    }
    return [
        {**head, "added": {name: _rounded((f - d.fits["none"])[k]) for name, f in fits.items()}}
        for head, k in _parts(seen.plan)
        if fits
    ]


def leading_hypotheses(d: Diagnosis) -> list[Hypothesis]:
    """Hypotheses with a posterior that move a mean, the chosen one first: N_LEADING_HYPOTHESES of one effect at most,
    and a pair."""
    known = {h.name: h for h in (*d.contest.hypotheses, d.chosen)}
    found: dict[frozenset[str], Hypothesis] = {}
    for name in (d.chosen.name, *d.named, *d.posteriors):
        h = known.get(name)
        if h is not None and name in d.posteriors and any(e.family != "scatter" for e in h.effects):
            found.setdefault(frozenset(e.name for e in h.effects), h)
    alone = [h for h in found.values() if len(h.effects) == 1][:N_LEADING_HYPOTHESES]
    return [h for h in found.values() if len(h.effects) > 1 or h in alone]


def _parts(plan: TestPlan) -> list[tuple[dict[str, Any], np.ndarray]]:
    """Each channel of each test, moving and at rest: what says where its readings were taken, and their rows."""
    found = []
    for item, c, at in plan.rows():
        test = item if isinstance(item, Test) else None
        branch = np.full(len(item.depth), LOADING_BRANCH) if test is None else test.branch
        for k in (branch != HELD_BRANCH, branch == HELD_BRANCH):
            if k.any():
                head = {
                    "experiment": plan.experiments[item.experiment].name,
                    "channel": c,
                    "label": "" if test is None else test.label,
                    "depth": item.depth[k].tolist(),
                    **({} if test is None or np.any(branch[k] != HELD_BRANCH) else {"since": test.since[k].tolist()}),
                    "branch": branch[k].tolist(),
                }
                found.append((head, np.arange(at.start, at.stop)[k]))
    return found


def _rounded(values: np.ndarray) -> list[float]:
    """To six digits of the largest."""
    top = float(np.abs(values).max(initial=0.0))
    return np.round(values, 5 - math.floor(math.log10(top))).tolist() if top > 0 else values.tolist()


def _units(base: Base) -> dict[str, str]:
    """Of the open parameters and of the fixed ones."""
    fixed = {p.name: p.unit for p in base.backend.parameters if p.name in base.fixed}
    return {base.modulus: "MPa", **{a.name: a.unit for a in base.axes}, **fixed}


def _experiment(e: Any) -> dict[str, Any]:
    return {
        "name": e.name,
        "role": e.role,
        "channels": list(e.channels),
        "speed": e.speed,
        "mounting": e.mounting,
        "repeats": len(e.measurement.repeats),
        "kind": e.measurement.kind,
        "point": list(e.settings.get("point", [])),
    }


def _effect(e: Effect) -> dict[str, Any]:
    return {
        "name": e.name,
        "label": e.label or e.name,
        "description": e.description,
        "family": e.family,
        "unit": e.size.unit,
        "neutral": e.size.neutral,
        "low": e.size.low,
        "high": e.size.high,
        "source": e.source,
        "shape": [s.name for s in e.shape],
        "one_place": e.place is not None,
    }
