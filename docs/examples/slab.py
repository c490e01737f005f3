"""A gel slab under a ball, from Python: one simulation, one fit, one picture.  Takes about two minutes.

python docs/examples/slab.py FOLDER
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

import rso

ROOT = Path(__file__).parents[2]
SLAB = {"shape": "slab", "thickness": 6.0}
BALL = {"shape": "sphere", "radius": 3.0}
COARSE = {"mesh": {"level": "coarse"}}


def simulated() -> pd.DataFrame:
    """Force at five depths, by finite elements, with the stated numerical error."""
    r = rso.indent([0.5, 1, 1.5, 2, 2.5], specimen=SLAB, indenter=BALL, settings=COARSE, mu="10 kPa", D1=5.8)
    return pd.DataFrame({"depth_mm": r.channels["travel"], "Fz_N": r.channels["Fz"], "error_N": r.error["Fz"]})


def main(folder: Path) -> None:
    """Fit the measured curve, print what it determines, and draw it."""
    print(simulated().round(5).to_string(index=False))
    data = ROOT / "studies" / "gel_slab" / "measured" / "thick.csv"
    result = rso.fit(data, specimen=SLAB, indenter=BALL, settings=COARSE, folder=folder / "fit", progress=print)
    print(result.parameters[["value", "unit", "low", "high", "verdict"]])
    curves = result.curves
    fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
    for what, of in curves.groupby("what"):
        ax.plot(of["depth"], of["value"], "k." if what == "measured" else "-", label=what)
    ax.set(xlabel="depth (mm)", ylabel="force (N)")
    ax.legend()
    fig.savefig(folder / "slab.svg")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
