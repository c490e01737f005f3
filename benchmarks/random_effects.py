"""How often intervals of random effects hold the truth, with the prediction by τ̂ alone beside the one in use.

    python benchmarks/random_effects.py [--sets 400]

Specimens θ_i ~ N(1, τ²) with standard errors from 0.05 to 0.3; shares of data sets at a nominal 90 %.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy import stats

from rso.inference.random_effects import gaussian_likelihood, random_effects

CASES = ((6, 0.15), (6, 0.3), (12, 0.3))  # specimens, τ


def main() -> None:
    """Print a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sets", type=int, default=400)
    sets = parser.parse_args().sets
    print("specimens    tau   mean  next one  next one by tau alone")
    for k, tau in CASES:
        rng, held = np.random.default_rng(99), np.zeros(3)
        for _ in range(sets):
            s = rng.uniform(0.05, 0.3, k)
            y = 1.0 + tau * rng.standard_normal(k) + s * rng.standard_normal(k)
            new = 1.0 + tau * rng.standard_normal()
            found = random_effects([gaussian_likelihood(*one) for one in zip(y, s, strict=True)])
            # Higgins, Thompson & Spiegelhalter, J. R. Stat. Soc. A 172 (2009) 137, eq. 12
            reach = stats.t.ppf(0.95, k - 2) * np.hypot(found.tau, found.sd)
            alone = (found.mean - reach, found.mean + reach)
            pairs = ((1.0, found.interval), (new, found.prediction), (new, alone))
            held += [a <= x <= b for x, (a, b) in pairs]
        mean, one, plain = 100.0 * held / sets
        print(f"{k:9d} {tau:6.2f} {mean:5.1f} % {one:7.1f} % {plain:20.1f} %", flush=True)


if __name__ == "__main__":
    main()
