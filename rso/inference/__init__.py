"""Identification: what measured curves say about parameters, and how well they determine them."""

from rso.inference.autocorrelated_residuals import remembering
from rso.inference.curve_metric import MetricMinimum, curve_score, downhill, minimise
from rso.inference.error_surface import ErrorSurface, Minimum, fit_surface, surface_minima
from rso.inference.expected_information import Experiment, Told, on_valley, told
from rso.inference.gauss_newton import Descent, Iterate, on_runs
from rso.inference.identifiability import Determination, Known, Runs, compare_weightings, determine, lenient, p_value
from rso.inference.intervals import Interval, Profile, laplace, profile, quantiles, spread
from rso.inference.least_squares import Fit, all_minima, descend, fit_at, gauss_newton
from rso.inference.likelihood import WEIGHTINGS, Data, Misfit, Model, common, covariance, stack, together
from rso.inference.models import Place, emulated, has_gradients, resample, simulated, spread_of
from rso.inference.posterior_sampling import Draws, sample
from rso.inference.sloppy_directions import Direction, Gain, best_depth, directions, expected_sd, gain
from rso.inference.tangents import Frame, Sight, tangents
from rso.inference.usual_errors import elsewhere, widened, with_usual
from rso.inference.verdict import Verdict, judge

__all__ = [
    "WEIGHTINGS",
    "Data",
    "Descent",
    "Determination",
    "Direction",
    "Draws",
    "ErrorSurface",
    "Experiment",
    "Fit",
    "Frame",
    "Gain",
    "Interval",
    "Iterate",
    "Known",
    "MetricMinimum",
    "Minimum",
    "Misfit",
    "Model",
    "Place",
    "Profile",
    "Runs",
    "Sight",
    "Told",
    "Verdict",
    "all_minima",
    "best_depth",
    "common",
    "compare_weightings",
    "covariance",
    "curve_score",
    "descend",
    "determine",
    "directions",
    "downhill",
    "elsewhere",
    "emulated",
    "expected_sd",
    "fit_at",
    "fit_surface",
    "gain",
    "gauss_newton",
    "has_gradients",
    "judge",
    "laplace",
    "lenient",
    "minimise",
    "on_runs",
    "on_valley",
    "p_value",
    "profile",
    "quantiles",
    "remembering",
    "resample",
    "sample",
    "simulated",
    "spread",
    "spread_of",
    "stack",
    "surface_minima",
    "tangents",
    "together",
    "told",
    "widened",
    "with_usual",
]
