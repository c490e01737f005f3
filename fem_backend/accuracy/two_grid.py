"""Two meshes of one experiment: a coarse run to start a fine one from, or to extrapolate its forces with.

Cold runs on fine meshes start from the coarse one: its solution at the asked travels, interpolated.  The way there is
then never walked on the fine mesh.  Newton converges so far that the start does not show in an answer
(`fem_backend.accuracy.warm_starts` relies on the same).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from skfem import ElementTetP2

from fem_backend import meshing
from fem_backend.remeshing.tetrahedra import N_CANDIDATE_CELLS
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import experiment, indentation
from fem_backend.simulation.assembly import AssembledModel, NotModelled, Placement
from fem_backend.simulation.controlled import COARSER_MERIDIAN_RATIO
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.indentation import Result
from fem_backend.simulation.knobs import Knobs
from fem_backend.simulation.outputs import FORCES
from fem_backend.solver.load_steps import Guess, Instant, LoadPoint, Stopped

COARSE_START_LEVELS = ("fine", "reference")  # levels whose way is dearer than a coarse run
# relative residual of the coarse run: it is a start, without multipliers as the fine run begins
COARSE_START_TOLERANCE = 1e-3
COARSE_RUN_WORDS = "the run on a coarser mesh, which gives the errors,"
UNCALIBRATED_ERRORS_WORDS = "they are several times those of a specimen whose meshes are calibrated"
GROWTH_BEYOND_WORDS = "a power of the travel"
ROUGHER_LEVEL = {
    "coarse": meshing.CRUDE_LEVEL,
    "standard": meshing.CRUDE_LEVEL,
    "fine": "coarse",
    "reference": "coarse",
}
# of the error of a force when every tetrahedron of the coarse mesh is cut into eight, h^2.25
HALVED_MESH_ERROR_SHARE = 0.21


def worthwhile(settings: Settings, knobs: Knobs) -> bool:
    """Whether a coarse run before pays: an elastic body on a fine mesh, held and without weight, specimen shipped."""
    shipped = "template" in settings.recipe
    return settings.level in COARSE_START_LEVELS and shipped and not settings.support.loose and knobs.weight == 0.0


def coarse(
    settings: Settings,
    knobs: Knobs,
    placement: Placement,
    instants: Sequence[Instant],
    slopes: Sequence[str] = (),
    control: Mapping[str, float] | None = None,
) -> tuple[AssembledModel, Result]:
    """The same experiment on the coarse mesh; `control` replaces numerical settings.  Raises NotModelled, Stopped."""
    crude = _on_coarse(settings)
    crude = replace(crude, control=replace(crude.control, **(control or {})))
    model = modelling.model_for(crude, knobs, placement, None)
    return model, indentation.simulate_indentation(crude, knobs, placement, model, instants, gradients=slopes)


def _on_coarse(settings: Settings) -> Settings:
    """The same experiment on the coarse mesh, without marks on the surface."""
    plain = experiment.plain_settings(settings)
    crude = experiment.read_settings(plain | {"profile": [], "mesh": {"level": "coarse"}, "solver": settings.solver})
    return replace(crude, large_strain=settings.large_strain)


def coarse_guess(
    settings: Settings, knobs: Knobs, placement: Placement, model: AssembledModel, instants: Sequence[Instant]
) -> Guess:
    """Start (n, 3) at a travel (mm) from a run of the same experiment on the coarse mesh; None where that has none."""
    try:
        crude, result = coarse(
            settings, knobs, placement, instants, control={"tight": COARSE_START_TOLERANCE, "augmentations": 0}
        )
        points: Sequence[LoadPoint] = result.points
    except NotModelled:
        return lambda s: None
    except Stopped as stopped:
        crude = modelling.model_for(_on_coarse(settings), knobs, placement, None)
        points = stopped.points
    return prolonged_start(crude, points, model)


def prolonged_start(crude: AssembledModel, points: Sequence[LoadPoint], model: AssembledModel) -> Guess:
    """Start (n, 3) at a travel (mm) from points on the coarse mesh, before their multipliers."""
    cells, N = located_in_coarse(crude, model.body.nodes)
    held = model.body.free.reshape(-1, 3) < 0
    states = {p.travel: p.stages[0].equilibrium.evaluation.u for p in points}

    def offer(s: float) -> list[np.ndarray] | None:
        if s not in states:
            return None
        start = np.einsum("na,nai->ni", N, states[s][cells])
        start[held] = 0.0
        return [start]

    return offer


def extrapolated_result(
    settings: Settings,
    knobs: Knobs,
    placement: Placement,
    model: AssembledModel,
    instants: Sequence[Instant],
    start: Guess | None = None,
    slopes: Sequence[str] = (),
) -> Result:
    """Result on the reference mesh with the forces, their derivatives and the reaction extrapolated:

        F = (F_h/2 − k F_h) / (1 − k)

    of the coarse mesh (h) and the same with every tetrahedron cut into eight (h/2); k = `HALVED_MESH_ERROR_SHARE`
    (Richardson 1911).  `start` may offer states.  Everything else is that of the reference mesh.  Raises NotModelled
    and Stopped, the latter without a curve so far.
    """
    try:
        crude, first = coarse(settings, knobs, placement, instants, slopes)
        if start is None and not settings.support.loose and knobs.weight == 0.0:
            start = prolonged_start(crude, first.points, model)
        second = indentation.simulate_indentation(settings, knobs, placement, model, instants, start, slopes)
    except Stopped as stopped:
        stopped.points = []
        raise

    def at_limit(name: str, fine: np.ndarray, rough: np.ndarray) -> np.ndarray:
        return (fine - HALVED_MESH_ERROR_SHARE * rough) / (1.0 - HALVED_MESH_ERROR_SHARE) if name in FORCES else fine

    return replace(
        second,
        channels={n: at_limit(n, v, first.channels.get(n, v)) for n, v in second.channels.items()},
        reaction=at_limit("Fz", second.reaction, first.reaction),
        gradients={
            knob: {n: at_limit(n, v, first.gradients[knob].get(n, v)) for n, v in row.items()}
            for knob, row in second.gradients.items()
        },
        residual=np.maximum(first.residual, second.residual),
        cpu_s=first.cpu_s + second.cpu_s,
    )


def checked_on_coarse_mesh(
    settings: Settings,
    knobs: Knobs,
    placement: Placement,
    model: AssembledModel,
    instants: Sequence[Instant],
    start: Guess | None = None,
    slopes: Sequence[str] = (),
) -> Result:
    """Result of a run beside the channels of one on a coarser mesh, which show its error.

    A meridian has elements of twice the size there, a body in space those of a level below.  Where the other ends
    early, its channels are nan from there on, and the result says so.  Raises NotModelled and Stopped, as the run
    itself does; without the other where that has no mesh or no answer at all.
    """
    result = indentation.simulate_indentation(settings, knobs, placement, model, instants, start, slopes)
    crude = _twice(settings) if placement.meridian else rougher_mesh(settings)
    try:
        other = modelling.model_for(crude, knobs, placement, None)
        first = indentation.simulate_indentation(crude, knobs, placement, other, instants)
    except NotModelled as error:
        return replace(result, unchecked=f"{COARSE_RUN_WORDS} has no mesh ({error}): {UNCALIBRATED_ERRORS_WORDS}")
    except Stopped as stopped:
        if stopped.reached is None or not stopped.points:
            return replace(
                result, unchecked=f"{COARSE_RUN_WORDS} has no answer ({stopped}): {UNCALIBRATED_ERRORS_WORDS}"
            )
        first = stopped.reached
        words = f"{COARSE_RUN_WORDS} ended early ({stopped}): errors beyond grow with {GROWTH_BEYOND_WORDS}"
        result = replace(result, unchecked=words)
    lost = len(result.travel) - len(first.travel)
    coarser = {n: np.concatenate([v, np.full(lost, np.nan)]) for n, v in first.channels.items()}
    finer = len(model.body.nodes) / len(other.body.nodes)
    return replace(result, coarser=coarser, finer=finer, cpu_s=result.cpu_s + first.cpu_s)


def _twice(settings: Settings) -> Settings:
    return replace(
        settings, fineness=COARSER_MERIDIAN_RATIO * settings.fineness, h0=COARSER_MERIDIAN_RATIO * settings.h0
    )


def rougher_mesh(settings: Settings) -> Settings:
    """The settings with a third to two thirds of the nodes in space: a level below, or a mapped mesh of ⅔ n."""
    mesh, length = dict(settings.mesh), min(settings.indenter.length, meshing.graded_for(settings.recipe))
    if settings.level not in ROUGHER_LEVEL:
        n = max(4, 2 * mesh["n"] // 3)
        made = settings.specimen.meshing(length, mesh["mesher"], "", n, mesh["slip"])
    else:
        made = settings.specimen.meshing(length, mesh.get("mesher", "tetwild"), ROUGHER_LEVEL[settings.level], 0, 0.0)
    return replace(settings, recipe=made.recipe, mesh=made.used, h0=made.h0, level=made.level, fineness=made.fineness)


def located_in_coarse(coarse: AssembledModel, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (p, 10) and shape functions (p, 10) of the coarse cell that each of `points` (p, 3) mm lies in.

    Cells are taken as straight-sided; a point outside of all is moved into the nearest.
    """
    corner = coarse.body.nodes[coarse.body.cells[:, :4]]
    inverse = np.linalg.inv(np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2))
    _, near = cKDTree(corner.mean(1)).query(points, min(N_CANDIDATE_CELLS, len(corner)))
    x = np.einsum("pkij,pkj->pki", inverse[near], points[:, None] - corner[near, 0])
    b = np.concatenate([1.0 - x.sum(-1, keepdims=True), x], axis=-1)
    best = b.min(-1).argmax(1)
    rows = np.arange(len(points))
    b = np.maximum(b[rows, best], 0.0)
    b /= b.sum(1, keepdims=True)
    N = np.stack([ElementTetP2().lbasis(b[:, 1:].T, a)[0] for a in range(10)], axis=1)
    return coarse.body.cells[near[rows, best]], N
