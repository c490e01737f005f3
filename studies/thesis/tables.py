"""Write docs/thesis_tables.md and its figures: every table of the thesis beside what is computed here.

Run from the root of the checkout:

    python -m studies.thesis.tables             # runs what is missing (about half an hour on one core), then writes
    python -m studies.thesis.tables --stored    # writes from what has been run

Simulations are kept in studies/thesis/results (not under version control); an interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2

from rso.cli import main as rso
from rso.evaluation import Event, Finished
from studies.thesis import figures, identification, validation
from studies.thesis.rows import Outcomes
from studies.thesis.simulations import FOLDER, compute, stored

RESULTS = FOLDER / "results"
DOCS = FOLDER.parents[1] / "docs"


def page(outcomes: Outcomes, study: Mapping[str, Any] | None) -> str:
    """The page as Markdown; a number that page.md.j2 names and nobody computes is an error."""
    facts = {**identification.facts(outcomes, study), **validation.facts(outcomes)}
    text = (FOLDER / "page.md.j2").read_text(encoding="utf-8")
    template = jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True).from_string(text)
    return template.render(facts)


def _tell(event: Event) -> None:
    if isinstance(event, Finished):
        print(f"{event.n_done}/{event.n_runs} {event.name}: {event.state}, {event.wall_s:.0f} s", flush=True)


def main() -> int:
    """Run, compute, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stored", action="store_true", help="run nothing, use what is stored")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder for thesis_tables.md and figures/")
    arguments = parser.parse_args()
    if not arguments.stored:
        compute(RESULTS / "simulations", _tell)
        rso(["run", str(FOLDER / "study.toml"), "--jobs", "1"])
    found = RESULTS / "results.json"
    study = json.loads(found.read_text(encoding="utf-8")) if found.exists() else None
    outcomes = stored(RESULTS / "simulations")
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "thesis_tables.md").write_text(page(outcomes, study), encoding="utf-8", newline="\n")
    for name in figures.draw(outcomes, arguments.out / "figures"):
        print(arguments.out / "figures" / name)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
