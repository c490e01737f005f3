"""Sentences for people: short, in the field's terms, with one way to write a unit.

What is read here: every text of three words and more in both packages (messages, reports, help), the page templates,
README, docs and the READMEs of studies, and the public docstrings for their words.  `TOO_LONG` and `ALLOWED` are what
is left: a place that got better must leave the list, so that it only shrinks.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MOST = 25  # words of a sentence
SOURCES = sorted(p for package in ("rso", "fem_backend") for p in (ROOT / package).rglob("*.py"))
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
PAGES += sorted((ROOT / "studies").glob("*/README.md"))

# A word of ours and the field's term for it.
WORDS = {
    r"anew": "again, re-",
    r"as good as \S+ independent": "effective sample size",
    r"belong together": "correlated; given together",
    r"climb(s|ed|ing)?": "model selection",
    r"customary": "usual",
    r"dear(er|est|ly)?": "expensive",
    r"fore(tell|tells|told|telling|seen)": "predict",
    r"hangs? (on|together)": "depend on, correlated",
    r"hum(s|ming)?": "periodic disturbance",
    r"loose(ly|ness)?": "not tight; play; free",
    r"made[- ]up data": "simulated data",
    r"reckon(s|ed|ing)?": "compute",
    r"remember(s|ed|ing)?": "autocorrelated, history-dependent",
    r"settl(e|es|ed|ing)": "decide, converge",
    r"t(ell|ells|old)( apart)?": "show, state, separate",
    r"way back": "unloading",
}
PRIVATE = re.compile(rf"(?<![\w.`/-])(?:{'|'.join(WORDS)})(?![\w(]|\.\w)", re.IGNORECASE)
# How units are not written where people read.
UNITS = re.compile(r"\d 1/MPa|\d /MPa|\b1 1/|\d{1,3}\.\d{11,}|\{'\w+': ")
LONE = {  # words that mean what they always mean there, by file: (word, reason)
    "rso/api/workspace.py": ("tell", "the method of ask and tell"),
}
DOCSTRINGS = {  # the same of public docstrings
    "fem_backend/adapter/priors.py": ("foreseen", ""),
}
# Sentences of more than MOST words, by file.  Only smaller numbers may be put here.
TOO_LONG: dict[str, int] = {}
# Words of WORDS, by file.  Only smaller numbers may be put here.
OURS: dict[str, int] = {}


def texts(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every string that is no docstring; what is filled in is one word."""
    tree = ast.parse(source)
    skipped = {id(d) for d, _ in docstrings(tree)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            skipped |= {id(part) for part in ast.walk(node) if part is not node}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.JoinedStr):
            parts = [v.value if isinstance(v, ast.Constant) else "X" for v in node.values]
            yield node.lineno, "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value


def docstrings(tree: ast.AST) -> Iterator[tuple[ast.Constant, bool]]:
    """Every docstring, and whether what it describes is public."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) or not node.body:
            continue
        first = node.body[0]
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str):
            yield first.value, not getattr(node, "name", "").startswith("_")


def prose(page: str) -> Iterator[str]:
    """Paragraphs, items and cells of a Markdown page, without code, links' targets and comments."""
    page = re.sub(r"```.*?```|<!--.*?-->|\$\$.*?\$\$", "", page, flags=re.DOTALL)
    page = re.sub(r"`[^`]*`", "X", re.sub(r"\]\([^)]*\)", "]", page))
    for block in re.split(r"\n\s*\n|\n(?=\s*[-|#*\d])", page):
        for cell in block.split("|") if block.strip().startswith("|") else [block]:
            yield " ".join(cell.split())


def sentences(text: str) -> list[str]:
    return [s for s in re.split(r"(?<=[.!?])[)”’\"*]*\s+", text) if s.strip()]


def length(sentence: str) -> int:
    """Words of a sentence; a formula, an option or a path is one."""
    return len([w for w in sentence.split() if re.search(r"\w", w)])


def spoken(text: str) -> bool:
    """Whether a string of the program is a sentence: three words and more, and neither SQL nor a list of names."""
    return text.count(" ") >= 3 and not re.match(r"\s*(CREATE|SELECT|INSERT|#set|<)", text)


def long_sentences(path: Path) -> list[str]:
    if path.suffix == ".md":
        every = [s for part in prose(path.read_text("utf-8")) for s in sentences(part)]
    else:
        every = [s for _, t in texts(path.read_text("utf-8")) if spoken(t) for s in sentences(t)]
    return [s for s in every if length(s) > MOST]


def our_words(path: Path) -> list[str]:
    if path.suffix == ".md":
        every = list(prose(path.read_text("utf-8")))
    else:
        source = path.read_text("utf-8")
        every = [t for _, t in texts(source) if spoken(t)]
        every += [str(d.value) for d, public in docstrings(ast.parse(source)) if public]
    return [m[0] for part in every for m in PRIVATE.finditer(part)]


def count(paths: list[Path], rule) -> dict[str, int]:
    found = {str(p.relative_to(ROOT)): len(rule(p)) for p in paths}
    return {name: n for name, n in found.items() if n}


@pytest.mark.parametrize("rule, left", [(long_sentences, TOO_LONG), (our_words, OURS)], ids=["length", "words"])
def test_sentences_are_short_and_in_the_terms_of_the_field(rule, left):
    found = count([*SOURCES, *PAGES], rule)
    worse = {name: rule(ROOT / name) for name, n in found.items() if n > left.get(name, 0)}
    assert worse == {}  # write these better
    better = {name: found.get(name, 0) for name, n in left.items() if found.get(name, 0) < n}
    assert better == {}  # write these numbers into the list above


def test_units_are_written_in_one_way():
    """MPa⁻¹ in prose, never "1 1/MPa"; no raw dictionaries, no seventeen digits.  What a file may say is code."""
    found = {
        (str(p.relative_to(ROOT)), m[0])
        for p in PAGES
        for part in prose(p.read_text("utf-8"))
        for m in UNITS.finditer(part)
    }
    assert found == set()


@pytest.mark.parametrize(
    "text, words, private",
    [
        ("This has five words. And these are four.", [5, 4], []),
        ("The data cannot tell it from noise; it was remade.", [10], ["tell"]),
        ("Simulated anew on the way back.", [6], ["anew", "way back"]),
        ("rso.tell(runs) and `tell` are names", [6], []),
        ("D₁ is 5.8 MPa⁻¹, i. e. soft.", [4, 1, 1], []),
    ],
)
def test_the_rules_see_what_they_should(text, words, private):
    assert [length(s) for s in sentences(text)] == words
    assert [m[0] for m in PRIVATE.finditer(text)] == private


def test_a_long_sentence_and_a_raw_unit_are_found(tmp_path):
    path = tmp_path / "page.md"
    path.write_text("word " * 26 + ".\n\nD1 is 1 1/MPa, {'mu': 0.0111078053637978}\n", "utf-8")
    assert [length(s) for s in long_sentences(path)] == [26]
    assert [m[0] for part in prose(path.read_text()) for m in UNITS.finditer(part)] == [
        "1 1/MPa",
        "{'mu': ",
        "0.0111078053637978",
    ]
