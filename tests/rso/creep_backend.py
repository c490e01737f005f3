"""A backend for tests: a ball on a half-space of a standard solid (Lee & Radok 1960), pressed by travel or by force.

x = (16/3) √R δ^{3/2} obeys F + τ F′ = μ (1 − g) x + τ μ x′ while the contact grows.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.optimize import brentq

from rso.contract import Response, SimulationFailed, drop_neutral, knob, parameters_of

RADIUS = 3.0
SIZE = 16.0 / 3.0 * np.sqrt(RADIUS)


@dataclasses.dataclass(frozen=True)
class Knobs:
    mu: float = knob("shear modulus", "MPa", 1e-6, 10.0)
    g: float = knob("relaxing share", "1", 0.0, 0.95, neutral=0.0, group="relaxation", plausible=(0.03, 0.8))
    tau: float = knob("relaxation time", "s", 1e-6, 1e6, default=5.0, group="relaxation", plausible=(0.3, 100.0))


Y, W = (0.5 * v for v in np.polynomial.legendre.leggauss(40))
Y = Y + 0.5  # from 0 to 1


def loading(t: float, speed: float, mu: float, g: float, tau: float) -> float:
    """Force (N) of a ramp of travel: μ (x − g/τ ∫ exp(−(t − s)/τ) x ds), s = t y² for a smooth integrand."""
    s = t * Y**2
    past = float(np.sum(W * 2.0 * t * Y * np.exp(-(t - s) / tau) * (speed * s) ** 1.5))
    return float(mu * SIZE * ((speed * t) ** 1.5 - g / tau * past))


def crept(since: np.ndarray, x: float, force: float, mu: float, g: float, tau: float) -> np.ndarray:
    """Depths (mm) since a force was reached at x, while it is held."""
    last = force / (mu * (1.0 - g))
    return ((last + (x - last) * np.exp(-since * (1.0 - g) / tau)) / SIZE) ** (2.0 / 3.0)


def ramped(force: float, rate: float, mu: float, g: float, tau: float) -> float:
    """x at the end of a ramp of force: ∫ J dF, J = (1 − g exp(−(1 − g) t/τ))/(μ (1 − g))."""
    t, k = force / rate, (1.0 - g) / tau
    return rate * (t - g * -np.expm1(-k * t) / k) / (mu * (1.0 - g))


class Backend:
    """See the module."""

    name, numerics = "creep", 1
    parameters = parameters_of(Knobs)
    channels = {"time": "s", "travel": "mm", "Fz": "N"}  # noqa: RUF012
    force = True

    def controls_force(self, settings):
        return self.force

    def check(self, case):
        if set(case.settings) - {"speed", "unload"}:
            raise ValueError(f"unknown setting {sorted(case.settings)[0]!r}; choose from speed")

    def canonical(self, values, case):
        return drop_neutral(self.parameters, values), case

    def recipes(self, values, case):
        return {}

    def make(self, recipe):
        raise ValueError("no artefacts")

    def relaxes(self, values, settings):
        return values.get("g", 0.0) > 0.0

    def __call__(self, values, case):
        mu, g, tau = values["mu"], values.get("g", 0.0), values.get("tau", 5.0)
        p = case.programme
        if p.segments:
            there, rest = p.segments
            if there.control == "travel":
                met = lambda t: loading(t, there.rate, mu, g, tau) - there.to_N  # noqa: E731
                if met(1e4 / there.rate) < 0.0:
                    raise SimulationFailed("step_limit", "the force is not met")
                came = brentq(met, 1e-9, 1e4 / there.rate, xtol=1e-13)
                x = SIZE * (there.rate * came) ** 1.5
            else:
                came, x = there.to_N / there.rate, ramped(there.to_N, there.rate, mu, g, tau)
            since = np.array([0.0, *rest.asked_s])
            depth = crept(since, x, there.to_N, mu, g, tau)
            return Response(
                {"time": came + since, "travel": depth, "Fz": np.full(len(since), there.to_N)}, self.channels
            )
        speed = p.travel_mm[1] / p.time_s[1]
        u = np.array(p.asked_mm)
        F = np.array([loading(v / speed, speed, mu, g, tau) for v in u])
        return Response({"time": u / speed, "travel": u, "Fz": F}, self.channels)


BACKEND = Backend()


class OfTravel(Backend):
    """The same without force control."""

    name, force = "travel alone", False


TRAVEL_ALONE = OfTravel()


def reached(force: float, speed: float, mu: float, g: float, tau: float) -> float:
    """When (s) a ramp of travel has reached a force."""
    return float(brentq(lambda t: loading(t, speed, mu, g, tau) - force, 1e-9, 1e4, xtol=1e-13))


def record(
    mu=0.01, g=0.45, tau=6.0, speed=0.1, force=8e-3, lasts=60.0, seed=0, white=2e-4, control="travel", segments=True
):
    """Rows of a file: loading, then the hold at a force; noise of the depth (mm) and a tenth of that in N."""
    rng = np.random.default_rng(seed)
    if control == "travel":
        came = reached(force, speed, mu, g, tau)
        t = np.linspace(came / 60.0, came, 60)
        u, F, x = speed * t, np.array([loading(v, speed, mu, g, tau) for v in t]), SIZE * (speed * came) ** 1.5
    else:
        came = 4.0
        t = np.linspace(came / 60.0, came, 60)
        F = force * t / came
        u = np.array([(ramped(f, force / came, mu, g, tau) / SIZE) ** (2.0 / 3.0) for f in F])
        x = ramped(force, force / came, mu, g, tau)
    since = np.linspace(0.1, lasts, 300)
    rows = [*zip(t, u, F, ["loading"] * 60, strict=True)]
    rows += [*zip(came + since, crept(since, x, force, mu, g, tau), np.full(300, force), ["creep"] * 300, strict=True)]
    head = "time_s,depth_mm,Fz_N" + ",segment" * segments + "\n"
    noise = rng.standard_normal((len(rows), 2)) * (white, 0.1 * white)
    return head + "".join(
        f"{a:.6f},{b + p:.7f},{c + q:.8f}" + f",{s}" * segments + "\n"
        for (a, b, c, s), (p, q) in zip(rows, noise, strict=True)
    )
