"""rso: what a soft material is from an indentation test, how sure one can be, and what the model is missing."""

import atexit
import contextlib
import importlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

# Before numpy is imported anywhere: on a loaded machine two BLAS threads made a small GP fit 30 times slower.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# numpy takes it for a whole number once scipy imports all of it, and ends where it is none; nothing here asks for it.
if not os.environ.get("SOURCE_DATE_EPOCH", "0").removeprefix("-").isdecimal():
    del os.environ["SOURCE_DATE_EPOCH"]

__version__ = "0.1.0"
__all__ = [
    "AskedRun",
    "Backend",
    "Case",
    "FreeCurve",
    "FunctionModel",
    "Parameter",
    "ParetoResult",
    "ParetoStudy",
    "Programme",
    "Response",
    "RunResult",
    "SimulationFailed",
    "SpecimensResult",
    "SpecimensStudy",
    "StudyError",
    "Workspace",
    "fit",
    "indent",
    "load",
    "model",
    "pareto",
    "specimens",
]


def __getattr__(name: str) -> Any:
    """A public name, loaded when it is first used: the command line needs none of them to begin."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module("rso.api"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _place_for_kernels() -> None:
    """numba refuses to import a kernel that it can keep nowhere: beside the code, or in the user's cache."""
    home = Path(os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache"))
    for folder in (Path(__file__).parent / "__pycache__", home / "numba"):
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return
    # What is kept there is code: a folder of this process and its workers alone, gone with it.
    with contextlib.suppress(OSError):  # without a temporary folder numba says what it misses
        os.environ["NUMBA_CACHE_DIR"] = private = tempfile.mkdtemp(prefix="kernels-")
        atexit.register(shutil.rmtree, private, ignore_errors=True)


if not os.environ.get("NUMBA_CACHE_DIR"):
    _place_for_kernels()
