"""Do intervals of one record hold the truth where its readings remember each other and nobody says so?

    python benchmarks/remembering.py [--sets 100]

A ball of 3 mm on a bonded layer of 8 mm, pressed by 4 mm, mu 0.01 MPa and D1 20 1/MPa; noise of 2 mN that remembers
along a length (AR(1); 0: white), nothing stated.  Printed are by number of readings and length the share of 90 %
profile intervals of mu that hold it, with the memory that the residuals show and taken for white, and in how many sets
it shows.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from rso.benchmarks import indentation
from rso.calibration.readings import as_data
from rso.data import Measurement, Noise, Repeat, combine
from rso.doe import Box
from rso.inference import Misfit, Model, all_minima, determine, with_autocorrelation

BOX = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.003, 2.0), (0.03, 200.0), (True, True))
MU, D1, SD = 0.01, 20.0, 2e-3


def misfit(u: np.ndarray, F: np.ndarray) -> Misfit:
    """Likelihood of one record F (n,) N at depths u (n,) mm of which nothing is stated."""
    record = Repeat("1", u, None, {"Fz": F}, {}, np.full(len(u), "loading"))
    curve = combine(Measurement(Path("record.csv"), "force", (record,), ()), Noise())
    data = as_data("top", "top", curve, np.full(len(u), True))
    return Misfit(Model(BOX, lambda X: indentation(data.depth, *BOX.from_unit(X).T[:, :, None], 3.0, 8.0)), (data,))


def covered(m: Misfit) -> bool:
    """Whether the interval of mu holds it."""
    i = determine(m, seed=0, mcmc=False).of("mu").profile_interval
    low, high = BOX.from_unit(np.array([[i.low, 0.5], [i.high, 0.5]]))[:, 0]
    return bool(low <= MU <= high)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=100)
    sets = parser.parse_args().sets
    print("readings  length mm  holds  as white  memory seen")
    for n, length in ((120, 0.0), (120, 0.1), (120, 0.3), (40, 0.0), (40, 0.1), (40, 0.3)):
        u = np.linspace(4.0 / n, 4.0, n)
        C = np.exp(-np.abs(np.subtract.outer(u, u)) / length) if length else np.eye(n)
        root, rows = SD * np.linalg.cholesky(C), []
        for seed in range(sets):
            plain = misfit(u, indentation(u, MU, D1, 3.0, 8.0) + root @ np.random.default_rng(seed).standard_normal(n))
            knows = with_autocorrelation(plain, all_minima(plain, seed=0)[0].x)
            rows.append((covered(knows), covered(plain), knows.data[0].memory > 0.0))
        holds, white, seen = np.mean(rows, axis=0)
        print(f"{n:8d}  {length:9.1f}  {holds:5.2f}  {white:8.2f}  {seen:11.2f}", flush=True)


if __name__ == "__main__":
    main()
