"""One word, one meaning: no class of the two packages shares its name with another, and old private words are gone."""

import ast
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PRIVATE = ("climb", "foretell", "foretold", "settled", "hum", "looseness", "rung", "remembering")


def defined(source: str, kinds: tuple[type, ...]) -> list[str]:
    """Names of the classes or functions that a module defines, not those inside of others."""
    return [n.name for n in ast.parse(source).body if isinstance(n, kinds) and not n.name.startswith("_")]


def sources() -> list[str]:
    return [p.read_text("utf-8") for name in ("rso", "fem_backend") for p in sorted((ROOT / name).rglob("*.py"))]


def twice(texts: list[str]) -> list[str]:
    """Class names that more than one module defines."""
    found = Counter(name for text in texts for name in defined(text, (ast.ClassDef,)))
    return sorted(name for name, n in found.items() if n > 1)


def test_a_class_name_means_one_thing():
    assert twice(sources()) == []


@pytest.mark.parametrize("word", PRIVATE)
def test_public_names_are_words_of_the_field(word):
    kinds = (ast.ClassDef, ast.FunctionDef)
    assert [n for text in sources() for n in defined(text, kinds) if n.lower() == word] == []


def test_a_second_meaning_is_seen():
    assert twice(["class Bench: ...", "class Runner: ...", "class Bench: ..."]) == ["Bench"]
    assert twice(["class A:\n    class Table: ...", "class Table: ..."]) == []
