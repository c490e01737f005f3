"""Hypotheses as tiles: the base model, every effect of the catalogue, pairs, and each with something unexplained."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rso.discrepancy.evidence.gaussian_mixture import TileFactors, Tiles, compressed
from rso.discrepancy.library.effects import Effect, Size
from rso.discrepancy.library.interpolation import grid_points, is_placed, timed
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.simulations import Base, BaseAxis
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import HELD_BRANCH, LOADING_BRANCH, UNLOADING_BRANCH, SurfaceProfile, TestPlan

BASE_TILES = {0: 1, 1: 11, 2: 5}  # on each base axis, by how many there are
SIZE_TILES = 8  # of an effect with one sign
SIZE_TILES_SIDE = 6  # per side of an effect with two signs
VARIANT_TILES = (18, 6)  # of another support, fewer for pairs: what a body does on it is far from linear
TILES_BESIDE_RELAXING = 3  # of every other axis there
RELAXING_TILES = 2, 4  # of the share and of the time of a base model that relaxes
MIN_TIME_TILES = 6  # of a time, at least
TIME_TILE_WIDTH_LN = 1.0  # in ln τ
PLACE_TILES = 5  # of where along a curve something sits
SUPPORT_TILES = 4  # of a shape of another support
SHAPE_TILES = 3  # of any other shape
TILES_LESS_FOR_PAIRS = 2  # of them for pairs
_TILE_STEP_SHARE = 0.35  # of a tile, for its derivative


@dataclass(frozen=True)
class Hypothesis:
    """Effects that are present: none is the base model; `unexplained` adds a smooth gap of no known cause."""

    effects: tuple[Effect, ...]
    unexplained: bool = False

    @property
    def name(self) -> str:
        """Names of the effects, joined; 'none' is the base model."""
        names = [e.name for e in self.effects] or ["none"]
        return " + ".join([*names, *(["unexplained"] if self.unexplained else [])])


@dataclass(frozen=True)
class _Levels:
    """Tile centres of one coordinate with log prior, width, and whether it moves in proportion."""

    at: np.ndarray
    log_prior: np.ndarray
    width: float
    log: bool


def tiles(
    library: Library, effects: Sequence[Effect], modulus: float, coarse: bool = False, base: Tiles | None = None
) -> Tiles:
    """Tiles of a hypothesis; priors are uniform over the base axes, ln |size| and shapes within plausible ranges.

    `coarse` takes fewer tiles per effect, for pairs; the basis spans the forces of `base` too.
    """
    kept = {j: v for j, a in enumerate(library.base.axes) if (v := _kept(a, modulus))}
    levels = []
    for j, a in enumerate(library.base.axes):
        shift = kept[j].slope * np.log(modulus) if j in kept else 0.0
        low, high = (kept[j].low + shift, kept[j].high + shift) if j in kept else a.ends
        levels.append(_even(max(low, a.ends[0]), min(high, a.ends[1]), _of_axis(library.base, a)))
    for e in effects:
        levels.append(_sizes(e, coarse))
        for s in e.shape:
            n = _times(s) if timed(s) else PLACE_TILES if is_placed(s) else SUPPORT_TILES if e.settings else SHAPE_TILES
            levels.append(_even(*s.ends()[0], n - (TILES_LESS_FOR_PAIRS if coarse and n > SHAPE_TILES else 0)))
    at = grid_points([v.at for v in levels])
    moduli = library.base.moduli(at)
    if moduli is not None:  # each tile has its modulus
        for j, shifted in kept.items():
            at[:, j] += shifted.slope * np.log(moduli / modulus)
    prior = np.array([sum(p) for p in itertools.product(*[v.log_prior for v in levels])])
    moving = [j for j, v in enumerate(levels) if v.width > 0]
    A, c = predict(library, effects, at, modulus)
    D = np.empty((len(at), len(moving), A.shape[1]))
    for k, j in enumerate(moving):
        level, ends = levels[j], []
        for sign in (-1, 1):
            moved = at.copy()
            step = sign * _TILE_STEP_SHARE * level.width
            moved[:, j] = at[:, j] * np.exp(step) if level.log else at[:, j] + step
            ends.append(predict(library, effects, moved, modulus))
        D[:, k] = ((ends[1][0] - ends[0][0]) + (ends[1][1] - ends[0][1]) / modulus) / (
            2 * _TILE_STEP_SHARE * level.width
        )
    sd = np.array([0.5 * levels[j].width for j in moving])
    along = library.base.tied
    own = Tiles(
        A,
        c,
        D,
        sd,
        at,
        prior,
        tuple(moving),
        tuple(levels[j].log for j in moving),
        moduli=moduli,
        tied=None if along is None else moving.index(along),
        kept={moving.index(j): v for j, v in kept.items()},
    )
    also = np.zeros((0, A.shape[1]))
    if base is not None:
        also = np.concatenate([base.lift(base.A), base.lift(base.c) / modulus])
    return compressed(own, list(blocks(library.plan).values()), also, modulus)


def _of_axis(base: Base, axis: BaseAxis) -> int:
    """Tiles of an axis of the base model: fewer of each, the more there are; of a share that relaxes, and its time."""
    if axis not in base.simulated:
        return RELAXING_TILES[axis.unit == "s"]
    return BASE_TILES[len(base.axes)] if len(base.axes) == len(base.simulated) else TILES_BESIDE_RELAXING


def blocks(plan: TestPlan) -> dict[tuple[int, str, int], np.ndarray]:
    """Rows of the data vector by place (−1: profiles), channel and branch."""
    found: dict[tuple[int, str, int], list[np.ndarray]] = {}
    for item, c, at in plan.rows():
        rows = np.arange(at.start, at.stop)
        for branch in (LOADING_BRANCH, UNLOADING_BRANCH, HELD_BRANCH):
            if isinstance(item, SurfaceProfile):
                mine, key = rows if branch == LOADING_BRANCH else rows[:0], (-1, c, LOADING_BRANCH)
            else:
                mine, key = rows[item.branch == branch], (item.place, c, branch)
            if len(mine):
                found.setdefault(key, []).append(mine)
    return {k: np.concatenate(v) for k, v in found.items()}


def _kept(axis: BaseAxis, modulus: float) -> TileFactors | None:
    """The range of a parameter itself; None where there is none, or where nothing of it was computed at a modulus."""
    if axis.kept is None:
        return None
    low, high = np.log(axis.kept)
    shift = -axis.exponent * np.log(modulus)
    if low + shift >= axis.ends[1] or high + shift <= axis.ends[0]:
        return None
    return TileFactors(-float(axis.exponent), float(low), float(high))


def _times(s: Size) -> int:
    """Tiles of a time: as narrow in a wide range as in the usual one."""
    low, high = s.ends()[0]
    return max(MIN_TIME_TILES, round((high - low) / TIME_TILE_WIDTH_LN))


def _even(low: float, high: float, n: int) -> _Levels:
    """n tiles of equal width from low to high."""
    width = (high - low) / n
    return _Levels(low + width * (np.arange(n) + 0.5), np.full(n, -np.log(n)), width, False)


def _sizes(effect: Effect, coarse: bool) -> _Levels:
    """Tiles of the size: even in ln |s| on each side of neutral, or over the range of a variant."""
    size = effect.size
    if size.neutral is None:
        if size.low == 0 and size.high == 1:  # a variant without a knob
            return _Levels(np.array([0.5]), np.zeros(1), 0.0, False)
        return _even(*size.ends()[0], VARIANT_TILES[coarse])
    found = []
    sides = size.ends()
    n = (SIZE_TILES if len(sides) == 1 else SIZE_TILES_SIDE) - (2 if coarse else 0)
    widths = []
    for near, far in sides:
        v = _even(np.log(abs(near)), np.log(abs(far)), n)
        found.append(np.copysign(np.exp(v.at), far))
        widths.append(v.width)
    at = np.concatenate(found)
    return _Levels(at, np.full(len(at), -np.log(len(at))), float(np.mean(widths)), True)
