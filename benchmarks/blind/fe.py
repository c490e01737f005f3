"""Finite elements of the blind generator (NGSolve): a rigid sphere pressed into an ellipsoid.

Everything is dimensionless in the shear modulus (mu = 1; forces come out as F/mu in mm^2). Curved quadratic tets
with an element-wise constant pressure (coarse, every case) or cubic tets with a linear one (fine, for the library
of the unmodified experiment only); contact is a penalty energy on the reference surface.
    Pi(u, p) = int W_iso(F) + p (J - 1) - p^2 muD1 / 4 dV + int eps/2 <-g>^2 dA,     g = |X + u - c| - R
Friction is Coulomb's by a return mapping from the traction of the step before (elastic stick, augmented),
viscoelasticity the stress convolution of Holzapfel on the isochoric second Piola-Kirchhoff stress, softening a frozen
field of the largest energy reached.
"""

from dataclasses import dataclass, field, replace

import ngsolve as ng
import numpy as np
from body import AXES, Model, approach, brought_back, carry, ellipsoid_mesh, rotation, symmetry
from laws import isochoric_energy, stiffness_field
from ngsolve.comp import IntegrationRuleSpaceSurface

POINT_DEPTHS = (0.1, 0.3, 0.7, 1.2, 1.8, 2.5, 3.2, 4.0)
TOP_DEPTHS = (0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
DEEP_DEPTHS = (*TOP_DEPTHS, 4.5, 5.0, 5.5, 5.8)  # beyond, the forces hang on the mesh, see README
STICK = (80.0, 20.0)  # mu/mm, traction per slip of a point that sticks; the second where the first does not converge
SUBSTEPS = 3  # of every step with friction under the sphere
AUGMENT = 3  # repeats of a step that take this slip out, each from the traction of the one before
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
    """A specimen with its history; `press` moves the sphere and solves.

    sym: part of the body to model where it is to be more than the model needs; turn: the mesh (made for another
    place of contact) is deformed by it, see `body.carried`.
    """

    def __init__(self, model, h=0.9, order=2, eps=200.0, mesh=None, wmax=None, sym=None, turn=None):
        self.model, self.sym, self.turn = model, sym or symmetry(model), turn
        self.c0, self.direction, self.contact = approach(model)
        blob = (model.blob_centre, model.blob_radius) if model.blob_ratio != 1 else None
        self.mesh = mesh or ellipsoid_mesh(self.sym, self.contact[:2], h, blob, 3.0 if model.bowl is not None else None)
        self.moved = carry(self.mesh, turn) if turn else None
        self.pressure_order = order - 2
        self.eps = eps * max(1.0, model.skin_ratio)
        self.trail = []  # the last states, (depth, vector)
        self.rest = np.zeros(len(MARKS))  # displacement of the marks before contact
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

    def _scale(self):
        """Factor of the modulus at a reference point."""
        return stiffness_field(self.model, self.mesh)

    def _gap(self, u, centre=None):
        ax = self.model.axes
        r = ng.CF((ng.x * ax[0], ng.y * ax[1], ng.z * ax[2])) + u - (self.centre if centre is None else centre)
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
        scale = self._scale()
        self.wfac = ng.Parameter(1.0)
        W = isochoric_energy(m, F, J)
        if wmax is not None:
            W = softened_energy(W, wmax, m.mullins)
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
        self.stick = ng.Parameter(STICK[0])
        self.rubbed, self.slid = [], []  # (values at the integration points a step before, expression, boundary)
        if m.friction:
            t_old, came, self.ds_friction = self._points("top", 10)
            self._friction = lambda w: self._traction_top(w, t_old, came)
            a += ng.InnerProduct(area * self._friction(u), v).Compile() * self.ds_friction
            self.rubbed.append((t_old, self._friction(self.u), "top"))
            self.slid.append((came, self.u - self.u_old - ng.CF(tuple(self.dc)), "top"))
        if m.bowl is not None:
            db = ng.ds("bottom", bonus_intorder=4)
            pen = self._bowl(u)[0]
            k = 20.0
            a += ng.Variation((0.5 * k * ng.IfPos(pen, pen * pen, 0.0)).Compile() * db)
            if m.bowl_friction:
                t_old, came, db = self._points("bottom", 8)

                def traction(w):
                    gap, n = self._bowl(w)
                    gap, old = -gap, -self._bowl(self.u_old)[0]
                    return returned(t_old, w - self.u_old, came, n, m.bowl_friction * k, gap, old, self.stick)

                a += ng.InnerProduct(traction(u), v).Compile() * db
                self.rubbed.append((t_old, traction(self.u), "bottom"))
                self.slid.append((came, self.u - self.u_old, "bottom"))
        self.a, self.ds, self.area = a, ds, area

    def _points(self, boundary, order):
        """Two vector fields at the integration points of a boundary, zero, and the integral over these points."""
        Q = IntegrationRuleSpaceSurface(self.mesh, order=order, definedon=self.mesh.Boundaries(boundary))
        return ng.GridFunction(Q**3), ng.GridFunction(Q**3), ng.ds(boundary, intrules=Q.GetIntegrationRules())

    def _traction_top(self, u, t_old, came):
        """Traction that resists the slip of the surface under the sphere (as +int t.v in the weak form)."""
        dc = ng.CF(tuple(self.dc))
        gap, n = self._gap(u)
        old = self._gap(self.u_old, self.centre - dc)[0]
        return returned(t_old, u - self.u_old - dc, came, n, self.model.friction * self.eps, gap, old, self.stick)

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
        self.rest = self._profile(rotation(self.model.tilt))  # marks are read from here, as the depth is

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
            S = self._scale() * J ** (-2 / 3) * (ng.Id(3) - ng.Trace(C) / 3 * ng.Inv(C))
            new = ng.GridFunction(self.L**6)
            for comp, (i, j) in zip(new.components, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True):
                comp.Set(S[i, j])
            for (_, tau), M in zip(self.model.prony, self.M_old, strict=True):
                e, gamma = np.exp(-self._dt / tau), -np.expm1(-self._dt / tau) * tau / self._dt
                M.vec.data = e * M.vec + gamma * new.vec - gamma * self.S_old.vec
            self.S_old.vec.data = new.vec
        self._hold(self.rubbed + self.slid)
        self.previous.vec.data = self.state.vec

    def _hold(self, fields):
        """Take over the present friction tractions (and slips) as those the return mapping starts from."""
        for t, expression, where in fields:
            values = ng.GridFunction(t.space)
            values.Interpolate(expression, definedon=self.mesh.Boundaries(where))
            t.vec.data = values.vec

    def _augment(self, scale):
        """Take the elastic slip of sticking points out of a solved step; what does not converge stays as it was."""
        for _ in range(AUGMENT if self.rubbed else 0):
            kept = [(f, f.vec.CreateVector(copy=True)) for f in (self.state, *(t for t, _, _ in self.rubbed))]
            self._hold(self.rubbed)
            if not self._newton(scale):
                for f, vec in kept:
                    f.vec.data = vec
                break

    def snapshot(self):
        """Copies of all that the history consists of."""
        fields = [self.state, self.previous] + ([self.S_old, *self.M_old] if self.model.prony else [])
        fields += [t for t, _, _ in self.rubbed + self.slid]
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
        t0, d0 = start
        trail = [(d0, self.state.vec.CreateVector(copy=True))]
        if self.trail and self.trail[-1][0] == d0:
            trail = self.trail  # the secant of the way down predicts the first step of the way up
        old_c = self._place(d0)
        n = SUBSTEPS if self.model.friction else 1
        for t, d in path:
            todo = [(t + (t0 - t) * k / n, d + (d0 - d) * k / n) for k in range(n)]  # the last is next
            while todo:
                t1, d1 = todo[-1]
                c = self._place(d1)
                for par, value in zip(self.dc, c - old_c, strict=True):
                    par.Set(float(value))
                if self.model.prony:
                    self._viscous(t1 - t0)
                for stick in STICK if self.rubbed else STICK[:1]:
                    self.stick.Set(stick)
                    self._predict(trail, d1)
                    ok = self._newton(max(0.3, 15 * abs(d1)))
                    if ok:
                        break
                if not ok and len(trail) > 1:
                    self.state.vec.data = trail[-1][1]
                    ok = self._newton(max(0.3, 15 * abs(d1)))
                if not ok:
                    self.state.vec.data = trail[-1][1]
                    if len(todo) > cut + n - 1:
                        error = NotConverged(f"depth {d1:.3f}")
                        error.reached = out
                        raise error
                    todo.append((0.5 * (t0 + t1), 0.5 * (d0 + d1)))
                    continue
                todo.pop()
                if self._crushed():
                    error = NotConverged(f"element turned inside out at depth {d1:.3f}")
                    error.reached = out
                    raise error
                self._augment(max(0.3, 15 * abs(d1)))
                F = factor * self._force()
                self._store()
                trail = [*trail, (d1, self.state.vec.CreateVector(copy=True))][-3:]
                self.trail = trail
                t0, d0, old_c = t1, d1, c
            out.t.append(t)
            out.d.append(d)
            out.F.append(self._turned(F))
            out.Ec.append(factor * self._contact_energy())
            out.uz.append((self._profile(rotation(self.model.tilt)) - self.rest).tolist() if profile else None)
        return out

    def _crushed(self):
        """Whether the volume ratio is below 0.2 anywhere (the material keeps it near 1: elements have broken)."""
        J = ng.Det(self._stretch(self.u))
        return ng.Integrate(ng.IfPos(0.2 - J, 1.0, 0.0) * ng.dx(bonus_intorder=-2), self.mesh) > 0

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
        F = np.array([ng.Integrate(self.area * t[i] * self.ds, self.mesh) for i in range(3)])
        if self.model.friction:
            t = self._friction(self.u)
            F += [ng.Integrate(self.area * t[i] * self.ds_friction, self.mesh) for i in range(3)]
        return F

    def _contact_energy(self):
        """Energy of the penalty, int eps/2 <-g>^2 dA."""
        g = self._gap(self.u)[0]
        return ng.Integrate(self.area * 0.5 * self.eps * ng.IfPos(-g, g * g, 0.0) * self.ds, self.mesh)

    def _turned(self, F):
        """Force on the sphere in the machine's frame, without what a plane of symmetry takes."""
        return rotation(self.model.tilt) @ self._symmetric(F)

    def _symmetric(self, F):
        zero = {"quarter": (0, 1), "half_x": (0,), "half_y": (1,), "full": ()}[self.sym]
        F = F.copy()
        F[list(zero)] = 0
        return F

    def _profile(self, Q):
        """Vertical displacement of the marks at nominal y = 5 mm; they are on the specimen and turn with it."""
        rows = []
        for x in MARKS:
            flip = np.array([-1.0 if self.sym in ("quarter", "half_x") and x < 0 else 1.0, 1.0, 1.0])
            X = np.array([x, 5.0, AXES[2] * np.sqrt(1 - (x / AXES[0]) ** 2 - (5.0 / AXES[1]) ** 2)])
            u = np.zeros(3)
            for pull in (0.9995, 0.998, 0.99):  # the curved mesh ends a little inside of the ellipsoid
                try:
                    at = pull * X * flip
                    at = brought_back(at, self.turn)[0] if self.turn else at  # points are found on the mesh as made
                    u = np.array(self.u(self.mesh(*at))) * flip
                    break
                except Exception:
                    continue
            rows.append(float((Q @ u)[2]))
        return np.array(rows)


def softened_energy(W, wmax, mullins):
    """Frozen Mullins field: W~ = W - (1/r) int tanh((Wm - W)/c) dW."""
    r, beta, m0 = mullins
    c = m0 + beta * wmax
    s = ng.IfPos(wmax - W, (wmax - W) / c, 0.0)
    return W + c / r * ng.log(0.5 * (ng.exp(s) + ng.exp(-s)))


def returned(t_old, slip, before, n, stiffness, gap, gap_old, stick):
    """Coulomb traction |t| <= stiffness <-gap>: elastic from t_old over the slip in contact, then scaled back.

    A point that touches within the step rubs only after it touched; until then it came in the direction of the step
    before (`before`, the motion against the sphere in it), and what it slipped on the way leaves no traction.
    """
    share = ng.IfPos(gap, 0.0, ng.IfPos(gap_old, gap / (gap - gap_old - 1e-12), 1.0))
    near = -ng.InnerProduct(before, n)
    way = ng.IfPos(gap_old, ng.IfPos(near - 1e-9, gap_old / (near + 1e-12), 0.0), 0.0)
    trial = t_old + stick * share * (slip - way * before)
    trial = trial - ng.InnerProduct(trial, n) * n
    size = ng.sqrt(ng.InnerProduct(trial, trial) + 1e-16)
    limit = stiffness * ng.IfPos(-gap, -gap, 0.0)
    return ng.IfPos(size - limit, limit / size, 1.0) * trial


def curve(model, depths, speed=0.5, **options):
    """One monotonic loading at `speed` mm/s."""
    return Experiment(model, **options).press([(d / speed, d) for d in depths])


__all__ = ["Experiment", "Model", "NotConverged", "Path", "curve", "replace"]
