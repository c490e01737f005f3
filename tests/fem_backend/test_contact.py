"""Contact, friction and adhesion of a surface with a rigid body, on a block small enough to know everything about."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import integrate, optimize, sparse
from skfem import MeshTet, MeshTet2

from fem_backend.contact import tractions
from fem_backend.contact.pointwise import LAG_SHARE, TANGENTIAL_PENALTY_RATIO
from fem_backend.contact.tractions import Adhesion, Before, ContactState, Pair, Touch
from fem_backend.geometry import EllipsoidShape
from fem_backend.indenters.sphere import Sphere
from fem_backend.kinematics import tetrahedra
from fem_backend.laws import NeoHooke
from fem_backend.solver import direct, newton
from fem_backend.supports.bowl import Bowl

STEPS = np.array([1.0, 0.5, 0.25, 0.125])
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class WrongWay(Sphere):
    """Negative control: the normal points into the indenter."""

    def gap(self, x, centre, direction=(0.0, 0.0, 0.0)):
        g, n, hessian = super().gap(x, centre, direction)
        return g, -n, hessian


@dataclass(frozen=True)
class Case:
    """A pair, its load, positions x (n, 3), and a body with the full matrix pattern."""

    body: tetrahedra.Body
    pair: Pair
    touch: Touch
    x: np.ndarray

    def evaluate(self, x: np.ndarray | None = None, **load: object) -> ContactState:
        return tractions.evaluate_contact(self.pair, self.x if x is None else x, replace(self.touch, **load))

    def matrix(self, geometric: bool = True) -> tuple[sparse.csr_matrix, np.ndarray]:
        """∂R/∂x over all dofs in the order of `free`, and ∂R/∂s."""
        pattern = self.body.pattern
        data = np.zeros(len(pattern.indices))
        moving = tractions.add_contact_tangent(self.pair, self.x, self.touch, self.evaluate(), data, geometric)
        return sparse.csr_matrix((data, pattern.indices, pattern.indptr), shape=(pattern.size,) * 2), moving


def block(
    cells: int = 4, half: float = 2.0, shape: Callable[[np.ndarray], np.ndarray] | None = None
) -> tuple[tetrahedra.Body, MeshTet2]:
    """A plate 1 mm thick with a free surface at z = 0, or at z = shape(x, y); full matrix pattern, nothing held."""
    line = np.linspace(-half, half, cells + 1)
    quadratic = MeshTet2.from_mesh(MeshTet.init_tensor(line, line, np.array([-1.0, 0.0])))
    X = quadratic.doflocs.copy()
    if shape is not None:
        X[2] += (1.0 + X[2]) * shape(X)
    quadratic = MeshTet2(X, quadratic.t)
    return tetrahedra.discretise(quadratic, np.zeros((X.shape[1], 3), bool), symmetric=False), quadratic


def top(body: tetrahedra.Body, quadratic: MeshTet2, surface_z: Callable[[np.ndarray], np.ndarray] | None = None):
    facets = tractions.quadratic_facets(quadratic, quadratic.boundary_facets())
    z = 0.0 if surface_z is None else surface_z(body.nodes.T)[facets]
    return tractions.contact_surface(body, facets[np.all(np.abs(body.nodes[facets, 2] - z) < 1e-9, axis=1)])


def wave(X: np.ndarray) -> np.ndarray:
    """A rough displacement (mm)."""
    return 0.03 * np.sin(2.0 * X[:, [1, 2, 0]] + 0.3) + 0.02 * np.cos(3.0 * X)


def pressed(
    friction: float = 0.0,
    adhesion: Adhesion | None = None,
    rigid: Sphere | Bowl | None = None,
    depth: float = 0.4,
    met: bool = False,
) -> Case:
    """A random state off equilibrium, with multipliers and a step behind it, whose open points were `met` in it."""
    rng = np.random.default_rng(1)
    rigid = Sphere(3.0) if rigid is None else rigid
    bowl = isinstance(rigid, Bowl)
    direction = np.zeros(3) if bowl else np.array([0.3, -0.2, -0.9]) / np.linalg.norm([0.3, -0.2, -0.9])
    centre = np.array(rigid.centre) if bowl else np.array([0.1, -0.2, rigid.R - depth])
    body, quadratic = block()
    surface = top(body, quadratic)
    x = body.nodes + wave(body.nodes)
    shape = surface.weights.shape
    epsilon = rng.uniform(2.0, 4.0, shape)
    start = tractions.contact_points(surface, body.nodes + 0.8 * wave(body.nodes))
    before = Before(
        start + 0.02 * rng.normal(size=start.shape),
        centre - 0.05 * direction,
        0.05 * rng.normal(size=start.shape),
        0.02 * rng.normal(size=shape),  # half of the points were open
    )
    if met:
        before = replace(before, met=rng.uniform(0.0, 1.0, size=shape))
    touch = Touch(centre, direction, 0.1 * epsilon * rng.uniform(0, 1, shape), rng.uniform(1, 2, shape), before)
    return Case(body, Pair(surface, rigid, epsilon, friction, adhesion), touch, x)


STICKY = Adhesion(work=0.05, range=0.1)
INSIDE = Bowl((4.0, 5.0, 3.0), (0.1, -0.2, -2.8), rim_z=5.0)  # its ceiling cuts through the block
CASES = {
    "normal": lambda: pressed(),
    "stick": lambda: pressed(friction=1e3),
    "slip": lambda: pressed(friction=0.02),
    "mixed": lambda: pressed(friction=0.3),
    "met": lambda: pressed(friction=0.3, met=True),
    "met, stick": lambda: pressed(friction=1e3, met=True),
    "adhesion": lambda: pressed(adhesion=STICKY),
    "everything": lambda: pressed(friction=0.3, adhesion=STICKY),
    "shaft": lambda: pressed(friction=0.3, rigid=Sphere(0.6, shaft=True), depth=0.65),
    "bowl": lambda: pressed(friction=0.3, rigid=INSIDE),
    "lip": lambda: pressed(friction=0.3, adhesion=STICKY, rigid=replace(INSIDE, rim_z=0.0)),
}
SYMMETRIC = ("normal", "adhesion")


def kind(case: Case, x: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Which branch every point is in: contact, slip, side of the joint or rim, side of g = 0."""
    at = case.evaluate(x, centre=centre)
    points = tractions.contact_points(case.pair.surface, x)
    side = (points - centre) @ case.touch.direction > 0
    rim = points[..., 2] > getattr(case.pair.rigid, "rim_z", 0.0)
    return np.stack([at.pressure > 0, at.slipping, side, rim, at.gap > 0])


def smooth_way(case: Case, move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A direction (n, 3) of the body and (3,) of the rigid body so short that no point changes its branch on it."""
    v = np.random.default_rng(2).normal(size=case.x.shape) * (1.0 - move.any())
    here, scale = kind(case, case.x, case.touch.centre), 1e-2
    while not all(
        np.array_equal(kind(case, case.x + t * scale * v, case.touch.centre + t * scale * move), here) for t in STEPS
    ):
        scale *= 0.7
    assert scale > 1e-7  # below, round-off would show
    return scale * v, scale * move


def flat(case: Case, r: np.ndarray) -> np.ndarray:
    """Nodal vectors (n, 3) in the order of the free dofs."""
    out = np.empty(case.body.pattern.size)
    out[case.body.free] = r.ravel()
    return out


# ---------------------------------------------------------------------------------------------- derivatives


@pytest.mark.parametrize("name", CASES)
def test_the_cases_hold_what_they_promise(name):
    """The suite itself: points in contact and open ones, sticking and slipping ones, both sides of joint and rim."""
    case = CASES[name]()
    at = case.evaluate()
    closed = at.pressure > 0
    assert 10 < closed.sum() < closed.size - 10
    slipping = at.slipping[closed].mean()
    if case.pair.friction:
        right = {"stick": slipping == 0, "met, stick": slipping == 0, "slip": slipping > 0.9}
        assert right.get(name, 0.05 < slipping < 0.95), slipping
    if name in ("shaft", "lip"):
        side = kind(case, case.x, case.touch.centre)[2 if name == "shaft" else 3][closed]
        assert 3 < side.sum() < len(side) - 3


@pytest.mark.parametrize("name", [*SYMMETRIC, "frictionless bowl", "wrong way"])
def test_residual_is_the_derivative_of_the_energy(name, slopes):
    """Slope 2 of |Π(x + t v) − Π − t R·v|; with the normal reversed O(t) stays."""
    rigid = {"frictionless bowl": replace(INSIDE, rim_z=0.0), "wrong way": WrongWay(3.0)}.get(name)
    case = CASES[name]() if rigid is None else pressed(rigid=rigid, adhesion=STICKY)
    v, _ = smooth_way(case, np.zeros(3))
    at = case.evaluate()
    first = float((at.residual * v).sum())
    error = np.array([abs(case.evaluate(case.x + t * v).energy - at.energy - t * first) for t in STEPS])
    if name == "wrong way":
        assert np.all(slopes(error, STEPS) < 1.5)
    else:
        np.testing.assert_allclose(slopes(error, STEPS), 2.0, atol=0.1)


@pytest.mark.parametrize("name", CASES)
def test_tangent_is_the_derivative_of_the_residual(name, slopes):
    """Slope 2 of |R(x + t v) − R − t K v|; without the curvature terms, the fallback of Newton, O(t) stays."""
    case = CASES[name]()
    v, _ = smooth_way(case, np.zeros(3))
    at = case.evaluate()
    difference = [flat(case, case.evaluate(case.x + t * v).residual - at.residual) for t in STEPS]
    for geometric in (True, False):
        Kv = case.matrix(geometric)[0] @ flat(case, v)
        error = np.array([np.linalg.norm(d - t * Kv) for d, t in zip(difference, STEPS, strict=True)])
        if geometric:
            np.testing.assert_allclose(slopes(error, STEPS), 2.0, atol=0.1)
        else:
            assert np.all(slopes(error, STEPS) < 1.5)


@pytest.mark.parametrize("name", [n for n in CASES if n not in ("bowl", "lip")])
def test_moving_the_rigid_body_changes_the_residual_as_predicted(name, slopes):
    """∂R/∂s for c + s·direction, the right-hand side of the predictor."""
    case = CASES[name]()
    _, move = smooth_way(case, case.touch.direction)
    at, rate = case.evaluate(), case.matrix()[1] * np.linalg.norm(move)
    error = np.array(
        [
            np.linalg.norm(case.evaluate(centre=case.touch.centre + t * move).residual - at.residual - t * rate)
            for t in STEPS
        ]
    )
    np.testing.assert_allclose(slopes(error, STEPS), 2.0, atol=0.1)


@pytest.mark.parametrize("name", ["bowl", "lip"])
def test_bowl_stands_still(name):
    case = CASES[name]()
    assert not case.matrix()[1].any()
    moved = case.evaluate(
        centre=case.touch.centre + 1.0, before=replace(case.touch.before, centre=case.touch.before.centre + 1.0)
    )
    np.testing.assert_array_equal(moved.gap, case.evaluate().gap)


def test_matrix_is_symmetric_where_there_is_a_potential():
    """Frictionless exactly; sticking but for the turning of the normal; slipping not at all."""
    skew = {}
    for name in ("normal", "adhesion", "stick", "slip"):
        for geometric in (True, False):
            K = CASES[name]().matrix(geometric)[0]
            skew[name, geometric] = abs(K - K.T).max() / abs(K).max()
    for name in SYMMETRIC:
        assert skew[name, True] < 1e-14 and skew[name, False] < 1e-14
    assert skew["stick", False] < 1e-14 < skew["stick", True] < 0.05
    assert skew["slip", False] > 1e-3


@pytest.mark.parametrize("name", ["normal", "adhesion", "stick"])
def test_without_the_curvature_terms_the_matrix_is_positive_semi_definite(name):
    K = CASES[name]().matrix(False)[0].toarray()
    assert np.linalg.eigvalsh(0.5 * (K + K.T)).min() > -1e-12 * np.abs(K).max()
    if name == "adhesion":  # negative control: the falling attraction is what would spoil it
        full = CASES[name]().matrix(True)[0].toarray()
        assert np.linalg.eigvalsh(full).min() < -1e-3 * np.abs(full).max()


def test_upper_pattern_gets_the_upper_triangle():
    """The same numbers in the matrix of a symmetric solver: places below the diagonal are skipped."""
    case = CASES["normal"]()
    full = case.matrix()[0]
    free = case.body.free
    upper = sparse.triu(full, format="csr")
    upper.sort_indices()
    pattern = tetrahedra.Pattern(upper.indptr.astype(np.int32), upper.indices.astype(np.int32))
    facets = case.pair.surface.facets
    place = pattern.find(free[(3 * facets[:, :, None] + np.arange(3)).reshape(len(facets), 18)])
    pair = replace(case.pair, surface=replace(case.pair.surface, place=place))
    data = np.zeros(len(pattern.indices))
    tractions.add_contact_tangent(pair, case.x, case.touch, case.evaluate(), data)
    np.testing.assert_array_equal(data, upper.data)


# ---------------------------------------------------------------------------------------------- balance, invariance


@pytest.mark.parametrize("name", CASES)
def test_forces_are_in_balance(name):
    """What the body gets (−R) the rigid body gives."""
    case = CASES[name]()
    at = case.evaluate()
    np.testing.assert_allclose(at.residual.sum(0), at.force, atol=1e-13 * np.abs(at.residual).sum())
    if name == "normal":
        moment = np.cross(case.x - case.touch.centre, at.residual).sum(0)
        # nodes are not the contact points, but shape functions hold linear fields: Σ x_a N_a is the point
        np.testing.assert_allclose(moment, 0.0, atol=1e-12 * np.abs(at.residual).sum())
        assert at.force[2] > 0  # the body pushes the indenter up
        assert pressed(rigid=WrongWay(3.0)).evaluate().force[2] < 0  # negative control


def moved(case: Case, Q: np.ndarray, shift: np.ndarray) -> Case:
    """The same case turned by Q (a bowl cannot) and shifted."""
    b, rigid = case.touch.before, case.pair.rigid
    if isinstance(rigid, Bowl):
        rigid = replace(rigid, centre=tuple(np.array(rigid.centre) + shift), rim_z=rigid.rim_z + shift[2])
    before = Before(b.points @ Q.T + shift, Q @ b.centre + shift, b.traction @ Q.T, b.gap, met=b.met)
    touch = replace(case.touch, centre=Q @ case.touch.centre + shift, direction=Q @ case.touch.direction, before=before)
    return Case(case.body, replace(case.pair, rigid=rigid), touch, case.x @ Q.T + shift)


@pytest.mark.parametrize("name", CASES)
def test_result_moves_with_the_frame(name):
    """Rigid motion of everything, past tractions too; 1e-10 is round-off of the gap at a shift of some mm."""
    case = CASES[name]()
    Q = (
        np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
        if isinstance(case.pair.rigid, Sphere)
        else np.eye(3)
    )
    Q *= np.linalg.det(Q)
    a, b = case.evaluate(), moved(case, Q, np.array([3.0, -2.0, 1.5])).evaluate()
    np.testing.assert_allclose(b.energy, a.energy, rtol=1e-10)
    np.testing.assert_array_equal(b.slipping, a.slipping)
    np.testing.assert_allclose(b.residual, a.residual @ Q.T, atol=1e-11)
    np.testing.assert_allclose(b.force, Q @ a.force, atol=1e-10)


@pytest.mark.parametrize("name", CASES)
def test_every_point_by_its_definition(name):
    """p, t, σ and the force of some points from the formulas, one by one, with numpy alone."""
    case = CASES[name]()
    at, s, touch, b = case.evaluate(), case.pair.surface, case.touch, case.touch.before
    force = np.zeros(3)
    for f in range(len(s.facets)):
        for q in range(s.N.shape[0]):
            point = sum(s.N[q, a] * case.x[s.facets[f, a]] for a in range(6))
            gap, normal, _ = (v[0] for v in case.pair.rigid.gap(point[None], touch.centre, touch.direction))
            epsilon = case.pair.epsilon[f, q] * touch.raised[f, q]
            p = max(touch.multiplier[f, q] - epsilon * gap, 0.0)
            unit = normal / np.linalg.norm(normal)
            slip = (point - b.points[f, q]) - (touch.centre - b.centre)
            counted = 1.0 if b.gap[f, q] <= 0 else max(-gap, 0.0) / (b.gap[f, q] - gap) if gap < 0 else 0.0
            if b.met is not None and b.gap[f, q] > 0:
                counted = b.met[f, q]
                slip = slip + LAG_SHARE * (1.0 - counted) * (touch.centre - b.centre)
            t = (np.eye(3) - np.outer(unit, unit)) @ (
                b.traction[f, q] - TANGENTIAL_PENALTY_RATIO * epsilon * counted * slip
            )
            t *= 0.0 if p == 0 or not case.pair.friction else min(1.0, case.pair.friction * p / np.linalg.norm(t))
            W, l = (STICKY.work, STICKY.range) if case.pair.adhesion else (0.0, 1.0)
            pull = W / l * (np.exp(-gap / l) if gap > 0 else 2.0 - np.exp(gap / l))
            force -= s.weights[f, q] * ((p - pull) * normal + t)
            np.testing.assert_allclose(at.gap[f, q], gap, atol=1e-13)
            np.testing.assert_allclose(at.pressure[f, q], p, atol=1e-12)
            np.testing.assert_allclose(at.traction[f, q], t, atol=1e-12)
            np.testing.assert_allclose(at.attraction[f, q], pull, atol=1e-12)
    np.testing.assert_allclose(at.force, force, atol=1e-12)


# ---------------------------------------------------------------------------------------------- friction


def test_no_friction_is_the_frictionless_problem_to_the_bit():
    """μ_f = 0 with a past, and the limit μ_f → 0 as it should be, linear."""
    plain, none = CASES["normal"](), pressed(friction=0.0)
    without = replace(plain, touch=replace(plain.touch, before=None))
    for other in (none, without):
        a, b = plain.evaluate(), other.evaluate()
        assert a.residual.tobytes() == b.residual.tobytes() and a.energy == b.energy
        assert not b.traction.any() and not b.slipping.any()
        assert plain.matrix()[0].data.tobytes() == other.matrix()[0].data.tobytes()
    change = [np.abs(pressed(friction=m).evaluate().residual - a.residual).max() for m in (1e-4, 1e-5)]
    np.testing.assert_allclose(change[0] / change[1], 10.0, rtol=1e-6)


def test_large_friction_sticks():
    """No point slips and t = P(t₀ − ε_T × displacement relative to the rigid body)."""
    case = pressed(friction=1e3)
    at, b = case.evaluate(), case.touch.before
    closed = at.pressure > 0
    points = tractions.contact_points(case.pair.surface, case.x)
    n = (points - case.touch.centre) / np.linalg.norm(points - case.touch.centre, axis=-1)[..., None]
    slip = points - b.points - (case.touch.centre - b.centre)
    slip *= np.where(b.gap <= 0, 1.0, np.where(at.gap < 0, at.gap / (at.gap - b.gap), 0.0))[..., None]
    t = b.traction - (TANGENTIAL_PENALTY_RATIO * case.pair.epsilon * case.touch.raised)[..., None] * slip
    t -= (t * n).sum(-1, keepdims=True) * n
    assert not at.slipping.any()
    np.testing.assert_allclose(at.traction[closed], t[closed], atol=1e-13)
    assert not at.traction[~closed].any()


@pytest.mark.parametrize("friction", [0.02, 0.3, 1.0])
def test_coulomb_limit_and_dissipation(friction):
    """|t| ≤ μ_f p, equal where slipping; the slip t·(t_trial − t)/ε_T dissipates; t opposes the motion."""
    stick, case = pressed(friction=1e3).evaluate(), pressed(friction=friction)
    at = case.evaluate()
    size = np.linalg.norm(at.traction, axis=-1)
    assert np.all(size <= friction * at.pressure * (1 + 1e-14))
    np.testing.assert_allclose(size[at.slipping], friction * at.pressure[at.slipping], rtol=1e-13)
    work = (at.traction * (stick.traction - at.traction)).sum(-1)
    assert work.min() >= -1e-16 and np.all(work[at.slipping] > 0)  # t is along the trial of full sticking


def test_friction_needs_a_past():
    case = pressed(friction=0.3)
    with pytest.raises(ValueError, match="before"):
        case.evaluate(before=None)


def sliding(amplitude: float, friction: float, count: int = 400) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Two cycles ±amplitude of a ball as good as flat on a plate held still: ways s, forces along it, Σ w p, p/ε."""
    body, quadratic = block(2)
    surface = top(body, quadratic)
    R, depth, epsilon = 1e6, 0.01, 3.0
    pair = Pair(surface, Sphere(R), np.full(surface.weights.shape, epsilon), friction)
    s = amplitude * np.sin(np.linspace(0, 4 * np.pi, 2 * count + 1))
    along = np.array([0.6, -0.8, 0.0])
    nothing = np.zeros(surface.weights.shape)
    centre = np.array([0.0, 0.0, R - depth])
    before = Before(tractions.contact_points(surface, body.nodes), centre, np.zeros((*nothing.shape, 3)), nothing)
    force = []
    for way in s:
        touch = Touch(centre + way * along, DOWN, nothing, before=before)
        at = tractions.evaluate_contact(pair, body.nodes, touch)
        before = tractions.contact_history(pair, body.nodes, touch, at)
        force.append(at.force @ along)
    return s, np.array(force), float((surface.weights * at.pressure).sum()), depth


def test_ball_on_a_still_plate_makes_the_loop_of_coulomb():
    """Area of the second loop = 4 μ_f N (A − μ_f p/ε_T), elastic-slip closed form; 1e-3 is that of 400 steps."""
    amplitude, friction = 0.02, 0.3
    s, force, N, depth = sliding(amplitude, friction)
    np.testing.assert_allclose(np.abs(force).max(), friction * N, rtol=1e-6)
    assert force[1] < 0 < s[1]  # friction holds the ball back
    loop = -np.trapezoid(force[400:], s[400:])
    give = friction * depth / TANGENTIAL_PENALTY_RATIO
    np.testing.assert_allclose(loop, 4 * friction * N * (amplitude - give), rtol=1e-3)
    assert 0.1 * amplitude < give < 0.9 * amplitude
    # sticking throughout: a spring ε_T times the area, no loop
    s, force, *_ = sliding(amplitude, 10.0)
    np.testing.assert_allclose(force, -TANGENTIAL_PENALTY_RATIO * 3.0 * 16.0 * s, atol=1e-9)  # ε = 3 MPa/mm on 16 mm²


def test_what_is_remembered_is_the_end_of_the_step():
    case = pressed(friction=0.3)
    at = case.evaluate()
    b = tractions.contact_history(case.pair, case.x, case.touch, at)
    np.testing.assert_array_equal(
        b.points, np.einsum("qa,fai->fqi", case.pair.surface.N, case.x[case.pair.surface.facets])
    )
    np.testing.assert_array_equal(b.centre, case.touch.centre)
    # standing still from there on keeps the traction
    again = case.evaluate(before=b)
    np.testing.assert_allclose(again.traction, at.traction, atol=1e-14)


# ---------------------------------------------------------------------------------------------- adhesion


def pulled(height: float, adhesion: Adhesion | None, R: float = 1e7, cells: int = 2) -> ContactState:
    """A ball over a flat plate, its lowest point at z = height."""
    body, quadratic = block(cells)
    surface = top(body, quadratic)
    nothing = np.zeros(surface.weights.shape)
    pair = Pair(surface, Sphere(R), nothing + 3.0, 0.0, adhesion)
    return tractions.evaluate_contact(pair, body.nodes, Touch(np.array([0.0, 0.0, R + height]), DOWN, nothing))


def test_work_of_separation():
    """∫ σ dg = W from touching to far away, which is also what the energy changes per area."""
    a = Adhesion(work=0.02, range=0.15)
    work = integrate.quad(lambda g: pulled(g, a).attraction[0, 0], 0.0, 50 * a.range, epsabs=1e-12)[0]
    np.testing.assert_allclose(work, a.work, rtol=1e-6)  # the ball is flat to 4/R
    area = 16.0
    np.testing.assert_allclose(pulled(0.0, a).energy, -a.work * area, rtol=1e-6)
    assert pulled(41 * a.range, a).energy == 0.0


def test_attraction_is_bounded_and_c1():
    """σ(0) = W/ℓ, twice that at most; slope −W/ℓ² on both sides of g = 0."""
    a, h = Adhesion(work=0.02, range=0.15), 1e-5
    pull = {g: pulled(g, a).attraction.mean() for g in (-100.0, -h, 0.0, h)}
    np.testing.assert_allclose([pull[0.0], pull[-100.0]], [a.work / a.range, 2 * a.work / a.range], rtol=1e-5)
    slopes = np.array([pull[0.0] - pull[-h], pull[h] - pull[0.0]]) / h
    np.testing.assert_allclose(slopes, -a.work / a.range**2, rtol=1e-3)


def test_force_of_a_ball_over_a_plate():
    """The same integral over the radius by scipy, and the limit 2π R W of a short range (Bradley 1932)."""
    a, R, height = Adhesion(work=0.02, range=0.02), 1.0, 0.02
    force = pulled(height, a, R, cells=16).force[2]

    def ring(r: float) -> float:
        far = np.hypot(r, R + height)
        return 2 * np.pi * r * a.work / a.range * np.exp(-(far - R) / a.range) * (R + height) / far

    np.testing.assert_allclose(force, -integrate.quad(ring, 0, 2)[0], rtol=2e-3)  # facets of 0.25 mm
    np.testing.assert_allclose(force, -2 * np.pi * R * a.work * np.exp(-1), rtol=0.05)  # ℓ/R = 0.02


def test_no_work_is_no_adhesion():
    plain, none = CASES["normal"]().evaluate(), pressed(adhesion=Adhesion(0.0, 0.1)).evaluate()
    assert plain.residual.tobytes() == none.residual.tobytes() and plain.energy == none.energy
    assert not none.attraction.any()
    assert np.abs(CASES["adhesion"]().evaluate().residual - plain.residual).max() > 1e-3  # negative control


# ---------------------------------------------------------------------------------------------- surface


def test_surface_area_is_that_of_the_sphere():
    """A plate bent to a cap of a sphere: weights add up to the area over the square, by scipy."""
    R, half = 10.0, 2.0

    def cap(X):
        return np.sqrt(R**2 - X[0] ** 2 - X[1] ** 2) - R

    body, quadratic = block(6, half, cap)
    weights = top(body, quadratic, cap).weights
    area = integrate.dblquad(lambda y, x: R / np.sqrt(R**2 - x**2 - y**2), -half, half, -half, half)[0]
    np.testing.assert_allclose(weights.sum(), area, rtol=1e-6)
    assert weights.min() > 0


def travel_oracle(surface, x, R: float, centre: np.ndarray, d: np.ndarray) -> float:
    """Least way to any point of the quadratic facets, by scipy on each of them."""

    def position(z: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        r, s = z
        L = np.array([1 - r - s, r, s])
        N = [*(L * (2 * L - 1)), 4 * L[0] * L[1], 4 * L[1] * L[2], 4 * L[0] * L[2]]
        return np.array(N) @ nodes

    def way(z: np.ndarray, nodes: np.ndarray) -> float:
        v = position(z, nodes) - centre
        root = R**2 - v @ v + (v @ d) ** 2
        return v @ d - np.sqrt(root) if root > 0 else 10.0 - root

    least = np.inf
    constraint = {"type": "ineq", "fun": lambda z: 1 - z.sum()}
    for facet in surface.facets:
        for start in ([0.3, 0.3], [0.1, 0.1], [0.8, 0.1], [0.1, 0.8]):
            found = optimize.minimize(
                way,
                start,
                (x[facet],),
                method="SLSQP",
                bounds=[(0, 1)] * 2,
                constraints=constraint,
                options={"ftol": 1e-14},
            )
            least = min(least, found.fun)
    return least


@pytest.mark.parametrize("seed", range(3))
def test_first_touch_is_that_of_all_points_of_the_deformed_surface(seed):
    """Also from inside (the way is negative then) and when the ball comes from the side."""
    rng = np.random.default_rng(seed)
    body, quadratic = block(3)
    surface = top(body, quadratic)
    x = body.nodes + wave(body.nodes) + 0.02 * rng.normal(size=body.nodes.shape)
    d = np.array([*rng.uniform(-0.4, 0.4, 2), -1.0])
    d /= np.linalg.norm(d)
    centre = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(0.5, 2.5)])
    found = tractions.first_touch(surface, x, Sphere(1.0), centre, d)
    np.testing.assert_allclose(found, travel_oracle(surface, x, 1.0, centre, d), atol=1e-9)
    gap = Sphere(1.0).gap(tractions.contact_points(surface, x), centre + found * d, d)[0]
    assert 0 <= gap.min() < 0.05  # quadrature points stay outside, but not by much


def test_first_touch_of_known_surfaces():
    body, quadratic = block()
    surface = top(body, quadratic)
    for shaft in (False, True):
        found = tractions.first_touch(surface, body.nodes, Sphere(1.0, shaft), np.array([0.37, 0.21, 3.0]), DOWN)
        np.testing.assert_allclose(found, 2.0, rtol=1e-14)
    assert tractions.first_touch(surface, body.nodes, Sphere(1.0), np.array([5.0, 0.0, 3.0]), DOWN) == np.inf
    ball = EllipsoidShape(10.0, 8.0, 7.0)

    def cap(X):
        return 7.0 * np.sqrt(1 - (X[0] / 10) ** 2 - (X[1] / 8) ** 2) - 7.0

    body, quadratic = block(6, 2.0, cap)
    surface = top(body, quadratic, cap)
    x = body.nodes + np.array([0, 0, 7.0])
    d = np.array([0.1, -0.2, -1.0]) / np.linalg.norm([0.1, -0.2, -1.0])
    centre = Sphere(2.0).first_contact(ball, [0.5, 0.3, 8.0], d)
    # quadratic facets of 0.67 mm follow the ellipsoid to some 1e-5
    np.testing.assert_allclose(tractions.first_touch(surface, x, Sphere(2.0), centre - 1.5 * d, d), 1.5, atol=1e-4)
    # a bowl going up meets the lowest point of a plate turned over
    bowl = Bowl((10.0, 10.0, 10.0), (0.0, 0.0, 5.0), rim_z=5.0)
    x = body.nodes * [1, 1, -1]
    up = tractions.first_touch(surface, x, bowl, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    points = tractions.contact_points(surface, x)
    below = 5.0 - np.sqrt(100.0 - points[..., 0] ** 2 - points[..., 1] ** 2)
    np.testing.assert_allclose(up, (points[..., 2] - below).min(), atol=5e-3)


def test_first_touch_follows_the_deformation_smoothly():
    """Second differences of the way along a smooth deformation are O(h²), not those of a grid."""
    body, quadratic = block()
    surface = top(body, quadratic)
    bump = np.exp(-((body.nodes[:, :2] - [0.2, 0.3]) ** 2).sum(1))[:, None] * [0.05, 0.03, 1.0]

    def way(t: float) -> float:
        x = body.nodes + t * bump
        return tractions.first_touch(surface, x, Sphere(1.0), np.array([0.25, 0.32, 2.0]), DOWN)

    h = 1e-5
    second = np.diff([way(0.3 + k * h) for k in range(12)], 2)
    assert np.abs(second).max() < 20 * h**2, second
    t = np.array([0.3, 0.301])
    assert abs((way(t[1]) - way(t[0])) / 1e-3 + 1.0) < 0.1  # the bump goes up nearly as much


# ---------------------------------------------------------------------------------------------- equilibrium


def indented(rigid: Sphere, friction: float = 0.0, augmentations: int = 0) -> tuple[Pair, newton.Evaluation]:
    """A plate on a rigid floor under a ball pressed in by 0.2 mm, multipliers λ ← p so many times."""
    body, quadratic = block(4)
    held = np.zeros(body.nodes.shape, bool)
    held[body.nodes[:, 2] < -1.0 + 1e-9] = True
    body = tetrahedra.discretise(quadratic, held, symmetric=False)
    surface = top(body, quadratic)
    nothing = np.zeros(surface.weights.shape)
    pair = Pair(surface, rigid, nothing + 2.0, friction)
    system = newton.System(body, NeoHooke(0.01, 5.8), pair, (), direct.solver(body.pattern, "superlu"))
    centre = np.array([0.1, 0.05, rigid.R])
    before = Before(tractions.contact_points(surface, body.nodes), centre, np.zeros((*nothing.shape, 3)), nothing)
    touch = Touch(centre + 0.2 * DOWN, DOWN, nothing, before=before)
    counters = newton.Counters()
    u = np.zeros_like(body.nodes)
    for _ in range(augmentations + 1):
        at = newton.solve(system, u, newton.Load(touch), 1e-8, counters).evaluation
        u, touch = at.u, replace(touch, multiplier=at.contact.pressure)
    return pair, at


def test_augmentation_makes_contact_complementary():
    """p ≥ 0, g → 0 where p > 0 and p·g → 0: every augmentation takes most of the rest away."""
    penetration, work = [], []
    for k in (0, 1, 3):
        pair, evaluation = indented(Sphere(1.5), augmentations=k)
        at, w = evaluation.contact, pair.surface.weights
        assert at.pressure.min() >= 0.0 and at.force[2] > 0
        assert np.all(at.gap[at.pressure == 0] > -1e-9)  # open points do not penetrate
        penetration.append(max(-at.gap.min(), 0.0))
        work.append(abs(float((w * at.pressure * at.gap).sum())) / float((w * at.pressure).sum()))
    assert penetration[0] < 0.05 and penetration[2] < 0.3 * penetration[0], penetration  # mm of 0.2 mm travel
    assert work[1] < 0.5 * work[0] and work[2] < 0.2 * work[0], work


def test_body_does_not_resist_an_indenter_with_the_normal_reversed():
    """Negative control of the whole chain: equilibrium under the reversed indenter is missing or pulls it in."""
    try:
        force = indented(WrongWay(1.5))[1].contact.force[2]
    except newton.NotConverged:
        return
    assert not force > 0


def test_friction_holds_the_surface_back():
    """A sticking surface follows the ball, a slippery one slides along it: more force, less sliding."""
    force, sliding = [], []
    for friction in (0.0, 0.3, 10.0):
        pair, at = indented(Sphere(1.5), friction)
        points = tractions.contact_points(pair.surface, at.u)
        across = np.linalg.norm(points[..., :2], axis=-1)
        force.append(at.contact.force[2])
        sliding.append(float((across * (at.contact.pressure > 0)).max()))
        assert at.residual[at.contact.residual.any(1)].max() < 1e-6  # in equilibrium where it is touched
    assert force[0] < force[1] <= force[2] and sliding[2] < sliding[0], (force, sliding)
