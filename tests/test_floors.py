"""The rooms of the house in order: a module imports only from rooms written before its own."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# One line per floor; within a floor too, the order counts.
ROOMS = {
    "rso": (
        "contract units disk printable distributions",
        "curves measurement similarity doe surrogates sensitivity feasibility",
        "store running targets benchmarks emulator",
        "search verify identify norms ladder diagnosis",
        "study",
        "report progress",
        "cli",
        "__main__",
    ),
    "fem_backend": (
        "voigt analytic laws geometry knobs",
        "stress meshing",
        "element linsolve condensed krylov zones pointwise contact newton keeping",
        "rolling stepping following post",
        "experiment model bench instants channels slopes indentation errors foreseen anchors nested levels "
        "possible costs",
        "backend output",
        "__main__",
    ),
}
ORDER = {package: " ".join(floors).split() for package, floors in ROOMS.items()}
SEAM = {"knobs", "experiment", "levels", "backend", "__main__"}  # rooms of fem_backend that may import rso.contract


def imports(source: str, package: str, inside: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Dotted names of everything imported from the two packages, anywhere in the source; `inside` is its folder."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [tuple(alias.name.split(".")) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            folder = (package, *inside)
            up = folder[: len(folder) - node.level + 1] if node.level else ()
            names = [(*up, *(node.module or "").split("."), alias.name) for alias in node.names]
            names = [tuple(part for part in name if part) for name in names]
        else:
            continue
        yield from (name for name in names if name[0] in ORDER)


def trespasses(source: str, package: str, room: str, inside: tuple[str, ...] = ()) -> list[str]:
    """Imports that a module in this room may not have; the package itself (`import rso`) is open to all of it."""
    order, bad = ORDER[package], []
    for name in imports(source, package, inside):
        other, target = name[0], name[1] if len(name) > 1 else ""
        if other != package:
            allowed = (other, target) == ("rso", "contract") and room in SEAM
        elif target in order:
            allowed = target == room or order.index(target) < order.index(room)
        else:
            allowed = target in ("", "__version__")
        if not allowed:
            bad.append(f"{package}.{room} imports {'.'.join(name)}")
    return bad


def modules(package: str) -> list[Path]:
    """Every module file of a package, but for the __init__ that opens it."""
    return [p for p in sorted((ROOT / package).rglob("*.py")) if p != ROOT / package / "__init__.py"]


def room_of(path: Path, package: str) -> str:
    return path.relative_to(ROOT / package).parts[0].removesuffix(".py")


@pytest.mark.parametrize("package", ROOMS)
def test_the_list_is_complete(package):
    assert {room_of(p, package) for p in modules(package)} == set(ORDER[package])
    assert len(set(ORDER[package])) == len(ORDER[package])


@pytest.mark.parametrize(
    ("package", "path"),
    [pytest.param(k, p, id=str(p.relative_to(ROOT))) for k in ROOMS for p in modules(k)],
)
def test_imports_lead_downwards_only(package, path):
    inside = path.relative_to(ROOT / package).parts[:-1]
    assert trespasses(path.read_text(encoding="utf-8"), package, room_of(path, package), inside) == []


@pytest.mark.parametrize("package", ROOMS)
def test_the_package_itself_imports_no_room(package):
    """But for the bare `rso`, which imports nothing itself: it sets threads and the place of compiled code."""
    found = imports((ROOT / package / "__init__.py").read_text(encoding="utf-8"), package)
    assert [name for name in found if name != ("rso",) or package == "rso"] == []


@pytest.mark.parametrize(
    ("package", "room", "source"),
    [
        ("rso", "store", "from rso.optimise import choose"),
        ("rso", "contract", "import rso.core.units"),
        ("rso", "curves", "def f():\n    from rso import doe"),
        ("rso", "doe", "if True:\n    import numpy, rso.calibration.plan"),
        ("rso", "cli", "from fem_backend.backend import BACKEND"),
        ("rso", "cli", "import fem_backend"),
        ("rso", "doe", "from .search import front"),
        ("rso", "cli", "from rso import nowhere"),
        ("fem_backend", "newton", "from rso.contract import Case"),
        ("fem_backend", "backend", "from rso.core.units import quantity"),
        ("fem_backend", "backend", "import rso"),
        ("fem_backend", "element", "from fem_backend import newton"),
    ],
)
def test_a_forbidden_import_is_caught(package, room, source):
    assert len(trespasses(source, package, room)) == 1


@pytest.mark.parametrize(
    ("package", "room", "inside", "source"),
    [
        ("rso", "cli", (), "import rso\nfrom rso import __version__\nfrom rso.optimise import choose\nimport numpy"),
        ("rso", "study", ("study",), "from .errors import Problem\nfrom ..contract import Case\nfrom . import plan"),
        ("fem_backend", "backend", (), "from rso.contract import Case\nfrom fem_backend import newton, laws"),
    ],
)
def test_allowed_imports_pass(package, room, inside, source):
    assert trespasses(source, package, room, inside) == []
