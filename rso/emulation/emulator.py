"""Predictions of every output of a study from the runs done so far, with exact similarity taken out first.

An output is y(θ) = s^e · f(θ′) with (s, θ′) from :mod:`rso.core.similarity`; surrogates are fitted to f over the box of
θ′ and predictions are made for θ.  Runs that failed take no part.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rso import emulation
from rso.contract import Response
from rso.core.curves import hold_rows, on_the_way_back, way_back
from rso.core.similarity import Group
from rso.doe import Box
from rso.emulation import (
    CurvePoint,
    MultiOutput,
    Scores,
    Surrogate,
    WholeCurve,
    beyond,
    fit_curve,
    fit_surrogate,
    from_dict,
    multi_output,
    refit,
    refit_curve,
    score,
)

ROUNDING_SPREAD_SHARE = 1e-10  # of an output's largest value: a smaller spread is rounding
MIN_CURVE_TRAVELS = 3  # a curve with fewer is no curve: one surrogate per travel


@dataclass(frozen=True)
class Output:
    """One scalar of a response: channel of an experiment at a travel (mm), or in a hold `since_s` after it began;
    `back` in unloading."""

    experiment: str
    channel: str
    depth_mm: float
    unit: str
    since_s: float = 0.0
    back: bool = False

    @cached_property
    def id(self) -> str:
        """``experiment:channel@depth``, in a hold ``experiment:channel@depth+since``."""
        held = f"+{self.since_s:g}s" if self.since_s else ""
        return f"{self.experiment}:{self.channel}@{self.depth_mm:g}{held}{' back' * self.back}"

    @property
    def on_surface(self) -> bool:
        """Whether it is the displacement of a point of a cloud, as ``uz(3,0)``."""
        return "(" in self.channel

    @property
    def order(self) -> tuple[float, float]:
        """Where it stands along its curve: loading by depth, then the hold by time."""
        return self.since_s, self.depth_mm

    def place(self, response: Response) -> int:
        """Index of this reading in a response that was asked for it; KeyError if it was not."""
        if self.since_s:
            time, travel = response.channels["time"], response.channels["travel"]
            return int(hold_rows(self.channel, time, travel, self.depth_mm, np.array([self.since_s]))[0])
        travel = response.curve(self.channel).travel_mm
        if self.back:
            rows = way_back(travel)
            return int(rows[np.argmin(np.abs(travel[rows] - self.depth_mm))])
        at = np.nonzero(np.abs(travel - self.depth_mm) < 1e-9)[0]
        if not len(at):
            raise KeyError(f"{self.id}: the response holds travels {travel.tolist()} mm")
        return int(at[0])

    def read(self, response: Response) -> float:
        """The value in a response that was asked for this travel; KeyError if it was not."""
        if self.back:
            curve = response.curve(self.channel)
            return float(on_the_way_back(curve.travel_mm, curve.value, np.array([self.depth_mm]))[0])
        return float(response.curve(self.channel).value[self.place(response)])

    def error(self, response: Response) -> float:
        """The estimated numerical error of that value; 0 where the backend states none."""
        return float(response.curve(self.channel).error[self.place(response)])

    def gradient(self, response: Response) -> dict[str, float]:
        """∂/∂knob of that value by knob, as far as the backend gave derivatives of this channel."""
        at = self.place(response)
        return {k: float(np.asarray(g[self.channel])[at]) for k, g in response.gradients.items() if self.channel in g}


@dataclass(frozen=True, eq=False)
class Sample:
    """One run that is done: its values, and by output id its outputs, numerical errors and derivatives by knob."""

    values: Mapping[str, float]
    outputs: Mapping[str, float]
    errors: Mapping[str, float] = field(default_factory=dict)
    gradients: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Emulator:
    """Surrogates by output id over the `reduced` box (None if similarity leaves no dimension), and the data in them.

    `degree` is that of the polynomials, None where the data choose it.
    """

    box: Box
    group: Group
    reduced: Box | None
    outputs: tuple[Output, ...]
    surrogates: Mapping[str, Surrogate | CurvePoint]
    samples: tuple[Sample, ...]
    degree: int | None = None

    @cached_property
    def _several(self) -> dict[tuple[str, ...], MultiOutput]:
        """Outputs that have been predicted together, by their ids."""
        return {}

    def predict(self, output: Output, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,) of one output at points X (n, d) of the unit cube of `box`."""
        return self._predict(output, *self._reduce(X))

    def mean(self, output: Output, X: np.ndarray) -> np.ndarray:
        """Mean alone (n,), faster."""
        s, R = self._reduce(X)
        return self._scaled(output, self._means(output, s, R), s)

    def means(self, outputs: Sequence[Output], X: np.ndarray) -> np.ndarray:
        """Means of several outputs (n, m)."""
        s, R = self._reduce(X)
        if self.reduced is None:
            return np.stack([self._scaled(o, np.full(len(s), self._constant(o)), s) for o in outputs], axis=1)
        names = tuple(o.id for o in outputs)
        if names not in self._several:
            self._several[names] = multi_output([self.surrogates[n] for n in names])
        f = self._several[names].mean(R)
        scale = {c: self.group.expand(c, np.ones(len(s)), s) for c in {o.channel for o in outputs}}
        return f * np.stack([scale[o.channel] for o in outputs], axis=1)

    def surface(self, outputs: Sequence[Output], X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Means and standard deviations (n, m) of outputs of one point cloud."""
        if self.reduced is None:
            mean = self.means(outputs, X)
            return mean, np.zeros_like(mean)
        curve, points = self._cloud(outputs)
        mean, sd = curve.predict(self._reduce(X)[1])
        return mean[:, points], sd[:, points]

    def modes_of_surface(self, outputs: Sequence[Output], X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Standard deviations (n, r) of the modes of a point cloud at X (n, d), and the modes at its outputs (m, r).

        Displacements have no stress in their unit, so similarity does not scale them.
        """
        if self.reduced is None:
            return np.zeros((len(X), 1)), np.zeros((len(outputs), 1))
        curve, points = self._cloud(outputs)
        R = self._reduce(X)[1]
        sd = np.stack([a.predict(R)[1] for a in curve.coefficients], axis=1)
        return curve.inflate * sd, (curve.modes * curve.weight).T[points]

    def _cloud(self, outputs: Sequence[Output]) -> tuple[WholeCurve, list[int]]:
        each = [self.surrogates[o.id] for o in outputs]
        assert all(isinstance(m, CurvePoint) for m in each)
        return each[0].curve, [m.point for m in each]  # type: ignore[union-attr]

    def beyond(self, X: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points of the unit cube of `box` that lie outside the hull of the (reduced) samples."""
        if self.reduced is None:
            return np.zeros(len(X), bool)
        return beyond(_points(self)[1], self._reduce(X)[1])

    def score(self, output: Output, held_out: Sequence[Sample]) -> Scores:
        """Errors on runs that took no part in the fit, in the unit of the output."""
        predicted, _ = self._predict(output, *self._of_samples(held_out))
        return score(predicted, np.array([s.outputs[output.id] for s in held_out]))

    def spread(self, output: Output) -> float:
        """Width of the values of an output over the box, √12 σ, in the unit of the output at the reference modulus.

        √12 σ is the range of evenly spread values of standard deviation σ, here of s^e f over the samples f and the
        range of the scale s, over √mean(s^2e). A share t of it as error leaves Q² = 1 − 12 t². It is not less than
        what rounding leaves.
        """
        f = np.array([v.outputs[output.id] for v in self.samples])
        scale = np.ones(1)
        if self.group.reference is not None:
            k = self.box.names.index(self.group.reference)
            s = np.linspace(0.0, 1.0, 33)[:, None] * np.ones(self.box.d)
            s = self.box.from_unit(s)[:, k] / self.group.reference_value
            own = self._of_samples(self.samples)[0]
            f = f / self.group.expand(output.channel, np.ones(len(f)), own)
            scale = self.group.expand(output.channel, np.ones(len(s)), s)
        width = np.sqrt(12.0) * float(np.std(np.outer(scale, f))) / float(np.sqrt(np.mean(scale**2)))
        return max(width, ROUNDING_SPREAD_SHARE * float(np.abs(f).max()), 1e-300)

    def _reduce(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._reduced(self.box.from_unit(np.asarray(X, float)))

    def _reduced(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scales s (n,) and points (n, d') of the reduced unit cube from physical values (n, d)."""
        reference, kept, powers = self._columns
        s = np.ones(len(theta)) if reference is None else theta[:, reference] / self.group.reference_value
        if self.reduced is None:
            return s, np.empty((len(theta), 0))
        physical = theta[:, kept] * s[:, None] ** powers if powers.any() else theta[:, kept]
        return s, np.clip(self.reduced.to_unit(physical), 0.0, 1.0)

    @cached_property
    def _columns(self) -> tuple[int | None, np.ndarray, np.ndarray]:
        """Column of the modulus that is scaled out or None, and those (d',) of the others with their powers of it."""
        names, reference = self.box.names, self.group.reference
        kept = () if self.reduced is None else self.reduced.names
        powers = np.array([-self.group.exponents.get(k, 0) if reference is not None else 0 for k in kept], float)
        column = None if reference is None else names.index(reference)
        return column, np.array([names.index(k) for k in kept], int), powers

    def _of_samples(self, samples: Sequence[Sample]) -> tuple[np.ndarray, np.ndarray]:
        """The same of the values of some runs."""
        return self._reduced(np.array([[s.values[n] for n in self.box.names] for s in samples], float))

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


def learn_emulator(
    box: Box,
    group: Group,
    outputs: Sequence[Output],
    samples: Sequence[Sample],
    *,
    kind: str,
    seed: int,
    degree: int | None = None,
    held: Sequence[Sample] = (),
    each: Callable[..., Iterable[Any]] = map,
) -> Emulator:
    """Emulator of all outputs from the samples; the kind of each surrogate is chosen by cross-validation.

    `each` may be the `map` of an executor: one call an output.

    'whole_curve' learns all travels of a channel of an experiment together (a channel with few travels as 'auto'), and
    all moments of its hold, over time.
    Derivatives and numerical errors of the samples are used where they help; `held` samples join the choice only.

    Raises ValueError if there are too few runs for any surrogate.
    """
    if not samples:
        raise ValueError("no run is done: nothing to fit")
    reduced = reduced_box(box, group)
    bare = Emulator(box, group, reduced, tuple(outputs), {}, tuple(samples), degree)
    if reduced is None:
        return bare
    X, columns = _data(bare)
    seen = _data(replace(bare, samples=tuple(held))) if held else None
    fitted: dict[str, Surrogate | CurvePoint] = {}
    clouds = {e: [o for o in outputs if o.on_surface and o.experiment == e] for e in {o.experiment for o in outputs}}
    for members in filter(None, clouds.values()):  # hundreds of outputs, and few ways in which they move
        Y, noise, G = _stacked(columns, members)
        at = np.arange(1.0, len(members) + 1)
        cloud = fit_curve(X, at, Y, seed=seed, log=False, noise_sd=noise, gradients=G, unit="mm", names=reduced.names)
        fitted |= {o.id: CurvePoint(cloud, j) for j, o in enumerate(members)}
    curves = [m for m in _curves(outputs) if not m[0].on_surface] if kind == "whole_curve" else []
    for members in curves:
        Y, noise, G = _stacked(columns, members)
        at = np.array([o.since_s or o.depth_mm for o in members])
        curve = fit_curve(X, at, Y, seed=seed, noise_sd=noise, gradients=G, unit=members[0].unit, names=reduced.names)
        fitted |= {o.id: CurvePoint(curve, j) for j, o in enumerate(members)}
    rest = [o for o in outputs if o.id not in fitted]
    jobs: list[dict[str, Any]] = [
        {
            "kind": "auto" if kind == "whole_curve" else kind,
            "X": X,
            "y": columns[o.id].y,
            "seed": seed,
            "degree": degree,
            "unit": o.unit,
            "names": reduced.names,
            "noise_sd": columns[o.id].noise,
            "share": None,
            "gradients": columns[o.id].gradients,
            "held": None if seen is None else (seen[0], seen[1][o.id].y),
        }
        for o in rest
    ]
    fitted |= dict(zip((o.id for o in rest), each(_fit, jobs), strict=True))
    return replace(bare, surrogates=fitted)


def _fit(job: Mapping[str, Any]) -> Surrogate:
    return fit_surrogate(**job)


def relearn(
    emulator: Emulator, new: Sequence[Sample], *, seed: int, each: Callable[..., Iterable[Any]] = map
) -> Emulator:
    """The emulator with new samples in it, every surrogate of the kind it already is; terms and modes again.

    `each` may be the `map` of an executor: one call an output.
    """
    bare = replace(emulator, samples=(*emulator.samples, *new))
    if emulator.reduced is None:
        return bare
    X, columns = _data(bare)
    fitted: dict[str, Surrogate | CurvePoint] = {}
    jobs: dict[str, dict[str, Any]] = {}
    for o in emulator.outputs:
        model = emulator.surrogates[o.id]
        if o.id in fitted:
            continue
        if isinstance(model, CurvePoint):
            members = [m for m in emulator.outputs if getattr(emulator.surrogates[m.id], "curve", None) is model.curve]
            members.sort(key=lambda m: emulator.surrogates[m.id].point)  # type: ignore[union-attr]
            Y, noise, G = _stacked(columns, members)
            curve = refit_curve(model.curve, X, Y, seed=seed, noise_sd=noise, gradients=G, unit=o.unit)
            fitted |= {m.id: CurvePoint(curve, j) for j, m in enumerate(members)}
        else:
            c = columns[o.id]
            rest = {"noise_sd": c.noise, "gradients": c.gradients, "degree": emulator.degree}
            jobs[o.id] = {"model": model, "X": X, "y": c.y, "seed": seed, **rest}
    fitted |= dict(zip(jobs, each(_refit, jobs.values()), strict=True))
    return replace(bare, surrogates=fitted)


def _refit(job: Mapping[str, Any]) -> Surrogate:
    return refit(**job)


@dataclass(frozen=True, eq=False)
class _Column:
    """One reduced output (n,), its numerical error (n,) and its derivatives (n, d') over the reduced unit cube."""

    y: np.ndarray
    noise: np.ndarray | None
    gradients: np.ndarray | None


def _curves(outputs: Sequence[Output]) -> list[list[Output]]:
    """Outputs of one channel of one experiment, by travel, and of its hold by time, where they are enough to be a
    curve."""
    groups: dict[tuple[str, str, bool], list[Output]] = {}
    for o in outputs:
        groups.setdefault((o.experiment, o.channel, o.since_s > 0.0), []).append(o)
    return [sorted(g, key=lambda o: o.order) for g in groups.values() if len(g) >= MIN_CURVE_TRAVELS]


def _stacked(
    columns: Mapping[str, _Column], members: Sequence[Output]
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Curves (n, m), their errors (n, m) and derivatives (n, d', m); None where a member has none."""
    mine = [columns[o.id] for o in members]
    noise = [c.noise for c in mine if c.noise is not None]
    G = [c.gradients for c in mine if c.gradients is not None]
    return (
        np.stack([c.y for c in mine], axis=1),
        np.stack(noise, axis=1) if len(noise) == len(mine) else None,
        np.stack(G, axis=2) if len(G) == len(mine) else None,
    )


def _points(emulator: Emulator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scales s (n,), reduced points (n, d') and places of the samples; equal points count once."""
    s, X = emulator._of_samples(emulator.samples)
    _, first = np.unique(np.round(X, 9), axis=0, return_index=True)
    first = np.sort(first)
    return s[first], X[first], first


def _data(emulator: Emulator) -> tuple[np.ndarray, dict[str, _Column]]:
    """Reduced points (n, d') and reduced outputs by id of the samples."""
    s, X, first = _points(emulator)
    samples = [emulator.samples[i] for i in first]
    columns = {}
    for o in emulator.outputs:
        factor = np.array([emulator.group.expand(o.channel, 1.0, float(v)) for v in s])
        y = np.array([p.outputs[o.id] for p in samples]) / factor
        noise = np.array([p.errors.get(o.id, 0.0) for p in samples]) / factor
        columns[o.id] = _Column(y, noise if noise.any() else None, _slopes(emulator, o, samples, s, X, factor))
    return X, columns


def _slopes(
    emulator: Emulator, o: Output, samples: Sequence[Sample], s: np.ndarray, X: np.ndarray, factor: np.ndarray
) -> np.ndarray | None:
    """∂f/∂x over the reduced unit cube from ∂y/∂θ: y = s^e f(θ′) and θ′_k = θ_k s^(−e_k), at constant modulus."""
    box, exponents = emulator.reduced, emulator.group.exponents
    if box is None or not any(p.gradients.get(o.id) for p in samples):
        return None
    scaled = emulator.group.reference is not None
    G = np.array([[p.gradients.get(o.id, {}).get(n, np.nan) for n in box.names] for p in samples])
    shrink = np.stack([s ** (exponents.get(n, 0) if scaled else 0) for n in box.names], axis=1)
    G = G * shrink / factor[:, None] * box.slope(X)
    return G if np.isfinite(G).any() else None


# ------------------------------------------------------------------------------------------------------ on disk


def save_emulator(emulator: Emulator, stem: Path) -> None:
    """Write the emulator to `stem`.json and `stem`.npz (see :mod:`rso.emulation.saving`)."""
    curves: list[WholeCurve] = []
    models: dict[str, Any] = {}
    for name, model in emulator.surrogates.items():
        if isinstance(model, CurvePoint):
            if not any(c is model.curve for c in curves):
                curves.append(model.curve)
            index = next(k for k, c in enumerate(curves) if c is model.curve)
            models[name] = {"kind": model.kind, "curve": index, "point": model.point}
        else:
            models[name] = model.to_dict()
    emulation.save_arrays(
        stem,
        {
            "schema": 1,
            "box": dataclasses.asdict(emulator.box),
            "reduced": None if emulator.reduced is None else dataclasses.asdict(emulator.reduced),
            "group": dataclasses.asdict(emulator.group),
            "outputs": [dataclasses.asdict(o) for o in emulator.outputs],
            "samples": [dataclasses.asdict(s) for s in emulator.samples],
            "degree": emulator.degree,
            "curves": [c.to_dict() for c in curves],
            "surrogates": models,
        },
    )


def load_emulator(stem: Path) -> Emulator:
    """The emulator of :func:`save_emulator`, with the same predictions to the bit; OSError or ValueError else."""
    data = emulation.load_arrays(stem)
    if data.get("schema") != 1:
        raise ValueError(f"{stem.name}.json: schema {data.get('schema')!r} is not 1")
    curves = [WholeCurve.from_dict(c) for c in data["curves"]]
    models = {
        name: CurvePoint(curves[m["curve"]], m["point"]) if m["kind"] == "whole_curve" else from_dict(m)
        for name, m in data["surrogates"].items()
    }
    return Emulator(
        Box(**data["box"]),
        Group(**data["group"]),
        None if data["reduced"] is None else Box(**data["reduced"]),
        tuple(Output(**o) for o in data["outputs"]),
        models,
        tuple(Sample(**s) for s in data["samples"]),
        data["degree"],
    )
