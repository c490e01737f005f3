"""The experiment to be computed (`Model`), where the sphere first touches, and the mesh of the ellipsoid."""

from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from netgen.csg import CSGeometry, Ellipsoid, Plane, Pnt, Sphere, Vec
from netgen.meshing import MeshingParameters
from scipy.optimize import brentq, minimize

AXES = np.array([60.0, 35.0, 35.0])


@dataclass(frozen=True)
class Model:
    """One mechanical experiment in units of mm and mu; the defaults are the experimenter's belief."""

    muD1: float = 0.1
    c20: float = 0.0  # Yeoh, over mu
    c30: float = 0.0
    alpha: float = 2.0  # Ogden exponent, a multiple of one half
    fibre: float = 0.0  # tension-only fibre stiffness over mu
    fibre_axis: int = 0
    skin_ratio: float = 1.0
    skin_thickness: float = 0.5
    gradient: float = 0.0  # modulus times exp(gradient * distance below the surface / 10 mm)
    blob_ratio: float = 1.0  # inclusion (or, nearly zero, cavity) in a sphere
    blob_centre: tuple = (0.0, 0.0, 20.0)
    blob_radius: float = 0.0
    axes: tuple = (1.0, 1.0, 1.0)  # factors of the semi-axes
    radius: float = 3.0
    weight: float = 0.0  # specific weight over mu, 1/mm
    friction: float = 0.0
    adhesion: float = 0.0  # work of adhesion over mu, mm
    adhesion_range: float = 0.2
    bowl: float | None = None  # clearance; None: lower half held
    bowl_friction: float = 0.0
    prony: tuple = ()  # ((g, tau), ...)
    mullins: tuple | None = None  # (r, m): eta = 1 - tanh((Wmax - W)/(m Wmax + m0))/r, see energies()
    line: tuple = (0.0, 0.0)  # (x, y) of the vertical the sphere's centre moves on
    tilt: tuple = (0.0, 0.0)  # rotation of the specimen (with its holder) about x, then y, radians


def rotation(tilt):
    """Matrix of the specimen's rotation about x, then about y."""
    (cx, sx), (cy, sy) = [(np.cos(a), np.sin(a)) for a in tilt]
    return np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])


def approach(model):
    """Start of the sphere's centre c0 at first contact, unit direction and contact point, in the specimen's frame."""
    Q = rotation(model.tilt)
    direction = Q.T @ np.array([0.0, 0.0, -1.0])
    x0 = Q.T @ np.array([*model.line, 0.0])
    height = brentq(lambda s: nearest(model, x0 - s * direction)[0] - model.radius, 30.0, 55.0, xtol=1e-9)
    c0 = x0 - height * direction
    return c0, direction, nearest(model, c0)[1]


def nearest(model, c):
    """Distance of a point from the ellipsoid (inside negative) and the point of its upper surface nearest to it."""
    a = AXES * np.array(model.axes)

    def surface(q):
        return np.array([q[0], q[1], a[2] * np.sqrt(max(1 - (q[0] / a[0]) ** 2 - (q[1] / a[1]) ** 2, 1e-9))])

    best = minimize(lambda q: np.sum((surface(q) - c) ** 2), c[:2], tol=1e-14)
    return np.sign(np.sum((c / a) ** 2) - 1) * np.sqrt(best.fun), surface(best.x)


def beneath(model, depth=2.5):
    """Point of the surface nearest to the sphere's centre after this travel, the middle of the contact by then."""
    c0, direction, _ = approach(model)
    return nearest(model, c0 + depth * direction)[1]


def first_contact(model):
    """Unit normal of the surface where the sphere first touches (in the machine's frame), mean curvature there."""
    c0, _, x = approach(model)
    p, a2 = x / AXES**2, AXES**2  # nominal axes
    curvature = (a2.sum() - x @ x) / (2 * a2.prod() * (p @ p) ** 1.5)
    return rotation(model.tilt) @ (c0 - x) / model.radius, curvature


def symmetry(model):
    """'quarter', 'half_x' (x >= 0 modelled), 'half_y' (y >= 0 modelled) or 'full'."""
    cx, cy, _ = model.blob_centre
    odd_x = model.line[0] != 0 or model.tilt[1] != 0 or (model.blob_ratio != 1 and cx != 0)
    odd_y = model.line[1] != 0 or model.tilt[0] != 0 or (model.blob_ratio != 1 and cy != 0)
    return {(0, 0): "quarter", (0, 1): "half_x", (1, 0): "half_y", (1, 1): "full"}[int(odd_x), int(odd_y)]


def ellipsoid_mesh(sym, centre, h, blob=None, bottom_h=None):
    """Tetrahedral mesh of the nominal ellipsoid, refined to h near `centre` (x, y)."""
    g = CSGeometry()
    a, b, c = AXES
    origin = Pnt(0, 0, 0)
    up = Ellipsoid(origin, Vec(a, 0, 0), Vec(0, b, 0), Vec(0, 0, c)).bc("top") * Plane(origin, Vec(0, 0, -1)).bc("mid")
    low = Ellipsoid(origin, Vec(a, 0, 0), Vec(0, b, 0), Vec(0, 0, c)).bc("bottom") * Plane(origin, Vec(0, 0, 1)).bc(
        "mid"
    )
    x0, y0 = Vec(-1, 0, 0), Vec(0, -1, 0)
    pieces = {  # a half is meshed as two glued quarters: netgen's surface mesher prefers them
        "quarter": [((x0, "symx"), (y0, "symy"))],
        "half_x": [((x0, "symx"), (y0, "inner")), ((x0, "symx"), (-1 * y0, "inner"))],
        "half_y": [((x0, "inner"), (y0, "symy")), ((-1 * x0, "inner"), (y0, "symy"))],
        "full": [()],
    }[sym]
    parts = [("body", up), ("body", low)]
    if blob:
        ball = Sphere(Pnt(*blob[0]), blob[1]).bc("blob")
        parts = [("body", up - ball), ("blob", ball), ("body", low)]
    for piece in pieces:
        for name, solid in parts:
            for normal, label in piece:
                solid = solid * Plane(origin, normal).bc(label)
            g.Add(solid.mat(name))
    for factor, grading in ((1, 0.45), (1.06, 0.4), (0.95, 0.4), (1.12, 0.5), (0.9, 0.35), (1.2, 0.3)):
        try:  # netgen's surface mesher sometimes gives up on a set of sizes
            mesh = ng.Mesh(g.GenerateMesh(_sizes(centre, h * factor, bottom_h, grading)))
        except Exception:
            continue
        mesh.Curve(2)
        return mesh
    raise RuntimeError("no mesh")


def turning(start, end):
    """Unit axis and angle that take `start` to `end`, points of the nominal surface, in coordinates over the axes."""
    p, q = np.asarray(start) / AXES, np.asarray(end) / AXES
    axis = np.cross(p, q)
    size = np.linalg.norm(axis)
    return (axis / size if size > 1e-14 else np.array([1.0, 0.0, 0.0])), float(np.arctan2(size, p @ q))


def carried(X, turn):
    """Points (n, 3) taken along when the contact moves on the surface by `turn` = (axis k, angle), (n, 3).

    q -> R(k, s(q_z) angle) q in coordinates q over the semi-axes, s from 0 at the equator to 1 at q_z = 0.8: spheres
    stay spheres, the bonded half stays as it is, and so does a plane of symmetry that the axis is normal to.
    """
    k, angle = turn
    q = np.atleast_2d(X) / AXES
    t = np.clip(q[:, 2:] / 0.8, 0, 1)
    a = t * t * (3 - 2 * t) * angle
    return (q * np.cos(a) + np.cross(k, q) * np.sin(a) + np.outer(q @ k, k) * (1 - np.cos(a))) * AXES


def brought_back(X, turn):
    """Inverse of `carried` by repeated substitution, (n, 3)."""
    X = Y = np.atleast_2d(X)
    for _ in range(60):
        Y = Y + X - carried(Y, turn)
    return Y


def carry(mesh, turn):
    """Deform the mesh by `carried`: the elements that lay around the old contact then lie around the new one."""
    (k, angle), q = turn, ng.CF((ng.x / AXES[0], ng.y / AXES[1], ng.z / AXES[2]))
    t = ng.IfPos(q[2], ng.IfPos(q[2] - 0.8, 1.0, q[2] / 0.8), 0.0)
    a = t * t * (3 - 2 * t) * angle
    k = ng.CF(tuple(k))
    new = q * ng.cos(a) + ng.Cross(k, q) * ng.sin(a) + ng.InnerProduct(q, k) * (1 - ng.cos(a)) * k
    moved = ng.GridFunction(ng.VectorH1(mesh, order=2))
    moved.Set(ng.CF(tuple((new - q)[i] * AXES[i] for i in range(3))), dual=True)
    mesh.SetDeformation(moved)
    return moved  # the mesh does not keep it alive


def _sizes(centre, h, bottom_h, grading):
    """Meshing parameters: h around the contact, bottom_h (or nothing) around the seat of a bowl."""
    a, b, c = AXES
    par = MeshingParameters(maxh=12, grading=grading)
    for r in np.arange(0, 4.6, 0.5):
        for phi in np.linspace(0, 2 * np.pi, max(1, int(4 * np.pi * r)), endpoint=False):
            x, y = centre[0] + r * np.cos(phi), centre[1] + r * np.sin(phi)
            z = c * np.sqrt(1 - (x / a) ** 2 - (y / b) ** 2)
            for below in (0, 0.5, 1.0):
                par.RestrictH(x, y, z - below, h)
    if bottom_h:
        for r in np.arange(0, 12.1, 2.0):
            for phi in np.linspace(0, 2 * np.pi, max(1, int(np.pi * r)), endpoint=False):
                x, y = 0.7 * centre[0] + r * np.cos(phi), 0.7 * centre[1] + r * np.sin(phi)
                par.RestrictH(x, y, -c * np.sqrt(1 - (x / a) ** 2 - (y / b) ** 2), bottom_h)
    return par
