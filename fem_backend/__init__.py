"""fem_backend: finite element indentation of soft bodies, usable on its own."""

import atexit
import contextlib
import os
import shutil
import tempfile
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # before numpy: see rso/__init__.py


def _place_for_kernels() -> None:
    """A folder for compiled code where numba has none; as in rso/__init__.py, without which this package runs too."""
    home = Path(os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache"))
    for folder in (Path(__file__).parent / "__pycache__", home / "numba"):
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return
    with contextlib.suppress(OSError):
        os.environ["NUMBA_CACHE_DIR"] = private = tempfile.mkdtemp(prefix="kernels-")
        atexit.register(shutil.rmtree, private, ignore_errors=True)


if not os.environ.get("NUMBA_CACHE_DIR"):
    _place_for_kernels()
