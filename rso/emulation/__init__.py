"""Surrogates of outputs: polynomial, kriging, whole curves, each with a mean, a standard deviation and a reason."""

from rso.emulation.convex_hull import beyond
from rso.emulation.kriging import Kriging, fit_kriging
from rso.emulation.model_choice import Surrogate, fit_surrogate, from_dict, refit
from rso.emulation.multi_output import MultiOutput, multi_output
from rso.emulation.polynomial import Polynomial, fit_polynomial
from rso.emulation.saving import load_arrays, save_arrays
from rso.emulation.scores import Scores, cross_validate, held_out_scores, pooled, score
from rso.emulation.whole_curve import CurvePoint, WholeCurve, fit_curve, on_common_grid, refit_curve

__all__ = [
    "CurvePoint",
    "Kriging",
    "MultiOutput",
    "Polynomial",
    "Scores",
    "Surrogate",
    "WholeCurve",
    "beyond",
    "cross_validate",
    "fit_curve",
    "fit_kriging",
    "fit_polynomial",
    "fit_surrogate",
    "from_dict",
    "held_out_scores",
    "load_arrays",
    "multi_output",
    "on_common_grid",
    "pooled",
    "refit",
    "refit_curve",
    "save_arrays",
    "score",
]
