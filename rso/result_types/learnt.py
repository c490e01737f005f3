"""Pieces of `results.json`: what was run to learn from, and what was learnt."""

from __future__ import annotations

from typing import Literal

from rso.result_types.keys import ByName, Interval, Number, Numbers, ResultBlock, holds

State = Literal["done", "failed", "crashed"]


class ProofBlock(ResultBlock):
    """Similarity put to the test by one run more."""

    values: ByName = holds("its parameters")
    direct: Number = holds("the output as it was run")
    similar: Number = holds("the same scaled from another run")
    relative_difference: Number = holds("their difference, relative")


class SimilarityBlock(ResultBlock):
    """Whether runs are scaled from each other."""

    applied: bool = holds("whether they are")
    story: str = holds("why, or why not")
    reference: str | None = holds("the parameter that scales")
    runs_saved: int = holds("runs that need not be made")
    proof: tuple[ProofBlock, ...] = holds("the tests of it")


class DesignBlock(ResultBlock):
    """The design of experiments."""

    kind: str = holds("kind of the design; `none` with Gauss–Newton")
    asked: int = holds("points of the design")
    points: tuple[ByName, ...] = holds("their values")
    held_out: int = holds("points asked for to test the surrogates")
    similarity: SimilarityBlock = holds("what similarity saves")


class SimulationBlock(ResultBlock):
    """A simulation, or one taken from the store."""

    key: str = holds("its key in the store")
    purpose: str = holds(
        "`design`, `held_out`, `proof`, `stored`, `infill`, `repair`, `candidate`, `identified`, `interval`, "
        "`iterate`, "
        "`validate`, `foretell` (of predictions) or `difference` (for a derivative)"
    )
    state: State = holds("how it ended")
    values: ByName = holds("its parameters")
    outputs: ByName = holds("output id → value; empty unless done")
    cause: str | None = holds("class of the failure")
    reason: str | None = holds("first line of it")
    wall_s: Number = holds("wall time", "s")
    cpu_s: Number = holds("processor time", "s")


class JoinedBlock(ResultBlock):
    """Runs of before that are learnt too."""

    points: tuple[ByName, ...] = holds("their values")
    outside: int = holds("number of points outside of the ranges")
    other: int = holds("number of runs of another model")
    left: int = holds("points left out where more than 200 are within")
    story: str = holds("the same in words")


class ScoresBlock(ResultBlock):
    """Errors of a surrogate."""

    rmse: Number = holds("root mean square error")
    max_abs: Number = holds("largest error seen")
    relative_rmse: Number = holds("RMSE over the root mean square of the output")
    q2: Number = holds("share of the variance that is predicted")
    n: int = holds("number of runs")


class SurrogateBlock(ResultBlock):
    """The response surface of an output."""

    output: str = holds("its id")
    unit: str = holds("its unit")
    kind: str = holds("kind of the surrogate")
    story: str = holds("how it was chosen")
    n: int = holds("runs that it was learnt from")
    spread: Number = holds("spread of the output over the runs")
    cross_validation: ScoresBlock | None = holds(
        "errors on left-out runs; of kriging what these let expect over the whole ranges"
    )
    held_out: ScoresBlock | None = holds("errors on the last runs that were new to it")


class GridBlock(ResultBlock):
    """A parameter along the side of a map."""

    parameter: str = holds("its name")
    values: Numbers = holds("its values")


class SurfaceBlock(ResultBlock):
    """An output over two parameters."""

    output: str = holds("its id")
    unit: str = holds("its unit")
    x: GridBlock = holds("the first open parameter")
    y: GridBlock | None = holds("the second; null where one is open")
    mean: tuple[Numbers, ...] = holds("predicted value, a row for each y")
    sd: tuple[Numbers, ...] = holds("its standard deviation")
    others: ByName = holds("values of the other parameters")


class FeasibleMapBlock(ResultBlock):
    """Where runs have an answer, over two parameters."""

    x: GridBlock = holds("the first open parameter")
    y: GridBlock | None = holds("the second")
    probability: tuple[Numbers, ...] = holds("of an answer, a row for each y")


class FeasibleBlock(ResultBlock):
    """Where runs have an answer, learnt from those that failed."""

    failed: int = holds("different runs that failed")
    causes: dict[str, int] = holds("cause → number")
    share_infeasible: Number = holds("share of the study's box without an answer")
    story: str = holds("the same in words")
    map: FeasibleMapBlock | None = holds("the probability of an answer")


class LocalBlock(ResultBlock):
    """What one parameter changes, the others in the middle."""

    output: str = holds("output id")
    parameter: str = holds("parameter")
    low: Number = holds("output at the lower end")
    high: Number = holds("output at the upper end")
    change: Number = holds("the largest change")
    elasticity: Number = holds("d ln y / d ln θ in the middle")


class AlongBlock(LocalBlock):
    """The same with Sobol indices at every travel of a curve."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    depth_mm: Number = holds("depth", "mm")
    since_s: Number = holds("time in a hold", "s", absent=True)
    first: Number = holds("first-order index", absent=True)
    total: Number = holds("total index", absent=True)
    first_interval: Interval | None = holds("its 90 % interval", absent=True)
    total_interval: Interval | None = holds("its 90 % interval", absent=True)


class LineBlock(ResultBlock):
    """An output along one parameter."""

    output: str = holds("output id")
    parameter: str = holds("parameter")
    x: Numbers = holds("the parameter")
    y: Numbers = holds("the output")


class MorrisBlock(ResultBlock):
    """Morris's elementary effects."""

    output: str = holds("output id")
    parameter: str = holds("parameter")
    mu: Number = holds("mean of them")
    mu_star: Number = holds("mean of their sizes")
    sigma: Number = holds("their standard deviation")


class SobolBlock(ResultBlock):
    """Sobol's indices, in [0, 1]."""

    output: str = holds("output id")
    parameter: str = holds("parameter")
    first: Number = holds("first-order index")
    total: Number = holds("total index")
    first_interval: Interval | None = holds("its 90 % interval")
    total_interval: Interval | None = holds("its 90 % interval")


class SensitivityBlock(ResultBlock):
    """Sensitivities of the outputs."""

    at: ByName = holds("the middle of the ranges")
    ranges: dict[str, Interval] = holds("the ranges that all of it is about")
    ranges_are: Literal["stated", "searched"] = holds("where they come from")
    local: tuple[LocalBlock, ...] = holds("one parameter at a time")
    curves: tuple[LineBlock, ...] = holds("outputs along the parameters")
    morris: tuple[MorrisBlock, ...] = holds("if it was asked for")
    sobol: tuple[SobolBlock, ...] = holds("variance shares")
    along: tuple[AlongBlock, ...] = holds("the same along the curves of the targets")
    excluded: Number = holds("share of the ranges that constraints forbid")
    story: str = holds("the same in words")
