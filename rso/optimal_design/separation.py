"""How likely a test is to decide which of several causes is there.

Causes whose forecasts of the test lie D standard deviations apart have, where k is true, a log likelihood ratio against
l of about N(D²/2, D²), so that the test decides the matter with probability

    Σ_k P_k min_l Φ[ (D_kl² / 2 − ln(P_l / P_k) − ln(s / (1 − s))) / D_kl ],      s = DECIDED_PROBABILITY.

Where the truth is none of the causes that can be simulated nothing is decided: P need not sum to 1.
Source: Atkinson & Fedorov, Biometrika 62 (1975) 57; Eriksson, Frisk & Krysander, Automatica 49 (2013) 1591 (D).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rso.core.distributions import normal_cdf, normal_logpdf, normal_ppf

DECIDED_PROBABILITY = 0.95  # probability of one hypothesis at which a matter is decided
DECIDED_LOG_ODDS = float(np.log(DECIDED_PROBABILITY / (1.0 - DECIDED_PROBABILITY)))  # of that hypothesis


def chance_to_decide(distance: Mapping[tuple[str, str], float], probability: Mapping[str, float]) -> float:
    """The chance that one cause has `DECIDED_PROBABILITY` afterwards, by the distances D of pairs and the probabilities
    before."""
    whole = max(sum(probability.values()), 1.0)  # the causes of a pair hold the same probability twice
    P = {k: max(v / whole, 1e-9) for k, v in probability.items()}
    chance = 0.0
    for k in P:
        rivals = [((l if k == m else m), D) for (l, m), D in distance.items() if k in (l, m)]
        chance += P[k] * min(float(_settles(D, np.log(P[k] / P[l]))) for l, D in rivals)
    return chance


def _settles(D: np.ndarray | float, odds: float) -> np.ndarray:
    """Probability that a test of distance D leaves the truth with `DECIDED_PROBABILITY`, from the logarithm of its odds
    before."""
    return normal_cdf((0.5 * np.square(D) + odds - DECIDED_LOG_ODDS) / np.maximum(D, 1e-9))


def as_likely(off: np.ndarray, resolution: float) -> float:
    """D with the chance, at even odds, of a test that shows sizes `off` (m,) of one hypothesis, 0 of the other, itself.

    Φ[D/2 − c/D] = ½ (⟨[ln p(x)/q(x) ≥ c]⟩ₚ + ⟨[ln q(x)/p(x) ≥ c]⟩_q), c = ln(s / (1 − s)), q = N(0, resolution²) and
    p = N(mean, sd² + resolution²) of the sizes, solved for D; 0 where a size that is none is as likely.
    """
    spread = np.hypot(float(np.std(off)), resolution)
    read = normal_ppf((np.arange(400) + 0.5) / 400)
    mean = float(np.mean(off))

    def odds(x: np.ndarray) -> np.ndarray:
        """ln p/q at x."""
        return normal_logpdf(x, mean, spread) - normal_logpdf(x, 0.0, resolution)

    chance = 0.5 * np.mean(odds(mean + spread * read) >= DECIDED_LOG_ODDS) + 0.5 * np.mean(
        -odds(resolution * read) >= DECIDED_LOG_ODDS
    )
    z = float(normal_ppf(np.clip(chance, 1e-12, 1 - 1e-12)))
    return z + float(np.sqrt(z**2 + 2.0 * DECIDED_LOG_ODDS))
