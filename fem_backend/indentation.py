"""The whole story on one page: an indentation test from its knobs and settings to forces.

Settings name what cannot be a number: shapes, support, law, place, mesh.  Knobs are numbers.  A setting or a value
that this backend does not model is refused by name; it is never ignored.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from skfem import MeshTet2

from fem_backend import element, linsolve, meshing, stepping
from fem_backend.contact import ContactSurface, contact_surface, quadratic_facets
from fem_backend.geometry import Ellipsoid, Sphere
from fem_backend.laws import Law, LinearElastic, NeoHooke
from fem_backend.meshing import Mesh, Sizing
from fem_backend.newton import Counters, Load, System
from fem_backend.stepping import Control, Point
from rso.contract import knob

LAWS = {"neo_hookean": NeoHooke, "linear_elastic": LinearElastic}
LEVELS = {
    "coarse": Sizing(0.8, 2.5, 0.45, 40.0),
    "standard": Sizing(0.6, 2.5, 0.4, 40.0),
    "fine": Sizing(0.5, 2.5, 0.3, 40.0),
    "reference": Sizing(0.36, 2.5, 0.2, 40.0),
}  # for R = 3 mm
LEVEL_ERROR = {"coarse": 0.011, "standard": 0.008, "fine": 0.004, "reference": 0.002}  # of the force, deep contact
EDGE_ERROR = 0.05  # of the force, times h0²/(R·travel): few elements under a small contact; benchmarks/fe_levels.py
PENALTY = 900.0  # ε R/μ: the multipliers remove its error, so it only steers convergence
RAISED, RAISED_WITHIN = 10.0, 0.7  # of the penalty under a deep ball; width in R
REACH = 3.0  # facets within REACH·R of the first contact may touch


@dataclass(frozen=True)
class Knobs:
    """Every number that a study may open; an effect also says the value that switches it off."""

    mu: float = knob("initial shear modulus", "MPa", 1e-6, 1e3)
    D1: float = knob("compressibility, bulk modulus K = 2/D1", "1/MPa", 1e-6, 1e6)


@dataclass(frozen=True)
class Settings:
    """An indentation experiment without its numbers; lengths in mm.

    `mesh` is the mesh table with the keys that count, `h0` the element size at the contact, `level_error` the relative
    error of the force when the contact is many elements wide.
    """

    body: Ellipsoid
    indenter: Sphere
    law: str = "neo_hookean"
    recipe: str = ""
    mesh: tuple[tuple[str, Any], ...] = ()
    h0: float = 0.0
    level_error: float = 0.0
    control: Control = field(default_factory=Control)
    solver: str = "auto"


@dataclass(frozen=True)
class Result:
    """Channels at the asked travels, (n,): force on the indenter (N), reaction of the support (N).

    `uz_max` (mm) is how far the deepest point went down, `bulge` (mm) how far the highest went up (the material rises
    around the ball, the more the less compressible it is); `contact_error` (N) is what the last augmentation changed.
    """

    travel: np.ndarray
    Fz: np.ndarray
    reaction: np.ndarray
    uz_max: np.ndarray
    bulge: np.ndarray
    contact_error: np.ndarray
    counters: Counters
    cpu_s: float


# --------------------------------------------------------------------------------------------------- settings


def read_settings(settings: Mapping[str, Any]) -> Settings:
    """Settings from plain data; raises ValueError naming key, value and choices."""
    data = dict(settings)
    specimen = _table(data.pop("specimen", {}), "specimen", {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]})
    _choice("specimen.shape", specimen["shape"], ["ellipsoid"])
    body = Ellipsoid(*_lengths("specimen.semi_axes", specimen["semi_axes"], 3))
    indenter = _table(data.pop("indenter", {}), "indenter", {"shape": "sphere", "radius": 3.0})
    _choice("indenter.shape", indenter["shape"], ["sphere"])
    sphere = Sphere(_lengths("indenter.radius", [indenter["radius"]], 1)[0])
    support = _table(data.pop("support", {}), "support", {"kind": "fixed"})
    _choice("support.kind", support["kind"], ["fixed"])
    law = _choice("material.law", _table(data.pop("material", {}), "material", {"law": "neo_hookean"})["law"], LAWS)
    point = data.pop("point", [0.0, 0.0])
    if [float(v) for v in _numbers("point", point, 2)] != [0.0, 0.0]:
        raise ValueError(f"point = {point} mm: only the top, [0, 0], is modelled so far")
    _choice("direction", data.pop("direction", "vertical"), ["vertical", "normal"])
    _speed(data.pop("speed", 1.0))  # an elastic body does not know it
    if data.pop("unload", False) is not False:
        raise ValueError("unload = true: an elastic body unloads on its loading curve; leave the key out")
    mesh = _table(data.pop("mesh", {}), "mesh", {"mesher": "tetwild", "level": "standard", "n": 12, "slip": 0.55})
    solver = _choice("solver", data.pop("solver", "auto"), ["auto", "pardiso", "superlu"])
    if data:
        known = "specimen, indenter, support, material, point, direction, speed, unload, mesh, solver"
        raise ValueError(f"unknown setting {sorted(data)[0]!r}; choose from {known}")
    if sphere.R > 0.5 * float(body.semi_axes.min()):
        raise ValueError(f"indenter.radius = {sphere.R} mm: only indenters much smaller than the specimen are modelled")
    return Settings(body, sphere, law, *_mesh(body, sphere, mesh), Control(), solver)


def _mesh(
    body: Ellipsoid, sphere: Sphere, mesh: Mapping[str, Any]
) -> tuple[str, tuple[tuple[str, Any], ...], float, float]:
    """Recipe, the keys that count, element size at the contact and error of the level."""
    mesher = _choice("mesh.mesher", mesh["mesher"], ["tetwild", "mapped"])
    n, level = mesh["n"], _choice("mesh.level", mesh["level"], LEVELS)
    if not isinstance(n, int) or isinstance(n, bool) or not 4 <= n <= 40:
        raise ValueError(f"mesh.n = {n!r}: number of subdivisions, an integer from 4 to 40")
    slip = _numbers("mesh.slip", [mesh["slip"]], 1)[0]
    if not 0.0 <= slip <= 0.8:
        raise ValueError(f"mesh.slip = {slip}: grading of the mapped mesh, from 0 to 0.8")
    if mesher == "mapped":
        h0 = 0.5 * np.pi * body.c / n * (1.0 - slip) / (1.0 + slip)
        used = (("mesher", mesher), ("n", n), ("slip", slip))
        return meshing.mapped_recipe(body, n, slip), used, float(h0), 0.03 * (12.0 / n) ** 2
    scale = sphere.R / 3.0
    sizing = LEVELS[level]
    sizing = replace(sizing, h0=sizing.h0 * scale, r0=sizing.r0 * scale, hmax=1.15 * float(body.semi_axes.min()))
    return meshing.tetwild_recipe(body, sizing), (("mesher", mesher), ("level", level)), sizing.h0, LEVEL_ERROR[level]


def force_error(settings: Settings, result: Result) -> np.ndarray:
    """Estimated error (n,) N of Fz: of the mesh (level and width of the contact) and of the contact.

    Calibrated on one law and specimen by comparing the levels (benchmarks/fe_levels.py and the verification set).
    """
    contact = EDGE_ERROR * settings.h0**2 / (settings.indenter.R * result.travel)
    return (settings.level_error + contact) * result.Fz + 0.2 * result.contact_error


def _speed(value: object) -> None:
    good = isinstance(value, int | float) and not isinstance(value, bool) and value > 0
    if not good and not (
        isinstance(value, str) and re.fullmatch(r"\s*\d+(\.\d*)?([eE][+-]?\d+)?\s*mm/(s|min)\s*", value)
    ):
        raise ValueError(f'speed = {value!r}: a speed such as "30 mm/min", or a number in mm/s')


def _table(value: object, name: str, defaults: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} = {value!r}: a table with the keys {', '.join(defaults)} is expected")
    unknown = sorted(set(value) - set(defaults))
    if unknown:
        raise ValueError(f"{name}.{unknown[0]} = {value[unknown[0]]!r}: unknown; choose from {', '.join(defaults)}")
    return {**defaults, **value}


def _choice(name: str, value: object, choices: Any) -> str:
    if value not in list(choices):
        raise ValueError(f"{name} = {value!r} is not modelled; choose from {', '.join(choices)}")
    return str(value)


def _numbers(name: str, value: object, count: int) -> list[float]:
    good = isinstance(value, list | tuple) and len(value) == count
    if not good or not all(isinstance(v, int | float) and np.isfinite(v) and not isinstance(v, bool) for v in value):
        raise ValueError(f"{name} = {value!r}: {count} finite number(s) expected")
    return [float(v) for v in value]


def _lengths(name: str, value: object, count: int) -> list[float]:
    numbers = _numbers(name, value, count)
    if min(numbers) <= 0:
        raise ValueError(f"{name} = {value!r} mm: must be positive")
    return numbers


# --------------------------------------------------------------------------------------------------- the run


@dataclass(frozen=True)
class Model:
    """A discretised experiment that every law and every value of its knobs can share."""

    body: element.Body
    surface: ContactSurface
    factor: linsolve.Factor
    held: np.ndarray


def build(settings: Settings, mesh: Mesh) -> Model:
    """Quarter model: symmetry planes x = 0 and y = 0, surface below z = 0 held, contact around the top."""
    quadratic = meshing.quadratic(settings.body, mesh)
    X = quadratic.doflocs.T
    facets = _curved_facets(quadratic)
    held = X == 0.0
    held[:, 2] = False
    lower = np.unique(facets)
    lower = lower[X[lower, 2] <= 1e-9]
    held[lower] = True
    body = element.discretise(quadratic, held)
    near = np.linalg.norm(X[facets].mean(1) - settings.body.top, axis=1) < REACH * settings.indenter.R
    surface = contact_surface(body, facets[near])
    return Model(body, surface, linsolve.symmetric_solver(body.pattern, settings.solver), lower)


def _curved_facets(mesh: MeshTet2) -> np.ndarray:
    """Boundary facets that lie on the specimen's surface, not on a symmetry plane."""
    facets = quadratic_facets(mesh, mesh.boundary_facets())
    X = mesh.doflocs.T
    return facets[~((X[facets, 0] == 0).all(1) | (X[facets, 1] == 0).all(1))]


def solve(settings: Settings, law: Law, model: Model, asked_mm: np.ndarray) -> Result:
    """Forces at the asked travels (mm, increasing); raises stepping.Stopped with what was reached."""
    started = time.process_time()
    epsilon = penalty(model.surface, model.body, settings, law)
    system = System(model.body, law, model.surface, settings.indenter, epsilon, model.factor)
    touch = settings.body.top + np.array([0.0, 0.0, settings.indenter.R])
    down = np.array([0.0, 0.0, -1.0])
    nothing = np.zeros(model.surface.weights.shape)
    counters = Counters()

    def start(s: float) -> Load:
        return Load(touch + s * down, nothing, down, raised(model.surface, model.body, settings, s))

    points = stepping.travel(system, start, np.asarray(asked_mm, float), settings.control, counters)
    return collect(model, points, counters, time.process_time() - started)


def penalty(surface: ContactSurface, body: element.Body, settings: Settings, law: Law) -> np.ndarray:
    """ε (f, q) MPa/mm at the contact points, a multiple of μ/R so that similarity stays exact."""
    return np.full(surface.weights.shape, PENALTY * law.shear_modulus / settings.indenter.R)


def raised(surface: ContactSurface, body: element.Body, settings: Settings, travel: float) -> np.ndarray:
    """Factor (f, q) on ε around the first contact, 1 to R of travel, growing to 1 + RAISED from there to 2R.

    ε acts per reference area, and the skin under a deep ball stretches up to twenty times in area: with a uniform ε the
    ball would pierce the surface at depths beyond 2R.
    """
    points = np.einsum("qa,fai->fqi", surface.N, body.nodes[surface.facets])
    d = np.linalg.norm(points - settings.body.top, axis=-1) / settings.indenter.R
    deep = min(max(travel / settings.indenter.R - 1.0, 0.0), 1.0)
    return 1.0 + RAISED * deep * np.exp(-((d / RAISED_WITHIN) ** 2))


def collect(model: Model, points: list[Point], counters: Counters, cpu_s: float) -> Result:
    """Channels of the whole specimen (four quarters) from the points reached."""
    at = [p.equilibrium.evaluation for p in points]
    return Result(
        travel=np.array([p.travel for p in points]),
        Fz=np.array([4.0 * e.contact.force[2] for e in at]),
        reaction=np.array([4.0 * (e.residual - e.contact.residual)[model.held, 2].sum() for e in at]),
        uz_max=np.array([-e.u[:, 2].min() for e in at]),
        bulge=np.array([e.u[:, 2].max() for e in at]),
        contact_error=np.array([4.0 * abs((p.previous_force - p.force)[2]) for p in points]),
        counters=counters,
        cpu_s=cpu_s,
    )
