"""Surrogates of one output: polynomial and kriging, each with a mean, a standard deviation and a reason."""

from rso.surrogates.choice import Surrogate, fit, from_dict, refit
from rso.surrogates.kriging import Kriging, fit_kriging
from rso.surrogates.polynomial import Polynomial, fit_polynomial
from rso.surrogates.scores import Scores, cross_validate, held_out, score

__all__ = [
    "Kriging",
    "Polynomial",
    "Scores",
    "Surrogate",
    "cross_validate",
    "fit",
    "fit_kriging",
    "fit_polynomial",
    "from_dict",
    "held_out",
    "refit",
    "score",
]
