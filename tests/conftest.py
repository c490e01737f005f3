"""rso is imported before anything imports numpy: it pins the threads of the linear algebra underneath."""

import gc

import pytest

import rso  # noqa: F401

# A file stays on one core: these take 15 s and more, and one that begins last would leave the other cores idle.
LONGEST = {"whole", "cli", "report", "ladder", "errors", "scaling", "multipliers", "diagnosis_report", "diagnosis",
           "symmetry", "surface", "unbreakable", "contact_found", "python", "bowl_friction", "combining"}  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.stem.removeprefix("test_") not in LONGEST)


def pytest_collection_finish() -> None:
    """What imports and collection made stays to the end: no later garbage collection has to go through it again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(7000, 10, 10)  # and it needs to look less often than a program of a few objects
