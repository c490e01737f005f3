"""The diagnosis on flat bodies, checked on cases of its own library: a slab, a puck and a slab of two layers.

    python benchmarks/diagnosis_flat.py FOLDER [--cases 300] [--only slab,puck,layers] [--out FILE] [--again]

Writes a study of each body into FOLDER, diagnoses it (`rso diagnose`, of which runs are kept there) and sends its
library through `benchmarks/diagnosis`.  The plan is one that laboratories have: load and unload at two speeds, a hold,
and a deeper test that is kept back.  Data are the base model with noise: only their forces and noise count.
Effects that break the revolution (a tilt, an indenter beside the axis, fibres, an inclusion beside it) need runs in
three dimensions and are left out.
"""

from __future__ import annotations

import argparse
import os
import re

os.environ.setdefault("OMP_NUM_THREADS", "1")

import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme
from rso.discrepancy.study_diagnosis import ask
from rso.study.loader import load_study

REPORT = Path(__file__).parents[1] / "reports" / "diagnosis_flat.md"
CHECK = Path(__file__).parent / "diagnosis"
SPECIMENS = {
    "slab": '{ shape = "slab", thickness = 6.0 }',
    "puck": '{ shape = "cylinder", radius = 10.0, height = 8.0 }',
    "layers": '{ shape = "slab", thickness = 4.0, layers = [{ thickness = 0.5, ratio = 3.0 }] }',
}
IN_WORDS = {
    "slab": "A slab of 6 mm, bonded",
    "puck": "A puck of radius 10 mm and height 8 mm, bonded",
    "layers": "A slab of 4 mm, bonded, its upper 0.5 mm three times as stiff",
}
ORACLE = "closest imitations known (oracle)"
SECTIONS = "effects,rules,controls,shrinkage"
IN_SPACE = ("tilt_x", "tilt_y", "offset_x", "offset_y", "fibre", "inclusion_ratio")  # need three dimensions
PEAK, DEEP = 1.5, 2.2  # mm
TRUE = {"mu": 0.012, "D1": 6.0}  # MPa, 1/MPa
NOISE, DEPTH_NOISE, GAIN = 1e-3, 3e-3, 3e-3  # N, mm, of the gain of a test
SECONDS = 60.0  # of the hold
TESTS = {  # role, depth mm, speed mm/min, repeats, comes back, is held before
    "slow": ("fit", PEAK, 10.0, 2, True, False),
    "fast": ("fit", PEAK, 100.0, 1, True, False),
    "held": ("fit", PEAK, 30.0, 1, True, True),
    "deep": ("validate", DEEP, 10.0, 1, False, False),
}
STUDY = """\
[study]
title = "{title}"
seed = 43
units = "N-mm-MPa-s"

[backend]
use = "fem_backend.backend:BACKEND"

[backend.settings]
specimen = {specimen}
indenter = {{ shape = "sphere", radius = 3.0 }}
support = {{ kind = "bonded" }}
mesh = {{ level = "standard" }}

[parameters]
mu = {{ low = "5 kPa", high = "30 kPa", scale = "log" }}
D1 = {{ low = "1 1/MPa", high = "60 1/MPa", scale = "log" }}
"""
EXPERIMENT = """
[[experiments]]
name = "{name}"
role = "{role}"
data = "measured/{name}.csv"
channels = ["Fz"]
noise = {{ Fz = "1 mN", depth = "3 um", gain = "0.3 %" }}
"""


def made(folder: Path, body: str) -> None:
    """The study of a body with data of its base model."""
    text = STUDY.format(title=IN_WORDS[body], specimen=SPECIMENS[body])
    before = ""
    for name, (role, *_) in TESTS.items():
        text += EXPERIMENT.format(name=name, role=role) + (f'after = ["{before}"]\n' if before else "")
        before = name
    (folder / "measured").mkdir(parents=True, exist_ok=True)
    study = folder / "study.toml"
    study.write_text(text, encoding="utf-8")
    rng = np.random.default_rng(43)
    depth = np.linspace(0.02, 1.0, 40) * DEEP
    exact = None
    for name, (_, deepest, speed, repeats, back, held) in TESTS.items():
        rows = ["time_s,depth_mm,Fz_N,repeat,segment"]
        for repeat in range(1, repeats + 1):
            d = np.linspace(0.02, 1.0, 50) * deepest
            t, kinds = d / (speed / 60.0), ["loading"] * len(d)
            if held:
                rest = np.geomspace(0.2, SECONDS, 40)
                d, t = np.append(d, np.full(len(rest), deepest)), np.append(t, t[-1] + rest)
                kinds += ["hold"] * len(rest)
            if back:
                home = np.linspace(0.98, 0.02, 49) * deepest
                d, t = np.append(d, home), np.append(t, t[-1] + (deepest - home) / (speed / 60.0))
                kinds += ["unloading"] * len(home)
            if exact is None:
                settings = _settings(study)
                exact = BACKEND(TRUE, Case(body, Programme.ramp(tuple(depth)), settings)).channels["Fz"]
            force = np.interp(d, depth, exact / depth**1.5) * d**1.5 * (1.0 + GAIN * rng.standard_normal())
            force = force + NOISE * rng.standard_normal(len(d))
            read = d + DEPTH_NOISE * rng.standard_normal(len(d))
            rows += [f"{a:.3f},{b:.4f},{c:.5f},{repeat},{k}" for a, b, c, k in zip(t, read, force, kinds, strict=True)]
        (folder / "measured" / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    every = [e.name for e in ask(load_study(study)).effects if e.place is None]
    effects = [n for n in every if n not in IN_SPACE]
    print(f"{body}: left out {', '.join(n for n in every if n in IN_SPACE) or 'nothing'}; tried {', '.join(effects)}")
    with study.open("a", encoding="utf-8") as file:
        file.write("\n[diagnose]\neffects = [" + ", ".join(f'"{n}"' for n in effects) + "]\n")


def _settings(study: Path) -> dict[str, Any]:
    return tomllib.loads(study.read_text(encoding="utf-8"))["backend"]["settings"]


def row(text: str, first: str) -> list[str]:
    """Cells of the first row of a table that begins with a cell."""
    line = next(v for v in text.splitlines() if v.startswith(f"| {first} |"))
    return [c.strip() for c in line.strip("|").split("|")]


def section(text: str, title: str) -> str:
    """A section of a Markdown text, without its title."""
    return text.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0].split("\nCPU ", 1)[0].strip()


def summary(checks: dict[str, str]) -> list[str]:
    """One column for each body: the figures by which the diagnosis of the ellipsoid is judged."""
    columns = {b: _figures(text) for b, text in checks.items()}
    words = list(next(iter(columns.values())))
    out = ["| | " + " | ".join(checks) + " |", "|---" * (len(checks) + 1) + "|"]
    return [*out, *(f"| {w} | " + " | ".join(c[w] for c in columns.values()) + " |" for w in words)]


def _figures(text: str) -> dict[str, str]:
    inference, controls, closes = (
        section(text, n) for n in ("Inference", "Controls", "How much of the gap is explained")
    )
    judged, missing, permuted = (
        row(inference, "as it is"),
        *(row(controls, n) for n in ("true effect not in the catalogue", "residuals permuted")),
    )
    # columns of the table of inference, those left out are empty
    names = ["false alarms", "detected", "cause on top", "or its class", "in the named set", ""]
    names += ["set size", "wrong and sure", "", "slope"]
    found = {n: v for n, v in zip(names, judged[1:], strict=True) if n}
    size = re.search(r"under the true cause (\S+)", inference)
    held, turn = (row(t, "all") for t in closes.split("### Each experiment", 1))
    without = re.search(r"as judged, (\S+)", closes)
    return {
        "cases": re.search(r"(\d+ cases \(\d+ without a gap)", text)[1] + ")",
        "effects tried": re.search(r"of (\d+) effects", text)[1],
        **found,
        "90 % interval of the size holds it": size[1] if size else "–",
        "true cause not in the catalogue: unexplained or partly": f"{float(missing[2]) + float(missing[3]):.3f}",
        "another cause sure": missing[5],
        "permuted residuals: one cause, sure": permuted[5],
        "share closed of the deep curve, median (quartiles)": f"{held[2]} of {held[1]} cases",
        "over that of the true effect": held[4],
        "the same, each experiment left out in turn": f"{turn[2]}; {turn[4]}",
        "share printed without a gap": without[1] if without else "–",
        f"cause on top of those found: {ORACLE}": row(text, "closest imitations known (oracle)")[1],
        "nearest signature, no re-fit": row(text, "nearest signature, no re-fit")[1],
    }


def report(folder: Path, bodies: list[str], out: Path, command: str) -> None:
    """The figures of every body, and each effect."""
    checks = {b: (folder / b / "check.md").read_text(encoding="utf-8") for b in bodies}
    lines = ["# Diagnosis on flat bodies, on cases of its own library", "", f"`{command}` (seed 0)", ""]
    lines += [f"- {b}: {IN_WORDS[b]}, under a ball of 3 mm." for b in bodies]
    lines += ["", *summary(checks), ""]
    for b in bodies:
        lines += [f"## {IN_WORDS[b]}", "", section(checks[b], "By effect"), ""]
    out.write_text("\n".join(lines), encoding="utf-8")


def options() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--only", default=",".join(SPECIMENS))
    parser.add_argument("--out", type=Path, default=REPORT)
    parser.add_argument("--again", action="store_true", help="with the studies and libraries that are there")
    return parser.parse_args()


def main() -> None:
    """Study, library and check of every body."""
    o = options()
    bodies = o.only.split(",")
    for body in bodies:
        folder = o.folder / body
        if not (o.again and (folder / "results" / "diagnosis.json").exists()):
            made(folder, body)
            subprocess.run([sys.executable, "-m", "rso", "diagnose", str(folder), "--jobs", "1"], check=True)
        told = ["--cases", str(o.cases), "--sections", SECTIONS, "--jobs", "1", "--out", str(folder / "check.md")]
        subprocess.run([sys.executable, str(CHECK), str(folder), *told], check=True)
    report(o.folder, bodies, o.out, f"python benchmarks/diagnosis_flat.py FOLDER --cases {o.cases}")


if __name__ == "__main__":
    main()
