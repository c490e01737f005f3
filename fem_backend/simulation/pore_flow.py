"""Where liquid may leave a body with pore flow: its open surface, what the indenter covers, what the support holds."""

from __future__ import annotations

import numpy as np

from fem_backend.kinematics import pore_pressure
from fem_backend.kinematics.axisymmetric import MeridianBody
from fem_backend.simulation.experiment import POROUS
from fem_backend.simulation.initial_state import InitialState
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver import direct
from fem_backend.solver.biphasic import Pores


def pores_of(at: InitialState) -> Pores:
    """The liquid of an experiment.

    Pore pressure is that of the bath on all of the surface that nothing touches.  Where the indenter touches, or the
    support holds or may touch, it is so if that is porous; else no liquid passes there.
    """
    body, facets = at.model.body, at.model.facets
    assert isinstance(body, MeridianBody)  # others are refused
    under, below = (drains == POROUS for drains in at.settings.drainage)
    pressed = at.system.pressing.surface.facets
    supported = _supported(at, facets)
    covered = _among(facets, pressed) & ~supported
    space = pore_pressure.porous(body)
    open_ = facets[np.where(supported, below, np.where(covered, under, True))]
    may_close = None
    if not under:
        may_close = pore_pressure.open_edges(space, pressed)
        may_close.products[~_among(pressed, facets[covered])] = 0.0
    unit = at.system.material.shear_modulus / at.placement.indenter.length
    factor = direct.precise(space.pattern, at.settings.solver)
    edges = pore_pressure.open_edges(space, open_)
    storage, closes = _storage(at.knobs), at.settings.closes
    return Pores(space, at.knobs.permeability, unit, factor, edges, may_close, storage, closes)


def _storage(knobs: Knobs) -> float:
    """S (1/MPa) of a liquid that makes the drained K = 2/D1 that of before it leaves, 2/(D1 − pore_D1) = K + 1/S."""
    if not knobs.pore_D1:
        return 0.0
    return float(1.0 / (2.0 / (knobs.D1 - knobs.pore_D1) - 2.0 / knobs.D1))


def _supported(at: InitialState, facets: np.ndarray) -> np.ndarray:
    """Whether edges (e,) are held by the support as a whole, or may touch it."""
    held = np.zeros(len(at.model.body.nodes), bool)
    held[at.model.held] = True
    out = held[facets].all(1)
    for pair in at.system.seat:
        out |= _among(facets, pair.surface.facets)
    return np.asarray(out)


def _among(facets: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether edges (e, 3) are among others, by their middles."""
    return np.isin(facets[:, 2], others[:, 2])
