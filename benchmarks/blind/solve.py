"""Finite-element tables of one case: which runs an effect needs and what they give.

Everything is over mu. Elastic effects: one loading run at the top (quarter model), one at (20, 0) (half model) where
the effect acts differently there. Viscosity and friction: load-unload cycles at the three speeds (at one speed for
friction), the deep run continued from 4 mm. Softening: the virgin run gives the field of the largest energy; reloading
and unloading are runs with that field frozen. Misalignment and tilt: two runs at every place, with and without, on the
same elements around the contact; only their ratio and difference are used.
"""

import body
import fe
import library
import ngsolve as ng
import numpy as np
from scipy.interpolate import PchipInterpolator

UNLOAD = (3.7, 3.2, 2.6, 2.0, 1.5, 1.0, 0.7, 0.45, 0.25, 0.1)
DEEP_TAIL = tuple(d for d in fe.DEEP_DEPTHS if d > 4)
BREAK = 0.004  # of the force; a reading beyond 4 mm further off the smooth curve is not used
HALF, WHOLE = 0.9, 1.1  # mm, elements of the models of a displaced sphere or a turned specimen
FAR = {"fibre", "friction", "bowl", "blob_ratio", "axes", "weight"}  # act differently at (20, 0): own run there


def run(experiment, path, **options):
    """Follow a path; what was reached when it fails beyond 4 mm is good enough."""
    try:
        return experiment.press(path, **options)
    except fe.NotConverged as error:
        reached = getattr(error, "reached", None)
        if reached is None or not reached.d or max(reached.d) < 4:
            raise
        return reached


def tables(muD1, changes):
    """Model changes (see `fe.Model`) -> tables for `experiment.Mechanics`, facts {"deepest": mm}."""
    ng.SetNumThreads(1)
    model = fe.Model(muD1=muD1, **changes)
    out, deepest = softened(model) if model.mullins else hard(model, muD1, changes)
    done = set()
    for (place, _), table in out.items():  # the same meshes as the library's, hence the same factor
        if id(table) not in done:
            done.add(id(table))
            d = np.array(table["d"])
            factor = library.correction(place if place == "20_0" else "top", muD1, d)
            table["F"] = (np.array(table["F"]) * factor[:, None]).tolist()
    return out, {"deepest": float(deepest)}


def hard(model, muD1, changes):
    """Tables of a model without softening, and the depth reached."""
    out = {}
    if model.prony:
        deepest = viscous(model, out)
    elif model.friction:
        deepest = rubbing(model, out)
    else:
        start = (0.01,) if model.adhesion else ()
        path = run(fe.Experiment(model), [(2 * d, d) for d in (*start, *fe.DEEP_DEPTHS)], profile=True)
        out["top", "load"] = unbroken(library.as_table(path), model.muD1)
        deepest = out["top", "load"]["d"][-1]
        if model.adhesion:
            table = out["top", "load"]
            table["F0"] = float(table["F"][0][2])  # jump into contact
            for column in table.values():
                if isinstance(column, list):
                    del column[0]
    if FAR & set(changes):
        far = fe.replace(model, line=(20.0, 0.0), prony=())
        path = run(fe.Experiment(far), [(2 * d, d) for d in fe.POINT_DEPTHS])
        out["20_0", "load"] = library.as_table(path)
        if model.prony:  # relaxation as at the top, depth by depth
            ratio = relaxation(out["mp_cycle_30", "load"], muD1, changes)
            out["20_0", "load"]["F"] = (np.array(out["20_0", "load"]["F"]) * ratio(path.d)[:, None]).tolist()
    return out, deepest


def turned(muD1, offset=(0.0, 0.0), tilt=(0.0, 0.0), places=("top", "20_0", "2.5_2.5"), h=None):
    """What a sphere displaced by `offset` (mm) and a specimen turned by `tilt` (rad, about x, then y) change.

    {place: {"ratio": of Fz with and without, (2,); "lean": change of (Fx, Fy)/Fz, (2, 2); "deepest": mm}}, the former
    two as polynomials of the depth; at the top also "d" and "uz", change of the profile. Both runs have the same
    elements around the contact (of size h: HALF or WHOLE), so that what the mesh is worth drops out.
    """
    ng.SetNumThreads(1)
    out = {}
    for place in places:
        top, line = place == "top", np.array(library.LINES[place])
        path = [(2 * d, d) for d in (fe.DEEP_DEPTHS if top else fe.POINT_DEPTHS)]
        old = fe.Model(muD1=muD1, line=tuple(line))
        new = fe.replace(old, line=tuple(line + offset), tilt=tuple(tilt))
        sym = body.symmetry(new)
        first = fe.Experiment(old, sym=sym, h=h or (WHOLE if sym == "full" else HALF))
        before = run(first, path, profile=top)
        turn = body.turning(body.beneath(old), body.beneath(new))
        after = run(fe.Experiment(new, mesh=first.mesh, sym=sym, turn=turn), path, profile=top)
        n = min(len(before.d), len(after.d))
        out[place] = change(before, after, *(body.first_contact(m) for m in (old, new)))
        if top:
            out[place] |= {"d": after.d[:n], "uz": np.array(after.uz[:n]) - np.array(before.uz[:n])}
    return out


def change(before, after, at_first, at_first_after):
    """Polynomials of `turned` from two paths and their first contacts (normal, mean curvature).

    For d -> 0 the force is Hertz's, Fz ~ n_z^2.5 (1/R + H)^-0.5, along the normal.
    """
    n = min(len(before.d), len(after.d))
    F, G = (np.array(library.as_table(p)["F"])[:n] for p in (before, after))
    (a, H), (b, K) = at_first, at_first_after
    d = np.array(before.d[:n])
    ratio = (b[2] / a[2]) ** 2.5 * ((1 / 3 + H) / (1 / 3 + K)) ** 0.5
    lean = b[:2] / b[2] - a[:2] / a[2]
    return {
        "ratio": straight(d, G[:, 2:] / F[:, 2:], [ratio])[:, 0],
        "lean": straight(d, (G / G[:, 2:] - F / F[:, 2:])[:, :2], lean),
        "deepest": float(d[-1]),
    }


def straight(d, y, start, coarse=1.0):
    """Coefficients of start + b d through y (n, k) by least squares, (2, k); depths below `coarse` are left out.

    The ring of contact is not resolved there, and the limit is known.
    """
    d, y = d[d >= coarse], y[d >= coarse]
    return np.vstack([start, d @ (y - start) / (d @ d)])


def unbroken(table, muD1):
    """The table without what lies at and beyond the first break beyond 4 mm, see `breaks`."""
    d = np.array(table["d"])
    off = breaks(d, np.array(table["F"])[:, 2] / library.raw("top", muD1, d)[:, 2])
    bad = np.flatnonzero((d > 4) & (np.abs(off) > BREAK))
    keep = bad[0] if len(bad) else len(d)
    return {k: v[:keep] if isinstance(v, list) else v for k, v in table.items()}


def breaks(d, ratio):
    """How far each ratio to the unmodified force lies off the parabola in d through the three before, relative, (n,).

    The nodes are half a millimetre apart or less: a force that is smooth in the depth leaves well below 1e-3.
    """
    off = np.zeros(len(d))
    for k in range(3, len(d)):
        a, b, c = d[k - 3 : k]
        x = d[k]
        w = [(x - b) * (x - c) / ((a - b) * (a - c)), (x - a) * (x - c) / ((b - a) * (b - c))]
        w.append(1 - w[0] - w[1])
        off[k] = ratio[k] / np.dot(w, ratio[k - 3 : k]) - 1
    return off


def relaxation(table, muD1, changes):
    """Ratio of the viscous to the elastic force at the top as a function of the depth."""
    elastic = {k: v for k, v in changes.items() if k != "prony"}
    path = run(fe.Experiment(fe.Model(muD1=muD1, **elastic)), [(2 * d, d) for d in fe.TOP_DEPTHS])
    return lambda d: np.interp(d, path.d, np.array(table["F"])[: len(path.d), 2] / np.array(path.F)[:, 2])


def cycle(model, speed, out, key, deep=False):
    """Load to 4 mm (then deeper from a copy of the state, when `deep`), unload; fills `out`; returns the depth."""
    e = fe.Experiment(model)
    up = run(e, [(d / speed, d) for d in fe.TOP_DEPTHS], profile=deep)
    out[key, "load"] = library.as_table(up)
    deepest = 4.0
    kept = e.snapshot()
    start = (4 / speed, 4.0)
    down = e.press([((8 - d) / speed, d) for d in UNLOAD], start=start)
    d = np.array([0.0, *down.d[::-1], 4.0])
    F = np.array([[0.0, 0.0, 0.0], *down.F[::-1], up.F[-1]])
    F[:, 2] += PchipInterpolator(d, [0.0, *down.Ec[::-1], up.Ec[-1]])(d, 1) * (d > 0)
    F[-1] = out[key, "load"]["F"][-1]
    out[key, "unload"] = {"d": d.tolist(), "F": F.tolist()}
    if deep:
        e.restore(kept)
        try:
            tail = e.press([(d / speed, d) for d in DEEP_TAIL], start=start)
        except fe.NotConverged as error:
            tail = error.reached
        for name in ("t", "d", "F", "Ec"):
            getattr(up, name).extend(getattr(tail, name))
        up.uz = [None]
        out["mp_deep", "load"] = unbroken(library.as_table(up), model.muD1)
        deepest = out["mp_deep", "load"]["d"][-1]
    return deepest


def viscous(model, out):
    """Cycles at 10, 30 and 100 mm/min."""
    for v in (10, 100):
        cycle(model, v / 60, out, f"mp_cycle_{v}")
    return cycle(model, 0.5, out, "mp_cycle_30", deep=True)


def rubbing(model, out):
    """Friction knows no speed: one cycle serves all."""
    deepest = cycle(model, 0.5, out, "mp_cycle_30", deep=True)
    for v in (10, 100):
        out[f"mp_cycle_{v}", "load"] = out["mp_cycle_30", "load"]
        out[f"mp_cycle_{v}", "unload"] = out["mp_cycle_30", "unload"]
    return deepest


def softened(model):
    """Tables "reload" (after 4 mm) and "after_deep" (after 5.5 mm) with frozen fields of the largest energy."""
    virgin = fe.replace(model, mullins=None)
    e = fe.Experiment(virgin)
    run(e, [(2 * d, d) for d in fe.TOP_DEPTHS])
    after4 = e.largest_energy()
    try:
        deepest = e.press([(2 * d, d) for d in DEEP_TAIL if d <= 5.5], start=(8.0, 4.0)).d[-1]
    except fe.NotConverged as error:
        deepest = [4.0, *error.reached.d][-1]
    after6 = e.largest_energy()
    out = {}
    for key, field in (("reload", after4), ("after_deep", after6)):
        soft = fe.Experiment(model, mesh=e.mesh, wmax=field)
        out[key, "load"] = library.as_table(run(soft, [(2 * d, d) for d in fe.TOP_DEPTHS]))
    return out, deepest
