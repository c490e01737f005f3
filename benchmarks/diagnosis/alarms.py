"""False alarms and gaps found by the limit of the log odds of a gap, on cases of a library's own.

    python benchmarks/diagnosis/alarms.py STUDY STORE [--cases 400]

STUDY has been diagnosed; STORE holds its simulations.  Only the first contest is held, which decides whether there is
a gap.  The product's limit is 0 (more probable than none), or higher where simulated data say so.
"""

from __future__ import annotations

import argparse
import os
import runpy
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")

from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from cases import Table, draw_cases

from rso.discrepancy.evidence import attribution
from rso.discrepancy.evidence.attribution import Evidence

LIMITS = (0.0, -0.25, -0.5, -0.75, -1.0)


def main() -> None:
    """One line for each limit."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("store", type=Path)
    parser.add_argument("--cases", type=int, default=400)
    o = parser.parse_args()
    whole = runpy.run_path(str(Path(__file__).parent / "__main__.py"))["library_of"](o.study, o.store)
    library = replace(whole, plan=whole.plan.seen())
    y = library.plan.values()
    evidence = Evidence(attribution.set_up(library, y), library.effects)
    cases = draw_cases(evidence.bench, y, o.cases, 3)
    contests = attribution.comparisons(Table(evidence, cases.Y), np.arange(len(cases.Y)))
    odds = np.array([c.statistic for c in contests])
    null = np.array([not cases.truth(i) for i in range(len(odds))])
    for limit in LIMITS:
        alarms, found = odds[null] > limit, odds[~null] > limit
        print(f"{limit:5.2f}: {alarms.sum()} alarms of {null.sum()} ({alarms.mean():.3f}), found {found.mean():.3f}")


if __name__ == "__main__":
    main()
