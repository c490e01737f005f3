"""The study: study.toml read, checked and given units."""

from rso.study.errors import StudyError
from rso.study.loader import load
from rso.study.resolve import Axis, Resolved, Search, resolve
from rso.study.schema import ExperimentTable, Study
from rso.study.search_table import Target, Variant

__all__ = [
    "Axis",
    "ExperimentTable",
    "Resolved",
    "Search",
    "Study",
    "StudyError",
    "Target",
    "Variant",
    "load",
    "resolve",
]
