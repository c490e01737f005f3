"""What may stand behind `rso` on a command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rso
from rso.cli import commands
from rso.contract import NewStudies, Option, capability
from rso.core.default_backend import USE, command_line

MOST_JOBS = 10_000  # as in [dispatch]
LABORATORY = """a folder, for example:
  mp_load.csv       mp_ with anything, or a name with less than two numbers: a force curve at the top
  mp_cycle_30.csv   loaded and unloaded at the top with 30 mm/min
  point_20_0.csv    pressed at x = 20, y = 0 mm; point_2.5_-3.csv at (2.5, -3) mm
  profile.csv       displacements of surface marks while pressed at the top
  nominal.json:
{
@example
  "noise": {"force_N": 0.003, "depth_mm": 0.005, "repeat_gain": 0.01, "profile_mm": 0.05},
  "rate_mm_per_min": 30,
  "remark": "whatever people should know: not read"
}
headers of a machine are named under "columns", with the keys of [columns] in a study;
what is not understood is refused with what is, other keys are not used, which is said; @ranges: what \
this means is in docs/data_for_a_diagnosis.md"""


def parser(arguments: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The whole command line; `call` of what it parses is the command.

    Only where `new` stands among the arguments is the backend loaded, whose options it has.
    """
    rso_ = argparse.ArgumentParser(
        prog="rso",
        description="Response surface optimisation for indentation tests.",
        epilog="exit codes: 0 done and verified, 1 results folder or workers unusable, 2 bad study or data, 3 some "
        "runs failed, 4 not verified, 5 a required parameter is not determined, 6 no candidate meets the targets and "
        "constraints, 7 a validation fails (--strict), 130 interrupted (resumable)",
    )
    rso_.add_argument("--version", action="version", version=f"rso {rso.__version__}")
    known = rso_.add_subparsers(required=True, metavar="command")
    _new(known, _options() if "new" in arguments else ())
    _of_a_study(known)
    _blind(known)
    _in_and_out(known)
    text = "list what a study file may hold: every table and key, its values, default and meaning"
    keys = known.add_parser("keys", help=text, description=text)
    keys.add_argument("table", nargs="?", default="", help="one table and those within, for example search")
    keys.add_argument("--schema", action="store_true", help="the JSON schema of a study file, for editors")
    keys.set_defaults(call=commands.keys)
    return rso_


def _options() -> Sequence[Option]:
    """Options of `rso new` that the backend has."""
    from rso.evaluation.adapters import load_backend

    studies = capability(load_backend(USE), NewStudies)
    return () if studies is None else studies.options()


def _new(known: Any, own: Sequence[Option]) -> None:
    text = "write a first study file from data files, what they tell filled in and guesses marked, and check it"
    new = known.add_parser("new", help=text, description=text)
    new.add_argument("fit", nargs="+", metavar="FILE", help="a file to fit; book.xlsx#Sheet is a sheet of a workbook")
    new.add_argument("--repeats", action="store_true", help="these files are repeats of one test")
    new.add_argument("--validate", nargs="+", default=[], metavar="FILE", help="a file only looked at in the end")
    for o in own:
        _add(new, o)
    new.add_argument(
        "--point",
        nargs=2,
        type=float,
        metavar=("X", "Y"),
        help="where it was pressed, mm from the top "
        "(default: as the name of a file says, point_20_0.csv, or else the top)",
    )
    new.add_argument(
        "--column",
        nargs="+",
        action="append",
        default=[],
        metavar=("NAME", "WORD"),
        help="what a column is called in the files and its unit: --column Fz Kraft N; behind these flip "
        "turns its sign, contact finds its zero; --column segment SegmentID 1=loading 2=skip says what "
        "codes mean; --column depth Piezo nm minus Deflection nm subtracts a deflection, --column Fz "
        "Deflection nm stiffness '0.0876 N/m' makes a force of it (minus Load N compliance '0.4 mm/N' for "
        "a frame)",
    )
    new.add_argument("--out", type=Path, default=Path("study.toml"), help="the study file (default: study.toml)")
    new.set_defaults(call=commands.new, of_backend=tuple(own))


def _add(new: argparse.ArgumentParser, o: Option) -> None:
    """An option of the backend; how many values it has is checked with what they are."""
    units = " and ".join(dict.fromkeys(u for u in o.units if u in ("mm", "deg")))
    words = f"{o.help} ({units})" if units else o.help
    if not o.words:
        new.add_argument(f"--{o.name}", action="store_const", const=[], help=words)
    elif o.least is None and not o.repeated:
        new.add_argument(f"--{o.name}", nargs=len(o.words), help=words, metavar=o.words)
    else:
        names = o.words[0] if o.repeated else (o.words[0], " ".join(o.words[1:]).replace("[", "").replace("]", ""))
        new.add_argument(f"--{o.name}", nargs="+", help=words, metavar=names)


def _of_a_study(known: Any) -> None:
    for name, call, text in (
        ("check", commands.check, "read a study, say what would run and about how long; compute nothing"),
        ("run", commands.run, "run a study, or go on with it, and write its report"),
        ("status", commands.status, "say how far a study is"),
        (
            "diagnose",
            commands.diagnose,
            "say where the model misses the measurements and which unmodelled effect causes it",
        ),
        ("ladder", commands.ladder, "climb from the simplest model to the one that the data ask for, and not further"),
        ("next", commands.next_test, "say which experiment, not done yet, would tell most of what is known worst"),
        ("report", commands.report, "write the pages again from what run, diagnose, ladder and next have found"),
    ):
        command = known.add_parser(name, help=text, description=text)
        command.add_argument("study", type=Path, help="study.toml, or the folder that holds it")
        command.add_argument("--out", type=Path, help="folder of the results (default: results/ beside the study)")
        command.set_defaults(call=call)
        if name != "report":
            text = "folder of the simulations, which studies may share, one at a time (default: that of the results)"
            command.add_argument("--store", type=Path, help=text)
        if name == "check":
            command.add_argument("--trust", action="store_true", help="load a backend that is not rso's own: its code")
        if name in ("check", "run", "diagnose", "ladder", "next"):
            command.add_argument("--jobs", type=_jobs, help="simulations at a time (default: dispatch.jobs)")
        if name == "run":
            command.add_argument("--fresh", action="store_true", help="move the old results aside and start again")
            command.add_argument(
                "--strict",
                action="store_true",
                help="exit code 7 where an experiment kept for the end is not predicted by the most likely values",
            )


FORMATS = ("febio", "abaqus", "cards", "csv", "parquet", "arviz")  # those that are options; a backend may have more


def _in_and_out(known: Any) -> None:
    """The commands that write what was found for others, and read what others have computed."""
    text = "write results for other programs: input files, material cards, tables, posterior draws"
    export = known.add_parser("export", help=text, description=text)
    export.add_argument("study", type=Path, help="study.toml, or the folder that holds it")
    export.add_argument("formats", nargs="*", default=[], metavar="FORMAT", help="any format (none: which there are)")
    for name in FORMATS:
        export.add_argument(f"--{name}", action="append_const", dest="options", const=name, help=f"format {name}")
    export.add_argument("--candidate", type=int, help="values of a candidate (default: the most likely ones)")
    export.add_argument("--experiment", help="whose simulation is written (default: the first that is fitted)")
    export.add_argument("--to", type=Path, help="folder of the files (default: export/ within the results)")
    export.add_argument("--out", type=Path, help="folder of the results (default: results/ beside the study)")
    export.set_defaults(call=commands.export)
    text = "store runs that were made elsewhere: a CSV with columns of parameters, travel and channels"
    load = known.add_parser("import", help=text, description=text)
    load.add_argument("study", type=Path, help="study.toml, or the folder that holds it")
    load.add_argument("table", type=Path, help="the CSV; docs/in_and_out.md says what it holds")
    load.add_argument("--out", type=Path, help="folder of the results (default: results/ beside the study)")
    load.set_defaults(call=commands.import_runs)


def _blind(known: Any) -> None:
    own = command_line().LABORATORY
    words = (
        "Diagnose every laboratory folder below FOLDER: nominal.json says what the experimenter believes, the CSV "
        "files hold what was measured. Answers are written one by one; folders that have one are passed over, an error "
        "is none."
    )
    blind = known.add_parser(
        "blind",
        help="diagnose laboratory folders (nominal.json, CSV)",
        description=words,
        epilog=LABORATORY.replace("@example", own["example"]).replace("@ranges", own["ranges"]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    blind.add_argument("folder", type=Path, help="a laboratory folder, or the folder that holds several")
    blind.add_argument("--out", type=Path, default=Path("answers"), help="where answers go (default: answers/)")
    blind.add_argument("--jobs", type=_jobs, default=2, help="simulations at a time")
    blind.add_argument("--seed", type=int, default=1, help="seed of the simulated data sets")
    blind.add_argument("--reruns", action="store_true", help="compute finalists anew: minutes a case")
    blind.set_defaults(call=commands.blind)


def _jobs(text: str) -> int:
    """A number of jobs; argparse turns the error into exit code 2."""
    number = int(text[:20]) if text.isdecimal() else 0  # Python reads no number of thousands of digits
    if not 1 <= number <= MOST_JOBS:
        raise argparse.ArgumentTypeError(f"{text[:40]}: a number from 1 to {MOST_JOBS} is needed")
    return number
