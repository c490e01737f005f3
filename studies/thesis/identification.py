"""Tables and numbers of chapters 4 and 5.1 of the source: ranges, candidates, sensitivity, error surfaces, norms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rso.core.curves import baseline, metrics
from rso.inference import fit_surface, surface_minima
from studies.thesis import analysis
from studies.thesis.analysis import RANGES, Family
from studies.thesis.rows import Outcomes, num, per_cent, table
from studies.thesis.simulations import PRINTED, SETS

# The source's searches: ranges, target depths in mm.
SEARCHES = {
    "1P FR": ("FR", (4.0,)),
    "1P RR": ("RR", (3.9,)),
    "2P RR": ("2P", (2.0, 3.9)),
    "2P FR": ("FR", (2.0, 3.9)),
    "3P": ("3P", (2.0, 3.0, 3.9)),
}
MAIN = "2P FR"  # what [search] of study.toml is
NORMS = ("nrmse", "mre", "rrmse")


def facts(outcomes: Outcomes, study: Mapping[str, Any] | None) -> dict[str, str]:
    """What the page says of identification, by name; `study` is results.json of study.toml, None if it was not run."""
    bowl, held = (analysis.family(outcomes, k) for k in ("bowl", "held"))
    parts = [searches(bowl, study), one_point(bowl), sensitivities(bowl, held), polynomials(), surface(bowl)]
    parts += [norms(bowl, held), means(bowl), lists(bowl, held)]
    parts += [{"n_family": str(len(bowl.x)), "left_out": per_cent(bowl.left_out()).lstrip("+")}]
    return {k: v for part in parts for k, v in part.items()}


def pair(mu: float, D1: float) -> str:
    """A parameter set for a reader: Pa and 1/MPa."""
    return f"{mu * 1e6:.0f} / {D1:.3g}"


def searches(bowl: Family, study: Mapping[str, Any] | None) -> dict[str, str]:
    """Ranges, targets, candidates."""
    depth, force = analysis.measured()
    found = {s["name"] if s["name"] in SEARCHES else MAIN: s for s in (study or {}).get("searches", [])}
    rows = []
    for name, (box, depths) in SEARCHES.items():
        (m0, m1), (d0, d1) = RANGES[box]
        printed = [(m * 1e-6, d) for m, d in PRINTED["candidates"].get(name, [])] or [SETS["4"]]
        target = float(np.interp(depths[-1], depth, force))
        theirs = [f"{pair(*p)} ({per_cent(float(bowl.force(*p, depths[-1])) / target - 1)})" for p in printed]
        s = found.get(name)
        ours = [] if s is None else [_candidate(c) for c in s["candidates"]]
        kind = "–" if s is None else s["kind"] + ("" if s["reachable"] else ", targets out of reach")
        rows.append(
            [
                name,
                ", ".join(f"{u:g}" for u in depths),
                f"{m0 * 1e6:.0f}–{m1 * 1e6:.0f}, {d0:g}–{d1:g}",
                "; ".join(theirs),
                "; ".join(ours) or "–",
                kind,
            ]
        )
    head = [
        "search",
        "targets mm",
        "ranges μ Pa, D₁ MPa⁻¹",
        "thesis (deepest target missed by)",
        "here (NRMSE)",
        "kind of set",
    ]
    runs = str((study or {}).get("counts", {}).get("fe_runs", "–"))
    determined = (study or {}).get("determined", {})
    mu, D1 = (determined.get(k, {}) for k in ("mu", "D1"))
    verdicts = {"mu": _verdict(mu, 1e6, "Pa"), "D1": _verdict(D1, 1.0, "MPa⁻¹")}
    return {"searches": table(head, rows), "study_runs": runs, **verdicts}


def _verdict(found: Mapping[str, Any], factor: float, unit: str) -> str:
    """Interval and verdict of one parameter; the study's `determined`."""
    low, high = (np.nan if v is None else v for v in found.get("interval", (None, None)))
    if not np.isfinite([low, high]).all():
        return "not determined"
    ends = (f"{float(f'{v * factor:.3g}'):g}" for v in (low, high))
    return f"{' to '.join(ends)} {unit}, {'' if found['determined'] else 'not '}determined"


def _candidate(c: Mapping[str, Any]) -> str:
    nrmse = c["metrics"].get("middle_point", {}).get("nrmse", np.nan) if c["state"] == "done" else np.nan
    return f"{pair(c['values']['mu'], c['values']['D1'])} ({num(nrmse)})"


def one_point(bowl: Family) -> dict[str, str]:
    """Why one target point fails."""
    target = PRINTED["middle_point"]["Fz_N"]
    M, D = (g.ravel() for g in np.meshgrid(*(np.linspace(*b, 121) for b in RANGES["FR"])))
    exact = bowl.force(M, D, 4.0)
    near = np.abs(exact - target) < 0.05 * target
    miss = ((analysis.quadratic(bowl, RANGES["FR"], 4.0)(M, D) - exact) / target)[near]
    D1 = np.array([1.0, 2.0, 5.0, 7.0, 10.0, 50.0, 112.0, 161.0, 168.0])
    valley = bowl.valley(D1, 4.0, target)
    at_2, at_39 = (bowl.valley(np.array([1.0, 50.0]), u, float(np.interp(u, *analysis.measured()))) for u in (2.0, 3.9))
    parting = float(np.divide(*(at_2 / at_39)[::-1]) - 1)
    theirs = {d: str(m) for name in ("1P FR", "1P RR") for m, d in PRINTED["candidates"][name]}
    rows = [
        ["μ Pa here for 0.546 N at 4 mm", *(f"{m * 1e6:.0f}" for m in valley)],
        ["μ Pa thesis", *(theirs.get(d, "") for d in D1)],
    ]
    reach = float(bowl.force(RANGES["RR"][0][1], RANGES["RR"][1][0], 4.0))
    return {
        "one_point": table(["D₁ MPa⁻¹", *(f"{v:g}" for v in D1)], rows),
        "quadratic_low": per_cent(miss.min(), 0),
        "quadratic_high": per_cent(miss.max(), 0),
        "parting": per_cent(parting).lstrip("+"),
        "reach": num(reach),
        "reach_miss": per_cent(reach / target - 1),
        "reduced_miss": per_cent(float(bowl.force(0.0085, 5.0, 4.0)) / target - 1),
    }


def sensitivities(bowl: Family, held: Family) -> dict[str, str]:
    """Local sensitivity."""
    rows = []
    for name, box in RANGES.items():
        for u in (2.0, 3.0, 4.0):
            s, h = (analysis.sensitivity(f, box, u) for f in (bowl, held))
            rows.append([name, f"{u:g}", *(num(v, 1) for v in (s.change, h.change, s.log_change, s.elasticity))])
    four = analysis.elasticity_of_four(bowl, 4.0)
    s, h = (analysis.sensitivity(f, RANGES["FR"], 4.0) for f in (bowl, held))
    head = [
        "ranges",
        "depth mm",
        "change, bowl",
        "change, held",
        "change about the geometric middle, bowl",
        "elasticity, bowl",
    ]
    return {
        "sensitivity": table(head, rows),
        "change": num(s.change, 1),
        "change_held": num(h.change, 1),
        "log_change": num(s.log_change, 1),
        "four": num(four, 2),
        "four_D1": num(four / 0.01, 0),
        "at_1": num(abs(np.divide(*bowl.slope(0.01, 1.0, 4.0))), 0),
    }


def polynomials() -> dict[str, str]:
    """Table 4.1."""
    rows = []
    for row in PRINTED["poly"]:
        points, values = analysis.printed_errors(row["metric"])
        fitted = fit_surface(points, values, row["degree"])
        ours = [f"{pair(*m.theta)} ({m.error:.3f} ± {m.sd:.3f}, {m.kind})" for m in surface_minima(fitted)]
        grid = np.stack(np.meshgrid(*np.linspace(points.min(axis=0), points.max(axis=0), 121).T), axis=-1)
        lowest = float(fitted(grid.reshape(-1, 2)).min())
        rows.append(
            [
                str(row["degree"]),
                row["metric"].upper(),
                f"{row['mu_Pa']} / {row['D1']}",
                "; ".join(ours),
                num(fitted.r2),
                num(lowest, 2),
            ]
        )
    head = ["degree", "metric", "thesis μ Pa / D₁ MPa⁻¹", "here (error ± sd, where)", "R²", "lowest in the box"]
    return {"polynomials": table(head, rows)}


def surface(bowl: Family) -> dict[str, str]:
    """Where the error of the finite elements themselves is smallest, and for how long a D1 it stays small."""
    u, y = analysis.measured()
    M, D = np.meshgrid(np.linspace(0.007, 0.014, 281), np.geomspace(1.0, 168.0, 200))
    F = M[..., None] / analysis.MU * bowl.at(u)(np.log(M * D))
    out = {}
    for name, Z in (
        ("nrmse", np.sqrt(np.mean((F - y) ** 2, axis=-1)) / y.mean()),
        ("mre", np.mean(np.abs(F / y - 1), axis=-1)),
    ):
        k = np.unravel_index(np.argmin(Z), Z.shape)
        flat = D[Z.min(axis=1) < 1.5 * Z.min(), 0]
        out[f"{name}_minimum"] = f"{num(Z.min())} at {pair(M[k], D[k])}"
        out[f"{name}_flat"] = f"{flat.min():.3g} to {flat.max():.3g}"
    return out


def norms(bowl: Family, held: Family) -> dict[str, str]:
    """Table 5.1."""
    u, y = analysis.measured()
    rows = []
    for s, row in PRINTED["sets"].items():
        both = [metrics(y, f.curve(*SETS[s], u)) for f in (bowl, held)]
        cells = [[num(row[name], 4), *(num(getattr(m, name)) for m in both)] for name in NORMS]
        rows.append([f"{s} ({pair(*SETS[s])})", *(c for group in cells for c in group)])
    head = ["set", *(f"{name.upper()} {who}" for name in NORMS for who in ("thesis", "bowl", "held"))]
    return {"norms": table(head, rows)}


def means(bowl: Family) -> dict[str, str]:
    """Table 5.2."""
    u, y = analysis.measured()
    own, rows = baseline(y), []
    for name in NORMS:
        points, values = analysis.printed_errors("nrmse" if name == "rrmse" else name)
        listed = "not printed" if name == "rrmse" else num(float(values.mean()), 4)
        here = [getattr(m, name) for m in analysis.errors_of(bowl, points, (u, y))]
        printed = PRINTED["means"][name]
        rows.append(
            [
                name.upper(),
                num(printed["mean"], 4),
                listed,
                num(float(np.mean(here)), 4),
                num(printed["baseline"], 4),
                num(getattr(own, name), 4),
            ]
        )
    head = ["metric", "mean, thesis", "mean of its list", "mean here, same sets", "baseline, thesis", "baseline here"]
    mad = float(np.mean(np.abs(y - y.mean())) / y.mean())
    return {"means": table(head, rows), "mad": num(mad, 4)}


def lists(bowl: Family, held: Family) -> dict[str, str]:
    """How far all errors that the source lists are from those computed here."""
    data, rows = analysis.measured(), []
    for name in ("nrmse", "mre"):
        points, values = analysis.printed_errors(name)
        cells = [name.upper(), str(len(values))]
        for f in (bowl, held):
            miss = np.array([getattr(m, name) for m in analysis.errors_of(f, points, data)]) - values
            cells += [num(float(np.sqrt(np.mean(miss**2)))), num(float(np.median(np.abs(miss))))]
        rows.append(cells)
    head = ["list", "simulations", "rms difference, bowl", "median, bowl", "rms difference, held", "median, held"]
    return {"lists": table(head, rows)}
