"""Runs docs/tutorial.md and draws its pictures: `python docs/figures/tutorial.py` (a minute); prints what is quoted."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
FIGURES = {"curve-0": "tutorial_fit.png", "determined": "tutorial_determined.png"}


def rso(folder: Path, *words: str) -> str:
    command = [sys.executable, "-m", "rso", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


def main(folder: Path) -> None:
    """The commands of the tutorial, in order."""
    (folder / "curve.csv").write_bytes((ROOT / "studies/gel_slab/measured/thin.csv").read_bytes())
    print(rso(folder, "new", "curve.csv", "--slab", "6", "--ball", "3"))
    print(rso(folder, "run", "study.toml"))
    print(rso(folder, "status", "study.toml"))
    for name, file in FIGURES.items():
        rso(folder, "plot", "study.toml", name, "--to", str(Path(__file__).with_name(file)))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
