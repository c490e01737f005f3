"""The shortest ways: one simulation, and one fit."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rso.api.run_result import RunResult
from rso.api.workspace import load
from rso.contract import Backend, Case, NewStudies, Programme, Response, capability, digest
from rso.core import disk
from rso.core.default_backend import DEFAULT_BACKEND
from rso.core.inline_toml import inline
from rso.core.units import value_in_unit
from rso.data import Noise, combine, read_measurement
from rso.evaluation.adapters import load_backend
from rso.study.cases import DEFAULT_SPEED_MM_S
from rso.study.errors import choices_text
from rso.study.settings_files import paths_seen_from

Table = Mapping[str, Any]
Quantity = float | str


def indent(
    depths: Sequence[float] | np.ndarray,
    *,
    specimen: Table,
    indenter: Table,
    support: Table | None = None,
    material: Table | None = None,
    speed: float = DEFAULT_SPEED_MM_S,
    settings: Table | None = None,
    **values: Quantity,
) -> Response:
    """Press an indenter into a specimen once, by finite elements: Fz (n,) N and other channels at `depths` (n,) mm.

    The tables are those of [backend.settings] in a study; `settings` are further ones (mesh, point, …), `speed` is in
    mm/s.  `values` are the backend's parameters, numbers in its units or texts with their own ("12 kPa"); effects that
    are not named are absent.  The response holds channels, units and errors by name; docs/python.md has an example.

    Raises ValueError for bad input (naming key, value and choices), :class:`rso.SimulationFailed` where there is no
    answer.
    """
    backend = load_backend(DEFAULT_BACKEND)
    tables = _tables(specimen, indenter, support, material, settings)
    travel = _in_mm(depths)
    case = Case("indent", Programme.ramp(tuple(map(float, travel)), speed), tables)
    given = _numbers(backend, values, tables)
    backend.check(case)
    return backend(given, case)


def fit(
    data: str | os.PathLike[str] | pd.DataFrame | Mapping[str, Any],
    *,
    specimen: Table,
    indenter: Table,
    support: Table | None = None,
    material: Table | None = None,
    settings: Table | None = None,
    parameters: Mapping[str, Any] | None = None,
    noise: Table | None = None,
    uncertainty: Table | None = None,
    folder: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> RunResult:
    """What the material is by one force curve: a study is written, run and read, all in one.

    `data` is a file, or a table or mapping of arrays whose columns say name and unit: ``depth_mm``, ``Fz_N``.  The
    tables are those of [backend.settings]; `parameters` is name → (low, high) in the backend's units or with their
    own, or a value that fixes it.  What is left out of it is guessed from the curve, as `rso new` does.  `noise` is
    that of an experiment, `uncertainty` how well stated dimensions are known, as ``{"delta_thickness": "0.1 mm"}``.
    Everything lies in `folder` (by default ``fits/`` and a name by the contents), and the same call is answered from
    there.  Its study.toml can be run by `rso run`.

    Raises ValueError for bad input, StudyError for what the study cannot use, NothingToFit where too few runs have an
    answer.
    """
    backend = load_backend(DEFAULT_BACKEND)
    tables = _tables(specimen, indenter, support, material, settings)
    text, source = _curve_file(data)
    ranges = {} if parameters is None else dict(parameters)
    given = [text.decode("utf-8", "replace"), tables, ranges, dict(noise or {})]
    name = digest([*given, dict(uncertainty)] if uncertainty else given)[:12]
    place = (Path("fits") / name if folder is None else Path(folder)).absolute()
    place.mkdir(parents=True, exist_ok=True)
    curve = place / source
    if not curve.exists() or curve.read_bytes() != text:
        disk.replace(curve, text)
    lines = [*_head(tables, place), "", "[parameters]", *_ranges(backend, tables, ranges, curve), ""]
    lines += ["[uncertainty]", *(f"{k} = {inline(v)}" for k, v in uncertainty.items()), ""] if uncertainty else []
    lines += ["[[experiments]]", 'name = "curve"', 'role = "fit"', f"data = {inline(source)}"]
    lines += [f"noise = {inline(dict(noise))}"] if noise else []
    disk.replace(place / "study.toml", "\n".join(lines) + "\n")
    return load(place / "study.toml").run(jobs=jobs, progress=progress)


def _tables(
    specimen: Table, indenter: Table, support: Table | None, material: Table | None, more: Table | None
) -> Table:
    """Settings of the backend; those not given are its own choice."""
    given = {"specimen": specimen, "indenter": indenter, "support": support, "material": material}
    stated = {k: dict(v) for k, v in given.items() if v is not None}
    if both := sorted(set(stated) & set(more or {})):
        raise ValueError(f"settings: {both[0]} is given twice, as an argument and in settings")
    return {**stated, **(more or {})}


def _in_mm(depths: Sequence[float] | np.ndarray) -> np.ndarray:
    """Depths (n,) mm; ValueError for what is no list of numbers that increase from above 0."""
    try:
        travel = np.atleast_1d(np.asarray(depths, float))
    except (TypeError, ValueError):
        travel = np.empty((0, 0))
    if travel.ndim != 1 or not travel.size or not np.isfinite(travel).all():
        raise ValueError(f"depths = {depths!r}: a list of finite numbers is expected, in mm, such as [0.5, 1.0]")
    # The answer has a force for each depth as it stands: sorted or thinned, forces would be read at other depths.
    wrong = np.flatnonzero(np.diff(travel, prepend=0.0) <= 0)
    if wrong.size:
        said = f"depths[{wrong[0]}] = {travel[wrong[0]]:g} mm"
        raise ValueError(f"{said}: depths are counted from contact, where no force is, and must increase from above 0")
    return travel


def _numbers(backend: Backend, values: Mapping[str, Quantity], settings: Table) -> dict[str, float]:
    """Values in the units of the backend; ValueError naming what is unknown or of another unit."""
    units = {p.name: p.unit for p in backend.parameters}
    found = {}
    for name, value in values.items():
        if name not in units:
            from rso.calibration.plan import derived_from

            known = derived_from(backend, settings).get(name)
            why = f"{known}, which are stated" if known else choices_text(name, units)
            raise ValueError(f"{name} = {value!r}: {backend.name} has no such parameter; {why}")
        try:
            found[name] = value_in_unit(value, units[name])
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    return found


def _curve_file(data: str | os.PathLike[str] | pd.DataFrame | Mapping[str, Any]) -> tuple[bytes, str]:
    """Contents and name of the file of the curve; ValueError where there is none."""
    if isinstance(data, Mapping):
        try:
            data = pd.DataFrame(data)
        except ValueError as error:
            raise ValueError(f"data: the columns {', '.join(map(repr, data))} make no table: {error}") from error
    if isinstance(data, pd.DataFrame):
        return data.to_csv(index=False).encode(), "curve.csv"
    if not isinstance(data, str | os.PathLike):
        raise ValueError(
            f"data is a {type(data).__name__}: the path of a file or a table is expected. A table names columns and "
            'units, such as {"depth_mm": depth, "Fz_N": force}'
        )
    path = Path(data)
    if not path.is_file():
        raise ValueError(f"{path}: {'is a folder, not a file' if path.is_dir() else 'there is no such file'}")
    return path.read_bytes(), path.name


def _head(tables: Table, place: Path) -> list[str]:
    lines = ["[study]", 'title = "Indentation"', "seed = 1", "", "[backend]", f"use = {inline(DEFAULT_BACKEND)}", ""]
    return [*lines, "[backend.settings]", *(f"{k} = {inline(paths_seen_from(v, place))}" for k, v in tables.items())]


def _ranges(backend: Backend, tables: Table, ranges: Mapping[str, Any], curve: Path) -> list[str]:
    """Lines of [parameters]: those given, then the guesses of the backend; ValueError for what is none."""
    stated = {name: _range(name, given) for name, given in ranges.items()}
    studies = capability(backend, NewStudies)
    measured = combine(read_measurement(curve), Noise())
    guessed = {} if studies is None else studies.first_parameters(tables, measured.depth, measured.value)
    every = {**{name: line.value for name, line in guessed.items()}, **stated}
    return [f"{name} = {inline(value)}" for name, value in every.items()]


def _range(name: str, given: Any) -> dict[str, Any]:
    """A line of [parameters] by (low, high), a table as the study has it, or a value that fixes it."""
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, int | float | str):
        return {"value": given}
    try:
        low, high = given
    except (TypeError, ValueError):
        raise ValueError(f"parameters: {name} = {given!r}: (low, high) or a value is expected") from None
    return {"low": low, "high": high, "scale": "log"}
