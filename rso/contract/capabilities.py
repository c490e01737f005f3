"""What a backend may offer beside :class:`.Backend`: one typed protocol per question that `rso` can ask it.

Each is optional and stands alone: a backend implements what it can answer, under the name given here, and
:func:`capability` is how `rso` asks.  What happens without it stands in each docstring; no answer of a simulation
and no run key depends on a capability (but for :class:`Fingerprint`, which is part of every key).  Lengths are in mm,
times in s, forces in N, moduli in MPa; `settings` are those of one case, as the study states them.
`docs/adding.md` has an example of each.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from rso.contract.cases import Case
from rso.contract.responses import Response

C = TypeVar("C")
Settings = Mapping[str, Any]

# --- priors: what is known before a test ---------------------------------------------------------------------------


class PlausibleRanges(Protocol):
    """Ranges of knobs that depend on the settings; without it each knob's declared `plausible` range holds."""

    def plausible(self, settings: Settings, given: Collection[str], /) -> Mapping[str, tuple[float, float] | None]:
        """Knob → its plausible range (in its unit) at these settings, None where there is no such effect.

        `given` are the knobs that have a value or are identified.  Knobs left out keep their declared range.
        """
        ...


class NominalValues(Protocol):
    """Values that the settings give to knobs; without it an effect is absent at its declared neutral value."""

    def nominal(self, settings: Settings, /) -> Mapping[str, float]:
        """Knob → the value that these settings state, where its effect is absent."""
        ...


class StatedDimensions(Protocol):
    """Sizes of body and indenter; without it an uncertainty is compared with the hard bounds of its knob alone."""

    def dimensions(self, settings: Settings, /) -> Mapping[str, float]:
        """Knob → the size, stated by these settings, that it is an error of, in the knob's unit; 1 of a share of it."""
        ...


class PhysicalBounds(Protocol):
    """Bounds of nature; without it only the hard bounds of knobs limit the sizes of effects."""

    def physical(self) -> Mapping[str, tuple[float, float]]:
        """Knob → bounds in its unit that no ordinary material leaves, whatever its modulus."""
        ...


class OrdinaryMaterials(Protocol):
    """Conditions between knobs; without it ranges are widened and checked with no condition."""

    def ordinary(self) -> Mapping[str, str]:
        """Condition between knobs (as in a study: ``mu * D1 <= 3``) → what it says, as a noun phrase."""
        ...


# --- alternatives: other models of the same experiment --------------------------------------------------------------


class Variants(Protocol):
    """Other settings that a diagnosis may try; without it only effects that a number switches are tried."""

    def variants(self, settings: Settings, /) -> Mapping[str, Mapping[str, Any]]:
        """Name → ``{"description": str, "settings": those replaced, "group": group of its knobs or ""}``."""
        ...


class ModelHierarchy(Protocol):
    """Models from simple to rich for `rso ladder`; without it the ladder has the study's own model only."""

    def levels(self, settings: Settings, /) -> tuple[tuple[Mapping[str, Any], ...], ...]:
        """Rungs, each a tuple of models side by side, of which each is a table.

        Keys: `name`, `title`, `description`, `settings` (replace the study's), `open` (knob → range, moduli as shares
        of the modulus), `hold` (knob → value, moduli likewise), `closed_form`, `extends` (the model it is at neutral).
        """
        ...


class Relaxation(Protocol):
    """Whether a model relaxes; without it one does that has a knob in seconds which its canonical values keep."""

    def relaxes(self, values: Mapping[str, float], settings: Settings, /) -> bool:
        """Whether forces go on changing while the indenter rests at one depth, with these values and settings."""
        ...


class ForceControl(Protocol):
    """Whether programmes may be controlled by force; without it travel alone is, and such a programme is refused."""

    def controls_force(self, settings: Settings, /) -> bool:
        """Whether segments at a force, or to one, and asked forces are understood with these settings."""
        ...


# --- closed forms: answers and starts without a simulation ----------------------------------------------------------


class ClosedForm(Protocol):
    """Answers of a level of `levels` with ``closed_form = True``, which such a level needs."""

    def closed_form(self, values: Mapping[str, float], case: Case, /) -> Response:
        """The response to a case in closed form: the channels that it knows at the asked travels of loading."""
        ...


@dataclass(frozen=True)
class FormulaCurve:
    """A closed form of the literature: forces (n,) N at the asked travels, and at each why it does not hold or ""."""

    name: str
    source: str
    force: np.ndarray
    invalid: tuple[str, ...]


class Formulas(Protocol):
    """Closed forms of the literature for an experiment; without it a report compares the simulations with none."""

    def formulas(self, values: Mapping[str, float], case: Case, /) -> Sequence[FormulaCurve]:
        """Each closed form that exists, the simplest first, at the asked travels of loading."""
        ...


class ClosedFormStart(Protocol):
    """Ranges from a measured curve before any simulation; without it a ladder starts from the study's ranges."""

    def start(self, case: Case, travel: np.ndarray, force: np.ndarray, /) -> Mapping[str, tuple[float, float, float]]:
        """Knob → (low, value, high) in its unit from Fz (n,) N at travels (n,) mm; ValueError where none follow."""
        ...


class ContactModulus(Protocol):
    """The modulus of a loading in the limit of small contacts; without it `rso check` and `rso new` state none."""

    def hertz(self, settings: Settings, depth: np.ndarray, force: np.ndarray, /) -> Mapping[str, float]:
        """Knob → the modulus (MPa) that Fz (n,) N at depths (n,) mm would have on a half-space."""
        ...


class ForceExponents(Protocol):
    """How force grows over small depths; without it as 3/2, that of a smooth rounded tip."""

    def exponents(self, settings: Settings, /) -> tuple[float, ...]:
        """Exponents p of Fz = Σ_p a_p u^p at depths u (mm) small against the indenter, the leading one first."""
        ...


# --- costs and accuracy ---------------------------------------------------------------------------------------------


class CostModel(Protocol):
    """How long simulations take; without it each is taken for 10 s until runs are stored."""

    def cost(self, values: Mapping[str, float], case: Case, /) -> float:
        """Seconds of one run on one thread, right to a factor of two or so."""
        ...


class LeanSettings(Protocol):
    """Settings of runs for forces alone, on the study's own mesh; without it such runs cost what all do."""

    @property
    def lean(self) -> Settings:
        """Settings, replacing those of a case, that leave out what a diagnosis does not read."""
        ...


class DraftSettings(Protocol):
    """Settings of many cheap runs whose differences count; without it those of :class:`LeanSettings` are taken."""

    @property
    def draft(self) -> Settings:
        """Settings, replacing those of a case, of a cheap run."""
        ...


class Resolution(Protocol):
    """What the discretisation misses; without it nothing is said of it before a run."""

    def resolution(self, settings: Settings, depth: float, given: Collection[str], /) -> Mapping[str, float]:
        """Level of the mesh, that of the settings first → share of the force that it misses at a depth (mm).

        `given` are the knobs that have a value or are identified; empty where nothing is known of these.
        """
        ...


class Reduction(Protocol):
    """How much of a symmetric experiment is simulated; without it `rso check` says nothing of that."""

    def reduction(self, values: Mapping[str, float], case: Case, /) -> str | None:
        """The part that is simulated with these values, in words; None where that is what one expects."""
        ...


class Refusals(Protocol):
    """Values that have no answer; without it `rso check` says nothing of the corners of the ranges."""

    def refused(self, values: Mapping[str, float], case: Case, /) -> str | None:
        """Why a simulation with these values would fail before its depth; None where nothing speaks against it."""
        ...


class ErrorCalibration(Protocol):
    """Whether stated numerical errors were fitted for what is modelled; without it they are taken as they are."""

    def uncalibrated(self, settings: Settings, given: Collection[str], /) -> str | None:
        """What a reader must know of the errors that runs with these settings state; None where they are calibrated.

        `given` are the knobs that have a value or are identified; empty where nothing is known of these.
        """
        ...


class SizeChecks(Protocol):
    """Whether stated sizes fit the record of a test; without it nobody compares them."""

    def odd_sizes(self, settings: Settings, depth: float, notes: Sequence[str], /) -> Sequence[str]:
        """What does not fit between sizes, the deepest reading (mm) and the notes of the file, a sentence each."""
        ...


class DistortionDepth(Protocol):
    """Where programs of one model part company; without it that is the deepest travel of the tests."""

    def deep(self, settings: Settings, /) -> float:
        """Travel (mm) from which the meshes of two programs distort differently; 0 for none."""
        ...


# --- further tests: what would tell causes apart --------------------------------------------------------------------


class FurtherTests(Protocol):
    """Tests of the same specimen to propose; without it tests with the same settings are proposed only."""

    def tests(self, settings: Settings, /) -> Mapping[str, Settings]:
        """The test in words → the settings that it replaces."""
        ...


class SurfaceMarks(Protocol):
    """Displacements of the surface to propose; without it no such measurement is proposed."""

    def marks(self, settings: Settings, /) -> Mapping[str, list[list[float]]]:
        """Marks that a camera could follow, in words → their places [[x, y], …] in mm."""
        ...


class PreventableEffects(Protocol):
    """Tests again without an effect to propose; without it none is proposed."""

    def prevented(self) -> Mapping[str, tuple[str, ...]]:
        """The tests again with something kept from acting, in words → the knobs that are neutral in them."""
        ...


class Gauges(Protocol):
    """Measurements beside the tests to propose; without it those of the measurement chain are proposed only."""

    def gauges(self, settings: Settings, /) -> Mapping[str, tuple[str, float]]:
        """Knob → a measurement that shows it by itself, in words, and its standard uncertainty in the knob's unit."""
        ...


# --- what is modelled, in words and lines ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Drawn:
    """One part of a sketch: its role, points (horizontal, up) in mm, and what is written beside it.

    Roles: the polygons `specimen`, `layer`, `indenter` where it first touches and `deepest` where it ends; the lines
    `edge` of the specimen, `held` where it is held, `support` of what it touches, solid to the right of their way;
    `dimension` between two points; `contact`, one point.
    """

    role: str
    points: tuple[tuple[float, float], ...]
    text: str = ""


@dataclass(frozen=True)
class Sketch:
    """An experiment in a sentence and as a vertical section through the axis of its indenter, along `plane`."""

    words: str
    plane: str
    drawn: tuple[Drawn, ...]


class Sketches(Protocol):
    """A sketch of an experiment for `rso check`, `rso new` and reports; without it they show none."""

    def sketch(self, settings: Settings, depth: float, /) -> Sketch:
        """What these settings are taken for, with a deepest travel (mm); ValueError for what is not modelled."""
        ...


@dataclass(frozen=True)
class DeformedFrame:
    """A section at one travel (mm) and force (N): points (n, 2) mm, triangles (t, 3) of them, fields (n,).

    `indenter` (k, 2) mm is its outline; `mirrored` says that the section goes on beyond 0 as its mirror image.
    """

    travel: float
    force: float
    points: np.ndarray
    triangles: np.ndarray
    fields: Mapping[str, np.ndarray]
    indenter: np.ndarray
    mirrored: bool = False


@dataclass(frozen=True)
class DeformedSurface:
    """The surface of the body in the last frame: points (n, 3) mm, triangles (t, 3), the same fields (n,).

    `mirrored` says of x and y whether the body goes on beyond 0 as its mirror image.
    """

    points: np.ndarray
    triangles: np.ndarray
    fields: Mapping[str, np.ndarray]
    mirrored: tuple[bool, bool]


@dataclass(frozen=True)
class DeformedBody:
    """A body as it is deformed: vertical sections along `plane` (as in :class:`Sketch`) from contact to the end.

    `units` are those of the fields, the most telling first.  No frames without an answer.
    """

    plane: str
    units: Mapping[str, str]
    frames: tuple[DeformedFrame, ...]
    surface: DeformedSurface | None = None


class DeformedBodies(Protocol):
    """The deformed body of a run in colour, for the first screen of a report; without it that shows none."""

    def deformed(self, values: Mapping[str, float], case: Case, /) -> DeformedBody:
        """The body of a run that is done, simulated again with its states; SimulationFailed where there is none."""
        ...


class FilledInputs(Protocol):
    """The input files of a program as they would be filled, for `rso check`; without it none is shown."""

    def filled(self, values: Mapping[str, float], case: Case, /) -> Mapping[str, Sequence[tuple[int, str, bool]]]:
        """File → its lines, each with its line in the template and whether something is filled in; nothing is run."""
        ...


@dataclass(frozen=True)
class DerivedQuantity:
    """A quantity that follows from parameters: letter, description, unit, and q = of(values), arrays in and out.

    Where its interval lies outside of the `ordinary` range, a reader reads `otherwise`.
    """

    name: str
    letter: str
    description: str
    unit: str
    of: Callable[[Mapping[str, np.ndarray]], np.ndarray]
    ordinary: tuple[float, float] = (-math.inf, math.inf)
    otherwise: str = ""


class DerivedQuantities(Protocol):
    """Quantities that people think in; without it a report states the parameters alone."""

    def derived(self, settings: Settings, given: Collection[str], /) -> Sequence[DerivedQuantity]:
        """The quantities that follow from the parameters `given`, the most telling first."""
        ...


class FreeCurves(Protocol):
    """Curves over abscissae of their own, such as a stretch or a frequency; without it there are channels alone."""

    def free_curves(self) -> Mapping[str, tuple[str, str, str]]:
        """Name → unit of the curve, name of its abscissa, and that one's unit: what `Response.curves` will hold."""
        ...


class Exports(Protocol):
    """Files for other programs; without it `rso export` writes tables only."""

    def exports(self) -> Mapping[str, str]:
        """Format → what it is, in a few words."""
        ...

    def exported(
        self, kind: str, values: Mapping[str, float], case: Case, remarks: Sequence[str], /
    ) -> Mapping[str, str]:
        """File → text of one of these formats, with `remarks` as comments; ValueError for what it cannot say."""
        ...


# --- new studies ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Line:
    """A line of a first study: plain data, what is said behind it, and whether nobody has stated it (a guess)."""

    value: Any
    remark: str = ""
    guess: bool = False


@dataclass(frozen=True)
class Option:
    """An option of `rso new`: its name, a word and a unit for each of its values, and its help.

    The first `least` values must be given, all by default; with `repeated` the last word stands for any number of
    values.  A unit is "mm" or "deg", of a number that is handed over in it, "file", an absolute path, which
    the study will hold as it finds it, or "text".
    """

    name: str
    words: tuple[str, ...]
    units: tuple[str, ...]
    help: str
    least: int | None = None
    repeated: bool = False


Given = Mapping[str, tuple[float | str, ...]]


class SettingUnits(Protocol):
    """Units of settings; without it a unit that a table of specimens states for one is believed."""

    def setting_unit(self, settings: Settings, keys: Sequence[str], /) -> str | None:
        """The unit that numbers of a setting are in, by its keys ("specimen", "thickness"), "1" of a pure number.

        None for what is no number, or no setting.
        """
        ...


class NewStudies(Protocol):
    """First studies by `rso new`; without it a study of this backend is written by hand."""

    def options(self) -> Sequence[Option]:
        """Options of the command line that say what a record does not."""
        ...

    def first_settings(self, given: Given, depths: Sequence[float], /) -> Mapping[str, Line]:
        """Setting → its line, by options → their values and the deepest reading (mm) of each force test.

        ValueError, naming option, value and unit, for what is missing or contradicts.
        """
        ...

    def first_parameters(self, settings: Settings, depth: np.ndarray, force: np.ndarray, /) -> Mapping[str, Line]:
        """Knob → a table with low, high and scale, by a loading Fz (n,) N at depths (n,) mm; n = 0 without one.

        ValueError for a record that no value explains.
        """
        ...


# --- identity -------------------------------------------------------------------------------------------------------


class Fingerprint(Protocol):
    """What answers depend on beside `numerics`; the loader sets it for a foreign backend that has none itself."""

    @property
    def fingerprint(self) -> str:
        """A text that changes when, and only when, answers may; part of every run key, "" for none."""
        ...


CAPABILITY_GROUPS: Mapping[str, tuple[type, ...]] = {
    "priors": (PlausibleRanges, NominalValues, StatedDimensions, PhysicalBounds, OrdinaryMaterials),
    "alternatives": (Variants, ModelHierarchy, Relaxation, ForceControl),
    "closed forms": (ClosedForm, Formulas, ClosedFormStart, ContactModulus, ForceExponents),
    "costs and accuracy": (
        CostModel,
        LeanSettings,
        DraftSettings,
        Resolution,
        Reduction,
        Refusals,
        ErrorCalibration,
        DistortionDepth,
    ),
    "further tests": (FurtherTests, SurfaceMarks, PreventableEffects, Gauges),
    "what is modelled": (Sketches, DeformedBodies, FilledInputs, DerivedQuantities, FreeCurves, Exports),
    "new studies": (NewStudies, SettingUnits),
    "identity": (Fingerprint,),
}
CAPABILITIES: tuple[type, ...] = tuple(kind for kinds in CAPABILITY_GROUPS.values() for kind in kinds)


def capability(backend: object, kind: Callable[..., C]) -> C | None:
    """The backend as one that answers the protocol `kind`, None where it lacks a member or has it as None.

    `kind` is typed as what makes C, not as ``type[C]``, for which mypy takes no protocol.
    """
    return None if lacking(backend, kind) else backend  # type: ignore[return-value]


def beyond_control(backend: object, case: Case) -> str | None:
    """Why a backend cannot follow the programme of a case: it asks for a force and travel alone is understood."""
    if not case.programme.forced:
        return None
    found = capability(backend, ForceControl)
    if found is not None and found.controls_force(case.settings):
        return None
    name = getattr(backend, "name", type(backend).__name__)
    return (
        f'programme: it is controlled by force (control = "force", to_N or asked_N). The backend {name!r} does not '
        "understand that (no controls_force, see rso.contract.ForceControl); give a programme of travel"
    )


def lacking(backend: object, kind: Callable[..., Any]) -> list[str]:
    """Names of what a protocol asks for and the backend has not; those of :class:`.Backend` are no option."""
    return [name for name in members(kind) if getattr(backend, name, None) is None]


@functools.cache
def members(kind: Callable[..., Any]) -> tuple[str, ...]:
    """Names of what a protocol asks for, in order of declaration."""
    methods = (name for name in vars(kind) if name == "__call__" or not name.startswith("_"))
    return (*vars(kind).get("__annotations__", ()), *methods)


def unfit(backend: object) -> list[str]:
    """A sentence for each capability that a backend has by name and that cannot be asked as its protocol is."""
    return [why for kind in CAPABILITIES for name in members(kind) if (why := _misfit(backend, kind, name))]


def _misfit(backend: object, kind: type, name: str) -> str:
    """Why a member does not answer a protocol as `rso` asks it; empty where it does or there is none."""
    found, asked = getattr(backend, name, None), inspect.getattr_static(kind, name)
    if found is None:
        return ""
    what = f"{name} (rso.contract.{kind.__name__})"
    if isinstance(asked, property):
        wanted, words = (str, "a text") if name == "fingerprint" else (Mapping, "a table of settings")
        return "" if isinstance(found, wanted) else f"{what} must be {words}, not {type(found).__name__}"
    names = [p for p in inspect.signature(asked).parameters if p != "self"]
    call = f"{name}({', '.join(names)})"
    if not callable(found):
        return f"{what} must be a method {call}, not {type(found).__name__}"
    try:
        own = inspect.signature(found)
    except (ValueError, TypeError):  # of compiled code nothing is known
        return ""
    try:
        own.bind(*names)
    except TypeError:
        return f"{what} is asked as {call}, but its arguments are ({', '.join(own.parameters)})"
    return ""
