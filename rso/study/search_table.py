"""The table [search] of study.toml: targets, constraints, variants, and how it is searched."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from rso.core.units import COLUMN_UNITS, value_in_unit
from rso.study.base_table import StudyFileTable
from rso.study.fields import Bound, Depth, Moment, Name, Positive, even, formed, list_to_tuple


class TargetTable(StudyFileTable):
    """A force (or displacement) to meet at one depth, on the way there or in a hold."""

    experiment: str
    """Name of the experiment."""
    depth: Depth
    """At which the value is met."""
    channel: Literal["Fx", "Fy", "Fz", "ux", "uy", "uz"] = "Fz"
    """What is met."""
    since: Moment = 0.0
    """In a hold at that depth, the time since the indenter came to rest; the nearest moment that is compared counts."""
    value: float | None = None
    """What it must be; read off the measured curve where it is not stated."""

    @field_validator("value", mode="before")
    @classmethod
    def _in_unit_of_channel(cls, value: Any, info: ValidationInfo) -> float:
        return value_in_unit(value, COLUMN_UNITS.get(info.data.get("channel", "Fz"), "N"))


class ConstraintTable(StudyFileTable):
    """A response that must stay within low and high at one depth."""

    experiment: str
    """Name of the experiment."""
    channel: Annotated[str, formed(r"[A-Za-z_]\w*", "expected is the name of a channel, such as Fz")]
    """A channel of the backend."""
    depth: Depth
    """At which the condition holds."""
    low: float | None = None
    """The least that it may be."""
    high: float | None = None
    """The most that it may be."""

    @field_validator("low", "high", mode="before")
    @classmethod
    def _in_unit_of_channel(cls, value: Any, info: ValidationInfo) -> float:
        channel = info.data.get("channel", "Fz")
        if channel not in COLUMN_UNITS and isinstance(value, str):
            raise ValueError(f"the unit of channel {channel!r} is the backend's, give a bare number in it")
        return value_in_unit(value, COLUMN_UNITS.get(channel, "1"))

    @model_validator(mode="after")
    def _ordered(self) -> ConstraintTable:
        if self.low is None and self.high is None:
            raise ValueError("give low, high or both")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low = {self.low:g} must be below high = {self.high:g}")
        return self


Range = Annotated[tuple[Bound, Bound], BeforeValidator(list_to_tuple)]


class Variant(StudyFileTable):
    """One more search of the same study: other targets and narrower ranges."""

    name: Name
    """How the search is called in the report."""
    targets: Annotated[tuple[TargetTable, ...], BeforeValidator(list_to_tuple)] = ()
    """Its own, in place of those of [search]."""
    ranges: dict[str, Range] = Field(default_factory=dict)
    """Parameter and its narrower range, [low, high]."""


class SearchTable(StudyFileTable):
    """[search]: where the parameters are looked for, on response surfaces of a design or straight on simulations.

    `start`, `starts`, `max_runs` and `derivatives` belong to method "gauss_newton", all others but `metric` to
    "response_surface".
    """

    method: Literal["response_surface", "gauss_newton", "simulations"] = "response_surface"
    """On response surfaces of a design, or whole curves straight on simulations and their derivatives. With
    [objectives] "simulations" makes each individual of NSGA-II a simulation: for models of milliseconds."""
    start: dict[str, Bound] = Field(default_factory=dict)
    """Values to begin with; the middle of the range for a parameter that is left out."""
    starts: Annotated[int, Field(ge=1, le=100)] = 1
    """Places to begin from."""
    max_runs: Annotated[int, Field(ge=2, le=1000)] = 20
    """Points for each start."""
    derivatives: Literal["backend", "differences"] = "backend"
    """Those of the backend, or differences between more runs; unless stated, these where the backend has none."""
    targets: Annotated[tuple[TargetTable, ...], BeforeValidator(list_to_tuple)] = ()
    """Values to meet; without, up to three points of each fitted curve."""
    constraints: Annotated[tuple[ConstraintTable, ...], BeforeValidator(list_to_tuple)] = ()
    """Responses that must stay within bounds."""
    metric: Literal["rmse", "nrmse", "mre", "mape", "rrmse"] = "nrmse"
    """By which whole curves are compared."""
    candidates: Positive = 3
    """How many of them are rerun."""
    population: Annotated[int, Field(ge=4, le=100_000), AfterValidator(even)] = 100
    """Of NSGA-II, an even number."""
    generations: Positive = 100
    """Of NSGA-II."""
    repair: bool = True
    """Whether ranges are widened while candidates press against an end."""
    repair_limit: Annotated[float, Field(gt=1.0, le=1e6)] | None = None
    """How far: by this factor a side on a log scale, by so many widths on a linear one. By default one width
    on its scale. Hard bounds come first, and no range crosses 0 that does not as stated."""
    variants: Annotated[tuple[Variant, ...], BeforeValidator(list_to_tuple)] = ()
    """More searches of the same study."""

    @model_validator(mode="after")
    def _keys_of_method(self) -> SearchTable:
        theirs = {"start", "starts", "max_runs", "derivatives"}
        mine = theirs if self.method == "gauss_newton" else set(type(self).model_fields) - theirs
        mine = {"population", "generations", "candidates"} if self.method == "simulations" else mine
        wrong = sorted(self.model_fields_set - mine - {"method", "metric"})
        if wrong:
            other = "response_surface" if self.method == "gauss_newton" else "gauss_newton"
            raise ValueError(f'{wrong[0]} belongs to method = "{other}", not to "{self.method}"')
        return self
