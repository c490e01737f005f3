"""The smallest whole backend: a rigid sphere on an elastic half space (Hertz 1882), in closed form.

F = 4/3 E* sqrt(R) d^(3/2) (1 + s d/R),   E* = E / (1 - nu^2),   E = 9 K mu / (3 K + mu),
nu = (3 K - 2 mu) / (6 K + 2 mu),   K = 2 / D1;   the effect s ("stiffening") is 0 in Hertz' theory.

*Validity*: d << R; here d <= R.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

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
)


@dataclass(frozen=True)
class Knobs:
    """Every knob of this backend."""

    mu: float = knob("shear modulus", "MPa", 1e-5, 10.0)
    D1: float = knob("compressibility, D1 = 2/K", "1/MPa", 1e-3, 1e4, default=1.0)
    stiffening: float = knob("force grows with depth over radius", "1", 0.0, 1.0, neutral=0.0, typical=0.2)


@dataclass(frozen=True)
class Hertz:
    """Hertz' sphere; its one setting is ``radius`` (mm)."""

    name: str = "hertz"
    numerics: int = 1
    parameters: tuple[Parameter, ...] = parameters_of(Knobs)
    channels: Mapping[str, str] = field(default_factory=lambda: {"time": "s", "travel": "mm", "Fz": "N"})

    def check(self, case: Case) -> None:
        """ValueError unless the settings are exactly a positive radius."""
        if set(case.settings) != {"radius"} or not float(case.settings["radius"]) > 0:
            raise ValueError(f"settings {dict(case.settings)}: needs exactly radius > 0 mm")

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Checked values with defaults, effects at neutral dropped."""
        return drop_neutral(self.parameters, self._complete(values)), case

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """No artefacts."""
        return {}

    def make(self, recipe: str) -> bytes:
        """Never asked for."""
        raise ValueError(f"hertz makes no artefacts (recipe {recipe!r})")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Force at each passage of an asked depth; SimulationFailed deeper than the radius."""
        self.check(case)
        v = self._complete(values)
        R, K = float(case.settings["radius"]), 2.0 / v["D1"]
        time, d = passages(case.programme)
        if d.max() > R:
            raise SimulationFailed("not_supported", f"depth {d.max():g} mm exceeds the radius {R:g} mm")
        E = 9.0 * K * v["mu"] / (3.0 * K + v["mu"])
        nu = (3.0 * K - 2.0 * v["mu"]) / (6.0 * K + 2.0 * v["mu"])
        F = 4.0 / 3.0 * E / (1.0 - nu**2) * np.sqrt(R) * d**1.5 * (1.0 + v["stiffening"] * d / R)
        return Response({"time": time, "travel": d, "Fz": F}, self.channels, {"Fz": 1e-15 * F})

    def _complete(self, values: Mapping[str, float]) -> dict[str, float]:
        known = {p.name: p for p in self.parameters}
        if unknown := sorted(set(values) - set(known)):
            raise ValueError(f"unknown parameter {unknown}; choose among {list(known)}")
        if missing := [p.name for p in self.parameters if p.default is None and p.name not in values]:
            raise ValueError(f"no value for {missing}")
        return {p.name: p.check(values.get(p.name, p.default)) for p in self.parameters}


def passages(programme: Programme) -> tuple[np.ndarray, np.ndarray]:
    """Time (s) and travel (mm) at each passage of an asked travel, in order of time; a turning point counts once."""
    found = []
    t, u = programme.time_s, programme.travel_mm
    for t0, t1, u0, u1 in zip(t[:-1], t[1:], u[:-1], u[1:], strict=True):
        for a in programme.asked_mm:
            if u0 != u1 and min(u0, u1) <= a <= max(u0, u1) and (a != u0 or not found):
                found.append((t1 if a == u1 else t0 + (t1 - t0) * (a - u0) / (u1 - u0), a))
    return tuple(np.array(sorted(found)).T)


BACKEND = Hertz()
