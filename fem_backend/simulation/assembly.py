"""From an experiment to what Newton solves: where the indenter goes, what is symmetric, what touches, what is held."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from skfem import MeshTet2

from fem_backend import laws, meshing
from fem_backend.contact.tractions import (
    Adhesion,
    ContactSurface,
    Pair,
    Touch,
    contact_points,
    contact_surface,
    quadratic_facets,
)
from fem_backend.indenters import Indenter
from fem_backend.kinematics import axisymmetric, bodies, tetrahedra
from fem_backend.kinematics.bodies import Body
from fem_backend.laws import LAWS, Material
from fem_backend.materials import zones
from fem_backend.materials.regions import Regions, Substance
from fem_backend.meshing import MeridianMesh, Mesh
from fem_backend.simulation import contact_elements, symmetry
from fem_backend.simulation.experiment import Settings, element_size
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver import condensation, direct, krylov
from fem_backend.solver.condensation import Condense
from fem_backend.solver.load_steps import Control
from fem_backend.solver.newton import Load, System
from fem_backend.specimens import Specimen, own_laws
from fem_backend.specimens.specimen import GradedInAdvance
from fem_backend.supports import SUPPORTS

# ε L/μ, L the length of the indenter: the multipliers remove its error, so it only steers convergence
BODY_PENALTY_RATIO = 900.0
MERIDIAN_PENALTY_RATIO = 100.0  # the same of a meridian, over μ/h
# that of friction and adhesion, which act per undeformed area, and of pore flow: see `penalty`
FIRM_PENALTY_RATIO = 3000.0
# elements of h₀ resolve attraction of a range h₀ over this; below, its force has the wrong sign
MAX_ELEMENT_TO_RANGE_RATIO = 30.0
DEEP_PENALTY_RISE, DEEP_PENALTY_WIDTH_RATIO = 10.0, 0.7  # of the penalty under a deep indenter; width in its length
MISALIGNMENT_KNOBS = ("offset_x", "offset_y", "tilt_x", "tilt_y")
MAX_MERIDIAN_BULK_RATIO = 2e4  # K/μ beyond which the element that projects volume changes is not verified
MAX_BODY_BULK_RATIO = 1000.0  # K/μ beyond which the displacement element is not verified
BULK_GLUE_RATIO = 30.0  # K/μ beyond which glue goes with K
# grounding springs of a loose body, all together, over μ times the length of the indenter
GROUNDING_SPRING_RATIO = 1e-4


class NotModelled(ValueError):
    """Values that this model does not cover; `cause` is a cause class of failed runs."""

    def __init__(self, cause: str, message: str) -> None:
        super().__init__(message)
        self.cause = cause


@dataclass(frozen=True)
class Placement:
    """Where and how the indenter moves, in the specimen's frame; lengths in mm.

    `rotation` (3, 3) takes machine to specimen; `touch` is the indenter's reference point at first contact with
    the undeformed body, `direction` its way; `planes` says which of x = 0, y = 0 are planes of symmetry of everything,
    and `meridian` whether all is of revolution about z, so that the meridian alone is modelled.
    """

    specimen: Specimen
    indenter: Indenter
    rotation: np.ndarray
    touch: np.ndarray
    direction: np.ndarray
    planes: tuple[bool, bool]
    meridian: bool = False

    @property
    def contact(self) -> np.ndarray:
        """Point (3,) of the specimen about which contact grows."""
        return self.indenter.contact(self.specimen, self.touch, self.direction)

    @property
    def normal(self) -> np.ndarray:
        """Unit vector (3,) out of the specimen there, about which its contact is reported."""
        return self.indenter.normal(self.specimen, self.touch, self.direction)

    @property
    def down(self) -> np.ndarray:
        """Direction of gravity (3,)."""
        return self.rotation @ np.array([0.0, 0.0, -1.0])


def placement_of(settings: Settings, knobs: Knobs) -> Placement:
    """Placement of an experiment; raises NotModelled (bad_geometry) for sizes that describe no body."""
    try:
        specimen = settings.support.actual(knobs).confines(settings.specimen.actual(knobs))
        indenter = settings.indenter.actual(knobs, specimen)
        on, normal = specimen.above(*settings.point)
        rotation = tilt_rotation(knobs)
        direction = np.array([0.0, 0.0, -1.0])
        through = np.array([settings.point[0] + knobs.offset_x, settings.point[1] + knobs.offset_y, 0.0])
        if settings.direction == "normal":
            direction = -normal
            through = on + np.array([knobs.offset_x, knobs.offset_y, 0.0])
        direction, through = rotation @ direction, rotation @ through
        if specimen.alike:  # it may as well be turned about its top
            through = specimen.top
        touch = indenter.first_contact(specimen, through, direction)
    except ValueError as error:
        raise NotModelled("bad_geometry", str(error)) from error
    planes = symmetry.planes(settings, knobs, direction, through)
    meridian = symmetry.axisymmetric(settings, knobs, direction, through)
    return Placement(specimen, indenter, rotation, touch, direction, planes, meridian)


def tilt_rotation(knobs: Knobs) -> np.ndarray:
    """Rotation (3, 3) that takes the machine's frame to that of a tilted specimen."""
    a, b = np.deg2rad([knobs.tilt_x, knobs.tilt_y])
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return (about_y @ about_x).T


def fine_at(settings: Settings, knobs: Knobs, placement: Placement) -> tuple[float, float]:
    """Where the fine elements go (x, y) mm: the asked point, moved as misalignment and tilt move the first contact."""
    aligned = dict.fromkeys(MISALIGNMENT_KNOBS, 0.0)
    point = (0.0, 0.0) if placement.specimen.alike else settings.point
    if all(getattr(knobs, name) == 0.0 for name in aligned):
        return point
    moved = placement.contact - placement_of(settings, replace(knobs, **aligned)).contact
    x, y = (0.0 if placement.planes[k] else float(point[k] + moved[k]) for k in (0, 1))
    return x, y


def material(settings: Settings, knobs: Knobs) -> Material:
    """The material of an experiment; raises NotModelled (not_supported) for combinations of laws that do not exist."""
    own = {name: law for name, law in LAWS.members.items() if law.Knobs is not None}
    used = [name for name, law in own.items() if law.used(knobs, settings.terms)]
    base = settings.law if settings.law in own else None
    if len({*used, *([base] if base else [])}) > 1 or (used and LAWS.members[settings.law].small_strain):
        raise NotModelled("not_supported", f"law {settings.law} with knobs of {', '.join(used)}: laws do not combine")
    law = LAWS.members[used[0] if used else settings.law].of(knobs, settings.terms)
    terms = [(knobs.prony_g, knobs.prony_tau), (knobs.prony_g2, knobs.prony_tau2), (knobs.prony_g3, knobs.prony_tau3)]
    terms = [t for t in terms if t[0] != 0.0] + list(settings.prony)
    if sum(g for g, _ in terms) >= 1.0:
        raise NotModelled("inadmissible", f"the Prony shares sum to {sum(g for g, _ in terms):g}, at least 1")
    angle = np.deg2rad(knobs.fibre_angle)
    fibre = laws.Fibre(knobs.fibre, knobs.fibre_k2, (float(np.cos(angle)), float(np.sin(angle)), 0.0))
    mullins = laws.Mullins(knobs.mullins, knobs.mullins_m * knobs.mu, knobs.mullins_beta)
    if law.small_strain and (knobs.fibre or terms or knobs.mullins):
        raise NotModelled("not_supported", "the linear elastic law has no fibres, relaxation or softening")
    return Material(
        law,
        fibre if knobs.fibre else None,
        laws.Prony(tuple(g for g, _ in terms), tuple(t for _, t in terms)) if terms else None,
        mullins if knobs.mullins else None,
    )


def of_layers(settings: Settings, knobs: Knobs) -> tuple[Material, ...]:
    """The materials of layers with a law of their own, from the top down; others stand for that of the rest.

    Fibres are as stiff beside the layer's μ as in the rest, softening begins at the same share of it.
    Raises NotModelled where the rest is linear elastic.
    """
    rest, specimen, out = material(settings, knobs), settings.specimen, []
    for prefix, own, ratio in zip(own_laws.LAYER_PREFIXES, specimen.laws, specimen.ratios, strict=False):
        if own is None:
            out.append(rest)
            continue
        if rest.small_strain:
            raise NotModelled("not_supported", f"law = {settings.law!r} below a layer of finite strain")
        law = own_laws.law_of_layer(own, prefix, knobs, ratio)
        k = law.shear_modulus / rest.shear_modulus
        fibre = rest.fibre and replace(rest.fibre, k1=k * rest.fibre.k1)
        out.append(Material(law, fibre, rest.prony, rest.mullins and replace(rest.mullins, m=k * rest.mullins.m)))
    return tuple(out)


def substance(settings: Settings, knobs: Knobs, placement: Placement, body: Body) -> Substance:
    """The material of a body, of several ones where layers have laws of their own; raises NotModelled."""
    rest = material(settings, knobs)
    if not any(settings.specimen.laws):
        return rest
    layer = placement.specimen.layer(body.nodes[body.cells].mean(1))
    return Regions((rest, *of_layers(settings, knobs)), layer)


@dataclass(frozen=True)
class AssembledModel:
    """A discretised specimen that every material and every place of the indenter near its fine mesh can share.

    `facets` (f, 6), or edges (f, 3) of a meridian, are those of the specimen's surface, `held` nodes of the support.
    """

    mesh: MeshTet2 | MeridianMesh
    body: Body
    facets: np.ndarray
    factor: direct.Factor
    held: np.ndarray
    condenser: Callable[[np.ndarray], Condense | None]


def revolved_model(settings: Settings, specimen: Specimen, symmetric: bool = True) -> AssembledModel:
    """Model of the meridian of a specimen of revolution; raises meshing.BadMesh."""
    wide = specimen.half_width if "base" in specimen.parts else specimen.largest
    many = contact_elements.samples(settings, max(wide, float(specimen.top[2] - specimen.lowest[2])))
    places = () if many is None else (many,)
    mesh = settings.specimen.meridian(specimen, contact_elements.spacing(settings), settings.fineness, *places)
    return of_meridian(settings, specimen, mesh, symmetric)


def of_meridian(settings: Settings, specimen: Specimen, mesh: MeridianMesh, symmetric: bool = True) -> AssembledModel:
    """Model of a specimen of revolution by a mesh of its meridian; raises meshing.BadMesh."""
    points, facets = mesh.points, mesh.outline()
    X = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    carried = settings.support.held(specimen, X, np.unique(facets))
    try:
        discrete = axisymmetric.discretise(points, mesh.cells, carried, symmetric)
    except ValueError as error:
        raise meshing.BadMesh(str(error)) from error
    factor = direct.precise(discrete.pattern, settings.solver)  # at K/μ = 10⁴ single precision says nothing
    condenser = condensation.condenser(discrete.pattern, settings.solver)
    return AssembledModel(mesh, discrete, facets, factor, np.nonzero(carried.any(1))[0], condenser)


def build_model(
    settings: Settings, mesh: Mesh, specimen: Specimen, planes: tuple[bool, bool], symmetric: bool = True
) -> AssembledModel:
    """Model of a specimen: symmetry planes held in their normal, and what the support holds.

    Raises meshing.BadMesh when the elements cannot take this shape or place.
    """
    at = mesh, settings.recipe, settings.point, planes
    if settings.large_strain and contact_elements.gathers(settings.indenter) and isinstance(specimen, GradedInAdvance):
        quadratic = specimen.gathered(*at, settings.indenter.length)
    else:
        quadratic = specimen.quadratic(*at)
    return of_tetrahedra(settings, quadratic, specimen, planes, symmetric)


def of_tetrahedra(
    settings: Settings, quadratic: MeshTet2, specimen: Specimen, planes: tuple[bool, bool], symmetric: bool
) -> AssembledModel:
    """Model of a specimen by a quadratic mesh of it; raises meshing.BadMesh."""
    X = quadratic.doflocs.T
    facets = quadratic_facets(quadratic, quadratic.boundary_facets())
    for axis in (0, 1):
        if planes[axis]:
            facets = facets[~(X[facets, axis] == 0.0).all(1)]
    held = np.zeros(X.shape, bool)
    for axis in (0, 1):
        if planes[axis]:
            held[:, axis] = X[:, axis] == 0.0
    carried = settings.support.held(specimen, X, np.unique(facets))
    held |= carried
    discrete = tetrahedra.discretise(quadratic, held, symmetric, settings.large_strain)
    rolls = settings.support.loose and not all(planes)
    factor = krylov.KrylovSolver(discrete.pattern, settings.solver).factor if rolls else None
    factor = factor or direct.solver(discrete.pattern, settings.solver)
    condenser = condensation.condenser(discrete.pattern, settings.solver)
    return AssembledModel(quadratic, discrete, facets, factor, np.nonzero(carried.any(1))[0], condenser)


def admit(settings: Settings, knobs: Knobs, placement: Placement) -> None:
    """Raise NotModelled for a material or an adhesion out of reach, and for small strains of a body that may turn."""
    stuff = material(settings, knobs)
    if stuff.small_strain and settings.support.loose and not all(placement.planes):
        holding = " or ".join(f'"{name}"' for name, member in SUPPORTS.members.items() if not member.loose)
        raise NotModelled(
            "not_supported",
            f'law = "{settings.law}" with support = "{settings.support.name}" lets the body turn (point, tilt or '
            "misalignment off the axes). Its strain, sym grad u, grows with a rotation: use law = "
            f'"{LAWS.default}", which agrees to first order, or support = {holding}',
        )
    everything = (stuff, *of_layers(settings, knobs))
    ratio = max(m.bulk_modulus / m.shear_modulus for m in everything)
    stiffest = MAX_MERIDIAN_BULK_RATIO if placement.meridian else MAX_BODY_BULK_RATIO
    if ratio > stiffest:
        raise NotModelled(
            "not_supported", f"K/mu = {ratio:.4g}: the element is verified to {stiffest:g} (nearly incompressible)"
        )
    if knobs.permeability:
        _admit_pore_flow(settings, knobs, placement)
    h0 = element_size(settings, placement.meridian)
    if knobs.adhesion and knobs.adhesion_range < h0 / MAX_ELEMENT_TO_RANGE_RATIO:
        raise NotModelled(
            "not_supported",
            f"adhesion_range = {knobs.adhesion_range:g} mm: elements of {h0:.3g} mm at the "
            f"contact resolve ranges of {h0 / MAX_ELEMENT_TO_RANGE_RATIO:.3g} mm and more",
        )


def _admit_pore_flow(settings: Settings, knobs: Knobs, placement: Placement) -> None:
    """Raise NotModelled for a body with pore flow that is not of revolution, rubs, sticks or lies loose."""
    asked = f"permeability = {knobs.permeability:g} mm^4/N/s: pore flow is modelled"
    if not placement.meridian:
        raise NotModelled(
            "not_supported",
            f"{asked} for bodies of revolution only: specimen, indenter, support, place and all effects alike",
        )
    if knobs.friction or knobs.adhesion or settings.support.friction(vars(knobs)):
        raise NotModelled("not_supported", f"{asked} without friction and adhesion; leave one of the two out")
    if settings.support.loose:
        raise NotModelled("not_supported", f"{asked} for specimens that their support holds")


def model_for(settings: Settings, knobs: Knobs, placement: Placement, mesh: str | None) -> AssembledModel:
    """The discretised specimen of an experiment; NotModelled without a mesh or for a material out of reach."""
    admit(settings, knobs, placement)
    symmetric, shared = _symmetric(settings, knobs), _shared(settings, knobs, placement)
    try:
        if placement.meridian:
            return _meridian(replace(shared, point=(0.0, 0.0)), placement.specimen, symmetric)
        return _model(shared, placement.specimen, placement.planes, symmetric, mesh)
    except meshing.BadMesh as error:
        raise NotModelled("bad_geometry", f"no mesh: {error}") from error


def remeshed_model(settings: Settings, knobs: Knobs, placement: Placement, mesh: MeridianMesh) -> AssembledModel:
    """The specimen of an experiment by another mesh of its meridian; raises meshing.BadMesh."""
    shared = replace(_shared(settings, knobs, placement), point=(0.0, 0.0))
    return of_meridian(shared, placement.specimen, mesh, _symmetric(settings, knobs))


def rezoned_model(settings: Settings, knobs: Knobs, placement: Placement, mesh: MeshTet2) -> AssembledModel:
    """The specimen of an experiment in space by another mesh of it."""
    shared = _shared(settings, knobs, placement)
    return of_tetrahedra(shared, mesh, placement.specimen, placement.planes, _symmetric(settings, knobs))


def _symmetric(settings: Settings, knobs: Knobs) -> bool:
    plain = knobs.friction == 0.0 and not settings.support.friction(vars(knobs))
    return plain and knobs.permeability == 0.0


def _shared(settings: Settings, knobs: Knobs, placement: Placement) -> Settings:
    """The settings as far as a model depends on them, so that runs share it."""
    return Settings(
        settings.specimen,
        settings.indenter,
        support=settings.support.actual(knobs).holding(),
        point=fine_at(settings, knobs, placement),
        recipe=settings.recipe,
        control=Control(),
        solver=settings.solver,
        fineness=settings.fineness,
        fine=settings.fine if placement.meridian else None,
        large_strain=settings.large_strain and not placement.meridian,
    )


@functools.lru_cache(maxsize=2)
def _model(
    settings: Settings, specimen: Specimen, planes: tuple[bool, bool], symmetric: bool, mesh: str | None
) -> AssembledModel:
    """Shared by all runs of a worker on one mesh."""
    made = meshing.cached(settings.recipe) if mesh is None else meshing.Mesh.from_file(mesh)
    return build_model(settings, made, specimen, planes, symmetric)


@functools.lru_cache(maxsize=4)
def _meridian(settings: Settings, specimen: Specimen, symmetric: bool) -> AssembledModel:
    """Shared by all runs of a worker: two of one experiment, see `accuracy.two_grid`."""
    return revolved_model(settings, specimen, symmetric)


def system(
    settings: Settings, knobs: Knobs, placement: Placement, model: AssembledModel, like: System | None = None
) -> System:
    """Everything that stays the same during a run.

    `like` is a system whose knobs differ in moduli of the material alone: surfaces and zones are taken over from it.
    Raises NotModelled for an inclusion outside the body and the like, and for laws that do not combine.
    """
    body = model.body
    settings = replace(settings, support=settings.support.actual(knobs))
    stuff = substance(settings, knobs, placement, body)
    mu, length = stuff.shear_modulus, placement.indenter.length
    if like is None:
        surface, below = contact_pairs(settings, placement, model)
    else:
        surface, below = like.pressing.surface, tuple(p.surface for p in like.seat)
    adhesion = Adhesion(knobs.adhesion, knobs.adhesion_range) if knobs.adhesion else None
    try:
        held = placement.indenter.held(contact_points(surface, body.nodes), placement.touch, placement.direction)
    except ValueError as error:
        raise NotModelled("bad_geometry", str(error)) from error
    if held is not None and knobs.weight:
        raise NotModelled("not_supported", "a bonded indenter on a specimen that sags under its weight before the test")
    follows = held is None and knobs.friction == 0.0
    scale = stiffening(settings, knobs, placement, body) if like is None else like.scale
    epsilon = penalty(placement, body, surface, mu, not follows or knobs.permeability > 0.0)
    if meshing.is_grid(settings.recipe) and not placement.meridian:
        epsilon = epsilon * firmness(placement, body, surface, stuff, scale)
    if held is not None:  # a layer between two that hold it is as stiff as K
        epsilon = epsilon * max(1.0, stuff.bulk_modulus / (BULK_GLUE_RATIO * mu))
    indenter = Pair(surface, placement.indenter, epsilon, knobs.friction, adhesion, held is not None, held)
    # multipliers stay with points of the body: where that turns, they do not hold its weight in place
    soft = knobs.weight > 0.0 and not all(placement.planes)
    seat = settings.support.pairs(settings.specimen, placement.specimen, below, knobs, mu, length, soft)
    springs = None
    if settings.support.loose:
        whole = body.w.sum()
        springs = (
            GROUNDING_SPRING_RATIO
            * mu
            * length
            * nodal_weight(body, np.ones_like(body.w))
            / whole
            / multiplicity(placement)
        )
    dead = None
    if knobs.weight:
        dead = (
            knobs.weight * nodal_weight(body, solid_share(settings, knobs, placement, body))[:, None] * placement.down
        )
    least = 1e-3 * mu * length**2  # about the force at a hundredth of the length
    return System(body, stuff, indenter, seat, model.factor, scale, dead, springs, least)


def penalty(placement: Placement, body: Body, surface: ContactSurface, mu: float, firm: bool) -> np.ndarray:
    """ε (f, q) MPa/mm: on a meridian by the length of each edge, as fine elements give way to a soft penalty.

    Pressed by p on a foundation of ε per undeformed area, a surface of modulus μ buckles in waves shorter than p²/(με):
    no element may be that short up to p = √FIRM_PENALTY_RATIO μ where it is `firm`, with friction or adhesion.  Without
    them contact acts per area now, and multipliers make it exact.  With pore flow it is firm, too: what multipliers
    move comes within one step, in which little drains.
    """
    if not placement.meridian:
        return np.full(surface.weights.shape, BODY_PENALTY_RATIO * mu / placement.indenter.length)
    ends = body.nodes[surface.facets[:, :2]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    factor = FIRM_PENALTY_RATIO if firm else MERIDIAN_PENALTY_RATIO
    return np.repeat((factor * mu / length)[:, None], surface.weights.shape[1], axis=1)


def firmness(
    placement: Placement, body: Body, surface: ContactSurface, stuff: Substance, scale: np.ndarray | None
) -> float:
    """How many times as stiff as the core the elements are that are touched first, at least 1.

    `scale` (m, q) is the factor of layers and skin, see `stiffening`; layers of their own law have their own modulus.

    A ball on a layer 40 times as stiff as what is below it went through a third of its travel into a surface whose
    penalty was that of the core: one augmentation does not take that away.
    """
    if scale is None and not isinstance(stuff, Regions):
        return 1.0
    corners = surface.facets[:, :3]
    first = np.argmin(np.linalg.norm(body.nodes[corners].mean(1) - placement.contact, axis=1))
    touched = np.isin(body.cells, corners[first]).any(1)
    times = np.ones(int(touched.sum())) if scale is None else scale[touched].mean(1)
    if isinstance(stuff, Regions):
        moduli = np.array([m.shear_modulus for m in stuff.materials])
        times = times * moduli[stuff.of[touched]] / stuff.shear_modulus
    return max(float(times.mean()), 1.0)


def contact_pairs(
    settings: Settings, placement: Placement, model: AssembledModel
) -> tuple[ContactSurface, tuple[ContactSurface, ...]]:
    """Surfaces that may touch: the indenter around the first contact, and what the support offers to touch."""
    middle = model.body.nodes[model.facets].mean(1)
    near = np.linalg.norm(middle - placement.contact, axis=1) < placement.indenter.reach
    near &= placement.specimen.part("upper", middle) | (middle[:, 2] > placement.specimen.lowest[2])  # not the base
    below = settings.support.surfaces(placement.specimen, model.body, model.facets)
    return contact_surface(model.body, model.facets[near], placement.specimen), below


def stiffening(settings: Settings, knobs: Knobs, placement: Placement, body: Body) -> np.ndarray | None:
    """Factor (m, q) of layers, skin, inclusion and cavity on all moduli, None without them; raises NotModelled."""
    N = bodies.shape_functions(body)
    layers = placement.specimen.stiffness(np.einsum("qa,mai->mqi", N, body.nodes[body.cells]))
    inclusion = (knobs.inclusion_x, knobs.inclusion_y, float(placement.specimen.top[2]) - knobs.inclusion_depth)
    try:
        other = zones.modulus_factor(
            body,
            placement.specimen,
            (knobs.skin_thickness, knobs.skin_ratio) if knobs.skin_ratio != 1.0 else None,
            (inclusion, knobs.inclusion_radius, knobs.inclusion_ratio) if knobs.inclusion_ratio != 1.0 else None,
            placement.specimen.hole(knobs.cavity) if knobs.cavity else None,
        )
        return layers if other is None else other if layers is None else layers * other
    except ValueError as error:
        raise NotModelled("bad_geometry", str(error)) from error


def solid_share(settings: Settings, knobs: Knobs, placement: Placement, body: Body) -> np.ndarray:
    """Share (m, q) of the volume that is no cavity: what weighs."""
    whole = np.ones_like(body.w)
    return whole - zones.cavity(body, *placement.specimen.hole(knobs.cavity)) if knobs.cavity else whole


def multiplicity(placement: Placement) -> int:
    """How many images of the modelled part make the whole: 1, 2 or 4; a meridian has the whole turn in its weights."""
    return 1 if placement.meridian else 2 ** sum(placement.planes)


def nodal_weight(body: Body, density: np.ndarray) -> np.ndarray:
    """∫ ρ N_a dV (n,) of a density (m, q): the consistent nodal share of a body force."""
    out = np.zeros(len(body.nodes))
    np.add.at(out, body.cells, (density * body.w) @ bodies.shape_functions(body))
    return out


def condensing(system: System, model: AssembledModel, start: Load, end: Load) -> System:
    """The system with what condenses its tangents to the dofs c that the indenter may touch between two loads.

    Only where nothing else touches (a support may do so everywhere), and where the dense matrix of those is no larger
    than the sparse one: beyond, to factorise it in every iteration costs what a new tangent of the body would.
    """
    if system.seat or isinstance(model.body, axisymmetric.MeridianBody):
        return system
    pair, c = system.pressing, [load.pressing.centre for load in (start, end)]
    points = contact_points(pair.surface, system.body.nodes)
    nodes = np.unique(pair.surface.facets[pair.rigid.swept(points, *c, end.pressing.direction).any(1)])
    dofs = model.body.free.reshape(-1, 3)[nodes]
    dofs = dofs[dofs >= 0]
    if len(dofs) ** 2 > len(model.body.pattern.indices):
        return system
    return replace(system, condense=model.condenser(dofs))


def load_at(system: System, placement: Placement, travel: float, lag: float = 0.0) -> Load:
    """Load at a travel (mm) without multipliers; `lag` is how much later the sagged body is touched than nominal."""
    indenter = system.pressing
    way = travel + lag
    centre, nothing = placement.touch + way * placement.direction, np.zeros(indenter.surface.weights.shape)
    factor = penalty_factor(indenter.surface, system.body, placement, travel)
    seat = [Touch(np.zeros(3), np.zeros(3), np.zeros(pair.surface.weights.shape), 1.0, None) for pair in system.seat]
    return Load(Touch(centre, placement.direction, nothing, factor, None), tuple(seat))


def penalty_factor(surface: ContactSurface, body: Body, placement: Placement, travel: float) -> np.ndarray | float:
    """Factor (f, q) on ε around the first contact: 1 to a travel of the indenter's length, 1 + r from twice it.

    r = DEEP_PENALTY_RISE.
    ε acts per reference area, and the skin under a deep indenter stretches up to twenty times in area: with a uniform ε
    it would pierce the surface at depths beyond twice its length.
    """
    if placement.meridian:  # its ε is stiff enough
        return 1.0
    length = placement.indenter.length
    deep = min(max(travel / length - 1.0, 0.0), 1.0)
    if deep == 0.0:
        return 1.0
    points = np.einsum("qa,fai->fqi", surface.N, body.nodes[surface.facets])
    d = np.linalg.norm(points - placement.contact, axis=-1) / length
    return 1.0 + DEEP_PENALTY_RISE * deep * np.exp(-((d / DEEP_PENALTY_WIDTH_RATIO) ** 2))
