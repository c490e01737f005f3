"""Closed forms of the literature beside the simulations of the best candidate: when is the simple formula enough?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rso.calibration.plan import Plan
from rso.contract import FormulaCurve, Formulas, capability
from rso.core.curves import loading
from rso.study.cases import MISREAD_SETTING_ERRORS, case_for

N_COMPARED_DEPTHS = 12  # at which they are compared, evenly spaced to the deepest reading
LATERAL_FORCES = ("Fx", "Fy")


def of_formulas(plan: Plan, found: Mapping[str, Any]) -> dict[str, Any]:
    """formulas: for each fitted loading Fz the closed forms at the values of the best candidate, or of the closest."""
    known, candidate = capability(plan.backend, Formulas), _candidate(found)
    if known is None or candidate is None:
        return {"formulas": []}
    rows = []
    for name, curve in (candidate.get("curves") or {}).items():
        if name not in plan.case_of or plan.curves[name].channel in LATERAL_FORCES or not len(curve["depth"]):
            continue
        measured = plan.curves[name]
        if measured.back:  # formulas are those of the way there
            continue
        deepest = min(float(measured.depth.max()), float(np.max(curve["depth"])))
        depth = np.linspace(deepest / N_COMPARED_DEPTHS, deepest, N_COMPARED_DEPTHS)
        simulated = loading(np.asarray(curve["depth"], float), np.asarray(curve["value"], float))
        try:
            forms = known.formulas(candidate["values"], case_for(plan.study, name, tuple(map(float, depth))))
        except MISREAD_SETTING_ERRORS:  # there is none of what the study describes
            continue
        keep = ~measured.held & (measured.depth > 0.0) & (measured.depth <= deepest * (1.0 + 1e-9))
        at, force = np.minimum(measured.depth[keep], deepest), measured.value[keep]
        fe = np.asarray(simulated(depth), float)
        rows.append(
            {
                "experiment": name,
                "depth": depth,
                "simulated": fe,
                "error": _error(curve, depth),
                "formulas": [_row(f, depth, fe, at, np.asarray(simulated(at), float), force) for f in forms],
            }
        )
    return {"formulas": rows}


def _error(curve: Mapping[str, Any], depth: np.ndarray) -> np.ndarray:
    """Estimated numerical error (N) of a simulated curve at depths (n,); empty where it has none."""
    error = np.asarray(curve.get("error", ()), float)
    return np.interp(depth, curve["depth"], error) if len(error) == len(curve["depth"]) else np.empty(0)


def _row(
    f: FormulaCurve, depth: np.ndarray, fe: np.ndarray, at: np.ndarray, simulated: np.ndarray, measured: np.ndarray
) -> dict[str, Any]:
    """A closed form over the simulations, and the modulus that it would have told from the readings over theirs."""
    ratio = np.asarray(f.force, float) / fe
    good = np.isfinite(ratio)
    modulus: float | None = None
    if good.any() and len(at):
        unit = np.interp(at, depth[good], ratio[good]) * simulated  # its force at the depths of the readings
        modulus = float(unit @ measured / (unit @ unit))
    return {
        "name": f.name,
        "source": f.source,
        "force": np.asarray(f.force, float),
        "invalid": list(f.invalid),
        "modulus": modulus,
    }


def stated_formulas(plan: Plan, name: str) -> list[str]:
    """Which closed forms there are for an experiment, and to what depth they hold, in the middle of the ranges."""
    known = capability(plan.backend, Formulas)
    if known is None or name not in plan.case_of:
        return []
    deepest = float(plan.curves[name].depth.max())
    depth = np.linspace(deepest / N_COMPARED_DEPTHS, deepest, N_COMPARED_DEPTHS)
    try:
        forms = known.formulas(
            plan.values(np.full(plan.box.d, 0.5)), case_for(plan.study, name, tuple(map(float, depth)))
        )
    except MISREAD_SETTING_ERRORS:
        return []
    each = [f"{f.name}, {_range(depth, f.invalid)}" for f in forms]
    why = f": {forms[0].invalid[-1]}" if forms and all(forms[0].invalid) else ""
    return [f"closed forms: {'; '.join([each[0] + why, *each[1:]])}"] if each else []


def _range(depth: np.ndarray, invalid: Sequence[str]) -> str:
    """Where a closed form holds, in words."""
    holds = [not why for why in invalid]
    if not any(holds):
        return "holds nowhere here"
    if all(holds):
        return "holds to the deepest reading"
    first, last = holds.index(True), len(holds) - 1 - holds[::-1].index(True)
    start = f"from {depth[first]:.2g} " if first else ""
    return f"holds {start}to {depth[last]:.2g} mm"


def _candidate(found: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The best candidate of some results, or the closest."""
    near = found.get("best") or found.get("closest")
    if not near:
        return None
    every = [c for s in found["searches"] if s["name"] == near["search"] for c in s["candidates"]]
    return next((c for c in every if c["name"] == near["candidate"]), None)
