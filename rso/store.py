"""The store of runs under the name by which scripts outside know it: see :mod:`rso.evaluation.store`."""

from rso.evaluation.store import Crashed, Done, Failed, RunStore, StoreError

__all__ = ["Crashed", "Done", "Failed", "RunStore", "StoreError"]
