"""Where: what each region of the data is off by, when the base model is fitted to all the others.

With T = C + J Λ Jᵀ (Λ the prior of what a re-fit can move, wide) the residual of region g given the others, k, is

    r_g|k = r_g − T_gk T_kk⁻¹ r_k,     V_g = T_gg − T_gk T_kk⁻¹ T_kg                   (leave-region-out, exact)

and its signed amplitude along the prediction F_g is  α_g = F_gᵀ V_g⁻¹ r_g|k / F_gᵀ V_g⁻¹ F_g.  The threshold is that of
the largest |z| of all regions under the base model (a maximum statistic: no region is favoured).  An experiment that is
odd among the others has no say in what its own regions or those of the others should be.

A region may be clearly off and yet hold little of the gap.  What a channel of an experiment holds of it is

    share_g ∝ Σ_{i∈g} e_i² / W_ii,     e = W C⁻¹ Δ,  Δ = f_H − f_0                          (W: readings alone)

the gap Δ as the chosen hypothesis sees it after both were fitted, less what gains and contacts take up (C: readings,
gains, contacts).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from rso.discrepancy.evidence.gaussian_mixture import Ready, log_tiles
from rso.discrepancy.library.test_plan import LOADING_BRANCH, UNLOADING_BRANCH, SurfaceProfile, Test, TestPlan

# parts of the way there and of the way back, each of which is looked at by itself
DEPTH_BINS = {LOADING_BRANCH: 3, UNLOADING_BRANCH: 2}
TIME_BINS = 2  # of a hold, in the logarithm of time
BRANCH_NAMES = {LOADING_BRANCH: "loading", UNLOADING_BRANCH: "unloading"}
N_LOCALISATION_DRAWS = 2000  # of all deviations without a gap: the largest of each tells what is beyond chance
N_FIRST_CHANNELS = 4  # that hold most of a gap: their strongest regions come first
VANISHING_FORCE_SHARE = 1e-3  # of the largest force: what a model has only by its mesh
_FREE_TILE_SPREAD_RATIO = 20.0  # times the spread of a tile: a re-fit moves where it wants


@dataclass(frozen=True)
class Region:
    """A part of an experiment: its name, rows of the data vector, signed z and relative amplitude.

    `share` is what its channel of the experiment holds of the gap.  Where a model has no force of its own (lateral ones
    vanish by symmetry) the amplitude is `of_largest`, one of the largest force of all.
    """

    experiment: str
    channel: str
    region: str
    rows: tuple[int, ...]
    z: float
    amplitude: float
    amplitude_sd: float
    of_largest: bool = False
    share: float = 0.0


@dataclass(frozen=True)
class Where:
    """Regions, and the |z| that the largest of all reaches in 5 % of data sets without a gap.

    Of a gap first the strongest region of each of the N_FIRST_CHANNELS channels that hold most of it, then all others
    by |z|.
    """

    regions: tuple[Region, ...]
    threshold: float


def localise(plan: TestPlan, h: Ready, C: np.ndarray, y: np.ndarray, seed: int, odd: str | None = None) -> Where:
    """Regions of the plan under hypothesis `h` (the base model) for data y (n,); `odd` is an experiment's name."""
    t = int(np.argmax(log_tiles(h, h.white(y)[None])[0]))
    X = np.concatenate([h.tiles.A[:, None], h.tiles.D], axis=1) * h.scale
    J, c = (h.tiles.lift(v[t]) for v in h.tiles.linear(X, h.tiles.c, h.scale))
    Λ = h.tiles.spread(1e4, _FREE_TILE_SPREAD_RATIO * h.tiles.sd)
    T = C + (J.T * Λ) @ J
    F = c + (J[0] if h.tiles.moduli is None else 0.0)
    rng = np.random.default_rng(seed)
    draws = np.linalg.cholesky(T) @ rng.standard_normal((len(y), N_LOCALISATION_DRAWS))
    R = np.concatenate([(y - F)[:, None], draws], axis=1)
    apart = experiment_rows(plan, odd)
    found, largest = [], np.zeros(N_LOCALISATION_DRAWS)
    for experiment, channel, name, rows in _regions(plan):
        pattern, of_largest = F[rows], False
        if channel in ("Fx", "Fy") and np.max(np.abs(pattern)) < VANISHING_FORCE_SHARE * np.max(np.abs(F)):
            pattern, of_largest = np.full(len(rows), np.max(np.abs(F))), True
        others = np.setdiff1d(np.arange(len(y)), np.concatenate([rows, apart]))
        B = T[np.ix_(rows, others)]
        W = cho_solve(cho_factor(T[np.ix_(others, others)]), B.T).T  # T_gk T_kk⁻¹
        S = np.linalg.inv(T[np.ix_(rows, rows)] - W @ B.T)
        weight = pattern @ S @ pattern  # inverse variance of the amplitude
        z = pattern @ S @ (R[rows] - W @ R[others]) / np.sqrt(weight)
        largest = np.maximum(largest, np.abs(z[1:]))
        found.append(
            Region(
                experiment,
                channel,
                name,
                tuple(int(i) for i in rows),
                float(z[0]),
                float(z[0] / np.sqrt(weight)),
                float(1 / np.sqrt(weight)),
                of_largest,
            )
        )
    found.sort(key=lambda g: -abs(g.z))
    return Where(tuple(found), float(np.quantile(largest, 0.95)))


def experiment_rows(plan: TestPlan, experiment: str | None) -> np.ndarray:
    """Rows (m,) of the data vector that an experiment has."""
    rows = [
        np.arange(at.start, at.stop)
        for item, _, at in plan.rows()
        if plan.experiments[item.experiment].name == experiment
    ]
    return np.concatenate(rows) if rows else np.zeros(0, int)


def shared(where: Where, plan: TestPlan, gap: np.ndarray, C: np.ndarray, W: np.ndarray) -> Where:
    """The regions with the shares of a gap (n,), C (n, n) its noise and W (n,) the variance of readings alone."""
    e = W * np.linalg.solve(C, gap)
    held: dict[tuple[str, str], float] = {}
    for item, c, at in plan.rows():
        key = (plan.experiments[item.experiment].name, c)
        held[key] = held.get(key, 0.0) + float(np.sum(e[at] ** 2 / W[at]))
    whole = sum(held.values())
    if whole <= 0.0:
        return where
    regions = [replace(g, share=held[g.experiment, g.channel] / whole) for g in where.regions]
    strongest: dict[tuple[str, str], Region] = {}
    for g in regions:
        strongest.setdefault((g.experiment, g.channel), g)
    first = sorted(strongest.values(), key=lambda g: -g.share)[:N_FIRST_CHANNELS]
    return replace(where, regions=(*first, *(g for g in regions if g not in first)))


def _regions(plan: TestPlan) -> Iterator[tuple[str, str, str, np.ndarray]]:
    """(experiment, channel, words, rows): repeats of an experiment together, in bins of depth or, held, of time."""
    groups: dict[tuple[int, str], list[tuple[Test | SurfaceProfile, slice]]] = {}
    for item, c, at in plan.rows():
        groups.setdefault((item.experiment, c), []).append((item, at))
    for (k, c), members in groups.items():
        name = plan.experiments[k].name
        depth = np.concatenate([m.depth for m, _ in members])
        rows = np.concatenate([np.arange(at.start, at.stop) for _, at in members])
        if isinstance(members[0][0], SurfaceProfile):
            for d in sorted({plan.near(v) for v in depth}):
                yield name, c, f"profile at {d:g} mm", rows[np.abs(depth - d) < 0.06 * plan.scale]
            continue
        tests = [m for m, _ in members if isinstance(m, Test)]  # a channel is of tests or of profiles
        branch = np.concatenate([t.branch for t in tests])
        deepest = float(depth.max())
        digits = max(1, 1 - math.floor(math.log10(plan.scale)))
        for b, bins in DEPTH_BINS.items():
            edges = np.linspace(0.0, deepest, bins + 1)
            for low, high in itertools.pairwise(edges):
                inside = (branch == b) & (depth > low - (low == 0) * 1e3) & (depth <= high)
                if inside.sum() >= 2:
                    yield name, c, f"{BRANCH_NAMES[b]} {low:.{digits}f}–{high:.{digits}f} mm", rows[inside]
        held, since = (np.concatenate([getattr(t, k) for t in tests]) for k in ("held", "since"))
        if held.any():
            edges = np.geomspace(since[held].min(), since[held].max(), TIME_BINS + 1)
            for k, (low, high) in enumerate(itertools.pairwise(edges)):
                inside = held & (since > low * (k > 0)) & (since <= high)
                if inside.sum() >= 2:
                    yield name, c, f"held {low:.2g}–{high:.2g} s", rows[inside]
