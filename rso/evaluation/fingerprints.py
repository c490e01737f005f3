"""What the answers of a foreign backend depend on: the hash of its file and of the modules beside it that it uses."""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from rso.contract import digest

_IMPORT_FUNCTIONS = ("import_module", "__import__")


def fingerprint_of(file: str) -> str:
    """SHA-256 of a file; where it is Python that uses modules beside it, of all of these with their names.

    Read from the text, functions included, so that it depends on nothing that a process has loaded: ``import``, names
    handed to ``import_module``, and texts that name a ``.py`` file there, each followed in turn.  Not seen are modules
    whose names are made up while it runs, data files, and what is installed, which has versions.
    """
    start = Path(os.path.realpath(file))
    root = start.parent
    while (root / "__init__.py").is_file() and root.parent != root:  # a package is one thing
        root = root.parent
    found: dict[str, Path] = {}
    waiting = [start]
    while waiting:
        path = waiting.pop()
        name = str(path.relative_to(root))
        if name not in found:
            found[name] = path
            waiting += [p for p in _used(path, root) if p.is_relative_to(root)]
    if len(found) == 1:
        return _hash(start)
    return digest([str(start.relative_to(root)), *([name, _hash(found[name])] for name in sorted(found))])


def _hash(file: Path) -> str:
    with open(file, "rb") as f:
        return hashlib.file_digest(f, "sha256").hexdigest()


def _used(path: Path, root: Path) -> list[Path]:
    """Files that a Python file may use of the folders it stands in."""
    if path.suffix != ".py":
        return []
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return []
    return [file for base, name in _names(tree, path, root) for file in _files(base, name.split("."))]


def _names(tree: ast.AST, path: Path, root: Path) -> Iterator[tuple[Path, str]]:
    """Dotted names of modules that a text mentions, each with the folders to look in."""
    beside = (path.parent, root)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((base, alias.name) for alias in node.names for base in beside)
        elif isinstance(node, ast.ImportFrom):
            above = node.level - 1
            bases = beside if above < 0 else (path.parents[above],) if above < len(path.parents) else ()
            whole = [f"{node.module}.{a.name}" if node.module else a.name for a in node.names]
            yield from ((base, name) for base in bases for name in whole)
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in _IMPORT_FUNCTIONS and isinstance(node.args[0].value, str):
                yield from ((base, node.args[0].value.lstrip(".")) for base in beside)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.endswith(".py"):
            stem = node.value[:-3]
            if stem and "." not in stem and "\0" not in stem and len(stem) < 200:
                yield from ((base, stem.replace("/", ".")) for base in beside)


def _files(base: Path, parts: Sequence[str]) -> list[Path]:
    """Files of a dotted name below a folder: those of its packages and of the module itself, compiled ones too."""
    found: list[Path] = []
    for k, part in enumerate(parts):
        folder = base.joinpath(*parts[:k])
        if not part or not folder.is_dir():
            break
        tries = [
            folder / f"{part}.py",
            folder / part / "__init__.py",
            *folder.glob(f"{part}.*.so"),
            folder / f"{part}.so",
        ]
        found += [Path(os.path.realpath(p)) for p in tries if p.is_file()]
    return found
