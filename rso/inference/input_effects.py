"""What the stated inputs of a study (a thickness, a radius) may be off by, as an error that all its curves share.

    u_i(y) = ½ [f(x_i + u_i) − f(x_i − u_i)]

u_i is the standard uncertainty of input i and y a simulated curve at the most likely parameters.  Readings of every
curve are off by the same multiple of it, which is one more part of their covariance.
Source: JCGM 100:2008 (GUM), 5.1.3, note 2, and 5.2.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rso.contract import Response
from rso.emulation.emulator import Output
from rso.inference.identifiability import Determination
from rso.inference.likelihood import Data
from rso.inference.models import CurvePlace, resample
from rso.inference.usual_errors import moved_by


@dataclass(frozen=True, eq=False)
class InputEffect:
    """Responses by case with a stated input as it is, and one standard uncertainty above and below it.

    `name` is that of the error that it makes, the same for all readings that share it.  The `knob` has the
    `uncertainty` in its `unit`; `experiments` share it, or all where that is empty.  A case that is missing in one of
    `above` and `below` had no answer there.
    """

    name: str
    knob: str
    experiments: tuple[str, ...]
    description: str
    unit: str
    uncertainty: float
    stated: Mapping[int, Response]
    above: Mapping[int, Response]
    below: Mapping[int, Response]

    def shift(self, place: CurvePlace, case: int) -> np.ndarray:
        """By how much one standard uncertainty moves the curve of a case at its readings (n,), in their unit."""
        return self._shift(place.experiment, case, lambda response: resample(response, place, ""))

    def output_shift(self, output: Output, case: int) -> float:
        """By how much one standard uncertainty moves an output of a case, in its unit."""
        return float(self._shift(output.experiment, case, lambda response: np.array(output.read(response))))

    def _shift(self, experiment: str, case: int, read: Callable[[Response], np.ndarray]) -> np.ndarray:
        middle = read(self.stated[case])
        if self.experiments and experiment not in self.experiments:
            return np.zeros_like(middle)
        sides = [(side[case], sign) for side, sign in ((self.above, 1.0), (self.below, -1.0)) if case in side]
        return np.asarray(np.mean([sign * (read(response) - middle) for response, sign in sides], axis=0))


@dataclass(frozen=True)
class BudgetEntry:
    """One stated input: by how much each parameter is another, relative, where the input is one standard uncertainty
    more than stated, and its share of the variance of that parameter."""

    effect: InputEffect
    moves: dict[str, float]
    share: dict[str, float]


def with_effects(data: Data, place: CurvePlace, case: int, effects: Sequence[InputEffect]) -> Data:
    """A measured curve with what stated inputs make uncertain of the simulated one; those that do not move it are none
    of it."""
    for e in effects:
        shift = e.shift(place, case)
        data = data.with_input(e.name, shift) if np.any(shift) else data
    return data


def uncertainty_budget(d: Determination, effects: Sequence[InputEffect]) -> tuple[BudgetEntry, ...]:
    """What each stated input contributes to each parameter; empty where the weighting knows no errors.

        Δθ = −(Jᵀ C⁻¹ J)⁻¹ Jᵀ C⁻¹ s

    s (n,) is what one standard uncertainty moves all readings by.  Source: JCGM 102:2011, 6.2.1.3 with 9.2.
    """
    if d.misfit.weighting != "noise":
        return ()
    return tuple(BudgetEntry(e, *shared_part(d, e.name)) for e in effects)


def shared_part(d: Determination, name: str) -> tuple[dict[str, float], dict[str, float]]:
    """What an error that readings share moves each parameter by, relative, and its share of the variance of each."""
    s = np.concatenate([v.shared.get(name, np.zeros(len(v.value))) for v in d.misfit.data])
    total = np.diag(np.linalg.pinv(d.fit.fisher, rcond=1e-9))
    step = moved_by(d, s[:, None])[:, 0]
    names = d.misfit.model.box.names
    return relative_moves(d, s), {n: float(min(v**2 / t, 1.0)) for n, v, t in zip(names, step, total, strict=True)}


def relative_moves(d: Determination, s: np.ndarray) -> dict[str, float]:
    """Parameter → relative change of its most likely value where the readings lack s (n,); nan of one that is 0."""
    box = d.misfit.model.box
    theta = box.from_unit(d.fit.x[None])[0]
    moved = box.from_unit((d.fit.x - moved_by(d, s[:, None])[:, 0])[None])[0]  # also beyond the ranges: it is a slope
    return {n: float(m / t - 1.0) if t else float("nan") for n, m, t in zip(box.names, moved, theta, strict=True)}
