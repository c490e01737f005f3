"""One word, one meaning: no class or function of the two packages, and no constant within one of them, shares its name
with another of another meaning; a number says beside it what it bounds."""

import ast
import functools
import re
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
PACKAGES = ("rso", "fem_backend")
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")
# What several modules of a package may define as a constant by one name, with the reason.
SHARED_CONSTANTS = {
    "T": "a type variable, as in every book",
    "BACKEND": "the one backend of the package, and its name in requests",
    "SAMPLER": "one contract, kept by each module of rso/doe/samplers",
}


def defined(source: str, kinds: tuple[type, ...]) -> list[str]:
    """Names of the classes or functions that a module defines, not those inside of others."""
    return [name for kind, name in definitions(source) if issubclass(kind, kinds) and not name.startswith("_")]


@functools.cache  # a source is parsed once for all tests
def body(source: str) -> list[ast.stmt]:
    return ast.parse(source).body


@functools.cache
def definitions(source: str) -> tuple[tuple[type, str], ...]:
    kinds = ast.ClassDef, ast.FunctionDef
    return tuple((type(n), n.name) for n in body(source) if isinstance(n, kinds))


@functools.cache  # a source is parsed once for both rules
def constants(source: str) -> list[tuple[str, ast.Assign | ast.AnnAssign]]:
    """Names in capital letters that a module assigns, each with its statement."""
    found = []
    for node in body(source):
        if isinstance(node, ast.Assign | ast.AnnAssign):
            places = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [n for p in places for n in ast.walk(p) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
            found += [(n.id, node) for n in names if CONSTANT.fullmatch(n.id)]
    return found


def constants_twice(texts: Mapping[str, str]) -> set[str]:
    """Names of constants that more than one module defines."""
    places: dict[str, set[str]] = {}
    for file, text in texts.items():
        for name, _ in constants(text):
            places.setdefault(name, set()).add(file)
    return {name for name, where in places.items() if len(where) > 1}


def is_number(value: ast.expr | None) -> bool:
    """Whether an expression is made of numbers alone: literals, operators, functions of them, other constants."""
    nodes = list(ast.walk(value)) if value is not None else []
    literals = [n for n in nodes if isinstance(n, ast.Constant)]
    others = ast.Constant | ast.Tuple | ast.UnaryOp | ast.BinOp | ast.Call | ast.Name | ast.Attribute | ast.Dict
    plain = all(isinstance(n, others) for n in nodes if isinstance(n, ast.expr))
    tables = [n for n in nodes if isinstance(n, ast.Dict)]
    keys = [k for n in tables for k in n.keys]
    look = any(isinstance(v, ast.Name) for n in tables for v in n.values)  # of a line, with its colour
    numbers = [type(n.value) in (int, float) for n in literals if n not in keys]
    return plain and not look and bool(numbers) and all(numbers)


def unexplained(source: str) -> list[str]:
    """Numeric constants without a comment, on their own lines or directly above them, or a text below them."""
    lines = source.splitlines()
    texts = [n for n in body(source) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)]
    below = {n.lineno - 1 for n in texts}
    found = []
    for name, node in constants(source):
        if node.end_lineno in below:
            continue
        own = lines[node.lineno - 1 : node.end_lineno]
        above = lines[node.lineno - 2] if node.lineno > 1 else ""
        if is_number(node.value) and not above.startswith("#") and not any("#" in line for line in own):
            found.append(name)
    return found


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


def of_package(package: str) -> dict[str, str]:
    return {file: text for file, text in files().items() if file.startswith(package + "/")}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_constant_name_means_one_thing(package):
    assert (
        constants_twice(of_package(package)) - set(SHARED_CONSTANTS) == set()
    )  # say what each bounds, or define it once


def test_what_constants_share_is_still_shared():
    found = set().union(*(constants_twice(of_package(package)) for package in PACKAGES))
    assert set(SHARED_CONSTANTS) - found == set()


@pytest.mark.parametrize("package", PACKAGES)
def test_a_number_says_what_it_bounds(package):
    found = {f"{file}: {name}" for file, text in of_package(package).items() for name in unexplained(text)}
    assert found == set()  # a comment beside it, with the unit


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


def test_a_second_constant_of_a_name_is_seen():
    assert constants_twice({"a.py": "MOST = 3", "b.py": "MOST: int = 5"}) == {"MOST"}
    assert constants_twice({"a.py": "_REST, LONG = 1, 2", "b.py": "LONG = 'text'"}) == {"LONG"}
    assert constants_twice({"a.py": "REST, (FEW, LONG) = 1, (2, 3)", "b.py": "LONG = 4"}) == {"LONG"}
    assert constants_twice({"a.py": "MOST = 3\nMOST = 4", "b.py": "from a import MOST"}) == set()
    assert constants_twice({"a.py": "MOST = 3", "b.py": "def f():\n    MOST = 5"}) == set()
    assert constants_twice({"a.py": "rows = 3\nRow = int", "b.py": "rows = 4\nRow = str"}) == set()


@pytest.mark.parametrize(
    "source",
    [
        "MOST = 3",
        "MOST: float = -3.0",
        "MOST, LEAST = 3, 1",
        "MOST = 2 * LEAST",
        "MOST = math.log(20.0)",
        'MOST = {"mm": 1e4}',
        "MOST = 3\n# below",
        "# above\n\nMOST = 3",
    ],
)
def test_a_number_without_a_word_is_seen(source):
    assert "MOST" in unexplained(source)


@pytest.mark.parametrize(
    "source",
    [
        "MOST = 3  # rows",
        "# rows\nMOST = 3",
        "MOST = (\n    3,  # rows\n)",
        "WORD = 'text'",
        "PAIR = ('a', 3)",
        "f = 3",
    ],
)
def test_a_number_with_its_word_passes(source):
    assert unexplained(source) == []
