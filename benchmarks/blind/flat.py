"""A slab or a puck under a ball, of a laboratory that records Fz at one place: what differs from the ellipsoid's round.

The chain, its noise and the rules are those of `experiment.py`, `catalogue.py` and `generate.py`; here are the bodies,
the test plan, the tables of forces by `flat_fe.py`, and the effects whose sizes are other ones on a body this small.
"""

import json
import os
from functools import lru_cache
from pathlib import Path

import catalogue
import experiment
import library
import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

FILE = Path(__file__).with_name("flat_library.json")
MU_D1 = (0.008, 0.02, 0.05, 0.13, 0.32, 0.75, 1.7)
PEAK, DEEP = 1.5, 2.2  # mm
STEP = 0.03  # mm between readings
UNLOAD = (1.4, 1.25, 1.05, 0.85, 0.65, 0.45, 0.3, 0.18, 0.08, 0.03)
SPAN = 900.0  # s of the plan with its rests
BODIES = {
    "slab": {"shape": {"shape": "slab", "thickness_mm": 6.0}, "fe": {}},
    "puck": {"shape": {"shape": "cylinder", "radius_mm": 10.0, "height_mm": 8.0}, "fe": {"width": 10.0, "height": 8.0}},
}
NOT_HERE = {  # no lateral force, no second place, no room
    *("fibre_x", "fibre_y", "inclusion_stiff", "inclusion_soft", "delta_a", "delta_b", "delta_c", "bowl"),
    *("offset_x", "offset_y", "tilt_x", "tilt_y", "cross_x", "cross_y"),
    *("swapped_file", "wrong_point", "rocking"),
}
ANSWERS = {
    "delta_thickness": {"delta_thickness"},
    "delta_height": {"delta_height"},
    "delta_radius": {"delta_radius"},
    "foundation": {"substrate_compliance"},
    "plate": {"plate_friction"},
}
LISTED = {"poroelastic": ("pore_D1",)}  # kinds outside that are in the catalogue of flat bodies
OF_BODY = {
    "slab": ("delta_thickness", "foundation", "plate"),
    "puck": ("delta_height", "delta_radius", "foundation", "plate"),
}


def single(body):
    """Names of single effects of a body."""
    return tuple(n for n in catalogue.SINGLE if n not in NOT_HERE) + OF_BODY[body]


def outside():
    """Kinds outside the catalogue that one place and one channel can show."""
    return tuple(n for n in catalogue.OUTSIDE if n not in NOT_HERE)


def draw(name, rng, body):
    """Sizes of one effect, as `catalogue.draw`; lengths are of this plan."""
    e, at = catalogue.effect, BODIES[body]["fe"]
    height, width = at.get("height", 6.0), at.get("width", 40.0)
    up, either = catalogue.log_uniform, catalogue.signed
    if name in ("delta_thickness", "delta_height"):
        size = either(rng, 0.05, 1.2)
        found = e(size, {"delta_mm": size}, {"height": height + size})
    elif name == "delta_radius":
        size = either(rng, 0.1, 2.0)
        found = e(size, {"delta_mm": size}, {"width": width + size})
    elif name == "foundation":
        size = up(rng, 0.3, 40.0)
        found = e(size, {"compliance_mm_per_MPa": size}, {"foundation_mpa": size})
    elif name == "plate":
        found = e(0.0, {"mu_plate": 0.0}, {"slips": True})
    elif name in ("skin_stiff", "skin_soft"):
        ratio = up(rng, 1.15, 6.0) if name == "skin_stiff" else 1 / up(rng, 1.15, 3.0)
        model = {"skin_ratio": ratio, "skin_thickness": up(rng, 0.15, 0.8)}
        found = e(ratio, dict(model), model)
    elif name == "cavity":
        r = up(rng, 0.4, 1.6)
        gap = up(rng, 0.7, height - 2 * r - 0.4)
        centre = [0.0, 0.0, height - gap - r]
        model = {"blob_ratio": 0.01, "blob_radius": r, "blob_centre": centre}
        found = e(r, {"ratio": 0.01, "radius_mm": r, "gap_below_surface_mm": gap}, model)
    else:
        return nearer(catalogue.draw(name, rng))
    return {"name": name} | found


def nearer(effect):
    """Depths of the ellipsoid's plan (4 mm, then to 5.5) brought into this one's (1.5, then to 2.2)."""
    chain = effect["chain"]
    if "tear_depth" in chain:
        chain["tear_depth"] = PEAK + (DEEP - PEAK) * (chain["tear_depth"] - 4.0) / 1.5
    if "collar_depth" in chain:
        chain["collar_depth"] *= DEEP / experiment.DEEP
    if "stick_slip_period" in chain:
        chain["stick_slip_period"] *= 0.5
    for ours, told in (("tear_depth", "depth_mm"), ("collar_depth", "depth_mm"), ("stick_slip_period", "period_mm")):
        if ours in chain:
            effect["truth"][told] = chain[ours]
    return effect


def plan(deep=DEEP):
    """Tests in their order, as `experiment.plan`: loading three times, cycles at three speeds, a deep run."""
    up = np.round(np.arange(0, PEAK + STEP / 2, STEP), 10)
    tests = [("mp_load", k, "top", 0.5, up) for k in range(1, 4)]
    tests += [(f"mp_cycle_{v}", 0, "top", v / 60, np.r_[up, up[-2::-1]]) for v in (10, 30, 100)]
    return [*tests, ("mp_deep", 0, "top", 0.5, np.round(np.arange(0, deep + STEP / 2, STEP), 10))]


def build():
    """Fill FILE: forces of the unmodified bodies over mu at MU_D1, run by run; can be interrupted."""
    import flat_fe as fe
    import ngsolve as ng

    ng.SetNumThreads(1)
    rows = json.loads(FILE.read_text()) if FILE.exists() else []
    for muD1 in MU_D1:
        for body, its in BODIES.items():
            if any(r["body"] == body and r["muD1"] == muD1 for r in rows):
                continue
            path = reached(fe.Meridian(fe.Flat(muD1=muD1, **its["fe"])), [(2 * d, d) for d in fe.STEPS + fe.TAIL], 2.3)
            table = library.as_table(path)
            rows.append({"body": body, "muD1": muD1, "d": table["d"], "F": [f[2] for f in table["F"]]})
            new = FILE.with_suffix(".tmp")
            new.write_text(json.dumps(rows))
            os.replace(new, FILE)
            print(body, muD1, rows[-1]["F"][-1], flush=True)


def reached(experiment, path, least=PEAK, **options):
    """Follow a path; what was reached when it fails beyond `least` (mm) is good enough."""
    import fe

    try:
        return experiment.press(path, cut=4, **options)
    except fe.NotConverged as error:
        if max(error.reached.d, default=0.0) < least - 1e-9:
            raise
        return error.reached


def hertz(muD1):
    """Limit of Fz/d^1.5 over mu for d -> 0, a ball of 3 mm on a plane."""
    K = 2 / muD1
    nu = (3 * K - 2) / (2 * (3 * K + 1))
    return 4 / 3 * 2 * (1 + nu) / (1 - nu**2) * 3.0**0.5


def in_depth(d, F, muD1, at):
    """Fz over mu at depths `at` through nodes and Hertz's limit: F/d^1.5 by a spline in the root of the depth.

    The first two nodes are left out: the ring of contact is not resolved there.
    """
    d, F = np.asarray(d)[2:], np.asarray(F)[2:]
    at = np.clip(at, 0, None)
    return CubicSpline(np.sqrt(np.r_[0, d]), np.r_[hertz(muD1), F / d**1.5])(np.sqrt(at)) * at**1.5


@lru_cache(maxsize=2)
def load(body):
    """ln(mu D1) and rows of one body."""
    rows = sorted((r for r in json.loads(FILE.read_text()) if r["body"] == body), key=lambda r: r["muD1"])
    return np.log([r["muD1"] for r in rows]), rows


def null(body, muD1, d):
    """Fz over mu of the unmodified body, (n,)."""
    x, rows = load(body)
    return library.across(x, np.array([in_depth(r["d"], r["F"], r["muD1"], d) for r in rows]), np.log(muD1))


class Mechanics:
    """Force over mu at true depths of every test, as `experiment.Mechanics`."""

    def __init__(self, body, muD1, tables=None):
        self.body, self.muD1, self.tables, self.turned = body, muD1, tables or {}, {}

    def null(self, _place, d):
        """Force of the unmodified body, (n, 3)."""
        return np.outer(null(self.body, self.muD1, np.asarray(d, float)), [0.0, 0.0, 1.0])

    @staticmethod
    def unmodified(body):
        """`library.null_curve` of the body."""
        return lambda _place, muD1, d: np.outer(null(body, muD1, d), [0.0, 0.0, 1.0])

    def force(self, test, repeat, _place, branch, d):
        """Force at true depths d of one branch, (n, 3)."""
        d = np.asarray(d, float)
        soft = ("reload", "load") in self.tables
        if soft and not (test == "mp_load" and repeat == 1):
            known = self._of(("reload", "load"), np.clip(d, 0, PEAK))
            return np.where((d > PEAK)[:, None], self.null("top", d), known)
        for key in ((test, branch), ("mp_cycle_30", "load"), ("top", "load")):
            if key in self.tables and not soft:
                return self._of(key, d)
        return self.null("top", d)

    def _of(self, key, d):
        """The table: as a ratio to the unmodified force of the same elements, but where the force starts at none."""
        t = self.tables[key]
        x, F = np.asarray(t["d"]), np.asarray(t["F"])
        if key[1] == "unload":
            Fz = PchipInterpolator(x, F)(np.clip(d, 0, x[-1]))
        elif "F0" in t:  # jump into contact
            Fz = null(self.body, self.muD1, d) + CubicSpline(
                np.sqrt(np.r_[0, x]), np.r_[t["F0"], F - null(self.body, self.muD1, x)]
            )(np.sqrt(np.clip(d, 0, None)))
        else:
            ratio = F[2:] / null(self.body, self.muD1, x[2:])
            Fz = null(self.body, self.muD1, d) * PchipInterpolator(x[2:], ratio)(np.clip(d, x[2], x[-1]))
        return np.outer(np.where(d > 0, Fz, 0.0), [0.0, 0.0, 1.0])


def tables(body, muD1, changes):
    """Model changes -> tables for `Mechanics` and facts {"deepest": mm}, the runs an effect needs."""
    import flat_fe as fe
    import ngsolve as ng

    ng.SetNumThreads(1)
    model = fe.Flat(**{"muD1": muD1, **BODIES[body]["fe"], **changes})
    out = {}

    def kept(path):
        table = library.as_table(path)
        return {"d": table["d"], "F": [f[2] for f in table["F"]]}

    def tail(e, speed):
        return reached(e, [(d / speed, d) for d in fe.TAIL], 0.0, start=(PEAK / speed, PEAK))

    def joined(a, b):
        for name in ("t", "d", "F", "Ec", "uz"):
            getattr(a, name).extend(getattr(b, name))
        return a

    if model.mullins:
        e = fe.Meridian(fe.replace(model, mullins=None))
        up = e.press([(2 * d, d) for d in fe.STEPS], cut=4)
        field = e.largest_energy()
        deepest = joined(up, tail(e, 0.5)).d[-1]
        soft = fe.Meridian(model, mesh=e.mesh, wmax=field)
        out["reload", "load"] = kept(soft.press([(2 * d, d) for d in fe.STEPS], cut=4))
        return out, {"deepest": deepest}
    if not (model.prony or model.friction):
        e = fe.Meridian(model)
        first = (0.01,) if model.adhesion else ()
        up = e.press([(2 * d, d) for d in (*first, *fe.STEPS)], cut=4)
        table = kept(joined(up, tail(e, 0.5)))
        if model.adhesion:
            table = {"F0": table["F"][0], "d": table["d"][1:], "F": table["F"][1:]}
        out["top", "load"] = table
        return out, {"deepest": table["d"][-1]}
    speeds = (10, 100, 30) if model.prony else (30,)
    for v in speeds:
        speed = v / 60
        e = fe.Meridian(model)
        up = e.press([(d / speed, d) for d in fe.STEPS], cut=4)
        state = e.snapshot()
        down = e.press([((2 * PEAK - d) / speed, d) for d in UNLOAD], start=(PEAK / speed, PEAK), cut=4)
        # the penalty's penetration is taken out along the way back, where the contact energy is that of each depth
        d = np.array([0.0, *down.d[::-1], PEAK])
        Ec = PchipInterpolator(d, [0.0, *down.Ec[::-1], up.Ec[-1]])(d, 1) * (d > 0)
        F = np.array([0.0, *[f[2] for f in down.F[::-1]], up.F[-1][2]]) + Ec
        if v == 30:
            e.restore(state)
            up = joined(up, tail(e, speed))
        out[f"mp_cycle_{v}", "load"] = kept(up)
        F[-1] = np.interp(PEAK, out[f"mp_cycle_{v}", "load"]["d"], out[f"mp_cycle_{v}", "load"]["F"])
        out[f"mp_cycle_{v}", "unload"] = {"d": d.tolist(), "F": F.tolist()}
    deepest = out["mp_cycle_30", "load"]["d"][-1]
    for v in (10, 100) if not model.prony else ():
        for branch in ("load", "unload"):
            out[f"mp_cycle_{v}", branch] = out["mp_cycle_30", branch]
    return out, {"deepest": deepest}


def clean(mechanics, mu, chain, deep=DEEP):
    """All noise-free records [(test, (t, depth, F, true))] in the order of the tests."""
    chain = dict(chain)
    if "clipping" in chain:
        bare = {k: v for k, v in chain.items() if k != "clipping"}
        chain["clip_at"] = chain["clipping"] * max(r[2][:, 2].max() for _, r in clean(mechanics, mu, bare, deep))
    records, clock = [], 0.0
    for index, test in enumerate(plan(deep)):
        record = experiment.clean_test(mechanics, mu, test, index, chain, clock, peak=PEAK, span=SPAN)
        records.append((test, record))
        clock += record[0][-1] + 100.0
    return records


def write(folder, records, chain, rng, noise, nominal):
    """Write CSVs and nominal.json of one case."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {}
    for test, record in records:
        jitter = float(rng.uniform(0, noise["jitter_mm"]))
        t, d, F = experiment.noisy(record, rng, noise, jitter)
        if chain.get("spikes"):
            F = F + (rng.uniform(size=F.shape) < chain["spikes"]) * rng.normal(0, 0.05, F.shape)
        head = "time_s,depth_mm,Fz_N"
        rows = [f"{a:.3f},{b:.4f},{f:.5f}" for a, b, f in zip(t, d, F[:, 2], strict=True)]
        if test[1]:
            head, rows = "repeat," + head, [f"{test[1]},{r}" for r in rows]
        files.setdefault(test[0], [head]).extend(rows)
    for name, lines in files.items():
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    (folder / "nominal.json").write_text(json.dumps(nominal, indent=1) + "\n")
    for path in (*folder.iterdir(), folder):
        os.utime(path, (1767225600, 1767225600))


def nominal(body, noise):
    """What the laboratory believes."""
    return {
        "specimen": BODIES[body]["shape"],
        "indenter": {"shape": "sphere", "radius_mm": 3.0},
        "support": "bonded",
        "units": "N, mm, MPa, s",
        "cycle_rates_mm_per_min": [10, 30, 100],
        "rate_mm_per_min": 30,
        "order_of_tests": "mp_load repeats 1-3, mp_cycle 10, 30, 100, mp_deep",
        "noise": noise,
    }


if __name__ == "__main__":
    build()
