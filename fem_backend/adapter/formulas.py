"""Closed forms of the literature for an experiment of the study: which exist, what they say, where they hold."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fem_backend import closed_forms, members
from fem_backend.adapter.model_hierarchy import as_it_is, touch
from fem_backend.closed_forms import Formula
from fem_backend.closed_forms.formulas import MAX_BASE_FORCE_SHARE, MAX_SMALL_STRAIN_DEPTH_RATIO
from fem_backend.indenters.plate import Plate
from fem_backend.laws import LAWS
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.supports.walls import Walls
from rso.contract import FormulaCurve

INDENTER_SIZE_KEYS = ("radius", "fillet", "half_angle", "tip_radius")  # keys of an indenter's table that formulas know
MIN_LAYER_WIDTH_RATIO = 5.0  # heights that a specimen must be wide to count as a layer without end
# heights beside the indenter from which on a wall counts for less than 0.1 % of the force
MIN_WALL_DISTANCE_RATIO = 4.0
MIN_JKR_TABOR, MAX_DMT_TABOR = 3.0, 0.1  # Tabor's parameter above which JKR, and below which DMT holds to some per cent
INCOMPRESSIBLE_POISSON = 0.5  # ν of a body that keeps its volume


def formula_forces(settings: Settings, knobs: Knobs, travel: np.ndarray) -> tuple[FormulaCurve, ...]:
    """Force Fz (n,) N of each closed form at travels (n,) mm, simplest first; none where the pair has none.

    μ and K = 2/D₁ give E and ν; errors of sizes and place count, other effects and nonlinear terms of the law do not.
    """
    actual = as_it_is(settings, knobs)
    normal, _, tilt = touch(actual)
    K = 2.0 / knobs.D1
    E, nu = closed_forms.youngs_modulus(knobs.mu, K), closed_forms.poisson_ratio(knobs.mu, K)
    h, found = travel * tilt, []
    general = _general(actual, h, nu)
    relaxes = "the material relaxes, the formula is elastic" if settings.prony or knobs.prony_g else ""
    other = relaxes or _unknown(settings, knobs)
    for f in of_pair(actual, E, nu):
        with np.errstate(all="ignore"):
            force = np.asarray(f.force(h), float) * float(normal[2])
        why = tuple(other or general[k] or f.valid(float(d)) or "" for k, d in enumerate(h))
        found.append(FormulaCurve(f.name, f.source, force, why))
    return (*found, *adhesive(actual, knobs, h, float(normal[2]), relaxes))


def adhesive(settings: Settings, knobs: Knobs, h: np.ndarray, up: float, relaxes: str) -> tuple[FormulaCurve, ...]:
    """JKR and DMT at depths (n,) mm of a ball that is attracted, each with where it holds by Tabor's parameter."""
    indenter = settings.indenter
    if not knobs.adhesion or "radius" not in indenter.plain() or indenter.finest[1] != math.inf:
        return ()
    K, w = 2.0 / knobs.D1, knobs.adhesion
    E, nu = closed_forms.youngs_modulus(knobs.mu, K), closed_forms.poisson_ratio(knobs.mu, K)
    stiff = closed_forms.plane_modulus(E, nu)
    R = indenter.effective_radius(settings.specimen.mean_curvature(*settings.point))
    number = closed_forms.tabor(R, w, stiff, knobs.adhesion_range)
    general, found = _general(settings, h, nu), []
    for name, source, force, wrong in (
        ("JKR", "Johnson, Kendall & Roberts 1971", closed_forms.jkr_force, number < MIN_JKR_TABOR),
        ("DMT", "Derjaguin, Muller & Toporov 1975", closed_forms.dmt_force, number > MAX_DMT_TABOR),
    ):
        far = f"Tabor's parameter is {number:.2g}" if wrong else ""
        small = [
            "the depth is more than a tenth of the radius" if d > MAX_SMALL_STRAIN_DEPTH_RATIO * R else "" for d in h
        ]
        why = tuple(relaxes or far or g or s for g, s in zip(general, small, strict=True))
        found.append(FormulaCurve(name, source, np.asarray(force(h, R, w, stiff), float) * up, why))
    return tuple(found)


def of_pair(settings: Settings, E: float, nu: float) -> tuple[Formula, ...]:
    """The closed forms of specimen, indenter and support; E in MPa."""
    indenter, specimen = settings.indenter, settings.specimen
    sizes: dict[str, Any] = {k: float(v) for k, v in indenter.plain().items() if k in INDENTER_SIZE_KEYS}
    curvature = specimen.mean_curvature(*settings.point)
    if curvature and "radius" in sizes:
        sizes["radius"] = indenter.effective_radius(curvature)
    base: dict[str, Any] = {} if _held(settings) else {"base": "slip"}
    try:
        return closed_forms.formulas(
            indenter.name,
            E,
            nu,
            **sizes,
            **base,
            thickness=thickness(settings),
            neo_hookean=settings.law == LAWS.default and not curvature,
        )
    except ValueError:  # of an indenter that they do not know
        return ()


def thickness(settings: Settings) -> float | None:
    """Thickness (mm) of the layer that the specimen is taken for; None for a half-space."""
    specimen = settings.specimen
    flat = "base" in specimen.parts and np.isfinite(specimen.thickness_along(np.array([0.0, 0.0, -1.0])))
    return float(specimen.top[2] - specimen.lowest[2]) if flat else None


def wall_nearby(settings: Settings) -> float | None:
    """Radius (mm) of a wall at the side of a flat specimen near the indenter; None where there is none.

    What a wall adds to the force falls off with its distance over the height: of a slab 1 to 4 % at 2.5 heights off the
    axis, 0.05 % at 5, down to half the height under a ball as large as that is high.
    """
    specimen: Any = settings.specimen
    if thickness(settings) is None or not getattr(specimen, "walled", False):
        return None
    height, half = float(specimen.top[2] - specimen.lowest[2]), float(specimen.half_width)
    return half if half < settings.indenter.length + MIN_WALL_DISTANCE_RATIO * height else None


def shear_modulus(settings: Settings, travel: np.ndarray, force: np.ndarray) -> tuple[str, float] | None:
    """The last closed form of the pair and the μ (MPa) that Fz (n,) N over travel (n,) mm has by it, incompressible.

    None where the pair has none.
    """
    normal, _, tilt = touch(settings)
    found = of_pair(settings, 3.0, INCOMPRESSIBLE_POISSON)
    if not found:
        return None
    with np.errstate(all="ignore"):
        unit = np.asarray(found[-1].force(travel * tilt), float) * float(normal[2])
    good = np.isfinite(unit)
    if not unit[good].any():
        return None
    return found[-1].name, float(unit[good] @ force[good] / (unit[good] @ unit[good]))


def of_uniform_compression(settings: Settings, travel: np.ndarray, force: np.ndarray) -> float | None:
    """μ (MPa) that Fz (n,) N over travel (n,) mm has where a plate compresses a flat body uniformly, incompressible.

        F = 3 μ V u / h²,   V / h the mean cross-section

    None for other indenters and for bodies without an end to the sides.  Ends that stick make it more, by at most
    1 + a²/2h² of a cylinder of radius a (Gent & Lindley, Proc. Inst. Mech. Eng. 173 (1959) 111).
    """
    h, specimen = thickness(settings), settings.specimen
    if h is None or not isinstance(settings.indenter, Plate) or getattr(specimen, "alike", False):
        return None
    unit = 3.0 * float(specimen.volume()) / h**2 * travel
    return float(unit @ force / (unit @ unit))


def _held(settings: Settings) -> bool:
    """Whether the base is held in all directions, as formulas take it to be by default, rather than sliding."""
    specimen = settings.specimen
    held: Any = settings.support.held(specimen, specimen.lowest[None], np.zeros(1, int))
    return bool(np.asarray(held).all())


def _general(settings: Settings, depth: np.ndarray, nu: float) -> list[str]:
    """Why no formula holds at depths (n,) mm for a specimen that is no half-space and no layer of one material."""
    why = _anywhere(settings)
    if why is not None:
        return [why] * len(depth)
    height = float(settings.specimen.top[2] - settings.specimen.lowest[2])
    length = settings.indenter.length
    more = closed_forms.thickness_factor(np.asarray(depth, float) / length, height / length, nu) - 1.0
    words = "the specimen is no half-space: a slab as high as it adds {:.0f} %"
    return [
        words.format(100.0 * v) if d != 0.0 and v > MAX_BASE_FORCE_SHARE else ""
        for d, v in zip(depth, more, strict=True)
    ]


def _unknown(settings: Settings, knobs: Knobs) -> str:
    """What acts that no formula of a bonded or sliding elastic body knows; "" for nothing."""
    support = settings.support.actual(knobs)
    if knobs.permeability:
        return "water flows in the pores, the formula is elastic"
    if knobs.adhesion:
        return "the indenter is attracted, the formula knows no attraction"
    if not isinstance(support, Walls):
        return ""
    if support.rubs and not _held(settings):
        return "the base rubs, that of the formula slides"
    return "the base yields, that of the formula does not" if support.yields else ""


def _anywhere(settings: Settings) -> str | None:
    """Why no formula holds at any depth, or "" where all may; None where that depends on the depth."""
    specimen = settings.specimen
    layers = getattr(specimen, "layers", ())
    if layers:
        return "the specimen has layers, the formula has one material"
    if (near := wall_nearby(settings)) is not None:
        return f"the wall of the well, {members.length_words(near)} from the axis, stiffens it: no formula has a wall"
    height = float(specimen.top[2] - specimen.lowest[2])
    if thickness(settings) is not None:
        narrow = not specimen.alike and specimen.volume() < math.pi / 4.0 * MIN_LAYER_WIDTH_RATIO**2 * height**3
        return f"the specimen is less than {MIN_LAYER_WIDTH_RATIO:g} times as wide as it is high" if narrow else ""
    return "" if specimen.alike else None
