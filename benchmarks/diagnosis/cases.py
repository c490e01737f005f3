"""Cases of known cause from the tables of a library, and the evidence of every hypothesis about all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky
from scipy.special import logsumexp

from rso.discrepancy.evidence import attribution, noise
from rso.discrepancy.evidence.attribution import Comparison, Evidence, Shared
from rso.discrepancy.evidence.gaussian_mixture import log_tiles, mean_prediction, mixture_log_evidence, ready, whitening
from rso.discrepancy.library.effects import Effect, Size
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library

NULL, PAIRS = 0.3, 0.1  # shares of the cases; the rest has one cause
SPREAD = 0.05  # of ln modulus around the one that gives the forces of the study
REDRAWN = 100  # times at most, until all cases lie in the ranges that fits keep to
AT_ONCE = 300  # data sets per evaluation: bounds the memory
TWIN = "_twin"


@dataclass(frozen=True, eq=False)
class Cases:
    """Data Y and noise-free means (B, n); effects, coordinates and modulus of each (of scatter: its size alone)."""

    Y: np.ndarray
    mean: np.ndarray
    effects: tuple[tuple[Effect, ...], ...]
    at: tuple[np.ndarray, ...]
    modulus: np.ndarray

    def truth(self, i: int) -> tuple[str, ...]:
        """Sources of a case; none for a null."""
        return tuple(sorted({e.source for e in self.effects[i]}))

    def size(self, i: int, axes: int) -> float:
        """Size coordinate of the first effect of a case, behind the base axes."""
        return float(self.at[i][axes])

    def picked(self, rows: Sequence[int], Y: np.ndarray | None = None) -> Cases:
        """Some of the cases, with other data if given."""
        rows = list(rows)
        return Cases(
            self.Y[rows] if Y is None else Y,
            self.mean[rows],
            tuple(self.effects[i] for i in rows),
            tuple(self.at[i] for i in rows),
            self.modulus[rows],
        )


def fitted(bench: Shared, y: np.ndarray) -> np.ndarray:
    """Prediction (n,) of the base model fitted to y (n,)."""
    white = bench.whites[0]
    return white.L @ mean_prediction(ready(bench.tiles[()], white, bench.modulus), white(y))


def draw_cases(bench: Shared, y: np.ndarray, count: int, seed: int, nothing: bool = False) -> Cases:
    """Cases near the forces of the study: base axes, sizes and shapes from the priors, noise of covariance C.

    With `nothing` all are without a cause.  Sources are equally frequent, and forms within a source.  The means are
    those of the tables, not of the tiles.
    """
    rng = np.random.default_rng(seed)
    force = fitted(bench, y)
    forms: dict[str, list[Effect]] = {}
    for e in bench.library.effects:
        forms.setdefault(e.source, []).append(e)
    plan: dict[tuple[Effect, ...], int] = {}
    for _ in range(count):
        kind, k = 0.0 if nothing else rng.random(), 1
        if kind < NULL + PAIRS:
            k = 0 if kind < NULL else 2
        one = lambda s: forms[s][rng.integers(len(forms[s]))]  # noqa: E731
        chosen = tuple(one(s) for s in rng.choice(list(forms), k, replace=False))
        if k == 2 and any(e.family == "scatter" for e in chosen):
            chosen = chosen[:1]
        plan[chosen] = plan.get(chosen, 0) + 1
    found = [_drawn(bench, force, effects, m, rng) for effects, m in plan.items()]
    mean = np.concatenate([f[0] for f in found])
    Y = mean + rng.standard_normal(mean.shape) @ cholesky(bench.C, lower=True).T
    names = tuple(effects for effects, m in plan.items() for _ in range(m))
    return Cases(Y, mean, names, tuple(x for f in found for x in f[1]), np.concatenate([f[2] for f in found]))


def _drawn(bench: Shared, force: np.ndarray, effects: tuple[Effect, ...], count: int, rng: np.random.Generator):
    """Means, coordinates and moduli of cases of these effects whose parameters lie in the ranges that fits keep to."""
    mean, X, modulus = _anywhere(bench, force, effects, count, rng)
    for _ in range(REDRAWN):
        out = ~_kept(bench.library, X, modulus)
        if not out.any():
            return mean, X, modulus
        mean[out], X[out], modulus[out] = _anywhere(bench, force, effects, int(out.sum()), rng)
    raise ValueError("hardly a case has parameters in the ranges that fits keep to")


def _kept(library: Library, X: np.ndarray, modulus: np.ndarray) -> np.ndarray:
    """Whether the parameters (B,) of base coordinates X (B, d) and moduli lie where fits look for them."""
    inside = np.ones(len(X), bool)
    for k, a in enumerate(library.base.axes):
        if a.kept is not None:
            v = a.physical(X[:, k], modulus)
            inside &= (v >= a.kept[0]) & (v <= a.kept[1])
    return inside


def _anywhere(bench: Shared, force: np.ndarray, effects: tuple[Effect, ...], count: int, rng: np.random.Generator):
    library = bench.library
    columns = [rng.uniform(*a.ends, count) for a in library.base.axes]
    for e in effects:
        if e.family != "scatter":
            columns += [signed(e.size, count, rng), *(rng.uniform(*s.ends()[0], count) for s in e.shape)]
    X = np.array(columns).reshape(len(columns), count).T
    A, c = predict(library, effects, X, bench.modulus)
    modulus = (A @ force) / np.sum(A**2, axis=1) * np.exp(SPREAD * rng.standard_normal(count))
    mean = modulus[:, None] * A + c
    if effects and effects[0].family == "scatter":
        e = effects[0]
        s = np.exp(rng.uniform(np.log(e.size.low), np.log(e.size.high), count))
        mean = mean + s[:, None] * (rng.standard_normal((count, len(library.plan.tests))) @ bench.scatter[e.name])
        X = np.append(X, s[:, None], axis=1)
    return mean, X, modulus


def signed(size: Size, count: int, rng: np.random.Generator) -> np.ndarray:
    """Size coordinates (count,) from the prior: log-uniform on a side of neutral, uniform for a variant."""
    ends = size.ends()
    if size.neutral is None:
        return np.full(count, 0.5) if (size.low, size.high) == (0, 1) else rng.uniform(*ends[0], count)
    side = rng.integers(len(ends), size=count)
    near, far = (np.array([abs(e[k]) for e in ends])[side] for k in (0, 1))
    return np.array([np.sign(e[1]) for e in ends])[side] * np.exp(rng.uniform(np.log(near), np.log(far)))


class Table:
    """Evidence of hypotheses about the data Y (B, n), each computed once; stands for `Evidence` in `contests`,

    where row numbers take the place of data.  `effects` may be fewer than those of the evidence, or have twins.
    """

    def __init__(self, evidence: Evidence, Y: np.ndarray, effects: Sequence[Effect] | None = None) -> None:
        self.evidence, self.bench = evidence, evidence.bench
        self.Y, self.effects = Y, tuple(effects or evidence.effects)
        self.columns: dict[tuple[frozenset[str], bool, bool], np.ndarray] = {}
        self._white: dict[int, np.ndarray] = {}

    def seen_by(self, effects: Sequence[Effect]) -> Table:
        """The same columns for another catalogue."""
        other = Table(self.evidence, self.Y, effects)
        other.columns, other._white = self.columns, self._white
        return other

    def of(self, effects, rows: np.ndarray, unexplained: bool = False, loose: bool = False) -> np.ndarray:
        """Log evidence of some rows."""
        names = frozenset(e.name.removesuffix(TWIN) for e in effects)
        key = (names, unexplained, loose)
        if key not in self.columns:
            own = [e for e in self.evidence.effects if e.name in names]
            self.columns[key] = self.column(own, np.arange(len(self.Y)), unexplained, loose)
        return self.columns[key][rows]

    def column(self, effects, rows: np.ndarray, unexplained: bool = False, loose: bool = False) -> np.ndarray:
        """Log evidence (len(rows),), whitening every data set once per covariance."""
        each = []
        for level in self.evidence._levels(effects, unexplained):
            h = self.evidence.ready(effects, level, loose)
            Yw = self._white.get(id(h.white))
            if Yw is None:
                Yw = self._white[id(h.white)] = h.white(self.Y)
            parts = np.array_split(rows, max(1, -(-len(rows) // AT_ONCE)))
            each.append(np.concatenate([mixture_log_evidence(h, Yw[p]) for p in parts]) if len(rows) else np.zeros(0))
        return logsumexp(np.array(each) + self.evidence.log_weights(effects, unexplained)[:, None], axis=0)

    def add_pairs(self, wanted: dict[tuple[Effect, Effect], list[int]]) -> None:
        """Columns of pairs for the rows that ask for them; tiles of a pair are let go at once."""
        for pair, rows in wanted.items():
            column = np.full(len(self.Y), np.nan)
            column[rows] = self.column(pair, np.array(rows), loose=True)
            self.columns[frozenset(e.name for e in pair), False, True] = column
            names = tuple(e.name for e in pair)
            for memory in (self.evidence._ready, self.evidence.bench.tiles):
                for key in [k for k in memory if k and names in (k, k[:-1], k[0])]:
                    del memory[key]


def contested(table: Table, rows: Sequence[int], first: Sequence[Comparison], pairs: bool = False) -> list[Comparison]:
    """The second contest of rows that have a gap, as the product holds it; `first` are those of all rows."""
    last = {i: attribution.survivors(first[i]) for i in rows}
    order = {e.name: k for k, e in enumerate(table.effects)}
    asked = (
        {i: [tuple(sorted(p, key=lambda e: order[e.name])) for p in attribution.pairs_of(v)] for i, v in last.items()}
        if pairs
        else {i: [] for i in rows}
    )
    wanted: dict[tuple[Effect, Effect], list[int]] = {}
    for i, v in asked.items():
        for p in v:
            wanted.setdefault(p, []).append(i)
    table.add_pairs(wanted)
    return [
        attribution.comparisons(table, np.array([i]), asked[i], finalists=frozenset(e.source for e in last[i]))[0]
        for i in rows
    ]


def other_bench(
    bench: Shared,
    y: np.ndarray,
    scale: float = 1.0,
    correlated: bool = True,
    projected: bool = True,
    rows: np.ndarray | None = None,
) -> Shared:
    """The bench with `scale` times the covariance, without its correlation, without projection, or of some rows."""
    C = scale * (bench.C if correlated else np.diag(np.diag(bench.C)))
    rows = np.arange(len(C)) if rows is None else rows
    white = whitening(C, rows)
    force = fitted(bench, y)
    h = ready(bench.tiles[()], white, bench.modulus)
    t = int(np.argmax(log_tiles(h, white(y)[None])[0]))
    J = h.X[t] @ h.Q.T
    H = white.L @ (J.T @ np.linalg.solve(J @ J.T + 1e-9 * np.eye(len(J)), J @ np.linalg.inv(white.L)))
    off = np.eye(len(rows)) - H if projected else np.eye(len(rows))
    whites = [white]
    for gap in bench.settings.priors.gaps:
        K = off @ noise.gap_covariance(bench.library, force, *gap)[np.ix_(rows, rows)] @ off.T
        whites.append(replace(whitening(C[np.ix_(rows, rows)] + K), rows=rows))
    return replace(bench, C=C, whites=tuple(whites), alone=())
