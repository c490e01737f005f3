"""What several modules of these tests share."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sample_studies as studies

from rso.core import disk
from rso.emulation import emulator
from rso.result_types import FILES


@pytest.fixture(scope="session", autouse=True)
def every_result_file_is_as_documented() -> Iterator[None]:
    """Whatever a test makes the program write has the keys of `rso.result_types`, all of them and no other."""
    replace = disk.replace

    def checked(path: Path, content: bytes | str, *, durably: bool = False) -> Path:
        if path.name in FILES:
            pareto = path.name == "results.json" and json.loads(content).get("kind") == "pareto"
            FILES[f"objectives/{path.name}" if pareto else path.name].model_validate_json(content)
        return replace(path, content, durably=durably)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(disk, "replace", checked)
        yield


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands simulate in this process: a worker takes a second to start."""
    monkeypatch.setattr("rso.evaluation.WorkerPool", studies.Here)


@pytest.fixture(scope="module")
def curves_learnt_once() -> Iterator[None]:
    """Surfaces of the same simulations are the same: those that other data of a module are held to are fitted once."""
    known: dict[Any, Any] = {}
    learn = emulator.fit_curve

    def learnt(*arrays: np.ndarray, **more: Any) -> Any:
        parts = [*arrays, *(v for _, v in sorted(more.items()))]
        key = tuple((v.shape, v.tobytes()) if isinstance(v, np.ndarray) else v for v in parts), tuple(sorted(more))
        if key not in known:
            known[key] = learn(*arrays, **more)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(emulator, "fit_curve", learnt)
        yield


@pytest.fixture
def no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks do not plan a diagnosis: that is most of their time, and of other tests."""
    monkeypatch.setattr("rso.cli.checking._diagnosis", lambda *_: [])
