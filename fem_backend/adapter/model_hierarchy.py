"""The ladder of models that this backend offers, from Hertz's closed form to the laws with one more constant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fem_backend import closed_forms
from fem_backend.indenters import INDENTERS
from fem_backend.laws import LAWS, Law
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.simulation.outputs import CHANNEL_UNITS
from rso.contract import Programme, Response

SIMPLE_MODEL_POISSON = 0.49  # of the simple levels: ν cannot be told from them
HELD_D1_MU = 3.0 * (1.0 - 2.0 * SIMPLE_MODEL_POISSON) / (1.0 + SIMPLE_MODEL_POISSON)  # D₁μ = 2μ/K at this ν
HERTZ_RANGE_FACTOR = 1.5  # what the moduli of Hertz are multiplied and divided with for a range
MIN_RANGE_POISSON, MAX_RANGE_POISSON = 0.2, 0.4999  # ν of the ends of a range of D₁


def model_levels(settings: Mapping[str, Any]) -> tuple[tuple[dict[str, Any], ...], ...]:
    """Rungs of a ladder as plain data, the levels of one rung side by side.

    Hertz → linear elastic, both with ν = 0.49 (D₁μ held) → neo-Hookean → Mooney-Rivlin, Yeoh, Ogden with one constant
    more, each as its law says.  Keys: `name`, `title`, `description`, `settings` (replace the study's), `open`
    (knob → range, moduli as shares of μ), `hold` (knob → value, moduli likewise), `closed_form`, `extends` (the level
    that it is at neutral).
    """
    material = settings.get("material", {})
    kept = {k: v for k, v in material.items() if k == "prony"} if isinstance(material, Mapping) else {}

    def of_law(law: type[Law]) -> dict[str, Any]:
        level = {**law.level, "settings": {"material": {**kept, "law": law.name}}}
        return level | ({"hold": {"D1": HELD_D1_MU}} if "hold" in level else {})

    indenter = INDENTERS.read(settings.get("indenter", {}))
    rungs: dict[int, list[dict[str, Any]]] = {}
    for law in LAWS.members.values():
        rungs.setdefault(law.rung, []).append(of_law(law))
    hertz = {
        "name": "hertz",
        "title": indenter.theory,
        "description": "closed form, half-space, small strain",
        "closed_form": True,
        "hold": {"D1": HELD_D1_MU},
    }
    first = () if indenter.force(np.ones(1), 0.0, 1.0, SIMPLE_MODEL_POISSON) is None else ((hertz,),)
    return (*first, *(tuple(rungs[k]) for k in sorted(rungs)))


def closed_form(settings: Settings, knobs: Knobs, programme: Programme) -> Response:
    """Fx, Fy, Fz (N) of Hertz at the asked travels of loading; every other channel is left out.

    The indenter meets a body of the mean curvature H where its axis does, h = s cos θ for a travel s on a line that is
    θ off the normal.  Errors of indenter, specimen and place count, other effects do not.
    Assumptions: half-space, small strain, no friction.  Source: Johnson 1985, §4.2.
    """
    s = np.array(programme.asked_mm)
    actual = as_it_is(settings, knobs)
    normal, H, tilt = touch(actual)
    K = 2.0 / knobs.D1
    E, nu = closed_forms.youngs_modulus(knobs.mu, K), closed_forms.poisson_ratio(knobs.mu, K)
    F = _closed(actual.indenter.force(s * tilt, H, E, nu), settings)
    time = np.interp(s, *_loading(programme))
    channels = {"time": time, "travel": s} | {f"F{axis}": F * n for axis, n in zip("xyz", normal, strict=True)}
    return Response(channels, {k: CHANNEL_UNITS[k] for k in channels})


def start(settings: Settings, travel: np.ndarray, force: np.ndarray) -> dict[str, tuple[float, float, float]]:
    """(low, value, high) of μ (MPa) and D₁ (1/MPa) from a measured Fz (n,) N over travel (n,) mm by Hertz, ν = 0.49.

        E = 3F(1 − ν²)/(4 √R* h^{3/2}),   μ = E/(2(1 + ν)),   K = E/(3(1 − 2ν)),   D₁ = 2/K

    The value is the least-squares one over the curve; the range of μ has the moduli of the single readings beyond a
    tenth of the depth, a factor 1.5 wider, that of D₁ ν from 0.2 to 0.4999 with these.  ValueError if no reading is a
    push.  Source: thesis eq. 2.3, 2.5–2.11.
    """
    u, F = np.asarray(travel, dtype=float), np.asarray(force, dtype=float)
    keep = (u > 0.1 * u.max(initial=0.0)) & (F > 0)
    if not keep.any():
        theory = settings.indenter.theory
        raise ValueError(f"no reading beyond a tenth of the depth pushes: there is no start by {theory}")
    normal, H, tilt = touch(settings)
    h, F = u[keep] * tilt, F[keep] / normal[2]
    shape = _closed(settings.indenter.force(h, H, 1.0, SIMPLE_MODEL_POISSON), settings)
    E, single = (
        float(shape @ F / (shape @ shape)),
        _closed(settings.indenter.modulus(F, h, H, SIMPLE_MODEL_POISSON), settings),
    )
    value, low, high = (
        e / (2.0 * (1.0 + SIMPLE_MODEL_POISSON))
        for e in (E, float(single.min()) / HERTZ_RANGE_FACTOR, float(single.max()) * HERTZ_RANGE_FACTOR)
    )

    def D1(mu: float, nu: float) -> float:
        return 3.0 * (1.0 - 2.0 * nu) / (1.0 + nu) / mu

    return {
        "mu": (low, value, high),
        "D1": (D1(high, MAX_RANGE_POISSON), D1(value, SIMPLE_MODEL_POISSON), D1(low, MIN_RANGE_POISSON)),
    }


def hertz(settings: Settings, travel: np.ndarray, force: np.ndarray) -> float | None:
    """μ (MPa) that Fz (n,) N over travel (n,) mm would have in Hertz's limit, incompressible; see `closed_form`.

    None where the indenter has no closed form.
    """
    normal, H, tilt = touch(settings)
    unit = settings.indenter.force(travel * tilt, H, 3.0, 0.5)
    if unit is None:
        return None
    unit = normal[2] * unit
    return float(unit @ force / (unit @ unit))


def jkr_start(settings: Settings, travel: np.ndarray, force: np.ndarray) -> dict[str, float]:
    """Knobs of Fz (n,) N over travel (n,) mm that pulls, and where contact is (mm): `Indenter.adhesive_fit`."""
    return settings.indenter.adhesive_fit(travel, force, settings.specimen.mean_curvature(*settings.point))


def as_it_is(settings: Settings, knobs: Knobs) -> Settings:
    """The settings with the errors of indenter, specimen and place; ValueError where there is nothing to press."""
    point = settings.point[0] + knobs.offset_x, settings.point[1] + knobs.offset_y
    specimen = settings.support.actual(knobs).confines(settings.specimen.actual(knobs))
    specimen.above(*point)
    return replace(settings, specimen=specimen, indenter=settings.indenter.actual(knobs, specimen), point=point)


def touch(settings: Settings) -> tuple[np.ndarray, float, float]:
    """Outer normal (3,) where the axis meets the body, mean curvature there (1/mm), cosine of the way to the normal."""
    _, normal = settings.specimen.above(*settings.point)
    H = settings.specimen.mean_curvature(*settings.point)
    return normal, H, 1.0 if settings.direction == "normal" else float(normal[2])


def _closed(answer: np.ndarray | None, settings: Settings) -> np.ndarray:
    """An answer; ValueError where the indenter has no closed form."""
    if answer is None:
        raise ValueError(f"there is no closed form for an indenter of shape {settings.indenter.name!r}")
    return answer


def _loading(programme: Programme) -> tuple[np.ndarray, np.ndarray]:
    """Travel and time up to the deepest point."""
    t, s = np.array(programme.time_s), np.array(programme.travel_mm)
    top = int(np.argmax(s)) + 1
    return s[:top], t[:top]
