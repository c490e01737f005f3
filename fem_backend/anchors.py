"""Anchors: the states of one cold run, from which every other elastic run of the same experiment starts.

An anchor depends on its recipe only, and Newton converges so far that the start does not show in an answer: the
result of a run is the same to 1e-8 with and without.
"""

from __future__ import annotations

import functools
import io
import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fem_backend import experiment, indentation
from fem_backend import model as modelling
from fem_backend.experiment import Knobs, Settings
from fem_backend.model import Model
from fem_backend.stepping import Guess, Instant, Stopped


def recipe(settings: Settings, knobs: Knobs, asked_mm: Sequence[float]) -> str:
    """Recipe of the anchor: the plain neo-Hookean experiment with μ = 1 MPa and K/μ rounded to a power of ten.

    Its model must have the nodes of the run's, so it keeps the symmetry that the knobs leave.  Raises NotModelled.
    """
    placement = modelling.place(settings, knobs)
    ratio = 2.0 / (knobs.mu * knobs.D1)
    plain = experiment.plain_settings(settings) | {"material": {"law": "neo_hookean"}, "profile": [], "earlier": 0.0}
    decade = 10.0 ** min(max(round(math.log10(ratio)), 0), 2)
    return json.dumps(
        {"anchor": 1, "settings": plain, "recipe": settings.recipe, "planes": placement.planes, "K_over_mu": decade,
         "clearance": knobs.bowl_clearance if settings.support == "bowl" else None, "asked_mm": list(asked_mm)},
        sort_keys=True,
    )  # fmt: skip


def is_anchor(recipe: str) -> bool:
    """Whether a recipe is that of an anchor."""
    return "anchor" in json.loads(recipe)


def make(recipe: str) -> bytes:
    """Compute an anchor: an npz with travel (k,) mm and u (k, n, 3) mm of as many asked travels as could be reached.

    Raises meshing.BadMesh.
    """
    data = json.loads(recipe)
    settings = experiment.read_settings(data["settings"])
    knobs = Knobs(mu=1.0, D1=2.0 / data["K_over_mu"], bowl_friction=0.0)
    if data["clearance"] is not None:
        knobs = replace(knobs, bowl_clearance=data["clearance"])
    placement = replace(modelling.place(settings, knobs), planes=tuple(data["planes"]))
    model = modelling.model_for(settings, knobs, placement, None)
    instants = [Instant(s, s, True) for s in data["asked_mm"]]
    try:
        points = indentation.solve(settings, knobs, placement, model, instants).points
    except Stopped as stopped:
        points = tuple(stopped.points)
    out = io.BytesIO()
    u = np.array([p.evaluation.u for p in points], np.float32).reshape(-1, *model.body.nodes.shape)
    np.savez(out, travel=np.array([p.travel for p in points]), u=u)
    return out.getvalue()


def guess(path: str, model: Model) -> Guess:
    """Start (n, 3) at a travel (mm) from an anchor's file; None where it offers nothing for this model."""
    travel, u = _read(path)

    def offer(s: float) -> np.ndarray | None:
        if u.shape[1:] != model.body.nodes.shape or not len(travel):
            return None
        k = int(np.argmin(np.abs(travel - s)))
        if abs(travel[k] - s) > 1e-9:
            return None
        start = u[k].astype(float)
        start[model.body.free.reshape(-1, 3) < 0] = 0.0
        return start

    return offer


@functools.lru_cache(maxsize=8)
def _read(path: str) -> tuple[np.ndarray, np.ndarray]:
    with np.load(path, allow_pickle=False) as data:
        return data["travel"], data["u"]
