"""Forces of the unmodified experiment over ln(mu D1): one small table, after which null and chain cases cost no FE.

python benchmarks/blind/library.py     fills library.json beside this file, run by run, and can be interrupted
By dimension F = mu f(mu D1, d); f is interpolated by a cubic in ln(mu D1) and a cubic spline in the root of the depth.
"""

import json
import os
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

FILE = Path(__file__).with_name("library.json")
MU_D1 = {"top": (0.13, 0.03, 0.45, 0.009, 1.3), "20_0": (0.13, 0.01, 1.3), "2.5_2.5": (0.13, 0.01, 1.3)}
LINES = {"top": (0.0, 0.0), "20_0": (20.0, 0.0), "2.5_2.5": (2.5, 2.5)}


def build():
    """Run what is missing; returns nothing, writes FILE after every run."""
    import fe
    import ngsolve as ng

    ng.SetNumThreads(1)
    rows = json.loads(FILE.read_text()) if FILE.exists() else []
    have = {(r["place"], r["muD1"]) for r in rows}
    for k in range(5):
        for place, values in MU_D1.items():
            if k < len(values) and (place, values[k]) not in have:
                top = place == "top"
                model = fe.Model(muD1=values[k], line=LINES[place])
                try:
                    path = fe.Experiment(model).press(
                        [(2 * d, d) for d in (fe.DEEP_DEPTHS if top else fe.POINT_DEPTHS)], profile=top
                    )
                except fe.NotConverged as error:
                    path = error.reached
                rows.append({"place": place, "muD1": values[k], **as_table(path)})
                new = FILE.with_suffix(".tmp")
                new.write_text(json.dumps(rows))
                os.replace(new, FILE)
                print(place, values[k], path.d[-1], path.F[-1], flush=True)


def as_table(path):
    """Path -> dict of lists; Fz corrected for the penetration of the penalty, F = F_eps + dE_c/dd."""
    d = np.array(path.d)
    F = np.array(path.F)
    s = np.sqrt(np.r_[0, d])
    F[:, 2] += CubicSpline(s, np.r_[0, path.Ec])(s[1:], 1) / (2 * s[1:])
    table = {"d": d.tolist(), "F": F.tolist()}
    if path.uz[0] is not None:
        table["uz"] = path.uz
    return table


def in_depth(d, values, at):
    """Smooth curve through (0, 0) and (d, values), evaluated at `at` >= 0: cubic spline in the root of the depth."""
    values = np.asarray(values, float)
    zero = np.zeros((1, *values.shape[1:]))
    return CubicSpline(np.sqrt(np.r_[0, d]), np.concatenate([zero, values]))(np.sqrt(np.clip(at, 0, None)))


@lru_cache(maxsize=1)
def load():
    """FILE -> {place: (ln(mu D1), list of splines in the root of the depth)}; "uz": the same for the marks."""
    rows = json.loads(FILE.read_text())
    return {place: prepared([r for r in rows if r["place"] == place], "F") for place in LINES} | {
        "uz": prepared([r for r in rows if "uz" in r], "uz")
    }


def prepared(rows, key):
    """Rows of one place, sorted -> (ln(mu D1), splines through (0, 0))."""
    rows = sorted(rows, key=lambda r: r["muD1"])
    splines = []
    for r in rows:
        y = np.asarray(r[key], float)
        splines.append(CubicSpline(np.sqrt(np.r_[0, r["d"]]), np.concatenate([np.zeros((1, y.shape[1])), y])))
    return np.log([r["muD1"] for r in rows]), splines


def across(x, y, at):
    """Interpolating spline in ln(mu D1), at most cubic."""
    return make_interp_spline(x, y, k=min(3, len(x) - 1))(at)


def null_curve(place, muD1, d):
    """f(mu D1, d) at depths d >= 0 -> (n, 3), the force over mu; off the top by ratio to the top's Fz."""
    table, s = load(), np.sqrt(np.clip(d, 0, None))
    x, splines = table["top"]
    top = across(x, np.array([c(s) for c in splines]), np.log(muD1))
    if place == "top":
        return top
    far, s1 = table[place], np.sqrt(np.clip(d, 0.1, None))
    ratio = []
    for ln, c in zip(*far, strict=True):
        base = across(x, np.array([t(s1)[:, 2] for t in splines]), ln)
        ratio.append(c(s1) / base[:, None])
    return across(far[0], np.array(ratio), np.log(muD1)) * top[:, 2:]


def null_profile(muD1, d):
    """Vertical displacement of the marks at depths d -> (n, 13), mm."""
    x, splines = load()["uz"]
    return across(x, np.array([c(np.sqrt(np.clip(d, 0, None))) for c in splines]), np.log(muD1))


if __name__ == "__main__":
    build()
