"""The measured curves of a study: which are compared, where, with which errors."""

from __future__ import annotations

import functools

import numpy as np

from rso.calibration.plan import Plan
from rso.contract import Response
from rso.core.curves import CREEP_CHANNEL, error_between_points, first_loading, hold_rows, on_the_way_back
from rso.data import MeasuredCurve, cloud_curve, combine
from rso.emulation.emulator import Emulator, Output
from rso.inference import SURFACE_CHANNEL, CurvePlace, Data, ModelErrors, emulated, of_marks, outputs_of, resample
from rso.inference.input_effects import with_effects
from rso.study.cases import cloud_channels, other_branch
from rso.study.creep import loading_experiment


def force_curves(plan: Plan, role: str) -> list[tuple[str, str]]:
    """(experiment, channel) of the force curves of a role; a study always has one to fit."""
    every = [e for e in plan.study.experiments if e.role == role and e.kind == "force"]
    return [(e.name, c) for e in every for c in e.compared]


def measured(plan: Plan, name: str, channel: str) -> MeasuredCurve:
    """A channel of an experiment, its repeats combined: loading, and its hold behind it where the model follows one."""
    if name in plan.clouds:
        return cloud_curve(plan.clouds[name], channel)
    curve, hold = plan.curves[name], plan.holds.get(name)
    if curve.channel == channel and hold is None:
        return curve
    return _combined(plan, name, channel)


@functools.lru_cache(maxsize=64)
def _combined(plan: Plan, name: str, channel: str) -> MeasuredCurve:
    """Asked for many times in a study."""
    noise, branch = plan.study.noise_of(name), plan.study.experiment(name).branch
    return combine(plan.study.measurement(name), noise, channel, branch, plan.holds.get(name))


def curve_label(plan: Plan, name: str, channel: str) -> str:
    """What a compared curve is called: its experiment, and where it is not the first of that the channel too."""
    return name if channel == plan.study.experiment(name).compared[0] else f"{name} {channel}"


def compared_curves(plan: Plan) -> dict[str, tuple[str, MeasuredCurve]]:
    """Label → experiment and measured curve of every channel that is compared of the experiments to fit and select."""
    pairs = [(n, c) for n in plan.case_of if n not in plan.clouds for c in plan.study.experiment(n).compared]
    return {curve_label(plan, n, c): (n, measured(plan, n, c)) for n, c in pairs}


def places_from_contact(plan: Plan, name: str, channel: str) -> CurvePlace:
    """Where a curve was measured, from contact on."""
    curve = measured(plan, name, channel)
    return curve_place(name, curve, curve.compared)


def profile_positions(places: np.ndarray | None) -> list[list[float]]:
    """Places (n, 2) of a profile as lists, none of a force curve."""
    return [] if places is None else [[float(x), float(y)] for x, y in places]


def curve_place(name: str, curve: MeasuredCurve, keep: np.ndarray, deepest: float = np.inf) -> CurvePlace:
    """Where the readings to `keep` (n,) of a curve were measured, none deeper than `deepest` (mm)."""
    since = None if curve.since is None else curve.since[keep]
    return CurvePlace(name, curve.channel, np.minimum(curve.depth[keep], deepest), since, curve.back)


def curve_data(plan: Plan, place: CurvePlace) -> Data:
    """A measured curve with what repeats and the experimenter say about its errors."""
    if place.marks is not None:
        return with_input_errors(plan, place, cloud_data(plan, place.experiment))
    curve = measured(plan, place.experiment, place.channel)
    keep = curve.compared
    several = len(plan.study.experiment(place.experiment).compared) > 1
    label = f"{place.experiment} {place.channel}" if several else place.experiment
    return with_input_errors(plan, place, as_data(label, record_of(plan, place.experiment), curve, keep))


def record_of(plan: Plan, name: str) -> str:
    """The experiment by which errors of a whole record are called: its loading, creep and unloading share contact and
    gain."""
    test = loading_experiment(name) if name in plan.creeps.followed else name
    other = other_branch(plan.study, test)
    return other if other is not None and plan.study.experiment(test).branch == "unloading" else test


def with_input_errors(plan: Plan, place: CurvePlace, data: Data) -> Data:
    """Readings with what uncertain inputs of the study make of them, once those were simulated."""
    return with_effects(data, place, plan.case_of[place.experiment], plan.effects)


def cloud_place(plan: Plan, name: str) -> CurvePlace:
    """Where and when the readings of a point cloud were taken."""
    cloud = plan.clouds[name]
    return CurvePlace(name, SURFACE_CHANNEL, cloud.depth, marks=cloud_channels(cloud))


def cloud_data(plan: Plan, name: str) -> Data:
    """The readings of a point cloud with their errors."""
    cloud = plan.clouds[name]
    return Data(name, "mm", cloud.depth, cloud.value, cloud.covariance)


def as_data(label: str, experiment: str, curve: MeasuredCurve, keep: np.ndarray) -> Data:
    """A measured curve at the readings to `keep` (n,); errors that its channels share are of the experiment's own."""
    C = curve.covariance[np.ix_(keep, keep)]
    every = {"calibration"}  # one cell for all experiments
    shared = {n if n in every else f"{experiment}: {n}": s[keep] for n, s in curve.shared.items()}
    white = None if curve.white is None else curve.white[keep]
    left = {n if n in every else f"{experiment}: {n}": U[keep] for n, U in curve.usual.items()}
    return Data(
        label,
        curve.unit,
        curve.depth[keep],
        curve.value[keep],
        C,
        curve.freedom,
        shared,
        white,
        usual=left,
        itself=curve.n_repeats == 1,
        since=None if curve.since is None else curve.since[keep],
    )


def curve_outputs(plan: Plan) -> list[Output]:
    """The outputs of the plan that belong to compared channels."""
    wanted = {(e, c) for r in ("fit", "select") for e, c in force_curves(plan, r)}
    return [o for o in plan.outputs if (o.experiment, o.channel) in wanted]


def model_errors(
    response: Response | None, place: CurvePlace, readings: np.ndarray, travel: np.ndarray, value: np.ndarray,
    emulator: np.ndarray | None = None,
) -> ModelErrors:  # fmt: skip
    """What a curve predicted by the model may be off by where `readings` (n,) were taken: the same in every analysis.

    The numerical error is that which a `response` near the most likely point states, in proportion to the readings,
    unknown (0) without one; the spline is that through the predicted `value` (m,) at `travel` (m,) mm; `emulator` (n,)
    is the standard deviation of what stands for simulations, None where nothing does.  In creep the error changes with
    the elements that the contact reaches, and so with the depth that is read.
    """
    if place.marks is not None:  # its depths are computed ones
        stated = np.zeros(len(readings)) if response is None else error_at(response, place)
        return ModelErrors(stated, None, 0.0, emulator)
    off, spacing = np.zeros(len(place.depth)), 0.0
    if not (place.back or place.held.all()):  # else every travel that is compared is computed, or many are
        off = np.where(place.held, 0.0, error_between_points(travel, value, place.depth))
        spacing = float(np.median(np.diff(np.append(0.0, travel))))
    stated = np.zeros(len(off)) if response is None else numerical(response, place, readings)
    depth = readings if place.channel == CREEP_CHANNEL and place.since is not None else None
    return ModelErrors(stated, off if off.any() else None, spacing, emulator, depth)


def of_response(response: Response, place: CurvePlace, readings: np.ndarray) -> ModelErrors:
    """The same of a curve that this response itself is, without an emulator."""
    if place.marks is not None:
        return model_errors(response, place, readings, place.depth, readings)
    curve = response.curve(place.channel)
    used = first_loading(curve.travel_mm)
    return model_errors(response, place, readings, curve.travel_mm[used], np.asarray(curve.value)[used])


def of_emulator(
    emulator: Emulator, x: np.ndarray, response: Response | None, place: CurvePlace, readings: np.ndarray
) -> ModelErrors:
    """The same of the curve that an emulator has at x (d,)."""
    if place.marks is not None:
        return model_errors(response, place, readings, place.depth, readings, emulated(emulator, place)[1](x))
    outputs = [o for o in outputs_of(emulator.outputs, place) if not o.since_s]
    travel = np.array([o.depth_mm for o in outputs])
    value = emulator.means(outputs, x[None])[0] if outputs else travel
    return model_errors(response, place, readings, travel, value, emulated(emulator, place)[1](x))


def numerical(response: Response, place: CurvePlace, readings: np.ndarray) -> np.ndarray:
    """Estimated numerical error (n,) at the measured depths, in proportion to the size of the `readings` (n,)."""
    error = error_at(response, place)
    if place.channel == CREEP_CHANNEL:  # of a depth that is found: no share of another
        return error
    largest = float(np.abs(resample(response, place, "")).max())
    return error if largest == 0.0 else error * float(np.abs(readings).max()) / largest


def error_at(response: Response, place: CurvePlace) -> np.ndarray:
    """Estimated numerical error (n,) of a channel at the measured depths and moments; between travels it grows as
    u^{3/2}.

    It is no share of the value: a lateral force may vanish on its way, and its error does not.
    """
    if place.marks is not None:
        errors = {c: response.curve(c).error for c in place.channels}
        return of_marks(response, place, errors)
    curve = response.curve(place.channel)
    if place.channel == CREEP_CHANNEL and place.since is not None:
        return curve.error[hold_rows(CREEP_CHANNEL, response.channels["time"], curve.travel_mm, 0.0, place.since)]
    if place.back:
        return on_the_way_back(curve.travel_mm, curve.error, place.depth)
    used = first_loading(curve.travel_mm)
    u = curve.travel_mm[used]
    found = np.interp(place.depth, u, curve.error[used] / u**1.5) * place.depth**1.5
    if (held := place.held).any():
        assert place.since is not None
        time, depth = response.channels["time"], float(place.depth[held][0])
        at = hold_rows(place.channel, time, curve.travel_mm, depth, place.since[held])
        found[held] = curve.error[at]
    return found
