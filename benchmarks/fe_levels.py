"""Cost and accuracy of the mesh levels, and of the linear solvers: python benchmarks/fe_levels.py

Three tables: every level on a run to 4 mm, the error that augmentations leave, and seconds per factorisation on the
standard mesh (last).
Times are CPU seconds of one thread.
"""

from __future__ import annotations

import time
from dataclasses import replace

from fem_backend.kinematics import tetrahedra
from fem_backend.simulation import assembly, experiment, indentation
from fem_backend.solver import direct

from fem_backend.materials import stress  # isort: skip (pins the threads)
from fem_backend.laws import NeoHooke
from fem_backend.simulation.assembly import AssembledModel
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.indentation import Result
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver.load_steps import Control, Instant

import numpy as np  # isort: skip

ASKED = np.array([1.0, 2.0, 3.0, 4.0])
KNOBS = Knobs(mu=0.0099997, D1=5.8)
INDEPENDENT = 0.99997 * np.array([0.08450, 0.22932, 0.40092, 0.58149])  # N, fe_limit.py, error 0.02 to 0.06 %
REPEATS = {"coarse": 3, "standard": 2, "fine": 1, "reference": 1}  # the last is what the others are compared with


def model_of(level: str) -> tuple[Settings, AssembledModel]:
    """The level's model on the mesh of this user's cache."""
    settings = experiment.read_settings({"mesh": {"level": level}})
    return settings, assembly.model_for(settings, KNOBS, assembly.placement_of(settings, KNOBS), None)


def run(settings: Settings, built: AssembledModel, asked: np.ndarray = ASKED) -> Result:
    """Run to the asked travels at 1 mm/s."""
    instants = [Instant(s, s, True) for s in asked]
    return indentation.simulate_indentation(settings, KNOBS, assembly.placement_of(settings, KNOBS), built, instants)


def timed(settings: Settings, built: AssembledModel, repeats: int) -> tuple[Result, float]:
    """Result and the median of the CPU seconds."""
    results = [run(settings, built) for _ in range(repeats)]
    return results[0], float(np.median([r.cpu_s for r in results]))


def levels(models: dict[str, tuple[Settings, AssembledModel]]) -> None:
    """Table of the levels; percentages are those of the depth where they are largest."""
    run(*models["coarse"], np.array([0.2]))  # compile the kernels
    runs = {level: timed(*models[level], REPEATS[level]) for level in REPEATS}
    finest = list(runs.values())[-1][0].Fz
    print(f"solver {direct.available()}; run to 4 mm, forces at {', '.join(f'{d:g}' for d in ASKED)} mm\n")
    print(
        f"{'level':9} {'nodes':>7} {'dofs':>7} {'CPU s':>7} {'its':>4} {'fact.':>5} {'F(4) N':>8}"
        f" {'to finest %':>26} {'to NGSolve %':>26}"
    )
    for level, (result, seconds) in runs.items():
        body = models[level][1].body
        to_finest, to_other = (100 * (result.Fz / other - 1) for other in (finest, INDEPENDENT))
        print(
            f"{level:9} {len(body.nodes):7d} {body.pattern.size:7d} {seconds:7.2f} {result.counters.iterations:4d} "
            f"{result.counters.factorisations:5d} {result.Fz[-1]:8.5f} "
            f"{_row(to_finest):>26} {_row(to_other):>26}"
        )


def _row(percent: np.ndarray) -> str:
    return " ".join(f"{p:+.2f}" for p in percent)


def solvers(built: AssembledModel, repeats: int = 3) -> None:
    """Seconds per factorisation and per solution of the undeformed stiffness on one mesh."""
    body = built.body
    state = stress.evaluate_stress(NeoHooke(KNOBS.mu, KNOBS.D1), np.zeros((*body.w.shape, 3, 3)), tangent=True)
    data = tetrahedra.stiffness(body, state.F, state.S_geometric, state.C)
    b = np.random.default_rng(0).normal(size=body.pattern.size)
    print(f"\nstandard mesh, {body.pattern.size} dofs: CPU s, median of {repeats}")
    print(f"{'solver':9} {'analysis':>9} {'factor':>9} {'solve':>9} {'residual':>9}")
    for name in ("pardiso", "superlu"):
        try:
            start = time.process_time()
            factor = direct.solver(body.pattern, name)
            factor(data)  # pardiso analyses here
            first = time.process_time() - start
        except ImportError:
            print(f"{name:9} not installed")
            continue
        made, solved = [], []
        for _ in range(repeats):
            start = time.process_time()
            solve = factor(data)
            made.append(time.process_time() - start)
            start = time.process_time()
            x = solve(b)
            solved.append(time.process_time() - start)
        seconds = float(np.median(made))
        residual = np.linalg.norm(_times(body.pattern, data, x) - b) / np.linalg.norm(b)
        print(f"{name:9} {max(first - seconds, 0.0):9.3f} {seconds:9.3f} {np.median(solved):9.4f} {residual:9.1e}")


def augmentations(settings: Settings, built: AssembledModel) -> None:
    """Force error that is left after 0, 1 and 2 augmentations, against 4 of them, and what they cost."""
    counts = (0, 1, 2, 4)
    runs = [run(replace(settings, control=Control(augmentations=k)), built) for k in counts]
    print("\ncoarse mesh: contact error of the force in % (against 4 augmentations) and Newton iterations")
    for k, result in zip(counts, runs, strict=True):
        row = " ".join(f"{100 * p:+.4f}" for p in result.Fz / runs[-1].Fz - 1)
        print(f"{k:2d} augmentations {row}  {result.counters.iterations:4d} its")


def _times(pattern: tetrahedra.Pattern, data: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The symmetric matrix times x."""
    rows = np.repeat(np.arange(pattern.size), np.diff(pattern.indptr))
    off = rows != pattern.indices
    out = np.bincount(rows, data * x[pattern.indices], minlength=pattern.size)
    return out + np.bincount(pattern.indices[off], data[off] * x[rows[off]], minlength=pattern.size)


if __name__ == "__main__":
    MODELS = {level: model_of(level) for level in REPEATS}
    levels(MODELS)
    augmentations(*MODELS["coarse"])
    solvers(MODELS["standard"][1])
