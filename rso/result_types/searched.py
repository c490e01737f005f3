"""Pieces of `results.json`: searches, their candidates, and experiments that were not fitted."""

from __future__ import annotations

from typing import Literal

from rso.result_types.keys import ByName, Interval, MetricsBlock, Number, Numbers, ResultBlock, Texts, holds
from rso.result_types.learnt import State


class TargetBlock(ResultBlock):
    """What a search aims at."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    depth_mm: float = holds("depth", "mm")
    value: float = holds("its value")
    sigma: float = holds("its standard uncertainty")
    unit: str = holds("its unit")
    read: bool = holds("whether it was read off the data")
    since_s: Number = holds("time in a hold", "s", absent=True)
    input_error: Number = holds("what inputs in [uncertainty] may move the simulated value by", absent=True)


class FrontBlock(ResultBlock):
    """The Pareto front of the targets."""

    values: tuple[ByName, ...] = holds("parameters")
    objectives: tuple[Numbers, ...] = holds("misses of the targets")


class CandidateOutputBlock(ResultBlock):
    """An output of a candidate."""

    output: str = holds("output id")
    predicted: Number = holds("by the surrogate")
    sd: Number = holds("its standard deviation")
    recomputed: Number = holds("by the simulation")
    numerical_error: Number = holds("estimated error of that")
    target: Number = holds("what was aimed at")


class DemandBlock(ResultBlock):
    """Whether a target or a limit is met."""

    kind: Literal["target", "constraint", "condition"] = holds("what is demanded")
    output: str | None = holds("output id")
    demand: str = holds("in words")
    value: Number = holds("recomputed value")
    miss: Number = holds("by how much it is missed; negative within a limit")
    tolerance: Number = holds(
        "what it may be missed by: `sigma` of a stated target, a millionth of a limit. A target read off the data may "
        "be missed by 3 `sigma` and the numerical error"
    )
    unit: str = holds("unit of both")
    met: bool = holds("whether it is met")
    words: str | None = holds("where it is not met")


class HoldBlock(ResultBlock):
    """A simulated hold."""

    since: Numbers = holds("time at rest", "s")
    value: Numbers = holds("value")
    error: Numbers = holds("estimated numerical error")


class CurveBlock(ResultBlock):
    """A simulated curve."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    depth: Numbers = holds("depth", "mm")
    value: Numbers = holds("value")
    error: Numbers = holds("estimated numerical error")
    hold: HoldBlock | None = holds("where a hold is compared", absent=True)


class CandidateBlock(ResultBlock):
    """A candidate of a search, recomputed."""

    name: str = holds("search and number")
    values: ByName = holds("its parameters")
    state: State = holds("how its runs ended")
    outputs: tuple[CandidateOutputBlock, ...] = holds("its outputs")
    agreement: Number = holds(
        "largest difference of predicted and recomputed targets, over the recomputed value or 20 standard "
        "deviations of "
        "the target where these are larger"
    )
    verified: bool = holds("whether that is within `verify.tolerance`")
    worst: str | None = holds("the output with that difference")
    meets: bool | None = holds("whether every target and limit is met")
    demands: tuple[DemandBlock, ...] = holds("each of them")
    curves: dict[str, CurveBlock] = holds("its curves by name")
    metrics: dict[str, MetricsBlock] = holds("their errors")
    at_bound: Texts = holds("parameters at an end of the search")
    extrapolated: bool = holds("whether it lies outside the convex hull of the runs")


class AuditBlock(ResultBlock):
    """A step of the extension of ranges."""

    round: int = holds("round")
    what: str = holds("`widened`, `taken back`, `kept`, `done` or `stopped`")
    why: str = holds("reason")
    parameter: str | None = holds("whose range", absent=True)
    end: str | None = holds("`low` or `high`", absent=True)
    from_: Number = holds("old end", absent=True)
    to: Number = holds("new end", absent=True)
    unit: str | None = holds("its unit", absent=True)
    runs: int | None = holds("runs for the round, in its first line", absent=True)


class SearchBlock(ResultBlock):
    """A search for parameters."""

    name: str = holds("its name")
    targets: tuple[TargetBlock, ...] = holds("what it aims at")
    ranges: dict[str, Interval] = holds("parameter → range")
    kind: Literal["valley", "islands", "front", "single"] = holds("shape of the acceptable set")
    reachable: bool = holds("whether all targets can be met within their uncertainty")
    story: str = holds("the same in words")
    front: FrontBlock = holds("the Pareto front")
    candidates: tuple[CandidateBlock, ...] = holds("candidates")
    infill: int = holds("runs added until predicted and recomputed agree")
    verified: bool = holds("whether every candidate is verified")
    met: bool = holds("whether a recomputed candidate meets every demand")
    audit: tuple[AuditBlock, ...] = holds("how ranges were widened")


class ChoiceBlock(ResultBlock):
    """A candidate of a search."""

    search: str = holds("name of the search")
    candidate: str = holds("name of the candidate")


class ValidationBlock(ResultBlock):
    """A candidate and a channel of an experiment kept for the end."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    unit: str = holds("its unit")
    search: str = holds("name of the search")
    candidate: str = holds("name of the candidate")
    state: State = holds("how the run ended")
    cause: str | None = holds("class of a failure")
    reason: str | None = holds("first line of it")
    depth: Numbers = holds("depth", "mm")
    measured: Numbers = holds("readings")
    sigma: Numbers = holds("their standard uncertainty")
    predicted: Numbers | None = holds("what the run has there")
    numerical_error: Numbers | None = holds("its estimated error")
    metrics: MetricsBlock | None = holds("errors of the prediction")
    position: tuple[tuple[float, float], ...] = holds("places of a profile", "mm")
    since: Numbers | None = holds("time in a hold", "s", absent=True)


class PredictedChannelBlock(ResultBlock):
    """A channel of a posterior predictive check."""

    channel: str = holds("its name")
    unit: str = holds("its unit")
    depth: Numbers = holds("depth", "mm")
    since: Numbers | None = holds("time in a hold", "s", absent=True)
    marks: tuple[str, ...] | None = holds(
        "of a point cloud: component and place (mm) of each reading, as uz(3,0)", absent=True
    )
    measured: Numbers = holds("readings")
    sigma: Numbers = holds("their standard uncertainty")
    predicted: Numbers = holds("prediction")
    numerical_error: Numbers = holds("estimated error of the run")
    spread: Numbers = holds("standard deviation of the prediction by the parameters")
    chi2: Number = holds("χ² of the channel alone")
    p_value: Number = holds("its p-value")
    missed: bool | None = holds("whether that is below 0.05")
    metrics: MetricsBlock = holds("errors of the prediction")


class PredictionBlock(ResultBlock):
    """An experiment that was not fitted, by the most likely values: the posterior predictive check."""

    experiment: str = holds("its name")
    values: ByName = holds("values that were run")
    verdict: Literal["yes", "among", "no"] | None = holds(
        "`no`: p below 0.05; `among`: it agrees because the fit leaves the prediction open; null: not known"
    )
    why: str | None = holds("why it is not known")
    chi2: Number = holds("χ² by the errors of readings and run and what the fit leaves open")
    points: int = holds("number of readings")
    p_value: Number = holds("share of data sets in which a perfect model is missed by more: by χ² or as a whole")
    level: Number = holds("standard deviations by which the readings as a whole are larger than predicted")
    alone: Number = holds("the same without what the fit leaves open")
    channels: tuple[PredictedChannelBlock, ...] = holds("every compared channel")
