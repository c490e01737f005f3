"""What a parameter could be besides: effects that the data neither show nor exclude move it with them.

The interval of a hypothesis holds if nothing else is there.  Over all that the data make no more than POSSIBLE times
less probable it is wider: a little stiffening beside a softer and less compressible body, say, leaves the same curve,
beside a cause that is found as beside none.  A gain of the cell, which no indentation tells from a modulus, and a scale
of the depth, which hardly one does, are left to their calibration.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.special import logsumexp
from scipy.stats import qmc

from rso.diagnosis.attribute import Contest, Evidence
from rso.diagnosis.effects import Effect
from rso.diagnosis.hypotheses import Hypothesis
from rso.diagnosis.library import Library
from rso.diagnosis.mixture import Posterior, Ready, log_evidence, posterior
from rso.diagnosis.prediction import predict

POSSIBLE = 10.0  # Bayes factor beyond which evidence counts as strong (Jeffreys 1961, appendix B)
WIDER = 0.1  # of the width of the interval: an end that moves by less is no news
DRAWS = 1000
SIZES = 64  # draws of an effect that is added to what is said


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
    evidence: Evidence, contest: Contest, said: Hypothesis, post: Posterior, y: np.ndarray, level: float, seed: int,
    open_: bool,
) -> dict[str, Reach]:  # fmt: skip
    """Reach of every open parameter: the hypothesis that is said, whose draws are `post`, and all that add one effect
    to it and whose evidence is at least 1/POSSIBLE of its own, but for a gain or a scale of the depth.

    Where another cause is as possible as the one that is said, `open_`, all single effects too.  Ends are those of the
    intervals of probability `level` under each.
    """
    library, rng = evidence.bench.library, np.random.default_rng(seed)
    ends = [(1 - level) / 2, (1 + level) / 2]
    own = {k: tuple(map(float, np.quantile(v, ends))) for k, v in draws(library, post).items()}
    least = {k: WIDER * (high - low) for k, (low, high) in own.items()}
    found = {k: Reach(*v, None, None) for k, v in own.items()}
    for name, possible in _possible(evidence, contest, said, post, y, rng, open_):
        for k, v in draws(library, possible).items():
            low, high = map(float, np.quantile(v, ends))
            r = found[k]
            if low < min(r.low, own[k][0] - least[k]):
                r = replace(r, low=low, low_with=name)
            if high > max(r.high, own[k][1] + least[k]):
                r = replace(r, high=high, high_with=name)
            found[k] = r
    return found


def _possible(
    evidence: Evidence, contest: Contest, said: Hypothesis, post: Posterior, y: np.ndarray, rng: np.random.Generator,
    open_: bool,
) -> Iterator[tuple[str, Posterior]]:  # fmt: skip
    """Names and draws of what the data make no more than POSSIBLE times less probable than what is said."""
    of = {_key(h): (h, z) for h, z in zip(contest.hypotheses, contest.log_evidence, strict=True)}
    h = evidence.best(said.effects, y, said.unexplained, loose=bool(said.effects))
    own = log_evidence(h, h.white(y)[None])[0]
    least = of.get(_key(said), (said, own))[1] - np.log(POSSIBLE)
    taken = {e.source for e in said.effects}
    for e in evidence.effects:
        if e.family == "scatter" or e.is_scale:
            continue
        alone, more = Hypothesis((e,)), Hypothesis((*said.effects, e), said.unexplained)
        both = [alone] * (open_ and said.effects not in ((), (e,))) + [more] * (e.source not in taken)
        for known, z in (of[_key(g)] for g in both if _key(g) in of):
            if z >= least:
                best = evidence.best(known.effects, y, known.unexplained, loose=len(known.effects) > 1)
                yield e.name, posterior(best, best.white(y), DRAWS, rng)
        if more in both and _key(more) not in of:
            log_Z, added = _added(evidence, h, said, post, e, y, rng)
            if log_Z >= own - np.log(POSSIBLE):
                yield e.name, added


def _key(h: Hypothesis) -> tuple[frozenset[str], bool]:
    """The same for the same effects in any order."""
    return frozenset(e.name for e in h.effects), h.unexplained


def _added(
    evidence: Evidence, h: Ready, said: Hypothesis, post: Posterior, e: Effect, y: np.ndarray, rng: np.random.Generator
) -> tuple[float, Posterior]:
    """Log evidence of what is said with an effect added, and draws of the former's coordinates.

    The effect, drawn SIZES times from its prior, is what it adds to the prediction in the middle of `post`; without it
    the data are fitted anew each time.  What a new modulus makes of it is another size of the same.
    """
    library, μ = evidence.bench.library, evidence.bench.modulus
    at, own = np.mean(post.at, axis=0), _drawn(e, SIZES, rng)
    A, c = predict(library, (*said.effects, e), np.hstack([np.tile(at, (SIZES, 1)), own]), μ)
    A0, c0 = predict(library, said.effects, at[None], μ)
    Y = h.white(y - (np.mean(post.modulus) * (A - A0) + c - c0))
    logs = log_evidence(h, Y)
    log_Z = logsumexp(logs)
    number = rng.multinomial(DRAWS, np.exp(logs - log_Z))
    each = [posterior(h, Y[b], n, rng) for b, n in enumerate(number) if n]
    joined = {f.name: np.concatenate([getattr(p, f.name) for p in each]) for f in fields(Posterior)}
    return float(log_Z - np.log(SIZES)), Posterior(**joined)


def _drawn(e: Effect, n: int, rng: np.random.Generator) -> np.ndarray:
    """Signed deviations (n, knobs) of an effect from its prior, one in each nth of it."""
    share = qmc.LatinHypercube(len(e.knobs), rng=rng).random(n)
    sides, (first, *shape) = e.size.ends(), share.T
    side, within = np.minimum((len(sides) * first).astype(int), len(sides) - 1), (len(sides) * first) % 1.0
    near, far = np.array(sides)[side].T
    if e.size.neutral is None:
        size = near + within * (far - near)
    else:
        size = near * (far / near) ** within
    spans = [s.ends()[0] for s in e.shape]
    return np.column_stack([size, *(low + v * (high - low) for v, (low, high) in zip(shape, spans, strict=True))])
