"""Readings of one record that remember each other, where neither repeats nor the study say whether they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rso.distributions import chi2_cdf
from rso.identify.likelihood import Data, Misfit
from rso.measurement import memory

SEEN = 0.001  # chance of errors of the stated size to leave so little: then it is not they that go together


def remembering(misfit: Misfit, x: np.ndarray) -> Misfit:
    """The misfit with memory where the residuals at x (d,) of a curve show it and its errors were white by default.

        C_ij → C_ij + w_i w_j ρ^|i−j|   (i ≠ j)

    w is what counts as white, ρ the correlation of neighbours in the whitened residuals, in order of depth.  A model
    that is wrong leaves residuals that go together, too: the size of the errors is not changed here, so that a misfit
    beyond them stays one.  n values hold n (1 − ρ²)/(1 + ρ²) degrees of freedom (Bartlett, J. R. Stat. Soc. 98 (1935)
    536); where χ² is too small for these, what goes together is not the errors.
    """
    r = misfit.white(misfit.model.predict(x[None])[0] - np.concatenate([d.value for d in misfit.data]))
    parts = np.split(r, np.cumsum([len(d.value) for d in misfit.data])[:-1])
    return replace(misfit, data=tuple(_remembering(d, part) for d, part in zip(misfit.data, parts, strict=True)))


def independent(ρ: float) -> float:
    """Degrees of freedom of a value whose neighbours have the correlation ρ: (1 − ρ²)/(1 + ρ²)."""
    return (1 - ρ**2) / (1 + ρ**2)


def _remembering(data: Data, r: np.ndarray) -> Data:
    if data.white is None or data.memory:
        return data
    order = np.argsort(data.depth, kind="stable")
    ρ = memory(r[order, None])
    each = independent(ρ)
    if ρ == 0.0 or chi2_cdf(each * float(r @ r), each * len(r)) < SEEN:
        return data
    place = np.argsort(order)
    along = ρ ** np.abs(np.subtract.outer(place, place)) - np.eye(len(r))
    return replace(data.plus(along * np.outer(data.white, data.white)), memory=ρ)
