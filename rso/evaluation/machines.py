"""Where the simulations of a study are computed: by its table [dispatch] and by what its backend is."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from rso.evaluation.adapters import Source
from rso.evaluation.cluster import open_cluster
from rso.evaluation.pool import WorkerPool
from rso.evaluation.slurm import ArraySettings, open_slurm


def executor(table: Any, jobs: int, source: Source, folder: Path, warm: bool = False) -> Any:
    """What runs the simulations of a study by its table [dispatch]: processes of this machine, Dask, or SLURM."""
    own = (
        source.timeout_s if source.command is None else None
    )  # a command is stopped by its adapter, which keeps its folder
    limit = min((t for t in (table.timeout, own) if t is not None), default=None)
    if table.engine == "dask":  # a folder of this machine means nothing there
        return open_cluster(table.address, jobs, source, limit)
    if source.command is not None:  # folders of runs that did not end well stay with the results
        source = dataclasses.replace(source, keep_folder=str(folder / "kept"))
    if table.engine == "slurm":
        asked = table.slurm
        place = folder / "slurm" if asked.folder is None else Path(asked.folder).expanduser().absolute()
        settings = ArraySettings(minutes=asked.walltime / 60, **asked.model_dump(exclude={"walltime", "folder"}))
        return open_slurm(place, jobs, settings, source, limit)
    return WorkerPool(jobs, source=source, timeout_s=limit, warm=warm)
