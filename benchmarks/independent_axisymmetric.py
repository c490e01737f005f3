"""Reference forces of bodies of revolution under rigid indenters, independent of fem_backend.

    python benchmarks/independent_axisymmetric.py [NAME …] [--out FILE] [--h0 H] [--list]

    NAME         cases (or beginnings of their names), all without
    --out FILE   table to which the cases are added (tests/fem_backend/reference_axisymmetric.json); - prints only
    --h0 H       factor on all element sizes (0.7, as in the table)
    --missing    only cases that the table lacks
    --liftoff    a slab on a base that it may leave, beside one that is held down, instead of the cases

Neo-Hookean, W = μ/2 (J^(-2/3) tr C − 3) + (J − 1)²/D₁.  Triangles of degree 4 whose pressures are unknowns at the
quadrature points, condensed (the answers are those of displacements alone; Newton converges at every K/μ).  Contact is
frictionless by a penalty at the quadrature points of the surface, extrapolated to an infinite one.  Meshes are
right-angled triangles bisected towards the contact.  Nothing of the product is imported.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu
from skfem import Basis, BoundaryFacetBasis, ElementTriP4, ElementVector, MeshTri

try:  # three times faster; the same answers
    import pypardiso
except ImportError:
    pypardiso = None

TABLE = Path(__file__).parents[1] / "tests" / "fem_backend" / "reference_axisymmetric.json"
ORDER = 10  # of the quadrature in the elements
SEEN = 20  # order of that on the surface: contact ends within an element
PENALTY = 300.0  # of contact, times μ over the smallest radius of the indenter
LEAST = 0.3  # volume ratio of any point on the way
ON_THE_WAY = 5.0  # factor on the penalty between asked depths
STIFFER = (15.0, 45.0)  # factors at an asked depth
INDEX = ((0, 0), (0, 1), (1, 0), (1, 1), (2, 2))  # components of F that are not zero


@dataclass(frozen=True)
class Problem:
    """A case: lengths in mm, μ in MPa, D₁ in 1/MPa, depths in mm.

    `indenter` is ("ball", R), ("flat", radius, fillet) or ("cone", half angle in degrees, tip radius); `base` is
    "bonded", "slip" (u_z = 0) or "unilateral"; `edge` of the outer radius is "free" or "fixed".  Elements measure
    `h0` mm within `near` mm of the first contact and grow by `growth` of the distance from there; with `fine` =
    (h, left, right) they measure h at radii between left and right.  `degree` is that of the pressures in an element,
    None for a pressure at each quadrature point.
    """

    name: str
    indenter: tuple
    radius: float
    height: float
    mu: float
    D1: float
    base: str
    depths: tuple[float, ...]
    h0: float
    near: float
    growth: float = 0.35
    edge: str = "free"
    step: float = 0.2
    degree: int | None = None
    fine: tuple[float, float, float] | None = None
    stiff: float = 1.0


def mesh(p: Problem) -> MeshTri:
    """Triangles of 0 ≤ r ≤ radius, 0 ≤ z ≤ height, bisected until each is as small as asked at its place."""
    t, r = min(p.height, p.radius), [0.0]
    while r[-1] < p.radius - 1e-9:
        width = t if r[-1] < 6.0 * t else 0.6 * (r[-1] - 4.0 * t)
        r.append(p.radius if r[-1] + 1.4 * width > p.radius else r[-1] + width)
    rows = max(round(p.height / t), 1)
    m = MeshTri.init_tensor(np.array(r), np.linspace(0.0, p.height, rows + 1))
    for _ in range(40):
        x, z = m.p[:, m.t].mean(axis=1)
        d = np.hypot(np.maximum(x - p.near, 0.0), p.height - z)
        e = m.p[:, m.t]
        wanted = p.h0 + p.growth * d
        if p.fine:
            least, left, right = p.fine
            beside = np.maximum(np.maximum(left - x, x - right), 0.0)
            wanted = np.minimum(wanted, least + p.growth * np.hypot(beside, p.height - z))
        size = np.sqrt(
            np.abs((e[0, 1] - e[0, 0]) * (e[1, 2] - e[1, 0]) - (e[0, 2] - e[0, 0]) * (e[1, 1] - e[1, 0]))
        )  # legs of a right-angled triangle of the same area
        size = np.where(x > 6.0 * t, 0.0, size)  # far away the columns are long, and the fields smooth
        large = np.flatnonzero(size > 1.2 * wanted)
        if not large.size:
            return m
        m = m.refined(large)
    raise RuntimeError("the mesh does not end")


def core(indenter: tuple, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Closest point of a convex core to points y (…, 2), whether it is a corner, and the radius that rounds the core.

    y is measured from the lowest point of the indenter, which is the core and everything within the radius of it.
    """
    kind, *sizes = indenter
    if kind == "ball":
        return np.broadcast_to([0.0, sizes[0]], y.shape), np.ones(y.shape[:-1], bool), sizes[0]
    if kind == "flat":
        rim, rho = sizes[0] - sizes[1], sizes[1]
        q = np.stack([np.minimum(y[..., 0], rim), np.maximum(y[..., 1], rho)], axis=-1)
        return q, (y[..., 0] > rim) & (y[..., 1] < rho), rho
    half, rho = np.radians(sizes[0]), sizes[1]
    up = np.array([np.sin(half), np.cos(half)])  # along the flank
    s = np.maximum((y - [0.0, rho]) @ up, 0.0)
    return np.array([0.0, rho]) + s[..., None] * up, s == 0.0, rho


class Body:
    """Discrete body: residual and tangent of the bulk and of contact; u (n,) mm, forces in N."""

    def __init__(self, p: Problem) -> None:
        self.p, self.K = p, 2.0 / p.D1
        m = self.mesh = mesh(p)
        element = ElementVector(ElementTriP4())
        basis = Basis(m, element, intorder=ORDER)
        r = basis.default_parameters()["x"][0]
        self.w, self.dofs, self.n = 2.0 * np.pi * r * basis.dx, basis.element_dofs.T, basis.N
        e, q, k = *self.w.shape, self.dofs.shape[1]
        self.B = np.zeros((e, q, 5, k))
        for a in range(k):
            value, grad = basis.basis[a][0].value, basis.basis[a][0].grad
            for row, part in enumerate((grad[0, 0], grad[0, 1], grad[1, 0], grad[1, 1], value[0] / r)):
                self.B[:, :, row, a] = part
        self.B2 = self.B.reshape(e, q * 5, k)
        s, t = basis.quadrature[0]
        d = p.degree
        powers = [] if d is None else [(i, j) for i in range(d + 1) for j in range(d + 1 - i)]
        self.phi = np.stack([s**i * t**j for i, j in powers], -1) if powers else np.eye(q)
        self.mass = np.linalg.inv(np.einsum("eq,qi,qj->eij", self.w, self.phi, self.phi))
        small, wide = 1e-9 * p.height, m.p[0].max()
        top = m.facets_satisfying(lambda x: x[1] > p.height - small, True)
        self.top = Side(m, element, top)
        low = m.facets_satisfying(lambda x: x[1] < small, True)
        self.low = Side(m, element, low) if p.base == "unilateral" else None
        fixed = [basis.get_dofs(m.facets_satisfying(lambda x: x[0] < small, True)).all(["u^1"])]
        if p.base != "unilateral":
            fixed.append(basis.get_dofs(low).all(["u^1", "u^2"] if p.base == "bonded" else ["u^2"]))
        if p.edge == "fixed":
            fixed.append(basis.get_dofs(m.facets_satisfying(lambda x: x[0] > wide - small, True)).all(["u^1"]))
        self.free = np.setdiff1d(np.arange(self.n), np.concatenate(fixed))
        self.rows, self.cols = np.repeat(self.dofs, k, axis=1).ravel(), np.tile(self.dofs, (1, k)).ravel()
        self.eps = p.stiff * PENALTY * p.mu / {"ball": p.indenter[1]}.get(p.indenter[0], 3.0 * p.indenter[-1])

    def bulk(self, u: np.ndarray, c: np.ndarray) -> tuple | None:
        """Residual (n,) and tangent with the pressures c (e, 10) condensed, and what these need; None if turned over.

        Energy: ∫ μ/2 (J^(-2/3) I₁ − 3) + p (J − 1) − p²/(2K), p = φ·c of each element alone.
        """
        F = np.einsum("mqia,ma->mqi", self.B, u[self.dofs]) + np.array([1.0, 0.0, 0.0, 1.0, 1.0])
        f, g, h, k, t = np.moveaxis(F, -1, 0)
        J = (f * k - g * h) * t
        if J.min() <= LEAST:  # W is finite at J = 0: Newton's way must not lead to a point that has collapsed
            return None
        o = np.zeros_like(f)
        cof = np.stack([k * t, -h * t, -g * t, f * t, f * k - g * h], axis=-1)  # ∂J/∂F
        rows = ((o, o, o, t, k), (o, o, -t, o, -h), (o, -t, o, o, -g), (t, o, o, o, f), (k, -h, -g, f, o))
        curve = np.stack([np.stack(row, -1) for row in rows], -2)  # ∂²J/∂F²
        I1, s = (F**2).sum(-1), self.p.mu * J ** (-2.0 / 3.0)
        G = cof / J[..., None]
        outer = lambda x, y: x[..., :, None] * y[..., None, :]  # noqa: E731
        pressure = c @ self.phi.T
        P = s[..., None] * (F - I1[..., None] / 3.0 * G) + pressure[..., None] * cof
        A = s[..., None, None] * (
            np.eye(5)
            - 2.0 / 3.0 * (outer(F, G) + outer(G, F))
            + I1[..., None, None] * (5.0 / 9.0 * outer(G, G) - curve / (3.0 * J[..., None, None]))
        )
        A += pressure[..., None, None] * curve
        m, q, _, n = self.B.shape
        K = np.matmul(self.B2.swapaxes(1, 2), np.matmul(A * self.w[..., None, None], self.B).reshape(m, q * 5, n))
        V = np.matmul((self.w[..., None] * self.phi).swapaxes(1, 2), np.einsum("mqi,mqia->mqa", cof, self.B))
        late = self.K * np.einsum("mij,mqj->mi", self.mass, (self.w * (J - 1.0))[..., None] * self.phi) - c
        K += self.K * np.matmul(V.swapaxes(1, 2), np.matmul(self.mass, V))
        inner = np.einsum("mqi,mqia->ma", P * self.w[..., None], self.B, optimize=True)
        R, condensed = np.zeros(self.n), np.zeros(self.n)
        np.add.at(R, self.dofs, inner)
        np.add.at(condensed, self.dofs, inner + np.einsum("mja,mj->ma", V, late))
        volume = float(np.sqrt((self.w * (late @ self.phi.T) ** 2).sum() / self.w.sum())) / self.p.mu
        return R, condensed, csc_matrix((K.ravel(), (self.rows, self.cols)), shape=(self.n, self.n)), V, late, volume

    def contact(self, u: np.ndarray, depth: float, stiffer: float) -> tuple:
        """Residual, tangent, force (N) on the indenter and pressures of the penalty, `stiffer` times the usual."""
        x = self.top.at(u)
        y = x - np.array([0.0, self.p.height - depth])
        y[..., 0] = np.maximum(y[..., 0], 0.0)
        closest, corner, rho = core(self.p.indenter, y)
        away = y - closest
        far = np.maximum(np.linalg.norm(away, axis=-1), 1e-12)
        n = away / far[..., None]
        R, K, p = self.top.push(self.n, n, far - rho, np.where(corner, 1.0 / far, 0.0), stiffer * self.eps)
        force = float(-(self.top.v * p * n[..., 1]).sum())
        if self.low is not None:
            z = self.low.at(u)[..., 1]
            up = np.broadcast_to([0.0, 1.0], (*z.shape, 2))
            r, k, _ = self.low.push(self.n, up, z, np.zeros_like(z), 0.1 * stiffer * self.eps)
            R, K = R + r, K + k
        return R, K, force

    def solve(self, u: np.ndarray, c: np.ndarray, depth: float, stiffer: float, tolerance: float) -> tuple | None:
        """Equilibrium (u, c) by Newton with halved steps, and its force; None where there is none."""

        def state(u: np.ndarray, c: np.ndarray) -> tuple | None:
            inside = self.bulk(u, c)
            if inside is None:
                return None
            outside = self.contact(u, depth, stiffer)
            size = float(np.linalg.norm((inside[0] + outside[0])[self.free]))
            return inside, outside, max(size / max(float(np.linalg.norm(outside[0])), 1e-12), inside[-1])

        now = state(u, c)
        for i in range(30):
            if now is None:
                return None
            (_, condensed, K, V, late, _), (Rc, Kc, force), size = now
            if size <= tolerance:
                return u, c, force
            K = (K + Kc)[self.free][:, self.free]
            b = -(condensed + Rc)[self.free]
            du = np.zeros(self.n)
            du[self.free] = pypardiso.spsolve(K.tocsr(), b) if pypardiso else splu(K, "MMD_AT_PLUS_A").solve(b)
            dc = late + self.K * np.einsum("mij,mja,ma->mi", self.mass, V, du[self.dofs], optimize=True)
            alpha = 1.0 if i < 9 or i % 3 == 0 else 0.5  # points that enter and leave contact in turns end so
            while alpha > 0.05:
                now = state(u + alpha * du, c + alpha * dc)
                if now is not None and now[2] < 2.0 * size + 1e-3:
                    break
                alpha *= 0.5
            u, c = u + alpha * du, c + alpha * dc
        return None


class Side:
    """Facets of a part of the boundary that may be pushed."""

    def __init__(self, m: MeshTri, element: ElementVector, facets: np.ndarray) -> None:
        basis = BoundaryFacetBasis(m, element, facets=facets, intorder=SEEN)
        self.X = basis.default_parameters()["x"].transpose(1, 2, 0)
        self.v = 2.0 * np.pi * self.X[..., 0] * basis.dx
        self.dofs = basis.element_dofs.T
        k = self.dofs.shape[1]
        self.N = np.stack([basis.basis[a][0].value.transpose(1, 2, 0) for a in range(k)], axis=-1)
        self.rows, self.cols = np.repeat(self.dofs, k, axis=1).ravel(), np.tile(self.dofs, (1, k)).ravel()

    def at(self, u: np.ndarray) -> np.ndarray:
        """Places (f, q, 2) of its points."""
        return self.X + np.einsum("fqia,fa->fqi", self.N, u[self.dofs])

    def push(self, size: int, n: np.ndarray, gap: np.ndarray, bend: np.ndarray, eps: float) -> tuple:
        """Residual, tangent and pressure ⟨−eps gap⟩; `bend` is the curvature of the gap across n."""
        trial = -eps * gap
        on = trial >= 0.0
        p = np.where(on, trial, 0.0)
        R, Nn = np.zeros(size), np.einsum("fqi,fqia->fqa", n, self.N)
        across = np.einsum("fqi,fqia->fqa", np.stack([-n[..., 1], n[..., 0]], axis=-1), self.N)
        np.add.at(R, self.dofs, -np.einsum("fq,fqa->fa", self.v * p, Nn))
        K = np.matmul((Nn * (self.v * eps * on)[..., None]).swapaxes(1, 2), Nn)
        K -= np.matmul((across * (self.v * p * bend)[..., None]).swapaxes(1, 2), across)
        return R, csc_matrix((K.ravel(), (self.rows, self.cols)), shape=(size, size)), p


def forces(p: Problem) -> tuple[np.ndarray, dict]:
    """Force (k, 2) N at the depths for both penalties, NaN where not reached, and the mesh; shorter steps may help."""
    body = Body(p)
    for shorter in (1.0, 0.6, 0.35):
        F, about = walked(body, replace(p, step=shorter * p.step))
        if np.isfinite(F).all():
            break
    return F, about


def walked(body: Body, p: Problem) -> tuple[np.ndarray, dict]:
    """The same with steps as they are."""
    now = (np.zeros(body.n), np.zeros((len(body.w), body.phi.shape[1])))
    before, here, way, last = now, 0.0, p.step, p.step
    out = []
    for target in p.depths:
        while here < target - 1e-9:
            goal = target if here + 1.2 * way > target else here + way
            ahead = tuple(x + (x - y) * (goal - here) / last if here else x for x, y in zip(now, before, strict=True))
            found = body.solve(*ahead, goal, ON_THE_WAY, 1e-5) or body.solve(*now, goal, ON_THE_WAY, 1e-5)
            if found is None:
                way *= 0.5
                if way < 0.01 * p.step:
                    lost = [[np.nan, np.nan]] * (len(p.depths) - len(out))
                    return np.array(out + lost), {}
                continue
            before, now, last, here = now, found[:2], goal - here, goal
            way = min(1.5 * way, p.step)
        state, found = now, []
        for stiffer in STIFFER:
            *state, F = body.solve(*state, target, stiffer, 1e-7) or (*state, np.nan)
            found.append(F)
        out.append(found)
    return np.array(out), {"elements": int(body.mesh.t.shape[1]), "dofs": int(body.n), "h0": p.h0, "growth": p.growth}


R, MU = 3.0, 0.01  # ball (mm), shear modulus (MPa)
D1S = {"D5.8": 5.8, "K1e4": 2.0 / (1e4 * MU), "D0.2": 0.2}


def cases() -> list[Problem]:
    """What the table holds."""
    ball, out = ("ball", R), []
    for ratio in (2.0, 0.7, 1.0, 4.0):
        depths = tuple(d * R for d in (0.25, 0.4, 0.5, 0.75, 1.0, 1.5) if d < 0.7 * ratio and (d != 0.4 or ratio < 1.0))
        for base, wide in (("bonded", 15.0 + 3.0 * ratio), ("slip", 200.0)):
            for key, D1 in D1S.items():
                name = f"slab_{ratio:g}_{base}_{key}"
                out.append(Problem(name, ball, wide * R, ratio * R, MU, D1, base, depths, 0.15 * R, 1.3 * R))
    deep = tuple(d * R for d in (0.1, 0.25, 0.5, 0.75, 1.0, 1.5))
    for key, D1 in D1S.items():
        out.append(Problem(f"half_space_{key}", ball, 1e3 * R, 1e3 * R, MU, D1, "bonded", deep, 0.15 * R, 1.3 * R))
    for base, wide in (("bonded", 50.0), ("slip", 600.0)):
        for key, D1 in D1S.items():
            a, depths = (wide, 5.0, MU, D1, base), (0.25, 0.5, 1.0, 1.5)
            how = {"growth": 0.3, "step": 0.1}
            flat = Problem(
                f"flat_{base}_{key}", ("flat", 2.0, 0.2), *a, depths, 0.35, 2.2, fine=(0.05, 1.6, 2.2), **how
            )
            cone = Problem(
                f"cone_{base}_{key}", ("cone", 60.0, 0.2), *a, depths, 0.3, 2.0, fine=(0.06, 0, 0.2), **how, stiff=8.0
            )
            out += [flat, cone]
    for key, D1 in D1S.items():
        puck = (10.0, 5.0, MU, D1, "bonded", (0.75, 1.5, 2.25, 3.0), 0.15 * R, 1.3 * R)
        out.append(Problem(f"puck_bonded_{key}", ball, *puck))
    first = [p for p in out if p.name.startswith("slab")]
    return first + [p for p in out if p not in first]


def extrapolated(F: np.ndarray) -> np.ndarray:
    """Force at an infinite penalty from those at the last two, from which it differs in proportion to 1/penalty."""
    a, b = STIFFER
    return F[:, 1] + (F[:, 1] - F[:, 0]) * a / (b - a)


def scaled(p: Problem, by: float) -> Problem:
    """The same on a mesh that is coarser by a factor."""
    return replace(p, h0=by * p.h0, growth=by * p.growth, fine=p.fine and (by * p.fine[0], *p.fine[1:]))


def stated(p: Problem, h0: float) -> dict:
    """A case's entry: forces, and their error from a coarser mesh, the penalty and where the body ends."""
    start = time.process_time()
    finer = scaled(p, h0)
    F, about = forces(finer)
    best = extrapolated(F)
    rough = scaled(p, 1.5 * h0)
    coarse = extrapolated(forces(rough)[0])
    error = {"mesh": np.abs(best - coarse), "penalty": 0.1 * np.abs(best - F[:, -1])}
    if p.name.startswith("half"):  # what the size of the block adds falls as 1/size
        more = extrapolated(forces(replace(rough, radius=2.0 * p.radius, height=2.0 * p.height))[0]) - coarse
        best, error["size"] = best + 2.0 * more, 0.2 * np.abs(more)
    elif p.base == "bonded" and p.D1 != D1S["D5.8"]:  # it fades within a few thicknesses: 1e-7 for the others
        error["outer radius"] = 1e-6 * best
    elif not p.name.startswith("puck"):
        wide = replace(rough, edge="fixed") if p.base == "slip" else replace(rough, radius=2.0 * p.radius)
        error["outer radius"] = np.abs(extrapolated(forces(wide)[0]) - coarse)
    # contact ends within an element: other meshes move shallow forces by more than two of them differ by chance
    error["floor"] = best * np.where(np.array(p.depths) < 0.3 * max(p.indenter[1], 2.0), 4e-4, 1e-4)
    return {
        "indenter": list(p.indenter),
        **{k: getattr(p, k) for k in ("radius", "height", "mu", "D1", "base")},
        "depth": list(p.depths),
        "force": [float(f"{f:.7g}") for f in best],
        "relative_error": [float(f"{e:.1e}") for e in sum(error.values()) / best],
        "relative_error_of": {k: [float(f"{e:.1e}") for e in v / best] for k, v in error.items()},
        "mesh": about,
        "cpu_s": round(time.process_time() - start, 1),
    }


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--out", default=str(TABLE))
    parser.add_argument("--h0", type=float, default=0.7)
    parser.add_argument("--missing", action="store_true")
    parser.add_argument("--liftoff", action="store_true")
    options = parser.parse_args()
    if options.liftoff:
        return liftoff()
    path = None if options.out == "-" else Path(options.out)
    table = json.loads(path.read_text(encoding="utf-8")) if path and path.exists() else {"about": ABOUT, "cases": {}}
    table["about"] = ABOUT
    wanted = options.names or [""]
    for p in (p for start in wanted for p in cases() if p.name.startswith(start)):
        if options.missing and np.isfinite(table["cases"].get(p.name, {"force": [np.nan]})["force"]).all():
            continue
        entry = table["cases"][p.name] = stated(p, options.h0)
        print(p.name, entry["mesh"].get("dofs"), f"{entry['cpu_s']} s")
        for d, f, e in zip(entry["depth"], entry["force"], entry["relative_error"], strict=True):
            print(f"  {d:6.3f} mm  {f:.6f} N  ± {e:.1e}", flush=True)
        if path:
            path.write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def liftoff() -> None:
    """Force of a ball on a slab 2 R thick and 10 R wide that may leave its frictionless base, and of one held down."""
    depths = (0.25 * R, 0.5 * R, R)
    for D1 in (5.8, 0.2):
        row = {}
        for base in ("slip", "unilateral"):
            p = Problem("", ("ball", R), 10.0 * R, 2.0 * R, MU, D1, base, depths, 0.2 * R, 1.3 * R, step=0.1)
            row[base] = extrapolated(forces(p)[0])
        for d, a, b in zip((0.25, 0.5, 1.0), row["slip"], row["unilateral"], strict=True):
            print(f"D1 {D1:g}, depth {d:g} R: held down {a:.6f} N, free to leave {b:.6f} N, {100 * (b / a - 1):+.2f} %")


ABOUT = (
    "Forces (N) printed by `python benchmarks/independent_axisymmetric.py`; mm, MPa. Neo-Hookean, frictionless, base "
    "bonded or u_z = 0 (slip); the outer side is free. indenter: ball R | flat radius fillet | cone half angle, tip "
    "radius. relative_error: sum of the difference from a mesh 1.5 times coarser, a tenth of the extrapolation in the "
    "penalty, and (on the coarser mesh) the difference with the outer radius doubled (bonded) or the outer edge held "
    "in r (slip). Half-space: blocks of 1000 R and 2000 R, extrapolated, with a fifth of that in the error. floor: by "
    "how much repeats on other meshes scatter. Cones, flat ends and puck_bonded_K1e4: with --h0 1."
)

if __name__ == "__main__":
    main()
