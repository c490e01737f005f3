"""What a test is usually off by as a whole, where nobody says so: sizes, and how repeats narrow them.

    v = (ν₀ v₀ + k s²)/(ν₀ + k),   counted as v t²/z²

v₀ is the usual variance as `USUAL_ERROR_FREEDOM` = ν₀ degrees of freedom know it, s² what k of the repeats show: the
most likely variance under a scaled inverse-χ² prior (Gelman et al., Bayesian Data Analysis, 2013, §2.6); t and z are
the quantiles of Student's distribution with ν₀ + k degrees of freedom and of the Gaussian at 90 %.  One record counts
the usual size itself; two do not start from one degree of freedom.
"""

from __future__ import annotations

from rso.core.distributions import student

# degrees of freedom with which usual sizes are known: a test may well be off by three times as much
USUAL_ERROR_FREEDOM = 2.0
USUAL_GAIN_ERROR = 0.02  # of the force: cells and amplifiers are within 0.1 to 2 %, radius and temperature come on top
USUAL_CONTACT_ERROR_SHARE = 0.01  # of the deepest travel: by eye or a touch threshold 0.05 to 0.3 mm of 4 to 10 mm
# of the largest force: nonlinearity, hysteresis and drift of a cell, 0.1 to 0.2 % of its range
USUAL_CORRELATED_ERROR_SHARE = 0.002
USUAL_CORRELATION_LENGTH_SHARE = 0.5  # of the travel, along which these belong together


def deviation_of_size(size: float) -> float:
    """The deviation √v₀ that counts as `size` where nothing else is known."""
    return size / student(USUAL_ERROR_FREEDOM)


def counted_variance(prior: float, k: float, shown: float) -> tuple[float, float]:
    """Variance that counts of a single test, known from k degrees of freedom beside the prior, in two parts.

    The first is what is `shown` (s²), the second what the usual deviation `prior` (√v₀) adds.
    """
    t2 = student(USUAL_ERROR_FREEDOM + k) ** 2 / (USUAL_ERROR_FREEDOM + k)
    return t2 * k * shown, t2 * USUAL_ERROR_FREEDOM * prior**2
