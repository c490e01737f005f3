"""How often a fit is sure of a wrong modulus where the model lacks an effect, and how often it is doubted.

    python benchmarks/unmodelled_effects.py [CASES] [SEED]

One record of a ball of 3 mm on a bonded layer in closed form (`rso.benchmarks.indentation`), whose noise nobody states.
Thickness, depth, noise, gain, contact and truth are drawn; the readings come from the model or have one effect more.
A fit is doubted where `rso.inference.systematic_residuals` finds what is missed over many readings alike.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from rso.benchmarks import indentation
from rso.calibration.readings import as_data
from rso.core.correlation import exponential
from rso.data import Measurement, Noise, Repeat, combine
from rso.doe import Box
from rso.inference import Misfit, Model, all_minima, determine, with_autocorrelation
from rso.inference.systematic_residuals import systematic_misfit

RADIUS = 3.0  # mm
BOX = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.001, 1.0), (0.05, 200.0), (True, True))
EFFECTS = ("none", "compliance", "stiffening", "other thickness", "skin", "other exponent")


def record(rng: np.random.Generator, effect: str, truth: np.ndarray, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth and force (n,) of a test with an effect of a drawn size."""
    mu, D1 = BOX.from_unit(truth[None])[0]
    h = np.linspace(0.0, rng.uniform(0.5, 2.0), int(rng.integers(31, 121)))[1:]
    other = thickness * rng.choice([0.6, 1.6]) if effect == "other thickness" else thickness
    F, s = indentation(h, mu, D1, RADIUS, other), h / h[-1]
    u = h + rng.uniform(0.1, 0.6) * h[-1] * F / F[-1] if effect == "compliance" else h
    F = F * (1.0 + rng.uniform(0.2, 1.5) * s**2) if effect == "stiffening" else F
    F = F + rng.uniform(0.1, 0.6) * F[-1] * s if effect == "skin" else F
    F = F * s ** rng.uniform(-0.4, 0.4) if effect == "other exponent" else F
    n, white = len(u), 10 ** rng.uniform(-3.3, -1.8) * F[-1]
    y = F * (1.0 + 0.01 * rng.standard_normal()) + np.interp(u - 0.01 * h[-1] * rng.standard_normal(), u, F) - F
    along = np.linalg.cholesky(exponential(u, 0.15 * u[-1]) + 1e-10 * np.eye(n)) @ rng.standard_normal(n)
    return u, y + 0.002 * F[-1] * along + white * rng.standard_normal(n)


def judged(seed: int, effect: str) -> tuple[bool, bool, bool]:
    """Whether μ would be called determined, whether its interval holds the truth, whether the fit is doubted."""
    rng = np.random.default_rng((seed, EFFECTS.index(effect)))
    truth, thickness = rng.uniform(0.1, 0.9, 2), rng.uniform(4.0, 20.0)
    u, y = record(rng, effect, truth, thickness)
    repeat = Repeat("1", u, None, {"Fz": y}, {}, np.full(len(u), "loading"))
    curve = combine(Measurement(Path("record.csv"), "force", (repeat,), ()), Noise())
    data = as_data("record", "record", curve, curve.compared)
    model = Model(
        BOX, lambda X: np.array([indentation(data.depth, m, d, RADIUS, thickness) for m, d in BOX.from_unit(X)])
    )
    misfit = Misfit(model, (data,))
    found = determine(with_autocorrelation(misfit, all_minima(misfit, seed=0)[0].x), seed=0, mcmc=False)
    mu = found.of("mu")
    held = mu.profile_interval.low <= truth[0] <= mu.profile_interval.high
    return mu.verdict.word == "determined", bool(held), bool(systematic_misfit(found))


def main(cases: int = 50, seed: int = 100) -> None:
    """Print the table as Markdown."""
    print("| the readings have | doubted | determined without doubts | of these wrong | determined | of these wrong |")
    print("|---|---|---|---|---|---|")
    for effect in EFFECTS:
        rows = [judged(seed + k, effect) for k in range(cases)]
        before, now = (
            [held for sure, held, doubted in rows if sure and not (doubted and use)] for use in (False, True)
        )
        counts = [sum(doubted for *_, doubted in rows), len(before), before.count(False), len(now), now.count(False)]
        print(f"| {effect} | {counts[0]} of {cases} | {' | '.join(map(str, counts[1:]))} |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
