"""`results.json` of a study with `[objectives]`, which `rso run` writes at its end."""

from __future__ import annotations

from typing import Literal

from rso.result_types.keys import ByName, Interval, Number, Numbers, ResultBlock, StudyBlock, Texts, holds
from rso.result_types.learnt import ScoresBlock, State
from rso.result_types.stated import VerifyBlock

Setting = float | str | None
Settings = dict[str, Setting]  # parameter → number, or the text of a category


class SimulatorBlock(ResultBlock):
    """What simulates."""

    name: str = holds("its name")
    numerics: int = holds("version of its numbers")


class VariableBlock(ResultBlock):
    """A parameter of the model: a range, levels within it, or a choice of categories."""

    name: str = holds("its name")
    unit: str = holds("its unit")
    description: str = holds("what it is")
    low: Number = holds("lower end of its range; null of a category")
    high: Number = holds("upper end of it")
    scale: Literal["linear", "log"] = holds("of the range")
    values: Numbers | None = holds("its levels where only these are allowed")
    choices: Texts | None = holds("its categories")
    fixed: Setting = holds("the value that the study fixes, else null")


class ObjectiveBlock(ResultBlock):
    """A quantity that is made small or large."""

    quantity: str = holds("as in the study file")
    unit: str = holds("its unit")
    minimise: bool = holds("whether small is better")


class LimitBlock(ResultBlock):
    """A limit of a simulated quantity."""

    text: str = holds("as in the study file")
    quantity: str = holds("what it limits")
    unit: str = holds("its unit")
    low: Number = holds("the least that is allowed, else null")
    high: Number = holds("the most that is allowed, else null")


class PlannedBlock(ResultBlock):
    """The design of experiments."""

    kind: str = holds("kind of the design")
    runs: int = holds("its points")
    held_out: int = holds("points more that test the surfaces")


class RunOfObjectivesBlock(ResultBlock):
    """A simulation, or one taken from the store."""

    key: str = holds("its key in the store")
    purpose: str = holds("`design`, `held out`, `candidate`, `exploration` or `search`")
    state: State = holds("how it ended")
    values: Settings = holds("its parameters")
    outputs: ByName | None = holds("quantity → value; null without an answer")
    within_limits: bool | None = holds("whether it keeps all limits")
    best: bool = holds("whether no other run within the limits beats it in every objective")
    cause: str | None = holds("class of the failure")
    reason: str | None = holds("first line of it")
    wall_s: Number = holds("wall time", "s")
    cpu_s: Number = holds("processor time", "s")


class QuantitySurfaceBlock(ResultBlock):
    """The response surface of a quantity."""

    quantity: str = holds("what it predicts")
    unit: str = holds("its unit")
    spread: Number = holds("spread of the quantity over the runs")
    story: str = holds("how it was chosen")
    cross_validation: ScoresBlock | None = holds("errors on left-out runs")
    held_out: ScoresBlock | None = holds("errors on runs that were new to it")


class ShareBlock(ResultBlock):
    """Sobol's indices of a parameter, in [0, 1]."""

    parameter: str = holds("its name")
    first: Number = holds("first-order index")
    total: Number = holds("total index")
    first_interval: Interval = holds("its 90 % interval")
    total_interval: Interval = holds("its 90 % interval")


class ElementaryEffectBlock(ResultBlock):
    """Morris's elementary effects of a parameter."""

    parameter: str = holds("its name")
    mean: Number = holds("mean of them")
    mean_size: Number = holds("mean of their sizes")
    deviation: Number = holds("their standard deviation")


class SliceBlock(ResultBlock):
    """A quantity along one parameter, the others as in `centre`."""

    parameter: str = holds("its name")
    quantity: str = holds("what is predicted")
    values: tuple[Setting, ...] = holds("the parameter")
    y: Numbers = holds("predicted values")
    sd: Numbers = holds("their standard deviations")


class SensitivitiesBlock(ResultBlock):
    """Sensitivities of the quantities."""

    sobol: dict[str, tuple[ShareBlock, ...]] = holds("quantity → shares of its variance")
    morris: dict[str, tuple[ElementaryEffectBlock, ...]] = holds("quantity → elementary effects")
    slices: tuple[SliceBlock, ...] = holds("quantities along single parameters")
    centre: Settings = holds("the point about which the slices lie")


class FrontPointBlock(ResultBlock):
    """A point of the front."""

    values: Settings = holds("its parameters")
    objectives: ByName = holds("quantity → value")


class ObjectivesFrontBlock(ResultBlock):
    """The front as predicted, or as simulated where every point was."""

    feasible: bool = holds("whether any point keeps all limits")
    points: tuple[FrontPointBlock, ...] = holds("its points")
    knee: int | None = holds("index of the point of the best compromise; null of one objective")
    hypervolume: Numbers = holds(
        "by generation, what the front dominates of the box between the best and the worst objectives ever kept"
    )
    evaluations: int = holds("designs that the search looked at")


class ProposalBlock(ResultBlock):
    """A candidate: predicted, then simulated."""

    name: str = holds("its name")
    key: str = holds("key of its simulation in the store")
    state: State = holds("how that ended")
    reason: str | None = holds("first line of a failure")
    values: Settings = holds("its parameters")
    predicted: ByName | None = holds("quantity → value by the surfaces; null where every point was simulated")
    simulated: ByName | None = holds("quantity → value by the simulation")
    difference: Number = holds("largest relative difference of the two")
    worst: str | None = holds("the quantity that has it")
    verified: bool = holds("whether it is within `verify.tolerance`")
    misses: ByName = holds("limit → by how much the simulation misses it")
    meets: bool = holds("whether the simulation keeps all limits")


class RoundBlock(ResultBlock):
    """A round of search, simulation and learning."""

    candidates: int = holds("their number")
    verified: int = holds("how many agree with their simulation")
    within_limits: int = holds("how many keep all limits")
    largest_difference: Number = holds("relative, between prediction and simulation")
    words: str = holds("the same in words")


class SearchedBlock(ResultBlock):
    """How the front was searched."""

    method: str = holds("`surfaces` or `simulations`")
    population: int = holds("size of the population")
    generations: int = holds("number of generations")


class RunCountsBlock(ResultBlock):
    """Numbers of different simulations."""

    runs: int = holds("all of them")
    done: int = holds("with an answer")
    failed: int = holds("without one")
    crashed: int = holds("ended in another way")


class ObjectivesProvenanceBlock(ResultBlock):
    """Which program computed the file, from which study."""

    rso: str = holds("version")
    python: str = holds("version")
    command: str = holds("the command")
    study_sha256: str = holds("hash of the study file")
    finished: str = holds("when, UTC")
    jobs: int = holds("workers")


class ObjectivesFile(ResultBlock):
    """`results.json` of a study with `[objectives]`, known by its `kind`."""

    schema_: int = holds("version of this layout, 1")
    kind: Literal["pareto"] = holds("which of the two it is")
    study: StudyBlock = holds("which study it is")
    backend: SimulatorBlock = holds("what simulates")
    parameters: tuple[VariableBlock, ...] = holds("searched parameters, then fixed ones")
    objectives: tuple[ObjectiveBlock, ...] = holds("what is made small or large")
    constraints: tuple[LimitBlock, ...] = holds("limits of simulated quantities")
    conditions: Texts = holds("conditions on parameters alone")
    units: dict[str, str] = holds("quantity → unit")
    design: PlannedBlock = holds("the design of experiments")
    runs: tuple[RunOfObjectivesBlock, ...] = holds("every simulation")
    best_runs: Texts = holds("keys of those within all limits that no other beats in every objective")
    surfaces: tuple[QuantitySurfaceBlock, ...] = holds("a response surface for each quantity")
    sensitivity: SensitivitiesBlock = holds("what the parameters change")
    front: ObjectivesFrontBlock = holds("the front")
    candidates: tuple[ProposalBlock, ...] = holds("candidates, each simulated")
    rounds: tuple[RoundBlock, ...] = holds("how search and simulation came to agree")
    verify: VerifyBlock = holds("the study's `[verify]`")
    search: SearchedBlock = holds("the study's `[search]`")
    warnings: Texts = holds("what a reader must not miss")
    counts: RunCountsBlock = holds("numbers of simulations")
    timings: ByName = holds("stage → wall time", "s")
    provenance: ObjectivesProvenanceBlock = holds("which program, which study")
    words: Texts = holds("what was found, in sentences")
    exit_code: int = holds("0 verified; 4 a candidate is not; 6 none keeps the limits; 3 runs without an answer")
    exit_reason: str | None = holds("why it is not 0")
