"""The tables of study.toml as frozen models: one class per table, every key with its default, nothing else allowed.

Quantities are floats in N, mm, MPa, s after loading.  Bounds of parameters stay as written, because their unit
is the backend's to say: see :func:`rso.study.resolve.resolve`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    field_validator,
    model_validator,
)

from rso.measurement import Measurement, Noise
from rso.study.columns import ColumnsTable
from rso.study.fields import (
    Bound,
    Channels,
    Count,
    Depth,
    Duration,
    Files,
    Name,
    Names,
    NotNegativeForce,
    NotNegativeLength,
    Positive,
    Runs,
    Settings,
    Share,
    Tolerance,
    apart,
    formed,
    list_to_tuple,
    names_of_effects,
    power_of_two,
    quantity_in,
)
from rso.study.places import Place
from rso.study.searched import Range, SearchTable
from rso.study.table import Table


class StudyTable(Table):
    """[study]"""

    title: Annotated[str, Field(min_length=1, max_length=200)]
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    units: Literal["N-mm-MPa-s"] = "N-mm-MPa-s"


class BackendTable(Table):
    """[backend]: a Python object or an external command; `timeout` is the longest one run may take."""

    use: Annotated[str, formed(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", 'expected is "package.module:NAME"')] | None = None
    command: Annotated[tuple[str, ...], BeforeValidator(list_to_tuple), Field(min_length=1)] | None = None
    settings: Settings = Field(default_factory=dict)
    timeout: Duration | None = None

    @model_validator(mode="after")
    def _one_of(self) -> BackendTable:
        if (self.use is None) == (self.command is None):
            raise ValueError('give either use = "package.module:NAME" or command = ["program", "argument"]')
        return self


class ParameterTable(Table):
    """[parameters] name: a range to search, or a `value` that fixes it."""

    low: Bound = None
    high: Bound = None
    scale: Literal["linear", "log"] = "linear"
    value: Bound = None

    @model_validator(mode="after")
    def _range_or_value(self) -> ParameterTable:
        if self.value is None and (self.low is None or self.high is None):
            raise ValueError("give low and high, or value to fix it")
        if (self.low is None) != (self.high is None):
            raise ValueError("low and high belong together")
        beside = [k for k in ("low", "high", "scale") if k in self.model_fields_set]
        if self.value is not None and beside:
            raise ValueError(f"value fixes it, and {beside[0]} belongs to a range to search: leave one of them out")
        return self


class NoiseTable(Table):
    """noise of an experiment: what repeats cannot tell (see :class:`rso.measurement.Noise`).

    `contact` and `gain` are of the whole test, in all its channels; `calibration` of all experiments that state it.
    """

    Fz: NotNegativeForce = 0.0
    Fx: NotNegativeForce | None = None
    Fy: NotNegativeForce | None = None
    uz: NotNegativeLength = 0.0
    depth: NotNegativeLength = 0.0
    gain: Share = 0.0
    correlation: NotNegativeLength = 0.0
    contact: NotNegativeLength = 0.0
    calibration: Share = 0.0

    def noise(self) -> Noise:
        """The same as a plain dataclass."""
        return Noise(**self.model_dump())


class ExperimentTable(Table):
    """[[experiments]]: `channels` are those compared with the model, by default Fz, or uz for a profile.

    `data` is a file, or a list of files with the repeats of one test; `columns` replaces that of the study as a whole.
    """

    name: Name
    role: Literal["fit", "select", "validate"]
    data: Files
    columns: ColumnsTable | None = None
    kind: Literal["force", "profile"] = "force"
    channels: Channels = ()
    settings: Settings = Field(default_factory=dict)
    noise: NoiseTable = NoiseTable()
    mounting: Annotated[str, Field(min_length=1)] = "A"
    after: Names = ()

    @property
    def compared(self) -> tuple[str, ...]:
        """Channels to compare."""
        return self.channels or (("Fz",) if self.kind == "force" else ("uz",))

    @property
    def files(self) -> str:
        """Its files in words."""
        return ", ".join(self.data)


class DoeTable(Table):
    """[doe]: `runs` is what the user asks for; with `reduce`, similarity may need fewer.

    `extend` adds so many runs to a finished design, whose runs stay. `constraints` between the open parameters, in
    their units, hold for the design, the sensitivities and the search. A ccd is `inscribed` in the ranges, has its star
    points on the `face`s, or is `circumscribed`: then low and high are its corners and the star points lie beyond.
    """

    kind: Literal["lhs", "sobol", "ccd", "box_behnken", "factorial", "osf", "file"] = "lhs"
    runs: Runs = 40
    held_out: Annotated[int, Field(ge=0, le=1000)] = 5
    reduce: bool = True
    file: str | None = None
    optimise: bool = True
    star: Literal["inscribed", "circumscribed", "face"] = "inscribed"
    alpha: Annotated[float, Field(ge=1, le=10)] | None = None
    levels: Annotated[tuple[Annotated[int, Field(ge=2, le=1000)], ...], BeforeValidator(list_to_tuple)] | None = None
    extend: Annotated[int, Field(ge=0, le=10_000)] = 0
    constraints: Names = ()

    @model_validator(mode="after")
    def _file_with_kind(self) -> DoeTable:
        if (self.kind == "file") != (self.file is not None):
            raise ValueError('file = "points.csv" and kind = "file" belong together')
        owners = {"star": "ccd", "alpha": "ccd", "levels": "factorial", "optimise": "lhs"}
        wrong = [k for k, kind in owners.items() if k in self.model_fields_set and self.kind != kind]
        if wrong:
            raise ValueError(f'{wrong[0]} belongs to kind = "{owners[wrong[0]]}", not to "{self.kind}"')
        return self


class SurrogateTable(Table):
    """[surrogate]: `tolerance` is the relative error on new runs above which points are added."""

    kind: Literal["auto", "polynomial", "kriging", "whole_curve"] = "auto"
    degree: Annotated[int, Field(ge=1, le=8)] = 2
    tolerance: Tolerance = 0.01


class SensitivityTable(Table):
    """[sensitivity]: `samples` are the base points of the Sobol indices at the targets, a power of two."""

    local: bool = True
    morris: bool = False
    sobol: bool = True
    samples: Annotated[Positive, AfterValidator(power_of_two)] = 1024


class IdentifyTable(Table):
    """[identify]: parameters that the data must determine."""

    require: Names = ()


class VerifyTable(Table):
    """[verify]: how well a rerun must agree with its prediction, and how many runs may be added for it."""

    tolerance: Tolerance = 0.005
    max_infill: Count = 8


class DiagnoseTable(Table):
    """[diagnose]: `settings` replace those of the backend in the library of effects (a coarser mesh).

    Without `keep_ranges` an open parameter besides the modulus is bounded by the range of its product with that alone.
    """

    effects: Annotated[Any, AfterValidator(names_of_effects)] = "all"
    keep_ranges: bool = True
    settings: Settings = Field(default_factory=dict)


class LevelTable(Table):
    """One level of a ladder: its settings replace those of the study, `open` maps parameters to [low, high].

    It is put on the level that holds by then, unless it stands `alone`.  With nothing but a name, or as bare text, it
    is what the backend knows by this name.
    """

    name: Name
    description: Annotated[str, Field(max_length=200)] = ""
    settings: Settings = Field(default_factory=dict)
    open: dict[str, Range] = Field(default_factory=dict)
    alone: bool = False


def _rungs(value: Any) -> Any:
    """Lists of levels as tables; one that stands alone is a rung of its own."""
    if not isinstance(value, list):
        return value
    rungs = [v if isinstance(v, list) else [v] for v in value]
    return tuple(tuple({"name": v} if isinstance(v, str) else v for v in rung) for rung in rungs)


class LadderTable(Table):
    """[ladder]: levels from simple to rich, a list within the list holds alternatives; by default all that are offered.

    `runs` is the size of the design of each level; `ranges` says
    whether the open parameters are searched where the study says or where the backend's closed form does.  With
    `count_validation` the curves for validation count as those for selection: nothing is then left to validate on.
    """

    levels: Annotated[tuple[tuple[LevelTable, ...], ...], BeforeValidator(_rungs)] = ()
    runs: Runs | None = None
    confidence: Annotated[float, quantity_in("1"), Field(gt=0.5, lt=1)] = 0.95
    draws: Annotated[int, Field(ge=99, le=100_000)] = 400
    ranges: Literal["study", "start"] = "study"
    count_validation: bool = False


READINGS = 1000  # of a curve that might be measured: their covariance is a matrix


class NextExperiment(Table):
    """[[next.experiments]]: an experiment that might be done: its settings, what is read and how well.

    A force curve is read every `step` down to `depth` in its `channels`; with `marks` ([x, y] of surface points, mm) it
    is a profile, whose uz is read at the `depths`.  `words` says in a line what it is.
    """

    name: Name
    words: Annotated[str, Field(max_length=200)] = ""
    settings: Settings = Field(default_factory=dict)
    depth: Depth = 4.0
    step: Depth = 0.1
    channels: Channels = ("Fz",)
    marks: Annotated[tuple[Annotated[tuple[float, float], BeforeValidator(list_to_tuple)], ...],
                     BeforeValidator(list_to_tuple), AfterValidator(apart)] = ()  # fmt: skip
    depths: Annotated[tuple[Depth, ...], BeforeValidator(list_to_tuple), AfterValidator(apart)] = ()
    noise: NoiseTable = NoiseTable()

    @model_validator(mode="after")
    def _profile(self) -> NextExperiment:
        if bool(self.marks) != bool(self.depths):
            raise ValueError("a profile needs both marks and depths, a force curve neither")
        if self.step > self.depth:
            raise ValueError(f"step = {self.step:g} mm is larger than depth = {self.depth:g} mm")
        if self.depth / self.step > READINGS:
            raise ValueError(f"step = {self.step:g} mm: more than {READINGS} readings down to {self.depth:g} mm")
        return self


class NextTable(Table):
    """[next]: what experiments that nobody has done yet would tell (`rso next`).

    `truths` maps a parameter to the values that it is asked for (default: five over its range, for the parameter that
    is known worst); the others follow the data.  `runs` is the design of each experiment, `draws` the made-up data sets
    behind every expectation.
    """

    experiments: Annotated[tuple[NextExperiment, ...], BeforeValidator(list_to_tuple)] = ()
    truths: dict[str, Annotated[tuple[Bound, ...], BeforeValidator(list_to_tuple)]] = Field(default_factory=dict)
    runs: Runs | None = None
    draws: Annotated[int, Field(ge=10, le=10_000)] = 60

    @field_validator("experiments")
    @classmethod
    def _names_apart(cls, value: tuple[NextExperiment, ...]) -> tuple[NextExperiment, ...]:
        names = [e.name for e in value]
        if twice := sorted({n for n in names if names.count(n) > 1}):
            raise ValueError(f"the name {twice[0]!r} is there twice")
        return value

    @field_validator("truths")
    @classmethod
    def _one_parameter(cls, value: dict[str, Any]) -> dict[str, Any]:
        if len(value) > 1:
            raise ValueError(f"one parameter at a time, not {', '.join(value)}: the others follow the data")
        return value


class DispatchTable(Table):
    """[dispatch]: `timeout` is for one run, whatever the backend's own limit."""

    jobs: Annotated[int, Field(ge=1, le=10_000)] = 2
    engine: Literal["local", "dask"] = "local"
    address: Annotated[str, Field(min_length=1, max_length=300)] | None = None
    timeout: Duration | None = None

    @model_validator(mode="after")
    def _address_of_dask(self) -> DispatchTable:
        if self.address is not None and self.engine != "dask":
            raise ValueError('address is that of a Dask scheduler: it needs engine = "dask"')
        return self


class ReportTable(Table):
    """[report]"""

    html: bool = True
    pdf: bool = True


@dataclass(frozen=True, eq=False)
class Source:
    """Where a study came from: its file, the line of every key, and the measured files by experiment."""

    file: Path
    lines: Mapping[Place, int]
    measurements: Mapping[str, Measurement] = field(default_factory=dict)


class Study(Table):
    """A whole study file; made by :func:`rso.study.load`."""

    study: StudyTable
    backend: BackendTable
    parameters: dict[str, ParameterTable]
    experiments: Annotated[tuple[ExperimentTable, ...], BeforeValidator(list_to_tuple)]
    columns: ColumnsTable | None = None
    doe: DoeTable = DoeTable()
    surrogate: SurrogateTable = SurrogateTable()
    sensitivity: SensitivityTable = SensitivityTable()
    search: SearchTable = SearchTable()
    identify: IdentifyTable = IdentifyTable()
    verify: VerifyTable = VerifyTable()
    diagnose: DiagnoseTable = DiagnoseTable()
    ladder: LadderTable = LadderTable()
    next: NextTable = NextTable()
    dispatch: DispatchTable = DispatchTable()
    report: ReportTable = ReportTable()

    _source: Source = PrivateAttr()

    @property
    def file(self) -> Path:
        """The study file."""
        return self._source.file

    @property
    def folder(self) -> Path:
        """The folder that paths in the study are relative to."""
        return self._source.file.parent

    def inputs(self) -> list[Path]:
        """The files beside the study file from which it is read: data, and the points of a design."""
        names = [f for e in self.experiments for f in e.data] + [self.doe.file] * (self.doe.file is not None)
        return [self.folder / name for name in names]

    @property
    def lines(self) -> Mapping[Place, int]:
        """Line of every key, for messages."""
        return self._source.lines

    def experiment(self, name: str) -> ExperimentTable:
        """The experiment of this name."""
        return next(e for e in self.experiments if e.name == name)

    def measurement(self, name: str) -> Measurement:
        """The measured file of an experiment, as read when the study was loaded."""
        return self._source.measurements[name]

    def noise_of(self, name: str) -> Noise:
        """Errors of an experiment as stated; of its contact, unless stated, as the record tells where it was found."""
        e, found = self.experiment(name), self.measurement(name).contact
        noise = e.noise.noise()
        return noise if "contact" in e.noise.model_fields_set else replace(noise, contact=found)

    def settings_of(self, name: str) -> dict[str, Any]:
        """Settings of an experiment: its own replace those of the backend, whole top-level keys at a time."""
        return {**self.backend.settings, **self.experiment(name).settings}
