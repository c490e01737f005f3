"""Finished runs of a study as points and curves: what every interval has to agree with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rso.calibration.plan import Plan
from rso.calibration.stored_runs import stored_points, stored_responses
from rso.contract import Response
from rso.emulation.emulator import Emulator, Sample
from rso.evaluation.store import RunStore
from rso.inference import CurvePlace, Misfit, Runs, outputs_of, readings_of, resample

N_SCALED_MODULI = 257  # values of the modulus that similarity makes of one run


def runs_with_curves(
    plan: Plan, emulator: Emulator, store: RunStore, misfit: Misfit, places: Sequence[CurvePlace]
) -> tuple[Runs, list[Sample]]:
    """All runs inside the ranges of the misfit whose curves are known: those that the emulator has learnt, scaled by
    similarity to where they agree best, and those of the store; and the samples of the latter that it has not."""
    box = misfit.model.box
    rows = [(s.values, _of_sample(emulator, s, places)) for s in emulator.samples]
    rows = [row for values, curve in rows for row in _scaled(emulator, misfit, places, values, curve)]
    known = {_point(plan, s.values) for s in emulator.samples}
    stored, new = [], []
    for point in stored_points(plan, store):
        values, responses = point.values, None
        if _point(plan, values) not in known:
            responses = stored_responses(store, point)
        if responses is not None:
            try:
                curve = np.concatenate([resample(responses[plan.case_of[p.experiment]], p, "") for p in places])
                new.append(_sample(emulator, plan, values, responses))
            except (ValueError, KeyError):  # it does not reach as deep, or knows nothing of that channel
                continue
            stored.append((values, curve))
    rows += stored
    X = box.to_unit(np.array([[v[n] for n in box.names] for v, _ in rows]).reshape(-1, box.d))
    curves = np.array([c for _, c in rows]).reshape(-1, misfit.n)
    inside = np.all((X >= -1e-9) & (X <= 1 + 1e-9), axis=1)
    X = np.clip(X, 0.0, 1.0)
    inside[inside] &= misfit.beyond(X[inside]).sum(axis=1) == 0.0
    return Runs(X[inside], curves[inside]), new


def _point(plan: Plan, values: Mapping[str, float]) -> tuple[float, ...]:
    return tuple(float(f"{values[n]:.12g}") for n in plan.box.names)


def _of_sample(emulator: Emulator, sample: Sample, places: Sequence[CurvePlace]) -> np.ndarray:
    """The curves (n,) of a sample at the measured depths."""
    parts = []
    for p in places:
        outputs = outputs_of(emulator.outputs, p)
        parts.append(readings_of(outputs, np.array([sample.outputs[o.id] for o in outputs]), p))
    return np.concatenate(parts)


def _scaled(
    emulator: Emulator, misfit: Misfit, places: Sequence[CurvePlace], values: Mapping[str, float], curve: np.ndarray
) -> list[tuple[Mapping[str, float], np.ndarray]]:
    """The run itself, and by similarity the one of its kind inside the ranges that agrees best with the data."""
    group, box = emulator.group, misfit.model.box
    if group.reference is None:
        return [(values, curve)]
    here = values[group.reference]
    low, high = (box.from_unit(np.full((1, box.d), e))[0][box.names.index(group.reference)] for e in (0.0, 1.0))
    s = np.geomspace(max(low, 1e-12 * high), high, N_SCALED_MODULI) / here
    theta = np.stack([values[n] * s ** (1 if n == group.reference else group.exponents.get(n, 0)) for n in box.names])
    keep = np.all((theta.T >= box.low) & (theta.T <= box.high), axis=1)
    if not keep.any():
        return [(values, curve)]
    each = np.concatenate([np.full(len(p.depth), k) for k, p in enumerate(places)])
    powers = np.stack([group.expand(p.channel, np.ones(len(s)), s) for p in places])
    curves = powers[each].T * curve
    y = np.concatenate([d.value for d in misfit.data])
    chi2 = np.where(keep, np.sum(misfit.white(curves - y) ** 2, axis=1), np.inf)
    j = int(np.argmin(chi2))
    return [(values, curve), (dict(zip(box.names, map(float, theta[:, j]), strict=True)), curves[j])]


def _sample(emulator: Emulator, plan: Plan, values: Mapping[str, float], responses: Sequence[Response]) -> Sample:
    outputs, errors, gradients = {}, {}, {}
    for o in emulator.outputs:
        response = responses[plan.case_of[o.experiment]]
        outputs[o.id], errors[o.id], gradients[o.id] = o.read(response), o.error(response), o.gradient(response)
    return Sample(dict(values), outputs, errors, gradients)
