"""Solutions for a body that lies loosely, against dense ones; what they refuse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from skfem import MeshTet, MeshTet2

from fem_backend.kinematics import tetrahedra
from fem_backend.kinematics.numbering import Pattern
from fem_backend.laws import NeoHooke
from fem_backend.materials import stress
from fem_backend.solver import direct, history_steps, krylov, load_steps, rigid_motions
from fem_backend.solver.direct import NotPositiveDefinite
from fem_backend.solver.load_steps import Control, Stopped
from fem_backend.solver.newton import Counters, NotConverged

BOWL = {"support": {"kind": "bowl", "clearance": 1.0, "friction": 0.0}, "point": [8.0, 4.0]}


@pytest.fixture(params=["superlu", "pardiso"])
def name(request):
    if request.param == "pardiso":
        pytest.importorskip("pypardiso")
    return request.param


@pytest.fixture(scope="module")
def loose():
    """A free cube on springs a billionth as stiff: pattern, data, dense matrix, rigid motions, all (…, f) free."""
    mesh = MeshTet2.from_mesh(MeshTet().refined(2))
    body = tetrahedra.discretise(mesh, np.zeros(mesh.doflocs.T.shape, bool))
    state = stress.evaluate_stress(NeoHooke(1.0, 0.02), np.zeros((*body.w.shape, 3, 3)), tangent=True)
    data, pattern = tetrahedra.stiffness(body, state.F, state.S_geometric, state.C), body.pattern
    data[pattern.diagonal] += 1e-9
    upper = sparse.csr_matrix((data, pattern.indices, pattern.indptr))
    whole = (upper + sparse.triu(upper, 1).T).toarray()
    return pattern, data, whole, rigid_motions.modes(rigid_motions.motion(body), np.zeros(mesh.doflocs.T.shape))


def general(whole: np.ndarray) -> tuple[Pattern, np.ndarray]:
    """Pattern of both triangles and its data, with room for every entry."""
    stored = sparse.csr_matrix(np.abs(whole) + np.abs(whole.T) + np.eye(len(whole)))
    stored.sort_indices()
    pattern = Pattern(stored.indptr.astype(np.int32), stored.indices.astype(np.int32), False)
    rows = np.repeat(np.arange(len(whole)), np.diff(stored.indptr))
    return pattern, whole[rows, stored.indices]


def rubbing(whole: np.ndarray, share: float) -> np.ndarray:
    """The matrix with a skew part at the first hundred dofs, as friction that slips makes one."""
    out, part = whole.copy(), np.triu(whole[:100, :100], 1)
    out[:100, :100] += share * (part - part.T)
    return out


def right(size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=size)


@pytest.mark.parametrize(
    "share,apart",
    [(None, True), (None, False), (0.0, True), (1e-4, True), (0.5, True)],
    ids=["symmetric", "modes unknown", "both triangles", "rubs a little", "rubs"],
)
def test_solution_is_the_dense_one(loose, name, share, apart):
    pattern, data, whole, modes = loose
    if share is not None:
        whole = rubbing(whole, share)
        pattern, data = general(whole)
    b = right(len(whole))
    x = krylov.KrylovSolver(pattern, name).factor(data, modes if apart else None)(b)
    exact = np.linalg.solve(whole, b)
    # the correction is below 1e-7; without the modes apart the factor's shift hides a thousandth of theirs
    assert np.linalg.norm(x - exact) < (1e-5 if apart else 1e-2) * np.linalg.norm(exact)


def test_single_precision_alone_is_lost(loose, name):
    """Negative control: refined factors in single precision do not solve this system."""
    pattern, data, *_ = loose
    mixed = direct.solver(pattern, name).__self__
    mixed.factor(data)(right(pattern.size))
    assert mixed._poor == 1


def counted(monkeypatch):
    made = []
    plain = krylov.raw_factors

    def raw(*given):
        factor, release = plain(*given)

        def count(data):
            solve = factor(data)
            made.append(1)  # those that are refused do not count
            return solve

        return count, release

    monkeypatch.setattr(krylov, "raw_factors", raw)
    return made


def test_a_factor_serves_matrices_nearby_and_is_made_anew_for_others(loose, monkeypatch):
    pattern, data, whole, modes = loose
    made, solver = counted(monkeypatch), krylov.KrylovSolver(pattern, "auto")
    damping, grip = 1e-4 * np.ones(pattern.size), np.zeros(pattern.size)
    grip[::7] = 1e3
    for change, factors in ((0.0 * grip, 1), (damping, 1), (grip, 2)):
        changed, dense = data.copy(), whole + np.diag(change)
        changed[pattern.diagonal] += change
        x = solver.factor(changed, modes)(right(pattern.size))
        exact = np.linalg.solve(dense, right(pattern.size))
        assert np.linalg.norm(x - exact) < 1e-5 * np.linalg.norm(exact)
        assert len(made) == factors


@pytest.mark.parametrize("both", [False, True], ids=["symmetric", "general"])
def test_a_matrix_without_minimum_is_refused(loose, name, both):
    pattern, data, whole, modes = loose
    springs = -2.0 * modes @ (modes.T @ whole @ modes) @ modes.T  # stiffness of the rigid motions turned round
    place = general(whole + springs) if both else None
    if both:
        with pytest.raises(NotPositiveDefinite):
            krylov.KrylovSolver(place[0], name).factor(place[1], modes)
    low = data.copy()
    low[pattern.diagonal] *= 0.5
    made = general(whole - 0.5 * np.diag(np.diag(whole))) if both else (pattern, low)
    with pytest.raises(NotPositiveDefinite):
        krylov.KrylovSolver(made[0], name).factor(made[1])(right(pattern.size))


def test_a_factor_of_before_does_not_hide_that_there_is_no_minimum(loose):
    pattern, data, whole, _ = loose
    solver = krylov.KrylovSolver(pattern, "auto")
    solver.factor(data)(right(pattern.size))
    stiffness, vectors = np.linalg.eigh(whole)
    soft = data.copy()
    soft[pattern.diagonal] -= 2.0 * stiffness[0]  # a few thousand million times less than an element's
    with pytest.raises(NotPositiveDefinite):
        solver.factor(soft)(vectors[:, 0] + 1e-3 * right(pattern.size))


def test_only_what_may_turn_in_its_bowl_rolls(make_bench):
    bowl = {"support": {"kind": "bowl"}}
    for point, table, rolls in (([0, 0], bowl, False), ([8, 0], bowl, True), ([8, 4], bowl, True), ([8, 4], {}, False)):
        b = make_bench({"bowl_friction": 0.0}, point=[float(v) for v in point], **table)
        assert rolls == rigid_motions.rolls(b.system())
        assert isinstance(getattr(b.model.factor, "__self__", None), krylov.KrylovSolver) == rolls


def test_equilibrium_is_that_of_factors_in_double(make_bench):
    """The same rolling with exact solutions, from the same start: one equilibrium."""
    b = make_bench(**{**BOWL, "point": [8.0, 0.0]})
    system, load = b.system(), replace(b.load(0.3), springs=1e3)
    start = np.zeros_like(b.model.body.nodes)
    one = rigid_motions.solve(system, start, load, 1e-10, Counters())

    class Exact:
        def __call__(self, data, modes=None):
            return direct.precise(b.model.body.pattern)(data)

    two = rigid_motions.solve(replace(system, factor=Exact()), start, load, 1e-10, Counters())
    # converged to 1e-10 of the outer forces; the springs are 1e4 times softer than the contact
    np.testing.assert_allclose(one.evaluation.contact.force, two.evaluation.contact.force, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(one.evaluation.u, two.evaluation.u, atol=1e-5)
    np.testing.assert_allclose(one.rate, two.rate, atol=1e-3 * np.abs(two.rate).max())


def test_a_step_between_may_stay_loose_and_says_so(make_bench, monkeypatch):
    """Where a path is not found tightly between asked travels, the state before it counts, 1e-2 of the force off."""
    b = make_bench({"prony_g": 0.2}, **{**BOWL, "point": [8.0, 0.0]})
    control, find = replace(Control(), path=0.1), load_steps.find_equilibrium
    tight = b.solve([0.2], control=control)

    def lazy(system, u, load, tolerance, *more, **given):
        if tolerance == control.between:
            raise NotConverged("contact", "no equilibrium", ())
        return find(system, u, load, tolerance, *more, **given)

    monkeypatch.setattr(load_steps, "find_equilibrium", lazy)
    loose = b.solve([0.2], control=control)
    assert (tight.counters.loose, loose.counters.loose) == (0, 1)
    np.testing.assert_allclose(loose.Fz, tight.Fz, rtol=1e-2)


def test_an_answer_may_stay_loose_says_so_and_states_what_is_left(make_bench, monkeypatch):
    """Where a body turns so easily that no tight equilibrium is found, 1e-2 of the force may be out of balance."""
    b, find = make_bench({"bowl_friction": 0.0}, **{**BOWL, "point": [8.0, 0.0]}), load_steps.find_equilibrium
    tight = b.solve([0.2])

    fails: list[float] = []

    def lazy(system, u, load, tolerance, *more, **given):
        if tolerance < Control().loose and len(fails) < most:
            fails.append(tolerance)
            raise NotConverged("contact", "no equilibrium", ())
        return find(system, u, load, tolerance, *more, **given)

    monkeypatch.setattr(load_steps, "find_equilibrium", lazy)
    for most in (2, 1):  # either stage, or the first alone: what the second starts from
        fails.clear()
        loose = b.solve([0.2], control=replace(Control(), seating=Control().loose))
        assert (tight.counters.loose, loose.counters.loose) == (0, most)
        assert tight.residual[0] < Control().tight < loose.residual[0] < Control().loose
        np.testing.assert_allclose(loose.Fz, tight.Fz, rtol=1e-2)


@pytest.mark.verification
def test_a_body_that_nothing_holds_slips_to_its_wall(make_bench, monkeypatch):
    """Where no rest with everything stuck is found, the path begins where a smooth bowl would let the body lie."""
    b = make_bench({"bowl_friction": 0.2}, **{**BOWL, "point": [8.0, 0.0]})
    held, smooth = b.solve([0.3]), b.other(bowl_friction=0.0).solve([0.3])

    def lost(*given):
        raise Stopped("contact", "while seating", [], (), Counters())

    monkeypatch.setattr(history_steps, "_held", lost)
    slipped = b.solve([0.3])
    assert 0.0 < slipped.Fz[0] < held.Fz[0]  # it gives way first
    assert abs(slipped.Fz[0] - smooth.Fz[0]) < abs(held.Fz[0] - smooth.Fz[0])


def test_points_hold_no_matrices(make_bench):
    """A matrix is tens of megabytes on a whole model."""
    b = make_bench({"prony_g": 0.2}, **{**BOWL, "point": [8.0, 0.0]})
    for point in b.solve([0.1, 0.2]).points:
        for stage in point.stages:
            assert stage.equilibrium.linear is None and stage.equilibrium.known is None
        assert not point.stages[0].equilibrium.evaluation.H.size and point.evaluation.H.size
