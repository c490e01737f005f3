"""rso is imported before anything imports numpy: it pins the threads of the linear algebra underneath."""

import gc

import rso  # noqa: F401


def pytest_collection_finish() -> None:
    """What imports and collection made stays to the end: no later garbage collection has to go through it again."""
    gc.collect()
    gc.freeze()
