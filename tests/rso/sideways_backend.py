"""A ball off the top in closed form, without derivatives: a force along x beside that along z.

    Fz = 8 mu √3 u^{3/2} (1 + 0.35 u/(1 + 5q))/(1 + q/2) (1 + c u),   Fx = Fz x/60 (1 + q/5),   q = mu D1

N, mm, MPa; settings: `x` (mm), `deaf` = a depth (mm) beyond which only the first values asked for have an answer.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from rso.contract import Case, Parameter, Programme, Response, SimulationFailed, drop_neutral

MU, D1 = 0.01, 20.0


def force(u: Any, mu: float = MU, D1: float = D1, c: float = 0.0) -> np.ndarray:
    """Fz (N) at depths u (mm)."""
    u, q = np.asarray(u, float), mu * D1
    return 8 * mu * np.sqrt(3) * u**1.5 * (1 + 0.35 * u / (1 + 5 * q)) / (1 + q / 2) * (1 + c * u)


def sideways(u: Any, x: float, mu: float = MU, D1: float = D1) -> np.ndarray:
    """Fx (N)."""
    return force(u, mu, D1) * x / 60 * (1 + mu * D1 / 5)


@dataclasses.dataclass(frozen=True)
class Sideways:
    """Backend of `rso.contract`."""

    name: str = "sideways"
    numerics: int = 1
    parameters: tuple[Parameter, ...] = (
        Parameter("mu", "shear modulus", "MPa", 1e-5, 10.0, None),
        Parameter("D1", "compressibility", "1/MPa", 1e-3, 1e5, None),
    )
    first: list[float] = dataclasses.field(default_factory=list)

    @property
    def channels(self) -> Mapping[str, str]:
        return {"Fz": "N", "Fx": "N", "time": "s", "travel": "mm"}

    def check(self, case: Case) -> None:
        """Any."""

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        programme = Programme.ramp(case.programme.asked_mm)
        return drop_neutral(self.parameters, values), Case(case.name, programme, case.settings)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        return {}

    def make(self, recipe: str) -> bytes:
        raise ValueError("no artefacts")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        u, x = np.array(case.programme.asked_mm), float(case.settings.get("x", 0.0))
        if u.max() > float(case.settings.get("deaf", np.inf)):
            self.first.append(values["mu"])
            if values["mu"] != self.first[0]:
                raise SimulationFailed("instability", "only the first")
        F = force(u, values["mu"], values["D1"])
        side = sideways(u, x, values["mu"], values["D1"])
        return Response({"time": u, "travel": u, "Fz": F, "Fx": side}, self.channels)


BACKEND = Sideways()
