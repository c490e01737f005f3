"""The set of parameters that meets the targets, what shape it has, and candidates worth verifying."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import cdist, pdist, squareform

from rso.core.units import spaced
from rso.doe import Box, sobol_sequence
from rso.optimise.acceptable import Goal, approach, grow
from rso.optimise.basins import basins
from rso.optimise.nsga2 import Front, Function, bounds, into_box
from rso.optimise.targets import Target

Kind = Literal["valley", "islands", "front", "single"]

N_APPROACHING_POINTS = 1024  # points from which the acceptable set is approached


@dataclass(frozen=True, eq=False)
class Choice:
    """Candidates X (count, d) with signed residuals (count, m), and the shape of the set that meets the targets.

    kind: 'valley' (the acceptable set is long: the targets leave a direction open), 'islands' (several
    separate solutions), 'front' (distinct compromises), 'single' (one point). `lowest` and `highest` (d,)
    bound the acceptable set, or the candidates where nothing is acceptable (`reachable` False). `together`
    lists pairs of parameters that move with (+1) or against (−1) each other along the set.
    """

    X: np.ndarray
    residual: np.ndarray
    tolerance: np.ndarray
    kind: Kind
    reachable: bool
    feasible: bool
    lowest: np.ndarray
    highest: np.ndarray
    together: tuple[tuple[int, int, int], ...]
    asked: int

    @property
    def F(self) -> np.ndarray:
        """Objectives |residual| (count, m)."""
        return np.abs(self.residual)

    @property
    def extent(self) -> np.ndarray:
        """Length (d,) of the acceptable set along each axis of the cube."""
        return self.highest - self.lowest


def choose_candidates(
    front: Front,
    residuals: Function,
    tolerance: np.ndarray,
    *,
    seed: int,
    violations: Function | None = None,
    count: int = 3,
    low: np.ndarray | None = None,
    high: np.ndarray | None = None,
    distinct: float = 0.01,
    long: float = 0.2,
) -> Choice:
    """Up to `count` candidates from the acceptable set {x: |r_j(x)| <= tolerance_j, no violation} or its neighbourhood.

    residuals(X) (n, m) is signed, predicted − target. A Sobol sample of the box, its basins and the front are moved
    to the acceptable set by shortest Gauss–Newton steps, each only as far as needed, so that they cover it. If a
    connected piece of it is longer than `long` along an axis of the cube it is a valley: the candidates are a
    central point that hits the targets and then points as far apart as possible. Otherwise they are the
    point with the smallest max |r|/tolerance and then the extremes of the front. Candidates are at least
    `distinct` apart; fewer than `count` come back where no more exist.
    """
    d = front.X.shape[1]
    low, high, free = bounds(d, low, high)
    tolerance = np.asarray(tolerance, float)
    if count < 1 or not np.all(tolerance > 0):
        raise ValueError(f"choose: needs count >= 1 and tolerances > 0, got {count} and {tolerance}")
    goal, pool = Goal(residuals, violations, tolerance, low, high), front.X
    if free.any():
        narrow = basins(lambda U: goal.judge(into_box(U, low, high, free))[1], int(free.sum()), seed)
        U = np.vstack([sobol_sequence(int(free.sum()), N_APPROACHING_POINTS, seed), narrow])
        pool = np.vstack([pool, into_box(U, low, high, free)])
    spread = approach(pool, goal, 0.95)
    if not len(spread):
        raise ValueError("choose: no residual is finite anywhere in the box")
    spread = grow(spread, goal, 0.95, np.random.default_rng(seed))
    everything = np.vstack([pool, spread, approach(spread, goal, 0.0)])
    r, score, v = goal.judge(everything)
    finite = np.isfinite(r).all(axis=1) & np.isfinite(v)
    everything, r, score, v = everything[finite], r[finite], score[finite], v[finite]
    permitted = v <= 0 if np.any(v <= 0) else v <= v.min()
    good = (score <= 1) & (v <= 0)
    if not good.any():
        at = (everything[permitted], r[permitted], score[permitted])
        return _unreachable(*at, bool(np.any(v <= 0)), tolerance, front, count, distinct)
    A, s = everything[good], score[good]
    pieces, longest = _pieces(A)
    lowest, highest = A.min(axis=0), A.max(axis=0)
    kind: Kind
    if longest >= long or pieces > 1:
        kind = "valley" if longest >= long else "islands"
        X = A[_spread_out(A, _central(A, s), count, distinct)]
        X = _polished(X, goal)
    else:
        onfront = cdist(A, front.X).min(axis=1) == 0
        X = A[_compromises(A, s, np.abs(r[good]), onfront, count, distinct)]
        kind = "front" if len(X) > 1 else "single"
    return Choice(X, residuals(X), tolerance, kind, True, True, lowest, highest, _together(A, long), count)


def choice_sentences(choice: Choice, box: Box, targets: Sequence[Target]) -> str:
    """What was found, in one to four sentences with physical values and units."""
    if not choice.feasible:
        return "No point of the ranges respects every constraint; the candidate violates them least."
    n = len(choice.X)
    ends = zip(box.names, box.from_unit(choice.lowest), box.from_unit(choice.highest), box.units, strict=True)
    ranges = ", ".join(f"{name} from {a:.4g} to {b:.4g}{spaced(u)}" for name, a, b, u in ends)
    allowed = zip(targets, choice.tolerance, strict=True)
    within = " and ".join(f"{t} within ±{tol:.3g}{spaced(t.unit)}" for t, tol in allowed)
    if not choice.reachable:
        signed = zip(targets, choice.residual[0], choice.tolerance, strict=True)
        misses = ", ".join(f"{t} by {r:+.3g}{spaced(t.unit)}" for t, r, tol in signed if abs(r) > tol)
        text = "The targets are not reachable inside the ranges: "
        text += f"the best compromise misses {misses} (predicted − target)."
    elif choice.kind == "valley":
        pairs = [f"{box.names[i]} {'up' if g > 0 else 'down'} as {box.names[j]} goes up" for i, j, g in choice.together]
        text = f"A valley: many parameter sets hit {within}, with {ranges}" + (
            f" ({'; '.join(pairs)})" if pairs else ""
        )
        text += (
            ". These targets do not determine them; the candidates are one in the middle of the valley, the "
            "others towards its ends."
        )
    elif choice.kind == "islands":
        text = f"Several separate parameter sets hit {within}, with {ranges}."
    else:
        text = f"One compact set of parameters hits {within}: {ranges}."
    if n < choice.asked:
        text += f" Only {n} of {choice.asked} requested candidates {'is' if n == 1 else 'are'} distinct."
    return text


def _pieces(A: np.ndarray) -> tuple[int, float]:
    """Number of connected pieces of the acceptable points, and the longest side of the box around any of them."""
    A = np.unique(np.round(A, 9), axis=0)
    A = A[:: len(A) // 1000 + 1]
    if len(A) < 2:
        return 1, 0.0
    tree = linkage(pdist(A), "single")  # the edges of a minimum spanning tree, without sorting all pairs
    # A gap is an edge far longer than the usual distance between neighbours in the sample.
    gap = max(0.1, 5 * float(np.median(tree[:, 2])))
    label = fcluster(tree, gap, "distance")
    return int(label.max()), max(float(np.ptp(A[label == k], axis=0).max()) for k in np.unique(label))


def _polished(X: np.ndarray, goal: Goal) -> np.ndarray:
    """Exact hits instead of near ones, where they lie close by.

    Along a valley that the tolerance alone makes (as many targets as parameters) the only exact hit is one
    point, to which all candidates would collapse: they stay where they are.
    """
    exact = approach(X, goal, 0.0)
    apart = squareform(pdist(X)) + np.where(np.eye(len(X)) > 0, np.inf, 0.0)
    near = np.linalg.norm(exact - X, axis=1) <= 0.25 * apart.min(axis=1)
    _, score, violation = goal.judge(exact)
    better = near & (violation <= 0) & (score <= goal.judge(X)[1])
    return np.where(better[:, None], exact, X)


def _central(A: np.ndarray, score: np.ndarray) -> int:
    """Among the points that hit the targets (nearly) exactly, the one closest to all the others."""
    exact = np.flatnonzero(score <= max(0.05, score.min()))
    return int(exact[cdist(A[exact], A).sum(axis=1).argmin()])


def _spread_out(A: np.ndarray, first: int, count: int, distinct: float, picks: list[int] | None = None) -> list[int]:
    picks = [first] if picks is None else list(picks)
    gap = cdist(A, A[picks]).min(axis=1)
    while len(picks) < count and gap.max() >= distinct:
        picks.append(int(gap.argmax()))
        gap = np.minimum(gap, np.linalg.norm(A - A[picks[-1]], axis=1))
    return picks


def _compromises(
    A: np.ndarray, score: np.ndarray, F: np.ndarray, onfront: np.ndarray, count: int, distinct: float
) -> list[int]:
    """Best compromise, then the best of each objective on the front, then whatever is farthest."""
    picks = [int(score.argmin())]
    front = np.flatnonzero(onfront)
    for j in range(F.shape[1] if len(front) else 0):
        extreme = int(front[F[front, j].argmin()])
        if len(picks) < count and np.linalg.norm(A[picks] - A[extreme], axis=1).min() >= distinct:
            picks.append(extreme)
    return _spread_out(A, picks[0], count, distinct, picks)


def _unreachable(
    X: np.ndarray,
    r: np.ndarray,
    score: np.ndarray,
    feasible: bool,
    tolerance: np.ndarray,
    front: Front,
    count: int,
    distinct: float,
) -> Choice:
    """Best compromise and extremes of the front; a single target has one best point and no front."""
    best = int(score.argmin())
    onfront = cdist(X, front.X).min(axis=1) == 0
    keep = np.unique(np.append(np.flatnonzero(onfront if r.shape[1] > 1 else np.zeros(len(X), bool)), best))
    A, s, F = X[keep], score[keep], np.abs(r[keep])
    picks = _compromises(A, s, F, keep != best, count, distinct)
    kind: Kind = "front" if len(picks) > 1 else "single"
    chosen = A[picks]
    return Choice(chosen, r[keep][picks], tolerance, kind, False, feasible, chosen.min(0), chosen.max(0), (), count)


def _together(A: np.ndarray, long: float) -> tuple[tuple[int, int, int], ...]:
    """Pairs (i, j, ±1) of parameters that vary over the set and are tied to one another (|correlation| > 0.8)."""
    wide = np.flatnonzero(np.ptp(A, axis=0) >= long / 2)
    if len(wide) < 2:
        return ()
    c = np.corrcoef(A[:, wide].T)
    pairs = [(a, b) for a in range(len(wide)) for b in range(a + 1, len(wide)) if abs(c[a, b]) > 0.8]
    return tuple((int(wide[a]), int(wide[b]), int(np.sign(c[a, b]))) for a, b in pairs)
