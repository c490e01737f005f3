"""Elements that resolve a contact: a ball's where it is small beside the ball, and the annulus of an attraction.

A ball pressed in by δ touches a circle of a = √(Rδ) (Hertz).  Where its own elements are longer, they are wanted
as long as a/10.

On a half-space of modulus E* the attraction w/ℓ of a range ℓ acts over l = (π/4) E* ℓ²/w beside the contact, and a
ball sticks to a circle of a₀ = (9π w R²/2E*)^(1/3) under no force (JKR).  Elements are wanted as long as the less of
l/6 and a₀/12.  All that is in steps of √2, so that like runs share a grid, out to where the deepest contact ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from fem_backend import closed_forms
from fem_backend.indenters import Indenter
from fem_backend.meshing import is_grid
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs

# elements along the annulus and along a₀, at unit fineness
N_ELEMENTS_PER_ANNULUS, N_ELEMENTS_PER_PULLED_CONTACT = 6.0, 12.0
N_ELEMENTS_PER_SMALL_CONTACT = 10.0  # elements along the radius of a small contact, at unit fineness
FINE_RADIUS_RATIO = 1.3  # of the deepest contact's radius: where elements begin to grow
MIN_HALF_SPACE_RATIO = 100.0  # lengths of the indenter: a smaller specimen is no half-space
ELEMENT_GROWTH_BESIDE_CONTACT = 0.25  # size of the elements per distance from there
MAX_CONTACT_ELEMENTS = 800  # elements along the contact, at unit fineness
N_SAMPLES_PER_ELEMENT = 40  # places at which a size is looked up, per finest element
MIN_SIZE_SAMPLES, MAX_SIZE_SAMPLES = 400, 400_000  # the same along an interval, whatever its elements are


class Unresolved(ValueError):
    """An attraction whose annulus no grid of a bearable size resolves."""


def stiff(mu: float, D1: float) -> float:
    """E* (MPa) of a body of mu (MPa) and D1 (1/MPa) under a rigid indenter."""
    E, nu = closed_forms.youngs_modulus(mu, 2.0 / D1), closed_forms.poisson_ratio(mu, 2.0 / D1)
    return closed_forms.plane_modulus(E, nu)


def zone(knobs: Knobs) -> float:
    """Width l (mm) of the annulus where the attraction acts."""
    return closed_forms.cohesive_zone(knobs.adhesion, stiff(knobs.mu, knobs.D1), knobs.adhesion / knobs.adhesion_range)


def resolved(settings: Settings, knobs: Knobs, deepest: float) -> Settings:
    """The settings with elements that resolve contact and attraction down to the `deepest` travel (mm); Unresolved."""
    if not knobs.adhesion:
        return shallow(settings, deepest)
    R, E = (
        settings.indenter.effective_radius(settings.specimen.mean_curvature(*settings.point)),
        stiff(knobs.mu, knobs.D1),
    )
    l, a0 = zone(knobs), (4.5 * math.pi * knobs.adhesion * R**2 / E) ** (1.0 / 3.0)
    unit = settings.indenter.length
    h = min(l / N_ELEMENTS_PER_ANNULUS, a0 / N_ELEMENTS_PER_PULLED_CONTACT)
    if h >= float(settings.indenter.spacing(np.zeros(1))[0]):
        return settings
    radius = FINE_RADIUS_RATIO * _deepest_contact(settings, knobs, R, E, max(deepest, 0.0))
    if radius > MAX_CONTACT_ELEMENTS * h:
        # of the same contact: the range at which MAX_CONTACT_ELEMENTS elements are enough
        least = knobs.adhesion_range * math.sqrt(
            radius / (MAX_CONTACT_ELEMENTS * min(l / N_ELEMENTS_PER_ANNULUS, radius / MAX_CONTACT_ELEMENTS))
        )
        number = closed_forms.tabor(R, knobs.adhesion, E, knobs.adhesion_range)
        raise Unresolved(
            f"adhesion_range = {knobs.adhesion_range:.3g} mm: attraction acts on {l:.3g} mm beside a contact of "
            f"{radius / FINE_RADIUS_RATIO:.3g} mm (Tabor parameter {number:.3g}). "
            f"{MAX_CONTACT_ELEMENTS} elements cannot resolve that; "
            f"{least:.2g} mm is the least"
        )
    return replace(settings, fine=(unit * _power(h / unit, math.floor), unit * _power(radius / unit, math.ceil)))


def for_force(settings: Settings, values: Mapping[str, float | None], travel: float, force: float) -> Settings:
    """The same down to a travel (mm) and to where a force (N) leads by Hertz, at once and when all is relaxed.

    Without adhesion, whose contact is wider, and with the moduli among the `values` of the knobs.
    """
    led = _led(settings, values, travel, force)
    return settings if led is None else shallow(settings, *led)


def for_force_in_space(settings: Settings, values: Mapping[str, float | None], travel: float, force: float) -> Settings:
    """The same for a body in space: see :func:`shallow_in_space`; later the contact may be wider."""
    led = _led(settings, values, travel, force)
    return settings if led is None else shallow_in_space(settings, led[0])


def _led(
    settings: Settings, values: Mapping[str, float | None], travel: float, force: float
) -> tuple[float, float] | None:
    """Travels (mm), at least the one given, to which a force (N) leads by Hertz, at once and when all is relaxed."""
    mu, D1 = values.get("mu"), values.get("D1")
    if not math.isinf(settings.indenter.finest[1]) or not mu or not D1 or values.get("adhesion"):
        return None
    R = settings.indenter.effective_radius(settings.specimen.mean_curvature(*settings.point))
    E = stiff(mu, D1)
    left = max(1.0 - sum(values.get(name) or 0.0 for name in ("prony_g", "prony_g2", "prony_g3")), 0.01)
    soon, late = (max(travel, (0.75 * force / (e * math.sqrt(R))) ** (2.0 / 3.0)) for e in (E, left * E))
    return soon, late


def gathers(indenter: Indenter) -> bool:
    """Whether contact grows from the axis of an indenter: the finest elements are wanted there, coarser ones beside."""
    size = indenter.spacing(indenter.length * np.linspace(0.0, 2.0, 201))
    return bool(size[0] < size[-1] and size[0] <= size.min())


def shallow(settings: Settings, deepest: float, later: float = 0.0) -> Settings:
    """The settings with elements for a contact at the deepest travel (mm), which may creep on to a `later` one.

    Below what touches in a point first: other contacts are as wide as the indenter from the beginning.
    """
    if not (math.isinf(settings.indenter.finest[1]) or gathers(settings.indenter)) or deepest <= 0.0:
        return settings
    H, unit = settings.specimen.mean_curvature(*settings.point), settings.indenter.length
    first, a = (float(settings.indenter.contact_radius(np.array(d), H)) for d in (deepest, max(deepest, later)))
    h = first / N_ELEMENTS_PER_SMALL_CONTACT
    if h >= float(settings.indenter.spacing(np.zeros(1))[0]):
        return settings
    return replace(
        settings, fine=(unit * _power(h / unit, math.floor), unit * _power(FINE_RADIUS_RATIO * a / unit, math.ceil))
    )


def shallow_in_space(settings: Settings, deepest: float) -> Settings:
    """The same for a body in space whose mesh is a grid: that of an indenter no longer than the contact is wide.

    Grids of one level then have as many elements along the radius of the deepest contact, however shallow it is.
    """
    smooth = math.isinf(settings.indenter.finest[1]) or gathers(settings.indenter)
    if not smooth or deepest <= 0.0 or not is_grid(settings.recipe):
        return settings
    unit = settings.indenter.length
    a = float(settings.indenter.contact_radius(np.array(deepest), settings.specimen.mean_curvature(*settings.point)))
    if a >= unit:
        return settings
    made = settings.specimen.meshing(unit * _power(a / unit, math.floor), "tetwild", settings.level, 0, 0.0)
    return replace(settings, recipe=made.recipe, h0=made.h0)


def spacing(settings: Settings) -> Callable[[np.ndarray], np.ndarray]:
    """Wanted element size (…) mm at distances (…) mm from the axis: that of the indenter, finer where it attracts."""
    own = settings.indenter.spacing
    if settings.fine is None:
        return own
    h, radius = settings.fine
    return lambda r: np.minimum(
        own(r), h + ELEMENT_GROWTH_BESIDE_CONTACT * np.maximum(np.asarray(r, float) - radius, 0.0)
    )


def samples(settings: Settings, length: float) -> int | None:
    """Places at which sizes are looked up along an interval of a `length` (mm), None where the usual ones do."""
    if settings.fine is None:
        return None
    return int(
        min(
            max(N_SAMPLES_PER_ELEMENT * length / (settings.fineness * settings.fine[0]), MIN_SIZE_SAMPLES),
            MAX_SIZE_SAMPLES,
        )
    )


def _deepest_contact(settings: Settings, knobs: Knobs, R: float, E: float, depth: float) -> float:
    """Radius (mm) of the contact at a depth (mm): JKR's a²/R = δ + √(2π w a/E*), on a layer as much as √2 wider."""
    a = math.sqrt(R * depth)
    for _ in range(60):
        a = math.sqrt(R * (depth + math.sqrt(2.0 * math.pi * knobs.adhesion * max(a, 1e-12 * R) / E)))
    layer = settings.specimen.smallest < MIN_HALF_SPACE_RATIO * settings.indenter.length
    return a * (math.sqrt(2.0) if layer else 1.0)


def _power(value: float, which: Callable[[float], int]) -> float:
    """A power of √2 below or above a value."""
    return 2.0 ** (0.5 * which(2.0 * math.log2(value)))
