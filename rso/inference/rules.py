"""The numbers that decide what is said of a fit: each a convention, and what it bounds.

`python benchmarks/identification_rules.py` prints how many verdicts change where one of them is halved or doubled.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class IdentificationRules:
    """When a parameter is determined, when a model is refuted, when a prediction is missed."""

    # a 90 % interval of up to half of the value either way, one digit, is a value (sd of ln θ up to 0.34)
    determined_factor: float = 1.75
    # the same where the range of another parameter makes an end: that is not the merit of the data
    leaning_factor: float = 1.25
    max_half_width_share: float = 0.25  # of its middle: the interval of a quantity without a scale that states a value
    uninformative_share: float = 0.5  # of the range stated or searched: an interval that leaves more says nothing
    refuted_error_ratio: float = 3.0  # times the stated errors: a model that misses by more determines nothing

    # times the usual correlated error, where nobody states one: a curve that is missed by more determines nothing
    systematic_residual_ratio: float = 3.0

    refuted_fit_chance: float = 0.01  # noise alone exceeds such a misfit this seldom: model or noise is wrong
    undecided_fit_chance: float = 0.05  # between this chance and the last the fit is undecided
    too_good_fit_chance: float = 0.001  # of true models leave less: errors are stated larger than the curves show
    missed_prediction_chance: float = 0.05  # a perfect model is said to miss in this share of data sets

    wide_error_share: float = 0.1  # of the largest value: an agreement within such errors says little
    refuting_distance_share: float = 0.1  # of an interval's width: a run that far outside of it refutes it
    # between the noise at which the profile is narrow enough and that at which a new one would be too
    noise_safety_ratio: float = 0.7


RULES = IdentificationRules()
