"""What the checks after a contest change: the look at what a cause leaves, and whether it predicts what it was not
fitted to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import controls
import numpy as np
from cases import Table
from scores import Scored
from sections import Say, table

from rso.discrepancy.diagnosis import WHOLE_GAP_VERDICTS
from rso.discrepancy.evidence.attribution import Evidence
from rso.discrepancy.evidence.cross_validation import held_out_evidence, predicts
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.verdict import Judgement
from rso.discrepancy.library.effects import Effect

MOST = 150  # cases found, with the true effect in the catalogue and without
KINDS = ("no_gap", "unexplained", "partly", "ambiguous")
VERDICTS = ["no gap", "unexplained", "partly", "ambiguous", "one cause, sure: right", "wrong", "cases"]


@dataclass(frozen=True)
class Checked:
    """A case judged: by the contest, after a look at what is left, after the held-out check too; what stands then.

    `gain` is the log predictive density of experiments left out over that of the base model, NaN where nobody asks.
    """

    judged: Judgement
    looked: str
    verdict: str
    chosen: Hypothesis
    gain: float

    @property
    def named(self) -> tuple[str, ...]:
        """Effects that are named in the end."""
        return () if self.verdict == "unexplained" else self.judged.named


def check(evidence: Evidence, effects: Sequence[Effect], judged: Judgement, y: np.ndarray, seed: int) -> Checked:
    """Both checks of one data set y (n,), with these effects in the catalogue."""
    if judged.verdict not in WHOLE_GAP_VERDICTS:
        return Checked(judged, judged.verdict, judged.verdict, judged.chosen, np.nan)
    looked, pure = controls.looked_at(evidence, effects, judged, y, seed), Hypothesis(judged.chosen.effects)
    held = held_out_evidence(evidence.bench, y, [Hypothesis(()), pure])
    gain = sum(c.gain.get(pure.name, np.nan) for c in held)  # some experiment alone can show it: nobody asks
    if not predicts(held, pure):
        return Checked(judged, looked, "unexplained", Hypothesis((), True), gain)
    return Checked(judged, looked, looked, judged.chosen, gain)


def counts(verdicts: Sequence[str], named: Sequence[Sequence[str]], truth: Sequence[Sequence[str]]) -> list[str]:
    """Shares of the verdicts; of one cause that is sure, with the sources named and those true."""
    v = np.array(verdicts)
    sure = np.isin(v, controls.ALONE)
    right = np.array([bool(n) and set(n) <= set(t) for n, t in zip(named, truth, strict=True)], bool)
    shares = [*(v == k for k in KINDS), sure & right, sure & ~right]
    return [*(f"{np.mean(m):.3f}" for m in shares), str(len(v))]


def with_and_without(
    say: Say, own: Table, s: Scored, threshold: float, look: Callable[[int], Checked], seed: int
) -> None:
    """Verdicts with and without the held-out check, with the true effect in the catalogue and without it."""
    rows = spread([i for i in np.nonzero(s.found & s.single)[0] if s.cases.effects[i][0].family != "scatter"], MOST)
    source = {e.name: e.source for e in own.effects}
    truth = [s.truth[i] for i in rows]
    there = [look(i) for i in rows]
    gone = []
    for i in rows:
        few, judged = controls.judged_without(own, s.truth[i][0], threshold, [i])[0]
        gone.append(check(own.evidence, few.effects, judged, s.cases.Y[i], seed + i))

    def row(found: Sequence[Checked], verdict: str, named: Callable[[Checked], Sequence[str]]) -> list[str]:
        names = [[source[n] for n in named(c)] for c in found]
        return counts([getattr(c, verdict) for c in found], names, truth)

    lines = []
    for words, found in (("in the catalogue", there), ("not in it", gone)):
        lines.append([words, "with", *row(found, "verdict", lambda c: c.named)])
        lines.append([words, "without", *row(found, "looked", lambda c: c.judged.named)])
    asked = [np.array([c.gain for c in v if np.isfinite(c.gain)]) for v in (there, gone)]
    lost = [int(np.sum(g <= 0)) for g in asked]
    text = (
        'A verdict that takes causes for the whole of a gap becomes "unexplained" where the cause chosen predicts '
        "experiments left out, all together, no better than the base model.  Without it a look at what is left "
        f"has the last word.  Asked of {len(asked[0])} cases with the true effect in the catalogue the check takes "
        f"back {lost[0]}, of {len(asked[1])} without it {lost[1]}.  Median gain (ln) {middle(asked[0])} and "
        f"{middle(asked[1])}, smallest {least(asked[0])} and {least(asked[1])}."
    )
    say(["## The held-out check", "", text, *table(["true effect", "held-out check", *VERDICTS], lines)])


def spread(rows: Sequence[int], most: int) -> list[int]:
    """At most so many of the rows, evenly taken."""
    rows = list(rows)
    return [rows[k] for k in np.unique(np.linspace(0, len(rows) - 1, min(most, len(rows))).astype(int))]


def middle(v: np.ndarray) -> str:
    """A median as text."""
    return f"{np.median(v):.1f}" if len(v) else "–"


def least(v: np.ndarray) -> str:
    """The smallest as text."""
    return f"{v.min():.1f}" if len(v) else "–"
