"""Search on predicted outputs: the NSGA-II front and the choice of candidates."""

from rso.search.choice import Choice, choose, story
from rso.search.front import Front, nsga2

__all__ = ["Choice", "Front", "choose", "nsga2", "story"]
