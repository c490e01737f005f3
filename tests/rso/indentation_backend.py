"""A whole backend in closed form for tests of whole studies: a sphere on a bonded layer, with mischief on request.

Settings: `thickness` (mm); `fail_below` and `crash_above` (MPa) make runs with a smaller or larger mu end badly;
`spring` (N/mm) adds a force with a constant that no parameter declares, which breaks similarity; `sleep_s`; `log`
names a file to which every call adds a line; `lateral` makes Fx that share of Fz (else Fx is noise about zero, as by
symmetry); `speed` has no influence.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso.benchmarks import indentation
from rso.contract import Case, Parameter, Programme, Response, SimulationFailed, drop_neutral, knob, parameters_of

SETTINGS = ("thickness", "fail_below", "crash_above", "spring", "sleep_s", "log", "lateral", "speed", "remark")


@dataclass(frozen=True)
class Knobs:
    """Every knob of this backend."""

    mu: float = knob("shear modulus", "MPa", 1e-5, 10.0)
    D1: float = knob("compressibility, D1 = 2/K", "1/MPa", 0.0, 1e6, neutral=0.0)
    radius: float = knob("radius of the sphere", "mm", 0.5, 20.0, default=3.0)


def force(mu: float, D1: float, h: np.ndarray, thickness: float, radius: float = 3.0) -> np.ndarray:
    """What the backend computes, for synthetic measurements."""
    return indentation(h, mu, D1, radius, thickness)


@dataclass(frozen=True)
class Layer:
    """Backend of `rso.contract`."""

    name: str = "layer"
    numerics: int = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return parameters_of(Knobs)

    @property
    def channels(self) -> Mapping[str, str]:
        return {"time": "s", "travel": "mm", "Fx": "N", "Fz": "N", "uz_max": "mm"}

    def check(self, case: Case) -> None:
        if unknown := sorted(set(case.settings) - set(SETTINGS)):
            raise ValueError(f"unknown settings {unknown}; choose from {', '.join(SETTINGS)}")
        if not float(case.settings.get("thickness", 8.0)) > 0:
            raise ValueError(f"thickness = {case.settings['thickness']} mm must be positive")

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        settings = {k: v for k, v in case.settings.items() if k != "speed"}
        programme = Programme.ramp(case.programme.asked_mm)  # the speed does not matter here
        return drop_neutral(self.parameters, values), Case(case.name, programme, settings)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        return {}

    def make(self, recipe: str) -> bytes:
        raise ValueError("no artefacts")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        s, mu, D1, radius = case.settings, values["mu"], values.get("D1", 0.0), values.get("radius", 3.0)
        if "log" in s:
            with open(s["log"], "ab", buffering=0) as file:  # short appends are atomic, also across kill -9
                file.write(f"{mu!r} {D1!r}\n".encode())
        time.sleep(s.get("sleep_s", 0.0))
        if mu < s.get("fail_below", 0.0):
            raise SimulationFailed("inversion", f"too soft: mu = {mu:.3g} MPa")
        if mu > s.get("crash_above", np.inf):
            raise ZeroDivisionError("a bug for stiff bodies")
        h = np.array(case.programme.asked_mm)
        F = force(mu, D1, h, s.get("thickness", 8.0), radius) + s.get("spring", 0.0) * h
        sunk = -h * (0.9 + 0.1 * mu * D1 / (1 + mu * D1))
        Fx = s["lateral"] * F if "lateral" in s else 1e-13 * np.sin(1e7 * mu * h)
        channels = {"time": 2 * h, "travel": h, "Fx": Fx, "Fz": F, "uz_max": sunk}
        return Response(channels, self.channels, {"Fz": 1e-4 * F})


BACKEND = Layer()
