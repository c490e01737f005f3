"""`rso example`: a worked study to start from."""

from __future__ import annotations

import argparse
import shlex
import shutil
import tomllib
from pathlib import Path

import rso
from rso.cli import output
from rso.study.errors import choices_text

EXAMPLE_PARTS = ("study.toml", "README.md", "measured")  # what a study consists of
PACKED_EXAMPLES = Path(rso.__file__).parent / "examples"  # in an installed package
REPOSITORY_STUDIES = Path(rso.__file__).parent.parent / "studies"  # in the repository


def examples() -> dict[str, Path]:
    """Folders of the worked studies by name."""
    place = PACKED_EXAMPLES if PACKED_EXAMPLES.is_dir() else REPOSITORY_STUDIES
    return {f.parent.name: f.parent for f in sorted(place.glob("*/study.toml"))}


def write_example(options: argparse.Namespace) -> int:
    """Copy a study into a folder of its name; without a name list them.  Nothing is overwritten."""
    known = examples()
    if options.name is None:
        output.say("examples; rso example NAME writes one into a folder of that name:")
        for name, place in known.items():
            title = tomllib.loads((place / "study.toml").read_text("utf-8"))["study"]["title"]
            output.lines([f"  {name:16}{title}"])
        return 0
    if options.name not in known:
        output.complain(f"example {options.name!r} is unknown; {choices_text(options.name, known)}")
        return 2
    folder: Path = options.to or Path(options.name)
    if folder.exists():
        output.complain(f"{folder}: exists already; give another folder with --to")
        return 2
    folder.mkdir(parents=True)
    for part in EXAMPLE_PARTS:
        source = known[options.name] / part
        if source.is_dir():
            shutil.copytree(source, folder / part)
        elif source.is_file():
            shutil.copy(source, folder / part)
    study = shlex.quote(str(folder))
    output.say(f"{folder}: written")
    output.say(f"  next: rso check {study}, then rso run {study}")
    return 0
