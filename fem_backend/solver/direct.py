"""Direct solution of K x = b for the CSR matrices of `element`: MKL Pardiso if installed, else SuperLU.

SuperLU with the METIS numbering of the dofs is the permissive default everywhere; pypardiso (the `fast` extra) is
about four times faster.  Both are exact to round-off, so the choice does not enter a run key.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.metadata
import os
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from fem_backend.kinematics.numbering import Pattern

DOUBLE_PRECISION_TOLERANCE = 1e-12  # relative correction at which a solution counts as that of double precision
SINGLE_PRECISION_TOLERANCE = 1e-2  # accuracy that a factor in single precision has without a check
MAX_CORRECTION_RATIO = 0.1  # ratio of two corrections beyond which a matrix is factorised in double
MAX_SINGLE_PRECISION_FAILURES = 2  # such matrices after which single precision is given up


class NotPositiveDefinite(ArithmeticError):
    """The matrix has a pivot that is not positive."""


Solve = Callable[..., np.ndarray]  # b → x, or (b, accuracy) → x
Factor = Callable[..., Solve]  # data → Solve, of the iterative one (data, motions of almost no energy) → Solve


def solver(pattern: Pattern, prefer: str = "auto") -> Factor:
    """A function data → (b → x) for matrices of one pattern; `prefer` is auto, pardiso or superlu.

    A symmetric pattern means positive definite matrices: factorising others raises NotPositiveDefinite.  The pattern
    is analysed once, the factors are overwritten each time.
    """
    if prefer not in ("auto", "pardiso", "superlu"):
        raise ValueError(f"solver {prefer!r} is unknown; choose auto, pardiso or superlu")
    if prefer != "superlu" and (prefer == "pardiso" or available() == "pardiso"):
        return _Mixed(pattern, _Pardiso(pattern).factor).factor
    if not pattern.symmetric:
        return _Mixed(pattern, functools.partial(_superlu_general, pattern)).factor
    return _Mixed(pattern, functools.partial(_superlu, pattern, _mirror(pattern))).factor


def precise(pattern: Pattern, prefer: str = "auto") -> Factor:
    """As `solver`, in double precision from the start; its memory goes with the solution."""
    factor = raw_factors(pattern, prefer)[0]
    return lambda data: _exactly(factor(data))


def raw_factors(pattern: Pattern, prefer: str = "auto") -> tuple[Factor, Callable[[], None]]:
    """Factors in the precision of their data, without refinement, and what frees the memory of the last one."""
    if prefer != "superlu" and (prefer == "pardiso" or available() == "pardiso"):
        pardiso = _Pardiso(pattern)
        return pardiso.factor, pardiso.release
    if pattern.symmetric:
        return functools.partial(_superlu, pattern, _mirror(pattern)), lambda: None
    return functools.partial(_superlu_general, pattern), lambda: None


@functools.cache
def available() -> str:
    """The solver that `auto` takes on this machine."""
    _point_to_mkl()
    try:
        import pypardiso

        pypardiso.PyPardisoSolver(mtype=2)
    except (ImportError, OSError):
        return "superlu"
    return "pardiso"


def _point_to_mkl() -> None:
    """Tell pypardiso where MKL is: it looks through all files of the installation, 0.8 s at every matrix."""
    if "PYPARDISO_MKL_RT" in os.environ:
        return
    try:
        files = importlib.metadata.files("mkl") or []
    except importlib.metadata.PackageNotFoundError:
        return  # installed in another way: pypardiso will look for it
    found = sorted(str(f.locate()) for f in files if "mkl_rt" in f.name and f.suffix != ".lib")
    if found and os.path.exists(found[0]):
        os.environ["PYPARDISO_MKL_RT"] = found[0]


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


class _Mixed:
    """Factors in single precision, solutions in double: iterative refinement (Wilkinson 1963; Higham 2002, §12).

    Single factors take 0.6 of the time and half of the memory.  What they say is checked in double: a matrix that they
    refuse, or whose refinement is slow, is factorised in double, and after two of those all are.
    """

    def __init__(self, pattern: Pattern, factor: Factor) -> None:
        self._pattern, self._factor, self._poor = pattern, factor, 0

    def factor(self, data: np.ndarray) -> Solve:
        if self._poor >= MAX_SINGLE_PRECISION_FAILURES:
            return _exactly(self._factor(data))
        size = float(np.abs(data).max()) or 1.0
        try:
            rough = self._factor((data / size).astype(np.float32))
        except NotPositiveDefinite:
            exact = _exactly(self._factor(data))  # in double the matrix may be definite, and if not, this raises
            self._poor += 1
            return exact
        upper = sparse.csr_matrix((data, self._pattern.indices, self._pattern.indptr), shape=2 * (self._pattern.size,))
        double: Solve | None = None

        def solve(b: np.ndarray, accuracy: float = DOUBLE_PRECISION_TOLERANCE) -> np.ndarray:
            nonlocal double
            if double is None:
                x = self._refined(upper, rough, size, b, accuracy)
                if x is not None:
                    return x
                self._poor += 1
                double = self._factor(data)
            return double(b)

        return solve

    def _refined(
        self, upper: sparse.csr_matrix, rough: Solve, size: float, b: np.ndarray, accuracy: float
    ) -> np.ndarray | None:
        """x with K x = b, or None where the corrections do not shrink."""
        scale = float(np.abs(b).max()) or 1.0
        x, last, rate, r = np.zeros_like(b), 0.0, 1.0, b
        diagonal = upper.data[self._pattern.diagonal]
        while True:
            step = rough((r / scale).astype(np.float32)).astype(float) * (scale / size)
            x = x + step
            now, whole = float(np.linalg.norm(step)), float(np.linalg.norm(x))
            if last:
                rate = now / last
                if not rate <= MAX_CORRECTION_RATIO:
                    return None
            # the next correction would be this small
            if accuracy >= SINGLE_PRECISION_TOLERANCE or now * rate <= accuracy * whole:
                return x
            last = now
            r = upper @ x
            if self._pattern.symmetric:
                r += upper.T @ x - diagonal * x
            r = b - r
            scale = float(np.abs(r).max()) or 1.0


def _exactly(solve: Solve) -> Solve:
    """A solution in double precision is always accurate."""
    return lambda b, accuracy=0.0: solve(b)


class _Pardiso:
    """Pardiso, matrix type 2 (SPD) or 1 (symmetric pattern, any values), one analysis for each precision."""

    def __init__(self, pattern: Pattern) -> None:
        _point_to_mkl()
        self._pattern = pattern
        self._solvers: dict[type, object] = {}

    def _solver(self, dtype: type) -> tuple[object, bool]:
        """The solver of a precision, and whether it is new."""
        if dtype in self._solvers:
            return self._solvers[dtype], False
        import pypardiso

        solver = pypardiso.PyPardisoSolver(mtype=2 if self._pattern.symmetric else 1)
        for place, value in ((1, 1), (5, 1), (10, 13), (24, 0), (35, 0), (28, int(dtype is np.float32))):
            solver.set_iparm(place, value)  # 1: all are given here; 5: our order; 28: precision
        solver.perm = np.arange(1, self._pattern.size + 1, dtype=np.int32)  # METIS of nodes: less fill than of dofs
        self._solvers[dtype] = solver
        # a full model's factors are 0.1 to 0.4 GB outside Python's sight; not at exit, when modules are half gone
        weakref.finalize(self, _free, solver).atexit = False
        return solver, True

    def factor(self, data: np.ndarray) -> Solve:
        solver, new = self._solver(data.dtype.type)
        empty = np.zeros(self._pattern.size, data.dtype)
        for other in self._solvers.values():
            if other is not solver:
                _free(other, everything=False)  # its factor is of a matrix before; its analysis stays
        if new:
            _call(solver, 11, data, *self._pattern.from_one, empty, empty.copy())
        try:
            _call(solver, 22, data, *self._pattern.from_one, empty, empty.copy())
        except NotPositiveDefinite:
            _free(solver, everything=False)
            raise

        def solve(b: np.ndarray) -> np.ndarray:
            b = np.asfortranarray(b)
            x = np.zeros_like(b)
            _call(solver, 33, data, *self._pattern.from_one, b, x)
            return np.ascontiguousarray(x)

        return solve

    def release(self) -> None:
        """Free all factors; solutions with them are at an end."""
        for solver in self._solvers.values():
            _free(solver)
        self._solvers.clear()


class Schur:
    """Schur complements of one symmetric pattern on the dofs (c,), increasing, by Pardiso in single precision."""

    def __init__(self, pattern: Pattern, dofs: np.ndarray) -> None:
        _point_to_mkl()
        import pypardiso

        self._size, self._dofs, self._analysed = pattern.size, dofs, False
        self._solver = pypardiso.PyPardisoSolver(mtype=2)
        for place, value in ((1, 1), (2, 2), (10, 13), (28, 1), (35, 0), (36, 2)):
            self._solver.set_iparm(place, value)  # 2: its own METIS, 28: single precision, 36: Schur complement
        self._pattern = pattern
        self._solver.perm = np.zeros(pattern.size, np.int32)  # chooses the dofs of the complement
        self._solver.perm[dofs] = 1
        weakref.finalize(self, _free, self._solver).atexit = False

    def factor(self, data: np.ndarray) -> tuple[np.ndarray, Solve, Solve]:
        """S (c, c), the reduction of b (f,) that leaves b_c − K_ci K_ii⁻¹ b_i in the dofs c, and the unloading.

        There must be such dofs: Pardiso crashes without.  Raises NotPositiveDefinite, also where S is not.
        """
        S = np.zeros((len(self._dofs), len(self._dofs)), np.float32)
        nothing = np.zeros(max(S.size, self._size), np.float32)
        if not self._analysed:
            _call(self._solver, 11, data, *self._pattern.from_one, nothing, nothing.copy())
            self._analysed = True
        _call(self._solver, 22, data, *self._pattern.from_one, nothing, S)

        def half(phase: int, b: np.ndarray) -> np.ndarray:
            x = np.zeros_like(b)
            _call(self._solver, phase, data, *self._pattern.from_one, b, x)
            return x

        return S, functools.partial(half, 331), functools.partial(half, 333)


def _call(
    solver: Any, phase: int, data: np.ndarray, starts: np.ndarray, columns: np.ndarray, b: np.ndarray, x: np.ndarray
) -> None:
    """Pardiso itself: its Python wrapper makes the places anew each time and has no room for a result of another shape.

    Raises NotPositiveDefinite.
    """
    error = ctypes.c_int32(0)

    def one(value: int) -> object:
        return ctypes.byref(ctypes.c_int32(value))

    def many(array: np.ndarray) -> object:
        return ctypes.cast(array.ctypes.data, ctypes.POINTER(ctypes.c_int32))

    solver._mkl_pardiso(
        ctypes.cast(solver.pt.ctypes.data, ctypes.POINTER(solver._pt_type[0])),
        one(1),
        one(1),
        one(solver.mtype),
        one(phase),
        one(len(starts) - 1),
        data.ctypes.data,
        many(starts),
        many(columns),
        many(solver.perm),
        one(1 if b.ndim == 1 else b.shape[1]),
        many(solver.iparm),
        one(0),
        b.ctypes.data,
        x.ctypes.data,
        ctypes.byref(error),
    )
    if error.value == -4:
        raise NotPositiveDefinite("negative pivot")
    if error.value:
        raise ArithmeticError(f"Pardiso ends with error {error.value} in phase {phase}")


def _free(solver: object, everything: bool = True) -> None:
    solver.free_memory(everything=everything)  # type: ignore[attr-defined]
