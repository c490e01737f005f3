"""`results.json`, which `rso run` writes after every stage."""

from __future__ import annotations

from typing import Literal

from rso.result_types.diagnosis_file import DiagnosisBlock
from rso.result_types.identified import DeterminedBlock, GaussNewtonBlock, IdentificationBlock
from rso.result_types.keys import ByName, MetricsBlock, ResultBlock, SketchBlock, StudyBlock, Texts, holds
from rso.result_types.learnt import (
    DesignBlock,
    FeasibleBlock,
    JoinedBlock,
    SensitivityBlock,
    SimulationBlock,
    SurfaceBlock,
    SurrogateBlock,
)
from rso.result_types.searched import ChoiceBlock, PredictionBlock, SearchBlock, ValidationBlock
from rso.result_types.stated import (
    BackendBlock,
    ExperimentBlock,
    FormulasBlock,
    OutputBlock,
    ParameterBlock,
    VerifyBlock,
)


class CountsBlock(ResultBlock):
    """Numbers of simulations."""

    asked: int = holds("by the study file: design and held out")
    fe_runs: int = holds("different ones behind `runs`")
    done: int = holds("of these with an answer")
    failed: int = holds("without one")
    crashed: int = holds("ended in another way")
    from_store: int = holds("known before this call")
    saved_by_similarity: int = holds("not made, as similarity knows them")


class RunProvenanceBlock(ResultBlock):
    """Which program computed the file, from which data, where."""

    rso: str = holds("version")
    python: str = holds("version")
    packages: dict[str, str | None] = holds("name → version")
    command: str = holds("the command")
    study_sha256: str = holds("hash of the study file")
    data_sha256: dict[str, str] = holds("data file → hash")
    artefacts: dict[str, str] = holds("name → hash")
    started: str = holds("when, UTC")
    finished: str | None = holds("when, UTC")
    cores: int | None = holds("of the machine")
    jobs: int = holds("workers")
    solver: str | None = holds("linear solver")


class RunFile(ResultBlock):
    """One file per study, written after every stage; a stage that is not reached has no keys yet."""

    schema_: int = holds("version of this layout, 1")
    stage: Literal["plan", "design", "surrogates", "sensitivity", "search", "verify", "validate"] = holds(
        "the last finished stage; `validate` is complete"
    )
    study: StudyBlock = holds("which study it is")
    backend: BackendBlock = holds("what simulates")
    parameters: tuple[ParameterBlock, ...] = holds("parameters of the model")
    sketches: tuple[SketchBlock, ...] = holds("each different experiment drawn")
    experiments: tuple[ExperimentBlock, ...] = holds("experiments with their readings")
    outputs: tuple[OutputBlock, ...] = holds("scalars that surrogates learn")
    verify: VerifyBlock = holds("the study's `[verify]`")
    metric: str = holds("the metric that chooses `best`")
    baseline: dict[str, MetricsBlock] = holds("curve → errors of its own mean as a model")
    warnings: Texts = holds("what a reader must not miss")
    timings: ByName = holds("stage → wall time, `total`, and `fe_cpu`, processor time of simulations", "s")
    provenance: RunProvenanceBlock = holds("which program, which data")
    joined: JoinedBlock | None = holds("runs of before that are learnt too", absent=True)
    design: DesignBlock | None = holds("the design of experiments", absent=True)
    runs: tuple[SimulationBlock, ...] | None = holds("every simulation", absent=True)
    surrogates: tuple[SurrogateBlock, ...] | None = holds("response surfaces", absent=True)
    surfaces: tuple[SurfaceBlock, ...] | None = holds("outputs over two parameters", absent=True)
    mean_over_runs: dict[str, MetricsBlock] | None = holds("curve → mean of each metric over the design", absent=True)
    feasible: FeasibleBlock | None = holds("where runs have an answer", absent=True)
    sensitivity: SensitivityBlock | None = holds("sensitivities", absent=True)
    searches: tuple[SearchBlock, ...] | None = holds("searches with their candidates", absent=True)
    descent: GaussNewtonBlock | None = holds("descents of Gauss–Newton", absent=True)
    best: ChoiceBlock | None = holds(
        "the candidate of the least metric, averaged over the curves, of all that are verified and meet every demand",
        absent=True,
    )
    closest: ChoiceBlock | None = holds(
        "where there is none: the recomputed candidate that violates constraints least, then misses targets least",
        absent=True,
    )
    formulas: tuple[FormulasBlock, ...] | None = holds("closed forms beside the best candidate", absent=True)
    validation: tuple[ValidationBlock, ...] | None = holds("candidates and what was kept for the end", absent=True)
    predictions: tuple[PredictionBlock, ...] | None = holds("posterior predictive checks", absent=True)
    identification: IdentificationBlock | None = holds("what the fitted curves say", absent=True)
    determined: dict[str, DeterminedBlock] | None = holds("parameter → verdict", absent=True)
    counts: CountsBlock | None = holds("numbers of simulations", absent=True)
    exit_code: int | None = holds("as printed by the command", absent=True)
    exit_reason: str | None = holds("its last line; null for 0", absent=True)
    diagnosis: DiagnosisBlock | None = holds("after `rso diagnose`, as in `diagnosis.json`", absent=True)
