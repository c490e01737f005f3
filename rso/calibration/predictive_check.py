"""Experiments that were not fitted, predicted by the most likely point, with what the fit leaves open of it.

    f = f₀ + J (x̂ − x₀)

f₀ (n,) is run at x₀, next to the most likely x̂ (d,).  All compared channels of an experiment are one test
(:mod:`rso.inference.predictive_test`), in `rso run` by whichever method, and in `rso ladder`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from rso.calibration.held_out import HeldOutReadings, held_out_readings, task
from rso.calibration.plan import Plan
from rso.calibration.search_stage import Chosen
from rso.calibration.stages import Run, Runner
from rso.contract import Response
from rso.core.curves import Metrics, metrics
from rso.core.digits import significant
from rso.doe import Box
from rso.evaluation import Done, why
from rso.inference import SURFACE_CHANNEL, Determination
from rso.inference.output_derivatives import NoSlopes, jacobian
from rso.inference.predictive_test import PredictiveTest, open_by, predictive_test
from rso.inference.rules import RULES
from rso.optimal_design.gains import Gain, gain

SAME_CANDIDATE_DISTANCE = 1e-3  # of the unit cube: a candidate as near to the most likely point is run already
LIKELIEST_VALUE_DIGITS = 6  # of the most likely values when they are run
# among: it agrees because the fit leaves the prediction open, by more than `RULES.wide_error_share`
PREDICTION_WORDS = ("yes", "among", "no")
Values = Mapping[str, float]
Evaluate = Callable[[Sequence[Values]], Sequence[Response | str]]  # values of axes → a response, or why there is none
Slopes = Callable[[Values, Mapping[str, np.ndarray]], Mapping[str, np.ndarray]]  # derivatives by knob → by axis


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel: readings, what is predicted there (n,), numerical error and the parameters' share of its sd (n,)."""

    kept: HeldOutReadings
    predicted: np.ndarray
    error: np.ndarray
    spread: np.ndarray
    test: PredictiveTest | None
    metrics: Metrics


@dataclass(frozen=True, eq=False)
class PredictiveCheck:
    """One experiment: its `test` over all channels, None where nobody can say, and `why` then says why not.

    J (n, d) and the covariances (n, n) of `theirs`, the readings, and `ours`, the run, are None where that is because
    of a run.
    """

    experiment: str
    why: str
    values: Values = field(default_factory=dict)
    channels: tuple[Channel, ...] = ()
    test: PredictiveTest | None = None
    J: np.ndarray | None = None
    theirs: np.ndarray | None = None
    ours: np.ndarray | None = None
    runs: tuple[Run, ...] = ()

    @property
    def points(self) -> int:
        """Number of readings."""
        return sum(len(c.predicted) for c in self.channels)

    @property
    def verdict(self) -> str | None:
        """Whether the experiment is predicted: one of `PREDICTION_WORDS`, None where nobody can say."""
        if self.test is None:
            return None
        if self.test.missed:
            return "no"
        much = RULES.wide_error_share
        wide = any(float(c.spread.max()) > much * float(np.abs(c.predicted).max()) for c in self.channels)
        return "among" if wide and self.test.alone < RULES.missed_prediction_chance else "yes"


def predictive_check(
    plan: Plan, name: str, d: Determination, values: Values, evaluate: Evaluate, slopes: Slopes = lambda _, known: known
) -> PredictiveCheck:
    """An experiment that took no part in a fit, by the `values` of its axes next to the most likely point.

    `evaluate` simulates the experiment; derivatives of a response that it lacks are taken from runs beside it.
    """
    box, parts = d.misfit.model.box, held_out_readings(plan, name)
    (response,) = evaluate([values])
    if isinstance(response, str):
        return PredictiveCheck(name, response, dict(values))
    x0 = box.to_unit(np.array([values[n] for n in box.names]))

    def look(points: Sequence[np.ndarray]) -> list[np.ndarray | str]:
        beside = [{**values, **_named(box, x)} for x in points]
        return [a if isinstance(a, str) else np.concatenate([k.read(a) for k in parts]) for a in evaluate(beside)]

    known = {n: np.concatenate([k.read(response, n) for k in parts]) for n in _differentiated(parts, response)}
    f = np.concatenate([k.read(response) for k in parts])
    try:
        J = jacobian(box, np.clip(x0, 0.0, 1.0), f, slopes(values, known), look)
    except NoSlopes as no:
        return PredictiveCheck(name, str(no), dict(values))
    y, f = np.concatenate([k.value for k in parts]), f + J @ (d.fit.x - x0)
    off = [k.errors(response) for k in parts]
    ours = block_diag(*(_whole(e.parts(k.depth), len(k.depth)) for k, e in zip(parts, off, strict=True)))
    theirs = block_diag(*(k.covariance for k in parts))
    left = open_by(d.fisher_of_exact_inputs, J)
    stated = bool(np.any(np.diag(theirs + ours)))

    def test(rows: slice, freedom: float) -> PredictiveTest | None:
        if not stated:
            return None
        return predictive_test(y[rows], f[rows], (theirs + ours)[rows, rows], left[rows, rows], freedom)

    channels, start = [], 0
    for k, e in zip(parts, off, strict=True):
        rows = slice(start, start + len(k.depth))
        spread = np.sqrt(np.diag(left)[rows])
        channels.append(Channel(k, f[rows], e.numerical, spread, test(rows, k.freedom), metrics(y[rows], f[rows])))
        start = rows.stop
    text = "" if stated else "neither the errors of its readings nor those of its run are known"
    unknown = sum(len(k.depth) ** 2 / k.freedom for k in parts)
    whole = test(slice(None), len(y) ** 2 / unknown if unknown else math.inf)
    return PredictiveCheck(name, text, dict(values), tuple(channels), whole, J, theirs, ours)


def _named(box: Box, x: np.ndarray) -> dict[str, float]:
    return dict(zip(box.names, map(float, box.from_unit(x)), strict=True))


def _differentiated(parts: Sequence[HeldOutReadings], response: Response) -> list[str]:
    """Knobs by which a response has the derivatives behind every reading."""
    return [n for n in response.gradients if all(k.knows(response, n) for k in parts)]


def _whole(parts: Mapping[str, np.ndarray], n: int) -> np.ndarray:
    return sum(parts.values(), np.zeros((n, n)))


def most_likely(plan: Plan, d: Determination, chosen: Sequence[Chosen]) -> dict[str, float]:
    """Values that are run: the most likely ones, or those of a candidate next to them."""
    box = d.misfit.model.box
    for _, _, values in chosen:
        if np.abs(box.to_unit(np.array([values[n] for n in box.names])) - d.fit.x).max() < SAME_CANDIDATE_DISTANCE:
            return dict(values)
    theta = [float(f"{v:.{LIKELIEST_VALUE_DIGITS}g}") for v in d.fit.theta]
    return {**dict(zip(box.names, theta, strict=True)), **plan.resolved.fixed}


def predictive_checks(bench: Runner, d: Determination, values: Values) -> list[PredictiveCheck]:
    """Every experiment that was not fitted by the `values` next to the most likely point."""
    names = held_out_experiments(bench.plan)
    bench.evaluator.begin([task(bench.plan, name, values) for name in names])
    return [_checked(bench, d, name, values) for name in names]


def _checked(bench: Runner, d: Determination, name: str, values: Values) -> PredictiveCheck:
    plan, runs = bench.plan, list[Run]()

    def evaluate(points: Sequence[Values]) -> list[Response | str]:
        outcomes = bench.evaluator.run([task(plan, name, v) for v in points])
        purpose = "difference" if runs else "foretell"
        runs.extend(Run(purpose, v, (o,)) for v, o in zip(points, outcomes, strict=True))
        lost = "" if purpose == "difference" else "the run of the most likely point has no answer: "
        return [o.response if isinstance(o, Done) else f"{lost}{why(o)[1]}" for o in outcomes]

    return dataclasses.replace(predictive_check(plan, name, d, values, evaluate), runs=tuple(runs))


def held_out_experiments(plan: Plan) -> list[str]:
    """Experiments that took no part in the identification: those to select by, and those kept for the end."""
    chosen_by = [e.name for e in plan.study.experiments if e.role == "select" and e.kind == "force"]
    return [*chosen_by, *plan.validation]


def prediction_warnings(plan: Plan, found: Sequence[PredictiveCheck]) -> list[str]:
    """Curves to select by that are missed: an NRMSE of some per cent may be far beyond their errors."""
    return [
        f"{v.experiment} (role select, not fitted) is not predicted by the most likely values: "
        f"χ² = {significant(v.test.chi2, 3)} for {v.points} readings. "
        f"As a whole the readings lie {abs(v.test.level):.2g} standard deviations "
        f"{'above' if v.test.level > 0 else 'below'} the prediction. All known uncertainties are included"
        for v in found
        if v.test is not None and v.test.missed and v.experiment not in plan.validation
    ]


def gains(plan: Plan, d: Determination, found: Sequence[PredictiveCheck]) -> list[Gain]:
    """What the force curves that were kept for the end would add if they were fitted too; they cost no test."""
    box, rows = d.misfit.model.box, []
    for v in found:
        if (
            v.J is None
            or v.theirs is None
            or v.ours is None
            or v.experiment not in plan.validation
            or plan.study.experiment(v.experiment).kind != "force"
        ):
            continue
        y = np.concatenate([c.kept.value for c in v.channels])
        C = (v.theirs + v.ours) * d.used.scale**2 + 1e-12 * np.eye(len(y)) * float(np.abs(y).max()) ** 2
        rows.append(gain(box, d.fit.x, d.fisher_of_exact_inputs, f"{v.experiment}, fitted too", v.J, C, price=0))
    return rows


def of_predictions(found: Sequence[PredictiveCheck]) -> dict[str, Any]:
    """predictions."""
    return {"predictions": [_row(v) for v in found]}


def _row(v: PredictiveCheck) -> dict[str, Any]:
    return {
        "experiment": v.experiment,
        "values": dict(v.values),
        "verdict": v.verdict,
        "why": v.why or None,
        "chi2": None if v.test is None else v.test.chi2,
        "points": v.points,
        "p_value": None if v.test is None else v.test.p_value,
        "level": None if v.test is None else v.test.level,
        "alone": None if v.test is None else v.test.alone,
        "channels": [
            {
                "channel": c.kept.channel,
                "unit": c.kept.unit,
                "depth": c.kept.depth,
                **c.kept.times,
                **({"marks": c.kept.simulated.tolist()} if c.kept.channel == SURFACE_CHANNEL else {}),
                "measured": c.kept.value,
                "sigma": c.kept.sigma,
                "predicted": c.predicted,
                "numerical_error": c.error,
                "spread": c.spread,
                "chi2": None if c.test is None else c.test.chi2,
                "p_value": None if c.test is None else c.test.p_value,
                "missed": None if c.test is None else c.test.missed,
                "metrics": dataclasses.asdict(c.metrics),
            }
            for c in v.channels
        ],
    }
