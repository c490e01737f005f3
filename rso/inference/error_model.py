"""The errors of a comparison between readings and a model, part by part, and the one covariance made of them.

    C = C_readings + C_test + C_usual          of the measurement: noise, gain, calibration, contact (rso.data)
      + C_numerical + C_interpolation          of the simulation: discretisation, the spline between computed travels
      + C_emulator                             of what stands for the simulation between runs

Every analysis adds these parts by :func:`with_model_errors`, so that the same curve has the same errors in all of them.
A diagnosis has one part more, what another program or another mesher makes of the same model; it stands in
:mod:`rso.discrepancy.evidence.noise`, on the same kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rso.core.correlation import Kernel, exponential
from rso.inference.likelihood import Data

NUMERICAL_ERROR, INTERPOLATION_ERROR, EMULATOR_ERROR = "numerical", "interpolation", "emulator"
MODEL_ERROR_NAMES = {  # and how each is called
    NUMERICAL_ERROR: "numerical",
    INTERPOLATION_ERROR: "between computed travels",
    EMULATOR_ERROR: "response surface",
}


def correlated_along(
    depth: np.ndarray, size: np.ndarray, length: float = np.inf, kernel: Kernel = exponential
) -> np.ndarray:
    """Covariance s sᵀ k(|Δu|) (n, n) of an error of size s (n,) that is correlated over a length (mm) of depth."""
    u, s = np.asarray(depth, float), np.asarray(size, float)
    return np.outer(s, s) * kernel(u, length)


def error_covariance(
    depth: np.ndarray,
    value: np.ndarray,
    slope: np.ndarray,
    *,
    white: float = 0.0,
    correlated: float = 0.0,
    length: float = 0.0,
    gain: float = 0.0,
    depth_noise: float = 0.0,
    contact: float = 0.0,
    repeats: int = 1,
    numerical: np.ndarray | None = None,
    numerical_length: float = np.inf,
) -> np.ndarray:
    """Covariance (n, n) of the mean of `repeats` curves y(u) with slope y′ (n,), against a model with its own error.

        C = [σ² I + c² e^{−|Δu|/ℓ} + g² y yᵀ + δ² diag(y′²) + o² y′ y′ᵀ] / r  +  s sᵀ e^{−|Δu|/L}

    `white` σ and `correlated` c in the unit of y, the latter over the `length` ℓ (mm); `gain` g relative, one draw
    for a whole repeat; `depth_noise` δ in mm, white, and `contact` o in mm, one draw for a whole repeat, propagated by
    the slope; `numerical` s (n,), the model's error, which is correlated over the length L and is not reduced by
    repeats.  ValueError for negative sizes.
    """
    u, y, dy = (np.asarray(v, float) for v in (depth, value, slope))
    if min(white, correlated, length, gain, depth_noise, contact) < 0 or repeats < 1 or not numerical_length > 0:
        raise ValueError("covariance: sizes must be >= 0, repeats >= 1 and numerical_length > 0")
    C = white**2 * np.eye(len(u)) + gain**2 * np.outer(y, y) + depth_noise**2 * np.diag(dy**2)
    C += contact**2 * np.outer(dy, dy)
    C += correlated**2 * (exponential(u, length) if length > 0 else np.eye(len(u)))
    C /= repeats
    return C if numerical is None else C + correlated_along(u, numerical, numerical_length)


@dataclass(frozen=True, eq=False)
class ModelErrors:
    """What a predicted curve may be off by at its n readings: a standard deviation (n,) of each part, in its unit.

    `spacing` mm is the distance of computed travels, over which the error of the spline between them is correlated;
    the other parts are correlated over the whole curve.  None: there is no such part.  `travel` (n,) mm is how deep
    the indenter is at each reading where that is no depth the readings were asked for, as in creep.
    """

    numerical: np.ndarray
    interpolation: np.ndarray | None = None
    spacing: float = np.inf
    emulator: np.ndarray | None = None
    travel: np.ndarray | None = None

    def parts(self, depth: np.ndarray) -> dict[str, np.ndarray]:
        """Covariance (n, n) of each part at the depths (n,) mm of the readings; parts that are zero are left out."""
        depth = depth if self.travel is None else self.travel
        whole = float(depth.max())
        sizes = {
            NUMERICAL_ERROR: (self.numerical, whole),
            INTERPOLATION_ERROR: (self.interpolation, self.spacing),
            EMULATOR_ERROR: (self.emulator, whole),
        }
        return {
            name: correlated_along(depth, size, length)
            for name, (size, length) in sizes.items()
            if size is not None and np.any(size)
        }


def joined_errors(each: Sequence[ModelErrors]) -> ModelErrors:
    """The errors of several curves as those of one block of readings, one curve after the other."""
    if len(each) == 1:
        return each[0]

    def whole(name: str) -> np.ndarray | None:
        sizes = [(getattr(e, name), len(e.numerical)) for e in each]
        if all(size is None for size, _ in sizes):
            return None
        return np.concatenate([np.zeros(n) if size is None else size for size, n in sizes])

    numerical = np.concatenate([e.numerical for e in each])
    return ModelErrors(numerical, whole(INTERPOLATION_ERROR), min(e.spacing for e in each), whole(EMULATOR_ERROR))


def with_model_errors(data: Data, errors: ModelErrors) -> Data:
    """A measured curve with what the predicted one may be off by, every part by its name."""
    for name, C in errors.parts(data.depth).items():
        data = data.plus(C, name)
    return data


def shares(data: Data) -> dict[str, float]:
    """Root mean square of each part of the errors over the largest value, that of the "measurement" first."""
    largest = float(np.abs(data.value).max()) or 1.0
    alone = data.without(*MODEL_ERROR_NAMES)
    found = {"measurement": alone.covariance, **data.parts}
    return {name: float(np.sqrt(np.mean(np.diag(C)))) / largest for name, C in found.items()}
