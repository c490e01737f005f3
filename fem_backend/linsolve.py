"""Direct solution of K x = b for the CSR matrices of `element`: MKL Pardiso if installed, else SuperLU.

SuperLU with the METIS numbering of the dofs is the permissive default everywhere; pypardiso (the `fast` extra) is
about four times faster.  Both are exact to round-off, so the choice does not enter a run key.
"""

from __future__ import annotations

import functools
import weakref
from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from fem_backend.element import Pattern


class NotPositiveDefinite(ArithmeticError):
    """The matrix has a pivot that is not positive."""


Solve = Callable[[np.ndarray], np.ndarray]
Factor = Callable[[np.ndarray], Solve]


def solver(pattern: Pattern, prefer: str = "auto") -> Factor:
    """A function data → (b → x) for matrices of one pattern; `prefer` is auto, pardiso or superlu.

    A symmetric pattern means positive definite matrices: factorising others raises NotPositiveDefinite.  The pattern
    is analysed once, the factors are overwritten each time.
    """
    if prefer not in ("auto", "pardiso", "superlu"):
        raise ValueError(f"solver {prefer!r} is unknown; choose auto, pardiso or superlu")
    if prefer != "superlu" and (prefer == "pardiso" or available() == "pardiso"):
        return _Pardiso(pattern).factor
    if not pattern.symmetric:
        return functools.partial(_superlu_general, pattern)
    return functools.partial(_superlu, pattern, _mirror(pattern))


@functools.cache
def available() -> str:
    """The solver that `auto` takes on this machine."""
    try:
        import pypardiso

        pypardiso.PyPardisoSolver(mtype=2)
    except (ImportError, OSError):
        return "superlu"
    return "pardiso"


def _mirror(pattern: Pattern) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Full CSC pattern of the symmetric matrix and, for each of its entries, its place in the upper data."""
    n = pattern.size
    number = np.arange(1, len(pattern.indices) + 1, dtype=np.float64)
    upper = sparse.csr_matrix((number, pattern.indices, pattern.indptr), shape=(n, n))
    full = (upper + sparse.triu(upper, 1).T).tocsc()
    full.sort_indices()
    return full.indptr, full.indices, full.data.astype(np.int64) - 1


def _superlu(pattern: Pattern, mirror: tuple[np.ndarray, np.ndarray, np.ndarray], data: np.ndarray) -> Solve:
    indptr, indices, place = mirror
    matrix = sparse.csc_matrix((data[place], indices, indptr), shape=(pattern.size, pattern.size))
    try:
        lu = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:  # "Factor is exactly singular"
        raise NotPositiveDefinite(str(error)) from error
    if np.any(lu.perm_r != lu.perm_c) or np.any(lu.U.diagonal() <= 0.0):  # rows are swapped where a pivot is zero
        raise NotPositiveDefinite("negative pivot")
    return lu.solve


def _superlu_general(pattern: Pattern, data: np.ndarray) -> Solve:
    matrix = sparse.csr_matrix((data, pattern.indices, pattern.indptr), shape=(pattern.size, pattern.size)).tocsc()
    try:
        return splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.01, options={"SymmetricMode": True}).solve
    except RuntimeError as error:  # "Factor is exactly singular"
        raise NotPositiveDefinite(str(error)) from error


class _Pardiso:
    """Pardiso, matrix type 2 (SPD) or 1 (symmetric pattern, any values), analysis kept between factorisations."""

    def __init__(self, pattern: Pattern) -> None:
        import pypardiso

        self._error = pypardiso.pardiso_wrapper.PyPardisoError
        self._solver = pypardiso.PyPardisoSolver(mtype=2 if pattern.symmetric else 1)
        self._solver.set_iparm(1, 1)  # all parameters are given here
        self._solver.set_iparm(2, 2)  # METIS
        self._solver.set_iparm(10, 13)
        self._solver.set_iparm(24, 0)
        self._solver.set_iparm(35, 0)
        self._shape = (pattern.size, pattern.size)
        self._pattern = pattern
        self._analysed = False
        # a full model's factors are 0.1 to 0.4 GB outside Python's sight; not at exit, when modules are half gone
        weakref.finalize(self, _free, self._solver).atexit = False

    def _call(self, phase: int, data: np.ndarray, b: np.ndarray) -> np.ndarray:
        matrix = sparse.csr_matrix((data, self._pattern.indices, self._pattern.indptr), shape=self._shape)
        self._solver.set_phase(phase)
        return self._solver._call_pardiso(matrix, b)

    def factor(self, data: np.ndarray) -> Solve:
        empty = np.zeros(self._shape[0])
        if not self._analysed:
            self._call(11, data, empty)
            self._analysed = True
        try:
            self._call(22, data, empty)
        except self._error as error:
            if error.value == -4:
                raise NotPositiveDefinite("negative pivot") from error
            raise
        return lambda b: self._call(33, data, np.asfortranarray(b))


def _free(solver: object) -> None:
    solver.free_memory(everything=True)  # type: ignore[attr-defined]
