"""From noise-free curves of the specimen to the files of one laboratory: test plan, measurement chain, noise.

Recorded depth = true depth - offset + compliance Fz; Fz recorded = gain Fz + bias + drift t; Fx recorded += cross Fz;
lag is a first-order filter of all channels, tau dF/dt + F = F_true. Depths are positions on the recorded scale, so
the true depth is solved for.
"""

import json
import os
from pathlib import Path

import library
import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy.interpolate import PchipInterpolator

SPEED = 0.5  # mm/s
DEEP = 5.5
MARKS = np.arange(-30.0, 31.0, 5.0)
PLACES = {"20_0": (20.0, 0.0), "2.5_2.5": (2.5, 2.5)}
SEMI_AXES = (60.0, 35.0)  # the second one is that of y and of z
COLLAR = 2.0  # mm, radius of what holds the ball


def plan(deep=DEEP):
    """Tests in the order they are done: (name, repeat, place, speed mm/s, recorded depth grid, direction)."""
    up = np.round(np.arange(0, 4.05, 0.1), 10)
    tests = [("mp_load", k, "top", SPEED, up) for k in range(1, 6)]
    tests += [(f"mp_cycle_{v}", 0, "top", v / 60, np.r_[up, up[-2::-1]]) for v in (10, 30, 100)]
    tests += [("mp_deep", 0, "top", SPEED, np.round(np.arange(0, deep + 0.05, 0.1), 10))]
    tests += [("point_2.5_2.5", 0, "2.5_2.5", SPEED, up), ("point_20_0", 0, "20_0", SPEED, up)]
    return tests


def branches(grid):
    """True where the sphere moves down (the turning point belongs to the way down)."""
    return np.r_[True, np.diff(grid) > 0]


class Mechanics:
    """Force on the indenter over mu at true depths, of every test; null curves unless `tables` say otherwise.

    tables: {(test, branch): {"d": (n,), "F": (n, 3)}} with test a name, a place ("top", "20_0") or "reload",
    "after_deep"; branch "load" or "unload". What is missing at (2.5, 2.5) and (20, 0) is transferred from the top by
    the ratio of the forces with and without the effect (see README). turned: what misalignment and tilt change at
    each place, see `solve.turned`; the same for every other effect.
    """

    def __init__(self, muD1, tables=None, additive=False, turned=None):
        self.muD1, self.tables, self.additive, self.turned = muD1, tables or {}, additive, turned or {}

    def null(self, place, d):
        """Null force over mu at the place, (n, 3)."""
        return library.null_curve(place, self.muD1, d)

    def _table(self, keys, d):
        for key in keys:
            if key in self.tables:
                t = self.tables[key]
                if key[1] == "unload":
                    order = np.argsort(t["d"])
                    F = PchipInterpolator(np.array(t["d"])[order], np.array(t["F"])[order])(np.clip(d, 0, max(t["d"])))
                else:
                    F = library.in_depth(t["d"], t["F"], d) if "F0" not in t else self._adhesive(t, d)
                return np.where((np.asarray(d) > 0)[:, None], F, 0.0)
        return None

    @staticmethod
    def _adhesive(t, d):
        start = np.array([[0.0, 0.0, t["F0"]]])
        return start + library.in_depth(t["d"], np.array(t["F"]) - start, d)

    def top(self, test, repeat, branch, d):
        """Force at the top."""
        if ("reload", "load") in self.tables and not (test == "mp_load" and repeat == 1):  # softened to 4 mm
            soft = self._table([("reload", "load")], np.clip(d, 0, 4.0))
            virgin = self.null("top", d)
            return np.where((np.asarray(d) > 4.0)[:, None], virgin, soft)
        keys = [(test, branch)] + ([("mp_cycle_30", "load")] if branch == "load" else [])
        keys += [("top", branch), ("top", "load")]
        F = self._table(keys, d)
        return self.null("top", d) if F is None else F

    def force(self, test, repeat, place, branch, d):
        """Force over mu, (n, 3), at true depths d of one branch."""
        d = np.asarray(d, float)
        if place == "top":
            return self.top(test, repeat, branch, d)
        own = self._table([(place, branch)], d)
        if own is not None:
            return own
        null = self.null(place, d)
        if ("reload", "load") in self.tables:  # softening stays where it was made
            if place == "20_0":
                return null
            ratio = self._ratio(self._table([("after_deep", "load")], d), d)
            return null * ratio
        if self.additive:
            return null + (self.top(test, repeat, branch, d) - self.null("top", d)) * [0, 0, 1]
        ratio = self._ratio(self.top(test, repeat, branch, d), d)
        side = np.ones((len(d), 3))
        far = self._table([("20_0", "load")], np.clip(d, 0.3, None))
        if far is not None:  # how the effect turns the force at (20, 0), and how it softens the support there
            near = self.null("20_0", np.clip(d, 0.3, None))
            side[:, :2] = ((far[:, 0] / far[:, 2]) / (near[:, 0] / near[:, 2]))[:, None]
            drop = (far[:, 2] / near[:, 2]) / np.clip(
                self._ratio(self.top(test, repeat, branch, np.clip(d, 0.3, None)), d), 0.05, None
            )[:, 0]
            side *= (1 + (drop - 1) * 2 * (2.5 / 20) ** 2)[:, None]
        return null * ratio * side

    def _ratio(self, F, d):
        return (F[:, 2] / np.maximum(self.null("top", np.clip(d, 1e-3, None))[:, 2], 1e-9))[:, None]

    def profile(self, d):
        """Vertical displacement of the marks at depths d, (n, 13)."""
        change = self.turned.get("top")
        return self._straight_profile(d) + (library.in_depth(change["d"], change["uz"], d) if change else 0.0)

    def _straight_profile(self, d):
        for key in (("mp_cycle_30", "load"), ("top", "load")):
            if key in self.tables and self.tables[key].get("uz"):
                t = self.tables[key]
                return library.in_depth(t["d"], t["uz"], d)
        return library.null_profile(self.muD1, d)


def turned(mechanics, F, place, d):
    """The force with the sphere displaced or the specimen turned: Fz ratio(d), and its lean Flateral/Fz + lean(d)."""
    if place not in mechanics.turned:
        return F
    change = mechanics.turned[place]
    at = np.clip(d, 0, change["deepest"])
    ratio, lean = polyval(at, change["ratio"]), polyval(at, change["lean"]).T
    F = F * ratio[:, None]
    return np.column_stack([F[:, :2] + lean * F[:, 2:], F[:, 2]])


def surface(place):
    """Height of the unmodified surface below the top, mm, and its steepest slope."""
    a, c = SEMI_AXES
    x, y = PLACES.get(place, (0.0, 0.0))
    z = c * np.sqrt(1 - (x / a) ** 2 - (y / c) ** 2)
    return c - z, float(np.hypot(c * c * x / (a * a), y) / z)


def true_depth(force, recorded, offset, compliance, scale=1.0, lint=0.0, lint_force=1.0):
    """Solve d - offset + compliance Fz(d) + lint (1 - exp(-Fz(d)/lint_force)) = recorded (Fz grows with d)."""
    low, high = np.full(len(recorded), -1.0), recorded * scale + abs(offset) + 1.0
    for _ in range(45):
        mid = 0.5 * (low + high)
        Fz = force(mid)[:, 2] if compliance or lint else np.zeros(len(mid))
        value = mid / scale - offset + (compliance * Fz if compliance else 0.0)
        if lint:
            value = value + lint * (1 - np.exp(-Fz / lint_force))
        low, high = np.where(value < recorded, mid, low), np.where(value < recorded, high, mid)
    return 0.5 * (low + high)


def clean_test(mechanics, mu, test, index, chain, clock, peak=4.0, span=1500.0):
    """Noise-free record of one test: time, recorded depth, force (n, 3) and true depth; clock in s since the start.

    peak (mm) is the deepest travel of the tests at the top but the deep one, span (s) what the plan takes.
    """
    name, repeat, place, speed, grid = test
    t = np.r_[0.0, np.cumsum(np.abs(np.diff(grid)))] / speed
    down = branches(grid)
    offset = chain.get("offset", 0.0) + (chain["offsets"][index] if "offsets" in chain else 0.0)
    compliance = chain.get("compliance", 0.0)
    if "rocking" in chain:
        x, y = PLACES.get(place, (0.0, 0.0))
        compliance += chain["rocking"] * (x * x + y * y) / 400
    if "set" in chain:  # what stays from deeper tests at the place; none before the first
        deepest = 0.0 if index == 0 else {"top": peak, "2.5_2.5": DEEP, "20_0": 0.0}[place]
        offset -= chain["set"] * deepest * (1.0 if place == "top" else 0.6)
    source = "20_0" if chain.get("swapped_file") and place == "2.5_2.5" else place
    source = "2.5_2.5" if chain.get("swapped_file") and place == "20_0" else source
    stiff = 1 + chain.get("temperature", 0.0) * (clock + t) / span
    scale = 1 + chain.get("depth_scale", 0.0)
    travel = grid + screw_error(grid, place, chain) if "screw_error" in chain else grid
    lint = chain.get("lint", 0.0), chain.get("lint_force", 1.0)

    def pressed(yielded):
        F, true = np.zeros((len(grid), 3)), np.zeros(len(grid))
        for branch, mask in (("load", down), ("unload", ~down)):
            if not mask.any():
                continue

            def force(d, branch=branch, mask=mask):
                raw = mechanics.force(name, repeat, source, branch, np.clip(d, 0, None))
                if chain.get("wrong_point") and place == "20_0":
                    w = (chain["wrong_point"] / 20) ** np.array([1.0, 1.0, 2.0])
                    raw = mechanics.null("top", np.clip(d, 0, None)) * (1 - w) + raw * w
                raw = turned(mechanics, raw, source, np.clip(d, 0, None))
                return mu * np.where((d > 0)[:, None], raw, 0.0) * stiff[mask][:, None]

            extra = 0.0
            if branch == "unload":
                extra = -chain.get("backlash", 0.0) - chain.get("set", 0.0) * peak * (index == 0)
            true[mask] = true_depth(force, (travel - yielded)[mask], offset + extra, compliance, scale, *lint)
            F[mask] = force(true[mask])
        return F, true

    F, true = pressed(np.zeros(len(grid)))
    for _ in range(20 if "glue" in chain else 0):  # what the mount has given way by then; contracts by glue dF/dd
        F, true = pressed(lagged(t, chain["glue"] * F[:, 2:], chain["glue_time"])[:, 0])
    if "stick_slip" in chain:
        phase = (true / chain["stick_slip_period"]) % 1.0
        F = F * (1 - chain["stick_slip"] * (phase - 0.5))[:, None]
    if "tear" in chain:
        F = F * intact(name, place, true, chain)[:, None]
    if "recovery" in chain:
        F = F * recovered(index, place, chain)
    if "collar" in chain:
        F = F * collar(place, true, chain)[:, None]
    if "poroelastic" in chain:
        F = F + overstress(t, true, F, chain["poroelastic"], chain["poroelastic_time"])
        F = np.where(F[:, 2:] < 0, 0.0, F)  # the sphere lifts off
    if "parallel_spring" in chain:
        F[:, 2] = F[:, 2] + chain["parallel_spring"] * grid
    if "cell_hysteresis" in chain:
        F[:, 2] = F[:, 2] + cell_loop(F[:, 2], down, chain["cell_hysteresis"])
    if "nonlinear_cell" in chain:
        F[:, 2] = F[:, 2] + chain["nonlinear_cell"] * F[:, 2] ** 2
    if "lag" in chain:
        F = lagged(t, F, chain["lag"])
    if "clipping" in chain:
        F[:, 2] = np.minimum(F[:, 2], chain["clip_at"])
    if "hum" in chain:
        F = F + chain["hum"] * np.sin(2 * np.pi * (t + 0.37 * index) / chain["hum_period"])[:, None]
    Fz = F[:, 2].copy()
    F[:, 0] += chain.get("cross_x", 0.0) * Fz
    F[:, 1] += chain.get("cross_y", 0.0) * Fz
    F[:, 2] = chain.get("gain", 1.0) * Fz + chain.get("bias", 0.0) + chain.get("drift", 0.0) * t
    return t, grid, F, true


def screw_error(depth, place, chain):
    """True less recorded travel of a screw whose error is a sine of its position, the same on the way back.

    The position is that of the machine: the surface beside the top is lower, so contact is at another phase there.
    """
    turn = 2 * np.pi / chain["screw_pitch"]
    contact = turn * surface(place)[0] + chain["screw_phase"]
    return chain["screw_error"] * (np.sin(contact + turn * depth) - np.sin(contact))


def intact(name, place, true, chain):
    """Share of the force that a tear in the deep run leaves: at once beyond its depth, for good within its reach."""
    if name == "mp_deep":
        return 1 - chain["tear"] * (true > chain["tear_depth"])
    return np.full(len(true), 1 - (0.6 * chain["tear"] if place == "2.5_2.5" else 0.0))


def recovered(index, place, chain):
    """Share of the force that is back after the rest before a test; the place far away has not been touched before."""
    reach = {"top": 1.0, "2.5_2.5": 0.6, "20_0": 0.0}[place] * (index > 0)
    return 1 - chain["recovery"] * reach * np.exp(-chain["recovery_rests"][index] / chain["recovery_time"])


def collar(place, true, chain):
    """Factor on the force once the ball's holder touches: like a second ball; on a slope its upper side is first."""
    beyond = np.maximum(true - chain["collar_depth"] + COLLAR * surface(place)[1], 0.0)
    return 1 + chain["collar"] * beyond**1.5


def overstress(t, true, F, share, time):
    """ds/dt = share dF/dt - s/tau, tau = time d/4 mm (contact area over diffusivity), s(0) = 0; F is the drained force.

    Exact for F linear and d constant between the samples. share is 1 - 2 nu of the drained solid.
    """
    s = [np.zeros(F.shape[1])]
    for k in range(1, len(t)):
        h, tau = t[k] - t[k - 1], max(time * 0.5 * (true[k] + true[k - 1]) / 4.0, 1e-9)
        left = np.exp(-h / tau)
        s.append(s[-1] * left + share * (F[k] - F[k - 1]) * tau / h * (1 - left))
    return np.array(s)


def cell_loop(Fz, down, share):
    """What a cell with hysteresis shows too much on the way back: share of the peak at half of it, 0 at both ends."""
    peak = max(Fz.max(), 1e-12)
    x = np.clip(Fz / peak, 0, 1)
    return np.where(down, 0.0, share * peak * 4 * x * (1 - x))


def lagged(t, F, tau, sub=40):
    """First-order filter tau y' + y = F, y(0) = F(0), exact for F linear between the samples."""
    y = [F[0]]
    for k in range(1, len(t)):
        h = t[k] - t[k - 1]
        slope = (F[k] - F[k - 1]) / h
        y.append(F[k] - tau * slope + np.exp(-h / tau) * (y[-1] - F[k - 1] + tau * slope))
    return np.array(y)


def clean(mechanics, mu, chain, deep=DEEP):
    """All noise-free records [(test, (t, depth, F, true))] in the order of the tests."""
    chain = dict(chain)
    if "clipping" in chain:
        bare = {k: v for k, v in chain.items() if k != "clipping"}
        chain["clip_at"] = chain["clipping"] * max(r[2][:, 2].max() for _, r in clean(mechanics, mu, bare, deep))
    records, clock = [], 0.0
    for index, test in enumerate(plan(deep)):
        records.append((test, clean_test(mechanics, mu, test, index, chain, clock)))
        clock += records[-1][1][0][-1] + 60.0
    return records


def noisy(record, rng, noise, jitter):
    """Add noise: gain per test, white or coloured force noise, depth noise, contact jitter (shifts the force)."""
    t, depth, F, _ = record
    rate = np.abs(np.gradient(depth, t))
    rate = np.maximum(rate, 0.5 * np.median(rate))  # at the turn the central difference of the depth is 0
    slope = np.gradient(F, t, axis=0) / rate[:, None] if jitter else 0.0
    F = (F + jitter * slope * np.sign(np.gradient(depth, t))[:, None]) * (1 + noise["repeat_gain"] * rng.normal())
    e = rng.normal(size=F.shape)
    if noise["rho"]:
        for k in range(1, len(e)):
            e[k] = noise["rho"] * e[k - 1] + np.sqrt(1 - noise["rho"] ** 2) * e[k]
    return t, depth + noise["depth_mm"] * rng.normal(size=len(depth)), F + noise["force_N"] * e


def write(folder, mechanics, mu, chain, rng, noise, nominal, deep=DEEP):
    """Write CSVs and nominal.json of one case; returns the noise-free records."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    records = clean(mechanics, mu, chain, deep)
    files = {}
    for test, record in records:
        jitter = float(rng.uniform(0, noise["jitter_mm"]))
        t, d, F = noisy(record, rng, noise, jitter)
        if chain.get("spikes"):
            hit = rng.uniform(size=F.shape) < chain["spikes"]
            F = F + hit * rng.normal(0, 0.05, F.shape)
        head = "time_s,depth_mm,Fx_N,Fy_N,Fz_N"
        rows = [f"{a:.3f},{b:.4f},{f[0]:.5f},{f[1]:.5f},{f[2]:.5f}" for a, b, f in zip(t, d, F, strict=True)]
        if test[1]:
            head, rows = "repeat," + head, [f"{test[1]}," + r for r in rows]
        files.setdefault(test[0], [head]).extend(rows)
    first = records[0][1]
    at = np.array([1.0, 2.0, 3.0, 4.0])
    uz = mechanics.profile(np.interp(at, first[1], first[3]))
    files["profile"] = ["depth_mm,x_mm,y_mm,uz_mm"] + [
        f"{d:g},{x:g},5,{u + noise['profile_mm'] * rng.normal():.4f}"
        for d, row in zip(at, uz, strict=True)
        for x, u in zip(MARKS, row, strict=True)
    ]
    for name, lines in files.items():
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    (folder / "nominal.json").write_text(json.dumps(nominal, indent=1) + "\n")
    for path in (*folder.iterdir(), folder):
        os.utime(path, (1767225600, 1767225600))  # the same time for every case
    return records


def signal(records, D1, mu, noise, null=library.null_curve):
    """Size of the effect over the noise after re-fit of mu, D1, gains and contact offsets; and where it stands out.

    sqrt(min chi^2) of the noise-free records against the null curves, gains and contact offsets of
    each curve fitted with their noise as priors by Gauss-Newton. About 3 is hardly visible; the null gives nearly zero.
    null(place, mu D1, d) is the unmodified force over mu.
    Returns (signal, [{"experiment", "channel", "share of chi^2"}] largest first).
    """

    def model(p, k, test, depth):
        return np.exp(p[0]) * unmodified(test[2], p[1], depth + p[2 + 2 * k]) * (1 + p[3 + 2 * k])

    def unmodified(place, ln, d):
        return null(place, np.exp(np.clip(ln, np.log(0.008), np.log(1.5))), np.clip(d, 0, None))

    n = len(records)
    p = np.r_[np.log(mu), np.log(mu * D1), np.zeros(2 * n)]
    step = np.r_[1e-3, 1e-2, np.full(2 * n, 1e-4)]
    chi = np.inf
    for _ in range(6):
        blocks, rows = [], []
        for k, (test, (_, depth, F, _)) in enumerate(records):
            f = model(p, k, test, depth)
            J = np.zeros((3 * len(depth), len(p)))
            for j in (0, 1, 2 + 2 * k, 3 + 2 * k):
                q = p.copy()
                q[j] += step[j]
                J[:, j] = ((model(q, k, test, depth) - f) / step[j]).T.ravel()
            slope = np.abs(J[2 * len(depth) :, 2 + 2 * k])
            sd = np.sqrt(noise["force_N"] ** 2 + np.outer([0, 0, 1], noise["depth_mm"] * slope) ** 2)
            blocks.append((F.T - f.T) / sd)
            rows.append(J / sd.ravel()[:, None])
        each = np.tile([1.0 / noise["jitter_mm"], 1.0 / noise["repeat_gain"]], n)
        prior = np.diag(np.r_[0.1, 0.1, each])  # sd 10 for ln mu and ln mu D1
        r = np.concatenate([*(b.ravel() for b in blocks), -prior[2:] @ p])
        chi = min(chi, float(np.sqrt(r @ r)))
        J = np.concatenate([*rows, prior[2:]])
        move = np.linalg.lstsq(J, r, rcond=None)[0]
        p = p + np.clip(move, -0.5, 0.5)
    share = {}
    for (test, _), b in zip(records, blocks, strict=True):
        for channel, part in zip(("Fx", "Fy", "Fz"), b, strict=True):
            key = (test[0], channel)
            share[key] = share.get(key, 0.0) + float(part @ part)
    total = max(sum(share.values()), 1e-12)
    best = sorted(share.items(), key=lambda kv: -kv[1])[:5]
    return chi, [{"experiment": e, "channel": c, "share": round(v / total, 3)} for (e, c), v in best]
