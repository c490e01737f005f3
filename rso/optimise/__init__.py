"""Search on predicted outputs: the NSGA-II front and the choice of candidates."""

from rso.optimise.candidates import Choice, choose, story
from rso.optimise.nsga2 import Front, nsga2

__all__ = ["Choice", "Front", "choose", "nsga2", "story"]
