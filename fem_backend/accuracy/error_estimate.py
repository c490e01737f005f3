"""The numerical error that a result states for each of its channels: mesh, contact and steps.

Each channel's error is a share of a few lengths and values that the run knows.  The shares of a specimen under an
indenter stand in calibration.toml; benchmarks/fe_errors.py prints their fit and what they cover.
"""

from __future__ import annotations

import numpy as np

from fem_backend import closed_forms
from fem_backend.accuracy.calibration import Calibration, calibration
from fem_backend.contact.pointwise import TANGENTIAL_PENALTY_RATIO
from fem_backend.meshing import graded_for
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import contact_elements
from fem_backend.simulation.experiment import SEALED, Settings, element_size, on_axis, profile_name
from fem_backend.simulation.indentation import Result
from fem_backend.simulation.knobs import Knobs
from fem_backend.simulation.outputs import FORCES
from fem_backend.specimens.flat import FlatTopped

# of the sum of steps and creep where what sticks is left beside their difference: they cancel in part
UNCANCELLED_SHARE = 0.3
AUGMENTATION_ERROR_SHARE = 0.1  # of what the last augmentation changed in the force
BELOW_INDENTER_RADIUS_RATIO = 0.7  # of R: what counts as below it
FRICTION_STEP_ERROR_SHARE = 0.025  # of the force, at friction 1 in the first step
STICKING_STEP_ERROR_SHARE = 0.05  # of what friction takes of a lateral force in the first step
FRICTION_CREEP_FACTOR = 2.5  # times what an even traction would let what sticks creep: it is largest at the edge
# of the force, at Σg = 1 in the first step: 1.5 times what ten times as many steps change
RELAXATION_STEP_ERROR_SHARE = 0.075
# of 2πWR*, times (h₀/ℓ)²: attraction of a range ℓ between points of contact (h₀/ℓ = 4 to 30)
ADHESION_MESH_ERROR_SHARE = 4e-4
WEIGHT_CREEP_FACTOR = 2.0  # times that is the share of what a body creeps by under its weight
# of the largest of these so far is still there on the way back, where the force vanishes
LINGERING_STEP_ERROR_SHARE = 0.3
COARSER_DIFFERENCE_SHARE = 0.35  # of the difference to elements of twice the size, see `coarse_mesh_errors`
DOUBLE_ERROR_CONTACT_ELEMENTS = 4.0  # elements: of a contact that is so wide twice that is missed
DOUBLE_ERROR_EDGE_ELEMENTS = 0.3  # elements: of a contact that reaches so far onto a rounded edge twice that is missed
# times the difference at most where contact barely reaches onto such an edge: both meshes miss it alike
MAX_EDGE_ERROR_FACTOR = 3.0
BELOW_TIP_SHARE_AND_ELEMENTS = 0.3, 3.0  # both below a rounded tip, where elements grow with the distance from it
MAX_DEEPER_TRAVEL_RATIO = 1.1  # times the travel: deeper differences say nothing of a deep one
NEIGHBOURING_REST_RATIO = 2.0  # times as long: two moments of a rest that are neighbours
SPACE_CONVERGENCE_ORDER = 1.1  # order of what is missed in space by the number of nodes: h^3.3
MIN_CALIBRATED_SHARE = 0.2  # of a calibrated error is stated where two meshes agree by accident
BEYOND_COARSE_EXPONENT = 6.0  # power of the travel by which the difference grows beyond the end of the coarser run
NEW_MESH_TRAVEL_RATIO = 1.25  # times the travel: as far a new mesh says something of the error
SLIPPING_ERROR_SHARE = 0.7  # of the contact in the first step, and of the share that slips


def stated_errors(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """Estimated error of each channel (k,) in its unit; `time` and `travel` are exact, what is zero by symmetry too.

    error = Σ c_j column_j (see `columns`) + what contact and steps leave (`run_terms`); of Fx and Fy by the root of the
    sum of squares with `aslant` and with the difference and a share of the sum of `sticking` and `friction_creep`:
    steps hold too much where a surface sticks, creep too little.

    A calibration, not a bound: in 47 random experiments on held bodies 97 % of the errors of the force and 93 to 98 %
    of those of the other channels lie below, in the median by 1.6 times (force, area, radius), 2 to 4 times (the
    others) or 4.8 (lateral forces).  Of all lateral forces, in 30 experiments beside the top, tilted, rubbing on
    slopes, 92 % lie below, in the median by 4.0 times (rubbing 89 %, 3.7); a ball that slips on a compressible body
    missed by up to three times.  In 12 kept back earlier, in bowls, tilted, with unloading, it was 98 % of the errors
    of the force (coarse and standard), 91 % of surface points, 88 to 100 % of the others.
    Valid for the shipped meshes at the levels coarse and standard (fine and reference are extrapolated with the force,
    and were compared at two materials; fine in twelve bowls, where its facets are the largest of all), K/μ from 1.5 to
    200, travel from 0.1 to 1.3 R, at the top and on the axes; points off the axes and other meshes are extrapolations.
    Forces to 2.7 R at the top: see `distorted`.
    Skins: at the top, K/μ = 60, 0.05 to 0.67 R thick, 0.1 to 30 times as stiff, coarse and standard beside fine.
    Balls on blocks, slabs and cylinders in space: see `python benchmarks/flat_errors.py`.
    """
    if result.coarser is None:
        return _sideways(settings, result, calibrated(settings, knobs, result))
    found = coarse_mesh_errors(settings, knobs, result)
    if settings.large_strain:
        least = calibrated(settings, knobs, result)
        found = {name: np.maximum(error, MIN_CALIBRATED_SHARE * least[name]) for name, error in found.items()}
    return _sideways(settings, result, found)


def _sideways(settings: Settings, result: Result, found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same where no horizontal displacement of a point is known better, in proportion, than its vertical one."""
    for place in settings.profile:
        up = profile_name(place)
        share = np.minimum(found[up] / np.maximum(np.abs(result.channels[up]), 1e-300), 1.0)
        for name in (profile_name(place, "x"), profile_name(place, "y")):
            if name in found:
                found[name] = np.maximum(found[name], share * np.abs(result.channels[name]))
    return found


def calibrated(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """Error of each channel (k,) by what meshes of the level miss on this specimen; see `stated_errors`."""
    c = calibration_of_run(settings, knobs)
    shares, other = c.shares, run_terms(settings, knobs, result)
    out = {name: np.zeros_like(result.travel) for name in result.channels}
    for name, parts in columns(settings, knobs, result).items():
        out[name] = parts @ np.array(shares[calibration_kind(name)])
    out |= {name: out[name] + left for name, left in other.items()}
    out |= {name: np.maximum(out[name], least) for name, least in unresolved_contact(settings, knobs, result).items()}
    turned = {n: parts @ np.array(shares["lateral"]) for n, parts in aslant(settings, knobs, result).items()}
    stuck, crept = sticking(settings, knobs, result), friction_creep(settings, knobs, result)
    for n, part in turned.items():
        out[n] = np.linalg.norm([out[n], part, crept[n] - stuck[n], UNCANCELLED_SHARE * (crept[n] + stuck[n])], axis=0)
    return {n: c.inflated * v for n, v in out.items()} if c.inflated != 1.0 else out


def coarse_mesh_errors(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """Error of each channel (k,) by the same run on a coarser mesh, c; of a meridian with elements of twice the size:

        e_k = m_k |c_k|_s r_k + what contact and steps leave,   r_k² = mean (f_j − c_j)²/s_j² over s_k/2 ≤ s_j ≤ 2 s_k

    with the channel f, s the travel and |c|_s its largest value so far.  Elements of the size h miss h^2.5 or so of a
    force: the difference is four or five times what the finer ones miss, and hangs at each depth on where the edge of
    contact lies in an element, which the mean over neighbours takes out.  Where the contact radius a is a few elements
    h₀ only, they miss a half: m = 0.35 (1 + (4 h₀/a)²), at most 1; 0.3 (1 + (3 h₀/a)²) below a rounded
    tip.  Beyond s₁, where that run ended, r = r₁ (s/s₁)⁶.
    Beyond a travel of 1.5 lengths of the indenter s_j ≤ 1.1 s_k: errors grow fast there.
    Beyond a travel w at which a mesh was outworn and no other was made, r grows by (s/w)⁶, too.
    Where the mesh was remade within a quarter of s, at least half of what the force changed by counts.

    With pore flow steps are twice as long there, too, and neighbours are also near in the time since a rest began.
    Where the indenter is sealed the edge of what drains is as wide as an element, of first order: m = 1.
    Below a rounded edge onto which contact reaches by the share x of an element, m ≥ 0.35 (1 + (0.3/x)²), at most 3:
    slab of 2 R, fillets R/50 to R/10, 0.003 to 0.1 R deep, 0.07 to 0.5 of the difference are missed where x > 0.2, and
    up to 1.4 of it below (`python benchmarks/deep_meridian.py shallow --level coarse`).  With pore flow what is missed
    there and what steps change cancel at some moments of a rest: m ≥ 1, of the mean over all.
    In space N times as many nodes miss N^−1.1 of what the coarser mesh does: m = 1/(N^1.1 − 1), at most 3, and r_k is
    at least that of k itself, as what is missed grows with the depth.  Held sphere of 35 mm to 2.7 R beside its
    meridian: all of 54 forces covered, 2.8 times in the median (`python benchmarks/deep_three_dimensions.py`).
    """
    assert result.coarser is not None
    travel, c = np.maximum(np.abs(result.travel), 1e-300), calibration_of_run(settings, knobs)
    left, size = run_terms(settings, knobs, result), whole_force(result)
    near = (travel[:, None] <= 2.0 * travel) & (travel <= 2.0 * travel[:, None]) & (result.travel > 0.0)
    near &= travel <= np.maximum(MAX_DEEPER_TRAVEL_RATIO * travel[:, None], c.deep * settings.indenter.length)
    h0 = element_size(settings, True)
    a = np.maximum(result.channels["contact_radius"], 1e-9 * h0)  # 0 where contact is lost on the way back
    tip = np.isfinite(settings.indenter.finest[1]) and contact_elements.gathers(settings.indenter)
    compared, width = BELOW_TIP_SHARE_AND_ELEMENTS if tip else (COARSER_DIFFERENCE_SHARE, DOUBLE_ERROR_CONTACT_ELEMENTS)
    share = np.minimum(compared * (1.0 + (width * h0 / a) ** 2), 1.0)
    onto = settings.indenter.on_edge(a) / settings.fineness
    edged = np.isfinite(onto)
    share = np.maximum(
        share,
        np.where(
            edged,
            np.minimum(
                COARSER_DIFFERENCE_SHARE * (1.0 + (DOUBLE_ERROR_EDGE_ELEMENTS / np.maximum(onto, 1e-9)) ** 2),
                MAX_EDGE_ERROR_FACTOR,
            ),
            0.0,
        ),
    )
    if knobs.permeability:
        near &= _as_long(result) | edged.any()
        share = np.maximum(share, 1.0) if settings.drainage[0] == SEALED or edged.any() else share
    if settings.large_strain:
        share = np.full_like(a, min(1.0 / max(result.finer**SPACE_CONVERGENCE_ORDER - 1.0, 1e-9), 3.0))
    out = {}
    for name, fine in result.channels.items():
        if name in ("time", "travel"):
            out[name] = np.zeros_like(fine)
            continue
        largest = np.maximum.accumulate(np.fmax(np.abs(fine), np.abs(result.coarser[name])))
        known = np.isfinite(result.coarser[name])
        rough = np.where(known, fine - result.coarser[name], 0.0) / np.maximum(largest, 1e-300)
        both = near & known
        mean = np.sqrt((both * rough**2).sum(1) / np.maximum(both.sum(1), 1))
        if not known.all():
            last = int(known.sum()) - 1
            mean[last:] = mean[last] * np.maximum(travel[last:] / travel[last], 1.0) ** BEYOND_COARSE_EXPONENT
        mean = np.maximum(mean, np.abs(rough)) if settings.large_strain else mean
        if result.outworn is not None:
            mean = mean * np.maximum(travel / result.outworn, 1.0) ** BEYOND_COARSE_EXPONENT
        out[name] = share * largest * mean
    if knobs.adhesion:
        out |= attracted(result)
    for began, jump in result.legs:
        beside = (travel > began / NEW_MESH_TRAVEL_RATIO) & (travel < began * NEW_MESH_TRAVEL_RATIO)
        out["Fz"] = np.where(beside, np.maximum(out["Fz"], 0.5 * jump * np.abs(result.channels["Fz"])), out["Fz"])
    deeper = distorted(settings, knobs, result)  # is of elements in space
    for name, more in left.items():
        out[name] = out[name] + (more - deeper * np.abs(result.channels[name]) if name in FORCES else more)
    beyond = settings.specimen.beyond(settings.indenter.length)
    out["Fz"] = out["Fz"] + beyond * result.channels["contact_radius"] / settings.indenter.length * size
    penetration = c.penetration * settings.indenter.length * (1.0 + log_bulk_ratio(knobs))
    out["uz_max"] = np.maximum(out["uz_max"] - penetration, 1e-6 * travel)
    return out


def attracted(result: Result) -> dict[str, np.ndarray]:
    """Error of each channel (k,) of a body that is attracted, beside elements of twice the size: the difference, and
    at least its root mean square over the instants at which both touch or neither does.

    The edge of an adhering contact is a crack: its forces converge no faster than h² and go up and down as it passes
    from element to element.  Between the jumps of the two the difference is the whole pull, and so is the error.
    """
    assert result.coarser is not None
    on = np.stack([c["contact_radius"] > 0.0 for c in (result.channels, result.coarser)])
    same = (on[:, :, None] == on[:, None, :]).all(0) & (on[0] == on[1])
    out = {}
    for name, fine in result.channels.items():
        off = np.abs(fine - result.coarser[name])
        mean = np.sqrt((same * off**2).sum(1) / np.maximum(same.sum(1), 1))
        out[name] = np.zeros_like(fine) if name in ("time", "travel") else np.maximum(off, mean)
    return out


def _as_long(result: Result) -> np.ndarray:
    """Whether two instants (k, k) both move, or have rested for times within a factor of `NEIGHBOURING_REST_RATIO`."""
    time, travel = result.channels["time"], result.travel
    moves = np.concatenate([[True], np.abs(np.diff(travel)) > 1e-9 * np.abs(travel).max()])
    began = np.maximum.accumulate(np.where(moves, np.arange(len(time)), 0))
    since = np.where(moves, 0.0, time - time[began])
    both = moves[:, None] == moves
    return (
        both & (since[:, None] <= NEIGHBOURING_REST_RATIO * since) & (since <= NEIGHBOURING_REST_RATIO * since[:, None])
    )


def mesh_factor(settings: Settings, knobs: Knobs) -> float:
    """Error of the mesh at this place over that of the level coarse at the top: level · (1 + 4ρ²).

    ρ is the distance from the top in semi-axes.  Meshes without a level: by the square of their element size, of second
    order and not calibrated.
    """
    return _of_level(settings, calibration_of_run(settings, knobs)) * stretched(settings, knobs)


def calibration_of_run(settings: Settings, knobs: Knobs) -> Calibration:
    """The calibration of a run; see `calibration`."""
    c = calibration(settings)
    if not c.only_in_space:
        return c
    apart = bool(knobs.adhesion) or settings.large_strain or modelling.placement_of(settings, knobs).meridian
    return calibration(settings, apart) if apart else c


def _of_level(settings: Settings, c: Calibration) -> float:
    """The share of the level, or of the element size where the mesh has none."""
    mesh = c.at(settings.level).mesh
    return mesh or (4.0 * settings.h0 / settings.indenter.length) ** 2


def unreached(settings: Settings, knobs: Knobs, result: Result) -> float:
    """(h/0.9 h₀)² where the mean edge h below the ball is longer than that: fTetWild does not always get there.

    0.9 is the `mean_edge` of a calibration: 0.78 to 0.89 of the shipped meshes and of most that are made.
    """
    if result.system is None or not settings.level:
        return 1.0
    corners = result.system.body.nodes[result.system.pressing.surface.facets[:, :3]]
    x, y = indenter_place(settings, knobs)
    away = np.hypot(*(corners.mean(axis=1)[:, :2] - (x, y)).T)
    length = min(settings.indenter.length, graded_for(settings.recipe))
    near = corners[away <= max(BELOW_INDENTER_RADIUS_RATIO * length, float(away.min()))]
    h = float(np.linalg.norm(near - np.roll(near, 1, axis=1), axis=2).mean())
    return max(1.0, (h / (calibration_of_run(settings, knobs).mean_edge * settings.h0)) ** 2)


def stretched(settings: Settings, knobs: Knobs) -> float:
    """The share of the place in it."""
    return 1.0 + calibration_of_run(settings, knobs).off_top * settings.specimen.off_top(
        *indenter_place(settings, knobs)
    )


def indenter_place(settings: Settings, knobs: Knobs) -> tuple[float, float]:
    """Where the ball is in the specimen's frame, (x, y) mm: misalignment and tilt move it, and the fine elements."""
    return modelling.fine_at(settings, knobs, modelling.placement_of(settings, knobs))


def run_terms(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """What contact and steps leave on any mesh, (k,) in the channel's unit.

    What is out of balance may be missing in a force.  A step is rough for friction by its share of the travel, and for
    relaxation (see `relaxation_step_error`, of displacements and contact `recovering`); attraction errs by a share of
    Bradley's pull-off force 2πWR*, the more the shorter its range.  `uz_max` has what the ball penetrates, a surface
    point its share of it: on grids by what the last augmentation changed, all of it where none was made.
    """
    size = whole_force(result)
    step = newly(settings, result)
    left = (
        AUGMENTATION_ERROR_SHARE * result.contact_error / np.maximum(size, 1e-300)
        + FRICTION_STEP_ERROR_SHARE * knobs.friction * step
    )
    left = left + result.residual + distorted(settings, knobs, result)
    c = calibration_of_run(settings, knobs)
    length = settings.indenter.length
    deep = c.penetration * length * (1.0 + log_bulk_ratio(knobs))
    if c.only_in_space:
        left_over = c.penetration if settings.multipliers else 1.0
        deep = left_over * np.abs(result.travel) * result.contact_error / np.maximum(size, 1e-300)
    points = {profile_name(place): deep * surface_share(result, profile_name(place)) for place in settings.profile}
    left = left + relaxation_step_error(settings, knobs, result) / np.maximum(size, 1e-300)
    pull = 2.0 * np.pi * knobs.adhesion * effective_radius(settings)
    pull *= (
        0.0
        if result.coarser is not None
        else min(ADHESION_MESH_ERROR_SHARE * (settings.h0 / knobs.adhesion_range) ** 2, 1.0)
    )
    forces = {n: left * np.abs(result.channels[n]) + pull * share for n, share in directed(result).items()}
    back = recovering(settings, knobs, result)
    points = {n: v + back[n] for n, v in points.items()}
    return (
        forces
        | points
        | {
            "uz_max": deep + back["uz_max"] + c.uneven * length * contrast(knobs),
            "contact_area": back["contact_area"],
            "contact_radius": back["contact_radius"],
            "slipping": np.minimum(SLIPPING_ERROR_SHARE * (step + result.channels["slipping"]), 1.0)
            * (knobs.friction > 0.0),
        }
    )


def distorted(settings: Settings, knobs: Knobs, result: Result) -> np.ndarray:
    """What elements distorted below a deep ball add to a force (k,), as a share of it:

    λ (0.4 + log₁₀ K/μ) (x − 3/2)³/80 beyond x = 3/2, x = (travel − w)/R, w what the body has `sunk`, λ by the level.
    Fitted to forces of an independent axisymmetric program of degree 4 (R = 3 mm on a sphere of 35 mm, x = 2 to 2.67,
    K/μ = 34 and 178: coarse and standard are 0.8 to 5.3 % too large), and to differences between levels elsewhere;
    benchmarks/axisymmetric.py, a second such program, agrees at x = 2 and has not been brought deeper.
    Of forces alone: what it does to other channels was not measured.  Nothing of a run with the element and the mesh of
    large strain that is compared with another.
    """
    c = calibration_of_run(settings, knobs)
    if settings.large_strain and result.coarser is not None:
        return np.zeros_like(result.travel)  # the other mesh tells
    x = (np.maximum(result.travel, 0.0) - sunk(settings, knobs, result)) / settings.indenter.length
    return (
        c.distorted
        * c.at(settings.level).distorts
        * (c.at_least + log_bulk_ratio(knobs))
        * np.maximum(x - c.deep, 0.0) ** 3
    )


def relaxation_step_error(settings: Settings, knobs: Knobs, result: Result) -> np.ndarray:
    """What steps leave (k,) N in the force of a body that relaxes: Σg |F| ds/s, and a share of the largest so far.

    By the first power of ds, see `newly`, as F ~ s^(3/2): at travel 1 and 2 mm in steps of 0.33 mm with g = 0.3 to 0.6,
    tau = 0.03 to 5 s.
    """
    now = RELAXATION_STEP_ERROR_SHARE * relaxed(settings, knobs) * newly(settings, result) * whole_force(result)
    return np.maximum(now, LINGERING_STEP_ERROR_SHARE * np.maximum.accumulate(now))


def recovering(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """What steps leave (k,) of displacements (mm) and of the contact (mm, mm²) of a body that relaxes, in unloading.

    As of the force, Σg ds/s of the largest so far, ds the longest step and s the deepest travel up to there: of the
    contact while there is one, of points once the ball has left them.  Under its weight a body creeps on the way there,
    too, where it does not move with the ball, by twice that.
    Beside twenty times as many steps, g = 0.3 to 0.6, tau = 0.05 to 5 s, to 1, 2 and 3 mm and back: 0.05 to 1.1 % of
    the deepest travel, up to 3 % of the largest radius and area (covered together with what the mesh states), 2 to 5 %
    of what a point has moved under the weight.
    """
    deepest = np.maximum.accumulate(result.travel)
    share = (
        RELAXATION_STEP_ERROR_SHARE
        * relaxed(settings, knobs)
        * longest_step_so_far(settings, result)
        / np.maximum(np.abs(deepest), 1e-300)
    )
    back, touched = result.travel < deepest, whole_force(result) > 0.0
    left = np.where(back & ~touched, share, 0.0)
    creeps = np.where(back & ~touched | (knobs.weight == 0.0), 0.0, WEIGHT_CREEP_FACTOR * share)
    largest = {n: np.maximum.accumulate(np.abs(v)) for n, v in result.channels.items()}
    out = {n: np.where(back & touched, share, 0.0) * largest[n] for n in ("contact_area", "contact_radius")}
    out["uz_max"] = left * largest["uz_max"]
    for name in map(profile_name, settings.profile):
        beside = 1.0 - np.clip(np.abs(result.channels[name]) / np.maximum(deepest, 1e-300), 0.0, 1.0)
        out[name] = (left + creeps * beside) * largest[name]
    return out


def relaxed(settings: Settings, knobs: Knobs) -> float:
    """Σg, the share of the stress that relaxes in the end."""
    return knobs.prony_g + knobs.prony_g2 + knobs.prony_g3 + sum(g for g, _ in settings.prony)


def sticking(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """What steps leave (k,) N of what friction takes of Fx and Fy: it grows from what touches first.

    By the root of ds/s: at (20, 0) in steps of 0.2 to 0.33 mm, beside steps of 0.02 to 0.04 mm, 0.1 to 0.7 % of the
    whole force at 0.2 mm and 0.1 % at 4 mm, friction 0.1 to 1, which takes a tenth to a fifth of it there.  Nothing of
    what slips: at most 0.05 % in three random experiments that slip, 0.2 to 0.9 % in three of four that stick.
    """
    step = STICKING_STEP_ERROR_SHARE * np.sqrt(newly(settings, result)) * (1.0 - result.channels["slipping"])
    return {n: step * held for n, held in taken(settings, knobs, result).items()}


def friction_creep(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """What the penalty of friction lets the surface creep after a ball that sticks: (k,) N of Fx and Fy.

    A spring ε_T πa² in a row with the surface's own 8Ga/(2 − ν) (Johnson 1985, §7.2; ν = 1/2): of what friction takes
    16 μ/(3π a ε_T) is missing, ε_T = 0.3 · 900 μ/R, on all levels; nothing of what slips.
    Measured at (20, 0), friction 0.4, with ten times ε_T: 2.1, 2.2, 1.8 and 1.1 times that at 0.5, 1, 2 and 4 mm.
    """
    a = np.maximum(result.channels["contact_radius"], 0.5 * settings.h0)
    share = (
        FRICTION_CREEP_FACTOR
        * 16.0
        / (3.0 * np.pi * TANGENTIAL_PENALTY_RATIO * modelling.BODY_PENALTY_RATIO)
        * settings.indenter.length
        / a
    )
    stuck = 1.0 - result.channels["slipping"]
    return {n: share * stuck * held for n, held in taken(settings, knobs, result).items()}


def taken(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """What friction takes (k,) N of Fx and Fy: ||F| n_i − F_i|, n normal to the body where the ball first touches."""
    out = {n: np.zeros_like(result.travel) for n in ("Fx", "Fy")}
    if knobs.friction:
        at = modelling.placement_of(settings, knobs)
        normal = at.rotation.T @ at.normal
        for n, along_n in zip(out, normal[:2], strict=True):
            if result.channels[n].any():  # else zero by symmetry
                out[n] = np.abs(along_n * whole_force(result) - result.channels[n])
    return out


def pressure_forces(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """Size (k,) N of the forces of the pressures: |F_i|, and of a lateral one what friction takes besides.

    Friction takes back what the pressures push the ball aside with, but not the error: at (20, 0) and 4 mm the levels
    coarse and fine differ by 0.0018 N of 0.150 (frictionless), 0.0014 of 0.077 (friction 0.1) and 0.0028 of 0.021 (0.4,
    stuck).
    """
    out = {n: np.abs(result.channels[n]) for n in FORCES}
    return out | {n: out[n] + held for n, held in taken(settings, knobs, result).items()}


def newly(settings: Settings, result: Result) -> np.ndarray:
    """ds/s (k,) at travel s, ds the longest step up to there."""
    ds = longest_step_so_far(settings, result)
    return ds / np.maximum(np.maximum(np.abs(result.travel), ds), 1e-300)


def longest_step_so_far(settings: Settings, result: Result) -> np.ndarray:
    """The longest step (k,) mm so far: asked travels may lie closer than the path's steps."""
    gap = np.abs(np.diff(result.travel, prepend=0.0))
    return np.maximum.accumulate(gap / np.maximum(np.ceil(gap / settings.control.path - 1e-9), 1.0))


def unresolved_contact(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """Least error (k,) N of the forces where the fitted contact is smaller than half an element: F h₀/a.

    F is the larger of what was found and the closed form's, as the ball may lie between the points of contact; a is the
    closed form's radius.  In the direction of the largest force.
    """
    at, size = result.channels, whole_force(result)
    K = 2.0 / knobs.D1
    H = settings.specimen.mean_curvature(*settings.point)
    E, nu = closed_forms.youngs_modulus(knobs.mu, K), closed_forms.poisson_ratio(knobs.mu, K)
    travel = np.maximum(result.travel, 0.0)
    small = settings.indenter.force(travel, H, E, nu)
    force = (size if small is None else np.maximum(size, small)) * (travel > 0.0)
    share = (
        calibration_of_run(settings, knobs).tiny
        * settings.h0
        / settings.indenter.contact_radius(np.maximum(travel, 1e-12), H)
        * (at["contact_radius"] < 0.5 * settings.h0)
    )
    return {n: along * share * force for n, along in directed(result).items()}


def at_depth(settings: Settings, depth: float, sticks: bool = False) -> float:
    """Share of the force that the mesh misses at a depth (mm), before any run, with a of the closed form.

    Of a nearly incompressible body at the top: that of `unresolved_contact` where a < h₀/2, else that of `columns` with
    3 % (h₀/a)² on every level (at 0.024 R coarse and standard are 8 % above Hertz, fine and reference 3 %).
    Of what may be solved on its meridian: 0.13 % f² + 35 % (h₀/a)², f the fineness, as of slabs and a half-space at 0.1
    to 1.5 R beside an independent program.
    """
    if not sticks:  # then contact is wider
        follow = contact_elements.shallow if on_axis(settings) else contact_elements.shallow_in_space
        settings = follow(settings, depth)
    h0 = element_size(settings, on_axis(settings))
    H = settings.specimen.mean_curvature(*settings.point)
    a = float(settings.indenter.contact_radius(np.array(max(depth, 1e-12)), H))
    if on_axis(settings):
        return float(min(1.3e-3 * settings.fineness**2 + COARSER_DIFFERENCE_SHARE * (h0 / a) ** 2, 1.0))
    c = calibration(settings, sticks)
    level = _of_level(settings, c)
    own, edge, stiff, _ = c.shares["force"]
    if a < 0.5 * h0:
        return float(min(c.inflated * c.tiny * h0 / a, 1.0))
    stiff *= float(decades_below(settings, np.array(a))) if c.only_in_space else 1.0
    shallow = (level if c.edge_by_level else 1.0) * edge if c.shallow is None else c.shallow
    return float(c.inflated * (level * (own + 2.0 * stiff) + shallow * (h0 / a) ** 2))


def directed(result: Result) -> dict[str, float]:
    """|F_i|/|F| of the largest force, so that what vanishes by symmetry stays exact; vertical where there is none."""
    size = whole_force(result)
    if not size.any():
        return {n: float(n == "Fz") for n in FORCES}
    k = int(np.argmax(size))
    return {n: float(abs(result.channels[n][k]) / size[k]) for n in FORCES}


def effective_radius(settings: Settings) -> float:
    """R* (mm) of ball and body where they touch, 1/R* = 1/R + H, H the mean curvature (Johnson 1985, eq. 4.3)."""
    return settings.indenter.effective_radius(settings.specimen.mean_curvature(*settings.point))


def whole_force(result: Result) -> np.ndarray:
    """|F| (k,) N."""
    return np.linalg.norm([result.channels[n] for n in FORCES], axis=0)


def surface_share(result: Result, name: str) -> np.ndarray:
    """q = |u|/travel (k,) of a surface point, at most 1: what touches the ball moves with it."""
    return np.clip(np.abs(result.channels[name]) / np.maximum(np.abs(result.travel), 1e-12), 0.0, 1.0)


def log_bulk_ratio(knobs: Knobs) -> float:
    """log₁₀ K/μ, at least 0."""
    return float(np.log10(max(2.0 / (knobs.D1 * knobs.mu), 1.0)))


def contrast(knobs: Knobs) -> float:
    """|ln of the skin's ratio|, 0 without a skin."""
    return abs(float(np.log(knobs.skin_ratio))) if knobs.skin_thickness > 0.0 else 0.0


def mixed_cell_factor(settings: Settings, knobs: Knobs) -> float:
    """Factor of what is missed at the edge of contact where elements hold skin and core: 1 + 1.7 |ln ratio| 4w(1 − w).

    w = t/2h₀, at most 1: nothing is missed of what is far thinner than an element, or thicker.
    """
    w = min(knobs.skin_thickness / (2.0 * settings.h0), 1.0)
    return 1.0 + calibration_of_run(settings, knobs).lumped * contrast(knobs) * 4.0 * w * (1.0 - w)


def layered(settings: Settings, knobs: Knobs) -> float:
    """Factor of what is missed at any depth: 1 + 7 ln(ratio) t/R, of a skin stiffer than the core.

    On grids 1 + 3 |ln ratio|, as elements below a small contact are longer than those at it.
    """
    if calibration_of_run(settings, knobs).only_in_space:
        return 1.0 + calibration_of_run(settings, knobs).layered * contrast(knobs)
    stiffer = contrast(knobs) * (knobs.skin_ratio > 1.0)
    return 1.0 + calibration_of_run(settings, knobs).layered * stiffer * min(
        knobs.skin_thickness / settings.indenter.length, 1.0
    )


def filmed(settings: Settings, knobs: Knobs, result: Result) -> np.ndarray:
    """What a stiff layer on a softer one adds to that factor (k,): φ (J^(2/3) − 1) min(a/t, 1).

    J is the largest ratio of a layer's modulus to that of what is below it, t (mm) how deep it reaches.  It bends as a
    film over many of its thicknesses: of J = 270, a/t = 1.7, coarse and standard miss 14 and 9 % of the force.
    """
    c, specimen = calibration_of_run(settings, knobs), settings.specimen.actual(knobs)
    if not isinstance(specimen, FlatTopped) or not specimen.layers:
        return np.zeros_like(result.travel)
    own = modelling.of_layers(settings, knobs) if any(specimen.laws) else ()
    rest = modelling.material(settings, knobs).shear_modulus
    moduli = [*specimen.ratios, 1.0]
    for k, (law, stuff) in enumerate(zip(specimen.laws, own, strict=False)):
        moduli[k] = stuff.shear_modulus / rest if law else moduli[k]
    down = np.cumsum([t for t, _ in specimen.layers])
    found = [(above / below, t) for above, below, t in zip(moduli[:-1], moduli[1:], down, strict=True)]
    return c.film * bent(*max(found), result)


def bent(ratio: float, thickness: float, result: Result) -> np.ndarray:
    """(J^(2/3) − 1) min(a/t, 1) of a layer or skin J times as stiff as what is below it, (k,); 0 of a soft one."""
    if thickness <= 0.0:
        return np.zeros_like(result.travel)
    wide = np.minimum(result.channels["contact_radius"] / thickness, 1.0)
    return (max(ratio, 1.0) ** (2.0 / 3.0) - 1.0) * wide


def sunk(settings: Settings, knobs: Knobs, result: Result) -> np.ndarray:
    """How far (k,) mm the body gives way as a whole on its support during the test; zero where it is held.

    w = travel · `sinking` · ((1 + W/F)^(2/3) − (W/F)^(2/3)), weight W, indenter and support carrying the same force by
    Hertz (Johnson 1985, eq. 4.23).
    """
    if not settings.support.loose:
        return np.zeros_like(result.travel)
    return np.abs(result.travel) * sinking(settings, knobs) * eased(settings, knobs, result)


def sinking(settings: Settings, knobs: Knobs) -> float:
    """The share of the travel by which a weightless body gives way as a whole on its support, at most 1."""
    return settings.support.sinking(settings.specimen, settings.indenter.length, knobs)


def eased(settings: Settings, knobs: Knobs, result: Result) -> np.ndarray:
    """(1 + W/F)^(2/3) − (W/F)^(2/3), (k,): what a heavy body sinks on its support over what a weightless one does."""
    force = np.maximum(whole_force(result), 1e-300)
    weight = knobs.weight * settings.specimen.volume() / force
    system = result.system
    if knobs.weight and knobs.cavity and system is not None and system.dead is not None:  # a hole has none
        weight *= np.linalg.norm(system.dead.sum(0)) / (knobs.weight * system.body.w.sum())
    return (1.0 + weight) ** (2.0 / 3.0) - weight ** (2.0 / 3.0)


def aslant(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """Columns (k, 2) N of Fx and Fy that pressures on the wrong slope add: m |F| (1, log₁₀ K/μ), m as in `columns`.

    A small lateral force is what is left of large pressures, the larger the less the body gives way in volume.  None
    where it is zero by symmetry.
    """
    size = mesh_factor(settings, knobs) * unreached(settings, knobs, result) * whole_force(result)
    parts = np.stack([size, size * log_bulk_ratio(knobs)], axis=-1)
    return {n: parts * result.channels[n].any() for n in ("Fx", "Fy")}


def columns(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """What the error of each channel grows with, (k, j) in its unit.

    Forces, area, radius, pressure: m · value · (1, (h₀/a)², log₁₀ K/μ), a the contact radius, h₀ the element size and m
    the `mesh_factor`; the value of a lateral force is that of `pressure_forces`.  An unconstrained body adds 3/2 F g/d
    to forces, d the travel, times what is `eased`: facets misplace the wall by a share of the clearance g, F ~ d^(3/2);
    d is at least what makes that the force itself. A skin adds to the first two, see `mixed_cell_factor` and `layered`.
    `uz_max`: (m h₀ (h₀/a)², d²/2R), the ball's lowest point as far beside the axis, R Fx/Fz, as it is beside a node, d.
    `bulge`: (m value, m travel, w), since it vanishes in a compressible body; w is what is `sunk` on its support, times
    what its elements there make of it.
    Surface points: (m g, m g log₁₀ K/μ, (4 q (1 − q))² h₀²/R, w), q = |u|/travel: what touches the ball moves with it.
    g = (1 − q) max(|u|, F/(4πμ max(r, a))), as a point load moves the surface (Johnson 1985, eq. 3.22b, ν = 1/2): a
    displacement may vanish, its error does not.  At the edge of contact, q = 1/2, the curvature 1/R ends in an element.

    A peak pressure below a layer or skin 4 to 40 times as stiff is off by 1 + √φ times as much, φ that of `bent`.

    On grids, whose elements follow the contact, (h₀/a)² has no m, and log₁₀ K/μ goes with `decades_below`.  `uz_max`
    has h₀²/R for h₀, `bulge` the root of value and travel for the value, and g the travel times a/max(r, a): the
    force on a layer says little of what lies beside.
    """
    at, mesh = result.channels, mesh_factor(settings, knobs) * unreached(settings, knobs, result)
    travel = np.maximum(np.abs(result.travel), 1e-12)
    size = whole_force(result)
    edge = mixed_cell_factor(settings, knobs) * (settings.h0 / np.maximum(at["contact_radius"], 0.5 * settings.h0)) ** 2
    stiff = np.full_like(travel, log_bulk_ratio(knobs))
    c, room = calibration_of_run(settings, knobs), settings.support.clearance(knobs)
    edge = edge if c.edge_by_level else edge / mesh
    if c.only_in_space:
        stiff = stiff * decades_below(settings, np.maximum(at["contact_radius"], 0.5 * settings.h0))
    shape = np.stack([np.ones_like(travel), edge, stiff], axis=-1)
    below = c.at(settings.level).below
    astray = c.shares["force"][3] * below * room  # no force is off by more than itself
    play = below * 1.5 * room / np.maximum(travel, 1.5 * astray)
    play = play * eased(settings, knobs, result)
    through, film = shape * [layered(settings, knobs), 1.0, 1.0], filmed(settings, knobs, result)
    through[:, 0] += film
    forces = np.concatenate([c.at(settings.level).extrapolated * mesh * through, play[:, None]], axis=-1)
    out = {n: size_n[:, None] * forces for n, size_n in pressure_forces(settings, knobs, result).items()}
    least = 0.5 * settings.h0 * (size > 0.0)  # a patch fitted over too few points may vanish
    radius = np.maximum(at["contact_radius"], least)
    hertz = 1.5 * size / np.maximum(np.pi * radius**2, 1e-300)
    floors = {"contact_area": np.pi * least**2, "contact_radius": least, "peak_pressure": hertz * (radius == least)}
    pull = knobs.adhesion / knobs.adhesion_range * (at["contact_area"] > 0.0)  # the peak is less than the ball presses
    for name, floor in floors.items():
        value, rough = at[name], 1.0
        if name == "peak_pressure":  # below a stiff layer or skin it goes from node to node
            skin = c.film * bent(knobs.skin_ratio, knobs.skin_thickness, result)
            value, rough = value + pull, 1.0 + np.sqrt(np.maximum(film, skin))
        out[name] = mesh * ((rough * np.maximum(value, floor))[:, None] * shape)
    beside = np.hypot(at["Fx"], at["Fy"]) / np.maximum(np.abs(at["Fz"]), 1e-300) * settings.indenter.length
    missed = np.minimum(beside, 0.25 * settings.h0) ** 2 / (2.0 * settings.indenter.length)
    flat = settings.h0 / settings.indenter.length if c.only_in_space else 1.0
    out["uz_max"] = np.stack([mesh * settings.h0 * flat * edge, missed], axis=-1)
    down = below * sunk(settings, knobs, result)
    risen, far = np.abs(at["bulge"]), np.abs(result.travel)
    out["bulge"] = np.stack([mesh * (np.sqrt(risen * far) if c.only_in_space else risen), mesh * far, down], axis=-1)
    for place in settings.profile:
        name = profile_name(place)
        q, r = surface_share(result, name), np.hypot(place[0] - settings.point[0], place[1] - settings.point[1])
        wide = np.maximum(at["contact_radius"], 0.5 * settings.h0)
        if c.only_in_space:  # the force on a thin layer says little of what moves beside it
            load = np.abs(result.travel) * wide / np.maximum(wide, r)
        else:
            load = size / (4.0 * np.pi * knobs.mu * np.maximum(wide, r))
        free = mesh * (1.0 - q) * np.maximum(np.abs(at[name]), load)
        kink = (4.0 * q * (1.0 - q)) ** 2 * settings.h0**2 / settings.indenter.length * stretched(settings, knobs)
        out[name] = np.stack([free, free * stiff, kink, down], axis=-1)
        for axis in "xy":  # beneath the indenter, too, a point may slide: nothing of it is given
            if (beside := at.get(profile_name(place, axis))) is not None and beside.any():
                free = mesh * np.maximum(np.abs(beside), load)
                out[profile_name(place, axis)] = np.stack([free, free * stiff, 0.0 * kink, 0.0 * free], axis=-1)
    return out


def decades_below(settings: Settings, radius: np.ndarray) -> np.ndarray:
    """log₁₀(1 + H/a) of contact radii a (k,) mm on a body of the height H: elements grow on the way down."""
    return np.log10(1.0 + settings.specimen.thickness_along(np.array([0.0, 0.0, -1.0])) / radius)


def calibration_kind(name: str) -> str:
    """Which shares of a calibration are those of a channel."""
    return "force" if name in FORCES else "uz" if name.startswith(("ux(", "uy(", "uz(")) else name
