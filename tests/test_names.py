"""One word, one meaning: no class or function of the two packages shares its name with another of another meaning."""

import ast
import functools
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# What several modules may define by one name, with the reason.
SHARED = {
    # one contract, kept by each of these
    "points": "a sampler's design (rso/doe/samplers)",
    "further": "how a sampler goes on (rso/doe/samplers)",
    "solve": "equilibrium of a system from a start, by one method each (fem_backend/solver)",
    **dict.fromkeys(
        ("discretise", "displacement_gradients", "internal_force", "shape_functions", "stiffness", "volume"),
        "the same of a meridian and of a body in space, behind fem_backend/kinematics/bodies.py",
    ),
    "rezoned": "a new mesh of a deformed section and of a deformed body in space (fem_backend/remeshing)",
    "main": "the console script of each package",
    # a command of the program, and what it calls
    **dict.fromkeys(
        ("compare", "diagnose", "doctor", "export", "next_test", "open_page", "plot", "report"),
        "rso/cli/commands.py calls each command's handler by the command's name",
    ),
    # what a page shows, and what it is of
    "number": "a finite number of a contract's data, and of a result read for a page",
    **dict.fromkeys(
        ("raised", "symbol", "unit_text"), "rso/report/layout/digits.py is rso/core/symbols.py for text of any origin"
    ),
}
PAGES = "rso/report/"  # each page has a module of its own with sections and figures of the same names
PRIVATE = ("climb", "foretell", "foretold", "settled", "hum", "looseness", "rung", "remembering")


def defined(source: str, kinds: tuple[type, ...]) -> list[str]:
    """Names of the classes or functions that a module defines, not those inside of others."""
    return [name for kind, name in definitions(source) if issubclass(kind, kinds) and not name.startswith("_")]


@functools.cache  # a source is parsed once for all tests
def definitions(source: str) -> tuple[tuple[type, str], ...]:
    kinds = ast.ClassDef, ast.FunctionDef
    return tuple((type(n), n.name) for n in ast.parse(source).body if isinstance(n, kinds))


@functools.cache
def files() -> dict[str, str]:
    paths = [p for name in ("rso", "fem_backend") for p in sorted((ROOT / name).rglob("*.py"))]
    return {p.relative_to(ROOT).as_posix(): p.read_text("utf-8") for p in paths}


def sources() -> list[str]:
    return list(files().values())


def twice(texts: list[str]) -> list[str]:
    """Class names that more than one module defines."""
    found = Counter(name for text in texts for name in defined(text, (ast.ClassDef,)))
    return sorted(name for name, n in found.items() if n > 1)


def functions_twice(texts: Mapping[str, str]) -> set[str]:
    """Names of functions that more than one module defines; the pages of reports are one."""
    places: dict[str, set[str]] = {}
    for file, text in texts.items():
        for name in defined(text, (ast.FunctionDef,)):
            places.setdefault(name, set()).add(PAGES if file.startswith(PAGES) else file)
    return {name for name, where in places.items() if len(where) > 1}


def test_a_class_name_means_one_thing():
    assert twice(sources()) == []


def test_a_function_name_means_one_thing():
    found = functions_twice(files())
    assert found - set(SHARED) == set()  # say what each does
    assert set(SHARED) - found == set()  # no longer shared


@pytest.mark.parametrize("word", PRIVATE)
def test_public_names_are_words_of_the_field(word):
    kinds = (ast.ClassDef, ast.FunctionDef)
    assert [n for text in sources() for n in defined(text, kinds) if n.lower() == word] == []


def test_a_second_meaning_is_seen():
    assert twice(["class Bench: ...", "class Runner: ...", "class Bench: ..."]) == ["Bench"]
    assert twice(["class A:\n    class Table: ...", "class Table: ..."]) == []


def test_a_second_function_of_a_name_is_seen():
    assert functions_twice({"a.py": "def load(): ...", "b.py": "def load(x): ..."}) == {"load"}
    assert functions_twice({"rso/report/a.py": "def draw(): ...", "rso/report/b.py": "def draw(): ..."}) == set()
    assert functions_twice({"a.py": "def _own(): ...", "b.py": "def _own(): ..."}) == set()
    assert functions_twice({"a.py": "class A:\n    def run(self): ...", "b.py": "def run(): ..."}) == set()
