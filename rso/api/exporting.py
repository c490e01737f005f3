"""What has been found as files for others: tables, draws of the posterior, and what the backend writes itself."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import rso
from rso.api.run_result import RunResult
from rso.calibration.plan import Plan
from rso.calibration.result_files import POSTERIOR_FILE
from rso.contract import Case, Exports, capability
from rso.core import disk
from rso.core.units import spaced
from rso.study.errors import choices_text

TABLE_FORMATS = {
    "csv": "tables of parameters, candidates, runs, curves and posterior draws as CSV",
    "parquet": "the same as Parquet (needs pyarrow)",
    "arviz": "posterior draws and readings for arviz.from_json",
    "figures": "every figure of the report as SVG and, where typst is installed, as PDF",
    "bibtex": "how to cite: the program and the methods that the run used",
}


def formats(plan: Plan) -> dict[str, str]:
    """Every format and what it is: those of tables, and those of the study's backend."""
    own = capability(plan.backend, Exports)
    return {**({} if own is None else own.exports()), **TABLE_FORMATS}


def check_formats(plan: Plan, names: Sequence[str]) -> None:
    """ValueError for the first name that is no format."""
    known = sorted(formats(plan))
    if wrong := [n for n in names if n not in known]:
        raise ValueError(f"format {wrong[0]!r}: {choices_text(wrong[0], known)}")


def export(
    plan: Plan,
    result: RunResult,
    folder: Path,
    names: Sequence[str],
    *,
    candidate: int | None = None,
    experiment: str | None = None,
) -> list[Path]:
    """Write formats to a folder; their files.

    What the backend writes is for the most likely values of all parameters, or those of a `candidate` (1 is the first
    of the main search), and for an `experiment`, by default the first that is fitted.  Raises ValueError for unknown
    names, for values that the results do not hold, and for what a format cannot say.
    """
    check_formats(plan, names)
    files: dict[str, bytes | str] = {}
    for name in names:
        if name == "csv":
            files |= {f"{k}.csv": t.to_csv(index=False, lineterminator="\n") for k, t in tables(result).items()}
        elif name == "parquet":
            _write_parquet(folder, tables(result))
        elif name == "figures":
            files |= _figures(result)
        elif name == "bibtex":
            files["references.bib"] = bibtex(result)
        elif name == "arviz":
            files["inference_data.json"] = json.dumps(inference_data(result), allow_nan=False)
        else:
            files |= _of_backend(plan, result, name, candidate, experiment)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "figures").mkdir(exist_ok=True) if "figures" in names else None
    written = [disk.replace(folder / name, content) for name, content in files.items()]
    return [*written, *sorted(folder.glob("*.parquet"))] if "parquet" in names else written


def tables(result: RunResult) -> dict[str, pd.DataFrame]:
    """Tables of the results by name, with names of rows as a column; `posterior` where draws were kept."""
    found = {"parameters": result.parameters.reset_index(), "derived": result.derived.reset_index()}
    found |= {"candidates": result.candidates, "runs": result.runs, "curves": result.curves}
    path = result.folder / POSTERIOR_FILE
    return {**found, "posterior": pd.read_csv(path)} if path.is_file() else found


def _figures(result: RunResult) -> dict[str, bytes | str]:
    from rso.report.picture_files import every

    return {f"figures/{name}": content for name, content in every(result.data).items()}


def bibtex(result: RunResult) -> str:
    """BibTeX of the program and of those methods that the results rest on."""
    entries = (Path(__file__).parent / "references.bib").read_text("utf-8").split("\n\n")
    used = {"rso", "venzon1988" if result.data.get("identification") else ""}
    used |= {"conn2000"} if result.data.get("descent") else {"deb2002", "rasmussen2006"}
    used |= {"saltelli2010"} if result.data.get("sensitivity") else set()
    used |= {"mackay2003", "kennedy2001"} if result.data.get("diagnosis") else set()
    chosen = [e.strip() for e in entries if e.partition("{")[2].partition(",")[0] in used]
    return "\n\n".join(chosen).replace("@VERSION", rso.__version__) + "\n"


def inference_data(result: RunResult) -> dict[str, Any]:
    """Posterior draws (chain, draw) and readings in the layout of ArviZ's `InferenceData.to_json`.

    The draws are one chain, as they come mixed; ValueError where a run kept none.
    """
    path = result.folder / POSTERIOR_FILE
    if not path.is_file():
        raise ValueError(f"{path}: there are no draws of the posterior; run the study (again), if its data allow any")
    draws = pd.read_csv(path)
    curves = result.curves
    read = curves[curves["what"] == "measured"]
    observed, depths = {}, {}
    for (experiment, channel), rows in read.groupby(["experiment", "channel"], sort=False):
        name = f"{experiment} {channel}"
        rows = rows[np.isfinite(rows["value"])]
        observed[name], depths[f"{name} depth_mm"] = rows["value"].tolist(), rows["depth"].tolist()
    units = {p["name"]: p["unit"] for p in result.data["parameters"]}
    return {
        "posterior": {name: [draws[name].tolist()] for name in draws.columns},
        "observed_data": observed,
        "coords": depths,
        "dims": {name: [f"{name} depth_mm"] for name in observed},
        "posterior_attrs": {"units": json.dumps(units), "inference_library": "rso"},
        "observed_data_attrs": {"inference_library": "rso"},
    }


def _write_parquet(folder: Path, found: Mapping[str, pd.DataFrame]) -> None:
    if importlib.util.find_spec("pyarrow") is None:
        raise ValueError("parquet needs pyarrow, which is not installed (pip install pyarrow); csv holds the same")
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in found.items():
        table.to_parquet(folder / f"{name}.parquet", index=False)


def _of_backend(
    plan: Plan, result: RunResult, name: str, candidate: int | None, experiment: str | None
) -> dict[str, bytes | str]:
    """What the backend writes, with the values, their intervals and where they come from as remarks."""
    own = capability(plan.backend, Exports)
    assert own is not None
    values, whose = exported_values(result, candidate)
    case = _case(plan, experiment)
    remarks = [f"{result.data['study']['title']}: {case.name}", f"values: {whose}", *interval_lines(result, values)]
    return dict(own.exported(name, values, case, remarks))


def _case(plan: Plan, experiment: str | None) -> Case:
    """The simulation of an experiment; ValueError for an unknown one."""
    every = {name: plan.cases[k] for name, k in plan.case_of.items()} | dict(plan.validation)
    name = next(iter(plan.case_of)) if experiment is None else experiment
    if name not in every:
        raise ValueError(f"experiment {name!r}: {choices_text(name, every)}")
    return every[name]


def exported_values(result: RunResult, candidate: int | None = None) -> tuple[dict[str, float], str]:
    """Values by parameter and whose they are: the most likely ones, or those of a candidate (from 1)."""
    found = result.data.get("identification")
    if candidate is None and found:
        return dict(found["values"]), "the most likely ones by the whole curves"
    searches = result.data.get("searches") or ()
    main = searches[0]["candidates"] if searches else []
    k = 1 if candidate is None else candidate
    if not 1 <= k <= len(main):
        raise ValueError(f"candidate {k}: the results hold {len(main)} of the main search; run the study first")
    return dict(main[k - 1]["values"]), f"candidate {k} of the main search"


def interval_lines(result: RunResult, values: Mapping[str, float]) -> list[str]:
    """A line per parameter: value, unit, interval and what the data say of it."""
    table, level = result.parameters, result.level
    lines = []
    for name, value in values.items():
        unit = spaced(str(table.loc[name, "unit"])) if name in table.index else ""
        line = f"{name} = {value:.6g}{unit}"
        if name in table.index and table.loc[name, "verdict"] == "fixed":
            line += ", fixed by the study"
        elif name in table.index and level is not None and math.isfinite(float(table.loc[name, "low"])):
            low, high = float(table.loc[name, "low"]), float(table.loc[name, "high"])
            said = "determined" if table.loc[name, "verdict"] == "determined" else "not determined by the data"
            line += f", {100 * level:g} % interval {low:.6g} to {high:.6g}{unit}: {said}"
        lines.append(line)
    return lines
