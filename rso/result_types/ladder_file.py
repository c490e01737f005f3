"""`ladder.json`, which `rso ladder` writes."""

from __future__ import annotations

from typing import Any, Literal

from rso.result_types.keys import (
    ByName,
    Interval,
    Number,
    Numbers,
    ProvenanceBlock,
    ResultBlock,
    SketchBlock,
    StudyBlock,
    Texts,
    holds,
)


class StartParameterBlock(ResultBlock):
    """A parameter by the backend's closed form."""

    parameter: str = holds("its name")
    unit: str = holds("its unit")
    low: Number = holds("lower end of the range")
    value: Number = holds("its value")
    high: Number = holds("upper end of the range")
    study: Interval | None = holds("the study's own range")


class StartBlock(ResultBlock):
    """The start by closed form from the first fitted curve."""

    used: bool = holds("whether its ranges are used")
    parameters: tuple[StartParameterBlock, ...] = holds("each parameter")


class LadderStepBlock(ResultBlock):
    """What became of a level."""

    level: str = holds("its name")
    title: str = holds("its name in sentences")
    rung: int = holds("its rung")
    verdict: Literal["adequate", "fails", "refused", "no_answer", "not_better", "not_needed"] = holds("the verdict")
    words: str = holds("in words")


class LevelParameterBlock(ResultBlock):
    """A parameter of a level."""

    name: str = holds("its name; `C20/mu` is a share of the modulus")
    parameter: str = holds("the backend's parameter")
    unit: str = holds("its unit")
    range: Interval = holds("where it is searched")
    value: Number = holds("most likely value")
    interval: Interval = holds("90 % interval by profile likelihood")
    verdict: Literal["determined", "weakly", "not"] = holds("how well it is determined")
    added: bool = holds("whether this level adds it")
    sd_log: Number = holds("standard deviation of ln θ")
    story: str = holds("in words")
    reason: str = holds("why it is not determined")


class JointVerdictBlock(ResultBlock):
    """χ² and all NRMSE as one test; of a curve kept for the end its predictive check."""

    passes: bool = holds("whether it agrees")
    p_value: Number = holds("p-value; a perfect model is below 1 − `confidence` in that share of data sets")
    share: Number = holds("how often a perfect model is beyond a single limit")


class MisfitBlock(ResultBlock):
    """χ² of the curves of a role against simulated data sets of a perfect model."""

    chi2: Number = holds("χ²")
    expected: Number = holds("its mean")
    limit: Number = holds("what it must stay below")
    p_value: Number = holds("share that is at least as large")
    points: int = holds("number of readings")
    p_analytic: Number = holds("p-value by the distribution of χ², as `rso run` has it", absent=True)


class KeptCurveBlock(ResultBlock):
    """A curve kept for the end, by the same check as `predictions[]` of `results.json`."""

    curve: str = holds("its name")
    chi2: Number = holds("χ² by all errors and what the fit leaves open", absent=True)
    expected: Number = holds("number of readings", absent=True)
    limit: Number = holds("what it must stay below", absent=True)
    p_value: Number = holds("share of data sets in which a perfect model has a larger χ²", absent=True)
    points: int | None = holds("number of readings", absent=True)
    nrmse: Number = holds("RMSE over the mean size", absent=True)
    verdict: JointVerdictBlock | None = holds("whether it is predicted; null: not known")
    why: str | None = holds("why it is not known")


class CurveErrorBlock(ResultBlock):
    """NRMSE of a curve."""

    curve: str = holds("its name")
    role: str = holds("`fit` or `select`")
    nrmse: Number = holds("RMSE over the mean size")
    threshold: Number = holds("what noise and numerical error alone leave")
    p_value: Number = holds("share of simulated data sets with a larger one")
    parts: ByName = holds("part of the errors → size, as in `identification.data[]`")


class LevelCurveBlock(ResultBlock):
    """A curve and what a level has there."""

    name: str = holds("its name")
    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    role: str = holds("`fit` or `select`")
    unit: str = holds("its unit")
    depth: Numbers = holds("depth", "mm")
    since: Numbers | None = holds("time in a hold", "s", absent=True)
    measured: Numbers = holds("readings")
    sigma: Numbers = holds("standard uncertainty of measurement and computation")
    predicted: Numbers = holds("the level at its best")
    numerical_error: Numbers = holds("estimated numerical error")


class LevelBlock(ResultBlock):
    """A level that was tried; with a `problem` there is nothing more."""

    name: str = holds("its name")
    title: str = holds("its name in sentences")
    rung: int = holds("its rung")
    description: str = holds("in words")
    onto: str = holds("the level that it was put on")
    settings: dict[str, Any] = holds("settings of its own")
    closed_form: bool = holds("whether it costs no simulation")
    problem: str | None = holds("why there is no answer")
    parameters: tuple[LevelParameterBlock, ...] | None = holds("its parameters", absent=True)
    values: ByName | None = holds("all that the backend is given", absent=True)
    verdict: JointVerdictBlock | None = holds("the test of everything", absent=True)
    fitted: MisfitBlock | None = holds("χ² of fitted curves", absent=True)
    selected: MisfitBlock | None = holds("χ² of curves to select by", absent=True)
    validated: tuple[KeptCurveBlock, ...] | None = holds("curves kept for the end", absent=True)
    errors: tuple[CurveErrorBlock, ...] | None = holds("NRMSE of each curve", absent=True)
    log_evidence: Number = holds("ln of the marginal likelihood", absent=True)
    agreement: Number = holds("of predicted and recomputed curves, relative", absent=True)
    similarity: str | None = holds("whether runs are scaled, and why", absent=True)
    runs: int | None = holds("simulations that it was the first to need", absent=True)
    cpu_s: Number = holds("their processor time", "s", absent=True)
    curves: tuple[LevelCurveBlock, ...] | None = holds("curves", absent=True)


class LadderCountsBlock(ResultBlock):
    """Numbers of simulations."""

    runs: int = holds("different ones")


class LadderFile(ResultBlock):
    """Which material law the data ask for."""

    schema_: int = holds("version of this layout, 2")
    study: StudyBlock = holds("which study it is")
    sketches: tuple[SketchBlock, ...] = holds("each different experiment drawn")
    rule: str = holds("the decision in words")
    confidence: float = holds("of the test")
    draws: int = holds("simulated data sets behind every threshold")
    chosen: str | None = holds("the level that holds; null: none has an answer")
    adequate: bool = holds("whether it is good enough")
    rivals: Texts = holds("levels of its rung that are not 20 times less likely")
    words: str = holds("the answer")
    warnings: Texts = holds("what a reader must know before believing it")
    stated_inputs: Texts = holds("errors of stated dimensions that [uncertainty] states")
    exact_inputs: Texts = holds("those that count as none: nobody said how well these are known")
    start: StartBlock | None = holds("the start by closed form")
    steps: tuple[LadderStepBlock, ...] = holds("every level in order")
    levels: tuple[LevelBlock, ...] = holds("those tried")
    counts: LadderCountsBlock = holds("numbers of simulations")
    timings: ByName = holds("`wall`, and processor time of simulations", "s")
    provenance: ProvenanceBlock = holds("which program, which data")
