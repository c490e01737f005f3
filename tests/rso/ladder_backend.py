"""A backend in closed form with a ladder of laws: how a ball's force stiffens with depth, the more the higher the law.

    F = mu · 12 √3 u^{3/2} · Q(mu D1) · shape(u),   Q = (6 + c)/(6 + 4c)

`linear` has shape 1 − u/8, `neo` 1 + 0.05 u, `stiff` 1 + 0.05 u + (C20/mu) u², `vain` 1 + 0.05 u + 1e-4 (C01/mu) u,
`lossy` has no answer.  The closed form is shape 1.  N, mm, MPa; settings: `error` is the stated relative error,
`spring` (N/mm) a force that no parameter declares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.contract import Case, Parameter, Programme, Response, SimulationFailed, drop_neutral, knob, parameters_of

LAWS = ("linear", "neo", "stiff", "vain", "lossy")
C = 0.04  # mu D1 of the simple levels


@dataclass(frozen=True)
class Knobs:
    """Every knob."""

    mu: float = knob("shear modulus", "MPa", 1e-6, 1e3)
    D1: float = knob("compressibility", "1/MPa", 1e-6, 1e6)
    C20: float = knob("stiffening", "MPa", -1e3, 1e3, neutral=0.0)
    C01: float = knob("hardly anything", "MPa", -1e3, 1e3, neutral=0.0)
    grip: float = knob("lift of the force", "1", 0.0, 1.0, neutral=0.0, plausible=(0.0, 0.5), group="grip")


def force(u: Any, law: str, mu: float, D1: float, C20: float = 0.0, C01: float = 0.0, grip: float = 0.0) -> np.ndarray:
    """Fz (N) at depths u (mm)."""
    u = np.asarray(u, float)
    c = mu * D1
    shape = {
        "hertz": 1 + 0 * u,
        "linear": 1 - u / 8,
        "neo": 1 + 0.05 * u,
        "stiff": 1 + 0.05 * u + C20 / mu * u**2,
        "vain": 1 + 0.05 * u + 1e-4 * C01 / mu * u,
    }[law]
    return 12 * np.sqrt(3) * mu * u**1.5 * (6 + c) / (6 + 4 * c) * shape * (1 + grip * u**2 / 16)


@dataclass(frozen=True)
class Laws:
    """Backend of `rso.contract`."""

    name: str = "laws"
    numerics: int = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return parameters_of(Knobs)

    @property
    def channels(self) -> Mapping[str, str]:
        return {"time": "s", "travel": "mm", "Fz": "N"}

    def levels(self, settings: Mapping[str, Any]) -> Any:
        return (
            ({"name": "hertz", "closed_form": True, "hold": {"D1": C}},),
            ({"name": "linear", "settings": {"law": "linear"}, "hold": {"D1": C}},),
            ({"name": "neo", "settings": {"law": "neo"}},),
            (
                {"name": "vain", "settings": {"law": "vain"}, "open": {"C01": (0.0, 0.5)}, "extends": "neo"},
                {"name": "stiff", "settings": {"law": "stiff"}, "open": {"C20": (0.0, 0.1)}, "extends": "neo"},
            ),
        )

    def closed_form(self, values: Mapping[str, float], case: Case) -> Response:
        u = np.array(case.programme.asked_mm)
        return Response({"time": u, "travel": u, "Fz": force(u, "hertz", values["mu"], values["D1"])}, self.channels)

    def start(self, case: Case, travel: np.ndarray, force: np.ndarray) -> Mapping[str, tuple[float, float, float]]:
        mu = float(force[-1] / (12 * np.sqrt(3) * travel[-1] ** 1.5) * (6 + 4 * C) / (6 + C))
        return {"mu": (mu / 2, mu, 2 * mu), "D1": (0.1 * C / mu, C / mu, 10 * C / mu)}

    def check(self, case: Case) -> None:
        law = case.settings.get("law", "neo")
        if unknown := sorted(set(case.settings) - {"law", "error", "spring"}):
            raise ValueError(f"unknown settings {unknown}")
        if law not in LAWS:
            raise ValueError(f"law = {law!r}; choose from {', '.join(LAWS)}")

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        programme = Programme.ramp(case.programme.asked_mm)
        return drop_neutral(self.parameters, values), Case(case.name, programme, case.settings)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        return {}

    def make(self, recipe: str) -> bytes:
        raise ValueError("no artefacts")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        law = case.settings.get("law", "neo")
        if law == "lossy":
            raise SimulationFailed("instability", "no equilibrium beyond 1 mm")
        u = np.array(case.programme.asked_mm)
        F = force(u, law, **values) + float(case.settings.get("spring", 0.0)) * u
        error = {"Fz": float(case.settings.get("error", 0.0)) * F}
        return Response({"time": u, "travel": u, "Fz": F}, self.channels, error)


BACKEND = Laws()
