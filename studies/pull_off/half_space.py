"""A ball that an elastic half-space is attracted to: gap and pressure on rings, an independent program of small strain.

    h(r) = −δ + r²/(2R) + u(r),   p(h) = −(w/ℓ) exp(−h/ℓ) for h ≥ 0,   steep repulsion below,   u = A p

A is that of uniform annuli on a half-space by complete elliptic integrals (Johnson 1985, eq. 3.29).  The curve δ ↦ F,
which turns back where the ball jumps, is followed by its length (Riks 1979): so did Greenwood (1997) for a force law of
another shape.  It shares no code with the finite elements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ellipe, ellipk

MOST = 2500  # steps
STEEP = 2000.0  # slope of the repulsion over the largest one of the attraction


@dataclass(frozen=True)
class Curve:
    """Depth (n,) mm and force (n,) N along the equilibria, from above the body to the deepest."""

    depth: np.ndarray
    force: np.ndarray

    def way_back(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth (m,) mm and force (m,) N of the branch that a controlled travel follows back, from its fold on."""
        k = len(self.depth) - 1
        while k > 0 and self.depth[k - 1] < self.depth[k]:
            k -= 1
        return self.depth[k:], self.force[k:]

    def way_there(self) -> tuple[np.ndarray, np.ndarray]:
        """The same of the way there, to where it is pulled in."""
        k = 0
        while k < len(self.depth) - 1 and self.depth[k + 1] > self.depth[k]:
            k += 1
        return self.depth[: k + 1], self.force[: k + 1]


def influence(edges: np.ndarray, stiff: float) -> np.ndarray:
    """A (n, n) mm/MPa: how far the middles of annuli between `edges` (n + 1,) sink by a pressure on each; E* in MPa."""
    r = 0.5 * (edges[1:] + edges[:-1])

    def circle(a: float) -> np.ndarray:
        if a == 0.0:
            return np.zeros_like(r)
        k = np.minimum(r / a, 1.0)
        inside = 4.0 * a / (np.pi * stiff) * ellipe(k**2)
        q = np.minimum((a / r) ** 2, 1.0)
        outside = 4.0 * r / (np.pi * stiff) * (ellipe(q) - (1.0 - q) * ellipk(np.minimum(q, 1.0 - 1e-15)))
        return np.where(r <= a, inside, outside)

    whole = np.stack([circle(float(a)) for a in edges], axis=1)
    return whole[:, 1:] - whole[:, :-1]


def law(h: np.ndarray, w: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Pressure (MPa) and its derivative by the gap h (n,) mm."""
    peak = w / reach
    far = np.exp(-np.maximum(h, 0.0) / reach)
    slope = STEEP * peak / reach
    below = h < 0.0
    return np.where(below, -peak - slope * h, -peak * far), np.where(below, -slope, peak / reach * far)


def curve(
    R: float, w: float, stiff: float, reach: float, deepest: float, count: int = 400, finest: float = 0.06
) -> Curve:
    """Equilibria from where the ball is beyond the attraction to the `deepest` depth (mm), in steps of `finest` (1)."""
    near = 1.5 * np.sqrt(R * (deepest + (np.pi**2 * w**2 * R / stiff**2) ** (1.0 / 3.0)))
    far = max(np.sqrt(2.0 * R * (deepest + 12.0 * reach)), 1.2 * near)  # exp(-12) of the attraction is beyond
    even = np.linspace(0.0, near, 3 * count // 4 + 1)
    edges = np.concatenate([even, near + (far - near) * np.linspace(0.0, 1.0, count // 4 + 1)[1:] ** 1.5])
    r, area = 0.5 * (edges[1:] + edges[:-1]), np.pi * np.diff(edges**2)
    A, shape = influence(edges, stiff), r**2 / (2.0 * R)
    length = (w**2 * R / stiff**2) ** (1.0 / 3.0)
    h, d = shape + 12.0 * reach + length, -12.0 * reach - length
    weight = np.sqrt(area / area.sum())
    tangent, at = np.append(np.zeros(count), 1.0), np.append(h, d)
    step, out = 0.2 * length, []
    while at[-1] < deepest:
        if len(out) > MOST:
            raise ArithmeticError(f"the curve does not come to {deepest:.4g} mm in {MOST} steps")
        x = at + step * tangent
        for k in range(25):  # noqa: B007  # h − shape + δ − A p(h) = 0 with the length of the step
            p, slope = law(x[:-1], w, reach)
            gap = x[:-1] - shape + x[-1] - A @ p
            along = float((weight**2 * (x[:-1] - at[:-1])) @ tangent[:-1] + (x[-1] - at[-1]) * tangent[-1]) - step
            J = np.zeros((count + 1, count + 1))
            J[:-1, :-1] = np.eye(count) - A * slope
            J[:-1, -1] = 1.0
            J[-1, :-1], J[-1, -1] = weight**2 * tangent[:-1], tangent[-1]
            change = np.linalg.solve(J, -np.append(gap, along))
            x = x + change
            if np.abs(change).max() < 1e-9 * length:
                break
        else:
            step *= 0.5
            if step < 1e-6 * length:
                raise ArithmeticError(f"no equilibrium beyond {at[-1]:.4g} mm")
            continue
        new = np.linalg.solve(J, np.append(np.zeros(count), 1.0))
        new /= np.sqrt(float((weight * new[:-1]) @ (weight * new[:-1]) + new[-1] ** 2))
        tangent, at = new, x
        out.append((float(x[-1]), float(law(x[:-1], w, reach)[0] @ area)))
        step = min(step * (1.4 if k < 8 else 0.8), finest * length)
    found = np.array(out)
    return Curve(found[:, 0], found[:, 1])
