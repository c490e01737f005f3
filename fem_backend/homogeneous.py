"""Tension, shear and compression tests of homogeneous strain as a backend of `rso.contract`: every law, exactly.

A test stretches one direction (equibiaxial: two) by λ = 1 ± u/L, u the travel and L the gauge length.  Free faces bear
nothing; what they do is solved for, at any compressibility.  The force is |P| A, A the undeformed area of the stretched
face, positive in the sense of the test: of tension where it pulls, of compression where it pushes.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ValidationError, create_model

from fem_backend import members
from fem_backend.laws import LAWS, Material
from fem_backend.laws.law import Elastic
from fem_backend.laws.law import canonical_law as law_table
from fem_backend.materials import stress
from fem_backend.simulation.knobs import composed
from rso.contract import Case, Parameter, Programme, Response, SimulationFailed, drop_neutral, parameters_of

# Stretches of the faces beside the first, as powers of λ where the law is incompressible; None is held at 1.
FACE_EXPONENTS: Mapping[str, tuple[float | None, float | None]] = {
    "uniaxial": (-0.5, -0.5),
    "planar": (None, -1.0),
    "equibiaxial": (1.0, -2.0),
    "confined": (None, None),
}
FREE_FACES = {"uniaxial": (1, 2), "planar": (2,), "equibiaxial": (2,), "confined": ()}  # by their directions
N_BISECTIONS = 60  # steps: each halves an interval of 4 in the logarithm of a stretch
SIDE_SEARCH_WIDTH = 2.0  # of that logarithm, about the incompressible one
TEST_CHANNEL_UNITS = {"time": "s", "travel": "mm", "Fz": "N"}


def _positive(value: float) -> float:
    if value <= 0.0:
        raise members.refused(": a positive number is expected", value=value)
    return value


Length = Annotated[float, BeforeValidator(members.finite_number), AfterValidator(_positive)]


class HomogeneousTable(members.MemberTable):
    """The settings of a homogeneous test beside its material."""

    test: Annotated[str, BeforeValidator(members.one_of(FACE_EXPONENTS))]
    """uniaxial, planar (pure shear), equibiaxial, or confined (the sides held)."""
    sense: Literal["tension", "compression"] = "tension"
    """Whether travel lengthens or shortens."""
    length: Length = 1.0
    """Gauge length, mm; with 1 the travel is the nominal strain."""
    area: Length = 1.0
    """Undeformed area of the stretched face, mm²; with 1 the force is the nominal stress in MPa."""
    speed: Any = 1.0
    """Not used: the laws here have no memory."""


@functools.lru_cache(maxsize=8)
def _model(now: tuple) -> Any:
    return create_model(
        "HomogeneousSettings",
        __base__=HomogeneousTable,
        material=(Annotated[Any, LAWS], LAWS.members[LAWS.default].Table()),
    )


def read_material_settings(settings: Mapping[str, Any]) -> Any:
    """Settings as a table with a material; ValueError naming key, value and choices."""
    try:
        return _model(tuple(LAWS.members.items())).model_validate(dict(settings))
    except ValidationError as error:
        known: dict[tuple[str, ...], list[str]] = {(): [*HomogeneousTable.model_fields, LAWS.noun]}
        raise ValueError("\n".join(members.problems(error, {LAWS.noun: LAWS}, (), known))) from error


@functools.cache
def _knobs() -> Any:
    return composed((Elastic, *LAWS.knobs()))


def law_of(settings: Any, values: Mapping[str, float]) -> Any:
    """The law of the settings, or that whose own knobs are off their neutral values; ValueError for two."""
    knobs = _knobs()(**values)
    table = settings.material.build()
    own = {name: law for name, law in LAWS.members.items() if law.Knobs is not None}
    used = [name for name, law in own.items() if law.used(knobs, table.ogden)]
    names = {*used, *([table.law] if table.law in own else [])}
    if len(names) > 1 or (used and LAWS.members[table.law].small_strain):
        raise ValueError(f"law {table.law} with knobs of {', '.join(used)}: laws do not combine")
    return LAWS.members[used[0] if used else table.law].of(knobs, table.ogden)


def nominal_stress(law: Any, test: str, stretch: np.ndarray) -> np.ndarray:
    """Nominal stress P (n,) MPa of a law in a test at stretches λ (n,), its free faces without load.

    P₁ = λ₁ S₁₁ with S of the law at F = diag(λ₁, λ₂, λ₃) and S₃₃ = 0 on free faces.  Raises ValueError where no
    stretch of a free face within e^±2 of the incompressible one is without load.
    """
    x, material = np.asarray(stretch, float), Material(law)
    first, second = FACE_EXPONENTS[test]

    def pulled(side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """λ₁ S₁₁ and S of the free face, at logarithmic departures (n,) from the incompressible side."""
        lateral = [np.ones_like(x) if p is None else x**p for p in (first, second)]
        free = FREE_FACES[test]
        lateral = [v * np.exp(side) if k + 1 in free else v for k, v in enumerate(lateral)]
        H = np.stack([x, *lateral], -1)[None, :, :, None] * np.eye(3) - np.eye(3)
        S = stress.evaluate_stress(material, H, tangent=False).S[0]
        return S[:, 0] * x, S[:, 2]

    if not FREE_FACES[test]:
        return pulled(np.zeros_like(x))[0]
    low, high = np.full_like(x, -SIDE_SEARCH_WIDTH), np.full_like(x, SIDE_SEARCH_WIDTH)
    if np.any(pulled(low)[1] > 0.0) or np.any(pulled(high)[1] < 0.0):
        raise ValueError(f"{test}: no width of the free faces is without load")
    for _ in range(N_BISECTIONS):
        middle = 0.5 * (low + high)
        above = pulled(middle)[1] > 0.0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return pulled(0.5 * (low + high))[0]


@dataclasses.dataclass(frozen=True)
class HomogeneousTests:
    """Homogeneous tests of every law without memory: Backend of `rso.contract`."""

    name: str = "fem_backend.homogeneous"
    numerics: int = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The knobs of all laws."""
        return parameters_of(_knobs())

    @property
    def channels(self) -> Mapping[str, str]:
        """Force Fz (N) over travel (mm)."""
        return TEST_CHANNEL_UNITS

    def check(self, case: Case) -> None:
        """ValueError for settings that are none, and for travels that compress to nothing."""
        if case.programme.still:
            raise ValueError("programme: nothing is moved; time_s and travel_mm are expected")
        settings = read_material_settings(case.settings)
        deepest = max(case.programme.travel_mm)
        if settings.sense == "compression" and deepest >= settings.length:
            raise ValueError(f"length = {settings.length:g} mm: a travel of {deepest:g} mm leaves nothing of it")

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Knobs at neutral dropped; no times."""
        settings, known = read_material_settings(case.settings), {p.name: p for p in self.parameters}
        kept = drop_neutral(self.parameters, {k: known[k].check(v) for k, v in values.items()})
        table = settings.material.build()
        plain = {"test": settings.test, "sense": settings.sense, "length": settings.length, "area": settings.area,
                 "material": law_table(table.law, table.ogden, ())}  # fmt: skip
        return kept, dataclasses.replace(case, settings=plain, programme=Programme.ramp(case.programme.asked_mm, 1.0))

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """No artefacts."""
        return {}

    def make(self, recipe: str) -> bytes:
        """Never asked for."""
        raise ValueError(f"{self.name}: makes no artefacts (recipe {recipe!r})")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Forces at the asked travels; SimulationFailed where the law has no answer."""
        settings = read_material_settings(case.settings)
        time, travel = case.programme.passages()
        sign = 1.0 if settings.sense == "tension" else -1.0
        known = {p.name: p.default for p in self.parameters if p.default is not None}
        try:
            law = law_of(settings, {**known, **values})
            stretch = 1.0 + sign * travel / settings.length
            P = nominal_stress(law, settings.test, stretch)
        except (ValueError, stress.Inverted) as error:
            raise SimulationFailed("inadmissible", str(error)) from error
        return Response({"time": time, "travel": travel, "Fz": sign * P * settings.area}, TEST_CHANNEL_UNITS)


BACKEND = HomogeneousTests()
