"""Which closed forms exist for an indenter on a flat specimen, with their range of validity."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fem_backend.closed_forms import approximations, half_space, layer

MAX_BASE_FORCE_SHARE = 1e-2  # of the force of a half-space
"""A half-space formula counts as valid while the integral equation says the layer adds less than this."""
MAX_SMALL_STRAIN_DEPTH_RATIO = 0.1  # of the radius or the thickness
"""Depth over the radius of a ball, or over a thickness, up to which strains count as small."""


@dataclass(frozen=True)
class Formula:
    """A closed form: `force` (N) of depths (n,) mm; `valid` is None, or says why it does not hold at a depth (mm)."""

    name: str
    source: str
    force: Callable[[np.ndarray], np.ndarray]
    valid: Callable[[float], str | None]


def formulas(
    shape: str,
    E: float,
    nu: float,
    *,
    radius: float = 0.0,
    fillet: float = 0.0,
    half_angle: float = 0.0,
    tip_radius: float = 0.0,
    thickness: float | None = None,
    base: str = "bonded",
    neo_hookean: bool = True,
) -> tuple[Formula, ...]:
    """The closed forms of a "sphere", "flat" or "cone" on a half-space (no `thickness`) or a wide layer.

    E in MPa; radius, fillet, tip_radius, thickness in mm; half_angle in degrees from the axis; base "bonded" or "slip".
    The simplest comes first.  The last one is always the solved integral equation for the indenter as it is, which is
    valid for small strain alone; those of large strain come before it.  Raises ValueError for another shape or base.
    """
    if base not in ("bonded", "slip"):
        raise ValueError(f'base "{base}" is neither "bonded" nor "slip"')
    incompressible = nu > 0.49
    if shape == "sphere":
        profile, tip = layer.ball(radius), radius
        simple = [
            Formula(
                "Hertz",
                "Johnson 1985, eq. 4.23",
                lambda h: half_space.hertz_force(h, radius, E, nu),
                lambda h: _small(h, radius) or _thick(h, layer.paraboloid(radius), thickness, nu, base),
            )
        ]
    elif shape == "flat":
        profile = layer.rounded_flat(radius, fillet) if fillet else layer.flat(radius)
        tip = radius
        simple = [
            Formula(
                "Sneddon, flat end",
                "Sneddon 1965",
                lambda h: half_space.sneddon_flat(h, radius, E, nu),
                lambda h: _sharp(fillet, radius) or _small(h, radius) or _thick(h, profile, thickness, nu, base),
            )
        ]
    elif shape == "cone":
        profile, tip = layer.cone(half_angle, tip_radius), math.inf
        simple = [
            Formula(
                "Sneddon, cone",
                "Sneddon 1965",
                lambda h: half_space.sneddon_cone(h, half_angle, E, nu),
                lambda h: _blunt(h, tip_radius, half_angle) or _thick(h, layer.cone(half_angle), thickness, nu, base),
            )
        ]
    else:
        raise ValueError(f'shape "{shape}" is none of "sphere", "flat", "cone"')
    found = simple
    if thickness is None:
        if shape == "sphere" and neo_hookean and incompressible:
            found.append(
                Formula(
                    "Zhang, neo-Hookean half-space",
                    "Zhang, Cao, Li & Feng 2014",
                    lambda h: half_space.neo_hookean_ball(h, radius, E),
                    lambda h: None if h <= radius else "deeper than the radius of the ball",
                )
            )
    else:
        found += _of_layer(shape, E, nu, radius, fillet, half_angle, tip_radius, thickness, base, neo_hookean)
    name = "Hayes et al., integral equation" if thickness is not None else "Sneddon, indenter as it is"
    source = "Hayes, Keer, Herrmann & Mockros 1972" if thickness is not None else "Sneddon 1965"
    exact = Formula(
        name,
        source,
        lambda h: layer.layer_force(h, profile, thickness, E, nu, base),
        lambda h: _small(h, tip if thickness is None else min(tip, thickness)),
    )
    return (*found, exact)


def _of_layer(
    shape: str,
    E: float,
    nu: float,
    radius: float,
    fillet: float,
    half_angle: float,
    tip_radius: float,
    t: float,
    base: str,
    neo_hookean: bool,
) -> list[Formula]:
    """The approximations for a layer."""
    found = []
    incompressible = nu > 0.49
    if shape == "sphere":
        found.append(
            Formula(
                f"Dimitriadis, {'bonded' if base == 'bonded' else 'not bonded'}",
                "Dimitriadis et al. 2002",
                lambda h: approximations.dimitriadis(h, radius, t, E, nu, base),
                lambda h: _small(h, radius) or _below(math.sqrt(radius * h) / t, 0.3, "√(R h)/thickness"),
            )
        )
        found.append(
            Formula(
                "thin layer, confined" if base == "bonded" else "thin layer, sliding",
                "Johnson 1985, §5.8; Jaffar 1989",
                lambda h: approximations.confined_ball(h, radius, t, E, nu, base),
                lambda h: _thin(h, radius, t, nu, base),
            )
        )
    if base == "bonded" and incompressible:
        size = half_angle if shape == "cone" else radius
        kind = "ball" if shape == "sphere" else shape
        x = {
            "ball": lambda h: math.sqrt(radius * h) / t,
            "flat": lambda h: radius / t,
            "cone": lambda h: h * math.tan(math.radians(half_angle)) / t,
        }[kind]
        found.append(
            Formula(
                "Garcia & Garcia",
                "Garcia & Garcia 2018",
                lambda h: approximations.garcia(kind, h, size, t, E),
                lambda h: (
                    _sharp(fillet, radius or 1.0)
                    or (_blunt(h, tip_radius, half_angle) if kind == "cone" else None)
                    or _small(h, min(radius or t, t))
                    or _below(x(h), 1.0, "contact radius/thickness")
                ),
            )
        )
        if shape == "sphere" and neo_hookean:
            found.append(
                Formula(
                    "Long et al., neo-Hookean layer",
                    "Long, Hall, Wu & Hui 2011",
                    lambda h: approximations.long_ball(h, radius, t, E),
                    lambda h: (
                        _below(h / t, min(0.6, radius / t), "depth/thickness")
                        or (None if 0.3 <= radius / t <= 12.7 else "radius/thickness is not between 0.3 and 12.7")
                    ),
                )
            )
    return found


def thickness_factor(
    depth_over_radius: np.ndarray,
    thickness_over_radius: float,
    nu: float,
    base: str = "bonded",
) -> np.ndarray:
    """Force of a ball on a layer over Hertz's at depths h/R (n,): how much "too thin for Hertz" a specimen is.

    Assumptions: small strain, no friction, paraboloid; 1 at no depth.  Source: Hayes et al. 1972, see :mod:`layer`.
    """
    h = np.asarray(depth_over_radius, dtype=float)
    force = layer.layer_force(h, layer.paraboloid(1.0), thickness_over_radius, 1.0, nu, base)
    return np.where(h > 0.0, force / np.where(h > 0.0, half_space.hertz_force(h, 1.0, 1.0, nu), 1.0), 1.0)


# ------------------------------------------------------------------------------------------------ in words


def _small(h: float, size: float) -> str | None:
    return (
        None
        if h <= MAX_SMALL_STRAIN_DEPTH_RATIO * size
        else f"strains are not small: depth {h:.3g} mm is above {MAX_SMALL_STRAIN_DEPTH_RATIO:g} of {size:.3g} mm"
    )


def _below(x: float, most: float, what: str) -> str | None:
    return None if x <= most else f"{what} is {x:.2g}, above {most:.2g}"


def _sharp(fillet: float, radius: float) -> str | None:
    return None if fillet <= 0.01 * radius else f"the edge is rounded by {fillet:.3g} mm"


def _blunt(h: float, tip_radius: float, half_angle: float) -> str | None:
    lost = tip_radius * (1.0 / math.sin(math.radians(half_angle)) - 1.0)  # of the sharp cone
    return None if h >= 50.0 * lost else f"the rounded tip counts: it is {lost:.2g} mm shorter than a sharp one"


def _thick(h: float, profile: layer.Profile, t: float | None, nu: float, base: str) -> str | None:
    if t is None or h == 0.0:
        return None
    forces = [float(layer.layer_force(np.array([h]), profile, s, 1.0, nu, base)[0]) for s in (t, None)]
    more = forces[0] / forces[1] - 1.0
    return (
        None
        if abs(more) <= MAX_BASE_FORCE_SHARE
        else f"the specimen is thin: its base adds {100 * more:.0f} % to the force"
    )


def _thin(h: float, radius: float, t: float, nu: float, base: str) -> str | None:
    a = math.sqrt((4.0 if base == "bonded" and nu == 0.5 else 2.0) * radius * h)
    least = 3.0 if base == "slip" else 30.0 if nu == 0.5 else max(10.0, 3.0 / math.sqrt(1.0 - 2.0 * nu))
    if a < least * t:
        return f"contact radius/thickness is {a / t:.2g}, below {least:.2g}"
    return _small(h, t)
