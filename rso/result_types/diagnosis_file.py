"""`diagnosis.json`, which `rso diagnose` writes; its block `diagnosis` stands in `results.json` too."""

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
    Texts,
    holds,
)


class GapBlock(ResultBlock):
    """Whether there is a gap."""

    p_value: Number = holds("chance of such a statistic without a gap")
    size_over_noise: Number = holds("root mean square of the whitened residual of the base model")
    statistic: Number = holds("ln Bayes factor of any gap against none")
    threshold: Number = holds("95 % of simulated data sets without a gap, at least 0")


class RemainderBlock(ResultBlock):
    """What the likeliest cause leaves."""

    of: str = holds("the cause")
    there: bool = holds("whether it is more than noise")
    score: Number = holds("residual score along one effect more")
    threshold: Number = holds("score that about 1 % of data simulated from the cause exceed")
    looks_like: str | None = holds("the effect with that score")


class OddBlock(ResultBlock):
    """An outlying experiment."""

    experiment: str = holds("its name")
    probability: Number = holds("that it is one")


class CrackBlock(ResultBlock):
    """A step of a force that stays."""

    z: Number = holds("its size over its standard deviation")
    experiment: str = holds("where")
    size: Number = holds("its size")
    depth: Number = holds("at which depth", "mm")
    branch: str = holds("`loading` or `unloading`")


class JumpsBlock(ResultBlock):
    """Discontinuities of records."""

    sudden: bool = holds("whether forces jump")
    skewed: bool = holds("whether differences are skewed")
    t: Number = holds("the score of jumps")
    z: Number = holds("the score of skewness")
    experiment: str = holds("where it is largest")
    size: Number = holds("its size")
    depths: Numbers = holds("where jumps are", "mm")
    crack: CrackBlock | None = holds("a step of a force that stays")


class PeriodicBlock(ResultBlock):
    """A periodic disturbance."""

    there: bool = holds("whether there is one")
    log10_p: Number = holds("decadic logarithm of its p-value")
    frequency: Number = holds("per mm, or per s")
    amplitude: Number = holds("its amplitude")
    channel: str = holds("where")
    along: str = holds("`depth` or `time`")


class RegionBlock(ResultBlock):
    """A region of a channel against the model fitted to all other data."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    region: str = holds("in words")
    z: Number = holds("deviation over its standard deviation")
    sign: Literal["+", "-"] = holds("+: measured is larger")
    amplitude: Number = holds("share of the predicted force, or of the largest")
    amplitude_sd: Number = holds("its standard deviation")
    of_largest: bool = holds("whether the share is of the largest force")
    share: Number = holds("of the gap, held by this channel")
    beyond_noise: bool = holds("whether |z| is above `where_threshold`")


class EachBlock(ResultBlock):
    """What one test has of a cause that scatters."""

    experiment: str = holds("its experiment")
    label: str = holds("the repeat")
    value: Number = holds("its size")
    sd: Number = holds("standard deviation of it")


class OtherwiseBlock(ResultBlock):
    """The other sign of a cause."""

    probability: Number = holds("of the other sign")
    low: Number = holds("lower end of its interval")
    high: Number = holds("upper end")


class ShapeBlock(ResultBlock):
    """What shapes a cause: a thickness, a time."""

    knob: str = holds("its name")
    unit: str = holds("its unit")
    size: Number = holds("median")
    interval: Interval = holds("90 % interval")


class CauseBlock(ResultBlock):
    """A cause that the data do not exclude."""

    effect: str = holds("knob, or knob at a place")
    cause: str = holds("what is behind it")
    description: str = holds("in words")
    family: Literal["model", "measurement", "scatter"] = holds("where it belongs")
    probability: Number = holds("given a gap, all forms of the cause together")
    size: Number = holds("median of its size, in its unit")
    interval: Interval = holds("90 % interval")
    unit: str = holds("its unit")
    neutral: Number = holds("the value at which it is absent")
    railed: bool = holds("whether it lies at the end of what was computed or is plausible")
    like_a_modulus: bool = holds("whether it may be a factor on all forces")
    like_a_body: bool = holds("whether the load train could yield alike")
    like_a_spot: bool = holds("whether a place that gives way could")
    flows: bool = holds("whether its time goes with the size of what is pressed")
    each: tuple[EachBlock, ...] | None = holds("of what scatters, every test", absent=True)
    otherwise: OtherwiseBlock | None = holds("where the data allow the other sign too", absent=True)
    shape: tuple[ShapeBlock, ...] = holds("what shapes it")


class HeldOutGapBlock(ResultBlock):
    """The gap of a held-out curve under three models: before, refitted, with the cause."""

    curve: str = holds("its name")
    unit: str = holds("its unit")
    before: Number = holds("G of the base model")
    refit_only: Number = holds("G after a mere refit")
    with_cause: Number = holds("G with the cause")
    rms: tuple[Number, Number, Number] = holds("root mean square of the three")
    p_values: Numbers = holds("of the posterior predictive check under the three")
    cause: Texts = holds("effects of the last model, chosen without this curve")


class ShrinkageBlock(ResultBlock):
    """How much of the gap closes on curves that were not used."""

    held_out: Texts = holds("those curves")
    before: Number = holds("mean of G before")
    refit_only: Number = holds("mean of G after a mere refit")
    with_cause: Number = holds("mean of G with the cause")
    noise_floor: Number = holds("what noise alone leaves")
    floor_error: Number = holds("standard error of that")
    closed: Number = holds("share that closes; null where nothing is to close")
    interval: Interval | None = holds("its 90 % interval")
    how: str = holds("how curves were held out")
    curves: tuple[HeldOutGapBlock, ...] = holds("each of them")
    fitted: ByName | None = holds("parameters of the model before, if they are the study's own")


class RangeBlock(ResultBlock):
    """A 90 % interval with its median."""

    low: Number = holds("lower end")
    median: Number = holds("median")
    high: Number = holds("upper end")


class ReachBlock(ResultBlock):
    """What a parameter may be by all that the data allow, and by what it is so wide."""

    low: Number = holds("lower end")
    high: Number = holds("upper end")
    low_with: str | None = holds("effect behind the lower end")
    high_with: str | None = holds("effect behind the upper end")
    by: Texts = holds("up to three effects that widen it most")
    without: RangeBlock | None = holds("the interval where these are absent")


class DetectableBlock(ResultBlock):
    """What the test plan can see of an effect."""

    effect: str = holds("its name")
    unit: str = holds("its unit")
    smallest_visible: Number = holds("size found in half of all data sets")
    visible: bool = holds("whether any plausible size is")
    confused_with: Texts = holds("effects that are taken for it")
    confounded_with: Texts = holds("the same")
    recognised: Number = holds("mean probability of the right cause at the smallest clear size")


class NextTestBlock(ResultBlock):
    """A test that could come next; the best comes first, of nearly equal ones the cheapest."""

    test: str = holds("in words")
    chance: Number = holds("that one cause has 95 % afterwards")
    information: Number = holds("expected about which cause is there, at least", "nats")
    price: int = holds("loadings to be done")
    separates: tuple[str, str] = holds("the pair that it separates worst")
    distance: Number = holds("distance D of that pair in standard deviations")
    resolves: int = holds("pairs with D of at least 4")
    pairs: int = holds("number of pairs")
    note: str = holds("what its forecast leans on, or nothing")


class DiagnosisBlock(ResultBlock):
    """What the model is missing."""

    verdict: Literal["no_gap", "explained", "measurement", "ambiguous", "partly", "unexplained"] = holds("the verdict")
    gap: GapBlock = holds("whether there is a gap")
    left: Number = holds("χ² per reading that the hypothesis of the verdict leaves")
    remainder: RemainderBlock | None = holds("what the likeliest cause leaves")
    odd: OddBlock | None = holds("an outlying experiment")
    jumps: JumpsBlock = holds("discontinuities")
    hum: PeriodicBlock = holds("a periodic disturbance")
    where: tuple[RegionBlock, ...] = holds("where the gap is")
    where_threshold: Number = holds("|z| of the largest region in 5 % of data sets without a gap")
    causes: tuple[CauseBlock, ...] = holds("causes, the likeliest first")
    chosen: Texts = holds("effects of the hypothesis of the verdict")
    ambiguous_with: tuple[Texts, ...] = holds("sets that cannot be separated")
    shrinkage: ShrinkageBlock = holds("how much closes on curves that were not used")
    parameters: dict[str, dict[str, RangeBlock]] = holds(
        "`before` (base model), `if_nothing_else` (the hypothesis said), `after` (all that the data allow) → parameter"
    )
    reach: dict[str, ReachBlock] = holds("parameter → what it may be")
    detectable: tuple[DetectableBlock, ...] = holds("what the plan can see of each effect")
    next_test: tuple[NextTestBlock, ...] = holds("tests that could come next")


class ModulusBlock(ResultBlock):
    """The parameter that forces scale with."""

    name: str = holds("its name")
    low: Number = holds("lower end of its range")
    high: Number = holds("upper end")


class DiagnosedExperimentBlock(ResultBlock):
    """An experiment of the test plan."""

    name: str = holds("its name")
    role: str = holds("its role")
    channels: Texts = holds("measured channels")
    speed: Number = holds("speed of the indenter", "mm/s")
    mounting: str = holds("experiments of one mounting share offsets")
    repeats: int = holds("repeats")
    kind: str = holds("`force` or `profile`")
    point: Numbers = holds("where it was pressed", "mm")


class WholeTestErrorBlock(ResultBlock):
    """Errors of a whole test."""

    gain: Number = holds("relative")
    contact_mm: Number = holds("of the contact", "mm")


class ChannelNoiseBlock(ResultBlock):
    """The noise of a channel."""

    white: Number = holds("independent part of a reading")
    correlated: Number = holds("correlated part")
    length_mm: Number = holds("its length of correlation", "mm")
    gain: Number = holds("relative error of a whole test")
    contact_mm: Number = holds("error of the contact", "mm")
    depth_mm: Number = holds("error of the depth", "mm")
    source: str = holds("where it is from")
    expected: WholeTestErrorBlock = holds("what was expected")
    repeats: WholeTestErrorBlock = holds("what repeats show")


class TrustedBlock(ResultBlock):
    """A calibration that was counted on."""

    sd: Number = holds("its standard deviation")
    unit: str = holds("its unit")
    stated: bool = holds("whether the study states it; else it is usual")


class EffectBlock(ResultBlock):
    """An effect of the catalogue."""

    name: str = holds("its name")
    label: str = holds("its name in pictures")
    description: str = holds("in words")
    family: str = holds("`model`, `measurement` or `scatter`")
    unit: str = holds("its unit")
    neutral: Number = holds("the value at which it is absent")
    low: Number = holds("lower end of what is plausible")
    high: Number = holds("upper end")
    source: str = holds("the cause behind it")
    shape: Texts = holds("knobs that shape it")
    one_place: bool = holds("whether it belongs to one place")


class LeftOutBlock(ResultBlock):
    """An experiment left out: log predictive density over that of the base model."""

    experiment: str = holds("its name")
    gain: ByName = holds("hypothesis → gain")


class SelfCheckBlock(ResultBlock):
    """A self-check on data simulated from a hypothesis."""

    hypothesis: str = holds("which one")
    returned: Number = holds("share of data sets in which it is named")
    in_set: Number = holds("share in which it is among the named")
    no_gap: Number = holds("share without a gap")
    n: int = holds("data sets")


class PowerBlock(ResultBlock):
    """Power by the size of an effect."""

    effect: str = holds("its name")
    power: tuple[Numbers, ...] = holds("size and power")


class ResidualBlock(ResultBlock):
    """Residuals of a channel of a test."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    label: str = holds("the repeat")
    depth: Numbers = holds("depth", "mm")
    since: Numbers | None = holds("time at rest", "s", absent=True)
    branch: tuple[int, ...] = holds("1 loading, -1 unloading, 0 hold")
    measured: Numbers = holds("readings")
    sd: Numbers = holds("standard deviation of a reading")
    residual: dict[str, Numbers] = holds("model → measured less fitted, gain and contact taken out")


class SignatureBlock(ResultBlock):
    """What leading hypotheses add to the base model."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    label: str = holds("the repeat")
    depth: Numbers = holds("depth", "mm")
    since: Numbers | None = holds("time at rest", "s", absent=True)
    branch: tuple[int, ...] = holds("1 loading, -1 unloading, 0 hold")
    added: dict[str, Numbers] = holds("hypothesis → what it adds")


class RerunBlock(ResultBlock):
    """A round in which finalists were recomputed."""

    runs: int = holds("simulations")
    failed: int = holds("those without an answer")
    largest: Number = holds("largest deviation of the library over Fz")
    rms: Number = holds("its root mean square")
    effects: Texts = holds("the finalists")


class MirroredBlock(ResultBlock):
    """A lateral force that is the model's times a number below −0.5."""

    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    times: Number = holds("the number")


class BaseParameterBlock(ResultBlock):
    """What the base model alone says of a parameter."""

    value: Number = holds("most likely value")
    interval: Interval = holds("90 % interval")
    sd_log: Number = holds("standard deviation of ln θ")
    verdict: str = holds("`determined`, `weakly` or `not`")
    story: str = holds("in words")


class BaseModelBlock(ResultBlock):
    """The base model by the likelihood of `rso run`."""

    chi2: Number = holds("χ²")
    degrees: int = holds("degrees of freedom")
    p_value: Number = holds("p-value of χ²")
    scale: Number = holds("what errors were multiplied with")
    story: str = holds("in words")
    errors: dict[str, ByName] = holds("curve → parts of its errors, as in `identification.data[]`")
    parameters: dict[str, BaseParameterBlock] = holds("parameter → what is known")


class DiagnosedStudyBlock(ResultBlock):
    """Which study it is."""

    file: str = holds("name of the study file")
    seed: int = holds("root of all random numbers")


class DiagnosisFile(ResultBlock):
    """What `rso diagnose` found, and what its page shows."""

    schema_: int = holds("version of this layout")
    title: str = holds("of the study")
    units: dict[str, str] = holds("parameter → unit")
    fixed: ByName = holds("parameters that the study fixes")
    ranges: dict[str, Interval] = holds("ranges that fits keep to")
    modulus: ModulusBlock = holds("the parameter that forces scale with")
    diagnosis: DiagnosisBlock = holds("the diagnosis; the same block stands in `results.json`")
    experiments: tuple[DiagnosedExperimentBlock, ...] = holds("the test plan")
    noise: dict[str, ChannelNoiseBlock] = holds("channel → noise")
    trusted: dict[str, TrustedBlock] = holds("effect → calibration that was counted on")
    effects: tuple[EffectBlock, ...] = holds("the catalogue")
    probabilities: ByName = holds("hypothesis → probability, the twenty largest")
    sensitivity: dict[str, Any] = holds("the same under other priors")
    held_out: tuple[LeftOutBlock, ...] = holds("experiments left out in turn")
    checks: tuple[SelfCheckBlock, ...] = holds("self-checks")
    power: tuple[PowerBlock, ...] = holds("power by size")
    residuals: tuple[ResidualBlock, ...] = holds("residuals")
    signatures: tuple[SignatureBlock, ...] = holds("what hypotheses add")
    rerun: tuple[RerunBlock, ...] = holds("rounds of recomputing")
    failed_runs: tuple[Any, ...] = holds("runs of the library without an answer")
    notes: Texts = holds("remarks on the test plan")
    mirrored: tuple[MirroredBlock, ...] = holds("lateral forces of the wrong sign")
    words: Texts = holds("the diagnosis in sentences")
    timings: ByName = holds("wall and processor time", "s", absent=True)
    base_model: BaseModelBlock | None = holds("the fit alone; null where nothing is open", absent=True)
    command: str | None = holds("the command", absent=True)
    settings: dict[str, Any] | None = holds("the study's `[backend.settings]`", absent=True)
    sketches: tuple[SketchBlock, ...] | None = holds("each different experiment drawn", absent=True)
    study: DiagnosedStudyBlock | None = holds("which study it is", absent=True)
    provenance: ProvenanceBlock | None = holds("which program, which data", absent=True)
    taken: dict[str, Any] | None = holds("of `rso blind`: what files were taken for", absent=True)
