"""What mkdocs.yml adds: equations as MathML, pages of studies and reports, links that lead out of docs/."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
OUTSIDE = ("studies", "reports")  # folders whose Markdown and pictures are pages of the site, too
SHOWN = (".md", ".svg", ".png")
ENTRY = re.compile(r"\]\((?P<path>[^)\s#]+)(?P<anchor>#[^)]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Add READMEs and pictures of studies and reports."""
    for top in OUTSIDE:
        for path in sorted((ROOT / top).rglob("*")):
            inside = path.relative_to(ROOT).parts
            if path.suffix in SHOWN and not any(p.startswith((".", "results")) for p in inside):
                files.append(File.generated(config, "/".join(inside), abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Display equations become MathML; links count from the folder of the site, those to no page are text."""
    source = ROOT / page.file.src_uri if page.file.src_uri.split("/")[0] in OUTSIDE else None
    here = (source or ROOT / "docs" / page.file.src_uri).parent
    known = {f.src_uri for f in files}
    depth = len(Path(page.file.src_uri).parts) - 1

    def moved(match: re.Match[str]) -> str:
        path = match["path"]
        if re.match(r"[a-z]+:", path):
            return match[0]
        target = (here / path).resolve()
        target = target / "README.md" if target.is_dir() else target
        if not target.is_relative_to(ROOT):
            return "]"
        inside = target.relative_to(ROOT).as_posix().removeprefix("docs/")
        return f"]({'../' * depth}{inside}{match['anchor'] or ''})" if inside in known else "]"

    return ENTRY.sub(moved, re.sub(r"\$\$(.*?)\$\$", _equation, markdown, flags=re.DOTALL))


def _equation(match: re.Match[str]) -> str:
    return convert(match[1].strip(), display="block").replace("\n", " ")


def on_post_build(config: Any) -> None:
    """No page asks another host: without this script the search of pages opened from the disk is off, that of a served
    site is not."""
    for path in Path(config["site_dir"]).rglob("*.html"):
        text = path.read_text("utf-8")
        path.write_text(re.sub(r'<script src="https://unpkg\.com/[^"]*"></script>', "", text), "utf-8")
