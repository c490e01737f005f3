"""Errors of a whole test that nobody stated and one record cannot show: what they would move the parameters by."""

from __future__ import annotations

import numpy as np

from rso.identify import Data, Determination
from rso.identify.intervals import Interval
from rso.study.plan import Plan
from rso.units import spaced

OFF = {"contact": 0.01, "gain": 0.01}  # of the deepest travel, of the force: what is usual
NONE = 0.5  # of half an interval: a smaller shift is not worth a word


def unstated(plan: Plan, d: Determination) -> list[str]:
    """Warnings of experiments of which neither contact nor gain is stated, or shown by repeats or by the record.

    An error s of a whole curve moves the most likely values by δx = (Jᵀ C⁻¹ J)⁻¹ Jᵀ C⁻¹ s, here with s = y' δu for a
    contact at δu and s = γ y for a gain.  0 is a statement.
    """
    if d.misfit.weighting != "noise" or not np.all(np.isfinite(d.fit.fisher)):
        return []
    said, start = [], 0
    J, box = d.misfit.white(d.misfit.model.jacobian(d.fit.x).T).T, d.misfit.model.box
    every = plan.study.experiments
    called = {e.name: e.name for e in every} | {f"{e.name} {c}": e.name for e in every for c in e.compared}
    whole = d.misfit.model.predict(d.fit.x[None])[0]
    for data in d.misfit.data:
        rows = slice(start, start + len(data.value))
        start = rows.stop
        name = called[data.name]
        if data.unit != "N" or len(data.value) < 2 or not _silent(plan, name, data):
            continue
        moved = []
        for what, s, size in _shapes(data, whole[rows]):
            full = np.zeros(d.misfit.n)
            full[rows] = s
            shift = np.linalg.lstsq(J, d.misfit.white(full), rcond=1e-9)[0]
            told = [k for k in range(box.d) if d.known[k].verdict.word != "not"]
            worth = [k for k in told if abs(shift[k]) > NONE * _half(d.known[k].profile_interval)]
            if worth:
                each = ", ".join(f"{box.names[k]} by {_much(d, k, shift[k])}" for k in worth)
                moved.append(f"{what} {size} off moves {each}")
        if moved:
            said.append(
                f"identification: neither noise.contact nor noise.gain of {name} is stated, and one record shows "
                f"neither: {'; '.join(moved)}, which no interval here holds (0 states that there is none)"
            )
    return said


def _silent(plan: Plan, name: str, data: Data) -> bool:
    """Whether nothing is known of errors of the whole test."""
    if plan.study.noise_of(name).contact > 0 or len(plan.study.measurement(name).repeats) > 1 or data.shared:
        return False
    stated = plan.study.experiment(name).noise.model_fields_set
    return not {"contact", "gain", "calibration"} & stated


def _shapes(data: Data, y: np.ndarray) -> list[tuple[str, np.ndarray, str]]:
    """What is off, the error (n,) it makes of the curve y (n,), and its size in words."""
    order = np.argsort(data.depth, kind="stable")
    slope = np.empty(len(y))
    slope[order] = np.gradient(y[order], np.maximum.accumulate(data.depth[order]) + 1e-12 * np.arange(len(y)))
    δu = float(f"{OFF['contact'] * data.depth.max():.1g}")
    return [("a contact", δu * slope, f"{δu:g} mm"), ("a gain", OFF["gain"] * y, f"{100 * OFF['gain']:g} %")]


def _half(interval: Interval) -> float:
    return 0.5 * max(interval.high - interval.low, 1e-12)


def _much(d: Determination, k: int, shift: float) -> str:
    box = d.misfit.model.box
    if box.log[k]:
        return f"{100 * np.expm1(shift * np.log(box.high[k] / box.low[k])):+.2g} %"
    return f"{shift * (box.high[k] - box.low[k]):+.2g}{spaced(box.units[k])}".rstrip()
