"""The commands: each calls a stage, prints what it says and returns an exit code."""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rso.calibration.exit_codes import EXIT_FAILED_RUNS
from rso.cli import output
from rso.contract import Option
from rso.core import disk
from rso.core.default_backend import DEFAULT_BACKEND
from rso.core.symbols import in_letters

EXIT_BROKEN, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 1, 2, 130  # docs/cli.md has the whole table


def check(options: argparse.Namespace, command: str) -> int:
    from rso.cli.checking import check_lines

    if _many(options):
        from rso.cli.specimens import check_specimens

        return check_specimens(options, _folder(options, _place(options)))
    study = _study(options)
    folder = _folder(options, study.folder)
    if study.objectives is not None:
        from rso.cli.objectives import check_objectives

        output.lines(check_objectives(study, folder, options.trust))
        return 0
    output.lines(check_lines(study, folder, options.trust, _store(options, folder), options.jobs))
    return 0


def new(options: argparse.Namespace, command: str) -> int:
    from rso.evaluation.adapters import load_backend
    from rso.study.new_study import NewTest, note_on_single_tests, specimens_texts, study_text

    out: Path = options.out
    own = out.stem == "study"  # a folder of results, and a table, belong to one study file
    table = out.with_name("specimens.csv" if own else f"{out.stem}_specimens.csv")
    point = None if options.point is None else tuple(options.point)
    rows = None
    try:
        columns: dict[str, dict[str, Any]] = {}
        for name, words in map(_column, options.column):
            if columns.setdefault(name, words) is not words:
                raise ValueError(f"--column {name}: is given twice")
        test = NewTest(_given(options), point, options.repeats, columns, options.specimens)
        if options.specimens and options.validate:
            raise ValueError("--validate: of specimens a test to validate is a column data.NAME of their table")
        if options.specimens:
            text, rows = specimens_texts(out, table, load_backend(DEFAULT_BACKEND), test, options.fit)
        else:
            text = study_text(out, load_backend(DEFAULT_BACKEND), test, options.fit, options.validate)
    except ValueError as error:
        output.complain(error)
        return EXIT_BAD_INPUT
    _written(out, text, table if rows is not None else None, rows or "")
    output.say(f"{out}: written; look at the lines with <-")
    if rows is not None:
        output.say(f"{table}: written; sizes and remarks of each specimen go there")
    print()
    folder = out.absolute().parent / ("results" if own else f"results_{out.stem}")
    there = [] if own else ["--out", str(folder)]
    then = f"then: {shlex.join(['rso', 'run', str(out), *there])}"
    if rows is not None:
        from rso.cli.specimens import check_specimens

        found = check_specimens(argparse.Namespace(study=out, trust=False), folder)
        output.say(f"first: write the sizes of each specimen into {table}; they are all alike now")
        output.say(then)
        return found
    from rso.cli.checking import check_lines
    from rso.study.loader import load_study

    note = note_on_single_tests(test, options.fit)
    study = load_study(out)
    output.lines([*check_lines(study, folder, False, folder), *([note] if note else []), then])
    return 0


def _written(out: Path, text: str, table: Path | None, rows: str) -> None:
    """Write a new study, and its table if it has one, once it has proved to run; StudyError, and no file, else."""
    from rso.calibration.plan import make_plan
    from rso.population.plans import specimen_plans
    from rso.study.errors import StudyError
    from rso.study.loader import load_study
    from rso.study.specimens import load_specimens

    draft = out.with_name(f"{out.name}.draft")
    try:
        if table:
            disk.replace(table, rows)
        disk.replace(draft, text)
        if table:
            specimen_plans(load_specimens(draft))
        else:
            make_plan(load_study(draft))
        draft.replace(out)
    except StudyError as error:  # nothing is left behind that the next try would find
        said = [p.replace(str(draft), str(out)) for p in error.problems]
        raise StudyError([*said, "the study that this would be cannot run; it was not written"]) from error
    finally:
        draft.unlink(missing_ok=True)
        if table and not out.exists():
            table.unlink(missing_ok=True)


def _given(options: argparse.Namespace) -> dict[str, tuple[float | str, ...]]:
    """The backend's own options that were given: name → values; ValueError naming option, value and unit."""
    found = {o: getattr(options, o.name.replace("-", "_")) for o in options.of_backend}
    return {o.name: _values(o, words) for o, words in found.items() if words is not None}


def _values(option: Option, words: Sequence[str]) -> tuple[float | str, ...]:
    """Values of an option by what was written: numbers in its units, files by absolute paths."""
    least = len(option.words) if option.least is None else option.least
    most = len(words) if option.repeated else len(option.words)
    usage = f"--{option.name} {' '.join(option.words)}"
    if not least <= len(words) <= most:
        raise ValueError(f"--{option.name} {shlex.join(words)}: {usage} is expected")
    values: list[float | str] = []
    for k, word in enumerate(words):
        unit = option.units[min(k, len(option.units) - 1)]
        if unit == "file":
            if not Path(word).is_file():
                raise ValueError(f"--{option.name} {word}: there is no such file")
            values.append(str(Path(word).absolute()))
        else:
            values.append(word if unit == "text" else _number(f"{usage}: ", word, unit))
    return tuple(values)


def _number(place: str, word: str, unit: str) -> float:
    """A number in a unit, which it may have behind itself or not; ValueError for another."""
    from rso.core.units import value_in_unit

    try:
        try:
            value: float | str = float(word)
        except ValueError:
            value = word
        return value_in_unit(value, unit)
    except ValueError as error:
        raise ValueError(f"{place}{error}") from error


SEGMENT_CODES = ("loading", "hold", "creep", "unloading", "skip")
COLUMN_FLAGS: dict[str, dict[str, Any]] = {"flip": {"flip": True}, "contact": {"zero": "contact"}}


def _column(words: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """A column by its words: name, header, unit, whether its sign is turned, its zero the contact that it shows."""
    at = next((k for k, word in enumerate(words) if k > 1 and word == "minus"), len(words))
    rest: list[str] = list(words[:at])
    table: dict[str, Any] = {}
    if at < len(words):
        table["minus"] = _minus(words, words[at + 1 :])
    codes = dict(word.rsplit("=", 1) for word in rest[2:] if word.rpartition("=")[2] in SEGMENT_CODES)
    if codes:
        rest = rest[:2] + [word for word in rest[2:] if word.rpartition("=")[2] not in SEGMENT_CODES]
        table["values"] = codes
    table |= _flags(rest, 2, {**COLUMN_FLAGS, "stiffness": None, "zero": None})
    if table.get("zero", "contact") != "contact":
        try:
            table["zero"] = float(table["zero"])
        except ValueError as error:
            text = f"zero {table['zero']}: give a number as the file has it, or contact"
            raise ValueError(f"--column {shlex.join(words)}: {text}") from error
    if len(rest) not in (2, 3):
        text = (
            "give NAME HEADER [UNIT] [stiffness K] [flip] [contact or zero VALUE] [minus HEADER …], such as Fz Kraft N "
            "flip, or segment HEADER 1=loading 2=skip"
        )
        raise ValueError(f"--column {shlex.join(words)}: {text}")
    return rest[0], dict(zip(("header", "unit"), rest[1:], strict=False)) | table


def _minus(words: Sequence[str], behind: Sequence[str]) -> dict[str, Any]:
    """What is subtracted of a column by the words behind minus: header, unit, whether its sign is turned, stiffness."""
    rest = list(behind)
    table = _flags(rest, 1, {"flip": COLUMN_FLAGS["flip"], "stiffness": None, "compliance": None})
    if len(rest) not in (1, 2):
        text = "behind minus give HEADER [UNIT] [stiffness K or compliance C] [flip], such as minus Deflection nm"
        raise ValueError(f"--column {shlex.join(words)}: {text}")
    return dict(zip(("header", "unit"), rest, strict=False)) | table


def _flags(rest: list[str], first: int, known: Mapping[str, dict[str, Any] | None]) -> dict[str, Any]:
    """The keys that the last of some words say, which are taken off; those of no value of their own have it behind."""
    table: dict[str, Any] = {}
    while len(rest) > first:
        if (flag := known.get(rest[-1])) is not None:
            table |= flag
            rest.pop()
        elif len(rest) > first + 1 and rest[-2] in known and known[rest[-2]] is None:
            value = rest.pop()
            table[rest.pop()] = value
        else:
            break
    return table


def keys(options: argparse.Namespace, command: str) -> int:
    from rso.result_types import reference as result_files
    from rso.study.keys import reference, study_schema

    of_results = options.table.endswith(".json")
    try:
        if options.schema:
            found = result_files.result_schema(options.table) if of_results else study_schema()
            print(json.dumps(found, indent=1, ensure_ascii=False))
            return 0
        if of_results or options.table == "results":
            lines = result_files.page(options.table if of_results else "")
        else:
            lines = reference(options.table)
    except ValueError as error:
        output.complain(error)
        return EXIT_BAD_INPUT
    output.lines(lines)
    return 0


def run(options: argparse.Namespace, command: str) -> int:
    from rso.evaluation import executor
    from rso.study.sources import source_of

    if _many(options, named=True):
        from rso.cli.specimens import run_many

        folder = _folder(options, _place(options), alone=False)
        return run_many(options, folder, (options.store or folder).absolute(), command)
    study = _study(options)
    jobs = options.jobs or study.dispatch.jobs
    folder = _folder(options, study.folder)
    if study.objectives is not None:
        from rso.cli.objectives import run_objectives

        return run_objectives(options, study, folder, _store(options, folder), command)
    if options.fresh and folder.exists():
        from rso.calibration.result_files import may_be_moved

        may_be_moved(folder, study.file, study.inputs())
    plan = _plan(study) if study.dispatch.engine != "local" else None  # a bad study asks for no cluster
    warm = options.fresh or not folder.exists()  # there will be simulations: workers start while the rest is imported
    with executor(study.dispatch, jobs, source_of(study), folder, warm) as pool:
        from rso.calibration.pipeline import run_study
        from rso.calibration.result_files import claim
        from rso.calibration.stages import NothingToFit
        from rso.cli.progress import Progress
        from rso.evaluation.store import RunStore, set_aside

        plan = plan or _plan(study)
        if options.fresh and folder.exists():
            aside = set_aside(folder)
            if not options.json:
                output.say(f"old results moved to {aside}")
        claim(folder, study.file)
        with RunStore(_store(options, folder)) as store, Progress(options.quiet or options.json) as progress:
            try:
                found = run_study(
                    plan,
                    store,
                    pool,
                    folder,
                    command=command,
                    jobs=jobs,
                    watch=progress.watch,
                    say=progress.say,
                    strict=options.strict,
                )
            except NothingToFit as error:
                return output.say_why_ended(EXIT_FAILED_RUNS, f"stopped: {error}")
    files = []
    if study.report.html or study.report.pdf:
        from rso.report import render

        files = render(found, folder, html=study.report.html, pdf=study.report.pdf)
    if options.json:
        from rso.cli.answer import condensed

        told = {"results": str(folder), **condensed(found), "pages": [str(f) for f in files]}
        print(json.dumps(told, indent=1, ensure_ascii=False))
        return int(found["exit_code"])
    from rso.cli.answer import verdict_lines
    from rso.report.terminal import summary

    print()
    output.bold(found["study"]["title"])
    for mark, text in verdict_lines(found):
        output.marked_line(mark, text)
    if not options.quiet:
        output.lines(summary(found))
    output.lines([f"  {file}" for file in files])
    _without_pdf(study.report.pdf)
    return output.say_why_ended(int(found["exit_code"]), found["exit_reason"])


def _without_pdf(wanted: bool) -> None:
    """A line where a PDF is wanted and what writes it is not installed."""
    from rso.report.layout.page import has_pdf

    if wanted and not has_pdf():
        output.say("  no PDF: it needs typst: pip install 'rso[pdf]'")


def diagnose(options: argparse.Namespace, command: str) -> int:
    from rso.calibration.plan import source_of
    from rso.discrepancy import LibraryUnanswered
    from rso.discrepancy.study_diagnosis import ask, run_diagnosis

    study = _study(options)
    asked = ask(study)
    folder = _folder(options, study.folder)
    with _workplace(options, study, source_of(study), folder) as (store, pool, progress):
        try:
            found = run_diagnosis(asked, store, pool, folder, command=command, watch=progress.watch, say=progress.say)
        except LibraryUnanswered as error:  # any other error is a fault of the program, and says where
            return output.say_why_ended(EXIT_FAILED_RUNS, f"stopped: {error}")
    files = [folder / "diagnosis.json"]
    if study.report.html or study.report.pdf:
        from rso.report import render_diagnosis

        files += render_diagnosis(found, folder, html=study.report.html, pdf=study.report.pdf)
        files += _told_again(folder, study.report)
    print()
    failed = [f"failed simulation, its neighbours stand for it: {line}" for line in found["failed_runs"]]
    for line in [*found["words"], *failed]:
        print(
            textwrap.fill(
                in_letters(line, [*found["units"], *found["fixed"]]), min(shutil.get_terminal_size().columns, 100)
            )
        )
    print()
    for file in files:
        output.say(file)
    failed = found["failed_runs"]
    return (
        output.say_why_ended(EXIT_FAILED_RUNS, f"{len(failed)} failed simulations; the first: {failed[0]}")
        if failed
        else 0
    )


def _told_again(folder: Path, pages: Any) -> list[Path]:
    """The pages of a run that is there, now that a diagnosis says where its model is off."""
    from rso.calibration.results import RUN_SCHEMA
    from rso.report import render

    path = folder / "results.json"
    try:
        found = disk.read_json(path)
    except (OSError, ValueError):  # there is none, or a damaged one, which the next run writes anew
        return []
    return render(found, folder, html=pages.html, pdf=pages.pdf) if found.get("schema") == RUN_SCHEMA else []


def ladder(options: argparse.Namespace, command: str) -> int:
    from rso.model_selection.ladder_results import LADDER_FILE, ladder_data, write_ladder
    from rso.model_selection.study_ladder import ladder_plan, run_ladder

    study = _study(options)
    plan = ladder_plan(study)
    folder = _folder(options, study.folder)
    with _workplace(options, study, plan.source, folder) as (store, pool, progress):
        climbed = run_ladder(plan, store, pool, watch=progress.watch, say=progress.say)
    found = ladder_data(plan, climbed, command)
    write_ladder(folder, found)
    files = [folder / LADDER_FILE]
    if study.report.html or study.report.pdf:
        from rso.report.model_selection.report import render_ladder

        files += render_ladder(found, folder, html=study.report.html, pdf=study.report.pdf)
    print()
    output.say(found["study"]["title"])
    output.wrapped_sentences(
        [*(s["words"] for s in found["steps"]), found["words"], *(f"warning: {w}" for w in found["warnings"])]
    )
    print(f"  {found['counts']['runs']} simulations, {found['timings']['wall']:.0f} s")
    for file in files:
        output.say(f"  {file}")
    return 0 if found["chosen"] else output.say_why_ended(EXIT_FAILED_RUNS, f"no level has an answer: {found['words']}")


def next_test(options: argparse.Namespace, command: str) -> int:
    from rso.calibration.plan import make_plan
    from rso.next_experiment.design_results import design_data, markdown, write_design
    from rso.next_experiment.study_design import run_next

    study = _study(options)
    plan = make_plan(study)
    folder = _folder(options, study.folder)
    with _workplace(options, study, plan.source, folder) as (store, pool, progress):
        further = run_next(plan, store, pool, watch=progress.watch, say=progress.say)
    found = design_data(plan, further, command)
    files = [write_design(folder, found)]
    if study.report.html or study.report.pdf:
        from rso.report.optimal_design.report import render_next

        files += render_next(found, folder, html=study.report.html, pdf=study.report.pdf)
    print()
    output.say(found["study"]["title"])
    unanswered = (f"no answer: {n}: {w}" for n, w in found["problems"].items())
    names = [p["name"] for p in found["parameters"]]
    output.wrapped_sentences([*found["words"], *(f"warning: {w}" for w in found["warnings"]), *unanswered], names)
    print("\n" + "\n".join(markdown(found)) + "\n")
    for file in files:
        output.say(f"  {file}")
    lost = "; ".join(f"{n}: {w}" for n, w in found["problems"].items())
    return output.say_why_ended(EXIT_FAILED_RUNS, f"no answer: {lost}") if lost else 0


def blind(options: argparse.Namespace, command: str) -> int:
    from rso.cli.progress import Progress
    from rso.discrepancy.blind import cases_of, diagnose_cases
    from rso.evaluation import WorkerPool
    from rso.evaluation.adapters import Source
    from rso.evaluation.store import RunStore

    cases = cases_of(options.folder)
    if not cases:
        output.complain(f"{options.folder}: no folder with a nominal.json in it")
        return EXIT_BAD_INPUT
    disk.folder(options.out)
    bad = 0
    with (
        RunStore(options.out / "store") as store,
        WorkerPool(options.jobs, source=Source(DEFAULT_BACKEND)) as pool,
        Progress(options.quiet) as progress,
    ):
        found = diagnose_cases(
            cases,
            options.out,
            store,
            pool,
            seed=options.seed,
            reruns=options.reruns,
            watch=progress.watch,
            say=progress.say,
        )
        bad = sum("error" in data for _, data in found)
    errors = f"; {bad} with an error, tried again at the next call" if bad else ""
    output.say(f"{len(cases)} cases, answers in {options.out}{errors}")
    return (
        output.say_why_ended(EXIT_BAD_INPUT, f"{bad} of {len(cases)} cases have an error; their answers say it")
        if bad
        else 0
    )


@contextmanager
def _workplace(options: argparse.Namespace, study: Any, source: Any, folder: Path) -> Iterator[tuple[Any, Any, Any]]:
    """The store of a study, what runs its simulations, and what shows of them; the folder is its own from then on."""
    from rso.calibration.result_files import claim
    from rso.cli.progress import Progress
    from rso.evaluation import executor
    from rso.evaluation.store import RunStore

    claim(folder, study.file)
    jobs = options.jobs or study.dispatch.jobs
    where = _store(options, folder)
    with (
        RunStore(where) as store,
        executor(study.dispatch, jobs, source, folder) as pool,
        Progress(options.quiet) as progress,
    ):
        yield store, pool, progress


def export(options: argparse.Namespace, command: str) -> int:
    from rso.api.exporting import formats
    from rso.api.specimens import specimens
    from rso.api.workspace import load

    if options.specimen:
        study = specimens(options.study, folder=_folder(options, _place(options), alone=False)).study(options.specimen)
    else:
        study = load(options.study, folder=options.out)
    names = list(dict.fromkeys([*options.formats, *(options.options or ())]))
    if not names:
        print("formats, each as an argument or option (rso export STUDY --csv):")
        output.lines([f"  {name}: {text}" for name, text in formats(study.plan).items()])
        return 0
    try:
        folder = options.to or study.folder / "export"
        files = study.export(folder, *names, candidate=options.candidate, experiment=options.experiment)
    except FileNotFoundError:
        output.complain(f"{study.folder}: there are no results; rso run {shlex.quote(str(options.study))} makes them")
        return EXIT_BAD_INPUT
    except ValueError as error:
        output.complain(error)
        return EXIT_BAD_INPUT
    for file in files:
        output.say(file)
    return 0


def import_runs(options: argparse.Namespace, command: str) -> int:
    from rso.api.workspace import load

    study = load(options.study, folder=options.out)
    try:
        count = study.import_runs(options.table)
    except ValueError as error:
        output.complain(f"{options.table}: {error}")
        return EXIT_BAD_INPUT
    output.say(f"{count} simulations are stored in {study.folder}; the study uses those that its design asks for")
    return 0


def status(options: argparse.Namespace, command: str) -> int:
    from rso.cli.status import report_status
    from rso.study.toml_text import study_source, tables_of

    if _are_results(options.study):
        return report_status(options, options.study, options.study, _store(options, options.study))
    if _many(options):
        from rso.cli.specimens import status_of_many

        return status_of_many(options, _folder(options, _place(options)))
    file, text = study_source(options.study)
    tables_of(file, text)  # no study is no study, but its data and backend have no say in what has been done
    folder = _folder(options, file.parent)
    return report_status(options, file, folder, _store(options, folder))


def example(options: argparse.Namespace, command: str) -> int:
    from rso.cli.example import write_example

    return write_example(options)


def compare(options: argparse.Namespace, command: str) -> int:
    from rso.cli.compare import compare

    return compare(options)


def doctor(options: argparse.Namespace, command: str) -> int:
    from rso.cli.doctor import doctor

    return doctor(options)


def open_page(options: argparse.Namespace, command: str) -> int:
    from rso.cli.pages import open_page

    return open_page(options, _results_folder(options))


def plot(options: argparse.Namespace, command: str) -> int:
    from rso.cli.pages import plot

    return plot(options, _results_folder(options))


def _are_results(place: Path) -> bool:
    """Whether a folder holds results and no study, as one that a colleague has sent."""
    return (place / "results.json").is_file() and not (place / "study.toml").exists()


def _results_folder(options: argparse.Namespace) -> Path:
    """Where the results of a study lie; a folder of results stands for itself."""
    from rso.study.toml_text import study_source

    if _are_results(options.study):
        return Path(options.study).absolute()
    return _folder(options, study_source(options.study)[0].parent)


def _many(options: argparse.Namespace, named: bool = False) -> bool:
    """Whether a study is one of many specimens of which none is named, or, with `named`, also where one is."""
    from rso.study.specimens import has_specimens

    return (named or not options.specimen) and has_specimens(options.study)


def _plan(study: Any) -> Any:
    """What would be run of a study; StudyError where it cannot be."""
    from rso.calibration.plan import make_plan

    return make_plan(study)


def _study(options: argparse.Namespace) -> Any:
    """The study of a command, or that of the specimen that is named."""
    from rso.study.loader import load_study
    from rso.study.specimens import load_specimens

    return load_specimens(options.study).study(options.specimen) if options.specimen else load_study(options.study)


def _place(options: argparse.Namespace) -> Path:
    from rso.study.toml_text import study_source

    return study_source(options.study)[0].parent


def first_steps(options: argparse.Namespace, command: str) -> int:
    """What `rso` alone says: the next three steps, by whether a study lies here."""
    here = Path("study.toml").is_file()
    steps = (
        [
            ("rso check study.toml", "what would run, and about how long"),
            ("rso run study.toml", "run it, or go on with it, and write its report"),
            ("rso status study.toml", "how far it is and what was found"),
        ]
        if here
        else [
            ("rso example", "worked studies to try; one takes about a minute"),
            ("rso new CURVE.csv --help", "write a study for your own force curve"),
            ("rso run study.toml", "run a study and write its report"),
        ]
    )
    output.bold("rso: identify soft materials from indentation tests")
    output.lines([f"  {words:28}{text}" for words, text in steps])
    output.say("All commands: rso --help")
    return 0


def report(options: argparse.Namespace, command: str) -> int:
    from rso.calibration.results import RUN_SCHEMA, data_hashes
    from rso.discrepancy.diagnosis_results import DIAGNOSIS_SCHEMA as TOLD
    from rso.model_selection import ladder_results
    from rso.next_experiment import design_results
    from rso.objectives import results as pareto_results
    from rso.report import render, render_diagnosis, render_ladder, render_next, render_pareto

    if _many(options):
        from rso.cli.specimens import report_of_many

        return report_of_many(options, _folder(options, _place(options)))
    study = _study(options)
    folder, now = _folder(options, study.folder), data_hashes(study)
    shown: list[tuple[str, int, Callable[..., list[Path]], str]] = [
        ("results.json", RUN_SCHEMA, render, "run"),
        ("diagnosis.json", TOLD, render_diagnosis, "diagnose"),
        (ladder_results.LADDER_FILE, ladder_results.LADDER_SCHEMA, render_ladder, "ladder"),
        (design_results.NEXT_FILE, design_results.NEXT_SCHEMA, render_next, "next"),
    ]
    if study.objectives is not None:
        shown = [("results.json", pareto_results.PARETO_SCHEMA, render_pareto, "run")]
    there = [row for row in shown if (folder / row[0]).exists()]
    for name, schema, draw, again in there or shown[:1]:
        path = folder / name
        try:
            found = disk.read_json(path)
        except FileNotFoundError:
            output.complain(f"{path}: is not there; run the study first: rso {again} {options.study}")
            return EXIT_BAD_INPUT
        except (OSError, ValueError) as error:
            output.complain(f"{path}: {error}; run the study first: rso {again} {options.study}")
            return EXIT_BAD_INPUT
        try:
            if found["schema"] != schema:
                raise ValueError(f"schema {found['schema']}, expected {schema}")
            missing: list[str] = []
            if options.language != "en" and draw is render_pareto:
                output.complain(f"{path.name}: its page is in English only; left as it is")
                continue
            more = {} if draw is render_pareto else {"language": options.language, "untranslated": missing}
            wanted = study.report  # who wants no page of a run asks for both here
            html, pdf = wanted.html or not wanted.pdf, wanted.pdf or not wanted.html
            files = draw(found, folder, html=html, pdf=pdf, **more)
        except (KeyError, TypeError, IndexError, AttributeError, ValueError) as error:
            output.complain(
                f"{path}: holds no results that this version can show ({type(error).__name__}: {error}); "
                f"run the study again: rso {again} {options.study}"
            )
            return EXIT_BAD_INPUT
        for file in files:
            output.say(file)
        output.untranslated(missing, options.language)
        then = (found.get("provenance") or {}).get("data_sha256") or now
        if changed := sorted(f for f in then.keys() | now.keys() if then.get(f) != now.get(f)):
            output.complain(
                f"{path.name} and its page are of other data: since then {', '.join(changed)} changed, came or "
                f"went; run it again: rso {again} {options.study}"
            )
    return 0


def _folder(options: argparse.Namespace, study: Path, alone: bool = True) -> Path:
    """Where results go, those of a specimen that is named `alone` in a folder of its own; StudyError where the folder
    beside the study leads elsewhere and nobody said that it may."""
    from rso.study.errors import StudyError

    beside = (study / "results").absolute()
    if options.out is None and beside.is_symlink():
        raise StudyError(
            [
                f"{beside}: is a symbolic link to {beside.resolve()}: say --out {beside.resolve()} if "
                "results are to go there"
            ]
        )
    folder: Path = options.out.absolute() if options.out else beside
    name = getattr(options, "specimen", None)
    if not (name and alone):
        return folder
    from rso.population.summary import folder_of

    return folder_of(folder, name)


def _store(options: argparse.Namespace, folder: Path) -> Path:
    """Where simulations are: those of specimens all in one place."""
    own = folder.parent.parent if getattr(options, "specimen", None) else folder
    return (options.store or own).absolute()
