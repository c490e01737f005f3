"""The numerical error that a result states for each of its channels: mesh, contact and steps.

A calibration, not a bound: each channel's error is the share of a few lengths and values that the run knows, LEVEL
times CALIBRATED · columns, such that 90 % of random experiments stay below (benchmarks/fe_errors.py prints both the
coefficients and what they cover in experiments that were not used).
"""

from __future__ import annotations

import numpy as np

from fem_backend.experiment import Knobs, Settings
from fem_backend.indentation import Result

LEVEL = {"coarse": 1.0, "standard": 0.6, "fine": 0.29, "reference": 0.18}  # error of the force over that of coarse
FORCES = ("Fx", "Fy", "Fz")
CALIBRATED = {  # of the columns of `columns`
    "force": (0.0015, 0.018, 0.0055),
    "uz_max": (0.001, 0.0, 0.0),
    "bulge": (0.15, 3e-4, 0.0),
    "contact_area": (0.065, 0.02, 0.005),
    "contact_radius": (0.026, 0.024, 0.0),
    "peak_pressure": (0.005, 0.33, 0.0),
    "uz": (0.001, 0.006, 0.0015),
}
AUGMENTED = 0.1  # of what the last augmentation changed in the force
OFF_TOP = 4.0  # times the squared distance from the top in semi-axes: elements are stretched on the way
PENETRATION = 1e-4  # of R, at K/μ = 1
LATERAL = 0.04  # of the whole force, counted to Fx and Fy
STEPS = 0.025  # of the force, at friction 1 in the first step
SLIP = 0.7  # of the contact, in the first step


def stated(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """Estimated error of each channel (k,) in its unit; `time` and `travel` are exact, what is zero by symmetry too.

    error = level · (1 + 4ρ²) · Σ c_j column_j, and for forces 0.1 |change by the last augmentation| + steps; ρ is the
    distance from the top in semi-axes.  Calibrated for the shipped meshes (a ball of 3 mm or in proportion), K/μ from
    1.5 to 200, travel from 0.1 to 1.3 R, ρ up to 0.5; beyond it is an extrapolation.
    """
    factor, other = mesh_factor(settings, knobs), run_terms(settings, knobs, result)
    out = {name: np.zeros_like(result.travel) for name in result.channels}
    for name, parts in columns(settings, knobs, result).items():
        out[name] = factor * parts @ np.array(CALIBRATED[kind(name)])
    return out | {name: out[name] + left for name, left in other.items()}


def mesh_factor(settings: Settings, knobs: Knobs) -> float:
    """Error of the mesh at this place over that of the level coarse at the top.

    Meshes without a level: by the square of their element size.
    """
    x, y = settings.point[0] + knobs.offset_x, settings.point[1] + knobs.offset_y
    off = (x / settings.body.a) ** 2 + (y / settings.body.b) ** 2
    return (LEVEL.get(settings.level) or (4.0 * settings.h0 / settings.R) ** 2) * (1.0 + OFF_TOP * off)


def run_terms(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """What contact and steps leave on any mesh, (k,) in the channel's unit, to forces, `uz_max` and `slipping`.

    A step is rough for friction by its share of the travel; `uz_max` has what the ball penetrates.
    """
    size = np.linalg.norm([result.channels[n] for n in FORCES], axis=0)
    step = settings.control.path / np.maximum(result.travel, settings.control.path)
    left = AUGMENTED * result.contact_error + STEPS * knobs.friction * step * size
    deep = PENETRATION * settings.R * (1.0 + stiffness(knobs))
    return {n: left * (result.channels[n] != 0.0) for n in FORCES} | {
        "uz_max": np.full_like(result.travel, deep),
        "slipping": SLIP * step * (knobs.friction > 0.0),
    }


def stiffness(knobs: Knobs) -> float:
    """log₁₀ K/μ, at least 0."""
    return float(np.log10(max(2.0 / (knobs.D1 * knobs.mu), 1.0)))


def columns(settings: Settings, knobs: Knobs, result: Result) -> dict[str, np.ndarray]:
    """What the error of each channel grows with, (k, 3) in its unit, before level and place.

    Forces, area, radius, pressure: value · (1, (h₀/a)², log₁₀ K/μ), a the contact radius and h₀ the element size;
    Fx and Fy take 4 % of the whole force on top of their own value.  `uz_max`: h₀ (h₀/a)².
    `bulge`: (value, travel), since it vanishes in a compressible body.  Surface points:
    (f, f log₁₀ K/μ, h₀) with f = |u|(1 − |u|/travel), since a point that touches the ball moves with it.
    """
    at = result.channels
    travel = np.maximum(np.abs(result.travel), 1e-12)
    size = np.linalg.norm([at[n] for n in FORCES], axis=0)
    edge = (settings.h0 / np.maximum(at["contact_radius"], 0.5 * settings.h0)) ** 2
    stiff = np.full_like(travel, stiffness(knobs))
    one, none = np.ones_like(travel), np.zeros_like(travel)
    shape = np.stack([one, edge, stiff], axis=-1)
    out = {"Fz": np.abs(at["Fz"])[:, None] * shape}
    for name in ("Fx", "Fy"):
        out[name] = ((np.abs(at[name]) + LATERAL * size) * (at[name] != 0.0))[:, None] * shape
    least = 0.5 * settings.h0 * (size > 0.0)  # a patch fitted over too few points may vanish
    radius = np.maximum(at["contact_radius"], least)
    hertz = 1.5 * size / np.maximum(np.pi * radius**2, 1e-300)
    floors = {"contact_area": np.pi * least**2, "contact_radius": least, "peak_pressure": hertz * (radius == least)}
    for name, floor in floors.items():
        out[name] = np.maximum(at[name], floor)[:, None] * shape
    out["uz_max"] = np.stack([settings.h0 * edge, none, none], axis=-1)
    out["bulge"] = np.stack([np.abs(at["bulge"]), np.abs(result.travel), none], axis=-1)
    for name in at:
        if kind(name) == "uz":
            u = np.abs(at[name])
            free = u * np.clip(1.0 - u / travel, 0.0, 1.0)
            out[name] = np.stack([free, free * stiff, settings.h0 * one], axis=-1)
    return out


def kind(name: str) -> str:
    """Row of CALIBRATED of a channel."""
    return "force" if name in FORCES else "uz" if name.startswith("uz(") else name
