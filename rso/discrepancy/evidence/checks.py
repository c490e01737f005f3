"""How far to trust a verdict: data simulated from its hypotheses, sent through the same contest, and other priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from rso.discrepancy.evidence import attribution
from rso.discrepancy.evidence.attribution import Comparison, Evidence
from rso.discrepancy.evidence.gaussian_mixture import log_tiles
from rso.discrepancy.evidence.verdict import judge_comparison, most_probable

N_SELF_CHECK_DATA_SETS = 60  # data sets per self-check


@dataclass(frozen=True)
class SelfCheck:
    """How often data simulated from a hypothesis lead back to it, and to no gap."""

    hypothesis: str
    returned: float
    no_gap: float
    in_set: float
    n: int


def self_checks(
    evidence: Evidence,
    contest: Comparison,
    finalists: frozenset[str],
    y: np.ndarray,
    threshold: float,
    null: np.ndarray,
    seed: int,
) -> tuple[SelfCheck, ...]:
    """Null, winner and runner-up (another cause) simulated through the same contest."""
    leading = most_probable(contest, len(contest.hypotheses))
    sources = [{e.source for e in h.effects} for h in leading]
    leading = [h for h, own in zip(leading, sources, strict=True) if h is leading[0] or not own & sources[0]][:2]
    pairs = [h.effects for h in leading if len(h.effects) == 2]
    alarm = float(np.mean(null > threshold))
    known = {e.name: e.source for e in evidence.effects}
    found = [SelfCheck("none", 1 - alarm, 1 - alarm, 1 - alarm, len(null))]
    for i, h in enumerate(leading):
        Y = attribution.simulated_data(evidence, h.effects, y, N_SELF_CHECK_DATA_SETS, seed + 10 + i, loose=True)
        returned = named = missed = 0
        own = {e.source for e in h.effects}
        for c in attribution.comparisons(evidence, Y, pairs, finalists=finalists):
            j = judge_comparison(c, c.statistic > threshold, evidence.bench.settings.rules)
            missed += j.verdict == "no_gap"
            returned += own == {e.source for e in j.chosen.effects}
            named += own <= {known[n] for n in j.named}
        found.append(
            SelfCheck(
                h.name,
                returned / N_SELF_CHECK_DATA_SETS,
                missed / N_SELF_CHECK_DATA_SETS,
                named / N_SELF_CHECK_DATA_SETS,
                N_SELF_CHECK_DATA_SETS,
            )
        )
    return tuple(found)


def prior_sensitivity(
    evidence: Evidence, contest: Comparison, finalists: frozenset[str], y: np.ndarray
) -> dict[str, dict[str, float]]:
    """Probabilities with prior widths of the sizes halved and doubled: the far half of the sizes left out, or half the
    prior beyond what is plausible."""
    out = {}
    for name in ("halved", "doubled"):
        z = contest.log_evidence.copy()
        for i, h in enumerate(contest.hypotheses):
            if h.unexplained or not h.effects or any(e.family == "scatter" for e in h.effects):
                continue
            if name == "doubled":
                z[i] -= np.log(2.0) * len(h.effects)
                continue
            r = evidence.ready(h.effects, loose={e.source for e in h.effects} <= finalists)
            keep = np.ones(len(r.tiles.at), bool)
            column = r.tiles.at.shape[1] - sum(len(e.knobs) for e in h.effects)
            for e in h.effects:
                if e.size.neutral is not None:
                    far = max(abs(v) for side in e.size.ends() for v in side)
                    keep &= np.abs(r.tiles.at[:, column]) <= 0.5 * far
                column += len(e.knobs)
            logs = log_tiles(r, r.white(y)[None])[0]
            z[i] = logsumexp(logs[keep]) - np.log(keep.mean())
        s = z + contest.log_prior
        q = np.exp(s - logsumexp(s))
        best: dict[str, float] = {}
        for h, v in zip(contest.hypotheses, q, strict=True):
            key = " + ".join(e.name for e in h.effects) or h.name
            best[key] = best.get(key, 0.0) + float(v)
        out[name] = dict(sorted(best.items(), key=lambda v: -v[1])[:5])
    return out
