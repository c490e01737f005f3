"""Whether what flows through a body could as well be a network of many relaxation times: nothing else is like it.

A network forgets in a time of its own, what flows in one that goes with the square of the size of what is pressed.
Where all tests are alike in size, a spectrum of times makes the same forces, and a single time is only its simplest.
The prediction f of a flow is compared with the nearest one of any spectrum,

    min_{q ≥ 0, m, b}  ‖ f − m f₀ − Σ_j q_j (f_j − f₀) − Σ_k b_k ∂f₀/∂κ_k ‖²,

f₀ the base model, f_j that with a small share of the time τ_j, in standard deviations of the noise (Tikhonov's
non-negative inversion for a relaxation spectrum, Honerkamp and Weese 1989, without its penalty).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from rso.discrepancy.evidence.attribution import Shared
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.relaxation import is_relaxation

SMALL_RELAXATION_SHARE = 0.1  # of the largest plausible share of one time: small against the whole
NETWORK_TIME_RATIO = 3.0  # a factor of e, from one time to the next


def network(shared: Shared) -> Effect | None:
    """The relaxation of the catalogue; None where there is none."""
    return next((e for e in shared.library.effects if is_relaxation(e)), None)


def distance(shared: Shared, effect: Effect, x: np.ndarray, modulus: float) -> float:
    """Standard deviations between what an effect makes at coordinates x (d + knobs,) and the nearest network."""
    other = network(shared)
    assert other is not None  # of a library that has both
    library, d = shared.library, len(shared.library.base.axes)
    centre, (low, high) = x[None, :d], other.shape[0].ends()[0]
    times = np.linspace(low, high, max(4, 1 + round((high - low) / np.log(NETWORK_TIME_RATIO))))
    share = SMALL_RELAXATION_SHARE * other.size.high
    at = np.column_stack([np.repeat(centre, len(times), 0), np.full(len(times), share), times])
    f, f0 = predict(library, [effect], x[None], modulus)[0][0], predict(library, [], centre, modulus)[0][0]
    columns = [f0, *(predict(library, [other], at, modulus)[0] - f0)]
    for k, axis in enumerate(library.base.axes):
        ends = []
        for sign in (-1, 1):
            moved = centre.copy()
            moved[0, k] += sign * 0.02 * (axis.ends[1] - axis.ends[0])
            ends.append(predict(library, [], moved, modulus)[0][0])
        columns += [ends[1] - ends[0], ends[0] - ends[1]]
    L = np.linalg.cholesky(shared.C)
    A = np.linalg.solve(L, modulus * np.stack(columns, axis=1))
    size = np.linalg.norm(A, axis=0)
    return float(nnls(A / np.maximum(size, 1e-300), np.linalg.solve(L, modulus * f))[1])
