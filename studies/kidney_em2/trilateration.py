"""The inverse problem behind reconstruct.py: printed norms, the same sets simulated, and the curve between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from simulated import BOWLS, HELD, Simulations, Support, Table

from rso.norms import (
    Printed,
    TrilaterationFit,
    TrilaterationProblem,
    TrilaterationShape,
    fit_trilateration,
    sample_trilateration,
    shared_votes,
    trilateration_log_evidence,
)

HERE = Path(__file__).parent
SETS = {1: (0.0099997, 5.8), 2: (0.0099752, 5.3), 3: (0.0102, 1.1), 4: (0.012453, 139.3)}  # Table 5.1: MPa, 1/MPa
TABLE = {  # Table 5.1
    "nrmse": (0.0339, 0.0340, 0.0533, 0.0648),
    "mre": (0.1098, 0.1097, 0.1139, 0.1713),
    "rrmse": (0.2067, 0.2069, 0.1964, 0.2592),
}
SPREAD, MAD = 0.6835, 0.5916  # Table 5.2, "baseline" NRMSE (and RRMSE) and MRE
DEEPEST, F_DEEPEST = 4.0, 0.546  # mm, N
PRINT = 0.0003  # standard uncertainty of three printed decimals
NEAR = (0.005, 0.06)  # sets that differ by no more in ln μ and ln D₁ are one simulation
SEED = 20230526


@dataclass(frozen=True, eq=False)
class Lists:
    """Sets θ (85, 2): those of the NRMSE list, of the MRE list and of Table 5.1; and the printed norms of each list."""

    theta: np.ndarray
    nrmse: Printed
    mre: Printed
    table: tuple[Printed, ...]  # of Table 5.1 what is in no list: set 3, and all RRMSE
    means: tuple[Printed, ...]  # of the constant

    def moved(self, zeros: int) -> Lists:
        """The same for a grid with so many points at u = 0."""
        with_zero = replace(self.nrmse, zeros=zeros)
        table = tuple(replace(p, zeros=zeros) for p in self.table)
        return replace(self, nrmse=with_zero, table=table, means=tuple(replace(p, zeros=zeros) for p in self.means))


def lists() -> Lists:
    """The printed numbers; near-duplicates share one vote."""
    a, b = (np.loadtxt(HERE / "thesis" / f"{k}.csv", delimiter=",", skiprows=4) for k in ("nrmse", "mre"))
    theta = np.concatenate([a[:, :2], b[:, :2], np.array(list(SETS.values()))])
    first, second, last = len(a), len(a) + len(b), np.arange(len(a) + len(b), len(theta))
    nrmse = Printed("nrmse", np.arange(first), a[:, 2], PRINT, 0.005, shared_votes(a[:, :2], NEAR))
    mre = Printed("mre", np.arange(first, second), b[:, 2], PRINT, 0.005, shared_votes(b[:, :2], NEAR))
    table = (
        Printed("rrmse", last, np.array(TABLE["rrmse"]), PRINT, 0.005, np.array([0.5, 0.5, 1.0, 1.0])),
        Printed("nrmse", last[2:3], np.array(TABLE["nrmse"][2:3]), 0.003),
        Printed("mre", last[2:3], np.array(TABLE["mre"][2:3]), 0.003),
    )
    means = Printed("spread", 0, SPREAD, PRINT), Printed("mad", 0, MAD, PRINT)
    return Lists(theta, nrmse, mre, table, means)


def depths(spacing: float = 0.1) -> np.ndarray:
    """Depths (n,) in mm of the triggers, up to 4."""
    return np.round(spacing * np.arange(1, round(DEEPEST / spacing) + 1), 6)


def problem(
    data: Lists, tables: dict[Support, Table], held: bool = False, what: str = "all", spacing: float = 0.1
) -> TrilaterationProblem:
    """The inverse problem in a bowl or held, from the NRMSE list alone, both lists, or all that is printed."""
    u = depths(spacing)
    known = Simulations(data.theta, u, [tables[HELD]] if held else [tables[s] for s in BOWLS])
    blocks = {
        "nrmse": (data.nrmse, data.means[0]),
        "lists": (data.nrmse, data.mre, *data.means),
        "all": (data.nrmse, data.mre, *data.table, *data.means),
    }
    return TrilaterationProblem(TrilaterationShape(u, F_DEEPEST, 0.0003), known, known.nuisances, blocks[what])


@dataclass(frozen=True, eq=False)
class Curve:
    """A reconstruction: draws (N, n) of the curve on depths u (n,), and the coordinates (N, d) they come from."""

    u: np.ndarray
    draws: np.ndarray
    x: np.ndarray
    log_evidence: float

    @property
    def mean(self) -> np.ndarray:
        """(n,) N."""
        return np.mean(self.draws, axis=0)

    @property
    def sd(self) -> np.ndarray:
        """(n,) N."""
        return np.std(self.draws, axis=0, ddof=1)

    def at(self, u: np.ndarray) -> np.ndarray:
        """Draws (N, m) at depths u (m,), all of them among its own."""
        return self.draws[:, np.argmin(np.abs(self.u - u[:, None]), axis=1)]

    @property
    def correlation(self) -> np.ndarray:
        """(n, n)."""
        return np.corrcoef(self.draws.T)


def reconstruct(p: TrilaterationProblem, seed: int = SEED, steps: int = 1000) -> tuple[TrilaterationFit, Curve]:
    """Most probable curve and draws of the posterior."""
    found = fit_trilateration(p, seed)
    x = sample_trilateration(p, found, seed, walkers=2 * p.size + 16, steps=steps, burn=steps // 2)
    return found, Curve(p.shape.u, p.shape(p.split(x)[0]), x, trilateration_log_evidence(p, x, found.log_posterior))


def length(curve: Curve) -> float:
    """ℓ in mm of e^(−|Δu|/ℓ) nearest to the correlation of a curve's errors, without the last, nearly exact point."""
    gap, c = np.abs(curve.u[:, None] - curve.u)[:-1, :-1], curve.correlation[:-1, :-1]
    tried = np.geomspace(0.05, 4.0, 100)
    return float(tried[np.argmin([np.sum((np.exp(-gap / ell) - c) ** 2) for ell in tried])])


def write(folder: Path, name: str, notes: list[str], u: np.ndarray, force: np.ndarray, sigma: np.ndarray) -> None:
    """One CSV file of a force curve with its uncertainty."""
    rows = [f"{d:.1f},{f:.5f},{s:.5f}" for d, f, s in zip(u, force, sigma, strict=True)]
    text = "\n".join([*(f"# {n}" for n in notes), "depth_mm,Fz_N,Fz_sigma_N", *rows]) + "\n"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8", newline="\n")


def residuals(p: TrilaterationProblem, curve: Curve, printed: Printed) -> np.ndarray:
    """Predicted minus printed norms (k,), mean over some draws."""
    return np.mean(p.predict(curve.x[::20], [printed])[0], axis=0) - printed.value


def rms(values: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Root mean square."""
    return float(np.sqrt(np.average(values**2, weights=weight)))


def crossings(y: np.ndarray, f: np.ndarray, u: np.ndarray) -> list[np.ndarray]:
    """Depths where each curve f (N, n) crosses y (N, n), by straight lines."""
    d = f - y
    out = []
    for row in d:
        k = np.flatnonzero(row[:-1] * row[1:] < 0)
        out.append(u[k] + (u[k + 1] - u[k]) * row[k] / (row[k] - row[k + 1]))
    return out


def made_up(p: TrilaterationProblem, x: np.ndarray, rng: np.random.Generator) -> tuple[Printed, ...]:
    """The blocks with the norms that x (d,) makes, and noise of the scales in x; near-duplicates share theirs."""
    out = []
    for i, (q, made) in enumerate(zip(p.printed, p.predict(x[None]), strict=True)):
        noise = rng.standard_t(p.dof, len(q.value)) if q.scale > 0 else rng.standard_normal(len(q.value))
        if q.scale > 0:
            theta = np.log(p.known.theta[q.rows]) / NEAR
            first = [np.argmax(np.max(np.abs(theta - t), axis=1) <= 1.0) for t in theta]
            noise = noise[first]
        value = np.broadcast_to(made[0] + p.sigma(x[None], i)[0] * noise, q.value.shape)
        out.append(replace(q, value=value.copy()))
    return tuple(out)
