"""What several modules of these tests share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import sample_studies as studies

from rso.emulation import emulator


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
