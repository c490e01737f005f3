"""Anchors: the states of one cold run, from which every other elastic run of the same experiment starts.

An anchor holds its states before and after the multipliers and their derivatives by Poisson's ratio ν, and offers a
body of another ν the states along these tangents.  It depends on its recipe only, and Newton converges so far that the
start does not show in an answer: the result of a run is the same to 1e-8 with and without.
"""

from __future__ import annotations

import functools
import io
import json
import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem_backend import closed_forms, meshing
from fem_backend.laws import LAWS
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import experiment, indentation
from fem_backend.simulation.assembly import AssembledModel
from fem_backend.simulation.derivatives import Slopes, travel_of
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.initial_state import initial_state
from fem_backend.simulation.knobs import Knobs, knobs_class
from fem_backend.solver.load_steps import Guess, Instant, Stage, Stopped
from fem_backend.solver.newton import Counters


def anchor_recipe(settings: Settings, knobs: Knobs, asked_mm: Sequence[float]) -> str:
    """Recipe of the anchor: the plain neo-Hookean experiment with μ = 1 MPa and K/μ rounded to a power of ten.

    Its model must have the nodes of the run's, so it keeps the symmetry that the knobs leave.  Raises NotModelled.
    """
    placement = modelling.placement_of(settings, knobs)
    ratio = 2.0 / (knobs.mu * knobs.D1)
    plain = experiment.plain_settings(settings) | {"material": {"law": LAWS.default}, "profile": [], "earlier": 0.0}
    decade = 10.0 ** min(max(round(math.log10(ratio)), 0), 2)
    return json.dumps(
        {
            "anchor": 2,
            "settings": plain,
            "recipe": settings.recipe,
            "planes": placement.planes,
            "K_over_mu": decade,
            **settings.support.anchored(knobs),
            **({"large_strain": True} if settings.large_strain else {}),
            "asked_mm": list(asked_mm),
        },
        sort_keys=True,
    )


def is_anchor(recipe: str) -> bool:
    """Whether a recipe is that of an anchor."""
    return "anchor" in json.loads(recipe)


def make_anchor(recipe: str) -> bytes:
    """Compute an anchor, an npz of as many asked travels k as could be reached.

    travel (k,) mm; u (k, s, n, 3) mm at the stages s of the multipliers; its derivative `slope` (k, s, n, 3) by
    Poisson's ratio; `ratio` itself.  Raises meshing.BadMesh.
    """
    data = json.loads(recipe)
    settings = replace(
        experiment.read_settings(data["settings"]), recipe=data["recipe"], large_strain=data.get("large_strain", False)
    )
    knobs = knobs_class()(mu=1.0, D1=2.0 / data["K_over_mu"], **settings.support.from_anchor(data))
    placement = replace(modelling.placement_of(settings, knobs), planes=tuple(data["planes"]))
    model = modelling.model_for(settings, knobs, placement, None)
    instants = [Instant(s, s, True) for s in data["asked_mm"]]
    counters = Counters(deadline=time.process_time() + settings.control.time_limit_s)
    states: dict[float, list[np.ndarray]] = {}
    tangents: dict[float, list[np.ndarray]] = {}
    try:
        at = initial_state(settings, knobs, placement, model, counters)
        slopes = Slopes(at, ("D1",))

        def keep(stage: Stage, last: bool) -> None:
            slopes(stage, last)
            s = travel_of(at, stage.load)
            if not any(t.multiplier.any() for t in stage.load.touches):  # a first stage
                states[s], tangents[s] = [], []
            states[s].append(stage.equilibrium.evaluation.u)
            tangents[s].append(slopes.field("D1"))

        indentation.elastic(at, instants, counters, watch=keep)
    except Stopped:
        pass  # what was reached is worth having
    stages = settings.control.augmentations + 1
    reached = [s for s, u in states.items() if len(u) == stages]
    shape = (len(reached), stages, *model.body.nodes.shape)
    K = 2.0 / knobs.D1
    by_ratio = -((6.0 * K + 2.0 * knobs.mu) ** 2) / (9.0 * knobs.mu * K**2)  # dD₁/dν
    out = io.BytesIO()
    np.savez(
        out,
        travel=np.array(reached),
        ratio=closed_forms.poisson_ratio(knobs.mu, K),
        u=np.array([states[s] for s in reached], np.float32).reshape(shape),
        slope=by_ratio * np.array([tangents[s] for s in reached], np.float32).reshape(shape),
    )
    return out.getvalue()


def anchor_guess(path: str, model: AssembledModel, ratio: float) -> Guess:
    """Starts at a travel (mm), for a body of Poisson's ratio `ratio`, from an anchor's file.

    States (n, 3) at the stages of the multipliers; None where it offers nothing for this model.
    """
    travel, u, slope, own = _read(path)

    def offer(s: float) -> list[np.ndarray] | None:
        if u.shape[2:] != model.body.nodes.shape or not len(travel):
            return None
        k = int(np.argmin(np.abs(travel - s)))
        if abs(travel[k] - s) > 1e-9:
            return None
        starts = u[k] + (ratio - own) * slope[k]
        starts[:, model.body.free.reshape(-1, 3) < 0] = 0.0
        return list(starts)

    return offer


@functools.lru_cache(maxsize=8)
def _read(path: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    travel, u, slope, ratio = meshing.read_arrays(path, "anchor", ("travel", "u", "slope", "ratio"))
    return travel, u.astype(float), slope.astype(float), float(ratio)
