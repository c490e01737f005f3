"""Runs on a Dask cluster: the same tasks through the executor of its client, nothing shared but the scheduler.

Optional (extra `dask`).  Artefacts travel with the tasks and are kept by hash on each machine, so that workers need
no disk in common with the parent; a backend that is a module must be importable there.
"""

from __future__ import annotations

import dataclasses
import os
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rso.contract import Case
from rso.evaluation.adapters import Source
from rso.evaluation.artefact_files import artefacts_by_hash, keep_artefact
from rso.evaluation.pool import WorkerPool, WorkersCannotStart

if TYPE_CHECKING:
    from distributed import Client

CONNECTION_TIMEOUT_S = 30.0  # for the scheduler to answer
LOOPBACK_ADDRESS = "127.0.0.1:0"
_here = threading.local()  # one pool of one process per thread of a Dask worker


class ClusterExecutor(Executor):
    """A Dask client behind the interface of `concurrent.futures`.

    Every call runs in a process of its own below the Dask worker (a :class:`WorkerPool` of one, which loads `source`
    once): a crash of compiled code or a time-out (`timeout_s`, wall) costs that run and not the worker.
    """

    def __init__(self, client: Client, source: Source | None = None, timeout_s: float | None = None) -> None:
        self.source = source
        self._client, self._timeout_s = client, timeout_s
        self._inner = client.get_executor(pure=False)
        self._sent: dict[str, Any] = {}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue one call; files of a case among its arguments go along."""
        files = {
            sha: self._scattered(path)
            for a in args
            if isinstance(a, Case)
            for sha, path in artefacts_by_hash(a).items()
        }
        shas = tuple(files)
        return self._inner.submit(
            _there, self.source, self._timeout_s, fn, args, kwargs, shas, *(files[sha] for sha in shas)
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Hand in no more; with `cancel_futures` what runs is given up too."""
        self._inner.shutdown(wait=wait and not cancel_futures)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.shutdown(cancel_futures=kind is not None)

    def _scattered(self, path: Path) -> Any:
        """The content of a file, sent to the cluster once."""
        if path.name not in self._sent:
            self._sent[path.name] = self._client.scatter(path.read_bytes(), hash=False)
        return self._sent[path.name]


@contextmanager
def open_cluster(
    address: str | None, jobs: int, source: Source | None = None, timeout_s: float | None = None
) -> Iterator[ClusterExecutor]:
    """Executor of the Dask scheduler at `address`; without one, of a cluster of `jobs` threads within this process.

    Each call has a process of its own anyway, and within one process the cluster opens no port that others could use: a
    Dask scheduler runs whatever whoever reaches it sends.  Its pages of status are switched off and not served.
    WorkersCannotStart if Dask is not installed or no scheduler answers there.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise WorkersCannotStart(f"engine = 'dask' needs Dask ({error}): pip install 'rso[dask]'") from error
    try:
        local = None if address else _within(jobs)
        client = Client(address or local, timeout=CONNECTION_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise WorkersCannotStart(f"no Dask scheduler at {address or 'this machine'}: {error}") from error
    try:
        with ClusterExecutor(client, source, timeout_s) as executor:
            yield executor
    finally:
        client.close()
        if local is not None:
            local.close()


def _within(jobs: int) -> Any:
    """A cluster within this process; its servers of status pages, which Dask starts in any case, have no pages and
    listen on this machine's loopback only."""
    import dask
    from distributed import LocalCluster

    quiet: dict[str, list[str]] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
    with dask.config.set(quiet):
        cluster = LocalCluster(
            n_workers=jobs,
            threads_per_worker=1,
            processes=False,
            protocol="inproc://",
            worker_dashboard_address=LOOPBACK_ADDRESS,
            memory_limit=0,
            scheduler_kwargs={"dashboard": False, "dashboard_address": LOOPBACK_ADDRESS},
        )
    for node in (cluster.scheduler, *cluster.workers.values()):
        if (server := getattr(node, "http_server", None)) is not None:
            server.stop()
    return cluster


def _there(
    source: Source | None,
    timeout_s: float | None,
    fn: Callable[..., Any],
    args: tuple[Any, ...],
    kwargs: Mapping[str, Any],
    shas: tuple[str, ...],
    *contents: bytes,
) -> Any:
    """On a worker of the cluster: put the files where the case can find them, and compute in a process apart."""
    folder = Path(tempfile.gettempdir()) / f"rso-objects-{os.getuid()}"
    for sha, content in zip(shas, contents, strict=True):
        keep_artefact(folder, sha, content)
    args = tuple(dataclasses.replace(a, objects=str(folder)) if isinstance(a, Case) and shas else a for a in args)
    pool = getattr(_here, "pool", None)
    if pool is None or _here.made_for != (source, timeout_s) or pool.broken:
        pool = _here.pool = WorkerPool(1, source=source, timeout_s=timeout_s)
        _here.made_for = (source, timeout_s)
    return pool.submit(fn, *args, **kwargs).result()
