"""Indentation of a held ball by a rigid ball, independent of fem_backend: axisymmetric triangles of degree 4.

A neo-Hookean sphere of radius c, its lower half held, touched at its top without friction; displacements alone, as a
degree of 4 does not lock at K/μ below a thousand.  Nothing of the product is imported, and neither elements, contact
nor solution are those of fem_backend.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu
from scipy.spatial import Delaunay
from skfem import Basis, BoundaryFacetBasis, ElementTriP4, ElementVector, MeshTri

ORDER = 10  # of the quadrature in the elements
SEEN = 24  # order of that on the surface: contact ends within an element
PENALTY = 400.0  # of contact, times mu/R
TOGETHER = 4  # augmentations at an asked depth


def mesh(c: float, R: float, h0: float, growth: float) -> MeshTri:
    """Triangles of the half disc r >= 0 of radius c, edges of h0 R at the top and growing with the distance from it."""
    size = lambda d: min(h0 * R + growth * max(d - R, 0.0), c / 8.0)  # noqa: E731
    rings, d = [0.0], 0.0
    while d < 2.0 * c:
        d += size(d)
        rings.append(min(d, 2.0 * c))
    points = []
    for d in rings:
        most = np.arccos(min(d / (2.0 * c), 1.0))  # angle from straight down at which a ring meets the surface
        for a in np.linspace(0.0, most, max(int(np.ceil(most * d / size(d))), 1 if d else 0) + 1):
            points.append((d * np.sin(a), c - d * np.cos(a)))
    p = np.unique(np.round(points, 9), axis=0)
    rim = np.argmin(np.abs(p[:, 1]) + 10.0 * np.abs(np.hypot(*p.T) - c))
    p[rim] = (c, 0.0)  # what is held ends at a point
    p = np.unique(np.round(p, 9), axis=0)
    t = Delaunay(p).simplices
    a, b = p[t[:, 1]] - p[t[:, 0]], p[t[:, 2]] - p[t[:, 0]]
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return MeshTri(p.T.copy(), t[np.abs(area) > 1e-7 * c * c].T.copy())


class Body:
    """Discrete sphere: residual and tangent of the bulk and of contact; u (n,) mm, forces in N."""

    def __init__(self, c: float, R: float, mu: float, D1: float, h0: float, growth: float) -> None:
        self.R, self.mu, self.kappa, self.c = R, mu, 2.0 / D1, c
        grid = mesh(c, R, h0, growth)
        element = ElementVector(ElementTriP4())
        basis = Basis(grid, element, intorder=ORDER)
        r = basis.default_parameters()["x"][0]
        self.w = 2.0 * np.pi * r * basis.dx
        self.dofs = basis.element_dofs.T
        m, q, k = *self.w.shape, self.dofs.shape[1]
        self.B = np.zeros((m, q, 5, k))
        for a in range(k):
            value, grad = basis.basis[a][0].value, basis.basis[a][0].grad
            for row, part in enumerate((grad[0, 0], grad[0, 1], grad[1, 0], grad[1, 1], value[0] / r)):
                self.B[:, :, row, a] = part
        top = grid.facets_satisfying(lambda x: (x[1] > 0.3 * c) & (x[0] > 1e-6), True)
        side = BoundaryFacetBasis(grid, element, facets=top, intorder=SEEN)
        self.X = side.default_parameters()["x"].transpose(1, 2, 0)
        self.v = 2.0 * np.pi * self.X[..., 0] * side.dx
        self.side_dofs = side.element_dofs.T
        self.N = np.stack([side.basis[a][0].value.transpose(1, 2, 0) for a in range(k)], axis=-1)
        low = grid.facets_satisfying(lambda x: (x[1] < 0.0) & (x[0] > 1e-6), True)
        held = basis.get_dofs(low).all()
        axis = basis.get_dofs(grid.facets_satisfying(lambda x: x[0] < 1e-9, True)).all(["u^1"])
        n = basis.N
        self.n, self.free = n, np.setdiff1d(np.arange(n), np.union1d(held, axis))
        self.rows = np.repeat(self.dofs, k, axis=1).ravel()
        self.cols = np.tile(self.dofs, (1, k)).ravel()
        self.side_rows = np.repeat(self.side_dofs, k, axis=1).ravel()
        self.side_cols = np.tile(self.side_dofs, (1, k)).ravel()

    def bulk(self, u: np.ndarray) -> tuple[np.ndarray, csc_matrix] | None:
        """Residual (n,) and tangent of W = μ/2 (J^(-2/3) I₁ − 3) + (J − 1)²/D₁; None where an element turns over."""
        H = np.einsum("mqia,ma->mqi", self.B, u[self.dofs])
        F = np.zeros((*H.shape[:2], 3, 3))
        index = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 2)]
        for k, (i, j) in enumerate(index):
            F[..., i, j] = H[..., k] + (i == j)
        J = np.linalg.det(F)
        if J.min() <= 0.0:
            return None
        G = np.linalg.inv(F).swapaxes(-1, -2)
        I1, s = (F**2).sum((-1, -2)), self.mu * J ** (-2.0 / 3.0)
        f, g = (np.stack([A[..., i, j] for i, j in index], axis=-1) for A in (F, G))
        P = s[..., None] * (f - I1[..., None] / 3.0 * g) + (self.kappa * (J - 1.0) * J)[..., None] * g
        e, outer = np.eye(5), lambda a, b: a[..., :, None] * b[..., None, :]
        turned = np.zeros((*J.shape, 5, 5))  # G_il G_kj
        for a, (i, j) in enumerate(index):
            for b, (k, n) in enumerate(index):
                turned[..., a, b] = G[..., i, n] * G[..., k, j]
        A = s[..., None, None] * (
            e - 2.0 / 3.0 * (outer(f, g) + outer(g, f)) + I1[..., None, None] * (2.0 / 9.0 * outer(g, g) + turned / 3.0)
        )
        A += (self.kappa * (2.0 * J - 1.0) * J)[..., None, None] * outer(g, g)
        A -= (self.kappa * (J - 1.0) * J)[..., None, None] * turned
        R = np.zeros(self.n)
        np.add.at(R, self.dofs, np.einsum("mq,mqi,mqia->ma", self.w, P, self.B))
        AB = np.matmul(A * self.w[..., None, None], self.B)
        K = np.einsum("mqia,mqib->mab", self.B, AB, optimize=True)
        return R, csc_matrix((K.ravel(), (self.rows, self.cols)), shape=(self.n, self.n))

    def contact(self, u: np.ndarray, depth: float, kept: np.ndarray) -> tuple:
        """Residual, tangent, force (N) on the ball and pressure of the multipliers `kept` and the penalty."""
        x = self.X + np.einsum("fqia,fa->fqi", self.N, u[self.side_dofs])
        y = x - np.array([0.0, self.c + self.R - depth])
        far = np.linalg.norm(y, axis=-1)
        n, eps = y / far[..., None], PENALTY * self.mu / self.R
        p = np.maximum(kept + eps * (self.R - far), 0.0)
        on = p > 0.0
        R, Nn = np.zeros(self.n), np.einsum("fqi,fqia->fqa", n, self.N)
        np.add.at(R, self.side_dofs, -np.einsum("fq,fqa->fa", self.v * p, Nn))
        K = np.einsum("fq,fqa,fqb->fab", self.v * eps * on, Nn, Nn, optimize=True)
        across = self.N - n[..., :, None] * Nn[..., None, :]
        K -= np.einsum("fq,fqia,fqib->fab", self.v * p / far, across, across, optimize=True)
        matrix = csc_matrix((K.ravel(), (self.side_rows, self.side_cols)), shape=(self.n, self.n))
        return R, matrix, float(-(self.v * p * n[..., 1]).sum()), p

    def solve(self, u: np.ndarray, depth: float, kept: np.ndarray, tolerance: float) -> tuple | None:
        """Equilibrium by Newton with halved steps, its force and pressure; None where there is none."""

        def state(u: np.ndarray) -> tuple | None:
            inside = self.bulk(u)
            return None if inside is None else (inside, self.contact(u, depth, kept))

        now = state(u)
        for _ in range(25):
            if now is None:
                return None
            (Rb, Kb), (Rc, Kc, force, p) = now
            R = (Rb + Rc)[self.free]
            size = float(np.linalg.norm(R))
            if size <= tolerance * max(float(np.linalg.norm(Rc)), 1e-9):
                return u, force, p
            step = splu((Kb + Kc)[self.free][:, self.free]).solve(-R)
            alpha, then = 1.0, None
            while alpha > 0.02:
                trial = u.copy()
                trial[self.free] += alpha * step
                then = state(trial)
                if then is not None:
                    (a, _), (b, *_rest) = then
                    if float(np.linalg.norm((a + b)[self.free])) < (1.0 - 0.1 * alpha) * size or alpha < 0.1:
                        break
                alpha *= 0.5
            u, now = trial, then
        return None


def force(
    c: float,
    R: float,
    mu: float,
    D1: float,
    asked: Sequence[float],
    h0: float = 0.2,
    growth: float = 0.35,
    step: float = 0.08,
) -> np.ndarray:
    """Force (k,) N at the asked depths (mm, increasing), NaN from the first that was not reached.

    c, R in mm, μ in MPa, D₁ in 1/MPa; h0 and `step` in R.
    """
    body = Body(c, R, mu, D1, h0, growth)
    u, before, here, way = np.zeros(body.n), np.zeros(body.n), 0.0, step * R
    kept, out, last = np.zeros(body.v.shape), [], way
    for target in asked:
        while here < target - 1e-9:
            goal = target if here + 1.2 * way > target else here + way
            start = u + (u - before) * (goal - here) / last if here else u
            found = body.solve(start, goal, kept, 1e-5) or body.solve(u, goal, kept, 1e-5)
            if found is None:
                way *= 0.5
                if way < 0.002 * R:
                    return np.array([*out, *[np.nan] * (len(asked) - len(out))])
                continue
            before, u, last, here = u, found[0], goal - here, goal
            kept = found[2]
            way = min(1.5 * way, step * R)
        for _ in range(TOGETHER):
            u, F, kept = body.solve(u, target, kept, 1e-7) or (u, np.nan, kept)
        out.append(F)
    return np.array(out)


def main() -> None:
    """Print forces at the depths of a set: `python benchmarks/axisymmetric.py MU D1 DEPTH …` (R = 3 on 35 mm)."""
    mu, D1, *asked = map(float, sys.argv[1:])
    for depth, F in zip(asked, force(35.0, 3.0, mu, D1, asked, h0=0.25), strict=True):
        print(f"{depth:g} mm: {F:.5f} N")


if __name__ == "__main__":
    main()
