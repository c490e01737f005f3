"""Experiments that are not fitted: what was measured of every compared channel, and what a run says of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rso.calibration.plan import Plan
from rso.calibration.readings import measured, of_response
from rso.contract import Case, Response
from rso.core.curves import at_readings, first_loading, hold_rows, on_the_way_back
from rso.evaluation import Task
from rso.inference import SURFACE_CHANNEL, CurvePlace, ModelErrors
from rso.study.cases import cloud_channels, mark_channel


@dataclass(frozen=True, eq=False)
class HeldOutReadings:
    """Readings (n,) of one channel from contact on, with the covariance (n, n) of their errors; depth in mm.

    `simulated` names the channel of a response behind each: of a profile, whose places are in `position` (n, 2) mm
    (else None), that of its mark.  `since` (n,) s is the time since the indenter came to rest, None without a hold.
    """

    experiment: str
    channel: str
    unit: str
    depth: np.ndarray
    value: np.ndarray
    covariance: np.ndarray
    simulated: np.ndarray
    position: np.ndarray | None
    since: np.ndarray | None = None
    back: bool = False
    freedom: float = math.inf

    @property
    def times(self) -> dict[str, np.ndarray]:
        """Times in the hold by their key in results; none without a hold."""
        return {} if self.since is None else {"since": self.since}

    @property
    def sigma(self) -> np.ndarray:
        """Standard uncertainty (n,) of each reading."""
        return np.sqrt(np.diag(self.covariance))

    def knows(self, response: Response, knob: str) -> bool:
        """Whether a response has the derivatives by a knob behind every reading."""
        return all(c in response.gradients.get(knob, {}) for c in set(self.simulated.tolist()))

    def read(self, response: Response, knob: str = "") -> np.ndarray:
        """What a run has at the readings (n,), or with a `knob` its derivatives by it."""
        found = np.zeros_like(self.depth)
        for channel in dict.fromkeys(self.simulated.tolist()):
            curve, mine = response.curve(channel), self.simulated == channel
            y = np.asarray(response.gradients[knob][channel]) if knob else curve.value
            depth, since = np.minimum(self.depth[mine], curve.travel_mm.max()), self._since(mine)
            time = response.channels["time"]
            found[mine] = at_readings(time, curve.travel_mm, y, depth, since, self.back, channel)
        return found

    def errors(self, response: Response) -> ModelErrors:
        """What a run may be off by there, as of a fitted curve; of a profile its estimated numerical error."""
        if self.position is not None:
            return ModelErrors(self.error(response))
        depth = np.minimum(self.depth, response.curve(self.channel).travel_mm.max())
        return of_response(
            response, CurvePlace(self.experiment, self.channel, depth, self.since, self.back), self.value
        )

    def error(self, response: Response) -> np.ndarray:
        """Estimated numerical error (n,) of what a run has there."""
        found = np.zeros_like(self.depth)
        for channel in dict.fromkeys(self.simulated.tolist()):
            curve, mine = response.curve(channel), self.simulated == channel
            if self.back:
                found[mine] = on_the_way_back(curve.travel_mm, curve.error, self.depth[mine])
                continue
            on, since = first_loading(curve.travel_mm), self._since(mine)
            found[mine] = np.interp(self.depth[mine], curve.travel_mm[on], curve.error[on])
            if since is not None and (held := mine & (self.since > 0.0)).any():  # type: ignore[operator]
                time, depth = response.channels["time"], float(self.depth[held][0])
                found[held] = curve.error[hold_rows(channel, time, curve.travel_mm, depth, since[since > 0.0])]
        return found

    def _since(self, mine: np.ndarray) -> np.ndarray | None:
        return None if self.since is None else self.since[mine]


def held_out_readings(plan: Plan, name: str) -> tuple[HeldOutReadings, ...]:
    """Every compared channel of an experiment; the components of a point cloud, whose errors go together, are one."""
    if (cloud := plan.clouds.get(name)) is not None:
        C, marks = cloud.covariance, cloud_channels(cloud)
        return (HeldOutReadings(name, SURFACE_CHANNEL, "mm", cloud.depth, cloud.value, C, marks, cloud.position),)
    found = []
    for channel in plan.study.experiment(name).compared:
        curve = measured(plan, name, channel)
        on = curve.compared
        place = None if curve.position is None else curve.position[on]
        behind = [channel] * int(on.sum()) if place is None else [mark_channel(p) for p in place]
        C = curve.covariance[np.ix_(on, on)]
        found.append(
            HeldOutReadings(
                name,
                channel,
                curve.unit,
                curve.depth[on],
                curve.value[on],
                C,
                np.array(behind),
                place,
                None if curve.since is None else curve.since[on],
                curve.back,
                curve.freedom,
            )
        )
    return tuple(found)


def task(plan: Plan, name: str, values: Mapping[str, float]) -> Task:
    """The simulation of an experiment, alone."""
    case: Case = plan.validation[name] if name in plan.validation else plan.cases[plan.case_of[name]]
    return Task(values, case, frozenset(c for k in held_out_readings(plan, name) for c in k.simulated.tolist()))
