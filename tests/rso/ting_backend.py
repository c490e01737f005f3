"""A ball on a viscoelastic, incompressible half-space, there and back: a backend of a modulus and one Prony term.

F(t) = 16/3 √R ∫₀^{t₁} μ(t − ξ) d(u^{3/2}),   ∫_{t₁}^t μ(t − ξ) du = 0 on the way back, t₁ = t on the way there;
μ(t) = mu (1 − g + g e^{−t/τ}).  Source: T. C. T. Ting, J. Appl. Mech. 33 (1966) 845, eqs. 20 and 32.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from sticky_backend import Sticky

from rso.contract import Case, Parameter, Response, knob, parameters_of

R, N = 3.0, 400  # mm, steps of the integrals


@dataclass(frozen=True)
class Relaxing:
    """All three."""

    mu: float = knob("initial shear modulus", "MPa", 1e-5, 10.0)
    g: float = knob("relaxing share of the shear modulus", "1", 0.0, 0.95)
    tau: float = knob("relaxation time", "s", 1e-3, 1e4)


def force(mu: float, g: float, tau: float, time: np.ndarray, way: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Force (n,) N at times (n,) of a way: its corners in time and travel."""
    knots = np.unique(np.concatenate([np.linspace(0.0, way[0][-1], N), way[0], time]))
    u = np.interp(knots, *way)
    top, out = int(np.argmax(u)), np.zeros(len(time))
    for k, t in enumerate(time):
        n = int(np.searchsorted(knots, t)) + 1
        weight = relaxed(mu, g, tau, t - 0.5 * (knots[: n - 1] + knots[1:n]))
        grown = np.append(0.0, np.cumsum(weight * np.diff(u[:n] ** 1.5)))
        left = np.append(np.cumsum((weight * np.diff(u[:n]))[::-1])[::-1], 0.0)  # from each knot to t
        t1 = t if n <= top + 1 else np.interp(0.0, -left[: top + 1], knots[: top + 1])
        out[k] = 16.0 / 3.0 * np.sqrt(R) * np.interp(t1, knots[:n], grown)
    return out


def relaxed(mu: float, g: float, tau: float, t: np.ndarray) -> np.ndarray:
    """μ(t) in MPa."""
    return mu * (1.0 - g + g * np.exp(-t / tau))


@dataclass(frozen=True)
class Ting(Sticky):
    """The ball; it has no settings either."""

    name: str = "ting"
    parameters: tuple[Parameter, ...] = parameters_of(Relaxing)

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """The force at the asked moments."""
        p = case.programme
        time = np.array(p.asked_s) if p.asked_s else np.interp(p.asked_mm, p.travel_mm, p.time_s)
        way = np.array(p.time_s), np.array(p.travel_mm)
        channels = {
            "time": time,
            "travel": np.interp(time, *way),
            "Fz": force(values["mu"], values["g"], values["tau"], time, way),
        }
        return Response(channels, self.channels, {"Fz": np.full(len(time), 1e-12)})


BACKEND = Ting()
