"""Identification: what measured curves say about parameters, and how well they determine them."""

from rso.inference.autocorrelated_residuals import with_autocorrelation
from rso.inference.curve_metric import MetricMinimum, curve_score, downhill, minimise
from rso.inference.derived import DerivedInterval, derived_interval
from rso.inference.error_model import ModelErrors, correlated_along, error_covariance, with_model_errors
from rso.inference.error_surface import ErrorSurface, Minimum, fit_surface, surface_minima
from rso.inference.fitted_errors import FittedCurve, curves_as_fitted
from rso.inference.gauss_newton import GaussNewtonFit, Iterate, on_runs
from rso.inference.identifiability import (
    Determination,
    Known,
    Profiled,
    Runs,
    chi2_p_value,
    compare_weightings,
    determination_of,
    determine,
    lenient,
    profiles_around,
)
from rso.inference.intervals import (
    Interval,
    ProfileInterval,
    laplace,
    profile_likelihood,
    quantiles,
    standard_deviations,
)
from rso.inference.least_squares import Fit, all_minima, fit_at, gauss_newton, levenberg_marquardt
from rso.inference.likelihood import WEIGHTINGS, Data, Misfit, Model, split_common_errors, stack
from rso.inference.models import (
    SURFACE_CHANNEL,
    CurvePlace,
    emulated,
    emulated_together,
    has_gradients,
    of_marks,
    outputs_of,
    readings_of,
    resample,
    simulated_curves,
    spread_of,
)
from rso.inference.posterior_sampling import Draws, sample_posterior
from rso.inference.sloppy_directions import Direction, directions, expected_sd
from rso.inference.tangents import EvaluatedPoint, TangentFrame, tangents
from rso.inference.usual_errors import elsewhere, widening, with_usual
from rso.inference.verdict import Verdict, judge_parameter

__all__ = [
    "SURFACE_CHANNEL",
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
    "Profiled",
    "Runs",
    "TangentFrame",
    "Verdict",
    "all_minima",
    "chi2_p_value",
    "compare_weightings",
    "correlated_along",
    "curve_score",
    "curves_as_fitted",
    "derived_interval",
    "determination_of",
    "determine",
    "directions",
    "downhill",
    "elsewhere",
    "emulated",
    "emulated_together",
    "error_covariance",
    "expected_sd",
    "fit_at",
    "fit_surface",
    "gauss_newton",
    "has_gradients",
    "judge_parameter",
    "laplace",
    "lenient",
    "levenberg_marquardt",
    "minimise",
    "of_marks",
    "on_runs",
    "outputs_of",
    "profile_likelihood",
    "profiles_around",
    "quantiles",
    "readings_of",
    "resample",
    "sample_posterior",
    "simulated_curves",
    "split_common_errors",
    "spread_of",
    "stack",
    "standard_deviations",
    "surface_minima",
    "tangents",
    "widening",
    "with_autocorrelation",
    "with_model_errors",
    "with_usual",
]
