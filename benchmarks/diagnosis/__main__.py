"""How well a diagnosis is calibrated for the test plan of a study, on cases simulated by its library.

    python benchmarks/diagnosis STUDY [--cases 2400] [--whole 40] [--pairs 40] [--store FOLDER] [--out FILE]
                                      [--sections effects,rules,controls,check,shrinkage,next,ablations,smooth,
                                                  pairs,whole,coverage,settings]

Draws causes, sizes and parameters from the priors and data from the noise of the plan, and sends each data set through
the contests of `rso diagnose`; curves kept for validation are drawn too, and say only how much closes.  The cases share
tables, priors and noise with the diagnosis: this checks the inference, not the model of the world (for that see
benchmarks/blind).  Needs the runs of `rso diagnose STUDY`, works on a copy of its store and writes a Markdown table.
"""

from __future__ import annotations

import argparse
import functools
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import checked
import complete
import controls
import covered
import sections
import shrunk
import smooth
import varied
from cases import Table, draw_cases
from scores import Scored

from rso import discrepancy
from rso.discrepancy.evidence import attribution
from rso.discrepancy.evidence.attribution import Evidence
from rso.discrepancy.evidence.detectable import Detectable, detectable
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.tables import Library
from rso.discrepancy.study_diagnosis import ask
from rso.evaluation import run_all
from rso.evaluation.store import RunStore
from rso.study.loader import load_study

REPORT = Path(__file__).parents[2] / "reports" / "diagnosis_emulator.md"
SECTIONS = (
    "effects",
    "rules",
    "controls",
    "check",
    "shrinkage",
    "next",
    "ablations",
    "smooth",
    "pairs",
    "whole",
    "coverage",
    "settings",
)


class NothingRuns(Executor):
    """All runs are in the store, or else there is nothing to check."""

    def submit(self, *_, **__):
        raise SystemExit("runs are missing in the store: first `rso diagnose STUDY`")


def library_of(folder: Path, store: Path) -> Library:
    """The library of a study from a copy of its store."""
    asked = ask(load_study(folder))
    with tempfile.TemporaryDirectory() as folder_of_copy:
        copy = Path(folder_of_copy) / "store"
        shutil.copytree(store, copy, ignore=shutil.ignore_patterns("*.lock", "*.html", "*.pdf"))
        with RunStore(copy) as runs:
            return discrepancy.build_library(
                asked.base, asked.plan, asked.effects, lambda t: run_all(asked.base.backend, t, runs, NothingRuns())
            )


def options() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("--cases", type=int, default=2400)
    parser.add_argument("--whole", type=int, default=40, help="cases of the complete diagnosis")
    parser.add_argument("--pairs", type=int, default=40, help="cases of the contest with pairs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--store", type=Path)
    parser.add_argument("--out", type=Path, default=REPORT)
    parser.add_argument("--sections", default=",".join(SECTIONS))
    parser.add_argument("--runs", type=Path, help="folder for simulations of next tests; without it only known places")
    parser.add_argument("--jobs", type=int, default=2)
    return parser.parse_args()


def classes_of(effects: Sequence[Effect], before: Sequence[Detectable]) -> dict[str, frozenset[str]]:
    """Effect → what the plan cannot tell from it, as computed before any data."""
    source = {e.name: e.source for e in effects}
    classes: dict[str, frozenset[str]] = {}
    for d in before:
        mine = classes.get(d.effect.source, frozenset({d.effect.source}))
        classes[d.effect.source] = mine | {source[n] for n in d.confused_with}
    return classes


def opening(s: Scored, library: Library, values: int, threshold: float, seed: int) -> list[str]:
    """What was simulated, and what the columns mean."""
    count = len(s.truth)
    return [
        "# Diagnosis on cases of its own library",
        "",
        f"`python benchmarks/diagnosis {' '.join(sys.argv[1:])}` (seed {seed})",
        "",
        f"{count} cases ({s.null.sum()} without a gap, {s.single.sum()} with one cause, "
        f"{(~s.null & ~s.single).sum()} with two) of {len(library.effects)} effects, {values} values of "
        f"{len(library.plan.tests)} curves and {len(library.plan.profiles)} profiles.  Sizes are log-uniform over the "
        "plausible ranges, so that many are too small to be seen.  Threshold of ln Bayes factor "
        f"{threshold:.2f}.  Columns from *cause on top* to *wrong and sure* count the cases found that have one cause; "
        "a class holds what the plan cannot tell apart, as computed before any data; *slope* is that of the outcome on "
        "logit P among causes (1: calibrated).",
    ]


def main() -> None:
    """Draw the cases, judge them, and write the sections asked for."""
    o, began = options(), time.process_time()
    whole = library_of(o.study, o.store or o.study / "results")
    library = replace(whole, plan=whole.plan.seen())
    y = library.plan.values()
    bench = attribution.set_up(library, y)
    evidence = Evidence(bench, library.effects)
    before = detectable(evidence, y, o.seed)
    classes = classes_of(library.effects, before)
    threshold = controls.threshold_of(evidence, y, o.seed + 1)
    cases = draw_cases(bench, y, o.cases, o.seed + 2)
    own = Table(evidence, cases.Y)
    s = controls.scored(evidence, y, cases, classes, o.seed, threshold=threshold, table=own)
    lines = opening(s, library, len(y), threshold, o.seed)
    spent = {"library and contests": time.process_time() - began}

    def say(more: Iterable[str]) -> None:
        more = list(more)
        lines.extend(more)
        print("\n".join(more), flush=True)
        save()

    def save() -> None:
        o.out.parent.mkdir(parents=True, exist_ok=True)
        each = ", ".join(f"{k} {v:.0f}" for k, v in spent.items())
        tail = f"CPU {sum(spent.values()):.0f} s, one thread: {each}."
        o.out.write_text("\n".join([*lines, "", tail, ""]), encoding="utf-8")

    values = shrunk.everywhere(whole, evidence, y, cases, o.seed + 3)

    @functools.cache
    def look(i: int) -> checked.Checked:
        return checked.check(evidence, evidence.effects, s.judged[i], cases.Y[i], o.seed + i)

    write: dict[str, Callable[[], None]] = {
        "inference": lambda: sections.inference(say, s, evidence, o.seed),
        "effects": lambda: sections.each_effect(say, evidence, s, before, o.seed),
        "rules": lambda: sections.beside(say, own, s),
        "controls": lambda: sections.checks(say, bench, evidence, own, s, y, threshold, o.seed),
        "check": lambda: checked.with_and_without(say, own, s, threshold, look, o.seed),
        "shrinkage": lambda: shrunk.shrinkages(say, whole, evidence, s, values, look, o.seed),
        "next": lambda: sections.decisive(say, evidence, s, o.seed, o.runs, o.jobs),
        "ablations": lambda: sections.without(say, bench, cases, y, classes, o.seed),
        "smooth": lambda: smooth.of_no_cause(say, evidence, y, threshold, o.seed),
        "pairs": lambda: sections.with_pairs(say, own, s, o.pairs),
        "coverage": lambda: covered.section(say, evidence, y, threshold, o.seed),
        "settings": lambda: varied.section(say, bench, y, cases, classes, o.seed),
        "whole": lambda: complete.complete(say, whole, s, values, o.whole, o.seed),
    }
    for name in ("inference", *(n for n in SECTIONS if n in o.sections.split(","))):
        began = time.process_time()
        write[name]()
        spent[name] = time.process_time() - began
        save()


if __name__ == "__main__":
    main()
