"""A measured curve found again from the error norms of known curves against it: trilateration among functions.

A norm ‖f_k − y‖ says how far the unknown curve y lies from a known curve f_k; many of them, from curves that lie around
y, say where it is.  The curve has a smooth logarithmic slope, the known curves may depend on nuisances, and what the
norms are wrong by beyond their print is found along with the curve.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaln

NORM_KINDS = ("nrmse", "mre", "rrmse", "spread", "mad")
N_QUADRATURE_POINTS = 240  # points of the quadrature of the slope
VECTORS_PER_BATCH = 256  # parameter vectors at once
DIFFERENCE_STEP_SD = 1e-3  # step of the differences, in standard deviations of the prior


@dataclass(frozen=True, eq=False)
class TrilaterationShape:
    """Prior of a positive increasing curve, y(u) = y_n exp(−∫_u^{u_n} p d ln u), with ln p a Gaussian process over √u.

    `u` (n,) mm, increasing and positive; `end` = y_n with standard uncertainty `end_sd`; ln p has mean ln `slope`,
    standard deviation `spread` and correlation exp(−Δ²/2ℓ²), Δ in √u, `length` = ℓ in √mm.  A curve has the coordinates
    z (m + 1,), independent standard normals: one for each of the `knots` m, the last one for the end.

    Raises ValueError for what is not increasing and positive.
    """

    u: np.ndarray
    end: float
    end_sd: float
    slope: float = 1.3
    spread: float = 0.35
    length: float = 0.5
    knots: int = 10

    def __post_init__(self) -> None:
        u = np.array(self.u, float)
        if u.ndim != 1 or len(u) < 3 or u[0] <= 0 or np.any(np.diff(u) <= 0):
            raise ValueError(f"a curve needs at least 3 increasing positive depths (n,), got {u.tolist()[:6]}")
        for name in ("end", "slope", "spread", "length"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} = {getattr(self, name)} must be positive")
        object.__setattr__(self, "u", u)

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.knots + 1

    @cached_property
    def _maps(self) -> tuple[np.ndarray, np.ndarray]:
        """z → ln p on the fine grid (N_QUADRATURE_POINTS, m), and p there → ∫_u^{u_n} p d ln u at every depth (n,
        N_QUADRATURE_POINTS)."""
        x, fine = np.log(self.u), np.linspace(np.log(self.u[0]), np.log(self.u[-1]), N_QUADRATURE_POINTS)
        at, knots = np.exp(fine / 2), np.linspace(np.sqrt(self.u[0]), np.sqrt(self.u[-1]), self.knots)

        def kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return np.exp(-0.5 * ((a[:, None] - b) / self.length) ** 2)

        root = np.linalg.cholesky(kernel(knots, knots) + 1e-6 * np.eye(self.knots))
        spread = self.spread * np.linalg.solve(root, kernel(knots, at)).T
        # trapezoidal rule from each fine point to the end
        weight = np.zeros((N_QUADRATURE_POINTS, N_QUADRATURE_POINTS))
        for i in range(N_QUADRATURE_POINTS - 2, -1, -1):
            weight[i] = weight[i + 1]
            weight[i, i : i + 2] += 0.5 * (fine[1] - fine[0])
        between = np.array([np.interp(x, fine, column) for column in weight.T]).T
        return spread, between

    def slopes(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depths (N_QUADRATURE_POINTS,) and p = d ln y / d ln u there (w, N_QUADRATURE_POINTS) of z (w, m + 1)."""
        at = np.exp(np.linspace(np.log(self.u[0]), np.log(self.u[-1]), N_QUADRATURE_POINTS))
        return at, self.slope * np.exp(np.atleast_2d(z)[:, : self.knots] @ self._maps[0].T)

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """The curves (w, n) of z (w, m + 1)."""
        z = np.atleast_2d(z)
        fall = self.slopes(z)[1] @ self._maps[1].T
        return (self.end + self.end_sd * z[:, -1:]) * np.exp(-fall)


@dataclass(frozen=True, eq=False)
class Printed:
    """Norms of one kind: `value` (k,) of the known curves `rows` (k,), as printed.

        nrmse √mean (f−y)² / ȳ      mre mean |f/y − 1|      rrmse √mean (f/y − 1)²
        spread and mad: nrmse and mean |ȳ − y|/ȳ of the constant ȳ (rows mean nothing)

    `sigma` is the uncertainty of the print; `scale`, if positive, the guess of what they are wrong by in addition
    (Student's t about the curve), found within a factor e^±1.5; 0 where they are exact but for `sigma`.  `weight` (k,)
    of each in the likelihood: near-duplicates share one vote.  `zeros` further points where every curve is 0 belong
    to the grid of a nrmse and the spreads; relative norms leave them out.
    """

    kind: str
    rows: np.ndarray
    value: np.ndarray
    sigma: float
    scale: float = 0.0
    weight: np.ndarray | None = None
    zeros: int = 0

    def __post_init__(self) -> None:
        if self.kind not in NORM_KINDS:
            raise ValueError(f"no norm {self.kind!r}; choose from {', '.join(NORM_KINDS)}")
        rows, value = np.atleast_1d(np.asarray(self.rows, int)), np.atleast_1d(np.asarray(self.value, float))
        weight = np.ones(len(value)) if self.weight is None else np.asarray(self.weight, float)
        if not len(rows) == len(value) == len(weight):
            raise ValueError(f"{self.kind}: {len(rows)} rows, {len(value)} values and {len(weight)} weights")
        if not self.sigma > 0 or not self.scale >= 0 or not np.all(np.isfinite(value)):
            raise ValueError(f"{self.kind}: needs finite values, sigma > 0 and scale >= 0")
        for name, array in (("rows", rows), ("value", value), ("weight", weight)):
            object.__setattr__(self, name, array)


def norm(kind: str, y: np.ndarray, f: np.ndarray, zeros: int = 0) -> np.ndarray:
    """Norm (w, k) of the curves f (w, k, n) against y (w, n), as in :class:`Printed`."""
    y = np.asarray(y, float)[..., None, :]
    if kind in ("mre", "rrmse"):
        r = f / y - 1.0
        return np.mean(np.abs(r), axis=-1) if kind == "mre" else np.sqrt(np.mean(r**2, axis=-1))
    n = y.shape[-1] + zeros
    mean = np.sum(y, axis=-1) / n
    if kind == "nrmse":
        return np.sqrt(np.sum((f - y) ** 2, axis=-1) / n) / mean
    d = y - mean[..., None]
    if kind == "spread":
        return np.sqrt((np.sum(d**2, axis=-1) + zeros * mean**2) / n) / mean
    return (np.sum(np.abs(d), axis=-1) / n + zeros * mean / n) / mean


def shared_votes(theta: np.ndarray, near: Sequence[float]) -> np.ndarray:
    """Weight (k,) 1/size of the cluster of each θ (k, d): chained where every |Δ ln θ_i| <= near_i."""
    x = np.log(np.asarray(theta, float)) / np.asarray(near, float)
    close = np.all(np.abs(x[:, None] - x[None]) <= 1.0, axis=-1)
    for _ in range(len(x)):
        wider = (close.astype(int) @ close) > 0
        if np.array_equal(wider, close):
            break
        close = wider
    return 1.0 / close.sum(axis=1)


Known = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class TrilaterationProblem:
    """The unknown: coordinates x (d,) of the curve, of `nuisances` and of the scales, all standard normal beforehand.

    `known(ν)` returns the known curves (w, k, n) on the depths of `shape` for nuisances ν (w, q).  What a norm is wrong
    by has Student's distribution with `dof` degrees of freedom: lists that people type hold outliers.
    """

    shape: TrilaterationShape
    known: Known
    nuisances: int
    printed: tuple[Printed, ...]
    dof: float = 4.0

    @cached_property
    def learned(self) -> tuple[int, ...]:
        """Which of `printed` have a scale to be found."""
        return tuple(i for i, p in enumerate(self.printed) if p.scale > 0)

    @property
    def size(self) -> int:
        """Number d of coordinates."""
        return self.shape.size + self.nuisances + len(self.learned)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x (w, d) → z, ν and the scales (w, number of learned ones)."""
        x = np.atleast_2d(x)
        a, b = self.shape.size, self.shape.size + self.nuisances
        guess = np.array([self.printed[i].scale for i in self.learned])
        return x[:, :a], x[:, a:b], guess * np.exp(1.5 * x[:, b:])

    def predict(self, x: np.ndarray, printed: Sequence[Printed] | None = None) -> list[np.ndarray]:
        """Norms (w, k) for each of `printed` (default: those that are fitted; only kind, rows and zeros count)."""
        wanted = self.printed if printed is None else printed
        z, ν, _ = self.split(x)
        y, f = self.shape(z), self.known(ν)
        spread = y[:, None, :]  # any one curve: a spread needs none
        return [norm(p.kind, y, spread if p.kind in ("spread", "mad") else f[:, p.rows], p.zeros) for p in wanted]

    def log_posterior(self, x: np.ndarray) -> np.ndarray:
        """ln of prior times likelihood (w,), normalised."""
        x = np.atleast_2d(x)
        return np.concatenate(
            [self._log_posterior(part) for part in np.array_split(x, -(-len(x) // VECTORS_PER_BATCH))]
        )

    def _log_posterior(self, x: np.ndarray) -> np.ndarray:
        total = -0.5 * np.sum(x**2, axis=1) - 0.5 * x.shape[1] * np.log(2 * np.pi)
        for i, q in enumerate(self.predict(x)):
            p, s = self.printed[i], self.sigma(x, i)[:, None]
            r = (p.value - q) / s
            total += np.sum(p.weight * (_log_density(r, self.dof if p.scale > 0 else None) - np.log(s)), axis=1)
        return np.where(np.isfinite(total), total, -np.inf)

    def sigma(self, x: np.ndarray, i: int) -> np.ndarray:
        """Scale (w,) of the errors of `printed[i]`, the print's included."""
        s = self.split(x)[2]
        own = s[:, self.learned.index(i)] if i in self.learned else np.zeros(len(s))
        return np.hypot(own, self.printed[i].sigma)

    def information(self, x: np.ndarray) -> np.ndarray:
        """Fisher information (d, d) of prior and likelihood at x (d,)."""
        d = len(x)
        shifts = np.concatenate([x + DIFFERENCE_STEP_SD * np.eye(d), x - DIFFERENCE_STEP_SD * np.eye(d)])
        F, ν = np.eye(d), self.dof
        for i, q in enumerate(self.predict(shifts)):
            p, s = self.printed[i], float(self.sigma(x[None], i)[0])
            assert p.weight is not None  # see Printed.__post_init__
            J = (q[:d] - q[d:]).T / (2 * DIFFERENCE_STEP_SD * s)
            F += (J.T * p.weight) @ J * ((ν + 1) / (ν + 3) if p.scale > 0 else 1.0)
            if i in self.learned:
                k = self.shape.size + self.nuisances + self.learned.index(i)
                share = 1.5 * (1.0 - (p.sigma / s) ** 2)  # d ln σ / dx
                F[k, k] += np.sum(p.weight) * share**2 * 2 * ν / (ν + 3)
        return F


def _log_density(r: np.ndarray, dof: float | None) -> np.ndarray:
    """ln of Student's density, or of the normal one."""
    if dof is None:
        return -0.5 * r**2 - 0.5 * np.log(2 * np.pi)
    constant = gammaln((dof + 1) / 2) - gammaln(dof / 2) - 0.5 * np.log(dof * np.pi)
    return constant - 0.5 * (dof + 1) * np.log1p(r**2 / dof)


@dataclass(frozen=True, eq=False)
class TrilaterationFit:
    """Most probable x (d,), covariance (d, d) by Laplace's method, and the evidence ln Z."""

    x: np.ndarray
    covariance: np.ndarray
    log_posterior: float
    log_evidence: float

    def draws(self, n: int, seed: int) -> np.ndarray:
        """Draws (n, d) of the Gaussian."""
        root = np.linalg.cholesky(self.covariance)
        return self.x + np.random.default_rng(seed).standard_normal((n, len(self.x))) @ root.T


def fit_trilateration(
    problem: TrilaterationProblem, seed: int = 0, starts: int = 4, iterations: int = 80
) -> TrilaterationFit:
    """Most probable curve by damped Fisher scoring from several starts (the prior's middle and draws of it)."""
    rng = np.random.default_rng(seed)
    best: tuple[float, np.ndarray] | None = None
    for k in range(starts):
        x = np.zeros(problem.size) if k == 0 else 0.5 * rng.standard_normal(problem.size)
        value, x = _climb(problem, x, iterations)
        if best is None or value > best[0]:
            best = (value, x)
    assert best is not None
    F = problem.information(best[1])
    evidence = best[0] + 0.5 * len(F) * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(F)[1]
    return TrilaterationFit(best[1], np.linalg.inv(F), best[0], float(evidence))


def _climb(problem: TrilaterationProblem, x: np.ndarray, iterations: int) -> tuple[float, np.ndarray]:
    value, damping, d = float(problem.log_posterior(x)[0]), 1.0, problem.size
    small = 0
    for _ in range(iterations):
        shifted = problem.log_posterior(
            np.concatenate([x + DIFFERENCE_STEP_SD * np.eye(d), x - DIFFERENCE_STEP_SD * np.eye(d)])
        )
        slope, F = (shifted[:d] - shifted[d:]) / (2 * DIFFERENCE_STEP_SD), problem.information(x)
        trials = damping * np.array([0.03, 0.3, 1.0, 3.0, 30.0])
        tried = np.array([x + np.linalg.solve(F + t * np.diag(np.diag(F)), slope) for t in trials])
        values = problem.log_posterior(tried)
        k = int(np.argmax(values))
        if not values[k] > value:
            damping *= 100.0
            if damping > 1e8:
                break
            continue
        small = small + 1 if values[k] - value < 1e-4 else 0
        value, x, damping = float(values[k]), tried[k], min(max(trials[k], 1e-4), 1e6)
        if small >= 3:
            break
    return value, x


def sample_trilateration(
    problem: TrilaterationProblem,
    fitted: TrilaterationFit,
    seed: int,
    walkers: int = 64,
    steps: int = 3000,
    burn: int = 1000,
    keep: int = 4000,
) -> np.ndarray:
    """Draws (keep, d) of the posterior by ensemble MCMC, started as draws of the Gaussian that the posterior favours.

    (A walker that starts far out in a bent posterior would stay there.)
    Source: Goodman & Weare, CAMCoS 5 (2010) 65; ter Braak, Stat. Comput. 16 (2006) 239; both as in emcee.
    """
    import emcee  # slow to import

    rng = np.random.default_rng([seed, 7])
    tried = fitted.draws(20 * walkers, seed)
    away = np.linalg.solve(np.linalg.cholesky(fitted.covariance), (tried - fitted.x).T)
    weight = problem.log_posterior(tried) + 0.5 * np.sum(away**2, axis=0)
    start = tried[np.argsort(-(weight + rng.gumbel(size=len(tried))))[:walkers]]  # drawn by weight, none twice
    moves = [(emcee.moves.DEMove(), 0.6), (emcee.moves.DESnookerMove(), 0.1), (emcee.moves.StretchMove(), 0.3)]
    sampler = emcee.EnsembleSampler(walkers, problem.size, problem.log_posterior, moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(seed % 2**32).get_state()
    sampler.run_mcmc(start, burn + steps, skip_initial_state_check=True)
    chain = sampler.get_chain(discard=burn, flat=True)
    return chain[np.linspace(0, len(chain) - 1, keep).astype(int)]


def trilateration_log_evidence(problem: TrilaterationProblem, draws: np.ndarray, best: float) -> float:
    """ln Z from draws (n, d) of the posterior and its highest value: Laplace's formula with the draws' covariance.

    Source: Lewis & Raftery, J. Am. Stat. Assoc. 92 (1997) 648, eq. 6.
    """
    d = problem.size
    best = max(best, float(np.max(problem.log_posterior(draws))))
    return best + 0.5 * d * np.log(2 * np.pi) + 0.5 * float(np.linalg.slogdet(np.cov(draws.T))[1])
