"""The tables of study.toml as frozen models: one class per table, every key with its default, nothing else allowed.

Quantities are floats in N, mm, MPa, s after loading.  Bounds of parameters stay as written, because their unit
is the backend's to say: see :func:`rso.study.resolve.resolve`.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    model_validator,
)

from rso.core import disk
from rso.core.polynomial_degree import MAX_POLYNOMIAL_DEGREE
from rso.data import Measurement, Noise
from rso.doe import SAMPLERS
from rso.evaluation.decks import DELIMITERS, Deck
from rso.evaluation.joint import BACKEND_SETTING
from rso.study.analysis_tables import DiagnoseTable, LadderTable, NextTable
from rso.study.base_table import StudyFileTable
from rso.study.columns_table import ColumnsTable
from rso.study.deck_table import FailureTable, OutputTable, deck_parameter, names_of_settings, pattern_alone, two_marks
from rso.study.fields import (
    TEXT_SCHEMA,
    Bound,
    Channels,
    Count,
    Duration,
    Files,
    Force,
    Name,
    Names,
    Positive,
    Runs,
    Settings,
    Tolerance,
    also,
    formed,
    list_to_tuple,
    power_of_two,
    visible_line,
)
from rso.study.line_numbers import Place
from rso.study.noise_table import NoiseTable
from rso.study.objectives_table import ObjectivesTable
from rso.study.search_table import SearchTable
from rso.study.settings_files import named_files, with_relative_paths
from rso.study.specimens_table import SpecimenTable

if TYPE_CHECKING:
    DesignKind = str
else:
    DesignKind = Literal[(*SAMPLERS, "file")]  # one for each file of rso.doe.samplers


class StudyTable(StudyFileTable):
    """[study]: the study as a whole."""

    title: Annotated[str, Field(min_length=1, max_length=200), AfterValidator(visible_line)]
    """What the report is called."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    """Root of all random numbers: the same seed gives the same answer, whatever the number of jobs."""
    units: Literal["N-mm-MPa-s"] = "N-mm-MPa-s"
    """Units of bare numbers; text may carry another unit of the same kind."""


class BackendTable(StudyFileTable):
    """[backend]: what simulates, a Python object or an external command."""

    use: Annotated[str, formed(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", 'expected is "package.module:NAME"')] | None = None
    """A Python object that simulates."""
    command: Annotated[tuple[str, ...], BeforeValidator(list_to_tuple), Field(min_length=1)] | None = None
    """Or a program, called with the paths of request.json and response.json behind its arguments, or, with a template,
    as it is written."""
    template: Files | None = None
    """Input files of the program with placeholders such as {mu:.6e} or {2 / D1}; each run has a folder of its own.
    What is between a line {each asked} and one {end} is repeated for each asked {travel} and {time}."""
    files: Names = ()
    """Further files that are put beside them unchanged, such as a mesh."""
    outputs: dict[str, OutputTable] = Field(default_factory=dict)
    """Where the program writes each channel, Fz = {…}."""
    failed: Annotated[FailureTable, BeforeValidator(pattern_alone), also(TEXT_SCHEMA)] | None = None
    """What in the output means that there is no answer; a text is a regular expression."""
    delimiters: Annotated[tuple[str, str], BeforeValidator(two_marks)] = DELIMITERS
    """What placeholders begin and end with, for input files that have braces of their own."""
    settings: Settings = Field(default_factory=dict)
    """Settings of the backend for every experiment: specimen, indenter, support, material, mesh, point, …"""
    timeout: Duration | None = None
    """The longest that one run may take."""

    @model_validator(mode="after")
    def _one_of(self) -> BackendTable:
        if (self.use is None) == (self.command is None):
            raise ValueError('give either use = "package.module:NAME" or command = ["program", "argument"]')
        own = [k for k in ("files", "outputs", "failed", "delimiters") if k in self.model_fields_set]
        if self.template is None and own:
            raise ValueError(f"{own[0]} belongs to a program with a template: give template = [...] too")
        if self.template is not None and (self.command is None or not self.outputs):
            lost = "outputs.Fz = { file = …, reader = … }" if self.command else 'command = ["program", "argument"]'
            raise ValueError(f"a template needs {lost}")
        return self


class NamedBackendTable(BackendTable):
    """[backends]: a further backend, which answers for the experiments that name it."""


class ParameterTable(StudyFileTable):
    """[parameters]: a range to search, or a value that fixes it."""

    low: Bound = None
    """Lower end of the range to search, in the backend's unit or with its own."""
    high: Bound = None
    """Upper end of it."""
    scale: Literal["linear", "log"] = "linear"
    """Whether the range is covered evenly or in its logarithm; moduli go by logarithm."""
    value: Bound = None
    """Or the value that fixes the parameter."""
    whole: bool = False
    """Whether only whole numbers between low and high are searched."""
    values: (
        Annotated[tuple[Bound, ...], BeforeValidator(list_to_tuple), Field(min_length=2, max_length=1000)] | None
    ) = None
    """Or the values that it may have, in place of low and high, such as ["1.5 mm", "2 mm"]."""
    choices: Annotated[tuple[str, ...], BeforeValidator(list_to_tuple), Field(min_length=2, max_length=50)] | None = (
        None
    )
    """Or texts to choose from, which have no order, such as ["steel", "brass"]."""
    unit: str | None = None
    """Of a parameter of a template, where its numbers do not say it: N, mm, MPa, s and what is made of them."""
    bounds: Annotated[tuple[Bound, Bound], BeforeValidator(list_to_tuple)] | None = None
    """Of such a parameter: limits of the program itself. By default its range, or any positive value where its unit
    holds a stress."""
    description: Annotated[str, Field(min_length=1, max_length=80), AfterValidator(visible_line)] | None = None
    """Of such a parameter: what it means, in a few words."""

    @model_validator(mode="after")
    def _range_or_value(self) -> ParameterTable:
        if self.values is not None or self.choices is not None:
            own = "values" if self.values is not None else "choices"
            beside = [k for k in ("low", "high", "value", "whole", "values", "choices", "scale", "bounds") if k != own]
            if self.choices is None:
                beside.remove("scale")
            if wrong := [k for k in beside if k in self.model_fields_set]:
                raise ValueError(f"{own} says all that it may be: leave {wrong[0]} out")
            listed = getattr(self, own)
            if twice := [v for k, v in enumerate(listed) if v in listed[:k]]:
                raise ValueError(f"{own}: {twice[0]!r} is there twice")
            return self
        if (self.low is None) != (self.high is None):
            raise ValueError("low and high must be given together")
        if self.value is None and self.low is None:
            raise ValueError("give low and high, values, choices, or value to fix it")
        if self.whole and self.value is not None:
            raise ValueError("value fixes it: leave whole out")
        beside = [k for k in ("low", "high", "scale") if k in self.model_fields_set]
        if self.value is not None and beside:
            raise ValueError(f"value fixes it, and {beside[0]} belongs to a range to search: leave one of them out")
        return self


class ExperimentTable(StudyFileTable):
    """[[experiments]]: a test that was done, and what the model is to do with it."""

    name: Name
    """How the experiment is called everywhere else."""
    role: Literal["fit", "select", "validate"]
    """Fitted; looked at when candidates or models are chosen; or only looked at in the end."""
    data: Files
    """Several files are repeats of one test; `book.xlsx#Sheet` is a sheet of a workbook.  `file.txt#2` is the second
    block or table of a text file, beneath or beside the first."""
    columns: ColumnsTable | None = None
    """Its own columns: these replace those of the study as a whole."""
    kind: Literal["force", "profile", "surface"] = "force"
    """Forces against depth; displacements of marks, not fitted by `rso run`; or of a point cloud, which is."""
    channels: Channels = ()
    """Those compared with the model; by default Fz, uz of a profile, and ux, uy, uz of a point cloud."""
    points: Annotated[int, Field(ge=1, le=300)] | None = None
    """Of a point cloud: how many of its points are compared, 30 unless stated; the most informative are taken."""
    branch: Literal["loading", "unloading"] = "loading"
    """Loading, or unloading down to the strongest pull. Two experiments with the same data compare both."""
    backend: str | None = None
    """Which of [backends] answers for it, by its name; by default the first, [backend]."""
    settings: Settings = Field(default_factory=dict)
    """Settings of the backend for this experiment, in place of keys of the same name."""
    noise: NoiseTable = NoiseTable()
    """What its readings are uncertain by."""
    preload: Force | None = None
    """Where its travel was set to 0 at a small force, that force, as "10 mN". Contact is found before it, by the shape
    of Fz, or in its approach; Fz may have been set to 0 there, too."""
    drift: Literal["time", "travel", "none"] | None = None
    """Along what a line through the forces of its approach is subtracted from the whole record, or that they have none.
    Unless stated, a drift that the approach shows counts as an error."""
    uncertainty: dict[str, Bound] = Field(default_factory=dict)
    """Standard uncertainties of its own specimen or indenter, in place of those in [uncertainty]."""
    mounting: Annotated[str, Field(min_length=1), AfterValidator(visible_line)] = "A"
    """Tests of one mounting share what it may be off by, as a tilt: the specimen was not taken out between them."""
    after: Names = ()
    """Experiments that the specimen had been through before: a softening depends on them."""

    def differing(self, other: ExperimentTable) -> list[str]:
        """Keys in which two experiments differ, beside name, branch, channels and settings."""
        keys = ("role", "columns", "kind", "backend", "noise", "preload", "drift", "uncertainty", "mounting", "after")
        files = [[os.path.normpath(f) for f in e.data] for e in (self, other)]
        return [
            *(["data"] if files[0] != files[1] else []),
            *(k for k in keys if getattr(self, k) != getattr(other, k)),
        ]

    @property
    def compared(self) -> tuple[str, ...]:
        """Channels to compare."""
        usual = {"force": ("Fz",), "profile": ("uz",), "surface": ("ux", "uy", "uz")}
        return self.channels or usual[self.kind]

    @model_validator(mode="after")
    def _of_a_surface(self) -> ExperimentTable:
        if self.kind == "surface" and self.role == "select":
            raise ValueError(
                'a point cloud (kind = "surface") is fitted or validates: choose role = "fit" or "validate"'
            )
        if self.drift is not None and self.kind != "force":
            raise ValueError('drift is that of forces: it belongs to kind = "force"')
        if self.points is not None and self.kind != "surface":
            raise ValueError('points belongs to a point cloud, kind = "surface"')
        return self

    @property
    def files(self) -> str:
        """Its files in words."""
        return ", ".join(self.data)


class DoeTable(StudyFileTable):
    """[doe]: the design of experiments, which simulations are run."""

    kind: DesignKind = "lhs"
    """Box-Behnken, central composite, factorial, Latin hypercube, optimal space filling, Sobol, or points of a file."""
    runs: Runs = 40
    """What is asked for; with `reduce`, where similarity holds, fewer: `rso check` says how many."""
    held_out: Annotated[int, Field(ge=0, le=1000)] = 5
    """Runs that score all surrogates before any of them learns these."""
    reduce: bool = True
    """Whether exact similarity, where units and backend grant it, takes a parameter out of the design."""
    file: str | None = None
    """A CSV file with one point in each row, one parameter in each column."""
    optimise: bool = True
    """Whether a Latin hypercube is spread out further."""
    star: Literal["inscribed", "circumscribed", "face"] = "inscribed"
    """Star points of a ccd within the ranges, beyond them (low and high are then its corners), or on their faces."""
    alpha: Annotated[float, Field(ge=1, le=10)] | Literal["rotatable", "orthogonal"] | None = None
    """Distance of the star points in units of that of the corners; by default that of a rotatable design."""
    centres: Annotated[int, Field(ge=1, le=100)] = 1
    """Centre points that an orthogonal ccd counts; a computed centre repeats exactly and is run once."""
    levels: Annotated[tuple[Annotated[int, Field(ge=2, le=1000)], ...], BeforeValidator(list_to_tuple)] | None = None
    """Number of levels of each parameter of a factorial design."""
    extend: Annotated[int, Field(ge=0, le=10_000)] = 0
    """So many runs more for a finished design, whose runs stay."""
    constraints: Names = ()
    """Conditions between open parameters, in their units, for design, sensitivities and search, such as mu * D1 < 1."""

    @model_validator(mode="after")
    def _file_with_kind(self) -> DoeTable:
        if (self.kind == "file") != (self.file is not None):
            raise ValueError('file = "points.csv" and kind = "file" must be given together')
        owners = {k: s.name for s in SAMPLERS.values() for k in s.options}
        wrong = [k for k, kind in owners.items() if k in self.model_fields_set and self.kind != kind]
        if wrong:
            raise ValueError(f'{wrong[0]} belongs to kind = "{owners[wrong[0]]}", not to "{self.kind}"')
        return self

    def options(self) -> dict[str, Any]:
        """Values of the keys that belong to the kind of this design alone."""
        return {k: getattr(self, k) for k in SAMPLERS[self.kind].options} if self.kind in SAMPLERS else {}


class SurrogateTable(StudyFileTable):
    """[surrogate]: the response surfaces."""

    kind: Literal["auto", "polynomial", "kriging", "whole_curve"] = "auto"
    """Response surfaces: chosen by their scores, or of one kind; whole_curve learns curves, not single forces."""
    degree: Annotated[int, Field(ge=1, le=MAX_POLYNOMIAL_DEGREE)] | None = None
    """Of the polynomial; chosen by cross-validation where it is not stated."""
    tolerance: Tolerance = 0.01
    """Error on new runs above which runs are added, at most verify.max_infill: a share of the output's spread over the
    ranges (√12 standard deviations). An error below the stated numerical error of the runs does not count."""


class SensitivityTable(StudyFileTable):
    """[sensitivity]: what moves the responses."""

    local: bool = True
    """Bars of local sensitivity, as the change over the range."""
    morris: bool = False
    """Elementary effects (Morris screening)."""
    sobol: bool = True
    """First-order and total Sobol indices at the targets."""
    ranges: Literal["stated", "searched"] = "stated"
    """Over which ranges: those that the study states, or those that the main search has widened."""
    samples: Annotated[Positive, AfterValidator(power_of_two)] = 1024
    """Base points of the Sobol indices, a power of two, at least 4."""


class IdentifyTable(StudyFileTable):
    """[identify]: what the data must determine."""

    require: Names = ()
    """Parameters that the data must determine: exit code 5 where they do not."""


class VerifyTable(StudyFileTable):
    """[verify]: candidates are simulated again."""

    tolerance: Tolerance = 0.005
    """How well the rerun of a candidate must agree with its prediction: exit code 4 where it does not."""
    max_infill: Count = 8
    """Runs that may be added until it does."""


Words = Annotated[str, Field(min_length=1, max_length=300), AfterValidator(visible_line)]


class SlurmTable(StudyFileTable):
    """[dispatch.slurm]: what each job of SLURM asks for.  Jobs compute one run after another, with one processor."""

    partition: Words | None = None
    """As of sbatch; by default that of the cluster."""
    account: Words | None = None
    """As of sbatch."""
    qos: Words | None = None
    """As of sbatch."""
    walltime: Duration = 3600.0
    """The longest that a job may take, with all its runs; SLURM takes whole minutes."""
    memory_gb: Annotated[float, Field(gt=0)] | None = None
    """Memory of a job, GB; by default that of the cluster."""
    runs_per_job: Runs = 1
    """Runs that one job computes: more of them where a run is short beside the start of a job."""
    setup: Annotated[tuple[Words, ...], BeforeValidator(list_to_tuple)] = ()
    """Lines of shell before a job computes, such as "module load python"."""
    options: Settings = Field(default_factory=dict)
    """Further words of sbatch, such as { constraint = "icelake" }."""
    folder: Words | None = None
    """Where calls and answers lie, which all machines must see; by default slurm/ in the folder of results."""
    here: bool = False
    """Whether jobs are processes of this machine, to try a study where SLURM is not."""


class DispatchTable(StudyFileTable):
    """[dispatch]: how simulations are run."""

    jobs: Annotated[int, Field(ge=1, le=10_000)] = 2
    """Simulations at a time."""
    engine: Literal["local", "dask", "slurm"] = "local"
    """Processes of this machine, a Dask cluster, or job arrays of SLURM."""
    address: Annotated[str, Field(min_length=1, max_length=300)] | None = Field(
        default=None,
        description="Of a Dask scheduler that runs already; `tls://` with certificates where others reach it, "
        "else they run code as you.",
    )
    timeout: Duration | None = None
    """For one run, whatever the backend's own limit."""
    slurm: SlurmTable = SlurmTable()
    """What each job of SLURM asks for."""

    @model_validator(mode="after")
    def _of_its_engine(self) -> DispatchTable:
        if self.address is not None and self.engine != "dask":
            raise ValueError('address is that of a Dask scheduler: it needs engine = "dask"')
        if self.slurm != SlurmTable() and self.engine != "slurm":
            raise ValueError('slurm says what jobs of SLURM ask for: it needs engine = "slurm"')
        return self


class ReportTable(StudyFileTable):
    """[report]: which pages are written."""

    html: bool = True
    """Whether report.html is written."""
    pdf: bool = True
    """Whether report.pdf is."""


@dataclass(frozen=True, eq=False)
class StudySource:
    """Where a study came from: its file, the line of every key, and the measured files by experiment.

    Of one of many specimens its name, and a hash of what the file and the table of specimens say of it.
    """

    file: Path
    lines: Mapping[Place, int]
    measurements: Mapping[str, Measurement] = field(default_factory=dict)
    specimen: str = ""
    digest: str = ""


class Study(StudyFileTable):
    """A whole study file; made by :func:`rso.study.loader.load_study`."""

    study: StudyTable
    backend: BackendTable
    backends: dict[str, NamedBackendTable] = Field(default_factory=dict)
    """Further backends by name, each for the experiments that name it; parameters of one name are one parameter."""
    parameters: dict[str, ParameterTable]
    uncertainty: dict[str, Bound] = Field(default_factory=dict)
    """Standard uncertainties of what the study states, which all its tests share, as delta_thickness = "0.1 mm" of the
    thickness of a slab. Intervals of parameters include them, to first order; without them dimensions are exact."""
    experiments: Annotated[tuple[ExperimentTable, ...], BeforeValidator(list_to_tuple)] = ()
    objectives: ObjectivesTable | None = None
    specimens: Annotated[tuple[SpecimenTable, ...], BeforeValidator(list_to_tuple)] = ()
    """Many specimens, each fitted for itself; or the name of a table of them."""
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

    _source: StudySource = PrivateAttr()

    @property
    def file(self) -> Path:
        """The study file."""
        return self._source.file

    @property
    def folder(self) -> Path:
        """The folder that paths in the study are relative to."""
        return self._source.file.parent

    @property
    def specimen(self) -> str:
        """The name of the specimen, of a study of many; else nothing."""
        return self._source.specimen

    @property
    def sha256(self) -> str:
        """Hash of the study file, or of what it says of this specimen."""
        return self._source.digest or hashlib.sha256(disk.read_bytes(self.file)).hexdigest()

    def inputs(self) -> list[Path]:
        """The files beside the study file from which it is read: data, points of a design, files that settings name."""
        names = [f for e in self.experiments for f in e.data] + ([] if self.doe.file is None else [self.doe.file])
        names += [*(self.backend.template or ()), *self.backend.files]
        settings = [b.settings for b in (self.backend, *self.backends.values())]
        settings += [e.settings for e in self.experiments]
        found = (self.folder / f for each in settings for f in named_files(each))
        return [*(self.folder / name for name in names), *(f for f in dict.fromkeys(found) if f.is_file())]

    def deck(self) -> Deck | None:
        """The input files of its program, None where the backend has none; ValueError for what contradicts."""
        b = self.backend
        if b.template is None:
            return None
        found = [deck_parameter(name, table) for name, table in self.parameters.items()]
        settings = (b.settings, *(e.settings for e in self.experiments))
        return Deck(
            b.template,
            tuple(p for p, _ in found),
            tuple(r for _, r in found),
            tuple(table.output(name) for name, table in b.outputs.items()),
            b.files,
            None if b.failed is None else b.failed.failure(),
            b.delimiters,
            names_of_settings(settings),
        )

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
        """Errors of an experiment as stated; of its contact, unless stated, as the record shows where it was found."""
        e, found = self.experiment(name), self.measurement(name).contact
        noise = e.noise.noise()
        return replace(noise, contact=found) if noise.contact is None and found > 0.0 else noise

    def beside(self, experiments: Sequence[ExperimentTable], measurements: Mapping[str, Measurement]) -> Study:
        """The study with more experiments, of which the measured files are given by name."""
        made = self.model_copy(update={"experiments": (*self.experiments, *experiments)})
        made._source = replace(self._source, measurements={**self._source.measurements, **measurements})
        return made

    def settings_of(self, name: str) -> dict[str, Any]:
        """Settings of an experiment: its own replace those of the backend, whole top-level keys at a time."""
        e = self.experiment(name)
        if e.backend is None:
            return {**self.backend.settings, **e.settings}
        return {**self.backends[e.backend].settings, **e.settings, BACKEND_SETTING: e.backend}

    def written(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """Settings as results keep them: with paths of files relative to the study file."""
        return with_relative_paths(settings, self.folder)
