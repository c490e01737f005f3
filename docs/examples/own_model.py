"""A model of one's own, from Python: a function of numbers, its runs made here or elsewhere.  Takes seconds.

python docs/examples/own_model.py FOLDER
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import rso

STUDY = """
[study]
title = "A stiffening spring"
seed = 1
[backend]
use = "own_model:spring"
[parameters]
k = { low = 0.5, high = 5.0 }
n = { low = 1.0, high = 2.0 }
[[experiments]]
name = "pull"
role = "fit"
data = "pull.csv"
[doe]
runs = 8
[sensitivity]
sobol = false
[search]
population = 12
generations = 5
[report]
html = false
pdf = false
"""


@rso.model(parameters={"k": (0.1, 10.0, "N/mm"), "n": (1.0, 2.0)})
def spring(travel, k, n):
    """F = k uⁿ (N) of the travel u (mm)."""
    return k * travel**n


def study_in(folder: Path) -> None:
    """A study with readings of a spring of k = 2 N/mm and n = 1.5, scattered by 0.01 N."""
    u = np.linspace(0.1, 2.0, 20)
    F = 2.0 * u**1.5 + 0.01 * np.random.default_rng(0).standard_normal(20)
    pd.DataFrame({"depth_mm": u, "Fz_N": F}).to_csv(folder / "pull.csv", index=False)
    (folder / "study.toml").write_text(STUDY)


def elsewhere(folder: Path) -> rso.RunResult:
    """The same study, whose runs somebody else makes: asked for in batches, and told."""
    study = rso.load(folder, backend=spring, folder=folder / "told")
    while runs := study.ask():
        study.tell([(run, {"Fz": spring(travel=run.travel, **run.values)}) for run in runs])
    return study.run()


def main(folder: Path) -> None:
    """Identify the spring both ways, print and draw what is found."""
    folder.mkdir(parents=True, exist_ok=True)
    study_in(folder)
    here, there = rso.load(folder, backend=spring).run(), elsewhere(folder)
    print(here.parameters[["value", "unit", "low", "high", "verdict"]].round(4))
    print("the same from runs made elsewhere:", here.parameters.equals(there.parameters))
    runs = here.runs
    fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
    for purpose, of in runs.groupby("purpose"):
        ax.plot(of["k"], of["n"], ".", label=purpose)
    ax.set(xlabel="k (N/mm)", ylabel="n")
    ax.legend()
    fig.savefig(folder / "own_model.svg")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
