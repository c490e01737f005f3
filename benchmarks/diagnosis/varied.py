"""What becomes of verdicts on the same data when one number that the diagnosis assumes is halved or doubled."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace

import controls
import numpy as np
from cases import Cases, Table
from scores import Scored
from sections import HEAD, Say, figures, table

from rso.discrepancy.evidence import attribution
from rso.discrepancy.evidence.attribution import Evidence, Shared
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS, DiagnosisSettings

FACTORS = (0.5, 2.0)
CASES = 200  # of each: a share is known to about 3 percentage points, differences on the same data to about 1
WEIGHTS = ("single", "pair", "unexplained", "partly")  # these sum to 1
ELSEWHERE = {  # decide nothing in a contest of one data set
    "priors": ("present", "seldom"),  # intervals of parameters
    "model_error": ("common", "common_length"),  # the same
    "tolerance": (),
    "noise": (),
    "rules": ("misfit", "rare", "beyond", "lone", "most"),  # what follows the contest
}


def odds(p: float, factor: float) -> float:
    """A probability whose odds are multiplied by a factor."""
    return factor * p / (1.0 - p + factor * p)


def variants() -> Iterator[tuple[str, float, float, DiagnosisSettings]]:
    """(name, factor, value, settings) of every number that a contest knows, moved alone."""
    for group in fields(DIAGNOSIS_SETTINGS):
        own = getattr(DIAGNOSIS_SETTINGS, group.name)
        for f in fields(own):
            value = getattr(own, f.name)
            if f.name in ELSEWHERE[group.name]:
                continue
            for factor in FACTORS:
                if isinstance(value, tuple):
                    first = value[0] if isinstance(value[0], tuple) else value
                    changed = _sizes(value, factor)
                    said = first[0] * factor
                else:
                    probability = group.name == "rules" or (group.name == "priors" and f.name in ("no_gap", *WEIGHTS))
                    said = changed = odds(value, factor) if probability else factor * value
                new = replace(own, **{f.name: changed})
                if f.name in WEIGHTS:
                    others = {k: getattr(own, k) * (1.0 - changed) / (1.0 - value) for k in WEIGHTS if k != f.name}
                    new = replace(new, **others)
                yield f"{group.name}.{f.name}", factor, said, replace(DIAGNOSIS_SETTINGS, **{group.name: new})


def _sizes(value: tuple, factor: float) -> tuple:
    """Sizes of free gaps, or of scatter, times a factor; lengths stay."""
    return tuple((v[0] * factor, *v[1:]) if isinstance(v, tuple) else v * factor for v in value)


def section(say: Say, bench: Shared, y: np.ndarray, cases: Cases, classes, seed: int) -> None:
    """One row a setting and factor, and the setting as it is."""
    few = cases.picked(np.unique(np.linspace(0, len(cases.Y) - 1, CASES).astype(int)))  # cases of a kind stand together
    evidence = Evidence(bench, bench.library.effects)
    own = Table(evidence, few.Y)
    threshold = controls.threshold_of(evidence, y, seed)
    usual = controls.scored(evidence, y, few, classes, seed, threshold=threshold, table=own)
    say(["", "## Each assumption halved and doubled", ""])
    say(
        [
            f"The same {len(few.Y)} data sets, drawn with the settings as they are, judged with one number changed at "
            "a time (`rso/discrepancy/evidence/settings.py`); of probabilities the odds.  *Other verdict* is the share "
            "of data sets whose verdict or named causes change.",
            "",
        ]
    )
    lines = table(["setting", "value", "other verdict", *HEAD], [["as it is", "", "", *figures(usual)]])
    say(lines[:-1] if not lines[-1] else lines)
    for name, factor, value, settings in variants():
        s = _judged(bench, evidence, own, usual, y, few, classes, seed, settings)
        other = [a != b or p != q for a, b, p, q in zip(s.verdict, usual.verdict, s.named, usual.named, strict=True)]
        row = [f"{name} × {factor:g}", f"{value:.3g}", f"{np.mean(other):.3f}", *figures(s)]
        say([f"| {' | '.join(row)} |"])


def _judged(
    bench: Shared,
    evidence: Evidence,
    own: Table,
    usual: Scored,
    y: np.ndarray,
    cases: Cases,
    classes,
    seed: int,
    settings: DiagnosisSettings,
) -> Scored:
    """The same data under other settings; evidence is computed anew only where it changes."""
    priors = replace(settings.priors, gaps=DIAGNOSIS_SETTINGS.priors.gaps, alone=DIAGNOSIS_SETTINGS.priors.alone)
    weights = settings == replace(DIAGNOSIS_SETTINGS, priors=priors, rules=settings.rules)
    if weights and settings.priors.scatter == DIAGNOSIS_SETTINGS.priors.scatter:
        there = Evidence(replace(bench, settings=settings), bench.library.effects)
        there._ready = evidence._ready
        seen = own.seen_by(own.effects)
        seen.bench = there.bench
        return controls.scored(there, y, cases, classes, seed, table=seen)
    there = Evidence(attribution.set_up(bench.library, y, settings=settings), bench.library.effects)
    return controls.scored(there, y, cases, classes, seed, table=Table(there, cases.Y))
