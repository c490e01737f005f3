"""The force of vanishing elements, from another code: p-version with NGSolve on graded, curved meshes of Netgen.

    python -m venv ngsolve && ngsolve/bin/pip install ngsolve numpy        # apart: never a dependency
    OMP_NUM_THREADS=1 ngsolve/bin/python benchmarks/fe_limit.py [--h0 0.8 --growth 0.5 --rim 0 --orders 2,3,4,5]

Reference specimen (semi-axes 60, 35, 35 mm, surface below z = 0 held, frictionless ball R = 3 mm at the top), quarter
model, one law over mu = 1.  Contact is a penalty energy eps/2 <-g>^2 per reference area; every force is taken at three
eps and extrapolated to 1/eps = 0.  The force is the derivative of that energy, so that it is consistent with the
equations whatever the quadrature.  Shares no line with `fem_backend`.  Orders 2 to 4 take some minutes, 5 five more.
"""

from __future__ import annotations

import argparse
import time

import ngsolve as ng
import numpy as np
from netgen.csg import CSGeometry, Ellipsoid, Plane, Pnt, Vec
from netgen.meshing import MeshingParameters

AXES, R = np.array([60.0, 35.0, 35.0]), 3.0
ASKED = (1.0, 2.0, 3.0, 4.0)  # mm
MU = 0.01  # MPa
EPSILON = (250.0, 500.0, 1000.0)  # over mu, 1/mm
STEP = 0.2  # mm of travel at the lowest order


def sizes(h0: float, growth: float, hmax: float, rim: float) -> MeshingParameters:
    """Edge length h0 within R of the top, growing with the distance, at most hmax, `rim` at the rim z = 0 (0: free)."""
    parameters = MeshingParameters(maxh=hmax, grading=0.5)
    random = np.random.default_rng(0)
    for d in np.concatenate([np.linspace(0, R, 8), R + np.geomspace(0.3, 60, 25)]):
        h = min(h0 + growth * max(d - R, 0), hmax)
        for _ in range(max(4, int(min(400, 4 * (d / h) ** 2)))):
            v = random.normal(size=3)
            x = np.abs(d * v / np.linalg.norm(v))
            x[2] = AXES[2] - x[2]
            if (x**2 / AXES**2).sum() > 1:
                inside = 1 - (x[0] / AXES[0]) ** 2 - (x[1] / AXES[1]) ** 2
                if inside <= 0:
                    continue
                x[2] = AXES[2] * np.sqrt(inside)
            parameters.RestrictH(*map(float, x), float(h))
    for phi in np.linspace(0, np.pi / 2, 60 if rim else 0):
        parameters.RestrictH(float(AXES[0] * np.cos(phi)), float(AXES[1] * np.sin(phi)), 0.0, rim)
    return parameters


def quarter(parameters: MeshingParameters) -> ng.Mesh:
    """Curved mesh of x >= 0, y >= 0 with an edge chain on the rim z = 0."""
    geometry, origin = CSGeometry(), Pnt(0, 0, 0)
    axes = Vec(AXES[0], 0, 0), Vec(0, AXES[1], 0), Vec(0, 0, AXES[2])
    for name, way in (("top", -1), ("bottom", 1)):
        part = Ellipsoid(origin, *axes).bc(name) * Plane(origin, Vec(0, 0, way)).bc("mid")
        geometry.Add(part * Plane(origin, Vec(-1, 0, 0)).bc("symx") * Plane(origin, Vec(0, -1, 0)).bc("symy"))
    mesh = ng.Mesh(geometry.GenerateMesh(parameters))
    mesh.Curve(4)
    return mesh


class Press:
    """Displacement of one order on a mesh; everything over mu.

    `yeoh` (C20, C30) and `mooney` C01 over mu; `mu_D1` is mu times D1.
    """

    def __init__(self, mesh: ng.Mesh, order: int, mu_D1: float, yeoh: tuple[float, float], mooney: float) -> None:
        space = ng.VectorH1(mesh, order=order, dirichletx="symx", dirichlety="symy", dirichlet="bottom")
        self.space, self.u = space, ng.GridFunction(space)
        self.epsilon, self.height = ng.Parameter(EPSILON[0]), ng.Parameter(AXES[2] + R)
        u = space.TrialFunction()
        F = ng.Id(3) + ng.Grad(u)
        J, C = ng.Det(F), F.trans * F
        i1 = J ** (-2 / 3) * ng.Trace(C) - 3
        W = (0.5 - mooney) * i1 + yeoh[0] * i1 * i1 + yeoh[1] * i1 * i1 * i1 + (J - 1) ** 2 / mu_D1
        if mooney:
            W = W + mooney * (J ** (-4 / 3) * 0.5 * (ng.Trace(C) ** 2 - ng.InnerProduct(C, C)) - 3)
        r = ng.CF((ng.x, ng.y, ng.z - self.height)) + u
        gap = ng.sqrt(ng.InnerProduct(r, r)) - R
        touching = (0.5 * self.epsilon * ng.IfPos(-gap, gap * gap, 0.0)).Compile() * ng.ds("top", bonus_intorder=8)
        self.whole, self.contact = (ng.BilinearForm(space, symmetric=True) for _ in range(2))
        self.whole += ng.Variation(W.Compile() * ng.dx)
        for form in (self.whole, self.contact):
            form += ng.Variation(touching)
        up = ng.GridFunction(space)
        up.Set(ng.CF((0, 0, 1.0)))
        self.up, self.work = up.vec, up.vec.CreateVector()

    def force(self) -> float:
        """Force of the whole specimen over mu (mm^2)."""
        self.contact.Apply(self.u.vec, self.work)
        return 4.0 * ng.InnerProduct(self.work, self.up)

    def solve(self, travel: float, tolerance: float = 1e-9) -> None:
        """Newton with a line search on the energy; ArithmeticError if it ends nowhere."""
        self.height.Set(AXES[2] + R - travel)
        form, x, free = self.whole, self.u.vec, self.space.FreeDofs()
        r, step, old = (x.CreateVector() for _ in range(3))
        energy = form.Energy(x)
        for _ in range(40):
            form.Apply(x, r)
            r.data = ng.Projector(free, True) * r
            if r.Norm() < tolerance * max(self.force() / 4, 0.5):
                return
            form.AssembleLinearization(x)
            step.data = form.mat.Inverse(free, inverse="sparsecholesky") * r
            slope, share, new = ng.InnerProduct(step, r), 1.0, np.nan
            old.data = x
            while not new <= energy - 1e-4 * share * slope + 1e-11 * abs(energy):  # also while elements are inside out
                x.data = old - share * step
                new, share = form.Energy(x), 0.5 * share
                if share < 1e-4:
                    raise ArithmeticError(f"no descent at {travel:g} mm")
            energy = new
        raise ArithmeticError(f"no equilibrium at {travel:g} mm")


def walk(press: Press) -> dict[float, ng.BaseVector]:
    """States at the asked travels, step by step from nothing."""
    states, trail = {}, []
    for s in sorted({*ASKED, *np.round(np.arange(STEP, max(ASKED), STEP), 6)}):
        if len(trail) > 1:
            (a, before), (b, last) = trail[-2:]
            press.u.vec.data = last + (s - b) / (b - a) * (last - before)
        press.solve(s, 1e-4)
        trail = [*trail, (s, press.u.vec.CreateVector(copy=True))][-2:]
        states[s] = trail[-1][1]
    return {s: states[s] for s in ASKED}


def without_penalty(press: Press) -> float:
    """Force (N) at 1/eps = 0 by the parabola through those at EPSILON, the state left at the first of them."""
    forces, kept = [], None
    for epsilon in EPSILON:
        press.epsilon.Set(epsilon)
        press.solve(AXES[2] + R - press.height.Get())
        forces.append(MU * press.force())
        kept = kept or press.u.vec.CreateVector(copy=True)
    press.u.vec.data = kept
    press.epsilon.Set(EPSILON[0])
    return float(np.polyfit(1 / np.array(EPSILON), forces, len(EPSILON) - 1)[-1])


def main() -> None:
    """One mesh, every order from the lowest."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, value in (
        ("h0", 0.8),
        ("growth", 0.5),
        ("hmax", 10.0),
        ("rim", 0.0),
        ("D1", 5.8),
        ("C01", 0.0),
        ("C20", 0.0),
        ("C30", 0.0),
    ):
        parser.add_argument(f"--{name}", type=float, default=value)
    parser.add_argument("--orders", default="2,3,4")
    o = parser.parse_args()
    mesh = quarter(sizes(o.h0, o.growth, o.hmax, o.rim))
    print(f"h0 {o.h0:g}, growth {o.growth:g}, rim {o.rim:g} mm: {mesh.ne} tetrahedra; F in N at {ASKED} mm", flush=True)
    before, states = None, {}
    for order in map(int, o.orders.split(",")):
        start = time.process_time()
        press = Press(mesh, order, MU * o.D1, (o.C20 / MU, o.C30 / MU), o.C01 / MU)
        if before is None:
            states = walk(press)
        row = []
        for s in ASKED:
            if before is None:
                press.u.vec.data = states[s]
            else:
                before.u.vec.data = states[s]
                press.u.Set(before.u)
            press.height.Set(AXES[2] + R - s)
            row.append(without_penalty(press))
            states[s] = press.u.vec.CreateVector(copy=True)
        before = press
        print(
            f"order {order} {press.space.ndof:7d} dofs {time.process_time() - start:6.0f} s  "
            + " ".join(f"{f:.6f}" for f in row),
            flush=True,
        )


if __name__ == "__main__":
    main()
