"""`next.json`, which `rso next` writes."""

from __future__ import annotations

from rso.result_types.keys import (
    ByName,
    Interval,
    Number,
    ProvenanceBlock,
    ResultBlock,
    SketchBlock,
    StudyBlock,
    Texts,
    holds,
)


class AskedParameterBlock(ResultBlock):
    """An open parameter."""

    name: str = holds("its name")
    unit: str = holds("its unit")
    low: Number = holds("lower end of its range")
    high: Number = holds("upper end")


class AskedExperimentBlock(ResultBlock):
    """An experiment, done or possible."""

    name: str = holds("its name")
    words: str = holds("in words")
    done: bool = holds("whether it has been done")
    readings: int = holds("number of readings")
    channels: Texts = holds("what is read")
    runs: int = holds("simulations")
    cpu_s: Number = holds("their processor time", "s")
    left_out: Number = holds("error of a run predicted by the others, over the largest value")


class JointParameterBlock(ResultBlock):
    """What experiments together say of a parameter."""

    name: str = holds("its name")
    value: Number = holds("most likely value")
    interval: Interval = holds("90 % interval")
    sd_log: Number = holds("standard deviation of ln θ")
    verdict: str = holds("`determined`, `weakly` or `not`")
    story: str = holds("in words")


class JointFitBlock(ResultBlock):
    """Experiments fitted together."""

    experiments: Texts = holds("their names")
    chi2: Number = holds("χ²")
    degrees: int = holds("degrees of freedom")
    p_value: Number = holds("p-value of χ²")
    scale: Number = holds("what errors were multiplied with")
    story: str = holds("in words")
    errors: dict[str, ByName] = holds("curve → parts of its errors, as in `identification.data[]`")
    parameters: tuple[JointParameterBlock, ...] = holds("what is known of each parameter")


class AtTruthBlock(ResultBlock):
    """Expected standard deviations of ln θ at one truth."""

    alone: ByName = holds("by Fisher information, without what has been done")
    fisher: ByName = holds("with it")
    expected: ByName | None = holds("root mean square over simulated data sets")
    coverage: Number = holds("of the 90 % interval of `focus`; null at an end of the range")


class AddedBlock(ResultBlock):
    """What a set of further experiments shows."""

    added: Texts = holds("none, one or two experiments")
    information: Number = holds("expected about `focus`, in the mean over the truths", "nats")
    price: int = holds("loadings to be done")
    at: tuple[AtTruthBlock, ...] = holds("truth by truth")


class BestSetBlock(ResultBlock):
    """The best sets: most information, of nearly equal ones the cheapest."""

    one: Texts | None = holds("one experiment")
    two: Texts | None = holds("two")


class NextCountsBlock(ResultBlock):
    """Numbers of simulations."""

    runs: int = holds("of all experiments")


class NextFile(ResultBlock):
    """What further experiments would show."""

    schema_: int = holds("version of this layout, 1")
    study: StudyBlock = holds("which study it is")
    sketches: tuple[SketchBlock, ...] = holds("each different experiment drawn")
    focus: str = holds("the parameter asked about")
    enough: float = holds("standard deviation of ln θ with which it is determined")
    draws: int = holds("simulated data sets behind every expectation")
    parameters: tuple[AskedParameterBlock, ...] = holds("open parameters")
    truths: tuple[ByName, ...] = holds("values that are taken as true")
    words: Texts = holds("the answer")
    experiments: tuple[AskedExperimentBlock, ...] = holds("experiments with an answer")
    warnings: Texts = holds("where the model misses the data, and truths that these exclude")
    stated_inputs: Texts = holds("errors of stated dimensions that [uncertainty] states")
    exact_inputs: Texts = holds("those that count as none: nobody said how well these are known")
    problems: dict[str, str] = holds("experiment → why it has no answer")
    fits: tuple[JointFitBlock, ...] = holds("what has been done, fitted alone and together")
    told: tuple[AddedBlock, ...] = holds("what each set shows")
    best: BestSetBlock = holds("the best sets")
    timings: ByName = holds("processor time of simulations", "s")
    counts: NextCountsBlock = holds("numbers of simulations")
    provenance: ProvenanceBlock = holds("which program, which data")
