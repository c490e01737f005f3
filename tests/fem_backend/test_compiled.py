"""Compiled functions are what was written, and cost nothing where none is called."""

import subprocess
import sys

import numpy as np
import pytest

from fem_backend.compiled import CompiledFunction, compiled
from fem_backend.geometry import EllipsoidShape


def test_the_backend_is_there_without_numba():
    code = "import sys; from fem_backend.backend import BACKEND; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]


@compiled()
def half(x):
    return 0.5 * x


@compiled(fastmath=True)
def quarter(x):
    return half(half(x))


def test_a_function_calls_those_of_its_module():
    names = globals()
    assert quarter(3.0) == 0.75 == quarter.py_func(3.0)
    assert not isinstance(names["half"], CompiledFunction)  # what numba can call
    assert quarter.__name__ == "quarter"


@pytest.mark.parametrize("n", [1, 8, 9, 50])
def test_few_points_and_many_lie_equally_deep(n):
    """Few are computed by the plain function."""
    shape = EllipsoidShape(60.0, 35.0, 30.0)
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3)) * [60.0, 35.0, 30.0]
    assert shape.depth(X[:n]) == pytest.approx(shape.depth(X)[:n], rel=1e-12, abs=1e-12)
