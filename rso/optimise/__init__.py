"""Search on predicted outputs: the NSGA-II front and the choice of candidates."""

from rso.optimise.candidates import Choice, choice_sentences, choose_candidates
from rso.optimise.nsga2 import Front, nsga2

__all__ = ["Choice", "Front", "choice_sentences", "choose_candidates", "nsga2"]
