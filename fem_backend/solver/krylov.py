"""Solution of K x = b for an unconstrained body: Krylov iterations on a factor in single precision.

Six motions of such a body cost almost no energy, a billionth of that of an element: what single precision says of them
is noise, and refinement with its factors fails.  Conjugate gradients or GMRES in double precision need a dozen steps
more for them (Saad 2003, algorithms 9.1 and 9.4), a tenth of the time of factors in double precision.  The factor is
that of the symmetric part, slightly shifted, and may be that of a matrix before.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse

from fem_backend.kinematics.numbering import Pattern
from fem_backend.solver.direct import NotPositiveDefinite, Solve, precise, raw_factors

DIAGONAL_SHIFTS = (1e-7, 1e-5)  # of the diagonal, added in the factor only: above the noise of single precision
# relative correction asked for at best: what the shift hides of it is beyond a Newton step's need
MIN_KRYLOV_TOLERANCE = 1e-7
# share of the skew part in a matrix below which the symmetric part says whether there is a minimum
MAX_SKEW_SHARE = 1e-3
MAX_OLD_FACTOR_STEPS, MAX_OWN_FACTOR_STEPS = 10, 60  # steps with a factor of an earlier matrix, with its own
# step at which an earlier one is given up if what is left is more than this
OLD_FACTOR_CHECK_STEP, MAX_REMAINDER_AT_CHECK = 3, 0.1

Rough = Callable[[np.ndarray], np.ndarray]


class KrylovSolver:
    """Factors of one pattern as :func:`fem_backend.solver.direct.solver` makes them; only one is alive at a time.

    A symmetric matrix with a negative direction raises NotPositiveDefinite when it is solved with, a general one is
    not looked at.  The factor of an earlier matrix serves as long as it needs no more than MAX_OLD_FACTOR_STEPS steps.
    """

    def __init__(self, pattern: Pattern, prefer: str) -> None:
        self._pattern, self._prefer = pattern, prefer
        self._upper, self._mirror = _upper(pattern)
        self._raw: tuple[Pattern, Callable[[np.ndarray], Solve], Callable[[], None]] | None = None
        self._rough: Rough | None = None

    def factor(self, data: np.ndarray, modes: np.ndarray | None = None) -> Solve:
        """Solve with the matrix of these `data`; `modes` (f, k) are the motions that cost almost no energy.

        Most of the work is done when a solution is asked for.  Raises NotPositiveDefinite if a mode has no stiffness.
        """
        n = self._pattern.size
        stored = sparse.csr_matrix((data, self._pattern.indices, self._pattern.indptr), shape=(n, n))
        diagonal = data[self._pattern.diagonal]

        def times(x: np.ndarray) -> np.ndarray:
            if not self._pattern.symmetric:
                return stored @ x
            return stored @ x + (stored.T @ x - (diagonal * x.T).T)

        apart = _apart(times, stored.T.__matmul__ if not self._pattern.symmetric else times, modes)
        iterate = _conjugate if self._pattern.symmetric else _gmres

        def solve(b: np.ndarray, accuracy: float = MIN_KRYLOV_TOLERANCE) -> np.ndarray:
            accuracy = max(accuracy, MIN_KRYLOV_TOLERANCE)
            if not b.any():
                return np.zeros_like(b)
            if self._rough is not None:
                x = iterate(times, apart(self._rough), b, accuracy, MAX_OLD_FACTOR_STEPS)
                if x is not None:
                    return x
            x = iterate(times, apart(self._renew(data)), b, accuracy, MAX_OWN_FACTOR_STEPS)
            if x is None:  # what no iteration solves
                self._forget()
                x = precise(self._pattern, self._prefer)(data)(b)
            return x

        return solve

    def _renew(self, data: np.ndarray) -> Rough:
        """The factor of these `data`, or one that is positive definite and near to it."""
        upper = data
        if self._mirror is not None:
            upper = data[self._mirror[0]]
            upper += data[self._mirror[1]]
            upper *= 0.5
        size = float(np.abs(upper).max()) or 1.0
        for shift in DIAGONAL_SHIFTS:
            shifted = (upper / size).astype(np.float32)
            shifted[self._upper.diagonal] *= np.float32(1.0 + shift)
            try:
                return self._make(self._upper, shifted, size)
            except NotPositiveDefinite:
                continue
        if self._pattern.symmetric:
            self._rough = None
            raise NotPositiveDefinite("negative pivot")
        assert self._mirror is not None  # as no half of the matrix is stored
        mirrored = data[self._mirror[1]]
        if np.linalg.norm(upper - mirrored) <= MAX_SKEW_SHARE * np.linalg.norm(mirrored):
            self._rough = None
            raise NotPositiveDefinite("negative pivot of the symmetric part")
        # Coulomb's friction: the caller looks at the step
        return self._make(self._pattern, (data / size).astype(np.float32), size)

    def _make(self, pattern: Pattern, data: np.ndarray, size: float) -> Rough:
        """The factor of these `data`, times `size`, in the place of the one there was."""
        self._rough = None
        if self._raw is not None and self._raw[0] is not pattern:
            self._forget()
        if self._raw is None:
            self._raw = (pattern, *raw_factors(pattern, self._prefer))
        solve = self._raw[1](data)

        def rough(r: np.ndarray) -> np.ndarray:
            scale = float(np.abs(r).max()) or 1.0
            return solve((r / scale).astype(np.float32)).astype(float) * (scale / size)

        self._rough = rough
        return rough

    def _forget(self) -> None:
        self._rough = None
        if self._raw is not None:
            self._raw[2]()
            self._raw = None


def _apart(times: Rough, transposed: Rough, modes: np.ndarray | None) -> Callable[[Rough], Rough]:
    """Preconditioner M⁻¹ → M⁻¹ − Q K M⁻¹ + Q, exact on the modes Z, Q = Z (ZᵀKZ)⁻¹Zᵀ (Tang et al. 2009, A-DEF2)."""
    if modes is None or not modes.size:
        return lambda rough: rough
    back = transposed(modes)  # KᵀZ
    E = modes.T @ times(modes)
    if np.linalg.eigvalsh(0.5 * (E + E.T)).min() <= 0.0:
        raise NotPositiveDefinite("a rigid motion without stiffness")
    inverse = np.linalg.inv(E)

    def both(rough: Rough) -> Rough:
        def solve(r: np.ndarray) -> np.ndarray:
            y = rough(r)
            return y + modes @ (inverse @ (modes.T @ r - back.T @ y))

        return solve

    return both


def _upper(pattern: Pattern) -> tuple[Pattern, tuple[np.ndarray, np.ndarray] | None]:
    """Pattern of the upper triangle and, for each entry, the places of itself and of its mirror image in the data."""
    if pattern.symmetric:
        return pattern, None
    n = pattern.size
    number = np.arange(1, len(pattern.indices) + 1, dtype=np.int32)
    places = sparse.csr_matrix((number, pattern.indices, pattern.indptr), shape=(n, n))
    own, mirrored = sparse.triu(places, format="csr"), sparse.triu(places.T.tocsr(), format="csr")
    for part in (own, mirrored):
        part.sort_indices()
    found = Pattern(own.indptr.astype(np.int32), own.indices.astype(np.int32), True)
    return found, (own.data - 1, mirrored.data - 1)


def _conjugate(times: Rough, rough: Rough, b: np.ndarray, accuracy: float, limit: int) -> np.ndarray | None:
    """x with K x = b by conjugate gradients, until a correction M⁻¹r is below accuracy·|x|; None after `limit` steps.

    Raises NotPositiveDefinite when a direction d with d·K d ≤ 0 turns up.
    """
    x = rough(b)  # exact on the modes that are set apart, as it has to be
    r = b - times(x)
    z = rough(r)
    d, along = z, float(r @ z)
    for k in range(limit):
        Kd = times(d)
        curvature = float(d @ Kd)
        if not along > 0.0:
            return None
        if not curvature > 0.0:
            raise NotPositiveDefinite("a direction without stiffness")
        x += along / curvature * d
        r -= along / curvature * Kd
        z = rough(r)
        now = float(np.linalg.norm(z) / np.linalg.norm(x))
        if now <= accuracy:
            return x
        if limit == MAX_OLD_FACTOR_STEPS and k == OLD_FACTOR_CHECK_STEP and now > MAX_REMAINDER_AT_CHECK:
            return None
        before, along = along, float(r @ z)
        d = z + along / before * d
    return None


def _gmres(times: Rough, rough: Rough, b: np.ndarray, accuracy: float, limit: int) -> np.ndarray | None:
    """x with K x = b by GMRES on M⁻¹K, until |M⁻¹(b − K x)| is below accuracy·|x|; None after `limit` steps."""
    v = rough(b)
    size = float(np.linalg.norm(v))
    if not (np.isfinite(size) and size > 0.0):
        return None
    basis, H, right = [v / size], np.zeros((limit + 1, limit)), np.zeros(limit + 1)
    right[0] = size
    for k in range(limit):
        w = rough(times(basis[k]))
        for j, v in enumerate(basis):
            H[j, k] = v @ w
            w -= H[j, k] * v
        H[k + 1, k] = np.linalg.norm(w)
        if not np.isfinite(H[k + 1, k]):
            return None
        y = np.linalg.lstsq(H[: k + 2, : k + 1], right[: k + 2], rcond=None)[0]
        left = float(np.linalg.norm(H[: k + 2, : k + 1] @ y - right[: k + 2]))
        now = left / float(np.linalg.norm(y))  # |x| = |y|: the basis is orthonormal
        if now <= accuracy:
            return np.array(basis).T @ y
        if limit == MAX_OLD_FACTOR_STEPS and k == OLD_FACTOR_CHECK_STEP and now > MAX_REMAINDER_AT_CHECK:
            return None
        if H[k + 1, k] == 0.0:
            return None
        basis.append(w / H[k + 1, k])
    return None
