"""Do stated errors cover what the levels coarse and standard miss of a skin?  Beside the level fine as it is.

    python benchmarks/fe_skins.py [--random 14]

One row a skin (ratio, thickness; at the top, K/μ = 60, 0.25 to 4 mm deep) with error over stated error of the force at
each travel; then, with --random, of as many experiments at random (R 3 to 8 mm, K/μ 5 to 200, at the top and (20, 0)).
Below each: share of the points below what is stated, and how many times that is the error in the median, by channel.
About 6 CPU minutes for the grid, 5 for 14 at random; three soft and thick skins have no answer and are named.
"""

from __future__ import annotations

from fem_backend.backend import BACKEND  # isort: skip (pins the threads)

import argparse
import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rso.contract import Case, Programme, Response, SimulationFailed

LEVELS = ("coarse", "standard")
CHANNELS = ("Fz", "contact_area", "contact_radius", "peak_pressure", "bulge", "uz_max")
MU = 0.01
TRAVELS = (0.25, 0.5, 1.0, 2.0, 4.0)

Skin = tuple[dict[str, float], tuple[float, ...], dict[str, Any]]  # knobs, travels, settings without the mesh


def grid() -> Iterator[Skin]:
    """Soft and stiff, thin and thick."""
    for ratio, thickness in itertools.product((0.1, 0.3, 3.0, 10.0, 30.0), (0.15, 0.3, 0.5, 1.0, 2.0)):
        yield knobs(60.0, ratio, thickness), TRAVELS, {}


def drawn(n: int, seed: int = 77) -> Iterator[Skin]:
    """Other balls, bodies and places."""
    rng = np.random.default_rng(seed)

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    for _ in range(n):
        R = float(rng.choice([3.0, 3.0, 5.0, 8.0]))
        values = knobs(log(5.0, 200.0), log(0.2, 25.0), log(0.1, 1.5))
        settings = {"indenter": {"shape": "sphere", "radius": R}, "point": [float(rng.choice([0.0, 0.0, 20.0])), 0.0]}
        yield values, tuple(float(s * R) for s in (0.1, 0.3, 0.7, 1.2)), settings


def knobs(stiffness: float, ratio: float, thickness: float) -> dict[str, float]:
    """Of K/μ and a skin."""
    return {"mu": MU, "D1": 2.0 / (stiffness * MU), "skin_ratio": ratio, "skin_thickness": thickness}


def run(skin: Skin, level: str) -> Response:
    """One run of a level."""
    values, travels, settings = skin
    return BACKEND(values, Case("skin", Programme.ramp(travels, 0.5), {**settings, "mesh": {"level": level}}))


def table(skins: Iterator[Skin]) -> None:
    """Rows of the skins and what is covered."""
    shares: dict[tuple[str, str], list[np.ndarray]] = {}
    for skin in skins:
        label = row(skin[0])
        try:
            fine, *others = (run(skin, level) for level in ("fine", *LEVELS))
        except SimulationFailed as failed:
            print(f"{label} {failed.cause}", flush=True)
            continue
        for level, response in zip(LEVELS, others, strict=True):
            for name in CHANNELS:
                off = np.abs(np.asarray(response.channels[name]) - fine.channels[name])
                shares.setdefault((name, level), []).append(off / np.asarray(response.error[name]))
            label += f"   {level} " + " ".join(f"{q:5.2f}" for q in shares["Fz", level][-1])
        print(label, flush=True)
    for (name, level), parts in sorted(shares.items()):
        q = np.concatenate(parts)
        times = np.median(1.0 / np.maximum(q, 1e-12))
        print(f"{name:15s} {level:9s} {100 * np.mean(q < 1.0):4.0f} % below, {times:.1f} times")


def row(values: Mapping[str, float]) -> str:
    """How a skin is called."""
    return f"K/mu {2.0 / (values['D1'] * MU):5.0f} ratio {values['skin_ratio']:5.2f} {values['skin_thickness']:4.2f} mm"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--random", type=int, default=0)
    options = parser.parse_args()
    table(grid())
    if options.random:
        table(drawn(options.random))


if __name__ == "__main__":
    main()
