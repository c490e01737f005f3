"""Which planes cut a run in parts that are alike: those of everything in it."""

from __future__ import annotations

import numpy as np

from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs


def planes(settings: Settings, knobs: Knobs, direction: np.ndarray, through: np.ndarray) -> tuple[bool, bool]:
    """Whether x = 0 and y = 0 are planes of symmetry of specimen, indenter, support, path, inclusion and fibres alike.

    The path is the line through the point `through` (3,) mm along `direction` (3,) in the frame of the specimen.
    """
    allowed = [settings.specimen.planes(), settings.indenter.planes(), settings.support.planes()]
    allowed += [_path(knobs, direction, through), _fibres(knobs), _inclusion(knobs)]
    x, y = (all(each[k] for each in allowed) for k in (0, 1))
    return x, y


def axisymmetric(settings: Settings, knobs: Knobs, direction: np.ndarray, through: np.ndarray) -> bool:
    """Whether all of it is of revolution about z: specimen, indenter, support, path, inclusion, and no fibres."""
    members = settings.specimen, settings.indenter, settings.support
    on_axis = all(_path(knobs, direction, through)) and all(_inclusion(knobs))
    return all(m.of_revolution for m in members) and on_axis and knobs.fibre == 0.0


def _path(knobs: Knobs, direction: np.ndarray, through: np.ndarray) -> tuple[bool, bool]:
    """The way of the indenter lies in the plane, and so does gravity."""
    tilt = (knobs.tilt_y, knobs.tilt_x)
    x, y = (bool(direction[k] == 0.0 and through[k] == 0.0 and tilt[k] == 0.0) for k in (0, 1))
    return x, y


def _fibres(knobs: Knobs) -> tuple[bool, bool]:
    """Fibres along x or y, or none."""
    angle = np.deg2rad(knobs.fibre_angle)
    along = min(abs(np.cos(angle)), abs(np.sin(angle))) < 1e-12
    return (bool(knobs.fibre == 0.0 or along),) * 2


def _inclusion(knobs: Knobs) -> tuple[bool, bool]:
    """An inclusion centred on the plane, or none."""
    none = not (knobs.inclusion_ratio != 1.0 and knobs.inclusion_radius > 0)
    return bool(none or knobs.inclusion_x == 0.0), bool(none or knobs.inclusion_y == 0.0)
