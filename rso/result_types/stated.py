"""Pieces of `results.json`: what the study states, and what was measured."""

from __future__ import annotations

from typing import Any

from rso.result_types.keys import Interval, Number, Numbers, ReadingsBlock, ResultBlock, Texts, holds


class BackendBlock(ResultBlock):
    """What simulates."""

    name: str = holds("its name")
    numerics: int = holds("version of its numbers")
    settings: dict[str, Any] = holds("the study's `[backend.settings]`")


class ParameterBlock(ResultBlock):
    """A parameter of the model."""

    name: str = holds("its name")
    description: str = holds("what it is")
    unit: str = holds("its unit")
    low: Number = holds("lower end of the main search's range, as it came to be used")
    high: Number = holds("upper end of it")
    log: bool = holds("whether the range is on a logarithmic scale")
    fixed: Number = holds("the value that the study fixes, else null")
    stated: Interval = holds("the range of the study file")


class OtherChannelBlock(ResultBlock):
    """A compared channel after the first."""

    channel: str = holds("its name")
    unit: str = holds("its unit")
    measured: ReadingsBlock = holds("its readings")


class CreepBlock(ResultBlock):
    """The creep that an experiment is."""

    held_N: Number = holds("held force", "N")
    rise_s: Number = holds("time to the force", "s")
    grows_mm: Number = holds("by how much the depth grows", "mm")


class ExperimentBlock(ResultBlock):
    """An experiment of the study."""

    name: str = holds("its name")
    role: str = holds("`fit`, `select` or `validate`")
    kind: str = holds("`force` or `profile`")
    channel: str = holds("the first compared channel")
    unit: str = holds("its unit")
    settings: dict[str, Any] = holds("the experiment's own settings")
    file: str = holds("data files, commas between")
    notes: Texts = holds("what of the file is not used, then what the file says itself")
    remarks: int = holds("how many notes are of the first kind")
    n_repeats: int = holds("repeats")
    measured: ReadingsBlock = holds("readings of the first channel")
    others: tuple[OtherChannelBlock, ...] = holds("the other compared channels")
    creep: CreepBlock | None = holds("of the creep of another experiment", absent=True)


class FormulaBlock(ResultBlock):
    """A closed form beside a simulated curve."""

    name: str = holds("its name")
    source: str = holds("where it is from")
    force: Numbers = holds("its force", "N")
    invalid: Texts = holds("why it does not hold at a depth, or empty")
    modulus: Number = holds("the modulus it gives over that of the candidate")


class FormulasBlock(ResultBlock):
    """Closed forms beside the best candidate of a fitted curve."""

    experiment: str = holds("its name")
    depth: Numbers = holds("depth", "mm")
    simulated: Numbers = holds("simulated force", "N")
    error: Numbers = holds("estimated numerical error", "N")
    formulas: tuple[FormulaBlock, ...] = holds("the closed forms")


class OutputBlock(ResultBlock):
    """A scalar of the response."""

    id: str = holds("`experiment:channel@depth`, in a hold `+time`")
    experiment: str = holds("its experiment")
    channel: str = holds("its channel")
    depth_mm: float = holds("depth", "mm")
    unit: str = holds("its unit")
    since_s: float | None = holds("time in a hold", "s", absent=True)


class VerifyBlock(ResultBlock):
    """The study's `[verify]`."""

    tolerance: float = holds("how well prediction and rerun must agree")
    max_infill: int = holds("runs that may be added")
