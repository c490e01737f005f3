"""A point cloud beside the force of a slab: compressibility is better known than by the force alone."""

from __future__ import annotations

import numpy as np
import pytest
from sample_studies import Inline, read

from fem_backend.backend import BACKEND
from rso.calibration.pipeline import run_study
from rso.calibration.plan import make_plan
from rso.contract import Case, Programme
from rso.evaluation.store import RunStore
from rso.study.loader import load_study

MU, D1, SIGMA = 0.01, 60.0, 0.004
SETTINGS = {
    "specimen": {"shape": "slab", "thickness": 8.0},
    "indenter": {"shape": "sphere", "radius": 3.0},
    "support": {"kind": "bonded"},
    "mesh": {"level": "coarse"},
}
STUDY = """
[study]
title = "Slab"
seed = 0
[backend]
use = "fem_backend.backend:BACKEND"
[backend.settings]
specimen = { shape = "slab", thickness = 8.0 }
indenter = { shape = "sphere", radius = 3.0 }
support = { kind = "bonded" }
mesh = { level = "coarse" }
[parameters]
mu = { low = 0.005, high = 0.02, scale = "log" }
D1 = { low = 10, high = 150, scale = "log" }
[[experiments]]
name = "top"
role = "fit"
data = "top.csv"
noise = { Fz = "0.5 mN", contact = "10 um", gain = "1 %", correlation = "0 mm" }
[search]
method = "gauss_newton"
[report]
html = false
pdf = false
"""
CLOUD = """
[[experiments]]
name = "cloud"
role = "fit"
kind = "surface"
data = "cloud.csv"
points = 20
noise = { uz = "4 um", surface_correlation = "1 mm", contact = "10 um" }
"""


@pytest.mark.verification
def test_compressibility_is_better_known_with_a_cloud(tmp_path):
    """sd ln D1 at least halves, and both fits hold the truth within 4 standard deviations."""
    g, depths, rng = np.linspace(-7.5, 7.5, 11), (1.0, 1.5, 2.0), np.random.default_rng(3)
    places = [[float(x), float(y)] for x in g for y in g]
    asked = tuple(map(float, np.linspace(0.1, 2.0, 20)))
    true = BACKEND({"mu": MU, "D1": D1}, Case("c", Programme.ramp(asked), {**SETTINGS, "profile": places})).channels
    F = true["Fz"] + 5e-4 * rng.standard_normal(20)
    top = "depth_mm,Fz_N\n" + "".join(f"{u},{f}\n" for u, f in zip(asked, F, strict=True))
    rows, apart = [], np.linalg.norm(np.array(places)[:, None] - np.array(places), axis=2)
    L = np.linalg.cholesky(np.exp(-apart / 1.0))
    for h in depths:
        k = int(np.argmin(np.abs(true["travel"] - h)))
        noise = SIGMA * L @ rng.standard_normal((len(places), 3))
        for (x, y), e in zip(places, noise, strict=True):
            u = [true[f"u{a}({x:g},{y:g})"][k] for a in "xyz"] + e
            rows.append(",".join(map(str, (h, x, y, *u))))
    sd = {}
    for name, more in (("alone", ""), ("both", CLOUD)):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "top.csv").write_text(top)
        (folder / "cloud.csv").write_text("depth_mm,x_mm,y_mm,ux_mm,uy_mm,uz_mm\n" + "\n".join(rows) + "\n")
        (folder / "study.toml").write_text(STUDY + more)
        plan = make_plan(load_study(folder / "study.toml"))
        with RunStore(folder / "results") as store:
            run_study(plan, store, Inline(), folder / "results", command="test", jobs=1)
        found = {p["parameter"]: p for p in read(folder)["identification"]["parameters"]}
        for parameter, value in (("mu", MU), ("D1", D1)):
            assert abs(np.log(found[parameter]["value"] / value)) < 4.0 * found[parameter]["sd_log"]
        sd[name] = found["D1"]["sd_log"]
    print(sd)
    assert sd["both"] < 0.5 * sd["alone"]
