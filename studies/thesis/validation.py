"""Tables and numbers of chapter 5.2 of the source, of its first experiment, of the support and of the mesh."""

from __future__ import annotations

import numpy as np

from rso.core.curves import Resampling, metrics
from rso.evaluation.store import Done, Failed
from studies.thesis import analysis
from studies.thesis.analysis import Family, gap
from studies.thesis.rows import Outcomes, curve, num, per_cent, table, value, yes
from studies.thesis.simulations import LEVELS, LINE, POINTS, PRINTED, SETS, STEPS, of_set, plan

DEEP = PRINTED["deeper"]
DEPTH = PRINTED["middle_point"]["validation_depth_mm"]


def facts(outcomes: Outcomes) -> dict[str, str]:
    """What the page says of validation, by name."""
    bowl = analysis.family(outcomes, "bowl")
    parts = [deeper(outcomes), crossings(outcomes), profiles(outcomes), half_model(outcomes, bowl)]
    parts += [blue(outcomes), points(outcomes), statements(outcomes), first_experiment(outcomes)]
    parts += [support(outcomes), levels(outcomes), endings(outcomes)]
    return {k: v for part in parts for k, v in part.items()}


def deeper(outcomes: Outcomes) -> dict[str, str]:
    """Force at 8 mm."""
    rows = []
    for s in ("1", "3", "4"):
        thesis = num(DEEP["set4_8mm_N"], 3) if s == "4" else "not printed"
        runs = ("ball", "bowl", "held", "weight")
        rows.append([s, thesis, *(num(value(outcomes, f"set {s} 8 mm {k}", "Fz", DEPTH)) for k in runs)])
    head = ["set", "thesis", "bowl, ball alone", "bowl, ball with shaft", "held, with shaft", "bowl and weight"]
    here = value(outcomes, "set 4 8 mm ball", "Fz", DEPTH)
    return {"deeper": table(head, rows), "deep_4": num(here), "deeper_miss": per_cent(here / DEEP["set4_8mm_N"] - 1)}


def crossings(outcomes: Outcomes) -> dict[str, str]:
    """Table 5.3: norms against a curve through the few points that the source says of the measured one."""
    rows = {s: [s, *(num(PRINTED["sets"][s][k], 4) for k in ("nrmse", "vc1"))] for s in ("1", "3", "4")}
    words = {}
    for kind in ("ball", "bowl"):
        found = {s: curve(outcomes, f"set {s} 8 mm {kind}") for s in rows}
        if any(not len(t) or t[-1] < DEPTH for t, _ in found.values()):
            words[kind] = "–"
            for row in rows.values():
                row.append("–")
            continue
        sets = {s: Resampling(*f) for s, f in found.items()}
        at = [(u, float(sets["1"](u) + sets["3"](u)) / 2) for u in DEEP["crossing_sets13_mm"]]
        at += [(DEEP["crossing_set4_mm"], float(sets["4"](DEEP["crossing_set4_mm"])))]
        at = sorted([*at, (DEPTH, PRINTED["middle_point"]["validation_Fz_N"])])
        u = 0.1 * np.arange(1, round(10 * DEPTH) + 1)
        y = analysis.deeper_curve(at, u)
        words[kind] = ", ".join(f"{F:.3f} N at {d:g} mm" for d, F in at)
        for s, f in sets.items():
            rows[s].append(num(metrics(y, f(u)).nrmse))
    head = ["set", "0–4 mm, thesis", "0–8 mm, thesis", "0–8 mm, here, ball alone", "with shaft"]
    mesh = value(outcomes, "set 3 8 mm held", "Fz", DEPTH) / value(outcomes, "level standard 8 mm", "Fz", DEPTH) - 1
    return {"vc1": table(head, list(rows.values())), "vc1_points": words["ball"], "mesh_8": per_cent(mesh)}


def profiles(outcomes: Outcomes) -> dict[str, str]:
    """Table 5.4: displacements beside the x axis; whether the printed norms agree with how the profiles differ."""
    rows = []
    for s in ("1", "3", "4"):
        z = [_line(outcomes, of_set("bowl", s), u) for u in (1.0, 2.0, 3.0, 4.0)]
        held = _line(outcomes, of_set("held", s), 4.0)
        rows.append(
            [
                s,
                num(PRINTED["sets"][s]["vc2"], 4),
                *(num(v[0], 2) for v in z),
                num(held[0], 2),
                num(_whole(z[-1]), 2),
                num(_whole(held), 2),
            ]
        )
    head = [
        "set",
        "NRMSE thesis",
        *(f"next to the ball, {u} mm" for u in (1, 2, 3, 4)),
        "same, 4 mm, held",
        "mean of the line, 4 mm",
        "same, held",
    ]
    at_4 = {label: {s: _line(outcomes, of_set(label, s), 4.0) for s in ("1", "3", "4")} for label in ("bowl", "held")}
    checks = []
    allowed = {label: (0.0, np.inf) for label in at_4}
    for a, b in (("1", "3"), ("1", "4"), ("3", "4")):
        cells = [f"{a} and {b}"]
        first, second = (PRINTED["sets"][s]["vc2"] for s in (a, b))
        for label, lines in at_4.items():
            d = gap(lines[a], lines[b])
            low, high = d / (first + second), d / abs(first - second)
            allowed[label] = max(allowed[label][0], low), min(allowed[label][1], high)
            cells += [num(d), f"{low:.2f} to {high:.2f}"]
        checks.append(cells)
    both = [f"{low:.2f} to {high:.2f}" if low < high else "none" for low, high in allowed.values()]
    checks.append(["all three", "", both[0], "", both[1]])
    pairs = ["sets", "differ by, bowl mm", "allows a mean, bowl mm", "differ by, held mm", "allows a mean, held mm"]
    fall = [_whole(at_4["bowl"][s]) for s in ("3", "1", "4")]  # rising D1
    return {
        "profile": table(head, rows),
        "profile_check": table(pairs, checks),
        "profile_order": yes(abs(fall[0]) < abs(fall[1]) < abs(fall[2])),
    }


def _line(outcomes: Outcomes, name: str, depth: float) -> np.ndarray:
    """Displacements (mm) of the marks on x >= 0."""
    return np.array([value(outcomes, name, f"uz({x:g},5)", depth) for x in LINE])


def _whole(z: np.ndarray) -> float:
    """Mean over both sides of the line."""
    return float((z[0] + 2 * z[1:].sum()) / (2 * len(z) - 1))


def half_model(outcomes: Outcomes, bowl: Family) -> dict[str, str]:
    """Table 5.5, middle point: what half of a model feels to the side."""
    name = f"set 3 friction {0.2:g}"
    t, side = curve(outcomes, name, "Fy_half")
    _, down = curve(outcomes, name)
    if not len(t) or t[-1] < STEPS[-1]:
        return dict.fromkeys(("half", "half_4", "half_share", "cv_x", "z_middle"), "–")
    u, y = analysis.measured()
    Fy, Fz = Resampling(t, side)(u), bowl.curve(*SETS["3"], u)
    printed, rows = PRINTED["components"]["middle"], []
    for factor, what in ((0.0, "whole model: Fy = 0"), (1.0, "Fy of one half"), (2.0, "doubled, as Fz of a half is")):
        total = metrics(y, np.hypot(Fz, factor * Fy)).nrmse
        mean = float(np.sqrt(np.mean((factor * Fy) ** 2))) / printed["Fy"]
        rows.append(
            [
                what,
                num(factor * abs(side[-1])),
                num(printed["total"], 4),
                num(total),
                "–" if not factor else f"{1e3 * mean:.1f} mN",
            ]
        )
    head = ["reading", "size of Fy at 4 mm, N", "NRMSE of the total, thesis", "here", "mean measured Fy for 67.98"]
    return {
        "half": table(head, rows),
        "half_4": num(abs(side[-1])),
        "half_share": num(100 * abs(side[-1]) / down[-1], 0),
        "cv_x": num(float(np.sqrt(printed["Fx"] ** 2 - 1)), 2),
        "z_middle": num(metrics(y, Fz).nrmse),
    }


def blue(outcomes: Outcomes) -> dict[str, str]:
    """Table 5.5, blue point."""
    rows = []
    for what, name in (
        ("held, vertical", "point blue vertical"),
        ("held, along the normal", "point blue normal"),
        ("bowl, vertical", "bowl blue"),
        ("bowl and weight, vertical", "bowl blue weight"),
    ):
        F = np.array([value(outcomes, name, c, 4.0) for c in ("Fx", "Fy", "Fz")])
        rows.append(
            [what, *(num(1e3 * f, 1) for f in F[:2]), *(num(f) for f in (F[2], np.linalg.norm(F))), num(F[1] / F[0], 1)]
        )
    printed = PRINTED["components"]["blue"]
    rows.append(["NRMSE in the thesis", *(num(printed[k], 4) for k in ("Fx", "Fy", "Fz", "total")), ""])
    # Curves of one shape, k times too large: NRMSE = |k - 1| sqrt(1 + cv^2), with the cv of the force itself.
    shape = np.sqrt(1 + PRINTED["means"]["nrmse"]["baseline"] ** 2)
    head = ["set 3 at 4 mm", "Fx mN", "Fy mN", "Fz N", "total N", "Fy / Fx"]
    k = 1 + printed["Fy"] / shape
    per_mm = {c: value(outcomes, "point blue vertical", f"F{c}", 4.0) / POINTS["blue"][0] for c in "xy"}
    offsets = {f"offset_{c}": num(PRINTED["middle_point"][f"F{c}_N"] / per_mm[c], 1) for c in "xy"}
    return {
        "blue": table(head, rows),
        "k_y": num(k, 1),
        "k_x": f"{100 * printed['Fx'] / shape:.0f} %",
        "ratio_measured": num((60 / 35) ** 2 / k, 1),
        **offsets,
    }


def _components(outcomes: Outcomes, place: str, direction: str) -> np.ndarray:
    name = "level coarse held" if place == "top" else f"point {place} {direction}"
    return np.array([value(outcomes, name, c, 4.0) for c in ("Fx", "Fy", "Fz")])


def points(outcomes: Outcomes) -> dict[str, str]:
    """Force components of every point, pressed vertically and along the normal."""
    rows = []
    for name in ("top", *POINTS):
        x, y = POINTS.get(name, (0.0, 0.0))
        cells = [f"({x:g}, {y:g})", num(_slope(x, y), 2)]
        for direction in ("vertical", "normal"):
            F = _components(outcomes, name, direction)
            cells += [num(1e3 * F[0], 0), num(1e3 * F[1], 0), num(F[2]), num(float(np.linalg.norm(F)))]
        rows.append(cells)
    head = [
        "point mm",
        "slope",
        *(f"{c}, {d}" for d in ("vertical", "normal") for c in ("Fx mN", "Fy mN", "Fz N", "total N")),
    ]
    return {"points": table(head, rows)}


def _slope(x: float, y: float) -> float:
    """Slope of the ellipsoid's upper surface above (x, y)."""
    a, b, c = 60.0, 35.0, 35.0
    root = np.sqrt(1 - (x / a) ** 2 - (y / b) ** 2)
    return float(c / root * np.hypot(x / a**2, y / b**2))


def statements(outcomes: Outcomes) -> dict[str, str]:
    """What section 2.4.3 says of the measured components, checked on the computed ones."""
    rows = []
    checks = {
        d: _checks(*(_components(outcomes, p, d) for p in ("top", "0, 20", "20, 0", "20, 20")))
        for d in ("vertical", "normal")
    }
    for words in checks["vertical"]:
        rows.append([words, *(yes(checks[d][words]) for d in checks)])
    head = ["the thesis on its measurements", "here, vertical", "here, normal"]
    near = _components(outcomes, "20, 20", "vertical")[1] / _components(outcomes, "0, 20", "vertical")[1]
    return {"Fy_ratio": per_cent(near, 0).lstrip("+"), "statements": table(head, rows)}


def _checks(top: np.ndarray, p1: np.ndarray, p2: np.ndarray, p3: np.ndarray) -> dict[str, bool | None]:
    """p1 = (0, 20), p2 = (20, 0), p3 = (20, 20): statement → whether it holds, None without all forces."""
    total = [float(np.linalg.norm(F)) for F in (top, p2, p1, p3)]
    known = np.isfinite(total).all()
    found = {
        "Fx largest at (20, 0), then (20, 20)": bool(abs(p2[0]) > abs(p3[0]) > 5 * max(abs(top[0]), abs(p1[0]))),
        "Fy largest at (20, 20), closely followed by (0, 20)": bool(1.25 * abs(p1[1]) > abs(p3[1]) > abs(p1[1])),
        "Fz: top, then (20, 0), then (0, 20) and (20, 20)": bool(top[2] > p2[2] > max(p1[2], p3[2])),
        "the steeper the surface, the lower the total force": bool(all(np.diff(total) < 0)),
    }
    return {words: holds if known else None for words, holds in found.items()}


def first_experiment(outcomes: Outcomes) -> dict[str, str]:
    """EM I."""
    first = PRINTED["em1"]
    u, rows = first["depth_mm"], []
    top, near = (value(outcomes, f"EM I {p}", "Fz", u) for p in ("top", "nearby"))
    for what, name, target in (
        ("top, cavity", "EM I top", first["middle_N"]),
        ("top, no cavity", "EM I top no cavity", first["middle_N"]),
        ("top, cavity, friction 0.3 at the ball", "EM I top friction", first["middle_N"]),
        ("5 mm beside, along the minor axis", "EM I nearby", first["nearby_N"]),
    ):
        F = [value(outcomes, name, c, u) for c in ("Fx", "Fy", "Fz")]
        rows.append([what, num(target, 4), num(F[2], 4), per_cent(F[2] / target - 1), num(float(np.linalg.norm(F)), 4)])
    head = ["set (6700 Pa, 6 MPa⁻¹) at 3.8 mm", "measured N", "here Fz N", "difference", "here, total N"]
    o = outcomes.get("EM I linear")
    reached = curve(outcomes, "EM I linear")[0]

    def linear(depth: float) -> float:
        return value(outcomes, "EM I linear", "Fz", depth)

    ending = "–" if o is None else "to the end" if isinstance(o, Done) else getattr(o, "cause", "crashed")
    return {
        "em1": table(head, rows),
        "em1_ratio": num(first["nearby_N"] / first["middle_N"]),
        "em1_ratio_here": num(near / top),
        "em1_mu": num(1e6 * first["mu_MPa"] * first["middle_N"] / top, 0),
        "hertz_38": num(_hertz(u), 4),
        "linear_reach": num(float(reached[-1]) if len(reached) else np.nan, 2),
        "linear_end": ending,
        "linear_2": num(linear(2.0)),
        "linear_025": per_cent(linear(0.25) / _hertz(0.25), 0).lstrip("+"),
        "hooke_2": num(_hertz(2.0)),
        "neo_2": num(value(outcomes, "EM I top", "Fz", 2.0), 3),
    }


def _hertz(u: float, E: float = PRINTED["em1"]["E_Hertz_MPa"], nu: float = 0.49) -> float:
    """Hertz's force (N) of a ball of 3 mm on a half space at depth u (mm)."""
    return float(4 / 3 * E / (1 - nu**2) * np.sqrt(3.0) * u**1.5)


def support(outcomes: Outcomes) -> dict[str, str]:
    """Held, bowl, clearance, friction, weight."""
    rows = []
    u = np.array(STEPS)
    data = np.interp(u, *analysis.measured())
    for s in ("3", "4"):
        scale = SETS[s][0] / analysis.MU
        runs = [("bowl, clearance 1 mm", of_set("bowl", s), scale), ("held", of_set("held", s), scale)]
        runs += [(f"bowl, clearance {c:g} mm", f"set {s} clearance {c:g}", 1.0) for c in (0.5, 2.0)]
        runs += [(f"bowl, friction {f:g}", f"set {s} friction {f:g}", 1.0) for f in (0.2, 0.5)]
        runs += [("bowl, friction 0.2, weight", f"set {s} weight", 1.0)]
        reference = scale * value(outcomes, runs[0][1], "Fz", 4.0)
        for what, name, factor in runs:
            if not len(curve(outcomes, name)[0]):
                continue
            F = factor * np.array([value(outcomes, name, "Fz", v) for v in STEPS])
            z = _line(outcomes, name, 4.0)
            rows.append(
                [
                    s,
                    what,
                    num(F[3]),
                    num(F[-1]),
                    per_cent(F[-1] / reference - 1, 2),
                    num(metrics(data, F).nrmse),
                    num(value(outcomes, name, "bulge", 4.0), 2),
                    num(z[0], 2),
                    num(z[-1], 2),
                ]
            )
    head = [
        "set",
        "support",
        "Fz N at 2 mm",
        "at 4 mm",
        "of the bowl's",
        "NRMSE",
        "bulge mm",
        "uz(0, 5) mm",
        "uz(20, 5) mm",
    ]
    return {"support": table(head, rows)}


def levels(outcomes: Outcomes) -> dict[str, str]:
    """Mesh convergence of set 3, and Hertz's contact at small depth."""
    rows = []
    finest = next((k for k in LEVELS[::-1] if isinstance(outcomes.get(f"level {k} held"), Done)), LEVELS[0])
    best = value(outcomes, f"level {finest} held", "Fz", 4.0)
    deep = {"coarse": "set 3 8 mm held", "standard": "level standard 8 mm"}
    for level in LEVELS:
        name = f"level {level} held"
        o = outcomes.get(name)
        nodes = str(o.response.info["nodes"]) if isinstance(o, Done) and "nodes" in o.response.info else "–"
        F = [value(outcomes, name, "Fz", u) for u in (0.4, 2.0, 4.0)]
        done = isinstance(o, Done)
        stated = float(o.response.error["Fz"][-1]) / F[-1] if done and "Fz" in o.response.error else np.nan
        cpu = o.cpu_s if done else np.nan
        rows.append(
            [
                level,
                nodes,
                *(num(f, 4) for f in F),
                per_cent(F[-1] / best - 1, 2),
                per_cent(stated, 2).lstrip("+"),
                num(value(outcomes, f"level {level} bowl", "Fz", 4.0), 4),
                num(value(outcomes, deep.get(level, ""), "Fz", 8.0)),
                num(value(outcomes, name, "contact_radius", 0.4), 2),
                num(cpu, 0),
            ]
        )
    head = [
        "mesh",
        "nodes",
        "Fz N at 0.4 mm",
        "2 mm",
        "4 mm",
        "of the finest",
        "stated error",
        "bowl, 4 mm",
        "8 mm",
        "contact radius at 0.4 mm",
        "CPU s",
    ]
    mu, D1 = SETS["3"]
    K = 2 / D1
    E, nu = 9 * K * mu / (3 * K + mu), (3 * K - 2 * mu) / (2 * (3 * K + mu))
    return {"levels": table(head, rows), "hertz_F": num(_hertz(0.4, E, nu), 4), "hertz_a": num(np.sqrt(3.0 * 0.4), 2)}


def endings(outcomes: Outcomes) -> dict[str, str]:
    """How many runs, what they cost and which have no answer."""
    failed = [f"*{k}* ({o.cause.replace('_', ' ')})" for k, o in outcomes.items() if isinstance(o, Failed)]
    cpu = sum(getattr(o, "cpu_s", 0.0) for o in outcomes.values())
    pending = [f"*{k}*" for k in plan() if k not in outcomes]
    return {
        "runs": str(len(outcomes)),
        "minutes": num(cpu / 60, 0),
        "failed": ", ".join(failed) if failed else "none",
        "pending": "; ".join(pending) if pending else "none",
    }
