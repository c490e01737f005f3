"""Answers to blind cases on any body, in a given order, with those of the simplest serious rival beside them.

    python benchmarks/blind_answers.py CASES --out ANSWERS [--order FILE] [--jobs 1]

`rso blind` reads a laboratory's folder of an ellipsoid only; here the same study is written for a slab or a puck as
well, with the default mesh and ranges, and judged by the same code, without simulating finalists again.  On flat bodies
effects that break the revolution (`IN_SPACE`) need runs in three dimensions and are left out, as in
`benchmarks/diagnosis_flat.py`.  FILE holds names of cases, one a line.  The rival is `rival` of `benchmarks/diagnosis`:
generalised least squares with the covariance of the diagnosis, judged by BIC; it stands in the answer as "rival".
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")

from pathlib import Path
from types import SimpleNamespace
from typing import Any

sys.path.append(str(Path(__file__).parent / "diagnosis"))
from diagnosis_flat import IN_SPACE
from scores import rival

from rso.calibration import result_files
from rso.core.default_backend import DEFAULT_BACKEND
from rso.discrepancy import blind, diagnosis
from rso.discrepancy.study_diagnosis import Asked, ask
from rso.evaluation import WorkerPool
from rso.evaluation.adapters import Source
from rso.evaluation.store import RunStore
from rso.study import laboratory_folder
from rso.study.laboratory_nominal import Nominal, read_nominal
from rso.study.loader import load_study

SIZES = {"slab": {"thickness_mm": "thickness"}, "cylinder": {"radius_mm": "radius", "height_mm": "height"}}


def nominal(folder: Path) -> Nominal:
    """What nominal.json says, of a flat body as `read_nominal` gives it for the ellipsoid."""
    data = json.loads((folder / "nominal.json").read_text(encoding="utf-8"))
    body, ball = data["specimen"], data["indenter"]
    if body["shape"] not in SIZES:
        return read_nominal(folder)
    specimen = {"shape": body["shape"]} | {key: body[name] for name, key in SIZES[body["shape"]].items()}
    indenter = {"shape": ball["shape"], "radius": ball["radius_mm"]}
    settings = {"specimen": specimen, "indenter": indenter, "support": {"kind": data["support"]}}
    return Nominal(settings, data["noise"], data["rate_mm_per_min"], ())


def asked(case: Path, out: Path, seed: int) -> Asked:
    """The study of a case, written below `out`, and what is asked of it."""
    own = out / "studies" / case.name
    own.mkdir(parents=True, exist_ok=True)
    text = laboratory_folder.study_of_folder(case, seed, own)
    if '"ellipsoid"' not in text:
        text = re.sub(r"point = \[[^]]*\],? ?", "", text)
        (own / "study.toml").write_text(text, encoding="utf-8")
        every = [e.name for e in ask(load_study(own / "study.toml")).effects if e.place is None]
        effects = f"effects = {json.dumps([n for n in every if n not in IN_SPACE])}"
        text = text.replace("[diagnose]", f"[diagnose]\n{effects}")
    (own / "study.toml").write_text(text, encoding="utf-8")
    return ask(load_study(own / "study.toml"))


def main() -> None:
    """Answer the cases that have no answer yet."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--order", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    o = parser.parse_args()
    names = o.order.read_text().split() if o.order else [c.name for c in blind.cases_of(o.cases)]
    o.out.mkdir(parents=True, exist_ok=True)
    seen: list[tuple[Any, Any]] = []
    opened = diagnosis._opened

    def noted(library: Any, y: Any, *rest: Any) -> Any:
        found = opened(library, y, *rest)
        seen.append((found.evidence, y))
        return found

    diagnosis._opened = noted
    laboratory_folder.read_nominal = nominal
    blind._asked, blind._tell = asked, lambda taken, say: None
    blind._taken = lambda case, of: {}
    with RunStore(o.out / "store") as store, WorkerPool(o.jobs, source=Source(DEFAULT_BACKEND)) as pool:
        for name, found in blind.diagnose_cases([o.cases / n for n in names], o.out, store, pool, seed=1, say=print):
            if "error" not in found and seen:
                evidence, y = seen[-1]
                said = rival(SimpleNamespace(evidence=evidence), SimpleNamespace(Y=y[None]))
                best = {"gap": bool(said.gap[0]), "best": said.best[0], "named": sorted(said.named[0])}
                result_files.write_results(o.out / f"{name}.json", {**found, "rival": best})
            seen.clear()


if __name__ == "__main__":
    main()
