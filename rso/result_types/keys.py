"""What all result files share: how a key is written down, and the pieces that several files have."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

Number = float | None
Numbers = tuple[float | None, ...]
Interval = tuple[float | None, float | None]
ByName = dict[str, float | None]  # parameter, or another name, → number
Texts = tuple[str, ...]


def holds(meaning: str, unit: str = "", absent: bool = False) -> Any:
    """A key: what it holds, in which unit, and whether it may be absent."""
    extra: JsonDict = {"unit": unit} if unit else {}
    return Field(default=None if absent else ..., description=meaning, json_schema_extra=extra)


class ResultBlock(BaseModel):
    """A table of a result file: nothing else is in it."""

    model_config = ConfigDict(frozen=True, extra="forbid", alias_generator=lambda name: name.rstrip("_"))


class StudyBlock(ResultBlock):
    """Which study it is."""

    title: str = holds("its title")
    file: str = holds("name of the study file")
    seed: int = holds("root of all random numbers")
    units: str = holds("N-mm-MPa-s")


class ProvenanceBlock(ResultBlock):
    """Which program computed the file, from which data."""

    rso: str = holds("version")
    backend: str = holds("name of the backend")
    numerics: int = holds("version of the backend's numbers")
    command: str = holds("the command, without paths", absent=True)
    finished: str = holds("when, UTC")
    data_sha256: dict[str, str] = holds("data file → hash")


class DrawnBlock(ResultBlock):
    """A line or an area of a sketch."""

    role: str = holds("as in `rso.contract.Drawn`")
    points: tuple[tuple[float, float], ...] = holds("across and up", "mm")
    text: str = holds("its label")


class SketchBlock(ResultBlock):
    """A different experiment, drawn."""

    experiments: Texts = holds("their names")
    words: str = holds("a sentence")
    plane: str = holds("the plane of the drawing")
    drawn: tuple[DrawnBlock, ...] = holds("lines and areas")


class ReadingsBlock(ResultBlock):
    """Measured readings of a channel."""

    depth: Numbers = holds("depth", "mm")
    value: Numbers = holds("mean of the repeats, in the unit of the channel")
    sigma: Numbers = holds("standard uncertainty of it")
    position: tuple[tuple[float, float], ...] = holds("place of each reading of a profile, else empty", "mm")
    since: Numbers | None = holds("time since the indenter came to rest, 0 while it moves", "s", absent=True)


class MetricsBlock(ResultBlock):
    """Errors of a curve."""

    rmse: Number = holds("root mean square error, in the unit of the curve")
    nrmse: Number = holds("RMSE over the mean size")
    mre: Number = holds("mean relative error")
    mape: Number = holds("mean absolute relative error", "%")
    rrmse: Number = holds("root mean square of relative errors")
    n: int = holds("number of points")
    excluded: int = holds("points of at most `floor`, which are not in the relative norms")
    floor: Number = holds("measured size below which no relative error counts")
