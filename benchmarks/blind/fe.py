"""Finite elements of the blind generator (NGSolve): a rigid sphere pressed into an ellipsoid.

Everything is dimensionless in the shear modulus (mu = 1; forces come out as F/mu in mm^2). Curved quadratic tets
with an element-wise constant pressure (coarse, every case) or cubic tets with a linear one (fine, for the library
of the unmodified experiment only); contact is a penalty energy on the reference surface.
    Pi(u, p) = int W_iso(F) + p (J - 1) - p^2 muD1 / 4 dV + int eps/2 <-g>^2 dA,     g = |X + u - c| - R
Friction is a regularised Coulomb traction on the slip increment of a step, viscoelasticity the stress convolution of
Holzapfel on the isochoric second Piola-Kirchhoff stress, softening a frozen field of the largest energy reached.
"""

from dataclasses import dataclass, field, replace

import ngsolve as ng
import numpy as np
from body import AXES, Model, approach, ellipsoid_mesh, rotation, symmetry
from laws import isochoric_energy, stiffness_field

POINT_DEPTHS = (0.1, 0.3, 0.7, 1.2, 1.8, 2.5, 3.2, 4.0)
TOP_DEPTHS = (0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
DEEP_DEPTHS = (*TOP_DEPTHS, 4.5, 5.0, 5.5, 5.8, 6.0, 6.2)
SLIP = 0.008  # mm, slip below which friction is regularised
MARKS = np.arange(-30.0, 31.0, 5.0)


class NotConverged(RuntimeError):
    """Newton's method did not converge within the smallest step; `reached` holds the path up to there."""


@dataclass
class Path:
    """What came out: depth d, force on the indenter F (n, 3), profile (n, 13) or None."""

    t: list = field(default_factory=list)
    d: list = field(default_factory=list)
    F: list = field(default_factory=list)
    Ec: list = field(default_factory=list)
    uz: list = field(default_factory=list)


class Experiment:
    """A specimen with its history; `press` moves the sphere and solves."""

    def __init__(self, model, h=0.9, order=2, eps=200.0, mesh=None, wmax=None):
        self.model, self.sym = model, symmetry(model)
        self.c0, self.direction, self.contact = approach(model)
        blob = (model.blob_centre, model.blob_radius) if model.blob_ratio != 1 else None
        self.mesh = mesh or ellipsoid_mesh(self.sym, self.contact[:2], h, blob, 3.0 if model.bowl is not None else None)
        self.pressure_order = order - 2
        self.eps = eps * max(1.0, model.skin_ratio)
        self.trail = []  # the last states, (depth, vector)
        self._spaces(order)
        self._forms(wmax)

    def _spaces(self, order):
        fixed = {} if self.model.bowl is not None else {"dirichlet": "bottom"}
        V = ng.VectorH1(self.mesh, order=order, dirichletx="symx", dirichlety="symy", **fixed)
        Q = ng.L2(self.mesh, order=self.pressure_order)
        self.X = V * Q
        self.state, self.previous = ng.GridFunction(self.X), ng.GridFunction(self.X)
        self.u, self.u_old = self.state.components[0], self.previous.components[0]
        self.L = ng.L2(self.mesh, order=1)

    def _stretch(self, u):
        """Gradient F of the motion with respect to the true reference (nominal mesh scaled by the axes' factors)."""
        inv = 1 / np.array(self.model.axes)
        scale = ng.CF((inv[0], 0, 0, 0, inv[1], 0, 0, 0, inv[2]), dims=(3, 3))
        return ng.Id(3) + ng.Grad(u) * scale

    def _gap(self, u):
        ax = self.model.axes
        r = ng.CF((ng.x * ax[0], ng.y * ax[1], ng.z * ax[2])) + u - self.centre
        norm = ng.sqrt(ng.InnerProduct(r, r))
        return norm - self.model.radius, r / norm

    def _bowl(self, u):
        """Penetration into the bowl and its inward normal; the specimen rests on the bottom at the start."""
        m = self.model
        b = AXES * np.array(m.axes) + m.bowl
        r = ng.CF((ng.x * m.axes[0], ng.y * m.axes[1], ng.z * m.axes[2] - m.bowl)) + u
        q = ng.CF((r[0] / b[0], r[1] / b[1], r[2] / b[2]))
        rho = ng.sqrt(ng.InnerProduct(q, q) + 1e-12)
        grad = ng.CF((r[0] / b[0] ** 2, r[1] / b[1] ** 2, r[2] / b[2] ** 2)) / rho
        size = ng.sqrt(ng.InnerProduct(grad, grad))
        return (rho - 1) / size, -grad / size

    def _surface_energy(self, g):
        m = self.model
        pen = 0.5 * self.eps * ng.IfPos(-g, g * g, 0.0)
        if m.adhesion:
            w, delta = m.adhesion, m.adhesion_range
            pen = pen + ng.IfPos(g, -w * ng.exp(-g / delta), -w + w / delta * g)
        return pen

    def _pressure(self, g):
        """Pressure of the sphere on the surface (tension negative)."""
        m = self.model
        p = self.eps * ng.IfPos(-g, -g, 0.0)
        if m.adhesion:
            p = p - m.adhesion / m.adhesion_range * ng.IfPos(g, ng.exp(-g / m.adhesion_range), 1.0)
        return p

    def _forms(self, wmax):
        m = self.model
        (u, p), (v, _) = self.X.TnT()
        self._centre = [ng.Parameter(0.0) for _ in range(3)]
        self.centre = ng.CF(tuple(self._centre))
        self.dc = [ng.Parameter(0.0) for _ in range(3)]
        jac = float(np.prod(m.axes))
        area = jac ** (2 / 3)  # scaled axes differ by percents: the area factor only scales the penalty
        F = self._stretch(u)
        J = ng.Det(F)
        scale = stiffness_field(m, self.mesh)
        self.wfac = ng.Parameter(1.0)
        W = isochoric_energy(m, F, J)
        if wmax is not None:  # frozen Mullins field: W~ = W - (1/r) int tanh((Wm - W)/c) dW
            r, beta, m0 = m.mullins
            c = m0 + beta * wmax
            s = ng.IfPos(wmax - W, (wmax - W) / c, 0.0)
            W = W + c / r * ng.log(0.5 * (ng.exp(s) + ng.exp(-s)))
        self.symmetric = not (m.friction or m.bowl_friction)
        a = ng.BilinearForm(self.X, symmetric=self.symmetric)
        dx = ng.dx(bonus_intorder=0 if m.skin_ratio != 1 else -2)  # four points per tet carry a quadratic field
        energy = jac * (self.wfac * scale * W + p * (J - 1) - m.muD1 / 4 / scale * p * p)
        self.hist = []
        if m.prony:
            C = F.trans * F
            for _ in m.prony:
                H = ng.GridFunction(self.L**6)
                h = H.components
                M = ng.CF((h[0], h[3], h[4], h[3], h[1], h[5], h[4], h[5], h[2]), dims=(3, 3))
                energy = energy + jac * 0.5 * ng.InnerProduct(M, C)
                self.hist.append(H)
            self.S_old = ng.GridFunction(self.L**6)
            self.M_old = [ng.GridFunction(self.L**6) for _ in m.prony]
        if m.weight:
            self.load = ng.Parameter(0.0)
            energy = energy + jac * self.load * m.weight * u[2]
        if m.bowl is not None:
            energy = energy + 1e-8 * ng.InnerProduct(u, u)
        a += ng.Variation(energy.Compile() * dx)
        ds = ng.ds("top", bonus_intorder=6)
        a += ng.Variation((area * self._surface_energy(self._gap(u)[0])).Compile() * ds)
        if m.friction:
            a += ng.InnerProduct(area * self._friction(u), v).Compile() * ds
        if m.bowl is not None:
            db = ng.ds("bottom", bonus_intorder=4)
            pen = self._bowl(u)[0]
            k = 20.0
            a += ng.Variation((0.5 * k * ng.IfPos(pen, pen * pen, 0.0)).Compile() * db)
            if m.bowl_friction:
                n = self._bowl(u)[1]
                slip = u - self.u_old
                slip = slip - ng.InnerProduct(slip, n) * n
                t = (
                    m.bowl_friction
                    * k
                    * ng.IfPos(pen, pen, 0.0)
                    * slip
                    / ng.sqrt(ng.InnerProduct(slip, slip) + (0.2 * SLIP) ** 2)
                )
                a += ng.InnerProduct(t, v).Compile() * db
        self.a, self.ds, self.area = a, ds, area

    def _friction(self, u):
        """Traction that resists the slip of the surface (as +int t.v in the weak form)."""
        g, n = self._gap(u)
        slip = u - self.u_old - ng.CF(tuple(self.dc))
        slip = slip - ng.InnerProduct(slip, n) * n
        p = self.eps * ng.IfPos(-g, -g, 0.0)
        return self.model.friction * p * slip / ng.sqrt(ng.InnerProduct(slip, slip) + SLIP**2)

    def _newton(self, scale):
        """Newton's method to a residual of 3e-5 scale; False if it does not get there."""
        a, x = self.a, self.state.vec
        r, w, old = x.CreateVector(), x.CreateVector(), x.CreateVector()
        free = ng.Projector(self.X.FreeDofs(), True)

        def residual():
            a.Apply(x, r)
            free.Project(r)
            return r.Norm()

        rn = residual()
        rise = 3.0 if self.symmetric else 1.2  # refuse only steps that make the residual explode; friction is touchier
        for iteration in range(16 if self.symmetric else 30):
            if not np.isfinite(rn):
                return False
            if rn < 3e-5 * scale and iteration:
                return True
            a.AssembleLinearization(x)
            w.data = a.mat.Inverse(self.X.FreeDofs(), inverse="sparsecholesky" if self.symmetric else "umfpack") * r
            old.data = x
            step, new = 1.0, np.inf
            while not new < rise * rn + 0.1 * rise * scale and step > 0.05:
                x.data = old - step * w
                new = residual()
                step /= 2
            rn = new
        return False

    def settle(self):
        """Let the weight act before the contact; the depth then counts from first contact with the sagged body."""
        self._place(-5.0)
        for share in (0.5, 1.0):
            self.load.Set(share)
            if not self._newton(1.0):
                raise NotConverged("weight")
        self.previous.vec.data = self.state.vec
        point = self.mesh(*(0.9995 * self.contact / np.array(self.model.axes)))
        sag = np.array(self.u(point))
        n = (self.c0 - self.contact) / self.model.radius
        self.c0 = self.c0 + self.direction * (sag @ n) / (self.direction @ n)

    def _place(self, d):
        c = self.c0 + d * self.direction
        for par, value in zip(self._centre, c, strict=True):
            par.Set(float(value))
        return c

    def _viscous(self, dt):
        """Set the history terms for a step of length dt (see the module's docstring)."""
        total = 1.0
        for (g, tau), H, M in zip(self.model.prony, self.hist, self.M_old, strict=True):
            e, gamma = np.exp(-dt / tau), -np.expm1(-dt / tau) * tau / dt
            H.vec.data = g * e * M.vec - g * gamma * self.S_old.vec
            total += g * gamma - g
        self.wfac.Set(total)
        self._dt = dt

    def _store(self):
        if self.model.prony:
            F = self._stretch(self.u)
            J = ng.Det(F)
            C = F.trans * F
            S = stiffness_field(self.model, self.mesh) * J ** (-2 / 3) * (ng.Id(3) - ng.Trace(C) / 3 * ng.Inv(C))
            new = ng.GridFunction(self.L**6)
            for comp, (i, j) in zip(new.components, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True):
                comp.Set(S[i, j])
            for (_, tau), M in zip(self.model.prony, self.M_old, strict=True):
                e, gamma = np.exp(-self._dt / tau), -np.expm1(-self._dt / tau) * tau / self._dt
                M.vec.data = e * M.vec + gamma * new.vec - gamma * self.S_old.vec
            self.S_old.vec.data = new.vec
        self.previous.vec.data = self.state.vec

    def snapshot(self):
        """Copies of all that the history consists of."""
        fields = [self.state, self.previous] + ([self.S_old, *self.M_old] if self.model.prony else [])
        return [(f, f.vec.CreateVector(copy=True)) for f in fields], list(self.trail)

    def restore(self, kept):
        """Back to a snapshot."""
        for f, vec in kept[0]:
            f.vec.data = vec
        self.trail = kept[1]

    def largest_energy(self):
        """Field of the isochoric energy of the present state (largest, if the sphere only went down)."""
        F = self._stretch(self.u)
        W = ng.GridFunction(self.L)
        W.Set(isochoric_energy(self.model, F, ng.Det(F)))
        return W

    def press(self, path, profile=False, start=(0.0, 0.0), cut=3):
        """Follow `path`, rows (t, d), from `start`; returns a Path.

        A step that fails is halved, up to `cut` times; then NotConverged, which carries what was reached.
        """
        if self.model.weight and not start[1]:
            self.settle()
        out = Path()
        factor = {"quarter": 4, "half_x": 2, "half_y": 2, "full": 1}[self.sym]
        Q = rotation(self.model.tilt)
        t0, d0 = start
        trail = [(d0, self.state.vec.CreateVector(copy=True))]
        if self.trail and self.trail[-1][0] == d0:
            trail = self.trail  # the secant of the way down predicts the first step of the way up
        old_c = self._place(d0)
        for t, d in path:
            todo = [(t, d)]
            while todo:
                t1, d1 = todo[-1]
                c = self._place(d1)
                for par, value in zip(self.dc, c - old_c, strict=True):
                    par.Set(float(value))
                if self.model.prony:
                    self._viscous(t1 - t0)
                self._predict(trail, d1)
                ok = self._newton(max(0.3, 15 * abs(d1)))
                if not ok and len(trail) > 1:
                    self.state.vec.data = trail[-1][1]
                    ok = self._newton(max(0.3, 15 * abs(d1)))
                if not ok:
                    self.state.vec.data = trail[-1][1]
                    if len(todo) > cut:
                        error = NotConverged(f"depth {d1:.3f}")
                        error.reached = out
                        raise error
                    todo.append((0.5 * (t0 + t1), 0.5 * (d0 + d1)))
                    continue
                todo.pop()
                F = factor * self._force()
                self._store()
                trail = [*trail, (d1, self.state.vec.CreateVector(copy=True))][-3:]
                self.trail = trail
                t0, d0, old_c = t1, d1, c
            out.t.append(t)
            out.d.append(d)
            out.F.append(Q @ self._symmetric(F))
            out.Ec.append(factor * self._contact_energy())
            out.uz.append(self._profile(Q) if profile else None)
        return out

    def _predict(self, trail, d):
        x = self.state.vec
        if len(trail) == 1:
            x.data = trail[-1][1]
            return
        (da, a), (db, b) = trail[-2:]
        turned = (len(trail) == 3 and (trail[0][0] - da) * (da - db) <= 0) or (da - db) * (db - d) <= 0
        if len(trail) == 3 and trail[0][0] > 0 and not turned:  # quadratic, in the square root of the depth
            q, (qc, qa, qb) = abs(d) ** 0.5, [abs(v) ** 0.5 for v, _ in trail]
            lc = (q - qa) * (q - qb) / ((qc - qa) * (qc - qb))
            la = (q - qc) * (q - qb) / ((qa - qc) * (qa - qb))
            lb = (q - qc) * (q - qa) / ((qb - qc) * (qb - qa))
            x.data = lc * trail[0][1] + la * a + lb * b
            return
        s = (d - db) / (db - da)
        x.data = b + s * b - s * a

    def _force(self):
        g, n = self._gap(self.u)
        t = -self._pressure(g) * n
        if self.model.friction:
            t = t + self._friction(self.u)
        return np.array([ng.Integrate(self.area * t[i] * self.ds, self.mesh) for i in range(3)])

    def _contact_energy(self):
        """Energy of the penalty, int eps/2 <-g>^2 dA."""
        g = self._gap(self.u)[0]
        return ng.Integrate(self.area * 0.5 * self.eps * ng.IfPos(-g, g * g, 0.0) * self.ds, self.mesh)

    def _symmetric(self, F):
        zero = {"quarter": (0, 1), "half_x": (0,), "half_y": (1,), "full": ()}[self.sym]
        F = F.copy()
        F[list(zero)] = 0
        return F

    def _profile(self, Q):
        """Vertical displacement of the marks at nominal y = 5 mm."""
        rows = []
        for x in MARKS:
            flip = np.array([-1.0 if self.sym in ("quarter", "half_x") and x < 0 else 1.0, 1.0, 1.0])
            X = np.array([x, 5.0, AXES[2] * np.sqrt(1 - (x / AXES[0]) ** 2 - (5.0 / AXES[1]) ** 2)])
            u = np.zeros(3)
            for pull in (0.9995, 0.998, 0.99):  # the curved mesh ends a little inside of the ellipsoid
                try:
                    u = np.array(self.u(self.mesh(*(pull * X * flip)))) * flip
                    break
                except Exception:
                    continue
            rows.append(float((Q @ u)[2]))
        return rows


def curve(model, depths, speed=0.5, **options):
    """One monotonic loading at `speed` mm/s."""
    return Experiment(model, **options).press([(d / speed, d) for d in depths])


__all__ = ["Experiment", "Model", "NotConverged", "Path", "curve", "replace"]
