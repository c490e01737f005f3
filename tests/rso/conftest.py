"""What several modules of these tests share."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sample_studies as studies

from rso.core import disk
from rso.emulation import emulator
from rso.result_types import RESULT_FILES


@pytest.fixture(scope="session", autouse=True)
def every_result_file_is_as_documented() -> Iterator[None]:
    """Whatever a test makes the program write has the keys of `rso.result_types`, all of them and no other."""
    replace = disk.replace

    def checked(path: Path, content: bytes | str, *, durably: bool = False) -> Path:
        if path.name in RESULT_FILES:
            pareto = path.name == "results.json" and json.loads(content).get("kind") == "pareto"
            RESULT_FILES[f"objectives/{path.name}" if pareto else path.name].model_validate_json(content)
        return replace(path, content, durably=durably)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(disk, "replace", checked)
        yield


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands simulate in this process: a worker takes a second to start."""
    monkeypatch.setattr("rso.evaluation.WorkerPool", studies.Here)


@pytest.fixture(scope="session", autouse=True)
def surfaces_learnt_once() -> Iterator[None]:
    """Surfaces of the same simulations are the same: a process fits them once, whatever test asks for them."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("fit_curve", "fit_surrogate", "refit", "refit_curve"):
            patch.setattr(emulator, name, _once(getattr(emulator, name)))
        yield


def _once(learn: Callable[..., Any]) -> Callable[..., Any]:
    """What is learnt from the same bits of all arguments is learnt once."""
    known: dict[Any, Any] = {}

    def bits(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value.shape, value.dtype.str, value.tobytes()
        return tuple(map(bits, value)) if isinstance(value, tuple | list) else value

    def learnt(*values: Any, **more: Any) -> Any:
        key = tuple(map(bits, values)), tuple((name, bits(more[name])) for name in sorted(more))
        if key not in known:
            known[key] = learn(*values, **more)
        return known[key]

    return learnt


@pytest.fixture
def no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks do not plan a diagnosis: that is most of their time, and of other tests."""
    monkeypatch.setattr("rso.cli.checking._diagnosis", lambda *_: [])
