"""What a test is worth: the information that it is expected to give about what is open, and its price.

    I(x; y) = H(x) − ⟨H(x | y)⟩                                                                    (Lindley 1956, eq. 5)

in nats.  Of a parameter with Gaussian errors that is the mean of ln sd(ln θ) before less that after.  Of causes k with
probabilities P_k, whose forecasts of the test lie D_kl standard deviations apart, it is at least

    I ≥ −Σ_k P_k ln Σ_l P_l e^{−D_kl²/8}

with equality where D is 0 and where it is large.  The price is the number of loadings that somebody has to do.
Source: Lindley, Ann. Math. Stat. 27 (1956) 986; Kolchinsky & Tracey, Entropy 19 (2017) 361, eq. 10 with Chernoff's
α = 1/2 (causes of equal covariance).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

# nats, and of the best: tests that are expected to show as much but for this are not told apart
SAME_INFORMATION_NATS = 0.1

T = TypeVar("T")


@dataclass(frozen=True)
class Worth:
    """Expected information in nats, and the price in loadings; what is measured already costs none."""

    information: float
    price: int


def about_parameter(before: Sequence[float], after: Sequence[float]) -> float:
    """Nats about a parameter whose sd of ln θ falls from `before` (t,) to `after` (t,), in the mean over t truths."""
    return float(np.mean(np.log(before)) - np.mean(np.log(after)))


def about_causes(distance: Mapping[tuple[str, str], float], probability: Mapping[str, float]) -> float:
    """Nats about which cause is there, at least, by the distances D of all pairs; causes need not have all of P.

    Where the truth is none of them nothing is learnt.
    """
    whole = max(sum(probability.values()), 1.0)  # the causes of a pair hold the same probability twice
    P = {k: max(v / whole, 1e-9) for k, v in probability.items()}
    among = sum(P.values())

    def overlap(k: str, l: str) -> float:
        return 1.0 if k == l else math.exp(-0.125 * distance[(k, l) if (k, l) in distance else (l, k)] ** 2)

    return -sum(p * math.log(sum(q / among * overlap(k, l) for l, q in P.items())) for k, p in P.items())


def ranked(tests: Sequence[T], worth: Callable[[T], Worth]) -> list[T]:
    """Tests in order: always the cheapest of those that show as much as the best that is left, but for
    `SAME_INFORMATION_NATS`."""
    left, order = list(tests), list[T]()
    while left:
        most = max(worth(t).information for t in left)
        near = [t for t in left if worth(t).information >= most - SAME_INFORMATION_NATS * min(max(most, 0.0), 1.0)]
        best = min(near, key=lambda t: (worth(t).price, -worth(t).information))
        order.append(best)
        left = [t for t in left if t is not best]
    return order
