"""Finite elements of the blind generator for a slab or a puck on its base: the meridian of a body of revolution.

As `fe.py` in everything but the body: units of mm and mu, curved quadratic elements become straight cubic triangles
with a linear pressure in each, and the integrals go over 2 pi r dr dz, with F = [[1 + u_r,r, u_r,z, 0], [u_z,r,
1 + u_z,z, 0], [0, 0, 1 + u_r/r]]. x is r, y is z; the base is z = 0.
"""

from dataclasses import dataclass, replace

import fe
import laws
import ngsolve as ng
import numpy as np
from netgen.geom2d import SplineGeometry
from ngsolve.comp import IntegrationRuleSpaceSurface

FINE = 3.4  # mm, radius of the surface with small elements
STEPS = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.25, 1.5)  # mm, depths computed up to the peak of the plan
TAIL = (1.7, 1.9, 2.1, 2.3, 2.5)  # mm, those of the deep run


@dataclass(frozen=True)
class Flat(fe.Model):
    """One experiment on a flat body of revolution; the defaults are the experimenter's belief of the slab."""

    height: float = 6.0
    width: float = 40.0  # radius
    slips: bool = False  # a base that lies on a plate without friction and never lifts; else it is bonded
    foundation: float = 0.0  # displacement of the base per pressure, mm (pressure over mu)


class Meridian(fe.Experiment):
    """A specimen with its history, as `fe.Experiment`."""

    def __init__(self, model, h=0.16, order=3, eps=400.0, mesh=None, wmax=None):
        self.model, self.sym, self.turn = model, "full", None
        self.c0 = np.array([0.0, model.height + model.radius])
        self.direction = np.array([0.0, -1.0])
        self.mesh = mesh or meridian_mesh(model, h)
        self.pressure_order = order - 2
        self.eps = eps * max(1.0, model.skin_ratio)
        self.trail, self.rest = [], None
        self._spaces(order)
        self._forms(wmax)

    def _spaces(self, order):
        m = self.model
        along = "axis" if m.slips else "axis|base"
        V = ng.VectorH1(self.mesh, order=order, dirichletx=along, dirichlety="" if m.foundation else "base")
        self.X = V * ng.L2(self.mesh, order=self.pressure_order)
        self.state, self.previous = ng.GridFunction(self.X), ng.GridFunction(self.X)
        self.u, self.u_old = self.state.components[0], self.previous.components[0]
        self.L = ng.L2(self.mesh, order=1)

    def _stretch(self, u):
        g = ng.Grad(u)
        around = ng.IfPos(ng.x - 1e-9, u[0] / (ng.x + 1e-12), g[0, 0])  # fields of the history are set on the axis too
        return ng.CF((1 + g[0, 0], g[0, 1], 0, g[1, 0], 1 + g[1, 1], 0, 0, 0, 1 + around), dims=(3, 3))

    def _gap(self, u, centre=None):
        r = ng.CF((ng.x, ng.y)) + u - (self.centre if centre is None else centre)
        norm = ng.sqrt(ng.InnerProduct(r, r))
        return norm - self.model.radius, r / norm

    def _scale(self):
        m, below = self.model, self.model.height - ng.y
        scale = ng.CF(1.0)
        if m.skin_ratio != 1:
            s = (m.skin_thickness - below) / (0.1 * m.skin_thickness)
            share = 0.5 * (1 + ng.IfPos(s - 1, 1.0, ng.IfPos(s + 1, s, -1.0)))
            scale = scale * (1 + (m.skin_ratio - 1) * share)
        if m.gradient:
            scale = scale * ng.exp(m.gradient * below / 10)
        if m.blob_ratio != 1:
            scale = scale * self.mesh.MaterialCF({"blob": m.blob_ratio}, default=1.0)
        return scale

    def _forms(self, wmax):
        m, ring = self.model, 2 * np.pi * ng.x
        (u, p), (v, _) = self.X.TnT()
        self._centre = [ng.Parameter(0.0) for _ in range(2)]
        self.centre = ng.CF(tuple(self._centre))
        self.dc = [ng.Parameter(0.0) for _ in range(2)]
        F = self._stretch(u)
        J = ng.Det(F)
        scale = self._scale()
        self.wfac, self.load, self.stick = ng.Parameter(1.0), ng.Parameter(0.0), ng.Parameter(fe.STICK[0])
        W = laws.isochoric_energy(m, F, J)
        if wmax is not None:
            W = fe.softened_energy(W, wmax, m.mullins)
        self.symmetric = not m.friction
        a = ng.BilinearForm(self.X, symmetric=self.symmetric)
        energy = self.wfac * scale * W + p * (J - 1) - m.muD1 / 4 / scale * p * p
        self.hist = []
        if m.prony:
            C = F.trans * F
            for _ in m.prony:
                H = ng.GridFunction(self.L**6)
                h = H.components
                M = ng.CF((h[0], h[3], h[4], h[3], h[1], h[5], h[4], h[5], h[2]), dims=(3, 3))
                energy = energy + 0.5 * ng.InnerProduct(M, C)
                self.hist.append(H)
            self.S_old = ng.GridFunction(self.L**6)
            self.M_old = [ng.GridFunction(self.L**6) for _ in m.prony]
        if m.weight:
            energy = energy + self.load * m.weight * u[1]
        a += ng.Variation((ring * energy).Compile() * ng.dx)
        if m.foundation:
            a += ng.Variation((ring * 0.5 / m.foundation * u[1] * u[1]).Compile() * ng.ds("base"))
        self.area, self.ds = ring, ng.ds("top", bonus_intorder=6)
        a += ng.Variation((ring * self._surface_energy(self._gap(u)[0])).Compile() * self.ds)
        self.rubbed, self.slid = [], []
        if m.friction:
            t_old, came, self.ds_friction = self._points("top", 12)
            self._friction = lambda w: self._traction_top(w, t_old, came)
            a += ng.InnerProduct(ring * self._friction(u), v).Compile() * self.ds_friction
            self.rubbed.append((t_old, self._friction(self.u), "top"))
            self.slid.append((came, self.u - self.u_old - ng.CF(tuple(self.dc)), "top"))
        self.a = a

    def _points(self, boundary, order):
        Q = IntegrationRuleSpaceSurface(self.mesh, order=order, definedon=self.mesh.Boundaries(boundary))
        return ng.GridFunction(Q**2), ng.GridFunction(Q**2), ng.ds(boundary, intrules=Q.GetIntegrationRules())

    def settle(self):
        """Let the weight act before the contact; the depth then counts from first contact with the sagged body."""
        self._place(-5.0)
        for share in (0.5, 1.0):
            self.load.Set(share)
            if not self._newton(1.0):
                raise fe.NotConverged("weight")
        self.previous.vec.data = self.state.vec
        self.c0 = self.c0 + np.array([0.0, self.u(self.mesh(0.0, self.model.height))[1]])

    def _newton(self, scale):
        """As `fe.Experiment`; a state with a broken element is none (the step is then halved)."""
        return super()._newton(scale) and not self._crushed()

    def _crushed(self):
        J = ng.Det(self._stretch(self.u))
        return ng.Integrate(ng.IfPos(0.2 - J, 1.0, 0.0) * ng.dx, self.mesh) > 0

    def _turned(self, F):
        """Force on the ball, (Fx, Fy, Fz)."""
        return np.array([0.0, 0.0, F[1]])

    def _force(self):
        g, n = self._gap(self.u)
        t = -self._pressure(g) * n
        F = np.array([0.0, ng.Integrate(self.area * t[1] * self.ds, self.mesh)])
        if self.model.friction:
            F[1] += ng.Integrate(self.area * self._friction(self.u)[1] * self.ds_friction, self.mesh)
        return F


def meridian_mesh(model, h):
    """Triangles of the half section 0 < r < width, 0 < z < height, small within FINE of the contact."""
    g = SplineGeometry()
    W, H, out = model.width, model.height, 0.35 * model.height
    fine = min(FINE, 0.8 * W)
    far = max(h, out)
    if model.blob_ratio != 1:
        z, r = model.blob_centre[2], model.blob_radius
        points = [(0, 0), (W, 0), (W, H), (fine, H), (0, H), (0, z + r), (r, z + r), (r, z), (r, z - r), (0, z - r)]
        a = [g.AppendPoint(*p) for p in points]
        for p, q, bc, size in ((0, 1, "base", far), (1, 2, "side", far), (2, 3, "top", far), (3, 4, "top", h)):
            g.Append(["line", a[p], a[q]], bc=bc, leftdomain=1, rightdomain=0, maxh=size)
        g.Append(["line", a[4], a[5]], bc="axis", leftdomain=1, rightdomain=0)
        g.Append(["spline3", a[5], a[6], a[7]], bc="inner", leftdomain=1, rightdomain=2, maxh=max(h, r / 4))
        g.Append(["spline3", a[7], a[8], a[9]], bc="inner", leftdomain=1, rightdomain=2, maxh=max(h, r / 4))
        g.Append(["line", a[5], a[9]], bc="axis", leftdomain=2, rightdomain=0, maxh=max(h, r / 4))
        g.Append(["line", a[9], a[0]], bc="axis", leftdomain=1, rightdomain=0)
        g.SetMaterial(1, "body")
        g.SetMaterial(2, "blob")
    else:
        a = [g.AppendPoint(*p) for p in [(0, 0), (W, 0), (W, H), (fine, H), (0, H)]]
        sizes = (("base", far), ("side", far), ("top", far), ("top", h), ("axis", out))
        for k, (bc, size) in enumerate(sizes):
            g.Append(["line", a[k], a[(k + 1) % 5]], bc=bc, leftdomain=1, rightdomain=0, maxh=size)
        g.SetMaterial(1, "body")
    mesh = ng.Mesh(g.GenerateMesh(maxh=out * 1.5, grading=0.3))
    mesh.Curve(3)
    return mesh


__all__ = ["STEPS", "TAIL", "Flat", "Meridian", "meridian_mesh", "replace"]
