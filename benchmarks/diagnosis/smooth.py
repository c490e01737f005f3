"""Gaps of no known cause: smooth changes of the force with depth, drawn otherwise than the free competitor's."""

from __future__ import annotations

from dataclasses import replace

import controls
import numpy as np
from cases import Cases, draw_cases, other_bench
from checked import KINDS, check
from scipy.linalg import cholesky
from scipy.special import comb
from sections import Say, table

from rso.discrepancy.evidence.attribution import Evidence, Shared
from rso.discrepancy.library.test_plan import Test

CASES = 300
AMPLITUDE = (0.005, 0.1)  # largest relative change of the force at a place
DEGREE = 5
EDGES = (0.005, 0.0136, 0.0368, 0.1)


def shape(at: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A random Bernstein polynomial (n,) of a depth between 0 and 1 (n,), its largest value on [0, 1] being 1."""
    k = np.arange(DEGREE + 1)
    basis = lambda x: comb(DEGREE, k) * x[:, None] ** k * (1 - x[:, None]) ** (DEGREE - k)  # noqa: E731
    weights = rng.uniform(-1, 1, DEGREE + 1)
    return basis(np.clip(at, 0, 1)) @ weights / np.abs(basis(np.linspace(0, 1, 101)) @ weights).max()


def gaps(bench: Shared, amplitude: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Relative changes (B, n) of the forces: a shape for each place, the same for its tests and channels; none of
    profiles."""
    plan = bench.library.plan
    out = np.zeros((len(amplitude), plan.n))
    for row, a in zip(out, amplitude, strict=True):
        for place in sorted({t.place for t in plan.tests}):
            mine = [(t, at) for t, _, at in plan.rows() if isinstance(t, Test) and t.place == place]
            depth = np.concatenate([t.depth for t, _ in mine]) / max(t.peak for t, _ in mine)
            row[np.concatenate([np.r_[at] for _, at in mine])] = a * shape(depth, rng)
    return out


def drawn(bench: Shared, y: np.ndarray, count: int, seed: int) -> tuple[Cases, np.ndarray]:
    """Cases of the base model with such a gap, and its amplitude (B,)."""
    plain = draw_cases(bench, y, count, seed, nothing=True)
    rng = np.random.default_rng(seed + 1)
    amplitude = np.exp(rng.uniform(*np.log(AMPLITUDE), count))
    mean = plain.mean * (1 + gaps(bench, amplitude, rng))
    Y = mean + rng.standard_normal(mean.shape) @ cholesky(bench.C, lower=True).T
    return replace(plain, Y=Y, mean=mean), amplitude


def of_no_cause(say: Say, evidence: Evidence, y: np.ndarray, threshold: float, seed: int, count: int = CASES) -> None:
    """Verdicts on these cases, with and without the parts that are there for them."""
    bench = evidence.bench
    cases, amplitude = drawn(bench, y, count, seed + 5)
    first = controls.scored(evidence, y, cases, {}, seed, threshold=threshold)
    flat = other_bench(bench, y, projected=False)
    alone = controls.only(lambda h: not h.unexplained)
    after = [
        check(evidence, evidence.effects, j, v, seed + i)
        for i, (j, v) in enumerate(zip(first.judged, cases.Y, strict=True))
    ]
    verdicts = {
        "as it is": first.verdict,
        "without projection": controls.scored(Evidence(flat, evidence.effects), y, cases, {}, seed).verdict,
        "without free competitor": controls.scored(evidence, y, cases, {}, seed, alone).verdict,
        "as it is, with a look at what is left": np.array([c.looked for c in after]),
        "and the held-out check": np.array([c.verdict for c in after]),
    }

    def row(v: np.ndarray) -> list[str]:
        return [*(f"{np.mean(v == k):.3f}" for k in KINDS), f"{np.mean(np.isin(v, controls.ALONE)):.3f}", str(len(v))]

    last = verdicts["and the held-out check"]
    at = np.clip(np.searchsorted(EDGES, amplitude) - 1, 0, len(EDGES) - 2)
    sizes = [[f"{100 * EDGES[k]:.1f}–{100 * EDGES[k + 1]:.1f} %", *row(last[at == k])] for k in np.unique(at)]
    head = ["no gap", "unexplained", "partly", "ambiguous", "one cause, sure", "cases"]
    text = (
        f"The base model with forces changed at each place by a random polynomial of degree {DEGREE} in depth, by "
        f"at most {100 * AMPLITUDE[0]:g} to {100 * AMPLITUDE[1]:g} % (log-uniform), the same for all tests and "
        'channels there; places have nothing to do with each other.  Right is "unexplained" or "partly"; a set of '
        "causes is wrong, one sure cause most of all."
    )
    say(
        [
            "## A smooth gap of no known cause",
            "",
            text,
            *table(["variant", *head], [[k, *row(v)] for k, v in verdicts.items()]),
            "The last of these by the largest relative change:",
            *table(["change", *head], sizes),
        ]
    )
