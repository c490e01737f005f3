"""A document and its figures as the files of a page, in any language."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypedDict

from rso.report.language.catalogue import sentences_of
from rso.report.language.document import in_language
from rso.report.language.figure import figure_in_language
from rso.report.layout.document import Report
from rso.report.layout.page import Tongue, pictures, pour


class PageOptions(TypedDict, total=False):
    """Which files of a page are written (both), in which language (en), and where sentences without a template go."""

    html: bool
    pdf: bool
    language: str
    untranslated: list[str]


def write_page(
    document: Report,
    draw: Callable[[str], str],
    folder: Path,
    stem: str,
    own: frozenset[str],
    options: PageOptions,
) -> list[Path]:
    """Write `stem`.html and .pdf with figures by name, in another language as `stem`.de.html; list of files.

    `own` are words that no language changes. Sentences without a template stay English and are added to
    `untranslated`.  ValueError for a language that there is none of.
    """
    figures = {name: draw(name) for name in pictures(document)}
    html, pdf, language = options.get("html", True), options.get("pdf", True), options.get("language", "en")
    if language == "en":
        return pour(document, figures, folder, stem, html, pdf)
    by = sentences_of(language, own)
    document = in_language(document, by)
    figures = {name: figure_in_language(svg, by) for name, svg in figures.items()}
    files = pour(document, figures, folder, f"{stem}.{language}", html, pdf, Tongue(language, by.text))
    options.get("untranslated", []).extend(by.missing)
    return files
