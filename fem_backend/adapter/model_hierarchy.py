"""The ladder of models that this backend offers, from Hertz's closed form to the laws with one more constant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fem_backend.accuracy import closed_forms
from fem_backend.geometry import Ellipsoid
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.simulation.outputs import UNITS
from rso.contract import Programme, Response

NU = 0.49  # of the simple levels: ν cannot be told from them
HELD = 3.0 * (1.0 - 2.0 * NU) / (1.0 + NU)  # D₁μ = 2μ/K at this ν
WIDER = 1.5  # what the moduli of Hertz are multiplied and divided with for a range
LOOSEST, TIGHTEST = 0.2, 0.4999  # ν of the ends of a range of D₁
ONE_MORE = {  # law → the constant that it opens, and its range; moduli as shares of μ
    "mooney_rivlin": ("C01", (0.0, 0.5), "Mooney-Rivlin", "second invariant"),
    "yeoh": ("C20", (0.0, 0.4), "Yeoh", "first stiffening term"),
    "ogden": ("alpha", (0.8, 12.0), "Ogden", "one term"),
}


def levels(settings: Mapping[str, Any]) -> tuple[tuple[dict[str, Any], ...], ...]:
    """Rungs of a ladder as plain data, the levels of one rung side by side.

    Hertz → linear elastic, both with ν = 0.49 (D₁μ held) → neo-Hookean → Mooney-Rivlin, Yeoh, Ogden with one constant
    more.  Keys: `name`, `title`, `description`, `settings` (replace the study's), `open` (knob → range, moduli as
    shares of μ), `hold` (knob → value, moduli likewise), `closed_form`, `extends` (the level that it is at neutral).
    """
    material = settings.get("material", {})
    kept = {k: v for k, v in material.items() if k == "prony"} if isinstance(material, Mapping) else {}

    def law(name: str) -> dict[str, Any]:
        return {"settings": {"material": {**kept, "law": name}}}

    hertz = {"name": "hertz", "title": "Hertz", "description": "closed form, half-space, small strain",
             "closed_form": True, "hold": {"D1": HELD}}  # fmt: skip
    linear = {"name": "linear_elastic", "title": "linear elasticity", "description": "small strain",
              "hold": {"D1": HELD}, **law("linear_elastic")}  # fmt: skip
    neo = {"name": "neo_hooke", "title": "neo-Hooke", "description": "large strain", **law("neo_hookean")}
    more = tuple(
        {"name": n, "title": title, "description": text, "open": {k: ends}, "extends": "neo_hooke", **law(n)}
        for n, (k, ends, title, text) in ONE_MORE.items()
    )
    return ((hertz,), (linear,), (neo,), more)


def closed_form(settings: Settings, knobs: Knobs, programme: Programme) -> Response:
    """Fx, Fy, Fz (N) of Hertz at the asked travels of loading; every other channel is left out.

    The ball meets the ellipsoid's tangent sphere of the mean curvature H: 1/R* = 1/R + H, h = s cos θ for a travel s
    on a line that is θ off the normal.  Errors of the ball, of the semi-axes and of the place count, other effects do
    not.  Assumptions: half-space, small strain, no friction.  Source: Johnson 1985, §4.2.
    """
    s = np.array(programme.asked_mm)
    normal, R, tilt = _touch(_as_it_is(settings, knobs))
    K = 2.0 / knobs.D1
    E, nu = closed_forms.youngs_modulus(knobs.mu, K), closed_forms.poisson_ratio(knobs.mu, K)
    F = closed_forms.hertz_force(s * tilt, R, E, nu)
    time = np.interp(s, *_loading(programme))
    channels = {"time": time, "travel": s} | {f"F{axis}": F * n for axis, n in zip("xyz", normal, strict=True)}
    return Response(channels, {k: UNITS[k] for k in channels})


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
        raise ValueError("no reading beyond a tenth of the depth pushes: there is no start by Hertz")
    normal, R, tilt = _touch(settings)
    h, F = u[keep] * tilt, F[keep] / normal[2]
    shape = closed_forms.hertz_force(h, R, 1.0, NU)
    E, single = float(shape @ F / (shape @ shape)), closed_forms.hertz_modulus(F, h, R, NU)
    value, low, high = (e / (2.0 * (1.0 + NU)) for e in (E, float(single.min()) / WIDER, float(single.max()) * WIDER))

    def D1(mu: float, nu: float) -> float:
        return 3.0 * (1.0 - 2.0 * nu) / (1.0 + nu) / mu

    return {"mu": (low, value, high), "D1": (D1(high, TIGHTEST), D1(value, NU), D1(low, LOOSEST))}


def hertz(settings: Settings, travel: np.ndarray, force: np.ndarray) -> float:
    """μ (MPa) that Fz (n,) N over travel (n,) mm would have in Hertz's limit, incompressible; see `closed_form`."""
    normal, R, tilt = _touch(settings)
    unit = normal[2] * closed_forms.hertz_force(travel * tilt, R, 3.0, 0.5)
    return float(unit @ force / (unit @ unit))


def jkr(settings: Settings, travel: np.ndarray, force: np.ndarray) -> dict[str, float]:
    """μ (MPa), w (N/mm) and where contact is (mm) of Fz (n,) N over travel (n,) mm in the JKR limit, incompressible.

    F = 4 E* a³/(3 R) − √(8π w E* a³),   δ = a²/R − √(2π w a/E*),   E* = 4 μ.  Least squares over w/E* and the contact,
    E* in closed form, of the readings from the strongest pull on.  Small strains, a half-space (Johnson, Kendall and
    Roberts 1971); nothing where no reading pulls.
    """
    R = _touch(settings)[1]
    k = int(np.argmin(force))
    u, F = travel[k:], force[k:]
    if len(u) < 4 or not F[0] < 0.0 or np.ptp(u) == 0.0:
        return {}
    a, best = np.linspace(1e-3, 1.0, 400) * R, (np.inf, 0.0, 0.0, 0.0)
    for ratio in np.geomspace(1e-6, 0.3, 120) * R:
        depth, unit = (
            a**2 / R - np.sqrt(2.0 * np.pi * ratio * a),
            4.0 * a**3 / (3.0 * R) - np.sqrt(8.0 * np.pi * ratio * a**3),
        )
        low = int(np.argmin(depth))  # beyond the turn of the branch no contact is stable
        for contact in u[0] + np.linspace(-0.5, 1.0, 61) * np.ptp(u):
            f = np.interp(u - contact, depth[low:], unit[low:])
            E = float(f @ F / max(f @ f, 1e-300))
            left = float(np.sum((F - E * f) ** 2))
            if E > 0.0 and left < best[0]:
                best = left, E, E * ratio, contact
    return {"mu": best[1] / 4.0, "adhesion": best[2], "contact": best[3]} if best[1] > 0.0 else {}


def _as_it_is(settings: Settings, knobs: Knobs) -> Settings:
    """The settings with the errors of ball, body and place; ValueError where nothing is left to press or with."""
    axes = settings.body.semi_axes + np.array([knobs.delta_a, knobs.delta_b, knobs.delta_c])
    x, y = settings.point[0] + knobs.offset_x, settings.point[1] + knobs.offset_y
    R = settings.R + knobs.delta_R
    if R <= 0.0 or axes.min() <= 0.0 or math.hypot(x / axes[0], y / axes[1]) >= 1.0:
        raise ValueError(f"Hertz needs a ball above a body: R = {R:g} mm at ({x:g}, {y:g}) mm, semi-axes {axes} mm")
    return replace(settings, body=Ellipsoid(*map(float, axes)), R=R, point=(x, y))


def _touch(settings: Settings) -> tuple[np.ndarray, float, float]:
    """Outer normal (3,) where the axis meets the body, effective radius (mm), cosine of the way to the normal."""
    s, (x, y) = settings.body.semi_axes, settings.point
    at = np.array([x, y, s[2] * np.sqrt(1.0 - (x / s[0]) ** 2 - (y / s[1]) ** 2)])
    normal = at / s**2
    normal /= np.linalg.norm(normal)
    R = 1.0 / (1.0 / settings.R + closed_forms.ellipsoid_mean_curvature(s, at))
    return normal, R, 1.0 if settings.direction == "normal" else float(normal[2])


def _loading(programme: Programme) -> tuple[np.ndarray, np.ndarray]:
    """Travel and time up to the deepest point."""
    t, s = np.array(programme.time_s), np.array(programme.travel_mm)
    top = int(np.argmax(s)) + 1
    return s[:top], t[:top]
