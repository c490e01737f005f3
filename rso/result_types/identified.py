"""Pieces of `results.json`: what the fitted curves say about the parameters."""

from __future__ import annotations

from typing import Literal

from rso.result_types.keys import ByName, Interval, MetricsBlock, Number, Numbers, ResultBlock, Texts, holds
from rso.result_types.learnt import State
from rso.result_types.searched import CurveBlock


class FittedReadingsBlock(ResultBlock):
    """What was fitted to the readings: the most likely curve, moved by errors of the whole test."""

    depth: Numbers = holds("depth", "mm")
    since: Numbers | None = holds("time since the indenter came to rest, 0 while it moves", "s", absent=True)
    value: Numbers = holds("fitted curve, in the unit of the channel")
    moved: Numbers = holds("by how much it lies above the simulated curve")
    sd: Numbers = holds("standard deviation that the fit leaves open of it")
    reading_sd: Numbers = holds("standard deviation of a reading about it")
    white: Numbers = holds("whitened residuals: standard normal numbers where model and errors are right")
    contact: Number = holds("fitted contact shift; positive: the specimen was deeper than recorded", "mm")
    gain: Number = holds("fitted gain of the channel, relative")
    expected: ByName = holds("standard deviation before the fit of `contact` (mm) and `gain`")
    inputs: ByName = holds("fitted errors of uncertain inputs, in standard uncertainties; positive: more than stated")
    metrics: MetricsBlock = holds("errors of the fitted curve")


class FittedCurveBlock(ResultBlock):
    """A fitted curve."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    points: int = holds("number of readings")
    errors: ByName = holds("part → root mean square of its standard deviation over the largest value")
    marks: Texts | None = holds("of a point cloud: component and place (mm) of each reading, as uz(3,0)", absent=True)
    measured: Numbers | None = holds("of a point cloud: its readings", "mm", absent=True)
    fitted: FittedReadingsBlock | None = holds("what was fitted; null where the weighting knows no errors", absent=True)


class RecomputedBlock(ResultBlock):
    """The most likely point, run again."""

    agreement: Number = holds("largest difference of predicted and recomputed curve, relative")
    chi2: Number = holds("χ² of the recomputed curves")
    chi2_bare: Number = holds("the same without what the surrogates may be off by")
    p_value_bare: Number = holds("its p-value")
    verified: bool = holds("whether the difference is within `verify.tolerance` and adds less than half a unit to χ²")
    open: Texts = holds(
        "points at which the surrogates do not know whether the data allow them; while there are such, no "
        "parameter is "
        "called determined"
    )
    values: ByName | None = holds("values of the run")
    curves: dict[str, CurveBlock] = holds("its curves")
    metrics: dict[str, MetricsBlock] = holds("their errors")


class MinimumBlock(ResultBlock):
    """Another minimum of χ²."""

    values: ByName = holds("its parameters")
    chi2: Number = holds("χ² there")


class ProfileBlock(ResultBlock):
    """The profile likelihood of a parameter."""

    values: Numbers = holds("the parameter")
    rise: Numbers = holds("χ² above its least value")
    change: Numbers = holds("change of the curve where it shows most", "N")
    sigma: Numbers = holds("its standard uncertainty there", "N")


class IdentifiedBlock(ResultBlock):
    """What the curves say about a parameter."""

    parameter: str = holds("its name")
    value: Number = holds("most likely value")
    verdict: Literal["determined", "weakly", "not"] = holds(
        "`determined`: the interval is within a factor 1.75 of its middle, 1.25 where the range of another parameter "
        "ends it. No bound of the search cuts it, and the model misses the data by at most three times their errors. "
        "`not`: the interval covers half of the range stated or searched, or both bounds. `weakly`: between"
    )
    digits: int = holds("digits that are warranted; 0: none")
    sd_log: Number = holds("standard deviation of ln θ by the Fisher information")
    interval: Interval = holds(
        "90 % interval by profile likelihood, usual errors included; of several pieces the outermost ends. "
        "No finished "
        "run that agrees with the data lies outside"
    )
    as_stated: Interval | None = holds("the same without usual errors that nobody has stated")
    usual_errors: ByName = holds("share of the variance that each of these adds")
    bounds: tuple[Literal["lower", "upper"], ...] = holds("ends where the search stops, not the data")
    laplace: Interval = holds("90 % interval by the Gaussian approximation")
    mcmc: Interval | None = holds("90 % interval by draws; null if they are too few")
    agreement: bool | None = holds("whether the last two agree within 15 % of the width")
    noise_factor: Number = holds("noise times this would determine it")
    profile: ProfileBlock = holds("the profile")
    story: str = holds("the same in words")
    reason: str = holds("why it is not determined")


class DerivedBlock(ResultBlock):
    """A quantity that the backend derives from the parameters."""

    name: str = holds("its name")
    letter: str = holds("its symbol")
    description: str = holds("what it is")
    unit: str = holds("its unit")
    value: Number = holds("at the most likely parameters")
    interval: Interval = holds("90 % interval by its own profile likelihood")
    known: bool = holds("whether it is determined")
    follows_from: Texts = holds("fixed values on which it rests as much as on what was fitted: it is no finding then")
    ends_by: tuple[Texts, Texts] = holds("what ends the interval where the data do not")
    unlikely: str = holds("a remark where the whole interval is out of the ordinary")


class DirectionBlock(ResultBlock):
    """An eigenvector of the Fisher information in ln θ."""

    change: ByName = holds("parameter → component")
    sd: Number = holds("standard deviation along it")
    story: str = holds("the same in words")


class InputBlock(ResultBlock):
    """An uncertain input that the study states: the uncertainty budget of the parameters."""

    input: str = holds("its name")
    experiment: str = holds("the experiments that share it; empty for all")
    description: str = holds("what it is")
    unit: str = holds("its unit")
    uncertainty: Number = holds("its standard uncertainty, in that unit")
    moves: ByName = holds("parameter or derived quantity → relative change if the input is that much more than stated")
    share: ByName = holds("parameter → share of its variance")


class CalibrationBlock(ResultBlock):
    """What the stated error of the calibration (`noise.calibration`), the same for all tests, contributes."""

    moves: ByName = holds("parameter → relative change if all forces are one standard uncertainty more than measured")
    share: ByName = holds("parameter → share of its variance")


class AssumptionBlock(ResultBlock):
    """What is taken for granted of a test, and what would be without it, by a closed form."""

    name: str = holds("the error of a stated size that counts as exact, or other settings that a diagnosis might try")
    experiment: str = holds("the experiments that it is of; empty for all")
    description: str = holds("what it is")
    larger: Number = holds("by which share of itself a size is taken to be larger; null of settings")
    moves: ByName = holds("parameter or derived quantity → relative change if it is so")


class GainBlock(ResultBlock):
    """A test that could come next; the best comes first, of nearly equal ones the cheapest."""

    test: str = holds("in words")
    before: ByName = holds("parameter → standard deviation of ln θ now")
    after: ByName = holds("the same with the test, the ranges counted as a weak prior")
    information: Number = holds("expected about the parameter that is known worst", "nats")
    price: int = holds("loadings to be done")


class DrawsBlock(ResultBlock):
    """Draws of the posterior."""

    method: Literal["cells", "chain"] = holds("a refined grid up to three parameters, else an ensemble sampler")
    draws: int = holds("their number")
    steps: int = holds("steps of the chain")
    tau: Number = holds("autocorrelation time in steps")
    independent: Number = holds("effective sample size")
    r_hat: Number = holds("Gelman–Rubin statistic")
    converged: bool = holds(
        "at least 300 independent draws, and a chain of more than 50 `tau` with an `r_hat` of at most 1.05"
    )


class WeightingBlock(ResultBlock):
    """The best fit with another weighting of the readings."""

    weighting: Literal["noise", "absolute", "relative"] = holds("errors by noise, all the same, or in proportion")
    values: ByName = holds("its parameters")


class MetricMinimumBlock(ResultBlock):
    """A minimum of an error metric."""

    values: ByName = holds("its parameters")
    value: Number = holds("the metric there")


class MetricMinimaBlock(ResultBlock):
    """All minima of an error metric."""

    metric: str = holds("its name")
    minima: tuple[MetricMinimumBlock, ...] = holds("all of them")


class IdentificationBlock(ResultBlock):
    """What the fitted curves say, in the ranges of the main search."""

    level: float = holds("of all intervals")
    data: tuple[FittedCurveBlock, ...] = holds("fitted curves and the parts of their errors")
    values: ByName = holds("the most likely parameters")
    chi2: Number = holds("χ² there")
    degrees: int = holds("degrees of freedom")
    p_value: Number = holds(
        "of that χ²; null without degrees of freedom, or where errors are taken from the residual. It is null too "
        "where residuals are autocorrelated by errors that are not stated, or the model agrees only within the "
        "errors of the surrogates"
    )
    noise_degrees: Number = holds(
        "degrees of freedom behind the size of the errors; null: all stated. χ² over its degrees is then "
        "Fisher's F, and "
        "intervals are wider by Student's factor"
    )
    scale: Number = holds("what errors were multiplied with because the model does not fit; 1: it does")
    story: str = holds("the same in words")
    doubts: str = holds("why the fit is not believed, so that it determines nothing; empty where it is")
    recomputed: RecomputedBlock = holds("the most likely point, run again")
    other_minima: tuple[MinimumBlock, ...] = holds("other minima of χ²")
    parameters: tuple[IdentifiedBlock, ...] = holds("what is known of each parameter")
    derived: tuple[DerivedBlock, ...] = holds("quantities derived from them")
    directions: tuple[DirectionBlock, ...] = holds("stiff and sloppy directions, stiffest first")
    inputs: tuple[InputBlock, ...] = holds("uncertain inputs of the study, and what they move")
    calibration: CalibrationBlock | None = holds("the calibration of the forces; null where its error is not stated")
    exact_inputs: Texts = holds("errors of stated dimensions that count as none: nobody said how well these are known")
    assumptions: tuple[AssumptionBlock, ...] = holds(
        "what is taken for granted and moves the answer; empty where no closed form is near the simulations"
    )
    gains: tuple[GainBlock, ...] = holds("tests that could come next")
    mcmc: DrawsBlock | None = holds("draws of the posterior")
    weightings: tuple[WeightingBlock, ...] = holds("best fits by weighting")
    metrics: tuple[MetricMinimaBlock, ...] = holds("minima by metric")


class DeterminedBlock(ResultBlock):
    """The verdict on a parameter, short."""

    determined: bool = holds("whether it is")
    interval: Interval = holds("its 90 % interval")
    story: str = holds("in words")


class IterateBlock(ResultBlock):
    """A point of a Gauss–Newton descent."""

    number: int = holds("from 1 on")
    values: ByName = holds("its parameters")
    state: State = holds("how it ended")
    chi2: Number = holds("χ² there")
    expected: Number = holds("χ² that was expected")
    agreement: Number = holds("largest difference of predicted and recomputed curve, relative")
    step: Number = holds("largest change of a parameter, as a share of its range")
    radius: Number = holds("the largest step allowed")
    better: bool = holds("whether it is better than all before")


class DescentBlock(ResultBlock):
    """A Gauss–Newton descent."""

    start: int = holds("number of the start")
    values: ByName | None = holds("where it ended")
    chi2: Number = holds("χ² there")
    verified: bool = holds("whether the last run agrees with its prediction")
    why: str = holds("why it ended")
    best: bool = holds("whether it is the candidate")
    iterates: tuple[IterateBlock, ...] = holds("its points")


class GaussNewtonBlock(ResultBlock):
    """With `[search] method = "gauss_newton"`."""

    derivatives: Literal["backend", "differences"] = holds("where derivatives come from")
    max_runs: int = holds("points of one descent, at most")
    descents: tuple[DescentBlock, ...] = holds("all of them")
