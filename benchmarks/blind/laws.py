"""Strain energies over mu, and how the modulus varies in the body, as symbolic expressions of NGSolve."""

import ngsolve as ng
from body import AXES


def power_sums_of_stretches(C, J, alpha):
    """sum lambda_i^alpha of C's square root, alpha a multiple of 1/2, smooth where stretches coincide.

    The trace t of the square root of a matrix with invariants (I, II, III) is the largest root of
    (t^2 - I)^2 = 4 (II + 2 sqrt(III) t); done twice, then Newton's identities.
    """

    def root(I, II, sqrt_III):
        t = ng.sqrt(3.0 * I)
        for _ in range(7):
            f = (t * t - I) * (t * t - I) - 4 * (II + 2 * sqrt_III * t)
            t = t - f / (4 * t * (t * t - I) - 8 * sqrt_III)
        return t, 0.5 * (t * t - I), sqrt_III

    I = ng.Trace(C)
    e1, e2, e3 = root(I, 0.5 * (I * I - ng.InnerProduct(C, C)), J)
    e1, e2, e3 = root(e1, e2, ng.sqrt(e3))
    n = round(2 * alpha)
    if n < 0:  # power sums of the inverses
        e1, e2, e3, n = e2 / e3, e1 / e3, 1 / e3, -n
    p = [ng.CF(3.0), e1, e1 * e1 - 2 * e2]
    for _ in range(3, n + 1):
        p.append(e1 * p[-1] - e2 * p[-2] + e3 * p[-3])
    return p[n]


def isochoric_energy(model, F, J):
    """Isochoric strain energy over mu (without the viscous and softening parts), as a symbolic expression."""
    C = F.trans * F
    C_bar = J ** (-2 / 3) * C
    i1 = ng.Trace(C_bar) - 3
    if model.alpha != 2:
        sums = power_sums_of_stretches(C, J, model.alpha)
        W = 2 / model.alpha**2 * (J ** (-model.alpha / 3) * sums - 3)
    else:
        W = 0.5 * i1
    if model.c20 or model.c30:
        W = W + model.c20 * i1 * i1 + model.c30 * i1 * i1 * i1
    if model.fibre:
        i4 = C_bar[model.fibre_axis, model.fibre_axis] - 1
        W = W + 0.25 * model.fibre * ng.IfPos(i4, i4 * i4, 0.0)
    return W


def stiffness_field(model, mesh):
    """Factor of the modulus at a reference point (skin, gradient, inclusion)."""
    scale = ng.CF(1.0)
    a = AXES
    rho = ng.sqrt((ng.x / a[0]) ** 2 + (ng.y / a[1]) ** 2 + (ng.z / a[2]) ** 2 + 1e-6)
    slope = ng.sqrt((ng.x / a[0] ** 2) ** 2 + (ng.y / a[1] ** 2) ** 2 + (ng.z / a[2] ** 2) ** 2 + 1e-9) / rho
    below = (1 - rho) / slope  # distance below the surface, first order
    if model.skin_ratio != 1:
        ramp = 0.1 * model.skin_thickness
        s = (model.skin_thickness - below) / ramp
        share = 0.5 * (1 + ng.IfPos(s - 1, 1.0, ng.IfPos(s + 1, s, -1.0)))
        scale = scale * (1 + (model.skin_ratio - 1) * share)
    if model.gradient:
        scale = scale * ng.exp(model.gradient * ng.IfPos(below - 30, 30.0, below) / 10)
    if model.blob_ratio != 1:
        scale = scale * mesh.MaterialCF({"blob": model.blob_ratio}, default=1.0)
    return scale
