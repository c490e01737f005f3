"""CPU time of typical jobs of the finite element model, one thread, medians of repeats; goals beside.

`slopes` is the time of the derivatives over that of the rest of the run (goal 5 %); penalty jobs are without
multipliers, `off` is how far their Fz is from that of the same with multipliers, at the worst of the travels.

    OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 python benchmarks/fe_speed.py [--repeats 3] [--jobs top,half,...]

Set-up (imports, compilation, mesh, analysis of the matrix) is apart: every job runs once before it is timed.
"""

from __future__ import annotations

import fem_backend  # noqa: F401 - before numpy: it sees to one thread, and waiting threads count as CPU time

# isort: split
import argparse
import dataclasses
import hashlib
import tempfile
import time
from pathlib import Path

import numpy as np

from fem_backend.backend import BACKEND
from fem_backend.kinematics import tetrahedra
from fem_backend.solver import condensation, direct, newton
from rso.contract import Case, Programme, object_path

SET1 = {"mu": 0.0099997, "D1": 5.8}
ASKED = (1.0, 2.0, 3.0, 4.0)
CYCLES = [Programme((0, 4 / v, 8 / v), (0, 4, 0), ASKED) for v in (1 / 6, 0.5, 5 / 3)]
BOWL = {"support": {"kind": "bowl", "clearance": 1.0, "friction": 0.2}}


def jobs() -> dict[str, tuple[str, list[tuple[dict, Case]], bool]]:
    """Name → goal, runs, whether from an anchor."""

    def case(programme: Programme | None = None, level: str = "coarse", **settings: object) -> Case:
        return Case("speed", programme or Programme.ramp(ASKED), {"mesh": {"level": level}, **settings})

    grid = tuple(0.5 * k for k in range(1, 9))
    mark = {"profile": [[float(x), 5.0] for x in range(-30, 31, 5)]}
    example = [case(Programme.ramp(grid), **mark), case(Programme.ramp((*grid, 5.0, 6.2)))]
    example += [case(Programme((0, 4 / v, 8 / v), (0, 4, 0), grid)) for v in (1 / 6, 0.5, 5 / 3)]
    example += [case(Programme.ramp(grid), point=p) for p in ([2.5, 2.5], [20.0, 0.0])]
    relaxing = SET1 | {"prony_g": 0.3, "prony_tau": 8.0}
    plan = [(relaxing, case(c)) for c in (Programme.ramp(ASKED), *CYCLES)]
    plan += [(relaxing, case(Programme.ramp((1.0, 2.0, 3.0)), point=p)) for p in ([2.5, 2.5], [20.0, 0.0])]
    loose = {"support": {"kind": "bowl", "clearance": 4.0, "friction": 0.1}}
    slides = case(Programme.ramp(tuple(0.5 * k for k in range(1, 9))), point=[20.0, 0.0], multipliers=False, **loose)
    return {
        "top, coarse": ("1.5 s at 1 %", [(SET1, case())], False),
        "top, standard": ("", [(SET1, case(level="standard"))], False),
        "top, fine": ("5 s at 0.3 %", [(SET1, case(level="fine"))], False),
        "top, limit": ("20 s at 0.1 %", [(SET1, case(level="limit"))], False),
        "top, coarse, anchor": ("0.5 s at 1 %", [(SET1 | {"D1": 12.0}, case())], True),
        "top, fine, anchor": ("1.5 s at 0.3 %", [(SET1 | {"D1": 12.0}, case(level="fine"))], True),
        "top, coarse, penalty": ("", [(SET1, case(multipliers=False))], False),
        "top, fine, penalty": ("5 s at 0.3 %", [(SET1, case(level="fine", multipliers=False))], False),
        "top, coarse, anchor, penalty": ("0.5 s at 1 %", [(SET1 | {"D1": 12.0}, case(multipliers=False))], True),
        "top, fine, anchor, penalty": (
            "1.5 s at 0.3 %",
            [(SET1 | {"D1": 12.0}, case(level="fine", multipliers=False))],
            True,
        ),
        "(20, 0), half": ("6 s at 1 %", [(SET1, case(point=[20.0, 0.0]))], False),
        "(2.5, 2.5), whole": ("15 s at 1 %", [(SET1, case(point=[2.5, 2.5]))], False),
        "bowl with friction": ("5 s at 1 %", [(SET1, case(**BOWL))], False),
        "bowl, slides, (20, 0)": ("", [({"mu": 0.01, "D1": 10.0}, slides)], False),
        "friction 0.3": ("", [(SET1 | {"friction": 0.3}, case())], False),
        "Prony, three cycles": ("10 s at 1 %", [(relaxing, case(c)) for c in CYCLES], False),
        "example, elastic": ("60 s at 1 %", distinct([(SET1, c) for c in example]), False),
        "plan of six tests": ("60 s at 1 %", plan, False),
    }


def distinct(runs: list[tuple[dict, Case]]) -> list[tuple[dict, Case]]:
    """The runs that a study would compute: what is the same in its canonical form, only once."""
    known = {}
    for values, case in runs:
        kept, plain = BACKEND.canonical(values, case)
        known.setdefault(repr((sorted(kept.items()), plain.settings, plain.programme)), (kept, plain))
    return list(known.values())


def anchored(values: dict, case: Case, folder: Path) -> Case:
    """The case with its anchor, as a study hands it on."""
    made = BACKEND.make(BACKEND.recipes(values, case)["anchor"])
    sha = hashlib.sha256(made).hexdigest()
    path = object_path(folder, sha)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(made)
    return dataclasses.replace(case, artefacts={"anchor": sha}, objects=str(folder))


def apart(values: dict, case: Case, Fz: np.ndarray) -> float:
    """Largest relative difference of Fz from that with multipliers."""
    exact = BACKEND(values, dataclasses.replace(case, settings={**case.settings, "multipliers": True}))
    return float(np.abs(Fz / exact.channels["Fz"] - 1.0).max())


class Clock:
    """CPU time inside some functions."""

    def __init__(self) -> None:
        self.s = 0.0

    def watch(self, function):  # type: ignore[no-untyped-def]
        def timed(*args, **more):  # type: ignore[no-untyped-def]
            start = time.process_time()
            try:
                return function(*args, **more)
            finally:
                self.s += time.process_time() - start

        return timed


def overhead() -> float:
    """CPU time of a whole run over that of its assembly, factorisations and solutions."""
    case = Case("speed", Programme.ramp(ASKED), {"mesh": {"level": "standard"}})
    BACKEND(SET1, case)
    clock = Clock()
    watched = [
        (tetrahedra, "internal_force"),
        (tetrahedra, "stiffness"),
        (tetrahedra, "displacement_gradients"),
        (newton.stress, "evaluate"),
        (direct._Pardiso, "_call"),
        (direct.Schur, "_call"),
        (condensation, "cho_factor"),
        (condensation, "cho_solve"),
    ]
    kept = [getattr(owner, name) for owner, name in watched]
    for (owner, name), function in zip(watched, kept, strict=True):
        setattr(owner, name, clock.watch(function))
    start = time.process_time()
    BACKEND(SET1, case)
    total = time.process_time() - start
    for (owner, name), function in zip(watched, kept, strict=True):
        setattr(owner, name, function)
    return total / clock.s


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--jobs", default="")
    options = parser.parse_args()
    print(f"solver: {direct.available()}")
    print(f"{'job':28s} {'CPU s':>7s} {'dofs':>6s} {'its':>5s} {'slopes':>6s} {'off':>6s}  goal")
    with tempfile.TemporaryDirectory() as folder:
        for name, (goal, runs, from_anchor) in jobs().items():
            if options.jobs and not any(part in name for part in options.jobs.split(",")):
                continue
            if from_anchor:
                runs = [(v, anchored(v, c, Path(folder))) for v, c in runs]
            seconds, shares = [], []
            for repeat in range(options.repeats + 1):
                start = time.process_time()
                responses = [BACKEND(v, c) for v, c in runs]
                if repeat:
                    seconds.append(time.process_time() - start)
                    differentiated = sum(r.info["derivatives_cpu_s"] for r in responses)
                    shares.append(differentiated / (seconds[-1] - differentiated))
            iterations = sum(r.info["iterations"] for r in responses)
            off = "" if "penalty" not in name else f"{apart(*runs[-1], responses[-1].channels['Fz']):.2%}"
            print(
                f"{name:28s} {np.median(seconds):7.2f} {responses[-1].info['dofs']:6d} {iterations:5d} "
                f"{np.median(shares):6.1%} {off:>6s}  {goal}",
                flush=True,
            )
    if direct.available() == "pardiso":
        print(f"whole run / (assembly + factorisation + solution), standard level: {overhead():.2f}  (goal 1.2)")


if __name__ == "__main__":
    main()
