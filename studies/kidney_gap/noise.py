"""The verdict on the kidney's curve under three statements of what its instruments are uncertain by.

Run: python studies/kidney_gap/noise.py      (after `rso diagnose studies/kidney_gap`, whose simulations it uses)
"""

from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from rso import discrepancy
from rso.data import Noise
from rso.discrepancy.evidence.attribution import Evidence, comparisons
from rso.discrepancy.study_diagnosis import ask
from rso.evaluation import run_all
from rso.evaluation.store import RunStore
from rso.study.loader import load_study

FOLDER = Path(__file__).parent
STATEMENTS = {  # force N, depth mm, gain
    "as in the study": (0.002, 0.05, 0.01),
    "data sheet of the sensor": (0.010, 0.05, 0.05),
    "depth trusted to 0.01 mm": (0.002, 0.01, 0.01),
}


def main() -> None:
    """Print verdict, p and leading causes of each statement."""
    asked = ask(load_study(FOLDER / "study.toml"))
    with RunStore(FOLDER / "results") as store, ThreadPoolExecutor(1) as one:
        library = discrepancy.build_library(
            asked.base, asked.plan, asked.effects, lambda tasks: run_all(asked.base.backend, tasks, store, one)
        )
    print(f"{'statement':26} {'verdict':10} {'p':>6} {'misfit':>7}  leading causes (probability given a gap)")
    for name, (force, depth, gain) in STATEMENTS.items():
        noise = Noise(Fz=force, depth=depth, gain=gain, correlation=2.2)
        experiments = tuple(dataclasses.replace(e, noise=noise) for e in library.plan.experiments)
        found = discrepancy.diagnose(
            dataclasses.replace(library, plan=dataclasses.replace(library.plan, experiments=experiments)), seed=1
        )
        causes = ", ".join(f"{c.effect.name} {c.probability:.2f}" for c in found.causes[:3])
        print(f"{name:26} {found.verdict:10} {found.p_value:6.3f} {found.size_over_noise:7.2f}  {causes}")
        offset = next(e for e in library.effects if e.name == "offset")
        print(f"{'':26} ln Bayes factor of a late contact {_factor(library, found, offset):.1f}")


def _factor(library: discrepancy.Library, found: discrepancy.Diagnosis, effect: discrepancy.Effect) -> float:
    evidence = Evidence(found.bench, library.effects)
    (contest,) = comparisons(evidence, library.plan.values()[None])
    at = [h.name for h in contest.hypotheses].index(effect.name)
    return float(contest.log_evidence[at] - contest.log_evidence[0])


if __name__ == "__main__":
    main()
