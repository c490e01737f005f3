"""Models of measured curves: from an emulator, or from a backend's runs with its own derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rso.contract import Response
from rso.core.curves import Resampling, at_readings
from rso.doe import Box
from rso.emulation.emulator import Emulator, Output
from rso.inference.likelihood import Model

Run = Callable[[Mapping[str, float]], Mapping[str, Response]]
SURFACE_CHANNEL = "surface"  # the channel of a point cloud: many marks and components together
RUN_DIFFERENCE_STEP = 1e-3  # of the unit cube, for a backend without derivatives: above the scatter of converged runs


@dataclass(frozen=True, eq=False)
class CurvePlace:
    """Where a curve was measured: depths (n,) mm of one channel of one experiment.

    `since` (n,) s is the time since the indenter came to rest, 0 for readings of loading; None without a hold.
    `back`: all are readings of the unloading.  Of a point cloud the channel is `SURFACE_CHANNEL`, and `marks` (n,) are
    those of a response behind each reading, at a depth that is computed; None of a curve.
    """

    experiment: str
    channel: str
    depth: np.ndarray
    since: np.ndarray | None = None
    back: bool = False
    marks: np.ndarray | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of a response that are read."""
        return (self.channel,) if self.marks is None else tuple(dict.fromkeys(self.marks.tolist()))

    @property
    def held(self) -> np.ndarray:
        """(n,) whether a reading is one of the hold."""
        return np.zeros(len(self.depth), bool) if self.since is None else self.since > 0.0


def emulated(emulator: Emulator, place: CurvePlace) -> tuple[Model, Callable[[np.ndarray], np.ndarray]]:
    """A curve from the emulator, and its standard deviation (n,) at x (d,).

    The spline of :class:`~rso.core.curves.Resampling` is linear in the computed values: one matrix (n, m) for all.
    ValueError if the emulator knows nothing of the curve, or not as deep.
    """
    outputs, R = _at(emulator, place)
    if place.marks is not None:
        return Model(emulator.box, lambda X: emulator.means(outputs, np.asarray(X, float))), lambda x: emulator.surface(
            outputs, np.asarray(x, float)[None]
        )[1][0]
    loading, held = np.array([o.since_s == 0.0 for o in outputs]), place.held
    travel = np.array([o.depth_mm for o in outputs])[loading]

    def predict(X: np.ndarray) -> np.ndarray:
        return emulator.means(outputs, np.asarray(X, float)) @ R.T

    def band(x: np.ndarray) -> np.ndarray:
        sd = np.array([emulator.predict(o, np.asarray(x, float)[None])[1][0] for o in outputs])
        if place.back:
            return np.interp(place.depth, travel, sd)
        found = np.interp(place.depth, np.append(0.0, travel), np.append(0.0, sd[loading]))
        found[held] = R[held] @ sd  # computed moments: there is nothing between
        return found

    return Model(emulator.box, predict), band


def emulated_together(emulator: Emulator, places: Sequence[CurvePlace]) -> Model:
    """The curves of several places one after the other, from one question to the emulator.

    ValueError as :func:`emulated`.
    """
    each = [_at(emulator, p) for p in places]
    outputs, ends = [o for mine, _ in each for o in mine], np.cumsum([len(mine) for mine, _ in each])

    def predict(X: np.ndarray) -> np.ndarray:
        whole = emulator.means(outputs, np.asarray(X, float))
        if len(each) == 1:
            return whole @ each[0][1].T
        parts = np.split(whole, ends[:-1], axis=1)
        return np.concatenate([part @ R.T for part, (_, R) in zip(parts, each, strict=True)], axis=1)

    return Model(emulator.box, predict)


def spread_of(emulator: Emulator, place: CurvePlace, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (k, m) of the surrogates y of a curve at X (k, d), and R (n, m) of the curve R y.

    ValueError as :func:`emulated`.
    """
    outputs, R = _at(emulator, place)
    if place.marks is not None:
        return emulator.modes_of_surface(outputs, np.asarray(X, float))
    return np.stack([emulator.predict(o, np.asarray(X, float))[1] for o in outputs], axis=1), R


def _at(emulator: Emulator, place: CurvePlace) -> tuple[list[Output], np.ndarray]:
    """Outputs of a curve by travel, and the matrix (n, m) of the spline through them at its measured places."""
    outputs = outputs_of(emulator.outputs, place)
    if not outputs:
        raise ValueError(f"the emulator has no {place.channel} of {place.experiment!r}")
    return outputs, readings_matrix(outputs, place)


def outputs_of(outputs: Sequence[Output], place: CurvePlace) -> list[Output]:
    """Those of a curve: loading by travel, then its hold by time; of a cloud that of each reading."""
    if place.marks is not None:
        known = {(o.channel, round(o.depth_mm, 9)): o for o in outputs if o.experiment == place.experiment}
        each = zip(place.marks.tolist(), place.depth.tolist(), strict=True)
        return [known[c, round(u, 9)] for c, u in each] if known else []
    mine = [o for o in outputs if (o.experiment, o.channel) == (place.experiment, place.channel)]
    return sorted(mine, key=lambda o: o.order)


def readings_of(outputs: Sequence[Output], values: np.ndarray, place: CurvePlace) -> np.ndarray:
    """Values (n,) at measured places of those (m,) of `outputs`, sorted as :func:`outputs_of` does."""
    if place.marks is not None:
        return values
    if place.held.any() or place.back:
        return readings_matrix(outputs, place) @ values
    loading = np.array([not o.since_s for o in outputs])
    travel = np.array([o.depth_mm for o in outputs])[loading]
    return Resampling(travel, values[loading])(place.depth)


def readings_matrix(outputs: Sequence[Output], place: CurvePlace) -> np.ndarray:
    """R (n, m) that makes values at measured places of the values of `outputs`, in their order.

    Loading is a spline over the travels; moments of a hold are those that were asked for.  ValueError for another one.
    """
    if place.marks is not None:
        return np.eye(len(outputs))
    travel = np.array([o.depth_mm for o in outputs if not o.since_s])
    n, held = len(travel), place.held
    if place.back:
        return np.stack([np.interp(place.depth, travel, e) for e in np.eye(n)], axis=1)
    if n and not held.any():
        R = Resampling(travel, np.eye(n))(place.depth)
        return R if n == len(outputs) else np.hstack([R, np.zeros((len(R), len(outputs) - n))])
    R = np.zeros((len(held), len(outputs)))
    if n:  # creep has no loading of its own
        R[~held, :n] = Resampling(travel, np.eye(n))(place.depth[~held])
    moments = {o.since_s: n + k for k, o in enumerate(outputs[n:])}
    for k in np.flatnonzero(held):
        since = float(place.since[k])  # type: ignore[index]
        if since not in moments:
            what = f"{place.channel} of {place.experiment!r}"
            raise ValueError(f"no {what} is computed {since:g} s into its hold")
        R[k, moments[since]] = 1.0
    return R


def simulated_curves(
    box: Box, run: Run, places: Sequence[CurvePlace], fixed: Mapping[str, float] | None = None
) -> Model:
    """Curves from runs of a backend: `run` values → response by experiment.

    Derivatives are the response's own where it has those of every parameter of the box, else forward differences,
    d more runs.  A run is kept until another is asked for, so that values and derivatives cost one run.
    """
    last: dict[bytes, Mapping[str, Response]] = {}

    def at(x: np.ndarray) -> Mapping[str, Response]:
        key = x.tobytes()
        if key not in last:
            theta = box.from_unit(x)
            answer = run({**dict(zip(box.names, map(float, theta), strict=True)), **(fixed or {})})
            last.clear()
            last[key] = answer
        return last[key]

    def values(x: np.ndarray) -> np.ndarray:
        return np.concatenate([resample(at(x)[p.experiment], p, "") for p in places])

    def derivative(x: np.ndarray) -> np.ndarray:
        answer = at(x)
        if all(has_gradients(answer[p.experiment], c, box) for p in places for c in p.channels):
            rows = [np.stack([resample(answer[p.experiment], p, n) for n in box.names], axis=1) for p in places]
            return np.vstack(rows) * box.slope(x)
        here = values(x)
        columns = []
        for k in range(box.d):
            moved = x.copy()
            moved[k] += RUN_DIFFERENCE_STEP if x[k] + RUN_DIFFERENCE_STEP <= 1 else -RUN_DIFFERENCE_STEP
            columns.append((values(moved) - here) / (moved[k] - x[k]))
        return np.stack(columns, axis=1)

    return Model(box, lambda X: np.stack([values(x) for x in np.array(X, float)]), derivative)


def of_marks(response: Response, place: CurvePlace, table: Mapping[str, np.ndarray]) -> np.ndarray:
    """Entries (n,) of a `table` by channel behind the readings of a cloud; ValueError for a depth not computed."""
    assert place.marks is not None
    found = np.empty(len(place.depth))
    travel = response.curve(place.marks[0]).travel_mm
    for k, (channel, depth) in enumerate(zip(place.marks.tolist(), place.depth.tolist(), strict=True)):
        at = int(np.argmin(np.abs(travel - depth)))
        if abs(travel[at] - depth) > 1e-6:
            raise ValueError(f"{channel} of {place.experiment!r} is not computed at {depth:g} mm")
        found[k] = np.asarray(table[channel])[at]
    return found


def has_gradients(response: Response, channel: str, box: Box) -> bool:
    """Whether a response knows the derivatives of a channel by every parameter of the box."""
    return all(channel in response.gradients.get(n, {}) for n in box.names)


def resample(response: Response, place: CurvePlace, knob: str) -> np.ndarray:
    """Values (n,) of a channel at the measured depths, or with a `knob` its derivatives by it."""
    if place.marks is not None:
        return of_marks(response, place, response.gradients[knob] if knob else response.channels)
    curve = response.curve(place.channel)
    y = np.asarray(response.gradients[knob][place.channel]) if knob else curve.value
    time, travel = response.channels["time"], curve.travel_mm
    return at_readings(time, travel, y, place.depth, place.since, place.back, place.channel)
