"""Running simulations: adapters for backends, a pool of worker processes, and `run_all`.

Public names are listed here; the files behind them are private to this room.
"""

from rso.evaluation.adapters import CommandBackend, Source, load_backend
from rso.evaluation.cluster import ClusterExecutor, open_cluster
from rso.evaluation.dispatch import Event, Finished, Planned, Preparing, Retried, Task, begin_ahead, run_all
from rso.evaluation.evaluator import Evaluator, Outcome, Watch, in_rows, responses, why
from rso.evaluation.executor_loop import Ahead
from rso.evaluation.machines import executor
from rso.evaluation.pool import WorkerDied, WorkerPool, WorkersCannotStart
from rso.evaluation.slurm import ArraySettings, SlurmExecutor, open_slurm
from rso.evaluation.store import Crashed, Done, Failed

__all__ = [
    "Ahead",
    "ArraySettings",
    "ClusterExecutor",
    "CommandBackend",
    "Crashed",
    "Done",
    "Evaluator",
    "Event",
    "Failed",
    "Finished",
    "Outcome",
    "Planned",
    "Preparing",
    "Retried",
    "SlurmExecutor",
    "Source",
    "Task",
    "Watch",
    "WorkerDied",
    "WorkerPool",
    "WorkersCannotStart",
    "begin_ahead",
    "executor",
    "in_rows",
    "load_backend",
    "open_cluster",
    "open_slurm",
    "responses",
    "run_all",
    "why",
]
