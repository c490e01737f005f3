"""How much each parameter moves each quantity: one at a time about a point, and Sobol indices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso.emulation.sensitivity import Morris, SobolIndices, morris, saltelli_indices
from rso.objectives.plan import ParetoPlan
from rso.objectives.surfaces import Surfaces

N_SLICE_POINTS = 41  # points of a slice along a range


@dataclass(frozen=True, eq=False)
class ParameterSlice:
    """A quantity along one parameter with the others at a point: values θ (n,), y (n,), its standard deviation (n,)."""

    parameter: str
    quantity: str
    theta: np.ndarray
    y: np.ndarray
    sd: np.ndarray


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """By quantity: Sobol indices and elementary effects where they were asked for; slices about the point `centre`."""

    centre: np.ndarray
    indices: Mapping[str, SobolIndices]
    effects: Mapping[str, Morris]
    slices: tuple[ParameterSlice, ...]


def sensitivities(plan: ParetoPlan, surfaces: Surfaces, centre: np.ndarray) -> Sensitivities:
    """Of all quantities over the ranges; levels and texts count as equally likely.

    Conditions between parameters restrict the indices to where they hold.
    """
    table, space = plan.study.sensitivity, plan.space
    constraint = plan.feasible if plan.conditions else None
    indices, effects = {}, {}
    for k, (text, surface) in enumerate(surfaces.each.items()):
        if table.sobol:
            indices[text] = saltelli_indices(
                surface.mean,
                space.d,
                plan.seed + k,
                table.samples,
                constraint,
                sd=lambda U, s=surface: s.predict(U)[1],  # type: ignore[misc]
            )
        if table.morris:
            effects[text] = morris(surface.mean, space.d, plan.seed + k, constraint=constraint)
    slices = tuple(
        _slice(surfaces, j, text, centre) for text in surfaces.each for j in range(space.d)
    ) if table.local else ()  # fmt: skip
    return Sensitivities(centre, indices, effects, slices)


def _slice(surfaces: Surfaces, j: int, text: str, centre: np.ndarray) -> ParameterSlice:
    space = surfaces.space
    levels = len(space.levels[j])
    x = (np.arange(levels) + 0.5) / levels if levels else np.linspace(0.0, 1.0, N_SLICE_POINTS)
    U = np.tile(centre, (len(x), 1))
    U[:, j] = x
    y, sd = surfaces.each[text].predict(U)
    return ParameterSlice(space.names[j], text, space.values(U)[:, j], y, sd)
