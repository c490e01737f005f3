"""Force curves of the finite element model, as a table over μD₁: what the norms of the thesis were measured against.

Similarity (neo-Hookean, no weight, Coulomb friction) makes F = μ f(μD₁, u): for one support a few runs are enough for
every (μ, D₁) of the thesis.  The runs are kept in a store, so that the next call reads them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme
from rso.core.curves import Resampling
from rso.evaluation import Done, Source, Task, WorkerPool, run_all
from rso.evaluation.store import RunStore

MU = 0.01  # MPa at which the table is computed
# μD₁ of the thesis's simulations lies between 0.0065 and 1.95; the force bends where K/μ = 2/μD₁ is not large.
BEND = 0.1
NODES = tuple(float(v) for v in np.round(np.geomspace(0.006 + BEND, 2.0 + BEND, 6) - BEND, 4))
FEW = (NODES[0], NODES[3], NODES[-1])  # enough for the ratio of two clearances
CLEARANCES = (0.25, 0.5, 1.0, 2.0)  # mm, "slightly larger" than the body is all that is said
MIDDLE = 1.0  # mm
FRICTION = 0.2  # bowl and body, of the thesis
TRAVEL = (0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.3, 1.6, 2.0, 2.4, 2.8, 3.2, 3.6, 4.0)  # mm


@dataclass(frozen=True)
class Support:
    """The lower half held (`clearance` None), or a bowl larger by `clearance` mm."""

    clearance: float | None = None

    def __str__(self) -> str:
        return "held" if self.clearance is None else f"bowl {self.clearance:g} mm"


HELD, BOWLS = Support(), tuple(Support(c) for c in CLEARANCES)
Run = tuple[Support, float, float]  # support, μD₁, friction of the bowl


def travel_of(deepest: float) -> tuple[float, ...]:
    """Depths (mm) at which a run answers."""
    return TRAVEL if deepest <= TRAVEL[-1] else (*TRAVEL, *np.arange(4.5, deepest + 0.1, 0.5).tolist())


def task(run: Run, deepest: float, level: str, shaft: bool) -> Task:
    """The test of the thesis in the middle, no weight, no friction at the ball."""
    support, product, friction = run
    settings = {
        "specimen": {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]},
        "indenter": {"shape": "sphere", "radius": 3.0, "shaft": shaft},
        "support": {"kind": "fixed" if support.clearance is None else "bowl"},
        "material": {"law": "neo_hookean"},
        "mesh": {"level": level},
    }
    bowl = {} if support.clearance is None else {"bowl_clearance": support.clearance, "bowl_friction": friction}
    case = Case(str(support), Programme.ramp(travel_of(deepest)), settings)
    return Task({"mu": MU, "D1": product / MU, **bowl}, case)


def simulate(
    folder: Path, wanted: Sequence[Run], deepest: float = 4.0, level: str = "coarse", jobs: int = 1, shaft: bool = True
) -> dict[Run, Resampling]:
    """F/μ (mm²) over travel of each run that has an answer; what the store in `folder` holds is not computed again."""
    tasks = [task(w, deepest, level, shaft) for w in wanted]
    with RunStore(folder) as store, WorkerPool(jobs, source=Source("fem_backend.backend:BACKEND")) as pool:
        outcomes = run_all(BACKEND, tasks, store, pool)
    curves = {w: o.response.curve("Fz") for w, o in zip(wanted, outcomes, strict=True) if isinstance(o, Done)}
    return {w: Resampling(c.travel_mm, c.value / MU) for w, c in curves.items()}


@dataclass(frozen=True, eq=False)
class Table:
    """F/μ (mm²) of one support on the depths `u` (n,): `force` (k, n) at the nodes (k,) of μD₁."""

    nodes: np.ndarray
    u: np.ndarray
    force: np.ndarray

    def __call__(self, product: np.ndarray) -> np.ndarray:
        """F/μ (m, n) at μD₁ (m,), by a cubic through ln F over ln(μD₁ + 0.1)."""
        x = np.log(self.nodes + BEND)
        return np.exp(CubicSpline(x, np.log(self.force))(np.log(np.asarray(product) + BEND)))


def tables(folder: Path, u: np.ndarray, jobs: int = 1) -> dict[Support, Table]:
    """A table for the held body and for every clearance on depths u (n,) > 0.

    Friction in the bowl is left out (see `friction_matters`).  At the other clearances the ratio to the middle one
    is quadratic in ln(μD₁ + 0.1).  Raises ValueError where a run has no answer.
    """
    middle = Support(MIDDLE)
    wanted = [(s, p, 0.0) for s in (middle, HELD) for p in NODES]
    wanted += [(s, p, 0.0) for s in BOWLS if s != middle for p in FEW]
    found = simulate(folder, wanted, jobs=jobs)
    if lost := [w for w in wanted if w not in found]:
        raise ValueError(f"no answer at {lost}")
    nodes = np.array(NODES)
    out = {s: Table(nodes, u, np.array([found[s, p, 0.0](u) for p in NODES])) for s in (middle, HELD)}
    x = np.log(nodes + BEND)
    for s in BOWLS:
        if s != middle:
            ratio = np.array([np.log(found[s, p, 0.0](u) / found[middle, p, 0.0](u)) for p in FEW])
            bent = np.array([np.polynomial.Polynomial.fit(np.log(np.array(FEW) + BEND), r, 2)(x) for r in ratio.T]).T
            out[s] = Table(nodes, u, out[middle].force * np.exp(bent))
    return out


def friction_matters(folder: Path, u: np.ndarray, jobs: int = 1) -> np.ndarray:
    """Relative change (n,) of the force by the thesis's friction of 0.2 in the bowl, at one μD₁ and clearance."""
    runs = [(Support(MIDDLE), NODES[3], friction) for friction in (FRICTION, 0.0)]
    found = simulate(folder, runs, jobs=jobs)
    return found[runs[0]](u) / found[runs[1]](u) - 1.0 if len(found) == 2 else np.full(len(u), np.nan)


GRID = np.arange(0.05, 4.0001, 0.05)  # mm
ROUGH = 0.35  # mm: above, the contact has enough points
DEEPEST_PENETRATION = 0.2  # mm
LEVEL_SD, TILT_SD = 0.012, 0.02  # two finite element codes and their meshes differ by about this in force


@dataclass(frozen=True, eq=False)
class Simulations:
    """Curves of sets (μ, D₁) (k, 2) at depths u (n,), as the thesis may have computed them, for nuisances ν (w, q).

    F = (1 + g + h (1 − u/u_n)) μ f(u − δ), δ = a (f/f(u_n))^q: level g and tilt h, by which two codes and their meshes
    differ; a contact penetration with a in 0-0.2 mm, q in 0-1; and in a bowl the clearance, 0.25-2 mm, cubic in its
    logarithm.  ν are standard normal: g/1.2 %, h/2 %, a, q, clearance (by Φ).  f/u^1.5 is continued in a straight line
    below 0.35 mm, where few points of a mesh touch.
    """

    theta: np.ndarray
    u: np.ndarray
    tables: Sequence[Table]  # one (held), or one per clearance

    @property
    def nuisances(self) -> int:
        """4, and 5 in a bowl."""
        return 4 + (len(self.tables) > 1)

    @cached_property
    def _flat(self) -> np.ndarray:
        """f/u^1.5 (c, k, grid) for every clearance and set."""
        out = []
        for table in self.tables:
            g = table(np.prod(self.theta, axis=1)) / table.u**1.5
            deep = table.u >= ROUGH
            near = deep & (table.u <= 2.5 * ROUGH)
            line = np.polynomial.polynomial.polyfit(table.u[near], g[:, near].T, 1)
            out.append(np.where(deep, g, (line[0][:, None] + line[1][:, None] * table.u)))
        return np.array(out)

    def __call__(self, nuisances: np.ndarray) -> np.ndarray:
        """Forces (w, k, n) in N."""
        ν = np.atleast_2d(nuisances)
        u, grid = self.u, self.tables[0].u
        level = 1.0 + LEVEL_SD * ν[:, :1] + TILT_SD * ν[:, 1:2] * (1.0 - u / u[-1])
        a, q = DEEPEST_PENETRATION * ndtr(ν[:, 2]), ndtr(ν[:, 3])
        g = self._flat[0][None] if len(self.tables) == 1 else np.einsum("wc,ckn->wkn", self._share(ν[:, 4]), self._flat)
        f = _interpolated(g, grid, np.broadcast_to(u, (len(ν), len(self.theta), len(u)))) * u**1.5
        end = g[..., -1:] * grid[-1] ** 1.5
        at = np.maximum(u - a[:, None, None] * (f / end) ** q[:, None, None], 0.0)
        return level[:, None] * self.theta[:, :1] * _interpolated(g, grid, at) * at**1.5

    def clearance(self, x: np.ndarray) -> np.ndarray:
        """Clearance (w,) in mm of its coordinate."""
        low, high = np.log(CLEARANCES[0]), np.log(CLEARANCES[-1])
        return np.exp(low + (high - low) * ndtr(x))

    def _share(self, x: np.ndarray) -> np.ndarray:
        """Lagrange's polynomials (w, c) of the clearances."""
        x, nodes = np.log(self.clearance(x)), np.log(CLEARANCES)
        every = range(len(nodes))
        others = [[(x - nodes[j]) / (nodes[i] - nodes[j]) for j in every if j != i] for i in every]
        return np.prod(np.array(others), axis=1).T


def _interpolated(y: np.ndarray, grid: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Straight lines through y (w or 1, k, grid) on an even grid, at (w, k, n); continued beyond its ends."""
    t = (at - grid[0]) / (grid[1] - grid[0])
    i = np.clip(t.astype(int), 0, len(grid) - 2)
    y = np.broadcast_to(y, (len(at), *y.shape[1:]))
    low, high = np.take_along_axis(y, i, -1), np.take_along_axis(y, i + 1, -1)
    return low + (t - i) * (high - low)
