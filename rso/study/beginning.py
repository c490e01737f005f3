"""A first study file from readings: what they tell is filled in, what they cannot tell is marked for their owner."""

from __future__ import annotations

import itertools
import json
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rso.contract import Backend
from rso.measurement import Measurement, Noise, combine, read, sheet_of
from rso.study.laboratory import inline, place
from rso.study.readings import by_hertz

GUESS = "# <-"  # behind what nobody has stated
AROUND = 3.0  # of the modulus of Hertz's limit, whose half-space the body is not
WIDE = (0.001, 1.0)  # MPa, of a modulus that no reading tells
PRODUCT = (0.01, 1.8)  # mu D1, at the middle of the range of mu and at its end: ν = 0.4975 and 0.15


@dataclass(frozen=True)
class Test:
    """What the readings do not tell: semi-axes, radius of the ball and clearance of the bowl (held without) in mm, the
    point that is pressed where the name of a file says none, whether the files fitted are repeats of one test."""

    semi_axes: tuple[float, float, float]
    radius: float
    clearance: float | None = None
    point: tuple[float, float] = (0.0, 0.0)
    repeats: bool = False

    def settings(self) -> dict[str, object]:
        """The same as settings of the backend."""
        bowl = {"kind": "bowl", "clearance": self.clearance, "friction": 0.2}
        return {
            "specimen": {"shape": "ellipsoid", "semi_axes": list(self.semi_axes)},
            "indenter": {"shape": "sphere", "radius": self.radius, "shaft": True},
            "support": {"kind": "fixed"} if self.clearance is None else bowl,
        }


def begin(file: Path, backend: Backend, test: Test, fitted: Sequence[str], validated: Sequence[str] = ()) -> str:
    """The text of a study to be written at `file`, from data files given as paths from where one stands.

    A file that cannot be read has its place too: reading the study says what it lacks.  ValueError for a file that is
    not there or given twice, and where a study is at `file` already.
    """
    if file.exists():
        raise ValueError(f"{file}: is there already; --out names another file")
    given = [*fitted, *validated]
    if twice := next((g for k, g in enumerate(given) if g in given[:k]), None):
        raise ValueError(f"{twice}: is given twice; a reading counts once")
    if gone := next((g for g in given if not sheet_of(Path(g))[0].is_file()), None):
        raise ValueError(f"{gone}: there is no such file")
    names = _names(given)
    groups = [list(fitted)] if test.repeats else [[f] for f in fitted]
    readable = [_read(g) for g in groups]
    lines = [
        "# Begun by `rso new`.  Lines with <- are guesses to look at; `rso keys` says what else may stand here.",
        "[study]", f"title = {json.dumps(f'Indentation: {names[0]}', ensure_ascii=False)}  {GUESS} for the report",
        "seed = 1", "", "[backend]", 'use = "fem_backend.backend:BACKEND"', "", "[backend.settings]",
        *(f"{key} = {inline(value)}{_remark(key, test)}" for key, value in test.settings().items()),
        f'material = {{ law = "neo_hookean" }}  {GUESS} or linear_elastic, mooney_rivlin, yeoh, ogden',
        'mesh = { level = "coarse" }  # about 1 % in force; standard, fine and reference cost more', "",
        *_parameters(backend, test, readable), "",
    ]  # fmt: skip
    if not all(readable):
        lines += ["# A file is not understood: `rso check` says why.  What its columns are (`rso keys columns`):",
                  "# [columns]", '# depth = { header = "Standardweg", unit = "mm" }',
                  '# Fz = { header = "Standardkraft", unit = "N" }', ""]  # fmt: skip
    beside = file.absolute().parent
    for group, m in zip(groups, readable, strict=True):
        lines += [*_experiment(names[given.index(group[0])], "fit", group, m, test, beside), ""]
    for path in validated:
        lines += [*_experiment(names[given.index(path)], "validate", [path], _read([path]), test, beside), ""]
    return "\n".join(lines).rstrip() + "\n"


def _read(files: Sequence[str]) -> Measurement | None:
    try:
        return read(files if len(files) > 1 else files[0])
    except ValueError:
        return None  # said again, with its place, when the study is read


def _remark(key: str, test: Test) -> str:
    if key == "support" and test.clearance is None:
        return '  # its lower half; or { kind = "bowl", clearance = 1.0, friction = 0.2 }'
    return f"  {GUESS} its friction" if key == "support" else ""


def _parameters(backend: Backend, test: Test, readable: Sequence[Measurement | None]) -> list[str]:
    """Ranges about the modulus that Hertz's limit has in the first readable force curve, or a wide one."""
    force = next((m for m in readable if m is not None and m.kind == "force" and "Fz" in m.channels), None)
    settings = {**test.settings(), "point": list(test.point)}
    mu = 0.0 if force is None else float(by_hertz(backend, settings, combine(force, Noise())).get("mu", 0.0))
    low, high = (mu / AROUND, mu * AROUND) if mu > 0 else WIDE
    limit = f"Hertz's limit of the shallow half says about {_two(1e3 * mu)} kPa"
    why = limit if mu > 0 else "no reading tells: narrow it"
    D1 = [_two(PRODUCT[0] / math.sqrt(low * high)), _two(PRODUCT[1] / high)]
    return ["[parameters]",
            f'mu = {{ low = "{_two(1e3 * low)} kPa", high = "{_two(1e3 * high)} kPa", scale = "log" }}  {GUESS} {why}',
            f'D1 = {{ low = "{D1[0]} 1/MPa", high = "{D1[1]} 1/MPa", scale = "log" }}  {GUESS} 2 / K, from nearly '
            "incompressible to a Poisson ratio of 0.15 in a corner of these ranges"]  # fmt: skip


def _experiment(
    name: str, role: str, files: Sequence[str], m: Measurement | None, test: Test, beside: Path
) -> list[str]:
    data = [os.path.relpath(f, beside) for f in files]
    lines = ["[[experiments]]", f"name = {json.dumps(name, ensure_ascii=False)}", f'role = "{role}"',
             f"data = {inline(data[0] if len(data) == 1 else data)}"]  # fmt: skip
    settings = [f"point = {list(place(name) or test.point)}"]
    if m is not None and m.kind == "profile":
        lines += ['kind = "profile"']
    elif m is not None:
        lines += ['channels = ["Fz", "Fx", "Fy"]'] if {"Fx", "Fy"} <= set(m.channels) else []
        settings += ["unload = true"] if any(np.any(r.segment == "unloading") for r in m.repeats) else []
    lines += [f"settings = {{ {', '.join(settings)} }}"]
    if m is None or m.kind == "force":
        lines += ['# What the record cannot show; usual: noise = { contact = "0.05 mm", gain = "1 %" }']
    return lines


def _names(files: Sequence[str]) -> list[str]:
    """A name of an experiment for each file, from that of the file and the sheet."""
    names: list[str] = []
    for f in files:
        path, sheet = sheet_of(Path(f))
        words = re.sub(r"[^\w.+-]+", " ", f"{path.stem} {sheet}")
        plain = words[:60].strip(" .+-") or "test"
        free = (f"{plain}_{k}" if k > 1 else plain for k in itertools.count(1))
        names.append(next(name for name in free if name not in names))
    return names


def _two(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"
