"""Docs: links lead somewhere, generated pages are up to date, the site builds without a network."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(p for top in ("docs", "studies", "reports") for p in (ROOT / top).rglob("*.md"))])
PAGES = [p for p in PAGES if "results" not in p.parts]
LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")


def module(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def prose(text: str) -> str:
    return re.sub(r"```.*?```|`[^`\n]*`", lambda m: "x" * (not m[0].startswith("```")), text, flags=re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Anchors of headings as GitHub and the site make them."""
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)
    titles = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", t) for t in re.findall(r"^#+ (.*)$", text, re.MULTILINE)]
    return {re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in titles}


def broken(page: Path, text: str) -> list[str]:
    """Relative links of a text that lead to no file, or to no heading of a page."""
    bad = []
    for one, other in LINK.findall(prose(text)):
        link = one or other
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = page if not path else (page.parent / path).resolve()
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            bad.append(link)
    return bad


def test_every_link_leads_somewhere():
    found = {str(p.relative_to(ROOT)): broken(p, p.read_text("utf-8")) for p in PAGES}
    assert {name: links for name, links in found.items() if links} == {}


def test_broken_links_are_seen():
    page = ROOT / "README.md"
    text = "[a](docs/index.md) [b](docs/gone.md) [c](docs/data.md#errors) [d](docs/data.md#gone) "
    text += "[e](https://x.y) ![f](f.png)"
    assert broken(page, text) == ["docs/gone.md", "docs/data.md#gone", "f.png"]


@pytest.mark.parametrize("name", ["cli.md", "python_reference.md", "gallery.md"])
def test_generated_pages_are_what_is_generated(name):
    reference = module(ROOT / "docs" / "reference.py")
    assert (ROOT / "docs" / name).read_text("utf-8") == reference.PAGES[name]()  # else: python docs/reference.py


def test_every_page_is_in_the_navigation():
    text = (ROOT / "mkdocs.yml").read_text("utf-8")
    listed = set(re.findall(r"([\w/]+\.md)$", text, re.MULTILINE))
    assert listed == {p.relative_to(ROOT / "docs").as_posix() for p in (ROOT / "docs").rglob("*.md")}


def test_sketches_of_what_can_be_modelled_are_drawn_by_the_model():
    sketches = module(ROOT / "docs" / "figures" / "sketches.py")
    for name, settings in sketches.EXPERIMENTS.items():
        drawn = (sketches.FOLDER / f"{name}.svg").read_text("utf-8")
        assert drawn == sketches.svg(settings)  # else: python docs/figures/sketches.py


@pytest.mark.verification
def test_the_site_builds_without_a_network(tmp_path):
    """Every warning of mkdocs is an error; no page asks another host for anything."""
    pytest.importorskip("material")
    pytest.importorskip("latex2mathml")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    page = (tmp_path / "theory.html").read_text("utf-8")
    assert "<math" in page and "$$" not in page
    asked = {
        m
        for p in tmp_path.rglob("*.html")
        for m in re.findall(
            r"(?:<script[^>]* src|<link[^>]*stylesheet[^>]* href|<img[^>]* src)=\"(https?:[^\"]+)", p.read_text("utf-8")
        )
    }
    assert asked == set()
