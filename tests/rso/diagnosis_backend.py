"""A body in closed form with effects of every kind, for tests of the diagnosis: a run takes well below a millisecond.

    F_z = μ u^1.5 [1 + 0.1 κ/(1 + κ) u] · place · effects,     κ = μ D1

Settings: `point` (mm; besides the top a curve is softer, and Fx and Fy show), `support` ('held' or 'loose'), `profile`,
`earlier` (mm) as in the finite elements, `fail` names a knob whose largest sizes have no answer (anywhere, or with
`fail_all` at any size), `log` a file to which every call adds a line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rso.contract import (
    Case,
    Parameter,
    Programme,
    Response,
    SimulationFailed,
    drop_neutral,
    knob,
    parameters_of,
    run_key,
)
from rso.data import Measurement, Noise, Repeat
from rso.discrepancy import Base, BaseAxis, Effect, Experiment, catalogue
from rso.evaluation import Task
from rso.evaluation.store import Done, Failed

SETTINGS = ("point", "support", "profile", "earlier", "fail", "fail_all", "log", "speed", "unload", "mesh")
FAILS_FROM = 0.7  # of the largest plausible size


@dataclass(frozen=True)
class Knobs:
    """Every knob of this backend."""

    mu: float = knob("shear modulus", "MPa", 1e-5, 10.0)
    D1: float = knob("compressibility", "1/MPa", 0.0, 1e6, default=60.0)
    stiff: float = knob("stiffening with depth", "1", 0.0, 5.0, neutral=0.0, plausible=(0.02, 1.0))
    twin: float = knob("stiffening that looks the same", "1", 0.0, 5.0, neutral=0.0, plausible=(0.02, 1.0))
    skin: float = knob("stiffness of a skin", "1", 0.01, 100.0, neutral=1.0, plausible=(0.2, 5.0))
    g: float = knob("relaxing share", "1", 0.0, 0.9, neutral=0.0, group="relaxation", plausible=(0.03, 0.6))
    tau: float = knob("relaxation time", "s", 1e-3, 1e3, default=3.0, group="relaxation", plausible=(0.5, 30.0))
    soften: float = knob("softening below the deepest travel", "1", 0.0, 0.9, neutral=0.0, plausible=(0.03, 0.6))
    tilt: float = knob("tilt about y", "deg", -20.0, 20.0, neutral=0.0, plausible=(-6.0, 6.0))
    shift: float = knob("misalignment in x", "mm", -50.0, 50.0, neutral=0.0, scope="place", plausible=(-1.5, 1.5))
    radius_error: float = knob("error of the radius", "mm", -1.0, 1.0, neutral=0.0, plausible=(-0.3, 0.3))
    clearance: float = knob("play of the support", "mm", 0.0, 10.0, default=1.0, group="loose", plausible=(0.2, 4.0))


PARAMETERS = parameters_of(Knobs)
PLAUSIBLE = {p.name: p.plausible for p in PARAMETERS}


def elastic(values: Mapping[str, float], u: np.ndarray, point=(0.0, 0.0), support: str = "held") -> np.ndarray:
    """Fz, Fx, Fy (3, …) of loading without relaxation at travels u (mm)."""
    v = {p.name: p.default if p.default is not None else p.neutral for p in PARAMETERS} | dict(values)
    κ, x = v["mu"] * v["D1"], (point[0] + v["shift"]) / 10.0
    bent = v["stiff"] * (1 + 0.2 * v["stiff"]) * (u / 8) * (1 - 0.3 * x) + v["twin"] * (u / 8.1) ** 1.02
    skin = 1 + 0.2 * np.log(v["skin"]) * np.exp(-u / 1.2) * (1 + 0.5 * x)
    loose = 1.0 - (support == "loose") * 0.3 * (1 - np.exp(-v["clearance"])) * np.exp(-u / (1 + 4 * x))
    place = 1 - 0.2 * x + 0.05 * x * κ / (1 + κ)
    F = v["mu"] * u**1.5 * (1 + 0.1 * κ / (1 + κ) * u) * (1 + bent) * skin * loose * place
    F = F * np.sqrt(1 + v["radius_error"] / 3)
    return np.stack([F, F * (0.15 * x + np.sin(np.radians(v["tilt"]))), F * 0.02 * x])


def along(
    values: Mapping[str, float], time: np.ndarray, travel: np.ndarray, earlier: float = 0.0, **place
) -> np.ndarray:
    """Fz, Fx, Fy (3, n) along a dense way (n,) in time and travel, with softening and relaxation.

    F(t) = ∫₀^{t₁} R(t − s) dF_e(s), R(t) = 1 − g (1 − e^{−t/τ}), summed interval by interval; t₁ = t until the ball
    turns and then when contact was as large, ∫_{t₁}^t R(t − s) du(s) = 0 (Ting, J. Appl. Mech. 33 (1966) 845).
    """
    F = elastic(values, travel, **place)
    soften, g, tau = values.get("soften", 0.0), values.get("g", 0.0), values.get("tau", 3.0)
    deepest = np.maximum(np.maximum.accumulate(travel), earlier)
    softer = 1 - soften * (1 - travel / np.maximum(deepest, 1e-12))
    if g:
        top = int(np.argmax(travel >= travel.max() - 1e-12))
        du, dF, middle = np.diff(travel), np.diff(F, axis=1), 0.5 * (time[1:] + time[:-1])
        relaxed = np.zeros_like(F)
        for i, t in enumerate(time[1:], 1):
            R, n = 1 - g * -np.expm1(-(t - middle[:i]) / tau), i
            if i > top:
                since = np.cumsum((R * du[:i])[::-1])[::-1]  # ∫ from the beginning of each interval on
                n = int(np.argmax(since <= 0.0))  # contact is lost where it is that of the first
                share = since[n - 1] / (since[n - 1] - since[n]) if n else 0.0
                relaxed[:, i] = share * R[n - 1] * dF[:, n - 1] if n else 0.0
                n = max(n - 1, 0)
            relaxed[:, i] += dF[:, :n] @ R[:n]
        F = relaxed
    return F * softer


def way(programme: Programme) -> tuple[np.ndarray, np.ndarray]:
    """A dense (time, travel) through a programme with every asked passage in it."""
    T, U = np.array(programme.time_s), np.array(programme.travel_mm)
    t = [np.linspace(T[0], T[-1], 241), np.concatenate([T, programme.asked_s])]
    for a, b, p, q in zip(T[:-1], T[1:], U[:-1], U[1:], strict=True):
        inside = np.array([x for x in programme.asked_mm if min(p, q) <= x <= max(p, q)])
        t.append(a + (b - a) * (inside - p) / (q - p) if p != q else np.empty(0))
    t = np.unique(np.concatenate([t[0], t[1], *t[2:]]).round(12))
    return t, np.interp(t, T, U)


@dataclass(frozen=True)
class Toy:
    """Backend of `rso.contract`."""

    name: str = "diagnosis toy"
    numerics: int = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return PARAMETERS

    @property
    def channels(self) -> Mapping[str, str]:
        return {"time": "s", "travel": "mm", "Fx": "N", "Fy": "N", "Fz": "N"}

    def variants(self, settings: Mapping[str, object]) -> Mapping[str, Mapping[str, object]]:
        if settings.get("support") == "loose":
            return {"held": {"settings": {"support": "held"}, "group": "", "description": "held instead of loose"}}
        return {"loose": {"settings": {"support": "loose"}, "group": "loose", "description": "loose instead of held"}}

    def check(self, case: Case) -> None:
        if unknown := sorted(set(case.settings) - set(SETTINGS)):
            raise ValueError(f"unknown settings {unknown}; choose from {', '.join(SETTINGS)}")

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        v = drop_neutral(PARAMETERS, values)
        settings = {k: s for k, s in case.settings.items() if k not in ("speed", "unload")}
        programme = case.programme
        if "g" not in v:
            v.pop("tau", None)
            if "soften" not in v:
                settings.pop("earlier", None)
                programme = Programme.ramp(programme.asked_mm, 1.0)
        if settings.get("support") != "loose":
            v.pop("clearance", None)
        return v, Case(case.name, programme, settings)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        return {}

    def make(self, recipe: str) -> bytes:
        raise ValueError("no artefacts")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        s = case.settings
        if "log" in s:
            with open(s["log"], "ab", buffering=0) as file:
                file.write(b"run\n")
        if name := s.get("fail"):
            p = next(p for p in PARAMETERS if p.name == name)
            far = max(abs(v - p.neutral) for v in p.plausible)
            size = abs(values.get(name, p.neutral) - p.neutral)
            if size > (0.0 if s.get("fail_all") else FAILS_FROM * far):
                raise SimulationFailed("contact", f"{name} = {values[name]:g} is too much")
        time, travel = way(case.programme)
        place = {"point": s.get("point", (0.0, 0.0)), "support": s.get("support", "held")}
        F = along(values, time, travel, s.get("earlier", 0.0), **place)
        goal = np.array(case.programme.asked_mm)
        asked = np.isin(travel.round(9), goal.round(9)) | np.isin(time.round(9), np.round(case.programme.asked_s, 9))
        t, u, F = time[asked], travel[asked], F[:, asked]
        very = goal[np.argmin(np.abs(u[:, None] - goal), axis=1)]
        u = np.where(np.abs(u - very) < 1e-8, very, u)  # both passages have the very travel asked
        channels = {"time": t, "travel": u, "Fz": F[0], "Fx": F[1], "Fy": F[2]}
        marks = {f"uz({x:g},{y:g})": mark(values, u, x, y) for x, y in s.get("profile", ())}
        error = {c: 1e-3 * np.abs(F[0]) for c in ("Fx", "Fy", "Fz")}
        return Response({**channels, **marks}, {**self.channels, **dict.fromkeys(marks, "mm")}, error)


def mark(values: Mapping[str, float], u: np.ndarray, x: float, y: float) -> np.ndarray:
    """uz (mm) of a surface mark at travel u: less far away, deeper where a skin is stiff."""
    far = np.exp(-(x**2 + y**2) / (60.0 + 20 * np.log(values.get("skin", 1.0))))
    return -far * (0.4 * u + 0.02 * values.get("mu", 0.01) * values.get("D1", 60.0) * u)


BACKEND = Toy()


# ------------------------------------------------------------------------------------------- a laboratory with it


def run(tasks: Sequence[Task], backend: Toy = BACKEND) -> list[Done | Failed]:
    """Outcomes in this process; equal runs once."""
    known: dict[str, Done | Failed] = {}
    out = []
    for task in tasks:
        values, case = backend.canonical(task.values, task.case)
        key = run_key(backend, values, case)
        if key not in known:
            try:
                known[key] = Done(key, values, case, backend(values, case), 0.0, 0.0)
            except SimulationFailed as error:
                known[key] = Failed(key, values, case, error.cause, error.reason, error.partial)
        out.append(known[key])
    return out


TRUTH = {"mu": 0.012, "D1": 60.0}
WHITE = 1e-3  # N
SCATTER = 0.01  # of the gain, test to test
STATED = Noise(Fz=WHITE, gain=SCATTER)


def recorded(
    truth: Mapping[str, float],
    rng: np.random.Generator,
    *,
    peak: float = 4.0,
    speed: float = 0.5,
    unload: bool = False,
    point: tuple[float, float] = (0.0, 0.0),
    support: str = "held",
    repeats: int = 1,
    white: float = WHITE,
    scatter: float = SCATTER,
    earlier: float = 0.0,
    offset: float = 0.0,
    compliance: float = 0.0,
    bias: float = 0.0,
    drift: float = 0.0,
    each_offset: float = 0.0,
    lateral: bool = False,
    readings: int = 84,
    hold: float = 0.0,
    pace: float = 1.0,
) -> tuple[Repeat, ...]:
    """Repeats as a laboratory records them, the chain written out by hand; `hold` s of rest at the end of a loading,
    `pace` times as fast on the way back."""
    found = []
    for k in range(repeats):
        zero = offset + each_offset * rng.standard_normal()
        far = peak
        for _ in range(30):  # the record, not the body, reaches the peak
            far = peak + zero - compliance * float(elastic(truth, np.array(far), point, support)[0])
        t, u = np.linspace(0, far / speed, 500), np.linspace(0, far, 500)
        if hold:
            t, u = np.append(t, t[-1] + np.linspace(0, hold, 1001)[1:]), np.append(u, np.full(1000, far))
        if unload:
            t, u = np.append(t, t[-1] + np.linspace(0, far / speed / pace, 500)[1:]), np.append(u, u[498::-1])
        F = along(truth, t, u, max(earlier, peak if k else 0.0), point=point, support=support)
        gain = 1 + scatter * rng.standard_normal()
        force = {"Fz": gain * F[0] + bias + drift * t, "Fx": gain * F[1], "Fy": gain * F[2]}
        depth = u - zero + compliance * F[0]
        at = np.linspace(len(t) / readings, len(t) - 1, readings * (2 if unload else 1)).astype(int)
        channels = {c: v[at] + white * rng.standard_normal(len(at)) for c, v in force.items() if lateral or c == "Fz"}
        top = int(np.argmax(depth[at]))
        segment = np.where(np.arange(len(at)) <= top, "loading", "unloading")
        if hold:
            home = np.linspace(1500, len(t) - 1, readings if unload else 0)
            at = np.concatenate([np.linspace(6, 499, readings), np.linspace(500, 1499, readings), home]).astype(int)
            channels = {c: v[at] + white * rng.standard_normal(len(at)) for c, v in force.items() if c in channels}
            segment = np.where(at < 500, "loading", np.where(at < 1500, "hold", "unloading"))
        found.append(Repeat(str(k + 1), depth[at], t[at], channels, {}, segment))
    return tuple(found)


def experiment(
    name: str,
    repeats: tuple[Repeat, ...],
    *,
    role: str = "fit",
    point=(0.0, 0.0),
    support: str = "held",
    speed: float = 0.5,
    noise: Noise = STATED,
    after: tuple[str, ...] = (),
    **settings: object,
) -> Experiment:
    """An experiment of the diagnosis around such repeats."""
    kind = "profile" if "x" in repeats[0].channels else "force"
    measurement = Measurement(Path(name), kind, repeats, ())
    channels = tuple(c for c in ("Fz", "Fx", "Fy", "uz") if c in repeats[0].channels)
    where = {"point": list(point), "support": support, **settings}
    return Experiment(name, role, measurement, noise, channels, where, speed, after=after)


def laboratory(truth: Mapping[str, float], seed: int, validate: bool = False, **chain: float) -> list[Experiment]:
    """Repeats at the top, two cycles at different speeds, another point with three channels, a deep curve."""
    rng = np.random.default_rng(seed)
    deep, first = "validate" if validate else "fit", ("load",)
    return [
        experiment("load", recorded(truth, rng, repeats=4, **chain)),
        experiment("slow", recorded(truth, rng, speed=0.1, unload=True, earlier=4.0, **chain), speed=0.1, after=first),
        experiment("fast", recorded(truth, rng, speed=2.0, unload=True, earlier=4.0, **chain), speed=2.0, after=first),
        experiment("deep", recorded(truth, rng, peak=6.0, earlier=4.0, **chain), role=deep, after=first),
        experiment("side", recorded(truth, rng, point=(10.0, 0.0), lateral=True, **chain), point=(10.0, 0.0)),
    ]


def base(axes: bool = True, low: float = 0.006, high: float = 0.024, **fixed: float) -> Base:
    """The base model with μ open, and κ = μ D1 if `axes`."""
    κ = (BaseAxis("D1", "1/MPa", 0.2, 3.0, True, -1),) if axes else ()
    held = {} if axes else {"D1": 60.0}
    return Base(BACKEND, "mu", (low * high) ** 0.5, low, high, κ, {**held, **fixed}, {})


def effects(*names: str, support: str = "held") -> tuple[Effect, ...]:
    """The catalogue, or those of it."""
    found = catalogue(BACKEND, {"support": support}, {}, ("mu", "D1"))
    return tuple(e for e in found if not names or e.name in names)
