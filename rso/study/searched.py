"""The table [search] of study.toml: targets, constraints, variants, and how it is searched."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from rso.study.fields import Bound, Depth, Name, Positive, even, formed, list_to_tuple
from rso.study.table import Table
from rso.units import COLUMNS, quantity


class Target(Table):
    """A force (or displacement) to meet at one depth; without `value` it is read off the measured curve."""

    experiment: str
    depth: Depth
    channel: Literal["Fx", "Fy", "Fz", "ux", "uy", "uz"] = "Fz"
    value: float | None = None

    @field_validator("value", mode="before")
    @classmethod
    def _in_unit_of_channel(cls, value: Any, info: ValidationInfo) -> float:
        return quantity(value, COLUMNS.get(info.data.get("channel", "Fz"), "N"))


class Constraint(Table):
    """low ≤ response ≤ high at one depth."""

    experiment: str
    channel: Annotated[str, formed(r"[A-Za-z_]\w*", "expected is the name of a channel, such as Fz")]
    depth: Depth
    low: float | None = None
    high: float | None = None

    @field_validator("low", "high", mode="before")
    @classmethod
    def _in_unit_of_channel(cls, value: Any, info: ValidationInfo) -> float:
        channel = info.data.get("channel", "Fz")
        if channel not in COLUMNS and isinstance(value, str):
            raise ValueError(f"the unit of channel {channel!r} is the backend's, give a bare number in it")
        return quantity(value, COLUMNS.get(channel, "1"))

    @model_validator(mode="after")
    def _ordered(self) -> Constraint:
        if self.low is None and self.high is None:
            raise ValueError("give low, high or both")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low = {self.low:g} must be below high = {self.high:g}")
        return self


Range = Annotated[tuple[Bound, Bound], BeforeValidator(list_to_tuple)]


class Variant(Table):
    """One more search of the same study: other targets (those of [search] if none) and narrower ranges."""

    name: Name
    targets: Annotated[tuple[Target, ...], BeforeValidator(list_to_tuple)] = ()
    ranges: dict[str, Range] = Field(default_factory=dict)


class SearchTable(Table):
    """[search]: where the parameters are looked for, on response surfaces of a design or straight on simulations.

    With method "gauss_newton" whole curves are fitted by runs and their derivatives: from the `start` (the middle of
    the ranges for what it leaves out), or from as many `starts`, with `max_runs` points for each. `derivatives` are
    those of the backend, or differences between more runs. All other keys but `metric` belong to "response_surface".

    Without targets up to three points of each fitted curve are met. With `repair` the ranges of the main search are
    widened while its candidates press against an end: on a log scale by up to the factor `repair_limit` a side, on a
    linear one by that many widths, within the hard bounds.
    """

    method: Literal["response_surface", "gauss_newton"] = "response_surface"
    start: dict[str, Bound] = Field(default_factory=dict)
    starts: Annotated[int, Field(ge=1, le=100)] = 1
    max_runs: Annotated[int, Field(ge=2, le=1000)] = 20
    derivatives: Literal["backend", "differences"] = "backend"
    targets: Annotated[tuple[Target, ...], BeforeValidator(list_to_tuple)] = ()
    constraints: Annotated[tuple[Constraint, ...], BeforeValidator(list_to_tuple)] = ()
    metric: Literal["rmse", "nrmse", "mre", "mape", "rrmse"] = "nrmse"
    candidates: Positive = 3
    population: Annotated[int, Field(ge=4, le=100_000), AfterValidator(even)] = 100
    generations: Positive = 100
    repair: bool = True
    repair_limit: Annotated[float, Field(gt=1.0, le=1e6)] = 10.0
    variants: Annotated[tuple[Variant, ...], BeforeValidator(list_to_tuple)] = ()

    @model_validator(mode="after")
    def _keys_of_method(self) -> SearchTable:
        theirs = {"start", "starts", "max_runs", "derivatives"}
        mine = theirs if self.method == "gauss_newton" else set(type(self).model_fields) - theirs
        wrong = sorted(self.model_fields_set - mine - {"method", "metric"})
        if wrong:
            other = "response_surface" if self.method == "gauss_newton" else "gauss_newton"
            raise ValueError(f'{wrong[0]} belongs to method = "{other}", not to "{self.method}"')
        return self
