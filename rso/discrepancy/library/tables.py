"""The library of a test plan: simulations of the base model and of every effect, once, and what they say in between.

    F_c(u) = μ [ f_c(u; κ) + f_z(u; κ) (δ_c(u) + ε_c(u)) ]

f is the base model over its reduced parameters κ, δ the relative change by an effect, computed at one κ and carried
to its sizes and shapes by cardinal weights, ε the step from the library's mesh to the study's.  Forces are over the
modulus, so that the modulus needs no simulation (exact similarity).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.interpolate import interp1d

from rso.contract.responses import FORCE_CHANNELS
from rso.core.curves import Resampling
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.interpolation import Nodes, cardinal, grid_points, is_placed, late, tensor, timed
from rso.discrepancy.library.planning import Sizes, framed, jobs_of_base, jobs_of_effects, key_of, simulated_effects
from rso.discrepancy.library.relaxation import dense, foreseen, is_relaxation
from rso.discrepancy.library.responses import (
    changed,
    forces_of,
    loading_forces,
    marks_of,
    reached_by,
    relative,
    rested,
)
from rso.discrepancy.library.simulations import (
    N_REST_MOMENTS,
    Base,
    LibraryJob,
    Pass,
    Rest,
    Run,
    nearest_pass,
    rests_at,
)
from rso.discrepancy.library.test_plan import TestPlan
from rso.evaluation.store import Done, Failed

EXPENSIVE_UNKNOWNS_RATIO = 3.0  # times the unknowns at the primary place, as a whole model has: runs there are few
# times the fewest unknowns: a model with fewer planes of symmetry, whose body is pushed aside
LESS_SYMMETRY_UNKNOWNS_RATIO = 1.3
MAX_CARRIED_CURVE_RATIO = 2.0  # times as large as at home: what the curve of an effect at another place may be at most
N_TABLE_TRAVELS = 160  # travels of the tables, evenly spaced in √u


class LibraryUnanswered(ValueError):
    """The base model has no answer where one is needed: there is nothing to compare with."""


@dataclass(frozen=True, eq=False)
class LibraryTable:
    """Relative changes (n_nodes, n_pass, 3, m) by an effect at a place, displacements of marks (n_nodes, n_uz).

    Of what flows `rests` (n_nodes, n_rest, 3, N_REST_MOMENTS) are the changes at the moments of rests, None of all
    others.
    """

    nodes: Nodes
    change: np.ndarray
    marks: np.ndarray
    known: np.ndarray
    rests: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class PlaceTables:
    """Everything computed at one place: travels `u` (m,), base forces f (n_base, 3, m), marks (n_base, n_uz).

    Relative to Fz of the base: `mesh` (3, m) the step to the study's mesh, `ways` (n_pass, 3, m) what the way of the
    indenter changes in the base model itself, `error` (3, m) the stated error.  `unknowns` of the base model on the
    study's mesh, 0 where the backend does not say.
    """

    u: np.ndarray
    passes: tuple[Pass, ...]
    base: np.ndarray
    base_marks: np.ndarray
    mesh: np.ndarray
    ways: np.ndarray
    error: np.ndarray
    effects: Mapping[str, LibraryTable]
    unknowns: int = 0
    rests: tuple[Rest, ...] = ()


@dataclass(frozen=True, eq=False)
class Library:
    """Tables by place, nodes of the base, primary place, and what could not be computed.

    `rubbing` are effects of the contact whose way matters.
    """

    base: Base
    plan: TestPlan
    levels: tuple[np.ndarray, ...]
    places: tuple[PlaceTables, ...]
    primary: int
    effects: tuple[Effect, ...]
    failed: tuple[str, ...]
    cpu_s: float
    runs: int
    slowest: float
    rubbing: frozenset[str] = frozenset()
    mended: Mapping[tuple[str, int], np.ndarray] = field(default_factory=dict)

    def home(self, effect: Effect) -> int:
        """Place whose nodes an effect is known at: the primary one, or the only one where it acts."""
        return _home(effect, self.plan, self.primary)

    def forces(self, place: int, x: np.ndarray) -> np.ndarray:
        """Base forces over the modulus (T, 3, m) at coordinates x (T, d)."""
        return np.tensordot(self.base_weights(x), self.places[place].base, axes=1)

    def marks(self, place: int, x: np.ndarray) -> np.ndarray:
        """Base displacements (T, n_uz)."""
        return self.base_weights(x) @ self.places[place].base_marks

    def weights(self, place: int, effect: Effect, at: np.ndarray, speed: float) -> np.ndarray:
        """(T, n): the changes at sizes and shapes `at` (T, 1 + d) in terms of those in the table of a place.

        Its rows are the nodes, then the points at which it was mended.
        """
        at = np.array(at, float) + late(effect, speed)
        nodes = self.places[place].effects[effect.name].nodes
        W = nodes.weights(at)
        points = self.mended.get((effect.name, place))
        return W if points is None else np.concatenate([W, nodes.nearness(at, points)], axis=1)

    def relaxed(self, place: int, effect: Effect, at: np.ndarray, speed: float) -> np.ndarray:
        """(T, n) as `weights`, for an effect with a time of its own that is over at once.

        A short time τ leaves what is of the order τ v / u: the parabola through the three shortest times computed, at
        none.
        """
        k = next(k for k, s in enumerate(effect.shape, 1) if timed(s))
        nodes = self.places[self.home(effect)].effects[effect.name].nodes
        shortest = nodes.levels[k][:: nodes.fine][:3]
        share, fast = cardinal(np.exp(shortest), np.zeros(1))[0], np.array(at, float)
        out = np.zeros(())
        for level, part in zip(shortest, share, strict=True):
            fast[:, k] = level - np.log(speed)
            out = out + part * self.weights(place, effect, fast, speed)
        return out

    def change(self, place: int, effect: Effect, at: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Relative changes (T, n_pass, 3, m) and changes of marks (T, n_uz) at sizes and shapes `at` (T, 1 + d)."""
        W, table = self.weights(place, effect, at, speed), self.places[place].effects[effect.name]
        return np.tensordot(W, table.change, axes=1), W @ table.marks

    def rested(self, place: int, effect: Effect, at: np.ndarray, speed: float) -> np.ndarray:
        """Relative changes (T, n_rest, 3, N_REST_MOMENTS) at the moments of rests by what flows, at sizes and shapes
        `at`."""
        rests = self.places[place].effects[effect.name].rests
        assert rests is not None  # of an effect that flows
        return np.tensordot(self.weights(place, effect, at, speed), rests, axes=1)

    def base_weights(self, x: np.ndarray) -> np.ndarray:
        """(T, n_base): the base model at coordinates x (T, d) in terms of its nodes, without what relaxes in it."""
        return tensor(self.levels, x[:, : len(self.levels)])


def _told(base: Base, job: LibraryJob) -> str:
    """The values of a run, and how its open parameters came by them: nobody stated a product of two ranges."""
    values = job.task.values
    each = [f"{base.modulus} = {base.reference:.4g}", *(f"{a.name} = {values[a.name]:.4g}" for a in base.simulated)]
    bound = [a.name for a in base.simulated if a.exponent]
    why = f"; low and high of {base.modulus} and of {' and '.join(bound)} are taken together" if bound else ""
    return f"{', '.join(dict.fromkeys(each))} (a library covers the ranges of [parameters]{why}: narrow them)"


def build_library(base: Base, plan: TestPlan, effects: Sequence[Effect], run: Run) -> Library:
    """Compute every table of the plan; a failed run leaves a gap that the nearest node of the same shape fills.

    Raises ValueError if the base model itself fails somewhere.
    """
    frame = framed(base, plan)
    primary, levels, few, every = frame.primary, frame.levels, frame.few, frame.every
    modelled = simulated_effects(base, effects)
    jobs = jobs_of_base(base, plan, frame)
    outcomes = run([j.task for j in jobs])
    unknowns = np.zeros(len(plan.places))
    for j, o in zip(jobs, outcomes, strict=True):
        if j.finer:
            continue
        if isinstance(o, Done):
            unknowns[j.place] = float(o.response.info.get("dofs", 0))
        elif j.passing is None:
            at = plan.places[j.place].settings.get("point")
            raise LibraryUnanswered(f"the base model has no answer at {at} with {_told(base, j)}: {o.reason}")
    dear = unknowns > EXPENSIVE_UNKNOWNS_RATIO * unknowns[primary]
    aside = (unknowns >= LESS_SYMMETRY_UNKNOWNS_RATIO * unknowns.min()) & ~dear
    grid, further, rubbing = jobs_of_effects(base, plan, modelled, frame, Sizes(dear, aside))
    jobs, outcomes = jobs + further, [*outcomes, *run([j.task for j in further])]
    different = {key_of(base, j): o for j, o in zip(jobs, outcomes, strict=True)}
    cpu = sum(float(o.response.info.get("cpu_s", 0.0)) for o in different.values() if isinstance(o, Done))
    failed = tuple(
        dict.fromkeys(
            f"{j.effect or 'base'} at {plan.places[j.place].settings.get('point', [0, 0])}: "
            f"{o.cause if isinstance(o, Failed) else 'crashed'}"
            for j, o in zip(jobs, outcomes, strict=True)
            if not isinstance(o, Done)
        )
    )
    found = {(j.place, j.effect, j.node, j.passing, j.finer): o for j, o in zip(jobs, outcomes, strict=True)}
    first = _tables(base, plan, primary, every[primary], modelled, grid, levels, found, primary)
    others = {
        k: _tables(base, plan, k, every[k], modelled, grid, few, found, primary)
        for k in range(len(plan.places))
        if k != primary
    }
    tables = tuple(first if k == primary else _beside(first, levels, few, others[k]) for k in range(len(plan.places)))
    home = {e.name: _home(e, plan, primary) for e in modelled}
    lost = {name for name, k in home.items() if not tables[k].effects[name].known.any()}
    if base.relaxing is not None and base.relaxing.effect.name in lost:
        raise LibraryUnanswered("the base model has no answer where it relaxes")
    carried = tuple(
        replace(
            here,
            effects={
                e.name: here.effects[e.name] if k == home[e.name] else _carried(e, tables[home[e.name]], here)
                for e in modelled
            },
        )
        for k, here in enumerate(tables)
    )
    return Library(
        base,
        plan,
        levels,
        carried,
        primary,
        tuple(e for e in effects if e.name not in lost),
        failed,
        cpu,
        len(different),
        frame.speeds[0],
        frozenset(rubbing),
    )


def _home(effect: Effect, plan: TestPlan, primary: int) -> int:
    """Index of the primary place, or of the only place where an effect acts if that is in the plan."""
    only = (k for k, p in enumerate(plan.places) if effect.place == p.settings)
    return primary if effect.place is None else next(only, primary)


def _tables(
    base: Base,
    plan: TestPlan,
    k: int,
    every: Sequence[Pass],
    modelled: Sequence[Effect],
    grid: Mapping[tuple[str, int], Nodes],
    levels: Sequence[np.ndarray],
    found: Mapping[tuple[Any, ...], Any],
    primary: int,
) -> PlaceTables:
    place, rests = plan.places[k], rests_at(plan, k)
    u = (np.linspace(0.0, np.sqrt(plan.reach(k)), N_TABLE_TRAVELS)) ** 2
    n_base = int(np.prod([len(v) for v in levels])) if levels else 1
    wanted = [found[k, None, n, None, False] for n in [*range(n_base), -1]]
    scaled = [loading_forces(o.response, u, base.reference) for o in wanted]
    scaled.pop()
    first = Resampling(*forces_of(wanted[-1].response, base.reference))
    mesh, error, ways = (
        np.zeros((3, N_TABLE_TRAVELS)),
        np.zeros((3, N_TABLE_TRAVELS)),
        np.zeros((len(every), 3, N_TABLE_TRAVELS)),
    )
    if (k, None, -1, 0, False) in found:  # the way matters to the base model itself
        each = [found[k, None, -1, i, False] for i in range(len(every))]
        ways, lost = changed(every, u, place, base.reference, each, first)
        if lost:
            raise LibraryUnanswered(f"the base model has no answer when unloading at {place.settings.get('point')}")
    best, unknowns = found.get((k, None, -1, None, True)), 0
    if isinstance(best, Done):
        unknowns = int(best.response.info.get("dofs", 0))
        travel, F = forces_of(best.response, base.reference)
        mesh = relative(travel, F - first(travel), first(travel)[:, 2], u)
        stated = np.stack([best.response.error.get(c, np.zeros(len(travel))) for c in FORCE_CHANNELS], 1)
        error = np.abs(relative(travel, stated / base.reference, first(travel)[:, 2], u))
    base_marks = np.stack([marks_of(o.response, place) for o in wanted])
    effects = {}
    for e in modelled:
        points, flowing = grid[e.name, k].points, rests if e.flows else ()
        resting = np.zeros((len(points), len(flowing), 3, N_REST_MOMENTS))
        change = np.zeros((len(points), len(every), 3, N_TABLE_TRAVELS))
        marks = np.zeros((len(points), base_marks.shape[1]))
        known = np.ones(len(points), bool)
        ahead = foreseen(u, first(u), points, every) if is_relaxation(e) else None
        for n in range(len(points)):
            whole = found.get((k, e.name, n, None, False))
            each = [found.get((k, e.name, n, i, False)) for i in range(len(every))] if whole is None else [whole]
            if None in each:  # not computed here
                known[n] = False
                continue
            likely = None if ahead is None else ahead[n]
            change[n], lost = changed(every, u, place, base.reference, each, first, likely)
            change[n] -= ways
            held = [found.get((k, e.name, n, len(every) + i, False)) for i in range(len(flowing))]
            resting[n], without = rested(flowing, base.reference, held, first)
            known[n] = lost + without == 0
            reached = reached_by(each[0], place.deepest)
            marks[n] = 0.0 if reached is None else marks_of(reached, place) - base_marks[-1]
        if ahead is not None:
            change = np.where(known[:, None, None, None], change - ahead, 0.0)
        rest = _filled(LibraryTable(grid[e.name, k], change, marks, known, resting if e.flows else None))
        effects[e.name] = rest if ahead is None else _densely(rest, dense(grid[e.name, primary]), u, first(u), every)
    return PlaceTables(u, tuple(every), np.stack(scaled), base_marks[:-1], mesh, ways, error, effects, unknowns, rests)


def _densely(rest: LibraryTable, nodes: Nodes, u: np.ndarray, base: np.ndarray, every: Sequence[Pass]) -> LibraryTable:
    """The table of an effect that relaxes: what is expected at dense `nodes`, and the `rest` that was computed at few.

    `base` (m, 3) are the forces without it.
    """
    W = rest.nodes.weights(nodes.points)
    change = np.tensordot(W, rest.change, axes=1) + foreseen(u, base, nodes.points, every)
    change[:, :, 2] = np.maximum(change[:, :, 2], -1.0)  # nothing pulls
    return LibraryTable(nodes, change, W @ rest.marks, np.full(len(W), rest.known.any()))


def _beside(
    first: PlaceTables, levels: Sequence[np.ndarray], few: Sequence[np.ndarray], own: PlaceTables
) -> PlaceTables:
    """Tables of another place at all levels of the base: its forces over Fz of the primary place vary slowly with κ."""
    every = grid_points(levels)
    W = tensor(few, every)
    at_few = np.tensordot(tensor(levels, grid_points(few)), first.base, axes=1)
    s = np.sqrt(np.minimum(own.u, first.u[-1]))
    normal = np.stack([np.interp(s, np.sqrt(first.u), f[2]) for f in first.base])
    normal_few = np.stack([np.interp(s, np.sqrt(first.u), f[2]) for f in at_few])
    ratio = own.base / np.maximum(normal_few, 1e-12)[:, None]
    ratio[..., 0] = ratio[..., 1]
    base = np.tensordot(W, ratio, axes=1) * normal[:, None]
    mesh, error = own.mesh, own.error
    if not mesh.any():  # no finer run there: what a finer mesh changes is much the same everywhere
        mesh, error = (np.stack([np.interp(s, np.sqrt(first.u), c) for c in v]) for v in (first.mesh, first.error))
    return replace(own, base=base, base_marks=W @ own.base_marks, mesh=mesh, error=error)


def _filled(table: LibraryTable) -> LibraryTable:
    """Failed nodes take the change of the nearest node that is known, in proportion to size."""
    if table.known.all() or not table.known.any():
        return table
    points, change, marks = table.nodes.points, table.change.copy(), table.marks.copy()
    resting = None if table.rests is None else table.rests.copy()
    spread = np.ptp(points, axis=0) + 1e-12
    for n in np.nonzero(~table.known)[0]:
        near = min(np.nonzero(table.known)[0], key=lambda j: np.sum(((points[j] - points[n]) / spread) ** 2))
        factor = points[n, 0] / points[near, 0] if table.nodes.anchored and points[near, 0] else 1.0
        change[n], marks[n] = factor * change[near], factor * marks[near]
        if resting is not None:
            resting[n] = factor * resting[near]
    return replace(table, change=change, marks=marks, rests=resting)


def _carried(effect: Effect, first: PlaceTables, own: PlaceTables) -> LibraryTable:
    """The table of an effect at another place, at the nodes P of its home, from the few nodes O computed there:

        δ(P) = R δ(O) + c [δ'(P) − R δ'(O)],    c = ⟨δ(O), δ'(O)⟩ / ⟨δ'(O), δ'(O)⟩

    δ' are changes at home and R the nodes P in terms of O (:func:`_transfer`).  What R leaves of the curve's shape is
    that of home, in the proportion c of both places, of every way and channel, by force.  What has a place of its own
    is not alike.
    """
    known, other = first.effects[effect.name], own.effects[effect.name]
    if other.nodes.fine > 1 or other.rests is not None:  # as dense as those
        return other
    R = _transfer(effect, known, other)
    change = np.tensordot(R, other.change, axes=1)
    if effect.place is None and not any(is_placed(s) for s in effect.shape):
        there = _along_ways(known.change, first, own)
        at = np.tensordot(known.nodes.weights(other.nodes.points), there, axes=1)
        force = own.base[:, 2].mean(axis=0)
        both, square = (np.sum(v * at * force**2, axis=(0, 3)) for v in (other.change, at))
        c = np.clip(both / np.maximum(square, 1e-300), 0.0, MAX_CARRIED_CURVE_RATIO)
        change = change + c[..., None] * (there - np.tensordot(R, at, axes=1))
    return LibraryTable(known.nodes, change, R @ other.marks, np.ones(len(R), bool))


def _along_ways(change: np.ndarray, first: PlaceTables, own: PlaceTables) -> np.ndarray:
    """Changes (n, n_pass, 3, m) of one place over the ways and travels of another.

    What a way matters to counts in shares of its peak, or of the earlier travel; nothing is known of ways back where
    home has none.
    """
    out = np.zeros((len(change), len(own.passes), 3, len(own.u)))
    for i, way in enumerate(own.passes):
        if all((way.peak is None) != (p.peak is None) for p in first.passes):
            continue
        j = nearest_pass(first.passes, way)
        matters = not np.allclose(change[:, j], change[:, 0], rtol=0, atol=1e-6)
        mine, theirs = (p.peak or p.earlier for p in (way, first.passes[j]))
        u = own.u * (theirs / mine if matters and mine and theirs else 1.0)
        at = np.sqrt(np.clip(u, first.u[0], first.u[-1]))
        out[:, i] = interp1d(np.sqrt(first.u), change[:, j])(at)
    return out


def _transfer(effect: Effect, primary: LibraryTable, other: LibraryTable) -> np.ndarray:
    """(n_primary, n_other): what each primary node is in terms of the nodes that the other place has too.

    Where an effect sits is read off between the other place's own nodes: what is below one point is beside another.
    """
    P, O = primary.nodes.points, other.nodes.points
    if effect.place is not None:  # it acts nowhere else
        return np.zeros((len(P), len(O)))
    curved = len(O) > 1 and O.shape[1] == 1 and (np.all(O[:, 0] > 0) or math.isinf(other.nodes.middle))
    if curved if other.nodes.anchored else len(O) == len(P):
        return other.nodes.weights(P)  # sizes enough of its own
    if not other.nodes.anchored:
        R = _likened(primary, P, O)
        return other.nodes.weights(P) if R is None else R
    where = [k for k, shape in enumerate(effect.shape, 1) if is_placed(shape)]
    levels = [other.nodes.levels[k] for k in where]
    share = tensor(levels, P[:, where])
    R = np.zeros((len(P), len(O)))
    for k, at in enumerate(grid_points(levels)):
        moved = P.copy()
        moved[:, where] = at
        mine = np.all(O[:, where] == at, axis=1)
        own = _likened(primary, moved, O[mine])
        R[:, mine] = share[:, k, None] * (_in_proportion(moved, O[mine]) if own is None else own)
    return R


def _likened(primary: LibraryTable, P: np.ndarray, O: np.ndarray) -> np.ndarray | None:
    """(n, m): sizes and shapes P (n, 1 + d) in terms of O (m, 1 + d) by least squares over the changes at the primary
    place; None where the effect does not show there."""
    nodes = primary.change.reshape(len(primary.change), -1)
    A, B = (primary.nodes.weights(at) @ nodes for at in (P, O))
    gram = B @ B.T
    if np.trace(gram) / len(O) < 1e-8 * A.shape[1]:  # below 1e-4: nothing to lean on
        return None
    return np.linalg.solve(gram + 1e-4 * np.trace(gram) / len(O) * np.eye(len(O)), B @ A.T).T


def _in_proportion(P: np.ndarray, O: np.ndarray) -> np.ndarray:
    """(n, m): each of P (n, 1 + d) as the nearest of O (m, 1 + d), of the same side if there is one, times its size."""
    spread = np.ptp(P[:, 1:], axis=0) + 1e-12
    R = np.zeros((len(P), len(O)))
    for i, p in enumerate(P):
        j = min(
            range(len(O)),
            key=lambda j: (
                np.sign(O[j, 0]) != np.sign(p[0]),
                np.sum(((O[j, 1:] - p[1:]) / spread) ** 2),
                abs(O[j, 0] - p[0]),
            ),
        )
        R[i, j] = p[0] / O[j, 0]
    return R
