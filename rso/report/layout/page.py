"""The report as one HTML file and one PDF: the same document, poured into two templates."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path

import jinja2
from markupsafe import Markup

from rso.core import disk
from rso.report.layout.document import Picture, Report

_HERE = Path(__file__).parent
PAGES = {"report": "Identification", "diagnosis": "Diagnosis", "ladder": "Ladder of models", "next": "Next experiment"}
_LINKS = '<p class="pages">'


def pictures(document: Report) -> list[str]:
    """Names of the figures of a document, in their order."""
    return [b.name for s in document.sections for b in s.blocks if isinstance(b, Picture)]


def pour(document: Report, figures: Mapping[str, str], folder: Path, stem: str, html: bool, pdf: bool) -> list[Path]:
    """Write `stem`.html and, where typst is installed, `stem`.pdf into `folder`, which is made; list of files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    if html:
        written.append(disk.replace(folder / f"{stem}.html", html_page(document, figures)))
        _link(folder)
    if pdf and has_pdf():
        written.append(disk.replace(folder / f"{stem}.pdf", pdf_page(document, figures)))
    return written


def _link(folder: Path) -> None:
    """Every page of a folder leads to the others that are there."""
    there = [s for s in PAGES if (folder / f"{s}.html").is_file()]
    for stem in there:
        path = folder / f"{stem}.html"
        before = disk.read(path).decode("utf-8")
        head, mark, rest = before.partition(_LINKS)
        links = [f"<b>{PAGES[s]}</b>" if s == stem else f'<a href="{s}.html">{PAGES[s]}</a>' for s in there]
        line = rest.partition("\n")
        after = f"{head}{mark}{' '.join(links) if len(there) > 1 else ''}</p>\n{line[2]}"
        if mark and after != before:
            disk.replace(path, after)


def html_page(document: Report, figures: Mapping[str, str]) -> str:
    """One self-contained file; every text is escaped, only our own figures are markup."""
    loader = jinja2.FileSystemLoader(_HERE)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    environment.trim_blocks = environment.lstrip_blocks = True
    template = environment.get_template("page.html.j2")
    return template.render(report=document, figures={k: Markup(v) for k, v in figures.items()})


def has_pdf() -> bool:
    """Whether PDF files can be written: typst is installed (the extra `pdf`)."""
    return importlib.util.find_spec("typst") is not None


def pdf_page(document: Report, figures: Mapping[str, str]) -> bytes:
    """A4 pages set by typst; texts travel as JSON strings, which it never reads as markup."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for figure, svg in figures.items():
            (folder / f"{figure}.svg").write_text(svg, encoding="utf-8", newline="\n")
        data = json.dumps(dataclasses.asdict(document), ensure_ascii=False)
        (folder / "report.json").write_text(data, encoding="utf-8")
        source = folder / "page.typ"
        source.write_bytes((_HERE / "page.typ").read_bytes())
        import typst

        return typst.compile(str(source), root=str(folder), format="pdf", ignore_system_fonts=True)
