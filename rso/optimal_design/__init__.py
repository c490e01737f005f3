"""Which test next: what each would show of what is open, at which price, in one order for every analysis.

ranking        the criterion, the price, and the order by both
expected_information   a parameter: by Fisher information, and by data made up for a test
separation     a cause: the chance that a test decides which of several is there
gains          a fit: what the same test once more, or more readings at one place, would add
"""

from rso.optimal_design.expected_information import (
    ExpectedInformation,
    PossibleExperiment,
    expected_information,
    on_valley,
)
from rso.optimal_design.gains import Gain, best_depth, gain, gains_of_repeats
from rso.optimal_design.ranking import SAME_INFORMATION_NATS, Worth, about_causes, about_parameter, ranked

__all__ = [
    "SAME_INFORMATION_NATS",
    "ExpectedInformation",
    "Gain",
    "PossibleExperiment",
    "Worth",
    "about_causes",
    "about_parameter",
    "best_depth",
    "expected_information",
    "gain",
    "gains_of_repeats",
    "on_valley",
    "ranked",
]
