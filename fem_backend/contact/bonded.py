"""Points that are glued to a rigid body: they follow it in every direction, and it can pull.

    t = −ε_b (x − c − h),   Π_b = ∫ ε_b |x − c − h|²/2 dA₀

with the reference point c of the rigid body and the place h (mm) of each point relative to it.  As this is linear, ε_b
may be so much larger than the penalty of contact that nothing is left to multipliers.
"""

from __future__ import annotations

import numpy as np

# ε_b/ε: some 1e-5 of a travel go into the glue; with much more, its round-off is larger than small forces
BOND_PENALTY_FACTOR = 30.0


def glued(held: np.ndarray) -> np.ndarray:
    """Whether points are glued (f, q), by their places `held` (f, q, 3), nan where they are free."""
    return np.isfinite(held[..., 0])


def traction(held: np.ndarray, points: np.ndarray, centre: np.ndarray, epsilon: np.ndarray) -> np.ndarray:
    """t (f, q, 3) MPa on the body at points (f, q, 3) mm, 0 where they are free; ε (f, q) MPa/mm is that of contact."""
    t = -BOND_PENALTY_FACTOR * epsilon[..., None] * (points - centre - held)
    return np.where(np.isfinite(t), t, 0.0)


def energy(t: np.ndarray, epsilon: np.ndarray, weights: np.ndarray) -> float:
    """Π_b (N mm) of tractions t (f, q, 3) MPa."""
    return float((0.5 * weights * (t**2).sum(-1) / (BOND_PENALTY_FACTOR * epsilon)).sum())


def loads(facets: np.ndarray, N: np.ndarray, weights: np.ndarray, t: np.ndarray, count: int) -> np.ndarray:
    """∫ N_a t dA₀ (count, 3) N of tractions t (f, q, 3) MPa on facets (f, a), N (q, a), weights (f, q) mm²."""
    out = np.zeros((count, 3))
    np.add.at(out, facets, np.einsum("fq,qa,fqi->fai", weights, N, t))
    return out


def bond_stiffness(
    held: np.ndarray, N: np.ndarray, weights: np.ndarray, place: np.ndarray, epsilon: np.ndarray, data: np.ndarray
) -> None:
    """Add ∫ ε_b N_a N_b dA₀ I of the glued points to `data` at the places (f, 3a, 3a), −1 for none."""
    w = np.where(glued(held), BOND_PENALTY_FACTOR * epsilon * weights, 0.0)
    some = np.nonzero(w.any(1))[0]
    block = np.einsum("fq,qa,qb,ij->faibj", w[some], N, N, np.eye(3)).reshape(place[some].shape)
    free = place[some] >= 0
    np.add.at(data, place[some][free], block[free])
