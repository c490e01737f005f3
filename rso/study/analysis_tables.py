"""The tables [diagnose], [ladder] and [next] of study.toml: what is asked beyond the parameters."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from rso.study.base_table import StudyFileTable
from rso.study.fields import (
    ONE_OR_MORE,
    TEXT_SCHEMA,
    Bound,
    Channels,
    Confidence,
    Depth,
    Name,
    Runs,
    Settings,
    also,
    expected,
    list_to_tuple,
    listed_once,
    names_of_effects,
)
from rso.study.noise_table import NoiseTable
from rso.study.search_table import Range


class DiagnoseTable(StudyFileTable):
    """[diagnose]: where the model misses the measurements, and why."""

    effects: Annotated[Any, AfterValidator(names_of_effects), expected('"all" or a list of names')] = "all"
    """The catalogue: all effects, or those named."""
    keep_ranges: bool = True
    """Whether ranges are bounds; else one besides the modulus is bounded by the range of its product with it alone."""
    settings: Settings = Field(default_factory=dict)
    """In place of those of the backend in the library of effects, as a coarser mesh."""
    known: dict[str, Any] = Field(default_factory=dict)
    """Effects that a calibration bounds, with the standard uncertainty of each, as compliance = "0.02 mm/N"."""


class LevelTable(StudyFileTable):
    """One level of a ladder; with nothing but a name, or as bare text, what the backend knows by this name."""

    name: Name
    """What the level is called."""
    description: Annotated[str, Field(max_length=200)] = ""
    """In a line, for the report."""
    settings: Settings = Field(default_factory=dict)
    """In place of those of the study."""
    open: dict[str, Range] = Field(default_factory=dict)
    """Parameters that the level opens, with [low, high]."""
    alone: bool = False
    """Whether it is put on the study itself, not on the level that holds by then."""


def _rungs(value: Any) -> Any:
    """Lists of levels as tables; one that stands alone is a rung of its own."""
    if not isinstance(value, list):
        return value
    rungs = [v if isinstance(v, list) else [v] for v in value]
    return tuple(tuple({"name": v} if isinstance(v, str) else v for v in rung) for rung in rungs)


Rung = Annotated[tuple[Annotated[LevelTable, also(TEXT_SCHEMA)], ...], ONE_OR_MORE]


class LadderTable(StudyFileTable):
    """[ladder]: models from simple to rich, until the data ask for no more."""

    levels: Annotated[tuple[Rung, ...], BeforeValidator(_rungs)] = ()
    """From simple to rich, a list within the list holds alternatives; by default all that the backend offers."""
    runs: Runs | None = None
    """Size of the design of each level."""
    confidence: Confidence = 0.95
    """A model is refuted where a true one would do as badly with less than the rest of this."""
    draws: Annotated[int, Field(ge=99, le=100_000)] = 400
    """Simulated data sets behind every p-value."""
    ranges: Literal["study", "start"] = "study"
    """Whether open parameters are searched where the study says or where a closed form of the backend does."""
    count_validation: bool = False
    """Whether curves for validation count as those for selection: nothing is then left to validate on."""


MAX_PROFILE_READINGS = 1000  # of a curve that might be measured: their covariance is a matrix


class NextExperiment(StudyFileTable):
    """[[next.experiments]]: an experiment that might be done: a force curve, or with `marks` and `depths` a profile."""

    name: Name
    """How it is called in the answer."""
    words: Annotated[str, Field(max_length=200)] = ""
    """In a line, what it is."""
    settings: Settings = Field(default_factory=dict)
    """In place of those of the backend."""
    depth: Depth = 4.0
    """Down to which it is read."""
    step: Depth = 0.1
    """Between two readings."""
    channels: Channels = ("Fz",)
    """What is read."""
    marks: Annotated[
        tuple[Annotated[tuple[float, float], BeforeValidator(list_to_tuple)], ...],
        BeforeValidator(list_to_tuple),
        AfterValidator(listed_once),
    ] = ()
    """Or surface points [x, y], mm, whose displacement uz is read."""
    depths: Annotated[tuple[Depth, ...], BeforeValidator(list_to_tuple), AfterValidator(listed_once)] = ()
    """At which the marks are read."""
    noise: NoiseTable = NoiseTable()
    """How well it is read."""

    @model_validator(mode="after")
    def _profile(self) -> NextExperiment:
        if bool(self.marks) != bool(self.depths):
            raise ValueError("a profile needs both marks and depths, a force curve neither")
        if self.step > self.depth:
            raise ValueError(f"step = {self.step:g} mm is larger than depth = {self.depth:g} mm")
        if self.depth / self.step > MAX_PROFILE_READINGS:
            raise ValueError(
                f"step = {self.step:g} mm: more than {MAX_PROFILE_READINGS} readings down to {self.depth:g} mm"
            )
        return self


class NextTable(StudyFileTable):
    """[next]: what experiments that nobody has done yet would show."""

    experiments: Annotated[tuple[NextExperiment, ...], BeforeValidator(list_to_tuple)] = ()
    """The experiments that are asked about."""
    truths: dict[str, Annotated[tuple[Bound, ...], BeforeValidator(list_to_tuple)]] = Field(default_factory=dict)
    """A parameter and values that it is asked for (default: up to five that the data allow, of the one known worst)."""
    runs: Runs | None = None
    """Size of the design of each experiment."""
    draws: Annotated[int, Field(ge=10, le=10_000)] = 60
    """Simulated data sets behind every expectation."""

    @field_validator("experiments")
    @classmethod
    def _names_apart(cls, value: tuple[NextExperiment, ...]) -> tuple[NextExperiment, ...]:
        names = [e.name for e in value]
        if twice := sorted({n for n in names if names.count(n) > 1}):
            raise ValueError(f"the name {twice[0]!r} is there twice")
        return value

    @field_validator("truths")
    @classmethod
    def _one_parameter(cls, value: dict[str, Any]) -> dict[str, Any]:
        if len(value) > 1:
            raise ValueError(f"one parameter at a time, not {', '.join(value)}: the others follow the data")
        return value
