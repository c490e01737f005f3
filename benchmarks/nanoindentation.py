"""Moduli of 2 500 public curves from 30 own simulations: python benchmarks/nanoindentation.py FOLDER [options]

    FOLDER           a copy of the repository PatrickGio/Nanoindentation on GitHub, or its folder data/SynthData;
                     it has no licence, so nothing of it may be kept here
    --runs N         simulations to learn from (30)
    --level LEVEL    of their meshes (standard)
    --support KIND   of the base: plate (it slides, as in those curves) or bonded
    --inscribed      the cylinder that stands for the square block has its half width as radius, not its area
    --seeds N        designs for the surrogate that learns from their own curves (5)

The curves (Giolando et al., "AI-dente", Soft Matter 2023): a ball of 25 µm, pressed by half its radius into a square
neo-Hookean block of half width W and thickness H, 5 to 40 radii, K/µ = 1000, on a sliding base; FEBio, a quarter with
linear hexahedra of a ninth of the radius.  That it is without friction is assumed.  Networks trained on 10 000 such
runs over (W, H, µ) gave their µ with R² = 0.99998 by least squares and 0.99985 directly.

Of these variables, exact similarity leaves F/(µ R²) = f(W/R, H/R, depth/R).  Here f is the surrogate of a few
simulations, and µ of every curve follows from linear least squares over its depths.  The square is replaced by the
circle of equal area, which makes the simulation axisymmetric.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from fem_backend import meshing  # isort: skip  # noqa: F401  (pins the threads before numpy)

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme, SimulationFailed
from rso.doe import Box, design
from rso.emulation import WholeCurve, fit_curve

INPUT, OUTPUT = "Model_Input_NH_ValPred", "Model_Output_NH_ValPred"
BALL = 25e-6  # radius of their ball, m
DEPTHS = np.arange(1, 21) / 40.0  # of their readings, in radii
K_OVER_MU = 1000.0
# Over their range, 5 to 40, on all sides: no curve is extrapolated to.
BOX = Box(("W/R", "H/R"), ("1", "1"), (4.8, 4.8), (42.0, 42.0), (True, True))
R, MU = 3.0, 0.01  # of the own simulations, mm and MPa: any would do


def read(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sizes (n, 2) = (W/R, H/R), moduli µ (n,) in Pa and forces (n, 20) in N of the neo-Hookean curves in a folder.

    Raises FileNotFoundError where the folder has no such files, ValueError where their shapes do not agree.
    """
    for place in (folder, folder / "data" / "SynthData"):
        if (place / INPUT).is_file() and (place / OUTPUT).is_file():
            break
    else:
        raise FileNotFoundError(
            f"{folder}: no {INPUT} and {OUTPUT} there or in data/SynthData; "
            "copy the repository PatrickGio/Nanoindentation from GitHub and name its folder"
        )
    given, forces = np.loadtxt(place / INPUT, ndmin=2), np.loadtxt(place / OUTPUT, ndmin=2).T
    if given.shape[1:] != (3,) or forces.shape != (len(given), len(DEPTHS)):
        raise ValueError(f"{place}: sizes {given.shape} and forces {forces.shape}, should be (n, 3) and (n, 20)")
    return given[:, :2], given[:, 2], forces


def simulate(size: np.ndarray, level: str, support: str, inscribed: bool) -> np.ndarray:
    """f = F/(µ R²) (20,) of a ball on a cylinder for the block of `size` (W/R, H/R)."""
    W, H = (float(v) for v in size)
    settings: dict[str, Any] = {
        "specimen": {
            "shape": "cylinder",
            "radius": R * W * (1.0 if inscribed else 2.0 / np.sqrt(np.pi)),
            "height": R * H,
        },
        "indenter": {"shape": "sphere", "radius": R},
        "support": {"kind": support},
        "mesh": {"level": level},
        "derivatives": False,
    }
    case = Case("slab", Programme.ramp(tuple(float(f"{v:.6g}") for v in DEPTHS * R)), settings)
    return np.asarray(BACKEND({"mu": MU, "D1": 2.0 / (K_OVER_MU * MU)}, case).channels["Fz"]) / (MU * R**2)


def learn(sizes: np.ndarray, f: np.ndarray) -> WholeCurve:
    """The surrogate of f (n, 20) over (n, 2) sizes: kriging of the modes of ln f."""
    return fit_curve(BOX.to_unit(sizes), DEPTHS, f, seed=1, kind="kriging", log=True)


def moduli(forces: np.ndarray, f: np.ndarray) -> np.ndarray:
    """µ (n,) in Pa that minimises Σ (F − µ R² f)² over the depths; forces (n, 20) N, f (n, 20) or (20,)."""
    f = np.broadcast_to(f, forces.shape)
    return np.einsum("nk,nk->n", forces, f) / np.einsum("nk,nk->n", f, f) / BALL**2


def row(name: str, found: np.ndarray, mu: np.ndarray) -> None:
    """One line of the table."""
    r2 = 1.0 - float(((found - mu) ** 2).sum() / ((mu - mu.mean()) ** 2).sum())
    off = 100.0 * (found / mu - 1.0)
    median, high, most = np.percentile(np.abs(off), [50, 95, 100])
    print(
        f"{name:<62} {len(mu):5d}  {r2:.7f}  {np.median(off):+7.3f} {off.std():6.3f}  "
        f"{median:6.3f} {high:6.3f} {most:6.2f}",
        flush=True,
    )


def nearest(design_: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Indices (n,) of different curves, the nearest to each point of a design in the unit square."""
    X, taken = BOX.to_unit(sizes), []
    for point in design_:
        far = ((X - point) ** 2).sum(1)
        far[taken] = np.inf
        taken.append(int(far.argmin()))
    return np.array(taken)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--level", default="standard")
    parser.add_argument("--support", default="plate")
    parser.add_argument("--inscribed", action="store_true")
    parser.add_argument("--seeds", type=int, default=5)
    args = parser.parse_args()
    sizes, mu, forces = read(args.folder)
    theirs = forces / (mu[:, None] * BALL**2)

    wall, cpu = time.perf_counter(), time.process_time()
    points, f = [], []
    for point in design("osf", 2, args.runs, seed=1):
        try:
            f.append(simulate(BOX.from_unit(point), args.level, args.support, args.inscribed))
            points.append(point)
        except SimulationFailed as error:
            print(f"W/R, H/R = {np.round(BOX.from_unit(point), 2)}: {error}", flush=True)
    print(
        f"{len(f)} simulations: {time.perf_counter() - wall:.1f} s, CPU {time.process_time() - cpu:.1f} s", flush=True
    )
    wall, cpu = time.perf_counter(), time.process_time()
    surrogate = learn(BOX.from_unit(np.array(points)), np.array(f))
    own = surrogate.mean(BOX.to_unit(sizes))
    found = moduli(forces, own)
    print(f"surrogate, {len(mu)} moduli: {time.perf_counter() - wall:.1f} s, CPU {time.process_time() - cpu:.1f} s\n")

    print(f"{'':<62} {'n':>5}  {'R²':<9}  {'µ found / µ - 1, per cent':<}")
    print(f"{'':<62} {'':>5}  {'':<9}  {'median':>7} {'sd':>6}  {'|median|':>6} {'95 %':>4} {'most':>6}")
    row("Hertz", moduli(forces, 16.0 / 3.0 * DEPTHS**1.5), mu)
    row(f"{len(f)} own simulations", found, mu)
    known = nearest(np.array(points), sizes)  # as many of their curves that a factor is learnt from
    rest = np.setdiff1d(np.arange(len(mu)), known)
    one = np.exp(np.log(found[known] / mu[known]).mean())
    row(f"the same over {one:.4f}, the mean of {len(known)} curves", found[rest] / one, mu[rest])
    each = np.exp(np.log(theirs[known] / own[known]).mean(0))
    row(f"the same with one factor a depth, of {len(known)} curves", moduli(forces[rest], each * own[rest]), mu[rest])
    for seed in range(1, args.seeds + 1):
        known = nearest(design("osf", 2, args.runs, seed=seed), sizes)
        rest = np.setdiff1d(np.arange(len(mu)), known)
        f_rest = learn(sizes[known], theirs[known]).mean(BOX.to_unit(sizes[rest]))
        row(f"{args.runs} of their curves, design {seed}", moduli(forces[rest], f_rest), mu[rest])

    ratio = own / theirs - 1.0
    print("\nown force over theirs - 1, per cent, at depth/R: median, 5 and 95 % of the curves")
    for k in range(1, len(DEPTHS), 2):
        low, middle, high = 100.0 * np.percentile(ratio[:, k], [5, 50, 95])
        print(f"  {DEPTHS[k]:.3f}  {middle:+.2f}  {low:+.2f} {high:+.2f}")
    print("\nµ found / µ - 1, per cent, mean and sd by W/R and H/R")
    for low, high in ((5, 6), (6, 8), (8, 12), (12, 20), (20, 40)):
        words = []
        for column in (0, 1):
            there = (sizes[:, column] >= low) & (sizes[:, column] <= high)
            off = 100.0 * (found[there] / mu[there] - 1.0)
            words.append(f"{off.mean():+.2f} ({off.std():.2f})")
        print(f"  {low} to {high}: {'   '.join(words)}")


if __name__ == "__main__":
    main()
