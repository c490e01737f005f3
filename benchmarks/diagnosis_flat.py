"""The diagnosis on flat bodies, checked on cases of its own library: a slab, a puck and a slab of two layers.

    python benchmarks/diagnosis_flat.py FOLDER [--cases 300] [--only slab,puck,layers] [--out FILE]

Writes a study of each body into FOLDER, diagnoses it (`rso diagnose`, of which runs are kept there) and sends its
library through `benchmarks/diagnosis`.  The plan is one that laboratories have: load and unload at two speeds, a hold,
and a deeper test that is kept back.  Data are the base model with noise: only their forces and noise count.
Effects that break the revolution (a tilt, an indenter beside the axis, fibres, an inclusion beside it) need runs in
three dimensions and are left out.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import subprocess
import sys
from pathlib import Path

import numpy as np

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme
from rso.discrepancy.study_diagnosis import ask
from rso.study.loader import load

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
            rows += [
                f"{a:.3f},{b:.4f},{c:.5f},{repeat},{k}" for a, b, c, k in zip(t, read, force, kinds, strict=True)
            ]
        (folder / "measured" / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    every = [e.name for e in ask(load(study)).effects if e.place is None]
    effects = [n for n in every if n not in IN_SPACE]
    print(f"{body}: left out {', '.join(n for n in every if n in IN_SPACE) or 'nothing'}; tried {', '.join(effects)}")
    with study.open("a", encoding="utf-8") as file:
        file.write("\n[diagnose]\neffects = [" + ", ".join(f'"{n}"' for n in effects) + "]\n")


def _settings(study: Path) -> dict:
    import tomllib

    return tomllib.loads(study.read_text(encoding="utf-8"))["backend"]["settings"]


def options() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--only", default=",".join(SPECIMENS))
    parser.add_argument("--sections", default="effects,rules,controls,shrinkage")
    return parser.parse_args()


def main() -> None:
    """Study, library and check of every body."""
    o = options()
    for body in o.only.split(","):
        folder = o.folder / body
        made(folder, body)
        subprocess.run([sys.executable, "-m", "rso", "diagnose", str(folder), "--jobs", "1"], check=True)
        out = folder / "check.md"
        told = ["--cases", str(o.cases), "--sections", o.sections, "--jobs", "1", "--out", str(out)]
        subprocess.run([sys.executable, str(CHECK), str(folder), *told], check=True)


if __name__ == "__main__":
    main()
