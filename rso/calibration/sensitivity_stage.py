"""Sensitivities of a study on its surrogates: local, Morris, Sobol, at the targets and along the curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.calibration.plan import Plan, ends_in, limited
from rso.calibration.stages import FittedSurrogates
from rso.core.symbols import symbol, unit_text
from rso.core.units import people
from rso.doe import Box
from rso.emulation import sensitivity
from rso.emulation.emulator import Emulator, Output
from rso.optimise.targets import violations

MAX_CURVE_BASE_POINTS = 128  # base points of the indices along a curve, at most
N_LOCAL_CURVE_POINTS = 21  # points of a local curve


@dataclass(frozen=True, eq=False)
class Along:
    """Sensitivities of one channel at one travel of a curve."""

    output: Output
    bars: tuple[sensitivity.LocalBar, ...]
    sobol: sensitivity.SobolIndices | None


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Local bars and curves (x, y), Morris and Sobol by output id at or over the ranges, and along the curves.

    `ranges` are those that all of it is about, `at` (d,) is their middle in the unit cube of the study's box. `refused`
    says why there are no indices.
    """

    ranges: Box
    searched: bool

    at: np.ndarray
    local: Mapping[str, tuple[sensitivity.LocalBar, ...]]
    curves: Mapping[str, tuple[tuple[np.ndarray, np.ndarray], ...]]
    morris: Mapping[str, sensitivity.Morris]
    sobol: Mapping[str, sensitivity.SobolIndices]
    along: tuple[Along, ...]
    restricted: bool
    refused: str | None


def analyse(plan: Plan, fitted: FittedSurrogates, stated: Plan) -> Sensitivity:
    """Sensitivities of the targets of the main search and of the extra outputs; along the curves those of the targets.

    They are over the ranges of the plan as `stated`, or, where `sensitivity.ranges` asks for it, over those of `plan`,
    which the main search may have widened; a circumscribed design is wider than either. Only the part of the ranges
    counts that respects the conditions between parameters and the limits on outputs.
    """
    table, emulator = plan.study.sensitivity, fitted.emulator
    searched = table.ranges == "searched"
    low, high = ends_in((plan if searched else stated).searches[0].axes, plan.box)
    box, d = plan.box, plan.box.d
    centre = low + 0.5 * (high - low)
    wanted = list(dict.fromkeys([*plan.searches[0].outputs, *(o for o in emulator.outputs if o in plan.extras)]))
    limits = feasible(plan, emulator)
    inside = None if limits is None else lambda U: limits(low + U * (high - low))
    local, curves, morris, sobol, along, refused = {}, {}, {}, {}, [], None

    def indices(output: Output, n: int) -> sensitivity.SobolIndices | None:
        nonlocal refused
        try:
            return (
                sensitivity.saltelli_indices(predict(output), d, plan.seed, n, inside, band(output))
                if table.sobol
                else None
            )
        except ValueError as error:
            refused = str(error)
            return None

    def predict(output: Output) -> Callable[[np.ndarray], np.ndarray]:
        return lambda U: emulator.mean(output, low + U * (high - low))

    def band(output: Output) -> Callable[[np.ndarray], np.ndarray]:
        return lambda U: emulator.predict(output, low + U * (high - low))[1]

    ranges = _ranges(box, low, high)
    for output in wanted:
        if table.local:
            local[output.id] = sensitivity.local(predict(output), np.full(d, 0.5), box.names, ranges)
            curves[output.id] = tuple(_curve(predict(output), j, d, ranges) for j in range(d))
        if table.morris:
            try:
                morris[output.id] = sensitivity.morris(predict(output), d, plan.seed, constraint=inside)
            except ValueError as error:
                refused = str(error)
        found = indices(output, table.samples)
        if found is not None:
            sobol[output.id] = found
    channels = {(o.experiment, o.channel) for o in plan.searches[0].outputs}
    for output in emulator.outputs if table.local or table.sobol else ():
        if (output.experiment, output.channel) in channels:
            bars = sensitivity.local(predict(output), np.full(d, 0.5), box.names, ranges) if table.local else ()
            known = sobol.get(output.id)
            along.append(Along(output, bars, known or indices(output, min(table.samples, MAX_CURVE_BASE_POINTS))))
    along.sort(key=lambda a: (a.output.experiment, a.output.channel, *a.output.order))
    return Sensitivity(
        ranges, searched, centre, local, curves, morris, sobol, tuple(along), inside is not None, refused
    )


def feasible(plan: Plan, emulator: Emulator) -> Callable[[np.ndarray], np.ndarray] | None:
    """Mask of points of the unit cube that respect every condition and limit; None where there are none."""
    limited_outputs = [limited(c) for c in plan.constraints]
    if not (limited_outputs or plan.conditions):
        return None

    def inside(X: np.ndarray) -> np.ndarray:
        good = plan.feasible(X)
        if limited_outputs and good.any():
            over = violations(plan.constraints, emulator.means(limited_outputs, X[good]))
            good[good] = np.all(over <= 0, axis=1)
        return good

    return inside


def _ranges(box: Box, low: np.ndarray, high: np.ndarray) -> Box:
    """The box of the ranges, whatever the design needed."""
    ends = box.from_unit(np.stack([low, high]))
    return Box(box.names, box.units, tuple(map(float, ends[0])), tuple(map(float, ends[1])), box.log)


def _curve(predict: Callable[[np.ndarray], np.ndarray], j: int, d: int, ranges: Box) -> tuple[np.ndarray, np.ndarray]:
    x, y = sensitivity.response_curve(predict, np.full(d, 0.5), j, n=N_LOCAL_CURVE_POINTS)
    U = np.full((N_LOCAL_CURVE_POINTS, d), 0.5)
    U[:, j] = x
    return ranges.from_unit(U)[:, j], y


def _span(name: str, low: float, high: float, unit: str) -> str:
    """A range in the unit that people use."""
    label, factor = people(unit, max(abs(low), abs(high)))
    return f"{symbol(name)} from {low * factor:.4g} to {high * factor:.4g} {unit_text(label)}".strip()


def of_sensitivity(plan: Plan, found: Sensitivity) -> dict[str, Any]:
    """The block `sensitivity` of results.json."""
    names = plan.box.names
    logs = [n for n, log in zip(names, plan.box.log, strict=True) if log]
    excluded = next((s.excluded for s in found.sobol.values()), 0.0)
    dependent = found.restricted and excluded > 0
    ranges = found.ranges
    ends = zip(ranges.names, ranges.low, ranges.high, ranges.units, strict=True)
    spans = ", ".join(_span(n, a, b, u) for n, a, b, u in ends)
    whose = "that the main search came to use" if found.searched else "that the study states"
    story = (
        f"Over the ranges {whose}, {spans}. "
        "Local: one parameter goes over its range, the others stay in the middle of theirs; elasticity is "
        "d ln y / d ln θ there. Sobol: shares of the variance when all parameters vary "
        f"{'' if dependent else 'independently and '}uniformly over "
        f"{'what the constraints leave of ' if dependent else ''}"
        f"their ranges{' (in the logarithm of ' + ', '.join(map(symbol, logs)) + ')' if logs else ''}."
    )
    if dependent:
        story += (
            " Within it the parameters are correlated: a share includes what its parameter shares with others, and "
        )
        story += "first shares may add up to more than 1."
    if found.morris:
        story += " Morris: mean size (mu*) and spread (sigma) of the change per full range, along random trajectories."
    if found.restricted:
        story += f" The constraints leave out {100 * excluded:.0f} % of the ranges; indices are over the rest."
    if found.refused:
        story += f" No indices for some outputs: {found.refused}."
    return {
        "sensitivity": {
            "at": plan.values(found.at),
            "ranges": {n: [a, b] for n, a, b in zip(ranges.names, ranges.low, ranges.high, strict=True)},
            "ranges_are": "searched" if found.searched else "stated",
            "local": [_bar(o, b) for o, bars in found.local.items() for b in bars],
            "curves": [
                {"output": o, "parameter": n, "x": x, "y": y}
                for o, pairs in found.curves.items()
                for n, (x, y) in zip(names, pairs, strict=True)
            ],
            "morris": [
                {"output": o, "parameter": n, "mu": m.mu[k], "mu_star": m.mu_star[k], "sigma": m.sigma[k]}
                for o, m in found.morris.items()
                for k, n in enumerate(names)
            ],
            "sobol": [_share(o, s, k, n) for o, s in found.sobol.items() for k, n in enumerate(names)],
            "along": [
                {"experiment": a.output.experiment, "channel": a.output.channel, "depth_mm": a.output.depth_mm}
                | ({"since_s": a.output.since_s} if a.output.since_s else {})
                | ({} if not a.bars else {k: v for k, v in _bar(a.output.id, a.bars[j]).items() if k != "parameter"})
                | ({} if a.sobol is None else _share(a.output.id, a.sobol, j, n))
                | {"parameter": n}
                for a in found.along
                for j, n in enumerate(names)
            ],
            "excluded": excluded,
            "story": story,
        }
    }


def _bar(output: str, b: sensitivity.LocalBar) -> dict[str, object]:
    return {
        "output": output,
        "parameter": b.name,
        "low": b.at_low,
        "high": b.at_high,
        "change": b.change,
        "elasticity": b.elasticity,
    }


def _share(output: str, s: sensitivity.SobolIndices, k: int, name: str) -> dict[str, object]:
    return {
        "output": output,
        "parameter": name,
        "first": s.first[k],
        "first_interval": s.first_interval[k],
        "total": s.total[k],
        "total_interval": s.total_interval[k],
    }
