"""The report as one HTML file and one PDF: the same document, poured into two templates."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
import json
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import jinja2
import matplotlib
from markupsafe import Markup

from rso.core import disk
from rso.report.layout.document import Block, Picture, Report, Text

_PAGE_FOLDER = Path(__file__).parent
PAGE_TITLES = {
    "report": "Identification",
    "specimens": "Specimens",
    "diagnosis": "Diagnosis",
    "ladder": "Ladder of models",
    "next": "Next experiment",
}
MAX_PX_PER_POINT, MAX_FIGURE_WIDTH_PX = 1.8, 900  # px a point that a figure is drawn with; px
MAX_SHRINKING_WIDTH_POINTS = 420.0  # points: figures no wider than this shrink on a phone, others scroll
MIN_FOLDED_WARNINGS = 3  # fewer warnings stand open
THEME_COLOURS = {  # of figures, by the variable of the page's theme
    "#23272b": "ink",
    "#7b8085": "grey",
    "#c9ccca": "light",
    "#eceeed": "faint",
    "#ffffff": "paper",
    "#0b5a7d": "accent",
    "#b4481e": "hot",
    "#f3e3d7": "sand",
    "#dfe4e7": "steel",
}
_LINKS_BEGIN = '<p class="pages">'
PRINTED_WORDS = ("Warning.", "Of the data.")
SCRIPT_WORDS = (  # by the script of a page
    "Light", "Dark", "Switch to the light theme", "Switch to the dark theme", "Link to", "Depth of the section",
    "What is coloured", "Press", "Arrow keys turn it.", "Show or hide", "Download as", "Copy table", "Copied",
    "Filter rows", "Filter the rows of this table", "Sort by this column", "Zoom", "Whole figure",
    "Enlarge a part: drag over it, or use plus, minus and the arrow keys", "series", "line",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Tongue:
    """The language of a page: its code, and what its own words are in it."""

    language: str
    say: Callable[[str], str]


ENGLISH_TONGUE = Tongue("en", str)


def pictures(document: Report) -> list[str]:
    """Names of the figures of a document, in their order."""
    return [b.name for s in document.sections for b in s.blocks if isinstance(b, Picture)]


def pour(
    document: Report,
    figures: Mapping[str, str],
    folder: Path,
    stem: str,
    html: bool,
    pdf: bool,
    tongue: Tongue = ENGLISH_TONGUE,
) -> list[Path]:
    """Write `stem`.html and, where typst is installed, `stem`.pdf into `folder`, which is made; list of files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    if html:
        written.append(disk.replace(folder / f"{stem}.html", html_page(document, figures, tongue)))
        _link(folder)
    if pdf and has_pdf():
        written.append(disk.replace(folder / f"{stem}.pdf", pdf_page(document, figures, tongue)))
    return written


def _link(folder: Path) -> None:
    """Every page of a folder leads to the others that are there."""
    there = [s for s in PAGE_TITLES if (folder / f"{s}.html").is_file()]
    for stem in there:
        path = folder / f"{stem}.html"
        before = disk.read_bytes(path).decode("utf-8")
        head, mark, rest = before.partition(_LINKS_BEGIN)
        links = [f"<b>{PAGE_TITLES[s]}</b>" if s == stem else f'<a href="{s}.html">{PAGE_TITLES[s]}</a>' for s in there]
        line = rest.partition("\n")
        after = f"{head}{mark}{' '.join(links) if len(there) > 1 else ''}</p>\n{line[2]}"
        if mark and after != before:
            disk.replace(path, after)


@dataclasses.dataclass(frozen=True)
class _Figure:
    """A figure as the page takes it: markup, how it is framed, how wide (px) it gets, whether a phone scrolls it."""

    svg: Markup
    look: str
    most: int
    wide: bool


def html_page(document: Report, figures: Mapping[str, str], tongue: Tongue = ENGLISH_TONGUE) -> str:
    """One self-contained file; every text is escaped, only our own figures are markup."""
    loader = jinja2.FileSystemLoader(_PAGE_FOLDER)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    environment.trim_blocks = environment.lstrip_blocks = True
    environment.filters["grouped"] = grouped
    captions = {b.name: b.caption for s in document.sections for b in s.blocks if isinstance(b, Picture)}
    template = environment.get_template("page.html.j2")
    return template.render(
        report=document,
        language=tongue.language,
        say=tongue.say,
        words=Markup(json.dumps({w: tongue.say(w) for w in SCRIPT_WORDS if tongue.say(w) != w}, ensure_ascii=False)),
        figures={k: _figure(k, v, captions.get(k, "")) for k, v in figures.items()},
        style=Markup((_PAGE_FOLDER / "page.css").read_text("utf-8")),
        script=Markup((_PAGE_FOLDER / "page.js").read_text("utf-8")),
    )


def grouped(blocks: Sequence[Block]) -> list[tuple[str, list[Block]]]:
    """Blocks as they stand: pictures with a share of the width in a row, many warnings behind one line."""

    def kind(b: Block) -> str:
        if isinstance(b, Picture) and b.share:
            return "row"
        return "warnings" if isinstance(b, Text) and b.role == "warning" else ""

    groups = [(k, list(some)) for k, some in itertools.groupby(blocks, kind)]
    return [("" if k == "warnings" and len(some) < MIN_FOLDED_WARNINGS else k, some) for k, some in groups]


def _figure(name: str, svg: str, caption: str) -> _Figure:
    """An image with a name for whoever cannot see it, in the colours of the page's theme."""
    for colour, variable in THEME_COLOURS.items():
        svg = svg.replace(colour, f"var(--{variable})")
    svg = svg.replace("'DejaVu Sans'", "var(--sans)")
    svg = svg.replace('font-family="DejaVu Sans"', 'style="font-family:var(--sans)"')
    label = Markup.escape(caption or name.replace("-", " "))
    head = f'<svg role="img" aria-label="{label}" data-name="{Markup.escape(name)}"'
    look = "plate" if "data-plate" in svg[:2000] else ""
    found = re.search(r'\bwidth="([\d.]+)(pt)?"', svg[:3000])
    points = float(found[1]) * (1.0 if found[2] else 0.75) if found else 0.0
    most = round(min(points * MAX_PX_PER_POINT, MAX_FIGURE_WIDTH_PX))
    return _Figure(Markup(svg.replace("<svg", head, 1)), look, most, points > MAX_SHRINKING_WIDTH_POINTS)


def has_pdf() -> bool:
    """Whether PDF files can be written: typst is installed (the extra `pdf`)."""
    return importlib.util.find_spec("typst") is not None


def pdf_page(document: Report, figures: Mapping[str, str], tongue: Tongue = ENGLISH_TONGUE) -> bytes:
    """A4 pages set by typst; texts travel as JSON strings, which it never reads as markup."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for figure, svg in figures.items():
            (folder / f"{figure}.svg").write_text(svg, encoding="utf-8", newline="\n")
        spoken = {w: tongue.say(w) for w in PRINTED_WORDS}
        data = json.dumps(
            {**dataclasses.asdict(document), "language": tongue.language, "words": spoken}, ensure_ascii=False
        )
        (folder / "report.json").write_text(data, encoding="utf-8")
        source = folder / "page.typ"
        source.write_bytes((_PAGE_FOLDER / "page.typ").read_bytes())
        import typst

        fonts = [str(Path(matplotlib.get_data_path()) / "fonts" / "ttf")]  # what figures are set in
        return typst.compile(str(source), root=str(folder), format="pdf", ignore_system_fonts=True, font_paths=fonts)
