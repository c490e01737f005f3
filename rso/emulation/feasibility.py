"""Where a model has an answer: the region of the parameters in which runs do not fail, learned from those that did.

A Gaussian process classifier (Rasmussen & Williams 2006, algorithm 3.1 and 3.2, Laplace approximation, as in
scikit-learn) gives P(done | θ) on the unit cube; a point is avoided where P < 1/2.  Nothing here invents an answer
for a run that failed: the region only says where not to look.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.core.similarity import Group
from rso.core.units import spaced
from rso.doe import Box, sobol_sequence

MIN_ANSWER_PROBABILITY = 0.5  # from which on a point counts as one where the model has an answer
MAX_MISJUDGED_RUNS_SHARE = 0.1  # share of the runs that a threshold may misjudge and still be told in words


@dataclass(frozen=True, eq=False)
class FeasibleRegion:
    """Runs in the unit cube of `box` (after similarity, whose modulus is `group`'s): X (n, d), which are done (n,).

    `model` is None while no run has failed.  It can stand among the conditions between parameters of a study.
    """

    box: Box
    group: Group
    X: np.ndarray
    done: np.ndarray
    model: Any

    @property
    def text(self) -> str:
        """What it asks for, as conditions say it."""
        return "runs are expected to have an answer"

    def probability(self, theta: Mapping[str, np.ndarray]) -> np.ndarray:
        """P(done) (n,) of physical values (n,) by name."""
        n = len(next(iter(theta.values())))
        return np.ones(n) if self.model is None else self.model.predict_proba(self._unit(theta))[:, 1]

    def excess(self, theta: Mapping[str, np.ndarray]) -> np.ndarray:
        """1/2 − P(done) (n,): positive where a run would rather fail."""
        return MIN_ANSWER_PROBABILITY - self.probability(theta)

    def share(self, box: Box, seed: int, n: int = 2048) -> float:
        """Share of `box` (in the study's own parameters, uniform on their scales) where runs would rather fail."""
        if self.model is None:
            return 0.0
        theta = box.from_unit(sobol_sequence(box.d, n, seed))
        return float(np.mean(self.excess(dict(zip(box.names, theta.T, strict=True))) > 0))

    def story(self) -> str:
        """Which region is infeasible, in one sentence; empty while no run has failed."""
        if self.model is None:
            return ""
        failed, n = int((~self.done).sum()), len(self.done)
        where = self._threshold() or self._extent()
        at = (
            ""
            if self.group.reference is None
            else (f" (at {self.group.reference} = {self.group.reference_value:.4g}; elsewhere by similarity)")
        )
        return f"{failed} of {n} points have no answer: {where}{at}. Nothing is searched or averaged there."

    def _unit(self, theta: Mapping[str, np.ndarray]) -> np.ndarray:
        return _unit(self.box, self.group, theta)

    def _threshold(self) -> str:
        """The single threshold that parts failed from done best, if it does so well enough."""
        best: tuple[float, int, float, float, bool] | None = None
        for j in range(self.box.d):
            x = np.unique(self.X[:, j])
            for a, b in itertools.pairwise(x):
                below = self.X[:, j] <= a
                for side in (True, False):
                    wrong = float(np.mean((below == side) == self.done))
                    if best is None or wrong < best[0]:
                        best = (wrong, j, a, b, side)
        if best is None or best[0] > MAX_MISJUDGED_RUNS_SHARE * min(1.0, 2 * float(np.mean(~self.done))):
            return ""
        wrong, j, a, b, side = best
        ends = self.box.from_unit(np.tile([[a], [b]], (1, self.box.d)))[:, j]
        word = "below" if side else "above"
        most = "" if wrong == 0 else " with few exceptions"
        name, unit = self.box.names[j], spaced(self.box.units[j])
        return f"runs fail for {name} {word} {ends[0]:.3g} to {ends[1]:.3g}{unit}{most}"

    def _extent(self) -> str:
        ends = self.box.from_unit(np.stack([self.X[~self.done].min(axis=0), self.X[~self.done].max(axis=0)]))
        parts = [
            f"{n} {a:.3g} to {b:.3g}{spaced(u)}"
            for n, u, a, b in zip(self.box.names, self.box.units, *ends, strict=True)
        ]
        return f"runs fail within {', '.join(parts)}"


def learn_feasibility(
    box: Box | None, group: Group, values: Sequence[Mapping[str, float]], done: Sequence[bool], seed: int
) -> FeasibleRegion | None:
    """The region that these runs show; None if `box` is None (similarity leaves no parameter) or there is no run.

    `box` is that of the parameters after similarity.  Crashed runs must be left out: a bug is not a property of θ.
    """
    if box is None or not len(values):
        return None
    theta = {n: np.array([v[n] for v in values], float) for n in values[0]}
    X, good = _unit(box, group, theta), np.asarray(done, bool)
    model = None
    if not good.all() and good.any():
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessClassifier
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel

        # A run at one place ends one way, always: a large amplitude lets the classifier believe its data.
        kernel = ConstantKernel(100.0, "fixed") * RBF(np.full(box.d, 0.3), (0.05, 3.0))
        model = GaussianProcessClassifier(kernel, random_state=np.random.RandomState(seed % 2**32))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound is an answer too
            model.fit(X, good)
    elif not good.any():
        model = _Nowhere()
    return FeasibleRegion(box, group, X, good, model)


class _Nowhere:
    """No run is done: nothing is feasible as far as anybody knows."""

    @staticmethod
    def predict_proba(X: np.ndarray) -> np.ndarray:
        return np.tile([1.0, 0.0], (len(X), 1))


def _unit(box: Box, group: Group, theta: Mapping[str, np.ndarray]) -> np.ndarray:
    """Points (n, d) of the unit cube of the reduced `box`."""
    s = 1.0 if group.reference is None else theta[group.reference] / group.reference_value
    shrunk = [theta[n] * s ** -(0 if group.reference is None else group.exponents.get(n, 0)) for n in box.names]
    return np.clip(box.to_unit(np.stack(shrunk, axis=1)), 0.0, 1.0)
