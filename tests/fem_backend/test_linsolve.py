import numpy as np
import pytest
from scipy import sparse

from fem_backend.kinematics import tetrahedra
from fem_backend.laws import NeoHooke
from fem_backend.materials import stress
from fem_backend.solver import direct
from fem_backend.solver.direct import NotPositiveDefinite, solver


@pytest.fixture(params=["superlu", "pardiso"])
def name(request):
    if request.param == "pardiso":
        pytest.importorskip("pypardiso")
    return request.param


def stiffness(body: tetrahedra.Body) -> np.ndarray:
    state = stress.evaluate_stress(NeoHooke(0.01, 5.8), np.zeros((*body.w.shape, 3, 3)), tangent=True)
    return tetrahedra.stiffness(body, state.F, state.S_geometric, state.C)


def pattern_of(upper: np.ndarray) -> tuple[tetrahedra.Pattern, np.ndarray]:
    """Pattern with every entry of a dense upper triangle, also where it is zero, and its data."""
    n = len(upper)
    rows, cols = np.triu_indices(n)
    indptr = np.concatenate([[0], np.cumsum(np.arange(n, 0, -1))]).astype(np.int32)
    return tetrahedra.Pattern(indptr, cols.astype(np.int32)), upper[rows, cols].astype(float)


def test_solution_is_that_of_the_whole_matrix(small, name):
    body = small.model.body
    data, b = stiffness(body), np.random.default_rng(0).normal(size=body.pattern.size)
    x = solver(body.pattern, name)(data)(b)
    upper = sparse.csr_matrix((data, body.pattern.indices, body.pattern.indptr), shape=(len(b), len(b)))
    A = (upper + sparse.triu(upper, 1).T).toarray()
    np.testing.assert_allclose(A @ x, b, atol=1e-10 * np.abs(b).max())  # condition of 1e4 to 1e5 times round-off
    np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=1e-8, atol=1e-10 * np.abs(x).max())


def test_factors_can_be_made_again(small, name):
    """One analysis, many matrices of the same pattern; the solution scales as the matrix does."""
    body = small.model.body
    factor, data = solver(body.pattern, name), stiffness(body)
    b = np.random.default_rng(0).normal(size=body.pattern.size)
    first = factor(data)(b).copy()
    np.testing.assert_allclose(factor(4.0 * data)(b), first / 4.0, rtol=1e-9, atol=1e-12 * np.abs(first).max())
    np.testing.assert_array_equal(factor(data)(b), first)  # no trace of what was before


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1.0, 2.0, -1.0, 3.0]),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
        np.array([[1.0, 0, 0], [0, 1.0, 3.0], [0, 3.0, 1.0]]),
        -np.eye(3),
    ],
)
def test_indefinite_matrix_is_refused(name, matrix):
    pattern, data = pattern_of(matrix)
    with pytest.raises(NotPositiveDefinite):
        solver(pattern, name)(data)
    good, ok = pattern_of(matrix @ matrix.T + np.eye(len(matrix)))  # negative control
    solver(good, name)(ok)


@pytest.mark.parametrize("matrix", [np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([[1.0, 1.0], [1.0, 1.0]])])
def test_zero_pivot_is_refused(name, matrix):
    """A zero on the diagonal makes a pivoting solver swap rows: the pivots look fine and the matrix is not."""
    pattern, data = pattern_of(matrix)
    with pytest.raises(NotPositiveDefinite):
        solver(pattern, name)(data)


def test_shifted_stiffness_is_refused_and_accepted_again(small, name):
    """One negative direction among thousands is enough; the solver works on afterwards."""
    body = small.model.body
    factor, data = solver(body.pattern, name), stiffness(body)
    bad = data.copy()
    bad[body.pattern.indptr[body.pattern.size // 2]] *= -1e-3
    with pytest.raises(NotPositiveDefinite):
        factor(bad)
    b = np.ones(body.pattern.size)
    np.testing.assert_allclose(factor(data)(b), solver(body.pattern, name)(data)(b), rtol=1e-9)


def test_solvers_agree(small):
    pytest.importorskip("pypardiso")
    body = small.model.body
    data, b = stiffness(body), np.random.default_rng(0).normal(size=body.pattern.size)
    x, y = (solver(body.pattern, n)(data)(b) for n in ("superlu", "pardiso"))
    np.testing.assert_allclose(x, y, rtol=0, atol=1e-9 * np.abs(x).max())


def test_matrix_beyond_single_precision_is_solved_in_double(name):
    """Condition 1e9: refinement of single factors does not converge, and the answer is that of double precision."""
    rng = np.random.default_rng(0)
    q, _ = np.linalg.qr(rng.normal(size=(30, 30)))
    matrix = q @ np.diag(np.logspace(0, -9, 30)) @ q.T
    pattern, data = pattern_of(0.5 * (matrix + matrix.T))
    x = rng.normal(size=30)
    found = solver(pattern, name)(data)(matrix @ x)
    np.testing.assert_allclose(found, x, rtol=0, atol=1e-5)  # condition times round-off


def test_rough_solution_is_that_of_single_precision(small, name):
    """Asked for a hundredth, a solution comes from the factor alone: not exact, not bad."""
    body = small.model.body
    data, b = stiffness(body), np.random.default_rng(0).normal(size=body.pattern.size)
    factor = solver(body.pattern, name)(data)
    x, y = factor(b), factor(b, direct.SINGLE_PRECISION_TOLERANCE)
    assert 0.0 < np.linalg.norm(y - x) < 1e-3 * np.linalg.norm(x)


def test_unknown_solver_is_refused_by_name(small):
    with pytest.raises(ValueError, match=r"'mumps'.*auto, pardiso or superlu"):
        solver(small.model.body.pattern, "mumps")


def test_auto_takes_what_is_there():
    assert direct.available() in ("pardiso", "superlu")


# ---------------------------------------------------------------------------------------------- unsymmetric matrices


def dense_pattern(n: int, symmetric: bool) -> tetrahedra.Pattern:
    """Every entry of a small matrix, or those of its upper triangle."""
    rows, cols = np.nonzero(np.triu(np.ones((n, n))) if symmetric else np.ones((n, n)))
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))]).astype(np.int32)
    return tetrahedra.Pattern(indptr, cols.astype(np.int32), symmetric)


def skewed(body: tetrahedra.Body) -> tuple[sparse.csr_matrix, np.ndarray]:
    """The stiffness of a body stored whole, every entry off by its own 2 %; a right-hand side."""
    p, rng = body.pattern, np.random.default_rng(0)
    data = stiffness(body) * (1.0 + 0.02 * rng.uniform(-1, 1, len(p.indices)))
    return sparse.csr_matrix((data, p.indices, p.indptr), shape=(p.size, p.size)), rng.normal(size=p.size)


@pytest.fixture(scope="module")
def whole(make_bench):
    """The small body with both triangles stored, as friction needs it."""
    return make_bench({"friction": 0.3}).model.body


def test_pattern_of_both_triangles_knows_its_diagonal(whole):
    p = whole.pattern
    rows = np.repeat(np.arange(p.size), np.diff(p.indptr))
    np.testing.assert_array_equal(p.indices[p.diagonal], np.arange(p.size))
    np.testing.assert_array_equal(rows[p.diagonal], np.arange(p.size))


def test_symmetric_matrix_stored_both_ways_is_the_same(small, whole, name):
    """Upper triangle or both: same entries, same solution (the numbering is the same, it depends on the mesh alone)."""
    np.testing.assert_array_equal(small.model.body.free, whole.free)
    one, two = stiffness(small.model.body), stiffness(whole)
    p, q = small.model.body.pattern, whole.pattern
    upper = sparse.csr_matrix((one, p.indices, p.indptr), shape=(p.size, p.size))
    full = sparse.csr_matrix((two, q.indices, q.indptr), shape=(q.size, q.size))
    np.testing.assert_allclose(abs(upper + sparse.triu(upper, 1).T - full).max(), 0.0, atol=1e-15 * abs(full).max())
    b = np.random.default_rng(0).normal(size=p.size)
    x, y = solver(p, name)(one)(b), solver(q, name)(two)(b)
    np.testing.assert_allclose(x, y, rtol=0, atol=1e-10 * np.abs(x).max())  # condition times round-off


def test_unsymmetric_matrix_is_solved_as_it_is(whole, name):
    A, b = skewed(whole)
    x = solver(whole.pattern, name)(A.data)(b)
    np.testing.assert_allclose(A @ x, b, atol=1e-9 * np.abs(b).max())
    assert np.abs(A.T @ x - b).max() > 1e-3  # negative control: the transpose is another matrix


def test_unsymmetric_solvers_agree(whole):
    pytest.importorskip("pypardiso")
    A, b = skewed(whole)
    x, y = (solver(whole.pattern, n)(A.data)(b) for n in ("superlu", "pardiso"))
    np.testing.assert_allclose(x, y, rtol=0, atol=1e-9 * np.abs(x).max())


def test_unsymmetric_factors_can_be_made_again(whole, name):
    A, b = skewed(whole)
    factor = solver(whole.pattern, name)
    first = factor(A.data)(b).copy()
    np.testing.assert_allclose(factor(4.0 * A.data)(b), first / 4.0, rtol=0, atol=1e-11 * np.abs(first).max())
    np.testing.assert_array_equal(factor(A.data)(b), first)


def test_unsymmetric_matrix_may_be_indefinite(name):
    """Friction's tangent has no sign: a negative pivot is no failure."""
    A = np.array([[1.0, 2.0, 0.0], [0.5, -1.0, 0.3], [0.0, -0.4, 2.0]])
    x = solver(dense_pattern(3, False), name)(A.ravel())(np.ones(3))
    np.testing.assert_allclose(A @ x, 1.0, rtol=1e-12)


def test_only_one_factor_is_alive(monkeypatch):
    """Each is 50 to 100 MB on a whole model: that of the other precision goes, a refused one too; analyses stay."""
    pytest.importorskip("pypardiso")
    freed, free = [], direct._free
    monkeypatch.setattr(direct, "_free", lambda s, everything=True: (freed.append(everything), free(s, everything)))
    pattern, data = pattern_of(np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 2.0]]))
    pardiso, b = direct._Pardiso(pattern), np.array([1.0, 2.0, 3.0])
    exact = np.linalg.solve([[4.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 2.0]], b)
    for k, dtype in enumerate((np.float32, np.float64, np.float32)):
        x = pardiso.factor(data.astype(dtype))(b.astype(dtype))
        np.testing.assert_allclose(x, exact, rtol=1e-5 if dtype is np.float32 else 1e-14)
        assert freed == [False] * k
    with pytest.raises(NotPositiveDefinite):
        pardiso.factor(-data)
    assert freed == [False] * 4
    np.testing.assert_allclose(pardiso.factor(data)(b), exact, rtol=1e-14)
