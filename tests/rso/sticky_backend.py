"""A ball that sticks to a half-space by Johnson, Kendall and Roberts (1971): a backend of two knobs.

a³ = (3R/4E*) (F + 3πwR + √(6πwRF + (3πwR)²)),  δ = a²/R − √(2πwa/E*),   E* = 4 mu;  no force beyond the jump-off.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rso.contract import Case, Parameter, Response, knob, parameters_of


@dataclass(frozen=True)
class Knobs:
    """Both."""

    mu: float = knob("shear modulus", "MPa", 1e-5, 10.0)
    adhesion: float = knob("work of adhesion", "N/mm", 1e-12, 1.0)


def force(mu: float, w: float, depth: np.ndarray, R: float = 2.0) -> np.ndarray:
    """Force (n,) N on the way back at depths (n,) mm."""
    stiff, least = 4.0 * mu, -1.5 * np.pi * w * R
    F = np.concatenate([np.linspace(least / 1.8, least, 800), least * np.linspace(1.0, -400.0, 200_000)[1:]])
    root = np.sqrt(np.maximum(6.0 * np.pi * w * R * F + (3.0 * np.pi * w * R) ** 2, 0.0))
    sign = np.where(np.arange(len(F)) < 800, -1.0, 1.0)
    a = (0.75 * R / stiff * (F + 3.0 * np.pi * w * R + sign * root)) ** (1.0 / 3.0)
    d = a**2 / R - np.sqrt(2.0 * np.pi * w * a / stiff)
    k = int(np.argmin(d))
    return np.where(depth < d[k], 0.0, np.interp(depth, d[k:], F[k:]))


@dataclass(frozen=True)
class Sticky:
    """The ball; it has no settings."""

    name: str = "sticky"
    numerics: int = 1
    parameters: tuple[Parameter, ...] = parameters_of(Knobs)
    channels: Mapping[str, str] = field(default_factory=lambda: {"time": "s", "travel": "mm", "Fz": "N"})

    def check(self, case: Case) -> None:
        """All is well."""

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """As they are."""
        return dict(values), case

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """No artefacts."""
        return {}

    def make(self, recipe: str) -> bytes:
        """Never asked for."""
        raise ValueError(recipe)

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Force at the asked moments."""
        t = np.array(case.programme.asked_s)
        u = np.interp(t, case.programme.time_s, case.programme.travel_mm)
        F = force(values["mu"], values["adhesion"], u)
        return Response({"time": t, "travel": u, "Fz": F}, self.channels, {"Fz": np.full_like(F, 1e-12)})


BACKEND = Sticky()
