"""Identification: what measured curves say about parameters, and how well they determine them."""

from rso.inference.autocorrelated_residuals import with_autocorrelation
from rso.inference.curve_metric import MetricMinimum, curve_score, downhill, minimise
from rso.inference.derived import DerivedInterval, derived_interval
from rso.inference.error_model import ModelErrors, correlated_along, covariance, with_model_errors
from rso.inference.error_surface import ErrorSurface, Minimum, fit_surface, surface_minima
from rso.inference.fitted_errors import FittedCurve, fitted_curves
from rso.inference.gauss_newton import GaussNewtonFit, Iterate, on_runs
from rso.inference.identifiability import Determination, Known, Runs, compare_weightings, determine, lenient, p_value
from rso.inference.intervals import Interval, ProfileInterval, laplace, profile, quantiles, spread
from rso.inference.least_squares import Fit, all_minima, descend, fit_at, gauss_newton
from rso.inference.likelihood import WEIGHTINGS, Data, Misfit, Model, common, stack
from rso.inference.models import (
    CurvePlace,
    emulated,
    emulated_together,
    has_gradients,
    outputs_of,
    readings_of,
    resample,
    simulated,
    spread_of,
)
from rso.inference.posterior_sampling import Draws, sample
from rso.inference.sloppy_directions import Direction, directions, expected_sd
from rso.inference.tangents import EvaluatedPoint, TangentFrame, tangents
from rso.inference.usual_errors import elsewhere, widened, with_usual
from rso.inference.verdict import Verdict, judge

__all__ = [
    "WEIGHTINGS",
    "CurvePlace",
    "Data",
    "DerivedInterval",
    "Determination",
    "Direction",
    "Draws",
    "ErrorSurface",
    "EvaluatedPoint",
    "Fit",
    "FittedCurve",
    "GaussNewtonFit",
    "Interval",
    "Iterate",
    "Known",
    "MetricMinimum",
    "Minimum",
    "Misfit",
    "Model",
    "ModelErrors",
    "ProfileInterval",
    "Runs",
    "TangentFrame",
    "Verdict",
    "all_minima",
    "common",
    "compare_weightings",
    "correlated_along",
    "covariance",
    "curve_score",
    "derived_interval",
    "descend",
    "determine",
    "directions",
    "downhill",
    "elsewhere",
    "emulated",
    "emulated_together",
    "expected_sd",
    "fit_at",
    "fit_surface",
    "fitted_curves",
    "gauss_newton",
    "has_gradients",
    "judge",
    "laplace",
    "lenient",
    "minimise",
    "on_runs",
    "outputs_of",
    "p_value",
    "profile",
    "quantiles",
    "readings_of",
    "resample",
    "sample",
    "simulated",
    "spread",
    "spread_of",
    "stack",
    "surface_minima",
    "tangents",
    "widened",
    "with_autocorrelation",
    "with_model_errors",
    "with_usual",
]
