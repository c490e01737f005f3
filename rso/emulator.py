"""Predictions of every output of a study from the runs done so far, with exact similarity taken out first.

An output is y(θ) = s^e · f(θ′) with (s, θ′) from :mod:`rso.similarity`; surrogates are fitted to f over the box of θ′
and predictions are made for θ.  Runs that failed take no part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rso.contract import Response
from rso.doe import Box
from rso.similarity import Group
from rso.surrogates import Scores, Surrogate, fit, score


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
    """Surrogates by output id over the `reduced` box (None if similarity leaves no dimension), and the data in them."""

    box: Box
    group: Group
    reduced: Box | None
    outputs: tuple[Output, ...]
    surrogates: Mapping[str, Surrogate]
    samples: tuple[Sample, ...]

    def predict(self, output: Output, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,) of one output at points X (n, d) of the unit cube of `box`."""
        s, R = self._reduce(X)
        if self.reduced is None:
            f, sd = np.full(len(s), self._constant(output)), np.zeros(len(s))
        else:
            f, sd = self.surrogates[output.id].predict(R)
        scale = self.group.expand(output.channel, np.ones(len(s)), s)
        return f * scale, sd * scale

    def mean(self, output: Output, X: np.ndarray) -> np.ndarray:
        """Mean alone (n,)."""
        return self.predict(output, X)[0]

    def means(self, outputs: Sequence[Output], X: np.ndarray) -> np.ndarray:
        """Means of several outputs (n, m)."""
        return np.stack([self.mean(o, X) for o in outputs], axis=1)

    def score(self, output: Output, held_out: Sequence[Sample]) -> Scores:
        """Errors on runs that took no part in the fit, in the unit of the output."""
        X = self.box.to_unit(np.array([[s.values[n] for n in self.box.names] for s in held_out]))
        predicted = self.mean(output, np.clip(X, 0.0, 1.0))
        return score(predicted, np.array([s.outputs[output.id] for s in held_out]))

    def _reduce(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        theta = self.box.from_unit(np.asarray(X, float))
        pairs = [self.group.reduce(dict(zip(self.box.names, row, strict=True))) for row in theta]
        s = np.array([p[0] for p in pairs])
        if self.reduced is None:
            return s, None
        physical = np.array([[p[1][n] for n in self.reduced.names] for p in pairs])
        return s, np.clip(self.reduced.to_unit(physical), 0.0, 1.0)

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
    box: Box, group: Group, outputs: Sequence[Output], samples: Sequence[Sample], *, kind: str, seed: int
) -> Emulator:
    """Emulator of all outputs from the samples; equal reduced points count once.

    Raises ValueError if there are too few runs for any surrogate.
    """
    reduced = reduced_box(box, group)
    pairs = [group.reduce(s.values) for s in samples]
    if not samples:
        raise ValueError("no run is done: nothing to fit")
    if reduced is None:
        return Emulator(box, group, None, tuple(outputs), {}, tuple(samples))
    X = reduced.to_unit(np.array([[r[n] for n in reduced.names] for _, r in pairs]))
    _, first = np.unique(np.round(X, 9), axis=0, return_index=True)
    first = np.sort(first)
    surrogates = {}
    for output in outputs:
        y = np.array([samples[i].outputs[output.id] / group.expand(output.channel, 1.0, pairs[i][0]) for i in first])
        surrogates[output.id] = fit(
            kind, np.clip(X[first], 0.0, 1.0), y, seed=seed, unit=output.unit, names=reduced.names
        )
    return Emulator(box, group, reduced, tuple(outputs), surrogates, tuple(samples))
