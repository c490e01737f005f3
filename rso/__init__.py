"""rso: what a soft material is from an indentation test, how sure one can be, and what the model is missing."""

import os

# Before numpy is imported anywhere: on a loaded machine two BLAS threads made a small GP fit 30 times slower.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

__version__ = "0.1.0"
