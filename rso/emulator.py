"""Predictions of every output of a study from the runs done so far, with exact similarity taken out first.

An output is y(θ) = s^e · f(θ′) with (s, θ′) from :mod:`rso.similarity`; surrogates are fitted to f over the box of θ′
and predictions are made for θ.  Runs that failed take no part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.contract import Response
from rso.doe import Box
from rso.similarity import Group
from rso.surrogates import Kriging, Scores, Surrogate, fit, refit, score


@dataclass(frozen=True)
class Output:
    """One scalar of a response: channel of an experiment at a travel (mm)."""

    experiment: str
    channel: str
    depth_mm: float
    unit: str

    @property
    def id(self) -> str:
        """``experiment:channel@depth``."""
        return f"{self.experiment}:{self.channel}@{self.depth_mm:g}"

    def read(self, response: Response) -> float:
        """The value in a response that was asked for this travel; KeyError if it was not."""
        curve = response.curve(self.channel)
        at = np.nonzero(np.abs(curve.travel_mm - self.depth_mm) < 1e-9)[0]
        if not len(at):
            raise KeyError(f"{self.id}: the response holds travels {curve.travel_mm.tolist()} mm")
        return float(curve.value[at[0]])


@dataclass(frozen=True, eq=False)
class Sample:
    """One run that is done: its values and its outputs by id."""

    values: Mapping[str, float]
    outputs: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Emulator:
    """Surrogates by output id over the `reduced` box (None if similarity leaves no dimension), and the data in them.

    `degree` is that of the polynomials, None where the data choose it.
    """

    box: Box
    group: Group
    reduced: Box | None
    outputs: tuple[Output, ...]
    surrogates: Mapping[str, Surrogate]
    samples: tuple[Sample, ...]
    degree: int | None = None

    def predict(self, output: Output, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,) of one output at points X (n, d) of the unit cube of `box`."""
        return self._predict(output, *self._reduce(X))

    def mean(self, output: Output, X: np.ndarray) -> np.ndarray:
        """Mean alone (n,)."""
        return self.predict(output, X)[0]

    def means(self, outputs: Sequence[Output], X: np.ndarray) -> np.ndarray:
        """Means of several outputs (n, m)."""
        s, R = self._reduce(X)
        return np.stack([self._scaled(o, self._means(o, s, R), s) for o in outputs], axis=1)

    def score(self, output: Output, held_out: Sequence[Sample]) -> Scores:
        """Errors on runs that took no part in the fit, in the unit of the output."""
        theta = {n: np.array([s.values[n] for s in held_out]) for n in self.box.names}
        predicted, _ = self._predict(output, *self._reduced(theta))
        return score(predicted, np.array([s.outputs[output.id] for s in held_out]))

    def _reduce(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        theta = self.box.from_unit(np.asarray(X, float)).T
        return self._reduced(dict(zip(self.box.names, theta, strict=True)))

    def _reduced(self, theta: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Scales s (n,) and points (n, d') of the reduced unit cube from physical values (n,) by name."""
        group = self.group
        n = len(next(iter(theta.values())))
        s = np.ones(n) if group.reference is None else theta[group.reference] / group.reference_value
        if self.reduced is None:
            return s, np.empty((n, 0))
        physical = np.stack([theta[k] * s ** -group.exponents.get(k, 0) for k in self.reduced.names], axis=1)
        return s, np.clip(self.reduced.to_unit(physical), 0.0, 1.0)

    def _predict(self, output: Output, s: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self.reduced is None:
            return self._scaled(output, np.full(len(s), self._constant(output)), s), np.zeros(len(s))
        f, sd = self.surrogates[output.id].predict(R)
        return self._scaled(output, f, s), self._scaled(output, sd, s)

    def _means(self, output: Output, s: np.ndarray, R: np.ndarray) -> np.ndarray:
        return np.full(len(s), self._constant(output)) if self.reduced is None else self.surrogates[output.id].mean(R)

    def _scaled(self, output: Output, f: np.ndarray, s: np.ndarray) -> np.ndarray:
        return self.group.expand(output.channel, f, s)

    def _constant(self, output: Output) -> float:
        sample = self.samples[0]
        return sample.outputs[output.id] / self.group.expand(output.channel, 1.0, self.group.reduce(sample.values)[0])


def reduced_box(box: Box, group: Group) -> Box | None:
    """Box of the reduced parameters; `box` itself where nothing is scaled out, None where nothing is left."""
    if group.reference is None:
        return box
    ranges = group.reduced_range(
        dict(zip(box.names, box.low, strict=True)), dict(zip(box.names, box.high, strict=True))
    )
    kept = [k for k, name in enumerate(box.names) if name in ranges]
    if not kept:
        return None
    names = tuple(box.names[k] for k in kept)
    return Box(
        names,
        tuple(box.units[k] for k in kept),
        tuple(ranges[n][0] for n in names),
        tuple(ranges[n][1] for n in names),
        tuple(box.log[k] for k in kept),
    )


def learn(
    box: Box, group: Group, outputs: Sequence[Output], samples: Sequence[Sample], *, kind: str, seed: int,
    degree: int | None = None,
) -> Emulator:  # fmt: skip
    """Emulator of all outputs from the samples; the kind of each surrogate is chosen by cross-validation.

    Raises ValueError if there are too few runs for any surrogate.
    """
    if not samples:
        raise ValueError("no run is done: nothing to fit")
    reduced = reduced_box(box, group)
    bare = Emulator(box, group, reduced, tuple(outputs), {}, tuple(samples), degree)
    if reduced is None:
        return bare
    X, columns = _data(bare)
    fitted = {
        o.id: fit(kind, X, columns[o.id], seed=seed, degree=degree, unit=o.unit, names=reduced.names) for o in outputs
    }
    return replace(bare, surrogates=fitted)


def relearn(emulator: Emulator, new: Sequence[Sample], *, seed: int) -> Emulator:
    """The emulator with new samples in it, every surrogate of the kind it already is."""
    bare = replace(emulator, samples=(*emulator.samples, *new))
    if emulator.reduced is None:
        return bare
    X, columns = _data(bare)
    fitted = {
        k: refit(model, X, columns[k], seed=seed)
        if emulator.degree is None or isinstance(model, Kriging)
        else fit("polynomial", X, columns[k], seed=seed, degree=emulator.degree, log=model.log)
        for k, model in emulator.surrogates.items()
    }
    return replace(bare, surrogates=fitted)


def _data(emulator: Emulator) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Reduced points (n, d') and reduced outputs (n,) by id of the samples; equal points count once."""
    theta = {n: np.array([s.values[n] for s in emulator.samples]) for n in emulator.box.names}
    s, X = emulator._reduced(theta)
    _, first = np.unique(np.round(X, 9), axis=0, return_index=True)
    first = np.sort(first)
    columns = {
        o.id: np.array([emulator.samples[i].outputs[o.id] / emulator.group.expand(o.channel, 1.0, s[i]) for i in first])
        for o in emulator.outputs
    }
    return X[first], columns
