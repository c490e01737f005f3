"""The finite element model of `indentation` as a backend of `rso.contract`."""

from __future__ import annotations

import dataclasses
import functools
import platform
from collections.abc import Mapping
from typing import Any

import numpy as np

from fem_backend import indentation, linsolve, meshing
from fem_backend.indentation import Knobs, Model, Result, Settings
from fem_backend.laws import Law
from fem_backend.stepping import Control, Stopped
from rso.contract import Case, Parameter, Programme, Response, SimulationFailed, drop_neutral, parameters_of

NUMERICS = 1  # raised when, and only when, answers change
UNITS = {"time": "s", "travel": "mm", "Fx": "N", "Fy": "N", "Fz": "N", "uz_max": "mm", "bulge": "mm"}
STIFFEST = 1000.0  # K/μ beyond which the displacement element is not verified


@dataclasses.dataclass(frozen=True)
class FiniteElements:
    """Indentation of a soft ellipsoid: Backend of `rso.contract`, picklable and stateless."""

    name: str = "fem_backend"
    numerics: int = NUMERICS

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every knob of :class:`fem_backend.indentation.Knobs`."""
        return parameters_of(Knobs)

    @property
    def channels(self) -> Mapping[str, str]:
        """Name → unit of every channel."""
        return UNITS

    def check(self, case: Case) -> None:
        """Raise ValueError for settings or programmes that are not modelled."""
        settings = indentation.read_settings(case.settings)
        asked, deepest = case.programme.asked_mm, 0.3 * float(settings.body.semi_axes.min())
        if max(asked) > deepest:
            raise ValueError(f"travel {max(asked):g} mm: at most {deepest:g} mm (0.3 of the smallest semi-axis)")
        if np.any(np.diff(case.programme.travel_mm) < 0):
            raise ValueError(
                "the programme unloads: an elastic body returns on its loading curve, ask for loading only"
            )

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Defaults written out; speed, direction at the top and the solver dropped: they do not change the answer."""
        settings = indentation.read_settings(case.settings)
        plain = {
            "specimen": {"shape": "ellipsoid", "semi_axes": settings.body.semi_axes.tolist()},
            "indenter": {"shape": "sphere", "radius": settings.indenter.R},
            "support": {"kind": "fixed"},
            "material": {"law": settings.law},
            "mesh": dict(settings.mesh),
        }
        programme = Programme.ramp(case.programme.asked_mm, 1.0)
        return drop_neutral(self.parameters, values), dataclasses.replace(case, settings=plain, programme=programme)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """The mesh of the experiment."""
        return {"mesh": indentation.read_settings(case.settings).recipe}

    def make(self, recipe: str) -> bytes:
        """A mesh from its recipe; raises SimulationFailed (bad_geometry) if there is none."""
        try:
            return meshing.cached(recipe).to_bytes()
        except meshing.BadMesh as error:
            raise SimulationFailed("bad_geometry", f"no mesh: {error}") from error

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Forces at the asked travels, or SimulationFailed with the curve so far."""
        self.check(case)
        settings = indentation.read_settings(case.settings)
        law = _law(settings, self._values(values))
        path = case.artefact("mesh")
        model = _model(dataclasses.replace(settings, law="", control=Control()), None if path is None else str(path))
        try:
            result = indentation.solve(settings, law, model, np.array(case.programme.asked_mm))
        except Stopped as stopped:
            partial = None
            if stopped.points:
                reached = indentation.collect(model, stopped.points, stopped.counters, 0.0)
                partial = _response(reached, case, model, settings)
            history = tuple({"iteration": k, "residual": r} for k, r in enumerate(stopped.history))
            raise SimulationFailed(stopped.cause, str(stopped), partial, history) from stopped
        return _response(result, case, model, settings)

    def _values(self, values: Mapping[str, float]) -> dict[str, float]:
        known = {p.name: p for p in self.parameters}
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise ValueError(f"unknown parameter {unknown[0]!r}; choose from {', '.join(known)}")
        missing = sorted(n for n, p in known.items() if p.default is None and n not in values)
        if missing:
            raise ValueError(f"parameter {missing[0]!r} ({known[missing[0]].unit}) has no value")
        return {n: p.check(values.get(n, p.default)) for n, p in known.items()}


BACKEND = FiniteElements()


def _law(settings: Settings, values: Mapping[str, float]) -> Law:
    law = indentation.LAWS[settings.law](mu=values["mu"], D1=values["D1"])
    ratio = law.bulk_modulus / law.shear_modulus
    if ratio > STIFFEST:
        raise SimulationFailed(
            "not_supported", f"K/mu = {ratio:.4g}: the element is verified to {STIFFEST:g} (nearly incompressible)"
        )
    return law


@functools.lru_cache(maxsize=4)
def _model(settings: Settings, mesh: str | None) -> Model:
    """Discretisation, shared by all runs of a worker on one mesh; SimulationFailed (bad_geometry) without a mesh."""
    if mesh is not None:
        return indentation.build(settings, meshing.Mesh.from_file(mesh))
    try:
        return indentation.build(settings, meshing.cached(settings.recipe))
    except meshing.BadMesh as error:
        raise SimulationFailed("bad_geometry", f"no mesh: {error}") from error


def _passage(programme: Programme, travel: np.ndarray) -> np.ndarray:
    """Time (s) at which a loading programme first reaches each travel."""
    u, t = np.array(programme.travel_mm), np.array(programme.time_s)
    rising = np.concatenate([[True], np.diff(u) > 0])
    return np.interp(travel, u[rising], t[rising])


def _response(result: Result, case: Case, model: Model, settings: Settings) -> Response:
    travel = result.travel
    zero = np.zeros_like(travel)
    info: dict[str, Any] = {
        "cpu_s": result.cpu_s,
        **dataclasses.asdict(result.counters),
        "nodes": len(model.body.nodes),
        "dofs": model.body.pattern.size,
        "solver": linsolve.available() if settings.solver == "auto" else settings.solver,
        "machine": platform.machine(),
        "reaction_Fz": result.reaction.tolist(),
    }
    return Response(
        channels={
            "time": _passage(case.programme, travel),
            "travel": travel,
            "Fx": zero,
            "Fy": zero,
            "Fz": result.Fz,
            "uz_max": result.uz_max,
            "bulge": result.bulge,
        },
        units=dict(UNITS),
        error={
            "Fz": indentation.force_error(settings, result),
            "uz_max": 1e-3 + zero,
            "bulge": 1e-3 + zero,
            "Fx": zero,
            "Fy": zero,
        },
        info=info,
    )
