"""Whether a fitted curve misses its readings over long stretches by more than a test is usually off by."""

from __future__ import annotations

import math

import numpy as np

from rso.core.digits import two_digits
from rso.data.usual_errors import USUAL_CORRELATED_ERROR_SHARE
from rso.inference.error_model import MODEL_ERROR_NAMES
from rso.inference.fitted_errors import curves_as_fitted
from rso.inference.identifiability import Determination
from rso.inference.likelihood import Data
from rso.inference.rules import RULES

MIN_READINGS = 8  # of a curve: of fewer nobody can say what goes together
USUAL_CORRELATION = "correlation"  # how usual errors call what goes together along the depth


def systematic_misfit(d: Determination) -> str:
    """Why a fit is not believed that leaves more than usual of its curves unexplained; else nothing.

        s² = mean r_i r_{i+1} > (systematic_residual_ratio · u)² + e²

    r (n,) are the residuals of the fitted curve in order of depth, moved by the fitted contact and gain, over the
    largest reading; u is the usual correlated error, e the root mean square of what the simulations may be off by.
    White noise is not in s.  Asked of curves whose correlated error nobody states and repeats do not show: such
    residuals are then of the noise or of a model that lacks something, and nothing says of which.
    """
    said = []
    try:
        curves = curves_as_fitted(d)
    except np.linalg.LinAlgError:
        return ""
    for data, curve in zip(d.misfit.data, curves, strict=True):
        size = float(np.abs(data.value).max())
        if len(data.value) < MIN_READINGS or size == 0.0 or not _counts_usual(data):
            continue
        order = np.lexsort((data.depth, np.zeros(len(data.depth)) if data.since is None else data.since))
        r = ((data.value - curve.fitted) / size)[order]
        share = math.sqrt(max(float(np.mean(r[1:] * r[:-1])), 0.0))
        e2 = sum(float(np.trace(data.parts[n])) for n in MODEL_ERROR_NAMES if n in data.parts) / len(r) / size**2
        allowed = math.hypot(RULES.systematic_residual_ratio * USUAL_CORRELATED_ERROR_SHARE, math.sqrt(e2))
        if share > allowed:
            said.append(f"{data.name} by {two_digits(100.0 * share)} % of its largest value")
    if not said:
        return ""
    return (
        f"The fitted curve misses {' and '.join(said)}, root mean square, over many readings alike. Errors of a test "
        "and of the simulations are usually smaller. Either the model lacks something, which rso diagnose looks for, "
        "or noise.correlation is to be stated."
    )


def _counts_usual(data: Data) -> bool:
    return any(name.split(": ")[-1].startswith(USUAL_CORRELATION) for name in data.usual)
