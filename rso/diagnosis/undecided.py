"""What a parameter could be besides: effects that the data neither show nor exclude move it with them.

The interval of a hypothesis holds if it does.  Over all that the data make no more than POSSIBLE times less probable it
is wider: a little stiffening beside a softer and less compressible body, say, leaves the same curve.  A gain of the
cell, which no indentation tells from a modulus, and a scale of the depth, which hardly one does, are left to their
calibration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rso.diagnosis.attribute import Contest, Evidence
from rso.diagnosis.hypotheses import Hypothesis
from rso.diagnosis.library import Library
from rso.diagnosis.mixture import Posterior, posterior

POSSIBLE = 10.0  # Bayes factor beyond which evidence counts as strong (Jeffreys 1961, appendix B)
WIDER = 0.1  # of the width of the interval: an end that moves by less is no news
DRAWS = 1000


@dataclass(frozen=True)
class Reach:
    """Ends of a parameter over all possible hypotheses, and the effect behind each, None for the one that is said."""

    low: float
    high: float
    low_with: str | None
    high_with: str | None


def draws(library: Library, p: Posterior) -> dict[str, np.ndarray]:
    """Open base parameters (m,) of the draws of a hypothesis."""
    out = {} if library.base.low == library.base.high else {library.base.modulus: p.modulus}
    for j, a in enumerate(library.base.axes):
        out[a.name] = a.physical(p.at[:, j], 1.0) * p.modulus**a.exponent
    return out


def reach(
    evidence: Evidence, contest: Contest, said: Hypothesis, post: Posterior, y: np.ndarray, level: float, seed: int
) -> dict[str, Reach]:  # fmt: skip
    """Reach of every open parameter: the hypothesis that is said, whose draws are `post`, and all single effects whose
    evidence is at least 1/POSSIBLE of its own, but for a gain or a scale of the depth.

    Ends are those of the intervals of probability `level` under each.
    """
    library, rng = evidence.bench.library, np.random.default_rng(seed)
    of = dict(zip(contest.hypotheses, contest.log_evidence, strict=True))
    ends = [(1 - level) / 2, (1 + level) / 2]
    own = {k: tuple(map(float, np.quantile(v, ends))) for k, v in draws(library, post).items()}
    least = {k: WIDER * (high - low) for k, (low, high) in own.items()}
    found = {k: Reach(*v, None, None) for k, v in own.items()}
    for h, z in of.items():
        alone = len(h.effects) == 1 and not h.unexplained and h.effects[0].family != "scatter"
        if h == said or not alone or h.effects[0].is_scale or z < of[said] - np.log(POSSIBLE):
            continue
        name, best = h.effects[0].name, evidence.best(h.effects, y)
        for k, v in draws(library, posterior(best, best.white(y), DRAWS, rng)).items():
            low, high = map(float, np.quantile(v, ends))
            r = found[k]
            if low < min(r.low, own[k][0] - least[k]):
                r = replace(r, low=low, low_with=name)
            if high > max(r.high, own[k][1] + least[k]):
                r = replace(r, high=high, high_with=name)
            found[k] = r
    return found
