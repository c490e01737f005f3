"""Runs that somebody made elsewhere, as a table: each becomes a stored simulation of a study."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import PchipInterpolator

from rso.calibration.plan import Plan
from rso.contract import Case, Response, run_key
from rso.core.units import conversion_factor
from rso.evaluation.store import Done
from rso.study.errors import choices_text

REACHED_TRAVEL_TOLERANCE = 1e-6  # of the deepest asked travel: a table that ends this near before it reaches it


def read_runs(path: Path) -> pd.DataFrame:
    """A CSV of runs, in which points are decimal; ValueError where it is none."""
    try:
        return pd.read_csv(path, sep=None, engine="python", comment="#", skipinitialspace=True)
    except (OSError, ValueError, pd.errors.ParserError) as error:
        raise ValueError(f"{path}: cannot be read as a table: {error}") from error


def runs_of_table(plan: Plan, table: pd.DataFrame) -> list[Done]:
    """A stored run for each case of the study and each set of values in a table.

    A row is a point of a curve: a column for each open parameter (``k`` in the unit of the backend, or ``k [N/m]``),
    ``travel`` (mm), the channels (``Fz`` in N, or ``Fz [mN]``), and ``experiment`` where the study has several.  Values
    at the asked travels are a monotone cubic between rows, and its difference from a straight line is their stated
    error.  Raises ValueError naming column, row or value for what is missing or does not reach the asked travels.
    """
    columns = _in_units(plan, table)
    open_ = list(plan.box.names)
    rows = []
    for name, k in plan.case_of.items():
        mine = columns
        if "experiment" in columns:
            mine = columns[columns["experiment"].astype(str) == name]
        elif len(plan.cases) > 1:
            raise ValueError(f"column experiment is missing: the study has {', '.join(plan.case_of)}")
        if mine.empty:
            continue
        for point, curve in mine.groupby(open_, sort=False):
            values = {**dict(zip(open_, map(float, point), strict=True)), **plan.resolved.fixed}
            rows.append(_stored(plan, values, plan.cases[k], curve))
    if not rows:
        raise ValueError(f"no row belongs to an experiment of the study ({', '.join(plan.case_of)})")
    return rows


def _in_units(plan: Plan, table: pd.DataFrame) -> pd.DataFrame:
    """The columns that are read by their names, in units of the backend; ValueError naming what is missing."""
    known = {p.name: p.unit for p in plan.backend.parameters} | dict(plan.backend.channels)
    found: dict[str, pd.Series] = {}
    for header in table.columns:
        name = str(header).split("[")[0].split("(")[0].strip()
        if name == "experiment":
            found[name] = table[header]
        elif name in known:
            scale = _factor(str(header), known[name])
            numbers = pd.to_numeric(table[header], errors="coerce")
            if numbers.isna().any():
                row = int(numbers.isna().to_numpy().argmax()) + 1
                raise ValueError(f"column {header!r}, row {row}: {table[header].iloc[row - 1]!r} is no number")
            found[name] = scale * numbers
    channels = {o.channel for o in (*plan.outputs, *plan.extras)}
    for name in (*plan.box.names, "travel", *sorted(channels)):
        if name not in found:
            raise ValueError(f"column {name!r} is missing; {choices_text(name, map(str, table.columns))}")
    return pd.DataFrame(found)


def _factor(header: str, unit: str) -> float:
    """The factor from the unit in a header, in square brackets, to that of the backend."""
    if "[" not in header:
        return 1.0
    written = header.partition("[")[2].partition("]")[0].strip()
    try:
        return float(conversion_factor(written, unit or "1"))
    except ValueError as error:
        raise ValueError(f"column {header!r}: {error}") from error


def _stored(plan: Plan, values: Mapping[str, float], case: Case, curve: pd.DataFrame) -> Done:
    """The simulation that stands for one curve."""
    given, canonical = plan.backend.canonical(values, case)
    if plan.backend.recipes(given, canonical):
        raise ValueError(f"{plan.backend.name} makes meshes of its own: runs of others cannot stand for its runs")
    time, travel = canonical.programme.passages()
    shown = ", ".join(f"{k} = {v:g}" for k, v in values.items())
    s = curve["travel"].to_numpy(float)
    order = np.argsort(s, kind="stable")
    s = s[order]
    if np.any(np.diff(s) <= 0.0):
        raise ValueError(f"{case.name}, {shown}: a travel stands there twice")
    if (
        len(s) < 2
        or s[0] > travel.min() + REACHED_TRAVEL_TOLERANCE
        or s[-1] < travel.max() * (1.0 - REACHED_TRAVEL_TOLERANCE)
    ):
        reach = f"from {s[0]:g} to {s[-1]:g} mm" if len(s) else "none"
        raise ValueError(
            f"{case.name}, {shown}: travels {reach}, but {travel.min():g} to {travel.max():g} mm are asked for"
        )
    at = np.clip(travel, s[0], s[-1])
    channels, error = {"time": time, "travel": travel}, {}
    for name in curve.columns:
        if name in plan.backend.channels and name not in ("time", "travel"):
            y = curve[name].to_numpy(float)[order]
            line = np.interp(at, s, y)
            channels[name] = PchipInterpolator(s, y)(at) if len(s) > 2 else line
            error[name] = np.abs(channels[name] - line)
    response = Response(channels, plan.backend.channels, error, info={"source": "imported"})
    return Done(run_key(plan.backend, given, canonical), given, canonical, response, 0.0, 0.0)
