"""`specimens.json`, which `rso run` writes for a study of many specimens."""

from __future__ import annotations

from typing import Literal

from rso.result_types.keys import Interval, Number, ResultBlock, StudyBlock, Texts, holds

Sides = Literal["both", "lower", "upper", "neither"]


class SpecimenParameterBlock(ResultBlock):
    """What the tests of one specimen say of a parameter."""

    parameter: str = holds("its name")
    unit: str = holds("its unit")
    value: Number = holds("most likely value; the stated one where it is fixed")
    interval: Interval = holds("90 % interval, as in its results.json")
    verdict: Literal["determined", "weakly", "not", "fixed"] = holds("how well it is determined")
    bounded: Sides = holds(
        "which ends of the interval the data give: both, the `lower` or the `upper` one alone, or `neither`"
    )
    residual: Number = holds("distance from all other specimens over its standard deviation (deleted residual)")
    p_value: Number = holds("two-sided p-value of it; null where there is no residual")
    outlier: bool = holds("whether that p-value is below 0.05 over the number of specimens with one")


class SpecimenBlock(ResultBlock):
    """A specimen."""

    name: str = holds("its name")
    folder: str = holds("folder of its results and page, seen from this file")
    state: Literal["done", "stopped", "missing"] = holds(
        "`done`; `stopped`: it has no answer, see `reason`; `missing`: it has not been run yet"
    )
    reason: str = holds("why it has no answer, or why its exit code is not 0")
    exit_code: int | None = holds("that of its own run")
    note: str = holds("the note of the study")
    own: dict[str, str] = holds("what the study says of it alone: key → value as written")
    runs: int = holds("simulations behind its results")
    new_runs: int = holds("of these, those that no earlier specimen had computed")
    p_value: Number = holds("p-value of the fit, as in `identification`")
    warnings: int = holds("number of warnings on its own page")
    parameters: tuple[SpecimenParameterBlock, ...] = holds("what its tests say of each parameter")


class PopulationBlock(ResultBlock):
    """A parameter over all specimens: θ_i = m + N(0, τ²), of its logarithm where `scale` is `log`."""

    parameter: str = holds("its name")
    unit: str = holds("its unit")
    scale: Literal["linear", "log"] = holds("`log`: m and τ are of ln θ, since its range is positive; else of θ")
    mean: Number = holds("m, on a log scale e^m, which half of all specimens exceed")
    interval: Interval = holds("90 % interval of it (Hartung–Knapp), with stated errors that all specimens share")
    shared: Number = holds("standard deviation of these errors; on a log scale that of ln θ; 0: none is stated")
    tau: Number = holds("standard deviation between specimens by REML; on a log scale that of ln θ")
    tau_interval: Interval = holds("90 % interval of τ (Q profile)")
    prediction: Interval = holds("90 % interval for the next specimen")
    q: Number = holds("Cochran's Q: squared distances from the common mean over squared errors of the specimens")
    q_p_value: Number = holds("p-value of Q if specimens did not differ")
    i2: Number = holds("share of the variance between estimates that is between specimens")
    both_sides: int = holds("specimens that are bounded on both sides")
    one_side: int = holds("specimens that are bounded on one; they count by their likelihood")
    left_out: Texts = holds("specimens that say nothing of it")
    outliers: Texts = holds("specimens that are outliers; they are not left out")
    without_outliers: Number = holds("`mean` without these; null where there are none")
    refuted: Texts = holds("specimens that count, but whose data the model misses (p < 0.01)")
    without_doubtful: tuple[Number, Number, Number] = holds(
        "`mean` without outliers and those refuted, and its 90 % interval; null where there are none, or too few rest"
    )
    words: str = holds("the same in words")


class SpecimensCountsBlock(ResultBlock):
    """How many."""

    specimens: int = holds("specimens")
    done: int = holds("with an answer")
    stopped: int = holds("without")
    missing: int = holds("not run yet")
    runs: int = holds("different simulations of all")


class SpecimensProvenanceBlock(ResultBlock):
    """Which program wrote the file."""

    rso: str = holds("version")
    command: str = holds("the command", absent=True)
    finished: str = holds("when, UTC")


class SpecimensFile(ResultBlock):
    """Many specimens, each fitted for itself, and what they are together."""

    schema_: int = holds("version of this layout, 1")
    study: StudyBlock = holds("which study it is")
    level: float = holds("of all intervals")
    specimens: tuple[SpecimenBlock, ...] = holds("each specimen in the order of the study")
    population: tuple[PopulationBlock, ...] = holds("each parameter over all specimens")
    words: Texts = holds("the answer")
    warnings: Texts = holds("what to know of it")
    counts: SpecimensCountsBlock = holds("how many")
    exit_code: int = holds("that of `rso run`: 0, or 3 where a specimen has no answer")
    exit_reason: str | None = holds("why it is not 0")
    provenance: SpecimensProvenanceBlock = holds("which program")
