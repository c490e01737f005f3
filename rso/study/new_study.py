"""A first study file from readings: what they tell is filled in, what they cannot tell is marked for their owner."""

from __future__ import annotations

import itertools
import math
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from rso.contract import Backend
from rso.core.units import COLUMN_NAMES
from rso.data import CONTACT, Measurement, Noise, Unsaid, combine, read, recorded_speed, sheet_of
from rso.study.cases import by_hertz
from rso.study.columns_table import ColumnsTable
from rso.study.errors import choose
from rso.study.laboratory_folder import inline, may_be_a_place, place

GUESS = "# <-"  # behind what nobody has stated
TURNED = "pressed, as both signs were turned; a pull looks the same: else [columns] says so"
TOP = (0.0, 0.0)
RESOLVED = 0.035  # of the force at the deepest reading: what the mesh of a new study may miss
AROUND = 3.0  # of the modulus of Hertz's limit, whose half-space the body is not
PULLS = 0.1  # of its range: a force that is negative by more pulls
WIDE = (0.001, 1.0)  # MPa, of a modulus that no force curve tells
PRODUCT = (0.01, 1.8)  # mu D1, at the middle of the range of mu and at its end: ν = 0.4975 and 0.15


@dataclass(frozen=True)
class Test:
    """What the readings do not tell.

    Semi-axes, radius of the ball and clearance of the bowl (held without) in mm; the point that was pressed where the
    name of a file says none (the top without); whether the files fitted are repeats of one test; and what columns are
    called, with the keys of [columns], where the files do not say it themselves.
    """

    semi_axes: tuple[float, float, float]
    radius: float
    clearance: float | None = None
    point: tuple[float, float] | None = None
    repeats: bool = False
    columns: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def settings(self) -> dict[str, object]:
        """The same as settings of the backend."""
        bowl = {"kind": "bowl", "clearance": self.clearance, "friction": 0.2}
        return {
            "specimen": {"shape": "ellipsoid", "semi_axes": list(self.semi_axes)},
            "indenter": {"shape": "sphere", "radius": self.radius, "shaft": True},
            "support": {"kind": "fixed"} if self.clearance is None else bowl,
        }


@dataclass(frozen=True)
class _Experiment:
    name: str
    role: str
    files: tuple[str, ...]
    measurement: Measurement
    point: tuple[float, float] | None
    by_name: bool


def begin(file: Path, backend: Backend, test: Test, fitted: Sequence[str], validated: Sequence[str] = ()) -> str:
    """The text of a study to be written at `file`, from data files given as paths from where one stands.

    ValueError where a study is at `file` already, and for data that are not there, given twice or not understood.
    """
    if file.exists():
        raise ValueError(f"{file}: is there already; --out names another file")
    if not file.absolute().parent.is_dir():
        raise ValueError(f"{file}: there is no folder {file.parent}")
    experiments = _experiments(test, fitted, validated)
    title = inline(f"Indentation: {experiments[0].name}")
    lines = [
        "# Begun by `rso new`.  Lines with <- are guesses to look at; `rso keys` says what else may stand here.",
        "[study]",
        f"title = {title}  {GUESS} for the report",
        "seed = 1",
        "",
        "[backend]",
        'use = "fem_backend.backend:BACKEND"',
        "",
        "[backend.settings]",
        *(f"{key} = {inline(value)}{_remark(key, test)}" for key, value in test.settings().items()),
        f'material = {{ law = "neo_hookean" }}  {GUESS} or linear_elastic, mooney_rivlin, yeoh, ogden',
        _mesh(backend, test, experiments),
        "",
        *_parameters(backend, test, experiments),
        "",
    ]
    if test.columns:
        lines += ["[columns]", *(f"{name} = {inline(dict(column))}" for name, column in test.columns.items()), ""]
    for e in experiments:
        lines += [*_lines(e, file.absolute().parent), ""]
    return "\n".join(lines).rstrip() + "\n"


def alone(test: Test, fitted: Sequence[str]) -> str:
    """What is to be said of several files that are fitted as tests of their own at one point; else nothing."""
    found = [] if test.repeats else _experiments(test, fitted, ())
    same = {e.point: [o.files[0] for o in found if o.point == e.point] for e in found}
    said = [f"{', '.join(files)} are tests of their own at one point" for files in same.values() if len(files) > 1]
    return f"{'; '.join(said)}; repeats of one test are begun with --repeats" if said else ""


def _experiments(test: Test, fitted: Sequence[str], validated: Sequence[str]) -> list[_Experiment]:
    given = [*fitted, *validated]
    for k, g in enumerate(given):
        path, sheet = sheet_of(Path(g))
        if not path.is_file():
            raise ValueError(f"{g}: {'is a folder, not a file' if path.is_dir() else 'there is no such file'}")
        if (path.resolve(), sheet) in [(p.resolve(), s) for p, s in map(sheet_of, map(Path, given[:k]))]:
            raise ValueError(f"{g}: is given twice; a reading counts once")
        if not g.isprintable() or any("\ud800" <= c <= "\udfff" for c in g):
            raise ValueError(f"{g!r}: a study file cannot name this; rename it")
    names = dict(zip(given, _names(given), strict=True))
    groups = [("fit", tuple(fitted))] if test.repeats else [("fit", (f,)) for f in fitted]
    groups += [("validate", (f,)) for f in validated]
    found = []
    for role, files in groups:
        m = _read(files, test.columns)
        if role == "fit" and m.kind == "profile":
            raise ValueError(f"{files[0]}: displacements are not fitted; give a profile behind --validate")
        point, by_name = _point(test, role, files)
        found.append(_Experiment(names[files[0]], role, files, m, point, by_name))
    return found


def _point(test: Test, role: str, files: Sequence[str]) -> tuple[tuple[float, float] | None, bool]:
    """Where a test was done, if anything says so, and whether that is the name of its file or sheet."""
    said = set()
    for f in files:
        path, sheet = sheet_of(Path(f))
        where = place(sheet) or place(path.stem)
        if where is None and test.point is None and (may_be_a_place(sheet) or may_be_a_place(path.stem)):
            raise ValueError(f"{f}: its name does not say where it was pressed as point_20_0 does; give --point X Y")
        said.add(where)
    if len(said) > 1:
        raise ValueError(f"{', '.join(files)}: by their names they were pressed at several points, and are no repeats")
    (where,) = said
    if role == "fit" and where is not None and test.point not in (None, where):
        raise ValueError(f"{files[0]}: pressed at ({where[0]:g}, {where[1]:g}) mm by its name, elsewhere by --point")
    return where or test.point, where is not None


def _read(files: Sequence[str], columns: Mapping[str, Mapping[str, Any]]) -> Measurement:
    if unknown := next((name for name in columns if name not in COLUMN_NAMES), None):
        raise ValueError(f"--column {unknown}: there is no column {unknown!r}; {choose(unknown, COLUMN_NAMES)}")
    try:
        known = ColumnsTable(**columns).columns() if columns else {}
    except ValidationError as error:
        each = [(".".join(map(str, e["loc"])), e["msg"].removeprefix("Value error, ")) for e in error.errors()]
        raise ValueError("; ".join(f"--column {place}: {message}" for place, message in each)) from error
    try:
        return read(files if len(files) > 1 else files[0], known)
    except Unsaid as error:
        words = "\n".join(f"  --column {shlex.join(_words(name, c))}" for name, c in error.columns.items())
        raise ValueError(f"{error.message}:\n{words}") from error
    except ValueError as error:
        if "column" not in str(error):
            raise
        text = f"{error}\nsay what its columns are: --column depth HEADER mm --column Fz HEADER N, and flip behind the "
        raise ValueError(f"{text}unit where the machine counts with the other sign (rso keys columns)") from error


def _words(name: str, column: Mapping[str, Any]) -> list[str]:
    """A column as the words of --column say it, what is subtracted of it last."""
    less, told = column.get("minus"), ("stiffness", "compliance")
    said = [name] * bool(name) + [column[k] for k in ("header", "unit") if k in column]
    said += [word for k in told if k in column for word in (k, column[k])]
    said += ["flip"] * ("flip" in column) + ["contact"] * (column.get("zero") == CONTACT)
    return said if less is None else [*said, "minus", *_words("", less)]


def _remark(key: str, test: Test) -> str:
    if key == "support" and test.clearance is None:
        return f'  {GUESS} its lower half; or {{ kind = "bowl", clearance = 1.0, friction = 0.2 }}'
    return f"  {GUESS} its friction" if key == "support" else ""


def _mesh(backend: Backend, test: Test, experiments: Sequence[_Experiment]) -> str:
    """The cheapest level that resolves the shallowest of the tests, and what it misses at its deepest reading."""
    forces = [e for e in experiments if e.measurement.kind == "force"]
    depths = [max(float(r.depth.max()) for r in e.measurement.repeats) for e in forces]
    ask, d = getattr(backend, "resolution", None), min(depths, default=0.0)
    if ask is None or d <= 0.0:
        return 'mesh = { level = "coarse" }  # standard, fine and reference cost more'
    errors = ask({**test.settings(), "mesh": {"level": "coarse"}}, d)
    level = next((name for name, error in errors.items() if error <= RESOLVED), min(errors, key=errors.__getitem__))
    others = ", ".join(f"{n} {100 * v:.2g} %" for n, v in errors.items() if n != level)
    return (
        f'mesh = {{ level = "{level}" }}  # about {100 * errors[level]:.2g} % in force at {_two(d)} mm, '
        f"more where it is shallower; {others}"
    )


def _parameters(backend: Backend, test: Test, experiments: Sequence[_Experiment]) -> list[str]:
    """Ranges about the modulus that Hertz's limit has in the first force curve, or a wide one."""
    force = next((e for e in experiments if "Fz" in e.measurement.channels), None)
    mu, pull = 0.0, {}
    if force is not None:
        settings = {**test.settings(), "point": list(force.point or TOP)}
        curve = combine(force.measurement, Noise())
        mu = float(by_hertz(backend, settings, curve).get("mu", 0.0))
        if _adheres(curve.value) and hasattr(backend, "jkr"):
            pull = backend.jkr(settings, curve.depth, curve.value)
            mu = float(pull.get("mu", mu))
        if mu <= 0.0:
            raise ValueError(
                f"{force.files[0]}: the modulus by Hertz's limit would be {mu:.2g} MPa, which is none: "
                "Fz falls while the ball goes deeper; is it a tensile record, "
                "or a sign or a zero wrong?"
            )
    low, high = (mu / AROUND, mu * AROUND) if mu > 0 else WIDE
    limit = f"Hertz's limit of the shallow half says about {_two(1e3 * mu)} kPa"
    limit = f"adhesion: the JKR limit says about {_two(1e3 * mu)} kPa" if pull else limit
    why = limit if mu > 0 else "no reading tells: narrow it"
    D1 = [_two(PRODUCT[0] / math.sqrt(low * high)), _two(PRODUCT[1] / high)]
    return [
        "[parameters]",
        f'mu = {{ low = "{_two(1e3 * low)} kPa", high = "{_two(1e3 * high)} kPa", scale = "log" }}  {GUESS} {why}',
        f'D1 = {{ low = "{D1[0]} 1/MPa", high = "{D1[1]} 1/MPa", scale = "log" }}  '
        f"{GUESS} bulk modulus K = 2 / D1; Poisson ratio 0.15 where both are high",
        *_adhesion(pull),
    ]


def _adheres(force: np.ndarray) -> bool:
    """Whether a loading curve (n,) is pulled by more than a tare or its scatter may be."""
    noise = 1.5 * float(np.median(np.abs(np.diff(force, 2)))) / 6**0.5
    return float(force.min()) < -max(PULLS * float(np.ptp(force)), 10.0 * noise) and int(np.argmin(force)) > 0


def _adhesion(pull: Mapping[str, float]) -> list[str]:
    """The line of a parameter of adhesion that the record shows."""
    if not pull:
        return []
    w = float(pull["adhesion"])
    return [
        f'adhesion = {{ low = "{_two(w / AROUND)} N/mm", high = "{_two(w * AROUND)} N/mm", scale = "log" }}  '
        f"{GUESS} Fz pulls: adhesion; JKR says about {_two(w)} N/mm, "
        f"contact at {pull['contact']:.3g} mm in the file"
    ]


def _lines(e: _Experiment, beside: Path) -> list[str]:
    m, data = e.measurement, [_beside(f, beside) for f in e.files]
    lines = [
        "[[experiments]]",
        f"name = {inline(e.name)}",
        f'role = "{e.role}"',
        f"data = {inline(data[0] if len(data) == 1 else data)}{f'  {GUESS} {TURNED}' * m.guessed}",
    ]
    settings = [f"point = {list(e.point or TOP)}"]
    if m.kind == "profile":
        lines += ['kind = "profile"']
    else:
        lines += ['channels = ["Fz", "Fx", "Fy"]'] if {"Fx", "Fy"} <= set(m.channels) else []
        settings += ["unload = true"] if any(np.any(r.segment == "unloading") for r in m.repeats) else []
    whose = f"  {GUESS} by the name of the file" if e.by_name else f"  {GUESS} the top" if e.point is None else ""
    lines += [f"settings = {{ {', '.join(settings)} }}{whose}"]
    if m.kind == "force" and not recorded_speed(m):
        lines += ['# no times in the file: settings may have speed = "30 mm/min" too, if the body remembers']
    unseen = [*([] if m.contact or len(e.files) > 1 else ['contact = "0.05 mm"']), 'gain = "1 %"']
    if m.kind == "force":
        lines += [f"# noise = {{ {', '.join(unseen)} }}  {GUESS} what a record cannot show of itself; usual figures"]
    return lines


def _beside(file: str, folder: Path) -> str:
    """The path of a file, or of a sheet in it, from a folder; its own on another drive."""
    path, sheet = sheet_of(Path(file))
    try:
        there = Path(os.path.relpath(path.resolve(), folder.resolve()))
    except ValueError:
        there = path.resolve()
    return there.as_posix() + (f"#{sheet}" if sheet else "")


def _names(files: Sequence[str]) -> list[str]:
    """A name of an experiment for each file, from that of the file and the sheet, none that another file has itself."""
    parts = [sheet_of(Path(f)) for f in files]
    words = [re.sub(r"[^\w.+-]+", " ", f"{path.stem} {sheet}")[:60].strip(" .+-") or "test" for path, sheet in parts]
    names: list[str] = []
    for plain in words:
        more = (f"{plain}_{k}" for k in itertools.count(2))
        names.append(plain if plain not in names else next(n for n in more if n not in (*names, *words)))
    return names


def _two(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"
