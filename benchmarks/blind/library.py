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
MU_D1 = {
    "top": (0.13, 0.03, 0.45, 0.009, 1.3),
    "20_0": (0.13, 0.01, 1.3, 0.036, 0.41),
    "2.5_2.5": (0.13, 0.01, 1.3, 0.036, 0.41),
}
FIRST_CONTACT = {"top": (1.0, 0.01915), "20_0": (0.9806, 0.02022), "2.5_2.5": (0.9975, 0.01915)}  # n_z, mean curvature
FINE_MU_D1 = 0.2
FINE_DEPTHS = (0.15, 0.3, 0.5, 0.7, 0.9, 1.1, 1.4, 1.7, 2.0, 2.5, 3.0, 3.5, 4.0)
DEEPEST = 5.8  # mm; the deeper nodes of FILE are left aside, they hang on the mesh
LINES = {"top": (0.0, 0.0), "20_0": (20.0, 0.0), "2.5_2.5": (2.5, 2.5)}


def build():
    """Run what is missing; returns nothing, writes FILE after every run."""
    import fe
    import ngsolve as ng

    ng.SetNumThreads(1)
    rows = json.loads(FILE.read_text()) if FILE.exists() else []
    have = {(r["place"], r["muD1"]) for r in rows}

    def keep(place, muD1, path):
        rows.append({"place": place, "muD1": muD1, **as_table(path)})
        new = FILE.with_suffix(".tmp")
        new.write_text(json.dumps(rows))
        os.replace(new, FILE)
        print(place, muD1, path.d[-1], path.F[-1], flush=True)

    if ("fine", FINE_MU_D1) not in have:
        for h in (1.2, 0.85):
            experiment = fe.Experiment(fe.Model(muD1=FINE_MU_D1), h=h, order=3)
            keep("fine", FINE_MU_D1, experiment.press([(2 * d, d) for d in FINE_DEPTHS]))
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
                keep(place, values[k], path)


def as_table(path):
    """Path -> dict of lists; the penalty's penetration taken out: Fz = Fz_eps + dE_c/dd, Fx and Fy in proportion."""
    d = np.array(path.d)
    F = np.array(path.F)
    s = np.sqrt(np.r_[0, d])
    F *= (1 + CubicSpline(s, np.r_[0, path.Ec])(s[1:], 1) / (2 * s[1:]) / F[:, 2])[:, None]
    table = {"d": d.tolist(), "F": F.tolist()}
    if path.uz[0] is not None:
        table["uz"] = list(path.uz)
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
        "uz": prepared([r for r in rows if "uz" in r and r["place"] == "top"], "uz")
    }


def prepared(rows, key):
    """Rows of one place, sorted -> (ln(mu D1), splines through (0, 0))."""
    rows = sorted(rows, key=lambda r: r["muD1"])
    splines = []
    for r in rows:
        d = np.array(r["d"])
        y = np.asarray(r[key], float)[d <= DEEPEST]
        splines.append(CubicSpline(np.sqrt(np.r_[0, d[d <= DEEPEST]]), np.concatenate([np.zeros((1, y.shape[1])), y])))
    return np.log([r["muD1"] for r in rows]), splines


def across(x, y, at):
    """Interpolating spline in ln(mu D1), at most cubic."""
    return make_interp_spline(x, y, k=min(3, len(x) - 1))(at)


def hertz(place, muD1):
    """Limit of Fz/d^1.5 over mu for d -> 0: Hertz with the mean curvature at the contact, vertical travel.

    Fz = 4/3 E/(1 - nu^2) sqrt(R_e) cos^2.5(theta) d^1.5, 1/R_e = 1/R + H (nearly round contact)
    """
    K = 2 / muD1
    nu = (3 * K - 2) / (2 * (3 * K + 1))
    n, curvature = FIRST_CONTACT[place]
    return 4 / 3 * 2 * (1 + nu) / (1 - nu**2) * (1 / (1 / 3 + curvature)) ** 0.5 * n**2.5


def raw(place, muD1, d):
    """Null force over mu as the coarse elements give it, (n, 3)."""
    x, splines = load()[place]
    return across(x, np.array([c(np.sqrt(d)) for c in splines]), np.log(muD1))


@lru_cache(maxsize=1)
def fine_shape():
    """Coefficients of Fz/(d^1.5 c0) - 1 in d^(1/2, 1, 2, 3) from the cubic elements, through Hertz's limit."""
    rows = [r for r in json.loads(FILE.read_text()) if r["place"] == "fine"]
    d = np.concatenate([r["d"] for r in rows])
    g = np.concatenate([np.array(r["F"])[:, 2] for r in rows]) / d**1.5 / hertz("top", FINE_MU_D1) - 1
    weight = np.where(d < 0.4, 0, 1 / (0.001 + 0.005 / d**2))
    return np.linalg.lstsq(powers(d) * weight[:, None], g * weight, rcond=None)[0]


def powers(d):
    """Basis of `fine_shape`, (n, 4)."""
    return np.stack([d**0.5, d, d**2, d**3], 1)


def correction(place, muD1, d):
    """Factor that takes the coarse mesh out of a force computed at this place, (n,).

    At the top: cubic over coarse elements at mu D1 = FINE_MU_D1 (the ratio hardly depends on mu D1: the contact grows
    over the same elements), its value at 4 mm beyond. Off the top: the corrected curve of the top, scaled to the
    place's own limit for d -> 0 and bent by 1 + b d + e d^2 to its own elements beyond 1.2 mm.
    """
    d = np.clip(np.asarray(d, float), 0.3, None)
    if place == "top":
        at = np.clip(d, None, 4.0)
        fine = hertz("top", FINE_MU_D1) * at**1.5 * (1 + powers(at) @ fine_shape())
        return fine / raw("top", FINE_MU_D1, at)[:, 2]
    return bent(place, muD1, d) / raw(place, muD1, d)[:, 2]


def bent(place, muD1, d):
    """Smooth Fz off the top, see `correction`."""

    def scaled(at):
        top = raw("top", muD1, at)[:, 2] * correction("top", muD1, at)
        return top * hertz(place, muD1) / hertz("top", muD1)

    at = np.linspace(1.2, 4.0, 40)
    ratio = raw(place, muD1, at)[:, 2] / scaled(at) - 1
    b, e = np.linalg.lstsq(np.stack([at, at**2], 1), ratio, rcond=None)[0]
    return scaled(d) * (1 + b * d + e * d * d)


def null_curve(place, muD1, d):
    """f(mu D1, d) at depths d >= 0 -> (n, 3), the force over mu, mesh taken out; lateral from the ratio to Fz."""
    d = np.clip(np.asarray(d, float), 0, None)
    at = np.clip(d, 0.3, None)
    Fz = raw(place, muD1, at)[:, 2] * correction(place, muD1, at) * (d / at) ** 1.5
    side = raw(place, muD1, np.clip(d, 1.0, None))
    return side / side[:, 2:] * Fz[:, None]


def null_profile(muD1, d):
    """Vertical displacement of the marks at depths d -> (n, 13), mm."""
    x, splines = load()["uz"]
    return across(x, np.array([c(np.sqrt(np.clip(d, 0, None))) for c in splines]), np.log(muD1))


if __name__ == "__main__":
    build()
