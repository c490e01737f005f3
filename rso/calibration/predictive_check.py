"""Experiments that were not fitted, predicted by the most likely point, with what the fit leaves open of it.

    f = f₀ + J (x̂ − x₀),   Σ = (F/b² + 12 I)⁻¹,   C = C_y + s sᵀ + J Σ Jᵀ,   χ² = (y − f)ᵀ C⁻¹ (y − f)

f₀ (n,) is run at x₀, next to the most likely x̂ (d,); F is the Fisher information of the identification in the unit cube
of the ranges, which count as a weak prior (12 I); b what the fit has widened its errors by; C_y what is known of the
errors of the readings y, s the numerical error of the run.  All compared channels of an experiment are one test: of a
perfect model, linear in x, χ² is larger than measured in the share p of all data sets.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import block_diag, cholesky, solve_triangular

from rso.calibration.held_out import HeldOutReadings, held_out_readings, task
from rso.calibration.plan import Plan
from rso.calibration.search_stage import Chosen
from rso.calibration.stages import Run, Runner, why
from rso.core.curves import Metrics, metrics
from rso.core.distributions import chi2_sf
from rso.evaluation import Outcome
from rso.evaluation.store import Done
from rso.inference import Determination, correlated_along, gain
from rso.inference.identifiability import WIDE
from rso.inference.likelihood import SMALLEST
from rso.inference.output_derivatives import NoSlopes, jacobian
from rso.inference.sloppy_directions import UNIFORM

UNLIKELY = 0.05  # a perfect model is said to miss in this share of data sets
BESIDE = 1e-3  # of the unit cube: a candidate as near to the most likely point is run already
DIGITS = 6  # of the most likely values when they are run
WORDS = ("yes", "among", "no")  # among: it agrees because the fit leaves the prediction open, by more than `WIDE`


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel: readings, what is predicted there (n,), numerical error and the parameters' share of its sd (n,)."""

    kept: HeldOutReadings
    predicted: np.ndarray
    error: np.ndarray
    spread: np.ndarray
    chi2: float | None
    p_value: float | None
    metrics: Metrics

    @property
    def missed(self) -> bool | None:
        """Whether this channel alone is missed; None where nobody can say."""
        return None if self.p_value is None else self.p_value < UNLIKELY


@dataclass(frozen=True, eq=False)
class PredictiveCheck:
    """One experiment: its test over all channels; `alone` is the p-value without the parameters' uncertainty.

    `verdict` is one of `WORDS`, None where nobody can say, and `why` then says why not.  J (n, d) and the covariances
    (n, n) of `theirs`, the readings, and `ours`, the run, are None where that is because of a run.
    """

    experiment: str
    runs: tuple[Run, ...]
    why: str
    values: Mapping[str, float] = field(default_factory=dict)
    channels: tuple[Channel, ...] = ()
    chi2: float | None = None
    p_value: float | None = None
    alone: float | None = None
    J: np.ndarray | None = None
    theirs: np.ndarray | None = None
    ours: np.ndarray | None = None

    @property
    def points(self) -> int:
        """Number of readings."""
        return sum(len(c.predicted) for c in self.channels)

    @property
    def verdict(self) -> str | None:
        """Whether the experiment is predicted."""
        if self.p_value is None or self.alone is None:
            return None
        if self.p_value < UNLIKELY:
            return "no"
        wide = any(float(c.spread.max()) > WIDE * float(np.abs(c.predicted).max()) for c in self.channels)
        return "among" if wide and self.alone < UNLIKELY else "yes"


def most_likely(plan: Plan, d: Determination, chosen: Sequence[Chosen]) -> dict[str, float]:
    """Values that are run: the most likely ones, or those of a candidate next to them."""
    box = d.misfit.model.box
    for _, _, values in chosen:
        if np.abs(box.to_unit(np.array([values[n] for n in box.names])) - d.fit.x).max() < BESIDE:
            return dict(values)
    theta = [float(f"{v:.{DIGITS}g}") for v in d.fit.theta]
    return {**dict(zip(box.names, theta, strict=True)), **plan.resolved.fixed}


def predictive_checks(bench: Runner, d: Determination, values: Mapping[str, float]) -> list[PredictiveCheck]:
    """Every experiment that was not fitted by the `values` next to the most likely point."""
    names = held_out_experiments(bench.plan)
    outcomes = bench.run_tasks([task(bench.plan, name, values) for name in names])
    return [_foretold(bench, d, name, values, o) for name, o in zip(names, outcomes, strict=True)]


def held_out_experiments(plan: Plan) -> list[str]:
    """Experiments that took no part in the identification: those to select by, and those kept for the end."""
    chosen_by = [e.name for e in plan.study.experiments if e.role == "select" and e.kind == "force"]
    return [*chosen_by, *plan.validation]


def warnings(plan: Plan, found: Sequence[PredictiveCheck]) -> list[str]:
    """Curves to select by that are missed: an NRMSE of some per cent may be far beyond their errors."""
    missed = [v for v in found if v.verdict == "no" and v.experiment not in plan.validation]
    return [
        f"{v.experiment} (role select, not fitted) is not predicted by the most likely values: χ² = {v.chi2:.3g} "
        f"for {v.points} readings. All known uncertainties are included"
        for v in missed
    ]


def _foretold(
    bench: Runner, d: Determination, name: str, values: Mapping[str, float], outcome: Outcome
) -> PredictiveCheck:
    plan, box, parts = bench.plan, d.misfit.model.box, held_out_readings(bench.plan, name)
    runs = [Run("foretell", values, (outcome,))]
    if not isinstance(outcome, Done):
        text = f"the run of the most likely point has no answer: {why(outcome)[1]}"
        return PredictiveCheck(name, tuple(runs), text, dict(values))
    response = outcome.response
    x0 = box.to_unit(np.array([values[n] for n in box.names]))

    def look(points: Sequence[np.ndarray]) -> list[np.ndarray | str]:
        beside = [{**values, **dict(zip(box.names, map(float, box.from_unit(x)), strict=True))} for x in points]
        found = bench.run_tasks([task(plan, name, v) for v in beside])
        runs.extend(Run("difference", v, (o,)) for v, o in zip(beside, found, strict=True))
        return [
            np.concatenate([k.read(o.response) for k in parts]) if isinstance(o, Done) else why(o)[1] or ""
            for o in found
        ]

    known = [n for n in box.names if all(k.knows(response, n) for k in parts)]
    own = {n: np.concatenate([k.read(response, n) for k in parts]) for n in known}
    f = np.concatenate([k.read(response) for k in parts])
    try:
        J = jacobian(box, np.clip(x0, 0.0, 1.0), f, own, look)
    except NoSlopes as no:
        return PredictiveCheck(name, tuple(runs), str(no), dict(values))
    y, f = np.concatenate([k.value for k in parts]), f + J @ (d.fit.x - x0)
    ours = block_diag(*(correlated_along(k.depth, k.error(response), float(k.depth.max())) for k in parts))
    theirs = block_diag(*(k.covariance for k in parts))
    left = J @ np.linalg.solve(d.fit.fisher / d.wider**2 + UNIFORM * np.eye(box.d), J.T)
    stated = bool(np.any(np.diag(theirs + ours)))
    channels, start = [], 0
    for k in parts:
        rows = slice(start, start + len(k.depth))
        chi2, p = _test(y[rows], f[rows], (theirs + ours + left)[rows, rows]) if stated else (None, None)
        spread = np.sqrt(np.diag(left)[rows])
        channels.append(Channel(k, f[rows], k.error(response), spread, chi2, p, metrics(y[rows], f[rows])))
        start = rows.stop
    text = "" if stated else "neither the errors of its readings nor those of its run are known"
    chi2, p = _test(y, f, theirs + ours + left) if stated else (None, None)
    alone = _test(y, f, theirs + ours)[1] if stated else None
    return PredictiveCheck(name, tuple(runs), text, dict(values), tuple(channels), chi2, p, alone, J, theirs, ours)


def _test(y: np.ndarray, f: np.ndarray, C: np.ndarray) -> tuple[float, float]:
    """χ² of readings y (n,) predicted as f (n,) with covariance C (n, n), and the share p of larger ones."""
    floor = SMALLEST * (float(np.abs(y).max()) or 1.0)
    r = solve_triangular(cholesky(C + floor**2 * np.eye(len(y)), lower=True), y - f, lower=True)
    chi2 = float(r @ r)
    return chi2, float(chi2_sf(chi2, len(y)))


def gains(plan: Plan, d: Determination, found: Sequence[PredictiveCheck]) -> list[dict[str, Any]]:
    """What the force curves that were kept for the end would add if they were fitted too."""
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
        C = v.theirs * d.wider**2 + v.ours + 1e-12 * np.eye(len(y)) * float(np.abs(y).max()) ** 2
        g = gain(box, d.fit.x, d.fit.fisher / d.wider**2, f"{v.experiment}, fitted too", v.J, C)
        rows.append({"test": g.test, "before": dict(g.before), "after": dict(g.after)})
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
        "chi2": v.chi2,
        "points": v.points,
        "p_value": v.p_value,
        "alone": v.alone,
        "channels": [
            {
                "channel": c.kept.channel,
                "unit": c.kept.unit,
                "depth": c.kept.depth,
                **c.kept.times,
                "measured": c.kept.value,
                "sigma": c.kept.sigma,
                "predicted": c.predicted,
                "numerical_error": c.error,
                "spread": c.spread,
                "chi2": c.chi2,
                "p_value": c.p_value,
                "missed": c.missed,
                "metrics": dataclasses.asdict(c.metrics),
            }
            for c in v.channels
        ],
    }
