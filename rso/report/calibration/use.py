"""What a reader can do with the results: commands to run again, to export, to cite."""

from __future__ import annotations

import shlex

from rso.report.layout.digits import clean
from rso.report.layout.document import Cell, Section, column, table, words
from rso.report.reading import Results, finished


def use_section(results: Results) -> tuple[Section, ...]:
    """A table of commands, with the study's file; nothing before there are candidates."""
    if not finished(results, "verify"):
        return ()
    study = shlex.quote(clean((results.get("study") or {}).get("file")) or "study.toml")
    made = clean((results.get("provenance") or {}).get("command"))
    rows = [
        ("run the study again", made or f"rso run {study}"),
        ("material cards of other programs, with intervals as comments", f"rso export {study} --cards"),
        ("tables and posterior draws", f"rso export {study} --csv"),
        ("figures of this page as files", f"rso export {study} --figures"),
        ("BibTeX of the program and its methods", f"rso export {study} --bibtex"),
        ("what the model misses", f"rso diagnose {study}"),
        ("the next experiment", f"rso next {study}"),
    ]
    columns = [
        column("I want", words([text for text, _ in rows]), number=False),
        column("command", tuple(Cell(command, mark="code") for _, command in rows), number=False),
    ]
    return (Section("use", "Use it", (table("Commands", columns),)),)
