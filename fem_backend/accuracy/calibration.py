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
    """Shares of a pair of specimen and indenter, as calibration.toml explains them; `inflated` multiplies errors."""

    specimen: str
    indenter: str
    source: str
    off_top: float
    tiny: float
    shallow: float
    penetration: float
    lumped: float
    layered: float
    uneven: float
    deep: float
    distorted: float
    at_least: float
    shares: Mapping[str, tuple[float, ...]]
    level: Mapping[str, Level] = field(default_factory=dict)
    inflated: float = 1.0

    def at(self, level: str) -> Level:
        """Shares of a level; those of coarse, with a mesh that is not calibrated, for another."""
        return self.level.get(level, Level())


@functools.cache
def calibrated_pairs() -> Mapping[tuple[str, str], Calibration]:
    """(specimen, indenter) → its calibration, for all pairs of the table."""
    found = {}
    for pair in tomllib.loads(CALIBRATION_TABLE.read_text(encoding="utf-8"))["pair"]:
        shares = {name: tuple(values) for name, values in pair.pop("shares").items()}
        levels = {name: Level(**values) for name, values in pair.pop("level").items()}
        c = Calibration(**pair, shares=shares, level=levels)
        found[c.specimen, c.indenter] = c
    return found


def calibration(settings: Settings) -> Calibration:
    """The calibration of this pair; for one that nobody has fitted the first of the table.

    Its errors are inflated by UNFITTED_ERROR_FACTOR.
    """
    table = calibrated_pairs()
    pair = settings.specimen.name, settings.indenter.name
    return table[pair] if pair in table else replace(next(iter(table.values())), inflated=UNFITTED_ERROR_FACTOR)


def uncalibrated(settings: Settings) -> str | None:
    """What a reader must know of the errors that runs with these settings state; None where the pair is calibrated."""
    c = calibration(settings)
    if c.inflated == 1.0 or on_axis(settings):
        return None  # a meridian states its errors by a second run of its own
    return (
        f"numerical errors are not calibrated for specimen.shape = {settings.specimen.name!r} under indenter.shape = "
        f"{settings.indenter.name!r}: stated are {c.inflated:g} times those of {c.specimen!r} under {c.indenter!r}"
    )
