"""What meshes miss, by specimen, indenter and level: a table beside this file, fitted by benchmarks/fe_errors.py."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from fem_backend.simulation.experiment import Settings, on_axis

CALIBRATION_TABLE = Path(__file__).with_suffix(".toml")  # beside this file
UNFITTED_ERROR_FACTOR = 3.0  # times as much for a pair that nobody has fitted: a wide guess, no calibration


@dataclass(frozen=True)
class Level:
    """Shares of one level of the mesh; 1 is that of coarse.

    `mesh` of the specimen's mesh, None where it is not calibrated; `below` of contact with the support, `distorts` of
    what distorted elements add, `extrapolated` of the error of forces that are extrapolated.
    """

    mesh: float | None = None
    below: float = 1.0
    distorts: float = 1.0
    extrapolated: float = 1.0


@dataclass(frozen=True)
class Calibration:
    """Shares of specimens under an indenter, as calibration.toml explains them; `inflated` multiplies errors.

    `only_in_space`: of grids in three dimensions alone, of what does not stick and with elements of small strain.
    """

    specimens: tuple[str, ...]
    indenter: str
    source: str
    mean_edge: float
    off_top: float
    tiny: float
    penetration: float
    lumped: float
    layered: float
    uneven: float
    deep: float
    distorted: float
    at_least: float
    shares: Mapping[str, tuple[float, ...]]
    level: Mapping[str, Level] = field(default_factory=dict)
    shallow: float | None = None
    film: float = 0.0
    edge_by_level: bool = True
    only_in_space: bool = False
    inflated: float = 1.0

    def at(self, level: str) -> Level:
        """Shares of a level; those of coarse, with a mesh that is not calibrated, for another."""
        return self.level.get(level, Level())


@functools.cache
def calibrated_pairs() -> Mapping[tuple[str, str], Calibration]:
    """(specimen, indenter) → its calibration, for all pairs of the table."""
    found: dict[tuple[str, str], Calibration] = {}
    for pair in tomllib.loads(CALIBRATION_TABLE.read_text(encoding="utf-8"))["pair"]:
        specimens = tuple(pair.pop("specimens"))
        shares = {name: tuple(values) for name, values in pair.pop("shares").items()}
        levels = {name: Level(**values) for name, values in pair.pop("level").items()}
        c = Calibration(**pair, specimens=specimens, shares=shares, level=levels)
        found |= {(name, c.indenter): c for name in specimens}
    return found


def calibration(settings: Settings, apart: bool = False) -> Calibration:
    """The calibration of this pair; for one that nobody has fitted the first of the table.

    Its errors are inflated by UNFITTED_ERROR_FACTOR.  `apart`: a run that sticks, is on its meridian or has elements of
    large strain, which is not among those that pairs are fitted to `only_in_space`.
    """
    table = calibrated_pairs()
    c = table.get((settings.specimen.name, settings.indenter.name))
    if c is None or (apart and c.only_in_space):
        return replace(next(iter(table.values())), inflated=UNFITTED_ERROR_FACTOR)
    return c


def uncalibrated(settings: Settings, sticks: bool = False) -> str | None:
    """What a reader must know of the errors that runs with these settings state; None where the pair is calibrated.

    `sticks`: with adhesion.
    """
    c = calibration(settings, sticks)
    if c.inflated == 1.0 or on_axis(settings):
        return None  # a meridian states its errors by a second run of its own
    with_it = " with adhesion" if calibration(settings).inflated == 1.0 else ""
    return (
        f"numerical errors are not calibrated for specimen.shape = {settings.specimen.name!r} under indenter.shape = "
        f"{settings.indenter.name!r}{with_it}: stated are {c.inflated:g} times those of {c.specimens[0]!r} under "
        f"{c.indenter!r}"
    )
