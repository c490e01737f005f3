"""Figures of the verification set: RSO_TABLE=docs/verification.md ./dev test -m verification writes them down."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

sys.path += [str(Path(__file__).parents[1] / name) for name in ("fem_backend", "rso")]  # cube.py, contact_records.py
HEAD = """# Verification of the finite element backend

Every figure is from a run of the test named beside it. The table is written by

    RSO_TABLE=docs/verification.md ./dev test -m verification

(rows of tests that were not run stay as they were). A test fails when its figure leaves the limit written in the test.
Forces are in N, lengths in mm; percentages are of the force unless said otherwise.

What costs little has no row: it is held by the daily tests, `./dev test tests/fem_backend`.

| property | tests |
|---|---|
| tangents of laws and elements are derivatives | `test_stress.py`, `test_element.py` |
| those of contact, friction and fibres | `test_contact.py`, `test_memory.py` |
| those of memory and of the whole model | `test_memory.py`, `test_tangent.py` |
| derivatives by knobs are differences of whole runs | `test_slopes.py` |
| objectivity; homogeneous closed forms; neutral laws | `test_stress.py`, `test_laws.py`, `test_memory.py` |
| relaxation and ramps against quadrature, rate limits, softened paths | `test_memory.py` |
| sag under weight against a bar | `test_gravity.py` |
| quarter = half = whole; turned by 90°, turned forces; an effect that is off changes no bit | `test_symmetry.py` |
| exact similarity, with every law and with friction | `test_scaling.py` |
| loop of Coulomb, work of separation, contact found again in any frame | `test_contact.py` |

Negative controls (normal or friction reversed, a wrong factor in law or area): `test_controls.py` of the marked set.
Beside 2 500 public slab curves of another code: [nanoindentation](../reports/nanoindentation.md).

| property | measured | test |
|---|---|---|
"""
ROWS: dict[str, tuple[str, str]] = {}


@pytest.fixture
def record(request):
    """record(property, figure): one row of the table, named after the test."""

    def note(what: str, figure: str) -> None:
        name = f"`{Path(request.node.path).name}::{request.node.name}`"
        ROWS[f"{name} {what}"] = what, f"| {what} | {figure} | {name} |"
        print(f"\n{what}: {figure}")

    return note


@pytest.fixture(scope="session", autouse=True)
def own_mesh_cache(tmp_path_factory):
    """Meshes made here do not go to the user's cache, and none is taken from it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def pytest_sessionfinish() -> None:
    """Write the table, in the order of the names of the tests."""
    target = os.environ.get("RSO_TABLE")
    if not target or not ROWS:
        return
    path = Path(target)
    rows = {key: row for key, (_, row) in ROWS.items()}
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            cells = [c.strip() for c in line.split(" | ")]
            if len(cells) == 3 and cells[2].startswith("`"):
                rows.setdefault(f"{cells[2].removesuffix(' |')} {cells[0].removeprefix('| ')}", line)
    path.write_text(HEAD + "\n".join(rows[key] for key in sorted(rows)) + "\n", encoding="utf-8")
