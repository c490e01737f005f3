"""Sentences for people: short, in the field's terms, with one way to write a unit.

What is read here: every text of three words and more in both packages (messages, reports, help), the page templates,
README, docs and the READMEs of studies, and the public docstrings for their words.  tests/words_left.json is what is
left of older texts, by file: a place that got better must leave it, so that it only shrinks.
`python tests/test_words.py` shows every place that is left; with --write it writes smaller numbers down.
"""

import ast
import functools
import json
import re
import sys
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
LEFT = Path(__file__).with_name("words_left.json")  # `length` and `words` by file: how many are left
REASONS = {  # why some stay, by what a path begins with
    "rso/cli/arguments.py": "the help of a folder and the table of exit codes are lists",
    "rso/data/files/header_words.py": "a list of words",
}


@functools.cache  # a source is parsed once for both rules
def written(source: str) -> tuple[list[tuple[int, str]], list[tuple[str, bool]]]:
    """Line and text of every string that is no docstring, and every docstring and whether what it describes is public.

    What is filled into a string is one word.
    """
    nodes = list(ast.walk(ast.parse(source)))
    docs = list(docstrings(nodes))
    skipped = {id(d) for d, _ in docs}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            skipped |= {id(part) for part in ast.walk(node) if part is not node}
    texts = []
    for node in nodes:
        if id(node) in skipped:
            continue
        if isinstance(node, ast.JoinedStr):
            parts = [v.value if isinstance(v, ast.Constant) else "X" for v in node.values]
            texts.append((node.lineno, "".join(map(str, parts))))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            texts.append((node.lineno, node.value))
    return texts, [(str(d.value), public) for d, public in docs]


def texts(source: str) -> list[tuple[int, str]]:
    return written(source)[0]


def docstrings(nodes: list[ast.AST]) -> Iterator[tuple[ast.Constant, bool]]:
    """Every docstring, and whether what it describes is public."""
    for node in nodes:
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
        every += [text for text, public in written(source)[1] if public]
    return [m[0] for part in every for m in PRIVATE.finditer(part)]


def count(paths: list[Path], rule) -> dict[str, int]:
    found = {str(p.relative_to(ROOT)): len(rule(p)) for p in paths}
    return {name: n for name, n in found.items() if n}


RULES = {"length": long_sentences, "words": our_words}


@pytest.mark.parametrize("name", RULES)
def test_sentences_are_short_and_in_the_terms_of_the_field(name):
    rule, left = RULES[name], json.loads(LEFT.read_text("utf-8"))[name]
    found = count([*SOURCES, *PAGES], rule)
    worse = {file: rule(ROOT / file) for file, n in found.items() if n > left.get(file, 0)}
    assert worse == {}  # write these better
    better = {file: found.get(file, 0) for file, n in left.items() if found.get(file, 0) < n}
    assert better == {}  # python tests/test_words.py --write


def test_what_may_stay_has_a_reason_or_is_a_page_of_docs():
    left = json.loads(LEFT.read_text("utf-8"))
    code = {file for rows in left.values() for file in rows if file.endswith(".py")}
    assert {f for f in code if f.startswith("rso/") and not any(f.startswith(r) for r in REASONS)} == set()


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
        ("This has four words. And here are five words.", [4, 5], []),
        ("The data cannot tell it from noise; it was remade.", [10], ["tell"]),
        ("Simulated anew on the way back.", [6], ["anew", "way back"]),
        ("rso.tell(runs) and `tell` are names", [5], []),
        ("D₁ is 5.8 MPa⁻¹, i. e. soft.", [5, 1, 1], []),
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


def _show(write: bool) -> None:
    """Print what is left; write it down where it is less than before."""
    before = json.loads(LEFT.read_text("utf-8")) if LEFT.is_file() else {}
    found = {name: count([*SOURCES, *PAGES], rule) for name, rule in RULES.items()}
    for name, rows in found.items():
        for file in rows:
            for text in RULES[name](ROOT / file):
                print(f"{file}: {' '.join(text.split())}")
    if write:
        kept = {
            name: {f: min(n, before[name].get(f, 0)) if before else n for f, n in rows.items()}
            for name, rows in found.items()
        }
        kept = {name: {f: n for f, n in rows.items() if n} for name, rows in kept.items()}
        LEFT.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n", "utf-8")


if __name__ == "__main__":
    _show("--write" in sys.argv)
