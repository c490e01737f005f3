"""Tangents condensed to the dofs that may touch: the contact's share is new in every iteration, the body's is kept.

    [K_ii  K_ic    ] [x_i]   [b_i]
    [K_ci  K_cc + C] [x_c] = [b_c],    S = K_cc − K_ci K_ii⁻¹ K_ic,    (S + C) x_c = b_c − K_ci K_ii⁻¹ b_i

What changes from one iteration to the next is the contact C, and that concerns the dofs c alone.  S is small and
dense; one factorisation of the body serves as many C as one likes (static condensation; Saad 2003, §14.2).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from fem_backend.kinematics.numbering import Pattern
from fem_backend.solver.direct import NotPositiveDefinite, Schur, available

Kept = Callable[[np.ndarray], Callable[[np.ndarray], np.ndarray]]  # data of C → (b → x)
Condense = Callable[[np.ndarray, np.ndarray], Kept]  # data of the body, of the contact


class OutOfReach(ArithmeticError):
    """The contact concerns dofs that the tangent is not condensed to."""


def condenser(pattern: Pattern, prefer: str = "auto") -> Callable[[np.ndarray], Condense | None]:
    """A function of the dofs (c,) that may touch; it stores the last ones, as their analysis takes a while.

    It returns None where no solver here condenses: only Pardiso does, and symmetric matrices only.
    """
    able = pattern.symmetric and (prefer == "pardiso" or (prefer == "auto" and available() == "pardiso"))
    last: dict[bytes, Condense] = {}

    def on(dofs: np.ndarray) -> Condense | None:
        if not able or not len(dofs):
            return None
        key = np.sort(dofs).tobytes()
        if key not in last:
            last.clear()
            last[key] = _condense_on(pattern, np.sort(dofs))
        return last[key]

    return on


def _condense_on(pattern: Pattern, dofs: np.ndarray) -> Condense:
    schur = Schur(pattern, dofs)
    number = np.full(pattern.size, -1)
    number[dofs] = np.arange(len(dofs))
    row, column = number[np.repeat(np.arange(pattern.size), np.diff(pattern.indptr))], number[pattern.indices]
    inside = np.nonzero((row >= 0) & (column >= 0))[0]
    row, column = row[inside], column[inside]

    def condense(body: np.ndarray, contact: np.ndarray) -> Kept:
        """Raises NotPositiveDefinite, and so does what is kept; that raises OutOfReach too."""
        data = body + contact  # the body alone need not be definite under a ball
        size = float(np.abs(data).max())
        S, forward, backward = schur.factor((data / size).astype(np.float32))
        first = contact[inside]

        def with_contact(now: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
            if np.count_nonzero(now) > np.count_nonzero(now[inside]):
                raise OutOfReach("contact beyond the condensed dofs")
            T = S.copy()
            T[row, column] += ((now[inside] - first) / size).astype(np.float32)  # the upper triangle
            try:
                factor = cho_factor(T, overwrite_a=True, check_finite=False)
            except LinAlgError as error:
                raise NotPositiveDefinite(str(error)) from error

            def solve(b: np.ndarray) -> np.ndarray:
                scale = float(np.abs(b).max()) or 1.0
                y = forward((b / scale).astype(np.float32))
                y[dofs] = cho_solve(factor, y[dofs], check_finite=False)
                return backward(y).astype(float) * (scale / size)

            return solve

        return with_contact

    return condense
