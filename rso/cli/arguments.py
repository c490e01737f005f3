"""What may stand behind `rso` on a command line."""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import rso
from rso.cli import commands
from rso.contract import NewStudies, Option, capability
from rso.core.default_backend import DEFAULT_BACKEND, command_line

MAX_JOBS = 10_000  # as in [dispatch]
LABORATORY_HELP = """a folder, for example:
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
headers of a machine are named under "columns", with the keys of [columns] in a study.
What is not understood is refused with what is. Other keys are not used, which is said; @ranges: what \
this means is in docs/data_for_a_diagnosis.md"""


EXIT_CODES_HELP = """\
exit codes:
  0    done and verified
  1    the results folder or the workers cannot be used
  2    bad study or data file
  3    finished, some runs failed
  4    a candidate's rerun disagrees with its prediction
  5    a required parameter is not determined
  6    no candidate meets the targets and constraints
  7    with --strict: a validation fails
  130  interrupted; the same command goes on"""


class Parser(argparse.ArgumentParser):
    """A command line that names the nearest command or option for a typing mistake."""

    def error(self, message: str) -> NoReturn:
        """One sentence, with what may have been meant; exit code 2."""
        near = self._nearest(message)
        if (wrong := re.search(r"argument command: invalid choice: ('.*?')", message)) is not None:
            message = f"there is no command {wrong[1]}"
            near += "; all commands: rso --help"
        super().error(message + near)

    def _nearest(self, message: str) -> str:
        actions = self._actions
        known = [o for a in actions for o in a.option_strings]
        known += [c for a in actions if isinstance(a.choices, dict) for c in a.choices]
        words = [w.strip("',:") for w in message.split("(choose")[0].split()]
        near = [m for w in words if w not in known for m in difflib.get_close_matches(w, known, n=1, cutoff=0.6)]
        return f"; did you mean {near[0]}?" if near else ""

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse does; an option that is not known is compared with those of its command."""
        found, left = self.parse_known_args(args, namespace)
        if left:
            command = getattr(found, "parser", self)
            command.error(f"unknown argument {left[0]}")
        return found


def parser(arguments: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The whole command line; `call` of what it parses is the command.

    Only where `new` stands among the arguments is the backend loaded, whose options it has.
    """
    rso_ = Parser(
        prog="rso",
        description="Identify soft materials from indentation tests, and say what the model misses.",
        epilog=EXIT_CODES_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    rso_.add_argument("--version", action="version", version=f"rso {rso.__version__}")
    rso_.set_defaults(call=commands.first_steps)
    known = rso_.add_subparsers(metavar="command", parser_class=Parser)
    _new(known, _options() if "new" in arguments else ())
    _of_a_study(known)
    _blind(known)
    _in_and_out(known)
    _at_hand(known)
    text = "list what a study file may hold, or a result file holds: every key and its meaning"
    keys = known.add_parser("keys", help=text, description=text)
    which = "one table of a study file, results, or one result file as results.json"
    keys.add_argument("table", nargs="?", default="", help=which)
    keys.add_argument("--schema", action="store_true", help="the JSON schema of a study file, or of the result file")
    keys.set_defaults(call=commands.keys)
    for command in known.choices.values():
        command.set_defaults(parser=command)
    return rso_


def _options() -> Sequence[Option]:
    """Options of `rso new` that the backend has."""
    from rso.evaluation.adapters import load_backend

    studies = capability(load_backend(DEFAULT_BACKEND), NewStudies)
    return () if studies is None else studies.options()


def _new(known: Any, own: Sequence[Option]) -> None:
    text = "write a study file for your own data, with every guess marked, and check it"
    new = known.add_parser("new", help=text, description=text)
    new.add_argument("fit", nargs="+", metavar="FILE", help="a file to fit; book.xlsx#Sheet is a sheet of a workbook")
    several = new.add_mutually_exclusive_group()
    several.add_argument("--repeats", action="store_true", help="these files are repeats of one test")
    several.add_argument(
        "--specimens", action="store_true", help="each file is of a specimen of its own; their sizes go into a table"
    )
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
        help="what a column is called and its unit: --column Fz Kraft N. Behind these, flip turns its sign, zero 25.3 "
        "is what the file has at contact, and contact finds it. Codes: --column segment SegmentID 1=loading 2=skip. "
        "A deflection is subtracted by --column depth Piezo nm minus Deflection nm. A force from it: --column Fz "
        "Deflection nm stiffness '0.0876 N/m'. A frame's compliance: minus Load N compliance '0.4 mm/N'",
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
        ("status", commands.status, "say how far a study is, what it found, and what to do next"),
        (
            "diagnose",
            commands.diagnose,
            "say where the model misses the measurements and which unmodelled effect causes it",
        ),
        (
            "ladder",
            commands.ladder,
            "fit models from simple to rich and stop at the first that is consistent with the data",
        ),
        ("next", commands.next_test, "say which further experiment would constrain the least known parameter best"),
        ("report", commands.report, "write the pages again from what run, diagnose, ladder and next have found"),
    ):
        command = known.add_parser(name, help=text, description=text)
        command.add_argument("study", type=Path, help="study.toml, or the folder that holds it")
        command.add_argument("--out", type=Path, help="folder of the results (default: results/ beside the study)")
        _specimen(command)
        command.set_defaults(call=call)
        if name == "report":
            text = (
                "language of the pages, beside the English ones: de; studies without measurements are in English only"
            )
            command.add_argument("--language", choices=("en", "de"), default="en", help=text)
        else:
            text = "folder of the simulations, which studies may share, one at a time (default: that of the results)"
            command.add_argument("--store", type=Path, help=text)
        if name == "check":
            command.add_argument("--trust", action="store_true", help="load a backend that is not rso's own: its code")
        if name in ("check", "run", "diagnose", "ladder", "next"):
            command.add_argument("--jobs", type=_jobs, help="simulations at a time (default: dispatch.jobs)")
        if name in ("run", "diagnose", "ladder", "next"):
            command.add_argument("-q", "--quiet", action="store_true", help="no progress, only the answer")
        if name in ("run", "status"):
            command.add_argument("--json", action="store_true", help="the answer as JSON, and nothing else")
        if name == "run":
            command.add_argument("--fresh", action="store_true", help="move the old results aside and start again")
            command.add_argument(
                "--strict",
                action="store_true",
                help="exit code 7 if a held-out experiment is not predicted by the most likely values",
            )


def _specimen(command: argparse.ArgumentParser) -> None:
    command.add_argument("--specimen", metavar="NAME", help="one of a study with many specimens, by its name")


EXPORT_FORMATS = (
    "febio",
    "abaqus",
    "cards",
    "csv",
    "parquet",
    "arviz",
    "figures",
    "bibtex",
)  # those that are options; a backend may have more


def _in_and_out(known: Any) -> None:
    """The commands that write what was found for others, and read what others have computed."""
    text = "write results for other programs: input files, material cards, tables, posterior draws"
    export = known.add_parser("export", help=text, description=text)
    export.add_argument("study", type=Path, help="study.toml, or the folder that holds it")
    export.add_argument("formats", nargs="*", default=[], metavar="FORMAT", help="any format (none: which there are)")
    for name in EXPORT_FORMATS:
        export.add_argument(f"--{name}", action="append_const", dest="options", const=name, help=f"format {name}")
    export.add_argument("--candidate", type=int, help="values of a candidate (default: the most likely ones)")
    export.add_argument("--experiment", help="whose simulation is written (default: the first that is fitted)")
    export.add_argument("--to", type=Path, help="folder of the files (default: export/ within the results)")
    export.add_argument("--out", type=Path, help="folder of the results (default: results/ beside the study)")
    _specimen(export)
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
        epilog=LABORATORY_HELP.replace("@example", own["example"]).replace("@ranges", own["ranges"]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    blind.add_argument("folder", type=Path, help="a laboratory folder, or the folder that holds several")
    blind.add_argument("--out", type=Path, default=Path("answers"), help="where answers go (default: answers/)")
    blind.add_argument("--jobs", type=_jobs, default=2, help="simulations at a time")
    blind.add_argument("--seed", type=int, default=1, help="seed of the simulated data sets")
    blind.add_argument("--reruns", action="store_true", help="simulate finalists again: minutes a case")
    blind.add_argument("-q", "--quiet", action="store_true", help="no progress, only the answer")
    blind.set_defaults(call=commands.blind)


def _at_hand(known: Any) -> None:
    """Small commands about what is there already."""
    text = "write a worked study into a folder; without a name list them"
    example = known.add_parser("example", help=text, description=text)
    example.add_argument("name", nargs="?", help="name of the example")
    example.add_argument("--to", type=Path, help="folder of the study (default: its name)")
    example.set_defaults(call=commands.example)
    for name, call, text in (
        ("open", commands.open_page, "show the pages of a study in the browser"),
        ("plot", commands.plot, "write a figure of the report as a file; without a name list them"),
    ):
        command = known.add_parser(name, help=text, description=text)
        command.add_argument("study", type=Path, help="study.toml, its folder, or a folder of results")
        command.add_argument("--out", type=Path, help="folder of the results (default: results/ beside the study)")
        _specimen(command)
        command.set_defaults(call=call)
        if name == "open":
            pages = ("report", "specimens", "diagnosis", "ladder", "next")
            command.add_argument("--page", choices=pages, help="which page (default: the first that is there)")
        else:
            command.add_argument("figure", nargs="?", help="name of the figure")
            command.add_argument("--to", type=Path, help="file, .svg, .pdf or .png (default: FIGURE.svg)")
    text = "compare two runs: their answers, and what differs between their studies"
    compare = known.add_parser("compare", help=text, description=text)
    compare.add_argument("first", type=Path, metavar="A", help="a study, or a folder of results")
    compare.add_argument("second", type=Path, metavar="B", help="the other one")
    compare.add_argument("--json", action="store_true", help="the comparison as JSON, and nothing else")
    compare.set_defaults(call=commands.compare)
    text = "check whether this machine can run studies, and how fast"
    doctor = known.add_parser("doctor", help=text, description=text)
    doctor.add_argument("--fast", action="store_true", help="without the simulation that is timed")
    doctor.add_argument("--json", action="store_true", help="the findings as JSON, and nothing else")
    doctor.set_defaults(call=commands.doctor)
    text = "print a completion script: rso completion bash > ~/.local/share/bash-completion/completions/rso"
    completion = known.add_parser("completion", help="print a completion script for a shell", description=text)
    completion.add_argument("shell", choices=("bash", "zsh", "tcsh"))
    completion.set_defaults(call=completion_script)


def completion_script(options: argparse.Namespace, command: str) -> int:
    """Print what a shell needs to complete commands, options and files."""
    import shtab

    whole = parser()
    for action in [a for p in _parsers(whole) for a in p._actions]:
        if action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(whole, options.shell))
    return 0


def _parsers(whole: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """A parser and those of its commands."""
    inner = [p for a in whole._actions if isinstance(a.choices, dict) for p in a.choices.values()]
    return [whole, *inner]


def _jobs(text: str) -> int:
    """A number of jobs; argparse turns the error into exit code 2."""
    number = int(text[:20]) if text.isdecimal() else 0  # Python reads no number of thousands of digits
    if not 1 <= number <= MAX_JOBS:
        raise argparse.ArgumentTypeError(f"{text[:40]}: a number from 1 to {MAX_JOBS} is needed")
    return number
