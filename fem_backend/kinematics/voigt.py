"""Symmetric tensors of one point by their six components 11, 22, 33, 23, 13, 12."""

import numpy as np

from fem_backend.compiled import compiled

VOIGT_ROW, VOIGT_COLUMN = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])  # of the six components
VOIGT_PLACE = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # of the component ij


@compiled()
def cauchy_green(f, J, c, inverse):  # type: ignore[no-untyped-def]
    """C = FᵀF and C⁻¹ of one point, no component doubled, written into c (6,) and inverse (6,)."""
    for i in range(3):
        c[i] = f[0, i] * f[0, i] + f[1, i] * f[1, i] + f[2, i] * f[2, i]
    c[3] = f[0, 1] * f[0, 2] + f[1, 1] * f[1, 2] + f[2, 1] * f[2, 2]
    c[4] = f[0, 0] * f[0, 2] + f[1, 0] * f[1, 2] + f[2, 0] * f[2, 2]
    c[5] = f[0, 0] * f[0, 1] + f[1, 0] * f[1, 1] + f[2, 0] * f[2, 1]
    j = 1.0 / (J * J)
    inverse[0] = (c[1] * c[2] - c[3] * c[3]) * j
    inverse[1] = (c[0] * c[2] - c[4] * c[4]) * j
    inverse[2] = (c[0] * c[1] - c[5] * c[5]) * j
    inverse[3] = (c[4] * c[5] - c[0] * c[3]) * j
    inverse[4] = (c[5] * c[3] - c[1] * c[4]) * j
    inverse[5] = (c[3] * c[4] - c[2] * c[5]) * j


@compiled()
def fill_tensor(c, A):  # type: ignore[no-untyped-def]
    """Fill A (3, 3) from its components c (6,)."""
    for k in range(6):
        A[VOIGT_ROW[k], VOIGT_COLUMN[k]] = c[k]
        A[VOIGT_COLUMN[k], VOIGT_ROW[k]] = c[k]
