"""The finite element model of `indentation` as a backend of `rso.contract`."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import json
import platform
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from fem_backend import closed_forms, members, meshing
from fem_backend.accuracy import admissible_depth, two_grid, warm_starts
from fem_backend.accuracy.calibration import calibration, uncalibrated
from fem_backend.accuracy.error_estimate import at_depth, stated_errors
from fem_backend.adapter import (
    cost_model,
    deformed,
    derived,
    model_hierarchy,
    new_study,
    priors,
    programmes,
    stated_sizes,
)
from fem_backend.adapter import formulas as literature
from fem_backend.adapter import sketch as sketches
from fem_backend.export import files as export_files
from fem_backend.indenters import INDENTERS
from fem_backend.laws import LAWS
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import contact_elements, controlled, derivatives, experiment, indentation, outputs
from fem_backend.simulation.assembly import MISALIGNMENT_KNOBS, AssembledModel, NotModelled, Placement
from fem_backend.simulation.experiment import Settings, on_axis
from fem_backend.simulation.indentation import Result
from fem_backend.simulation.initial_state import InitialState
from fem_backend.simulation.knobs import SWITCHES, Knobs
from fem_backend.simulation.knobs import knobs_class as every
from fem_backend.simulation.outputs import CHANNEL_UNITS
from fem_backend.solver import direct
from fem_backend.solver.load_steps import Instant, LoadPoint, Stopped
from fem_backend.solver.newton import System
from fem_backend.specimens import SPECIMENS, own_laws
from fem_backend.supports import SUPPORTS
from rso.contract import (
    Case,
    DeformedBody,
    DerivedQuantity,
    FormulaCurve,
    Given,
    Line,
    Option,
    Parameter,
    Programme,
    Response,
    SimulationFailed,
    Sketch,
    drop_neutral,
    parameters_of,
)

NUMERICS = 5  # raised when, and only when, answers change
SAME_TRAVEL_TOLERANCE = 1e-12  # of the deepest travel: an asked one this near a corner's is that
MOMENT_ULPS = 8  # of a moment: what interpolating it may lose
LEVELS_BY_COST = ("coarse", "standard", "fine", "reference")  # levels from cheap to dear
THICKNESS_ROUND_OFF = 1e-12  # of the thickness: sums of layers and sizes are a little off
DOWN = np.array([0.0, 0.0, -1.0])  # way of an indenter that is not along the normal

RESTATED_TRAVEL_RATIO = 1.5  # lengths of the indenter: errors deeper than this were stated anew once, see `mended`
MODULI = ("mu", "D1")  # knobs that move neither a body nor what touches it
GRAM_PER_CM3 = 9.81e-6  # N/mm³, the specific weight of 1 g/cm³


@dataclasses.dataclass(frozen=True)
class Solved:
    """A run with everything that led to it."""

    settings: Settings
    knobs: Knobs
    placement: Placement
    model: AssembledModel
    result: Result

    @property
    def system(self) -> System:
        """What was solved."""
        assert self.result.system is not None  # of a run that was solved here
        return self.result.system

    def on(self, point: LoadPoint) -> InitialState:
        """What a point was solved with: its mesh may have been remade on the way."""
        return next(on for p, on in zip(self.result.points, self.result.on, strict=True) if p is point)


@dataclasses.dataclass(frozen=True)
class FiniteElements:
    """Indentation of a soft specimen: Backend of `rso.contract`, picklable and stateless."""

    name: str = "fem_backend"
    numerics: int = NUMERICS

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every knob of :class:`fem_backend.simulation.knobs.Knobs`."""
        return parameters_of(every())

    @property
    def channels(self) -> Mapping[str, str]:
        """Name → unit of every channel."""
        return CHANNEL_UNITS

    @property
    def lean(self) -> Mapping[str, Any]:
        """Settings that leave out what a run costs beyond forces right to 0.2 %: derivatives, exact contact."""
        return {"derivatives": False, "multipliers": False}

    @property
    def draft(self) -> Mapping[str, Any]:
        """Settings for many cheap runs whose differences count."""
        return {"mesh": {"level": "coarse"}, **self.lean}

    def nominal(self, settings: Mapping[str, Any]) -> Mapping[str, float]:
        """Knobs that the settings set."""
        return dict(experiment.read_settings(settings).defaults)

    def plausible(
        self, settings: Mapping[str, Any], given: Collection[str] = ()
    ) -> Mapping[str, tuple[float, float] | None]:
        """Knob → its plausible range where the usual one does not suit these settings, None where none does.

        `given` are knobs that have a value.
        """
        return priors.plausible(experiment.read_settings(settings), given, {p.name: p for p in self.parameters})

    def tests(self, settings: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
        """Further tests of the same specimen, in words, and the settings that they replace."""
        return priors.tests(experiment.read_settings(settings))

    def marks(self, settings: Mapping[str, Any]) -> Mapping[str, list[list[float]]]:
        """Surface marks that a camera could follow during a test, in words, and their places (x, y) in mm."""
        return priors.camera_marks(experiment.read_settings(settings))

    def derived(self, settings: Mapping[str, Any], given: Collection[str]) -> Sequence[DerivedQuantity]:
        """E, ν, K and long-term moduli; see :mod:`fem_backend.adapter.derived`."""
        return derived.derived(given)

    def prevented(self) -> Mapping[str, tuple[str, ...]]:
        """The same tests again with something kept from acting, in words, and its knobs."""
        return priors.PREVENTED_EFFECTS

    def deep(self, settings: Mapping[str, Any]) -> float:
        """Travel (mm) by which elements under the indenter are so distorted that programs part company."""
        return priors.DISTORTED_TRAVEL_RATIO * experiment.read_settings(settings).indenter.length

    def uncalibrated(self, settings: Mapping[str, Any], given: Collection[str] = ()) -> str | None:
        """What to know of the errors that runs with these settings state; None where they are calibrated.

        `given` are knobs that have a value.
        """
        return uncalibrated(experiment.read_settings(settings), "adhesion" in given)

    def odd_sizes(self, settings: Mapping[str, Any], depth: float, notes: Sequence[str]) -> Sequence[str]:
        """Sizes that are not stated, and what does not fit between sizes, deepest reading (mm) and notes of a file."""
        doubts = stated_sizes.doubts_of_radius(experiment.read_settings(settings), depth, notes)
        return [*stated_sizes.unstated_sizes(settings), *doubts]

    def gauges(self, settings: Mapping[str, Any]) -> Mapping[str, tuple[str, float]]:
        """Knob → a measurement that shows it without indentation, and its standard uncertainty in the knob's unit."""
        return priors.gauges(experiment.read_settings(settings))

    def dimensions(self, settings: Mapping[str, Any]) -> Mapping[str, float]:
        """Knob → the stated size that it is an error of, in the knob's unit; 1 of what is a share."""
        return priors.dimensions(experiment.read_settings(settings))

    def setting_unit(self, settings: Mapping[str, Any], keys: Sequence[str]) -> str | None:
        """The unit that numbers of a setting are in, "1" of a pure number; None for what is no number or no setting."""
        return experiment.unit_of_setting(keys)

    def variants(self, settings: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
        """Other supports than that of the settings: what replaces them and the group of knobs that belongs to it."""
        return priors.variants(experiment.read_settings(settings))

    def levels(self, settings: Mapping[str, Any]) -> tuple[tuple[Mapping[str, Any], ...], ...]:
        """Models from simple to rich, alternatives side by side: :func:`.model_hierarchy.levels`."""
        return model_hierarchy.model_levels(settings)

    def closed_form(self, values: Mapping[str, float], case: Case) -> Response:
        """The indenter's closed form of the case, for no cost; see :func:`.model_hierarchy.closed_form`."""
        self.check(case)
        settings = experiment.read_settings(case.settings)
        return model_hierarchy.closed_form(settings, self.knobs(values, settings), case.programme)

    def formulas(self, values: Mapping[str, float], case: Case) -> tuple[FormulaCurve, ...]:
        """Closed forms of the literature at the asked travels: :func:`fem_backend.adapter.formulas.formula_forces`."""
        settings = experiment.read_settings(case.settings)
        programme = case.programme
        asked = np.array(programme.asked_mm)
        if not programme.segments and programme.asked_s:  # moments of a way back
            asked = np.unique([*asked, *np.interp(programme.asked_s, programme.time_s, programme.travel_mm)])
        return literature.formula_forces(settings, self.knobs(values, settings), asked)

    def start(self, case: Case, travel: np.ndarray, force: np.ndarray) -> Mapping[str, tuple[float, float, float]]:
        """(low, value, high) of mu and D1 by Hertz, before any simulation: :func:`.model_hierarchy.start`."""
        return model_hierarchy.start(experiment.read_settings(case.settings), travel, force)

    def cost(self, values: Mapping[str, float], case: Case) -> float:
        """Seconds that a run takes, roughly; see :func:`fem_backend.adapter.cost_model.estimated_seconds`."""
        settings = experiment.read_settings(case.settings)
        used = vars(self.knobs(values, settings))
        placement = _placement(settings, _geometric(used), every())
        return cost_model.estimated_seconds(settings, placement, path_dependent(settings, values))

    def check(self, case: Case) -> None:
        """Raise ValueError for settings or programmes that are not modelled, and for artefacts that have no hash."""
        for name, sha in case.artefacts.items():
            if not isinstance(sha, str):
                raise ValueError(f"case.artefacts.{name} = {sha!r}: the SHA-256 of the artefact, a text, is expected")
        if case.programme.still:
            raise ValueError("programme: nothing is moved; time_s and travel_mm, or segments, are expected")
        settings = experiment.read_settings(case.settings)
        through = _through(settings)
        if programmes.controlled(case.programme):
            programmes.check_programme(case.programme, settings, through)
        if case.programme.segments:
            return
        for name, far in (("travel_mm", max(case.programme.travel_mm)), ("earlier", settings.earlier)):
            if far >= through * (1.0 - THICKNESS_ROUND_OFF):
                raise ValueError(
                    f"{name}: travel {far:g} mm: less than {through:g} mm is expected, as far as "
                    f"{settings.specimen.described} reaches; are the units of depth and specimen right?"
                )
        if case.programme.travel_mm[0] > 0.0:
            raise ValueError(
                f"programme: travel_mm starts at 0 (first contact) or above the specimen, where it is negative, not at "
                f"{case.programme.travel_mm[0]:g} mm"
            )

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Defaults written out, what has no influence dropped: effects at neutral, times and returns if elastic."""
        try:
            text = json.dumps(case.settings, sort_keys=True)
        except (TypeError, ValueError):  # not plain data: whoever reads it says what is wrong
            return self._canonical(values, case)
        given = tuple((k, type(v), v) for k, v in values.items())
        stamps = members.stamps_of(text, case.settings)
        kept, plain, programme = _canonical_again(
            self, given, text, case.programme, stamps, experiment.settings_model()
        )
        own = {k: dict(v) if isinstance(v, dict) else v for k, v in plain.items()}
        return dict(kept), dataclasses.replace(case, settings=own, programme=programme)

    def _canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        settings = experiment.read_settings(case.settings)
        known, own = {p.name: p for p in self.parameters}, {**priors.usual(settings), **dict(settings.defaults)}
        kept = {k: known[k].check(v) if k in known else v for k, v in {**own, **values}.items()}
        absent_here = settings.specimen.absent() | settings.support.absent(settings.specimen)
        for kind, present in (
            (SPECIMENS, settings.specimen),
            (INDENTERS, settings.indenter),
            (SUPPORTS, settings.support),
        ):
            absent = kind.of_others(present.name) | absent_here
            kept = {k: v for k, v in kept.items() if k not in absent}
        for group, switches in SWITCHES.items():
            if any(kept.get(name, known[name].default) == off for name, off in switches.items()):
                kept = {k: v for k, v in kept.items() if k not in known or known[k].group != group}
        kept = drop_neutral(self.parameters, kept)
        plain = experiment.plain_settings(settings)
        if settings.specimen.alike and not settings.profile:
            plain["point"], settings = [0.0, 0.0], dataclasses.replace(settings, point=(0.0, 0.0))
        if settings.direction == "normal" and settings.point == (0.0, 0.0):
            plain["direction"] = "vertical"
        if "mullins" not in kept:
            plain["earlier"], settings = 0.0, dataclasses.replace(settings, earlier=0.0)
        if "permeability" not in kept:
            plain.pop("drainage", None)
        programme, by_force = case.programme, programmes.controlled(case.programme)
        if path_dependent(settings, kept) and _may_turn(settings, kept):
            plain["support"]["rolling"] = experiment.MARKS["rolling"]
        if any(kept.get(name) for name in MISALIGNMENT_KNOBS):
            plain["mesh"]["follows"] = experiment.MARKS["follows"]
        if by_force:  # contact is exact there, and no derivative is made
            plain.pop("multipliers", None)
            plain["derivatives"] = False
        some = not by_force and settings.multipliers and not path_dependent(settings, kept) and not kept.get("weight")
        if some and not settings.derivatives:
            plain["derivatives"] = False
        if programme.time_s and programme.time_s[0] != 0.0:  # one test has one key, whenever it began
            programme = _from_zero(programme)
        given = programme
        if not by_force and not path_dependent(settings, kept):
            held = np.interp(programme.asked_s, programme.time_s, programme.travel_mm)
            asked = sorted(v for v in {*programme.asked_mm, *(float(v) for v in held)} if v > 0.0)
            programme = Programme.ramp(tuple(asked or [max(programme.travel_mm)]), 1.0)
        if _read(dataclasses.replace(case, programme=programme), kept).large_strain and not _placed(
            settings, kept, lambda at: at.meridian
        ):
            plain["mesh"]["large_strain"] = experiment.MARKS["large_strain"]
        if revision := mended(settings, kept, given, programme):
            plain["specimen"]["mended"] = revision
        return kept, dataclasses.replace(case, settings=plain, programme=programme)

    def refused(self, values: Mapping[str, float], case: Case) -> str | None:
        """Why a simulation with these values has no answer to its depth; None where nothing speaks against it."""
        settings = dataclasses.replace(_read(case, values), large_strain=False)
        try:
            knobs, deepest = self.knobs(values, settings), max(case.programme.travel_mm, default=0.0)
            placement = modelling.placement_of(settings, knobs)
            settings = contact_elements.resolved(settings, knobs, deepest) if placement.meridian else settings
            modelling.admit(settings, knobs, placement)
            end = admissible_depth.inadmissible(settings, knobs, deepest)
        except ValueError as error:  # NotModelled, too
            return str(error)
        return end.why if end is not None else admissible_depth.small_strains(settings, knobs, deepest)

    def relaxes(self, values: Mapping[str, float], settings: Mapping[str, Any]) -> bool:
        """Whether forces go on changing while the indenter rests: a Prony term is there, or liquid that flows."""
        shares = (values.get(name, 0.0) for name in ("prony_g", "prony_g2", "prony_g3", "permeability"))
        return any(shares) or bool(experiment.read_settings(settings).prony)

    def ordinary(self) -> Mapping[str, str]:
        """Conditions between knobs that ordinary materials respect, and what they say: K/μ ≥ 2/3 with K = 2/D₁."""
        return {"mu * D1 <= 3": "a Poisson ratio of at least 0"}

    def physical(self) -> Mapping[str, tuple[float, float]]:
        """Knob → bounds that no ordinary material leaves, whatever its modulus: densities from 0.5 to 8 g/cm³."""
        return {"weight": (0.5 * GRAM_PER_CM3, 8.0 * GRAM_PER_CM3)}

    def jkr(self, settings: Mapping[str, Any], depth: np.ndarray, force: np.ndarray) -> Mapping[str, float]:
        """Modulus (MPa), work of adhesion (N/mm) and contact (mm) by knob of Fz (n,) N at depths (n,) mm that pulls."""
        return model_hierarchy.jkr_start(experiment.read_settings(settings), depth, force)

    def resolution(self, settings: Mapping[str, Any], depth: float, given: Collection[str] = ()) -> Mapping[str, float]:
        """Level of the mesh, that of the settings first, and the share of the force that it misses at a depth (mm).

        Empty with adhesion among the knobs `given` on a meridian: elements then resolve its range, whatever the level.
        """
        own = experiment.read_settings(settings)
        if "adhesion" in given and on_axis(own):
            return {}
        if not own.level:
            return {"mapped": at_depth(own, depth, "adhesion" in given)}
        names = [own.level, *(name for name in LEVELS_BY_COST if name != own.level)]
        each = {n: experiment.read_settings({**settings, "mesh": {"level": n}}) for n in names}
        return {name: at_depth(one, depth, "adhesion" in given) for name, one in each.items()}

    def reduction(self, values: Mapping[str, float], case: Case) -> str | None:
        """How much of a specimen of revolution is modelled with these values, in words; None of another specimen."""
        settings = experiment.read_settings(case.settings)
        try:
            placed = modelling.placement_of(settings, self.knobs(values, settings))
        except ValueError:  # NotModelled, too: the run itself will say why
            return None
        if placed.meridian:
            return "of revolution: solved on its meridian"
        part = ("all", "half", "a quarter")[sum(placed.planes)]
        whole = settings.specimen.of_revolution
        return f"the specimen is of revolution, its test is not: {part} of it is solved in space" if whole else None

    def hertz(self, settings: Mapping[str, Any], depth: np.ndarray, force: np.ndarray) -> Mapping[str, float]:
        """The modulus (MPa) by knob of Fz (n,) N at depths (n,) mm by the indenter's closed form, incompressible."""
        mu = model_hierarchy.hertz(experiment.read_settings(settings), depth, force)
        return {} if mu is None else {"mu": mu}

    def exponents(self, settings: Mapping[str, Any]) -> tuple[float, ...]:
        """Exponents of force over small depths, the leading one first, as the indenter of these settings has them."""
        return experiment.read_settings(settings).indenter.exponents

    def sketch(self, settings: Mapping[str, Any], depth: float) -> Sketch:
        """The experiment of these settings, pressed to a depth (mm), in a sentence and as a section."""
        return sketches.sketch(experiment.read_settings(settings), depth)

    def deformed(self, values: Mapping[str, float], case: Case) -> DeformedBody:
        """Sections through the deformed body and its surface; see :mod:`fem_backend.adapter.deformed`."""
        solved = self.solve(values, case)
        result = solved.result
        return deformed.deformed(solved.placement, result.points, result.on, result.Fz)

    def exports(self) -> Mapping[str, str]:
        """Input files of other programs and material cards."""
        return export_files.EXPORT_FORMATS

    def exported(self, kind: str, values: Mapping[str, float], case: Case, remarks: Sequence[str]) -> Mapping[str, str]:
        """File → text; ValueError for what a format cannot say."""
        self.check(case)
        if programmes.controlled(case.programme):
            raise ValueError("a programme that a force controls is not written for other programs")
        settings = dataclasses.replace(_read(case, values), large_strain=False)
        path = case.artefact("mesh")
        mesh = None if path is None else str(path)
        try:
            return export_files.exported(kind, settings, self.knobs(values, settings), case.programme, mesh, remarks)
        except NotModelled as error:
            raise ValueError(str(error)) from error

    def options(self) -> Sequence[Option]:
        """Options of `rso new`, those that members of the open sets declare."""
        return new_study.options()

    def first_settings(self, given: Given, depths: Sequence[float]) -> Mapping[str, Line]:
        """Settings of a new study by the options of the command line, for tests whose deepest readings are `depths`."""
        lines = new_study.geometry(given, depths)
        coarse = {**{k: line.value for k, line in lines.items()}, "mesh": {"level": "coarse"}}
        return {**lines, "mesh": new_study.mesh(depths, lambda d: self.resolution(coarse, d))}

    def first_parameters(self, settings: Mapping[str, Any], depth: np.ndarray, force: np.ndarray) -> Mapping[str, Line]:
        """Ranges of a new study by a loading Fz (n,) N at depths (n,) mm; see :mod:`fem_backend.adapter.new_study`."""
        own = experiment.read_settings(settings)
        if literature.thickness(own) is None:
            return new_study.suggested_ranges(
                depth, force, lambda u, F: self.hertz(settings, u, F), self._jkr(settings)
            )
        first = literature.shear_modulus(own, depth, force) if len(depth) else None
        plate = literature.of_uniform_compression(own, depth, force) if len(depth) else None
        name = first[0] if first else new_study.HERTZ_LIMIT if plate is None else new_study.UNIFORM_LIMIT

        def layer(u: np.ndarray, F: np.ndarray) -> Mapping[str, float]:
            found, uniform = literature.shear_modulus(own, u, F), literature.of_uniform_compression(own, u, F)
            if found is None and uniform is not None:
                return {"mu": uniform}
            return self.hertz(settings, u, F) if found is None else {"mu": found[1]}

        walled = literature.wall_nearby(own) is not None
        return new_study.suggested_ranges(depth, force, layer, self._jkr(settings), name, walled)

    def _jkr(self, settings: Mapping[str, Any]) -> new_study.Limit:
        return lambda u, F: self.jkr(settings, u, F)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """The mesh of the experiment and, for a body without memory, an anchor: states to start from."""
        settings = _read(case, values)
        knobs = self.knobs(values, settings)
        if _of_revolution(settings, knobs):
            return {}  # a grid of the meridian is made in no time
        out = {"mesh": settings.recipe}
        # an anchor's state lies beside a ball that is off its nominal place: it would cost more than it saves
        moved = any(getattr(knobs, name) for name in MISALIGNMENT_KNOBS)
        by_force = programmes.controlled(case.programme)
        if not moved and not by_force and not path_dependent(settings, dataclasses.asdict(knobs)):
            try:
                out["anchor"] = warm_starts.anchor_recipe(settings, knobs, case.programme.asked_mm)
            except NotModelled:
                pass  # the run itself will say why
        return out

    def make(self, recipe: str) -> bytes:
        """A mesh or an anchor from its recipe; raises SimulationFailed (bad_geometry) if there is none."""
        try:
            return (
                warm_starts.make_anchor(recipe) if warm_starts.is_anchor(recipe) else meshing.cached(recipe).to_bytes()
            )
        except meshing.BadMesh as error:
            raise SimulationFailed("bad_geometry", f"no mesh: {error}") from error

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Channels at every passage of an asked travel, or SimulationFailed with the curve so far."""
        return self.response(self.solve(values, case))

    def response(self, solved: Solved) -> Response:
        """What of a run goes through the seam."""
        return _response(solved.result, solved.model, solved.settings, solved.knobs)

    def solve(self, values: Mapping[str, float], case: Case) -> Solved:
        """As a call, but with the states themselves, for files and pictures."""
        self.check(case)
        settings = _read(case, values)
        knobs = self.knobs(values, settings)
        path, anchor = case.artefact("mesh"), case.artefact("anchor")
        if programmes.controlled(case.programme):
            return self._by_force(case, settings, knobs, None if path is None else str(path))
        try:
            placement = modelling.placement_of(settings, knobs)
            if placement.meridian:
                settings = contact_elements.resolved(settings, knobs, max(case.programme.travel_mm))
            settings = dataclasses.replace(settings, large_strain=settings.large_strain and not placement.meridian)
            instants, slopes = passages(case.programme), differentiable(settings, knobs)
            instants, end = _before(
                instants, admissible_depth.inadmissible(settings, knobs, max(case.programme.travel_mm))
            )
            model = modelling.model_for(settings, knobs, placement, None if path is None else str(path))
            guess, started = None, time.process_time()
            if anchor is not None:
                guess = warm_starts.anchor_guess(
                    str(anchor), model, closed_forms.poisson_ratio(knobs.mu, 2.0 / knobs.D1)
                )
            elastic = not path_dependent(settings, dataclasses.asdict(knobs))
            if guess is None and elastic and not placement.meridian and two_grid.worthwhile(settings, knobs):
                guess = two_grid.coarse_guess(settings, knobs, placement, model, instants)
            before = time.process_time() - started
            how = (
                two_grid.extrapolated_result
                if settings.level == meshing.LIMIT_LEVEL
                else indentation.simulate_indentation
            )
            how = two_grid.checked_on_coarse_mesh if placement.meridian or settings.large_strain else how
            result = how(settings, knobs, placement, model, instants, guess, slopes)
            result = _begun(dataclasses.replace(result, cpu_s=result.cpu_s + before), case.programme)
            if (lost := indentation.doubtful(result)) is not None:
                failed = _ended(lost, result, model, settings, knobs)
            elif end is not None:
                failed = SimulationFailed("inadmissible", end.why, _response(result, model, settings, knobs))
            else:
                return Solved(settings, knobs, placement, model, result)
        except NotModelled as error:
            failed = SimulationFailed(error.cause, str(error))
        except contact_elements.Unresolved as error:
            failed = SimulationFailed("not_supported", str(error))
        except Stopped as stopped:
            partial, reached = None, stopped.reached
            if stopped.points:
                reached = _begun(reached, case.programme)
                partial = _response(reached, model, settings, knobs)
            history = tuple({"iteration": k, "residual": r} for k, r in enumerate(stopped.history))
            failed = SimulationFailed(stopped.cause, str(stopped), partial, history)
            if stopped.points and (lost := indentation.doubtful(reached)) is not None:
                failed = _ended(lost, reached, model, settings, knobs)
        raise failed  # not from the other: that holds states and factors, which cannot travel between processes

    def _by_force(self, case: Case, settings: Settings, knobs: Knobs, mesh: str | None) -> Solved:
        """As `solve`, of a programme that a force controls."""
        settings = experiment.with_multipliers(settings)
        try:
            placement = modelling.placement_of(settings, knobs)
            deepest = _through(settings) * (1.0 - THICKNESS_ROUND_OFF)
            why = f"{settings.specimen.described} reaches no farther along the way of the indenter"
            end = admissible_depth.inadmissible(settings, knobs, deepest)
            limit = (deepest, why) if end is None else min((deepest, why), (end.depth, end.why))
            drive = programmes.driven(case.programme, *limit)
            if placement.meridian:
                settings = contact_elements.for_force(
                    settings, dataclasses.asdict(knobs), *programmes.goals(case.programme)
                )
            model = modelling.model_for(settings, knobs, placement, mesh)
            result = _begun(controlled.checked_programme(settings, knobs, placement, model, drive), case.programme)
            if (lost := indentation.doubtful(result)) is None:
                return Solved(settings, knobs, placement, model, result)
            failed = _ended(lost, result, model, settings, knobs)
        except NotModelled as error:
            failed = SimulationFailed(error.cause, str(error))
        except Stopped as stopped:
            reached = _begun(stopped.reached, case.programme) if stopped.points else None
            partial = None if reached is None else _response(reached, model, settings, knobs)
            history = tuple({"iteration": k, "residual": r} for k, r in enumerate(stopped.history))
            failed = SimulationFailed(stopped.cause, str(stopped), partial, history)
        raise failed  # not from the other, as in `solve`

    def controls_force(self, settings: Mapping[str, Any]) -> bool:
        """Force controls programmes with any settings."""
        return True

    def knobs(self, values: Mapping[str, float], settings: Settings) -> Knobs:
        """Values with the defaults of knobs and settings; ValueError for unknown, missing or unbounded ones.

        With pore flow `D1` is that of the drained body, whichever of the two the values name.
        """
        known = {p.name: p for p in self.parameters}
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise ValueError(f"unknown parameter {unknown[0]!r}; choose from {', '.join(known)}")
        own = {**priors.usual(settings), **dict(settings.defaults)}
        given = {**{n: p.default for n, p in known.items()}, **own, **values}
        missing = sorted(n for n, v in given.items() if v is None)
        if missing:
            raise ValueError(f"parameter {missing[0]!r} ({known[missing[0]].unit}) has no value")
        checked = {n: known[n].check(v) for n, v in given.items() if v is not None}
        if checked["permeability"]:
            checked["D1"] += checked["pore_D1"]
        return every()(**checked)


BACKEND = FiniteElements()


@functools.lru_cache(maxsize=4096)
def _canonical_again(
    backend: FiniteElements,
    values: tuple[tuple[str, type, float], ...],
    text: str,
    programme: Programme,
    stamps: tuple[tuple[str, int, int], ...],
    table: type,
) -> tuple[dict[str, float], Mapping[str, Any], Programme]:
    """A study asks for the same run many times: what it costs, whether it is stored, which others are the same."""
    kept, case = backend._canonical({k: v for k, _, v in values}, Case("", programme, json.loads(text)))
    return kept, case.settings, case.programme


def _ended(
    end: tuple[int, str, str], result: Result, model: AssembledModel, settings: Settings, knobs: Knobs
) -> SimulationFailed:
    """The end of a run that went on into what is no answer, with the curve before."""
    k, cause, why = end
    return SimulationFailed(cause, why, _response(result.upto(k), model, settings, knobs) if k else None)


def _before(
    instants: list[Instant], end: admissible_depth.LawEnd | None
) -> tuple[list[Instant], admissible_depth.LawEnd | None]:
    """The instants before a law ends, and its end; NotModelled where no answer is asked for before it."""
    if end is None:
        return instants, None
    left = list(itertools.takewhile(lambda i: i.travel < end.depth, instants))
    if not any(i.asked for i in left):
        raise NotModelled("inadmissible", end.why)
    return left, end


def path_dependent(settings: Settings, values: Mapping[str, float]) -> bool:
    """Whether the answer depends on times and on the way there."""
    rubbing = bool(values.get("friction") or values.get("adhesion"))
    rubbing = rubbing or settings.support.friction(values) != 0.0
    memory = any(values.get(k) for k in ("prony_g", "prony_g2", "prony_g3", "mullins")) or settings.prony
    return bool(rubbing or memory or values.get("permeability"))


def _of_revolution(settings: Settings, knobs: Knobs) -> bool:
    """Whether the meridian of a run is modelled alone."""
    try:
        return modelling.placement_of(settings, knobs).meridian
    except NotModelled:
        return False  # the run itself will say why


def mended(settings: Settings, kept: Mapping[str, float], programme: Programme, run: Programme) -> int:
    """The last change since the first answers that counts here, 0 where none does; `run` is the canonical programme.

    1: a cavity used to weigh, the peak pressure not to be the net one, a rest to be one step, and the lip of every
    bowl to be 1 mm.  2: small strains had no end, and errors below a deep ball were stated too small.  3: on a
    meridian, elements did not resolve an attraction, and contact beside it acted per undeformed area.  4: the mesh of a
    meridian was never remade.  5: new meshes were coarser, none were made with friction and under a force, and an
    outworn mesh that is kept was not in the errors (how deep a force leads is not known before); elements below a
    rounded tip were too long.  6: no later meshes were made below many edges.  7 and 8: errors were stated too small
    where contact just reaches a rounded edge.  9 and 10: elements did not follow a contact much smaller than a ball or
    a tip, on a meridian and in grids of three dimensions.  11: such grids had no errors of their own, and a penalty
    that was too soft for a stiff layer or skin.  12: such grids stated lateral forces, and peak pressures below stiff
    layers, too exactly.
    """
    if _stated_by_grids(settings, kept, run) or _stiffened_in_space(settings, kept):
        return 12
    if _small_in_space(settings, kept, run):
        return 10
    finest = np.isfinite(settings.indenter.finest[1])
    pointed = finest and contact_elements.gathers(settings.indenter)
    if on_axis(settings) and finest and not pointed:
        return 8
    if on_axis(settings) and not kept.get("adhesion") and _small(settings, kept, run):
        return 9
    if on_axis(settings) and pointed:
        return 6
    if programmes.controlled(programme):
        return 6 if on_axis(settings) else 0
    relaxes = settings.prony or any(kept.get(k) for k in ("prony_g", "prony_g2", "prony_g3"))
    rests = any(a == b for a, b in itertools.pairwise(programme.travel_mm))
    hollow = kept.get("weight") and kept.get("cavity")
    other = settings.support.revised(settings.specimen)
    if kept.get("adhesion") and on_axis(settings):
        return 3
    if on_axis(settings) and max(programme.travel_mm, default=0.0) > experiment.watched_from(settings):
        return 6
    if (
        max(programme.travel_mm) > RESTATED_TRAVEL_RATIO * settings.indenter.length
        or LAWS.members[settings.law].small_strain
    ):
        return 2
    return int(bool(hollow or kept.get("adhesion") or (relaxes and rests) or other))


def _small(settings: Settings, kept: Mapping[str, float], programme: Programme) -> bool:
    """Whether elements follow a contact that is small beside the indenter."""
    if programmes.controlled(programme):
        return contact_elements.for_force(settings, kept, *programmes.goals(programme)).fine is not None
    return contact_elements.shallow(settings, max(programme.travel_mm)).fine is not None


def _small_in_space(settings: Settings, kept: Mapping[str, float], programme: Programme) -> bool:
    """The same in space."""
    if _meshed(settings, kept, programme).recipe == settings.recipe:
        return False
    return _placed(settings, kept, lambda at: not at.meridian)


def _stated_by_grids(settings: Settings, kept: Mapping[str, float], programme: Programme) -> bool:
    """Whether errors are those of a calibration that holds in space only."""
    if not calibration(settings, bool(kept.get("adhesion"))).only_in_space:
        return False
    meshed = settings
    if not programmes.controlled(programme):
        meshed = experiment.for_travel(settings, _deepest(settings, kept, programme))
    return not meshed.large_strain and _placed(settings, kept, lambda at: not at.meridian)


def _stiffened_in_space(settings: Settings, kept: Mapping[str, float]) -> bool:
    """Whether what is touched first may be stiffer than the core, on a grid of three dimensions."""
    firm = settings.specimen.ratios or any(kept.get(n, 1.0) > 1.0 for n in ("skin_ratio", "inclusion_ratio"))
    return bool(firm) and meshing.is_grid(settings.recipe) and _placed(settings, kept, lambda at: not at.meridian)


def _from_zero(programme: Programme) -> Programme:
    """The programme with the times since its start."""
    times, moments = ([v - programme.time_s[0] for v in given] for given in (programme.time_s, programme.asked_s))
    return dataclasses.replace(programme, time_s=tuple(times), asked_s=tuple(dict.fromkeys(moments)))


def _may_turn(settings: Settings, kept: Mapping[str, float]) -> bool:
    """Whether a body is loose on its support and not both planes are planes of symmetry."""
    return settings.support.loose and _placed(settings, kept, lambda at: not all(at.planes))


def _placed(settings: Settings, kept: Mapping[str, float], asked: Callable[[Placement], bool]) -> bool:
    """What is asked of the placement of a run with these values; False where there is none."""
    placement = _placement(settings, _geometric(kept), every())
    return placement is not None and asked(placement)


def _geometric(values: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """The values that may move a body or what touches it: no moduli, and none at its default."""
    default = _defaults(every())
    return tuple(sorted((k, v) for k, v in values.items() if k not in MODULI and v != default.get(k)))


@functools.lru_cache(maxsize=4)
def _defaults(knobs: type) -> dict[str, Any]:
    return {f.name: f.default for f in dataclasses.fields(knobs)}


@functools.lru_cache(maxsize=1024)
def _placement(settings: Settings, kept: tuple[tuple[str, float], ...], knobs: type) -> Placement | None:
    """The placement with these values, None where there is none: a study asks for a few, thousands of times.

    Where a body lies and what touches it hangs on no modulus.
    """
    known = _defaults(knobs)
    try:
        return modelling.placement_of(
            settings, knobs(**dict.fromkeys(MODULI, 1.0), **{k: v for k, v in kept if k in known})
        )
    except NotModelled:
        return None  # the run itself will say why


def _read(case: Case, values: Mapping[str, float]) -> Settings:
    """The settings of a case, with mesh and element for its deepest travel, or for where force leads by Hertz."""
    settings = _meshed(experiment.read_settings(case.settings), values, case.programme)
    if programmes.controlled(case.programme):
        return settings
    return experiment.for_travel(settings, _deepest(settings, values, case.programme))


def _meshed(settings: Settings, values: Mapping[str, float], programme: Programme) -> Settings:
    """The settings with a grid in space for the contact of a programme; what sticks is wider than that."""
    if programmes.controlled(programme):
        return contact_elements.for_force_in_space(settings, values, *programmes.goals(programme))
    if values.get("adhesion"):
        return settings
    return contact_elements.shallow_in_space(settings, _deepest(settings, values, programme))


def _deepest(settings: Settings, values: Mapping[str, float], programme: Programme) -> float:
    """The deepest travel (mm); what went before the test counts for a body that remembers it."""
    return max(*programme.travel_mm, settings.earlier if values.get("mullins") else 0.0)


def _through(settings: Settings) -> float:
    """How far (mm) the specimen reaches along the way of the indenter, where no travel can go."""
    way = -settings.specimen.above(*settings.point)[1] if settings.direction == "normal" else DOWN
    return settings.specimen.thickness_along(way)


def _begun(result: Result, programme: Programme) -> Result:
    """The result of a programme that began with its first moment, not at 0 s."""
    channels, began = dict(result.channels), programme.time_s[0] if programme.time_s else 0.0
    return dataclasses.replace(result, channels=channels | {"time": channels["time"] + began})


def passages(programme: Programme) -> list[Instant]:
    """Every asked moment and every corner of a programme after its start, in order of the time since then.

    An asked travel within round-off of a corner's is that travel, and a moment that of the corner; one beyond the
    deepest, which a programme allows, is the deepest, and none is taken for 0.  The start is among them, and not asked
    for, where the indenter is above the specimen then.
    """
    t, s = np.array(programme.time_s) - programme.time_s[0], np.array(programme.travel_mm)
    found = {float(a): float(b) for a, b in zip(t[1:], s[1:], strict=True)}
    asked: dict[float, float] = {}
    near_by = SAME_TRAVEL_TOLERANCE * float(np.abs(s).max())

    def add(moment: float, travel: float, rest: bool) -> None:
        """Two instants in one place would be none; on a steep ramp what is near in time is not near in travel."""
        corner = float(t[1:][np.argmin(np.abs(t[1:] - moment))])
        near = abs(corner - moment) <= MOMENT_ULPS * np.spacing(abs(programme.time_s[0]) + moment)
        near = near and abs(found[corner] - travel) <= near_by and (rest or found[corner] != 0.0)
        asked[corner if near else moment] = found[corner] if near else travel

    below = np.clip(programme.asked_mm, min(float(s.min()), 0.0), s.max())
    travels = [s[np.argmin(np.abs(s - a))] for a in below]
    travels = [float(c if c != 0.0 and abs(c - a) <= near_by else a) for c, a in zip(travels, below, strict=True)]
    for k in range(len(t) - 1):
        for a in travels:
            low, high = sorted((s[k], s[k + 1]))
            if low < a <= high if s[k + 1] > s[k] else low <= a < high:
                add(float(t[k] + (t[k + 1] - t[k]) * (a - s[k]) / (s[k + 1] - s[k])), float(a), False)
    for moment in programme.asked_s:
        since = float(moment - programme.time_s[0])
        add(since, float(np.interp(since, t, s)), True)
    beside = [Instant(0.0, float(s[0]), False)] if s[0] < 0.0 else []
    return beside + [Instant(at, {**found, **asked}[at], at in asked) for at in sorted({**found, **asked})]


def differentiable(settings: Settings, knobs: Knobs) -> tuple[str, ...]:
    """Material knobs that are in use, smooth and differentiated; none where the way or the sag would enter too.

    None without multipliers either: what the penalty lacks depends on the material, 1 to 6 % of a derivative by D1.
    """
    way = path_dependent(settings, dataclasses.asdict(knobs))
    if not settings.derivatives or not settings.multipliers or way or knobs.weight:
        return ()
    neutral = {p.name: p.neutral for p in BACKEND.parameters}
    names = [n for n in derivatives.material_knobs() if getattr(knobs, n) != neutral[n] or _always(settings, n)]
    names = [n for n in names if n not in settings.specimen.absent()]
    if "fibre" not in names or knobs.fibre_k2 == 0.0:
        names = [n for n in names if n != "fibre_k2"]
    return tuple(names)


def _always(settings: Settings, name: str) -> bool:
    """Whether a knob has its influence also at its neutral value."""
    if name in own_laws.always(settings.specimen.laws):
        return True
    return LAWS.members[settings.law].own_at_neutral and name in LAWS.own(settings.law)


def _response(result: Result, model: AssembledModel, settings: Settings, knobs: Knobs) -> Response:
    info: dict[str, Any] = {
        "cpu_s": result.cpu_s,
        **{k: v for k, v in dataclasses.asdict(result.counters).items() if k != "deadline"},
        **result.notes,
        "nodes": len(model.body.nodes),
        "dofs": model.body.pattern.size,
        "solver": direct.available() if settings.solver == "auto" else settings.solver,
        "machine": platform.machine(),
        "reaction_Fz": result.reaction[:, 2].tolist(),
    }
    if result.unchecked:
        info["errors"] = result.unchecked
    return Response(
        channels=result.channels,
        units=outputs.units(settings),
        error=controlled.errors_of_travel(stated_errors(settings, knobs, result), result),
        gradients={k: dict(v) for k, v in result.gradients.items()},
        info=info,
    )
