"""`rso check`: what the backend takes an experiment for, and that what others refuse is not called good."""

import re
from pathlib import Path

import sample_studies as studies

from rso.study import load
from rso.study.checking import check

OWN = {
    "backend": 'use = "fem_backend.backend:BACKEND"',
    "backend__settings": "indenter = { radius = 5.0, shaft = true }\nsupport = { kind = 'bowl', clearance = 2.0 }",
    "search": None,
}
SECOND = 'name = "side"\nrole = "validate"\ndata = "top.csv"\nnoise = { Fz = "0.02 mN" }\n'


def said(folder: Path, settings: str = "", trust: bool = False, **changes: str | None) -> list[str]:
    """Lines of a check of a study with a second experiment that has settings of its own."""
    both = "\n[[experiments]]\n".join([studies.SECTIONS["[experiments]"], SECOND + settings])
    return check(load(studies.write(folder, **{**OWN, "experiments": both, **changes})), folder / "results", trust)


def whole(lines: list[str]) -> list[str]:
    """Lines with their continuations."""
    return re.sub(r"\n {6}", " ", "\n".join(lines)).split("\n")


def test_what_the_backend_takes_an_experiment_for(tmp_path):
    bowl = "support = { kind = 'bowl' }"
    lines = whole(said(tmp_path, f"settings = {{ point = [10.0, 0.0], indenter = {{ shaft = false }}, {bowl} }}"))
    stated = next(line for line in lines if "settings as stated" in line)
    assert "indenter.radius = 5.0" in stated and "indenter.shaft = true" in stated and "bowl_clearance = 2.0" in stated
    default = next(line for line in lines if "default" in line)
    assert "specimen.semi_axes = [60.0, 35.0, 35.0]" in default and "indenter.radius" not in default
    at = next(n for n, line in enumerate(lines) if "'side'" in line)
    own, *_ = (line for line in lines[at:] if "differs" in line)
    for words in ("point = [10.0, 0.0] (study: [0.0, 0.0])", "indenter.radius = 3.0 (study: 5.0)",
                  "indenter.shaft = false (study: true)", "bowl_clearance = 1.0 (study: 2.0)"):  # fmt: skip
        assert words in own
    assert not any("differs" in line for line in lines[:at])


def test_a_table_that_replaces_that_of_the_study_is_remarked_upon(tmp_path):
    lines = said(tmp_path, "settings = { indenter = { shaft = false } }")
    (line,) = (line for line in lines if "as a whole" in line)
    assert "settings.indenter" in line and "radius = 5.0" in line and "shaft" not in line.split("as a whole")[1]
    lines = said(tmp_path, "settings = { indenter = { shaft = false, radius = 5.0 } }")
    assert not any("as a whole" in line for line in lines)
    foreign = {"backend": studies.SECTIONS["backend"], "backend__settings": "thickness = { mean = 8.0, error = 1 }"}
    lines = said(tmp_path, "settings = { thickness = { mean = 9.0 } }", **foreign)  # without its backend too
    assert any("as a whole" in line and "error = 1" in line for line in lines)
