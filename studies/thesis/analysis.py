"""What the tables need beyond single simulations: forces by similarity, valleys, sensitivities, polynomials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from rso.core.curves import Metrics, Resampling, metrics
from rso.data import read_measurement
from rso.evaluation import Outcome
from rso.evaluation.store import Done
from studies.thesis.simulations import FAMILY, MU, PRINTED

KIDNEY = Path(__file__).parents[1] / "kidney_em2"
RANGES = {k: (np.array(v["mu_Pa"]) * 1e-6, np.array(v["D1"], float)) for k, v in PRINTED["ranges"].items()}


@dataclass(frozen=True, eq=False)
class Family:
    """Curves at the top for every (mu, D1) from runs over x = mu D1 at one modulus: F(mu, D1, u) = mu f(mu D1, u).

    `x` (n,), `travel` (m,) mm, `F` (n, m) N at mu = MU; between the x a cubic spline in ln x.
    """

    x: np.ndarray
    travel: np.ndarray
    F: np.ndarray

    def at(self, u: np.ndarray | float) -> CubicSpline:
        """f(ln x) at depths u (mm), in N at mu = MU."""
        return CubicSpline(np.log(self.x), Resampling(self.travel, self.F.T)(u).T)

    def force(self, mu: np.ndarray | float, D1: np.ndarray | float, u: float) -> np.ndarray:
        """Force (N) at one depth u (mm) for moduli and compressibilities that broadcast."""
        return np.asarray(mu) / MU * self.at(u)(np.log(np.multiply(mu, D1)))

    def curve(self, mu: float, D1: float, u: np.ndarray) -> np.ndarray:
        """Force (N) at depths u (n,) mm."""
        return mu / MU * self.at(u)(np.log(mu * D1))

    def slope(self, mu: float, D1: float, u: float) -> tuple[float, float]:
        """d ln F / d ln mu and d ln F / d ln D1; by similarity the first is one more than the second."""
        f, x = self.at(u), np.log(mu * D1)
        e = float(f(x, 1) / f(x))
        return 1.0 + e, e

    def valley(self, D1: np.ndarray, u: float, F: float) -> np.ndarray:
        """Modulus (MPa) with which each D1 (n,) gives the force F (N) at depth u (mm); NaN beyond the runs."""
        f, low, high = self.at(u), np.log(self.x[0]), np.log(self.x[-1])
        out = []
        for d in np.atleast_1d(D1):
            ends = [np.exp(b) / d for b in (low, high)]
            miss = [m / MU * float(f(np.log(m * d))) - F for m in ends]
            inside = miss[0] < 0 < miss[1]
            out.append(brentq(lambda m, d=d: m / MU * float(f(np.log(m * d))) - F, *ends) if inside else np.nan)
        return np.array(out)

    def left_out(self) -> float:
        """Largest relative error at the last travel where one inner run is predicted from the others."""
        y, worst = self.F[:, -1], 0.0
        for k in range(1, len(y) - 1):
            keep = np.arange(len(y)) != k
            worst = max(worst, abs(float(CubicSpline(np.log(self.x[keep]), y[keep])(np.log(self.x[k]))) / y[k] - 1))
        return worst


def family(outcomes: Mapping[str, Outcome], label: str) -> Family:
    """The runs of a family that are done."""
    done = [(x, o.response) for x in FAMILY if isinstance(o := outcomes.get(f"{label} {x:g}"), Done)]
    return Family(
        np.array([x for x, _ in done]), done[0][1].channels["travel"], np.array([r.channels["Fz"] for _, r in done])
    )


def measured() -> tuple[np.ndarray, np.ndarray]:
    """Depth (mm) and force (N) of the middle point, as reconstructed in studies/kidney_em2."""
    (r,) = read_measurement(KIDNEY / "measured" / "middle_point.csv").repeats
    return r.depth, r.channels["Fz"]


def printed_errors(metric: str) -> tuple[np.ndarray, np.ndarray]:
    """(mu, D1) (n, 2) in MPa and 1/MPa and errors (n,) of the source's simulations."""
    rows = np.loadtxt(KIDNEY / "thesis" / f"{metric}.csv", delimiter=",", comments="#", skiprows=4)
    return rows[:, :2], rows[:, 2]


def errors_of(curves: Family, points: np.ndarray, data: tuple[np.ndarray, np.ndarray]) -> list[Metrics]:
    """Norms of the curves at (mu, D1) (n, 2) against measured (depth, force)."""
    u, y = data
    return [metrics(y, curves.curve(mu, D1, u)) for mu, D1 in points]


@dataclass(frozen=True)
class Sensitivity:
    """How many times more mu moves the force than D1 does, over a box at one depth.

    `change`: largest change over the range of mu over that of D1, the other in the arithmetic middle of its range (the
    bars of the source's program), `log_change` the same about the geometric middle; `elasticity`: ratio of
    d ln F / d ln mu and |d ln F / d ln D1| in the arithmetic middle.
    """

    change: float
    log_change: float
    elasticity: float


def sensitivity(curves: Family, box: tuple[np.ndarray, np.ndarray], u: float) -> Sensitivity:
    """The ratios at depth u (mm)."""
    mu, D1 = box

    def change(middle: tuple[float, float]) -> float:
        by_mu = np.ptp(curves.force(np.linspace(*mu, 101), middle[1], u))
        return float(by_mu / np.ptp(curves.force(middle[0], np.linspace(*D1, 101), u)))

    middle = float(np.mean(mu)), float(np.mean(D1))
    a, b = curves.slope(*middle, u)
    return Sensitivity(change(middle), change((float(np.sqrt(np.prod(mu))), float(np.sqrt(np.prod(D1))))), abs(a / b))


def elasticity_of_four(curves: Family, u: float) -> float:
    """mu D1 at which a relative change of mu moves the force four times as much as the same of D1 (NaN: nowhere)."""
    f, x = curves.at(u), np.linspace(np.log(curves.x[0]), np.log(curves.x[-1]), 2001)
    e = -f(x, 1) / f(x)
    ratio = np.where(e > 0, (1 - e) / np.where(e > 0, e, 1.0), np.inf)
    below = np.flatnonzero((ratio[:-1] > 4) & (ratio[1:] <= 4))
    return float(np.exp(x[below[0]])) if len(below) else float("nan")


@dataclass(frozen=True, eq=False)
class Quadratic:
    """Full second-degree polynomial of the force over a box, through the nine points of a face-centred design."""

    box: tuple[np.ndarray, np.ndarray]
    coefficients: np.ndarray

    def __call__(self, mu: np.ndarray, D1: np.ndarray) -> np.ndarray:
        """Predicted force (N)."""
        return _terms(*(_scaled(v, b) for v, b in zip((mu, D1), self.box, strict=True))) @ self.coefficients


def quadratic(curves: Family, box: tuple[np.ndarray, np.ndarray], u: float) -> Quadratic:
    """Response surface of the force at depth u (mm), both ranges on linear axes."""
    mu, D1 = np.meshgrid(*([b[0], np.mean(b), b[1]] for b in box))
    y = curves.force(mu, D1, u).ravel()
    T = _terms(*(_scaled(v.ravel(), b) for v, b in zip((mu, D1), box, strict=True)))
    return Quadratic(box, np.linalg.lstsq(T, y, rcond=None)[0])


def _scaled(v: np.ndarray, box: np.ndarray) -> np.ndarray:
    return (2 * np.asarray(v, float) - box[0] - box[1]) / (box[1] - box[0])


def _terms(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    a, b = np.broadcast_arrays(a, b)
    return np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=-1)


def deeper_curve(crossings: Sequence[tuple[float, float]], u: np.ndarray) -> np.ndarray:
    """The measured curve of the deeper test (N) at u (n,) mm from the few points (depth, force) known of it."""
    d, F = np.array(sorted(crossings)).T
    return Resampling(d, F)(u)


def gap(first: np.ndarray, second: np.ndarray) -> float:
    """Root mean square difference of two profiles."""
    return float(np.sqrt(np.mean((first - second) ** 2)))
