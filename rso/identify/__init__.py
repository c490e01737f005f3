"""Identification: what measured curves say about parameters, and how well they determine them."""

from rso.identify.descent import Descent, Iterate, on_runs
from rso.identify.determination import Determination, Known, Runs, compare_weightings, determine, lenient, p_value
from rso.identify.directions import Direction, Gain, best_depth, directions, expected_sd, gain
from rso.identify.error_surface import ErrorSurface, Minimum, fit_surface, surface_minima
from rso.identify.fitting import Fit, all_minima, descend, fit_at, gauss_newton
from rso.identify.further import Experiment, Told, on_valley, told
from rso.identify.intervals import Interval, Profile, laplace, profile, quantiles, spread
from rso.identify.likelihood import WEIGHTINGS, Data, Misfit, Model, common, covariance, stack, together
from rso.identify.metric import MetricMinimum, curve_score, downhill, minimise
from rso.identify.models import Place, emulated, has_gradients, resample, simulated, spread_of
from rso.identify.remembering import remembering
from rso.identify.sampling import Draws, sample
from rso.identify.tangents import Frame, Sight, tangents
from rso.identify.usual_errors import elsewhere, widened, with_usual
from rso.identify.verdict import Verdict, judge

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
