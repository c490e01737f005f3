import numpy as np
import pytest
from scipy import sparse

from fem_backend import element, linsolve, stress
from fem_backend.laws import NeoHooke
from fem_backend.linsolve import NotPositiveDefinite, solver


@pytest.fixture(params=["superlu", "pardiso"])
def name(request):
    if request.param == "pardiso":
        pytest.importorskip("pypardiso")
    return request.param


def stiffness(body: element.Body) -> np.ndarray:
    state = stress.evaluate(NeoHooke(0.01, 5.8), np.zeros((*body.w.shape, 3, 3)), tangent=True)
    return element.stiffness(body, state.F, state.S_geometric, state.C)


def pattern_of(upper: np.ndarray) -> tuple[element.Pattern, np.ndarray]:
    """Pattern with every entry of a dense upper triangle, also where it is zero, and its data."""
    n = len(upper)
    rows, cols = np.triu_indices(n)
    indptr = np.concatenate([[0], np.cumsum(np.arange(n, 0, -1))]).astype(np.int32)
    return element.Pattern(indptr, cols.astype(np.int32)), upper[rows, cols].astype(float)


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


def test_unknown_solver_is_refused_by_name(small):
    with pytest.raises(ValueError, match=r"'mumps'.*auto, pardiso or superlu"):
        solver(small.model.body.pattern, "mumps")


def test_auto_takes_what_is_there():
    assert linsolve.available() in ("pardiso", "superlu")
