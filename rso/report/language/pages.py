"""A document and its figures as the files of a page, in any language."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rso.report.language.catalogue import sentences_of
from rso.report.language.document import in_language
from rso.report.language.figure import figure_in_language
from rso.report.layout.document import Report
from rso.report.layout.page import Tongue, pour


def write_page(
    document: Report,
    figures: Mapping[str, str],
    folder: Path,
    stem: str,
    html: bool,
    pdf: bool,
    language: str,
    own: frozenset[str],
    untranslated: list[str] | None,
) -> list[Path]:
    """Write `stem`.html and .pdf, in another language as `stem`.de.html; list of files.

    `own` are words that no language changes. Sentences without a template stay English and are added to
    `untranslated`.  ValueError for a language that there is none of.
    """
    if language == "en":
        return pour(document, figures, folder, stem, html, pdf)
    by = sentences_of(language, own)
    document = in_language(document, by)
    figures = {name: figure_in_language(svg, by) for name, svg in figures.items()}
    files = pour(document, figures, folder, f"{stem}.{language}", html, pdf, Tongue(language, by.text))
    if untranslated is not None:
        untranslated += by.missing
    return files
