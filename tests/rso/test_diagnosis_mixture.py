"""Evidence, posterior and simulation within tiles against brute force, and where a gap is against leaving it out."""

import dataclasses

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.discrepancy import make_test_plan
from rso.discrepancy.evidence.gaussian_mixture import (
    MAX_TILE_DEVIATION_SD,
    Tiles,
    compressed,
    log_tiles,
    mean_prediction,
    mixture_log_evidence,
    posterior,
    ready,
    whitened_draws,
    whitening,
)
from rso.discrepancy.evidence.localisation import localise

U = np.linspace(1.0, 4.0, 4)
A = U**1.5
DIRECTION = 0.3 * U**2.5
SHIFT = np.array([0.0, 0.1, -0.1, 0.2])
SD = 0.4
C = 0.04 * np.exp(-np.abs(U[:, None] - U)) + 0.02 * np.eye(4)
M0 = 2.0
Y = 1.1 * M0 * A + SHIFT + 0.2 * M0 * DIRECTION + np.array([0.1, -0.2, 0.15, 0.05])


def tiles(*scales: float, log: bool = False) -> Tiles:
    """Tiles that differ in their direction; equal prior."""
    n = len(scales)
    D = np.array([[s * DIRECTION] for s in scales])
    at = np.array([[3.0 + k] for k in range(n)])
    prior = np.full(n, -np.log(n))
    return Tiles(np.tile(A, (n, 1)), np.tile(SHIFT, (n, 1)), D, np.array([SD]), at, prior, (0,), (log,))


def density(rows: np.ndarray, direction: np.ndarray) -> float:
    """∫∫ N(y; m M0 A + c + M0 D ξ, C) N(ξ; 0, SD²) dξ dm on a grid."""
    m, ξ = np.linspace(-1, 3, 1601), np.linspace(-6 * SD, 6 * SD, 1201)
    P = np.linalg.inv(C[np.ix_(rows, rows)])
    r = Y[rows] - SHIFT[rows] - M0 * (m[:, None, None] * A[rows] + ξ[None, :, None] * direction[rows])
    q = np.exp(-0.5 * np.einsum("mxi,ij,mxj->mx", r, P, r) - 0.5 * (ξ / SD) ** 2)
    norm = np.sqrt(2 * np.pi) ** (len(rows) + 1) * np.sqrt(np.linalg.det(C[np.ix_(rows, rows)])) * SD
    return float(q.sum() * (m[1] - m[0]) * (ξ[1] - ξ[0]) / norm)


@pytest.mark.parametrize("rows", [[0, 1, 2, 3], [1, 3], [0, 1, 3]])
def test_evidence_is_the_integral(rows):
    rows = np.array(rows)
    white = whitening(C, rows)
    one = mixture_log_evidence(ready(tiles(1.0), white, M0), white(Y)[None])[0]
    both = mixture_log_evidence(ready(tiles(1.0, -2.0), white, M0), white(Y)[None])[0]
    first, second = density(rows, DIRECTION), density(rows, -2.0 * DIRECTION)
    # the grid's sum of a Gaussian is exact to round-off where it is resolved and not cut off
    np.testing.assert_allclose(one, np.log(first), rtol=0, atol=1e-6)
    np.testing.assert_allclose(both, np.log(0.5 * (first + second)), rtol=0, atol=1e-6)


def test_differences_of_evidence_are_predictive_densities():
    """p(y_g | y_rest) from the ratio of two integrals: what held-out scores are made of."""
    every, rest = np.arange(4), np.array([0, 1, 2])
    found = []
    for rows in (every, rest):
        white = whitening(C, rows)
        found.append(mixture_log_evidence(ready(tiles(1.0), white, M0), white(Y)[None])[0])
    expected = np.log(density(every, DIRECTION) / density(rest, DIRECTION))
    np.testing.assert_allclose(found[0] - found[1], expected, rtol=0, atol=2e-6)


def test_a_basis_of_few_vectors_changes_no_evidence():
    rng = np.random.default_rng(8)
    n, shapes = 40, rng.standard_normal((3, 40))
    A, c, D = (rng.standard_normal((*k, 3)) @ shapes for k in ((6,), (6,), (6, 2)))
    full = Tiles(A, 1e-2 * c, D, np.array([0.1, 0.3]), np.zeros((6, 2)), np.full(6, -np.log(6)), (0, 1), (False, False))
    cov = 1e-3 * (np.eye(n) + np.exp(-np.abs(np.subtract.outer(np.arange(n), np.arange(n)))))
    blocks = [np.arange(25), np.arange(25, n)]
    few = compressed(full, blocks, np.zeros((0, n)), M0)
    assert few.basis.shape == (n, 6)  # three per block
    np.testing.assert_allclose(few.basis.T @ few.basis, np.eye(6), rtol=0, atol=1e-12)
    Y = M0 * A[:2] + 0.05 * rng.standard_normal((2, n))
    for rows in (np.arange(n), np.arange(3, n), np.array([1, 30])):  # also fewer rows than vectors
        white = whitening(cov, rows)
        a, b = (ready(t, white, M0) for t in (full, few))
        # round-off of a quadratic form of a thousand or so
        np.testing.assert_allclose(log_tiles(b, white(Y)), log_tiles(a, white(Y)), rtol=0, atol=1e-7)
        np.testing.assert_allclose(mean_prediction(b, white(Y[0])), mean_prediction(a, white(Y[0])), rtol=0, atol=1e-8)
    assert compressed(full, blocks, rng.standard_normal((1, n)), M0).basis.shape[1] == 8  # what else it must span


def test_whitening_of_chosen_rows():
    rows = np.array([3, 0, 2])
    white = whitening(C, rows)
    np.testing.assert_allclose(white.L @ white.L.T, C[np.ix_(rows, rows)], rtol=0, atol=1e-15)
    B = np.random.default_rng(0).standard_normal((5, 2, 4))
    np.testing.assert_allclose(white(B) @ white.L.T, B[..., rows], rtol=0, atol=1e-13)
    np.testing.assert_allclose(white.log_det, np.linalg.slogdet(C[np.ix_(rows, rows)])[1], rtol=0, atol=1e-13)


def conditioned() -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of (m, ξ) given Y by conditioning a joint Gaussian with a very wide prior of m."""
    G = M0 * np.stack([A, DIRECTION], 1)
    P = np.diag([1e2, SD**2])
    K = P @ G.T @ np.linalg.inv(G @ P @ G.T + C)
    return K @ (Y - SHIFT), P - K @ G @ P


def test_posterior_draws_have_the_exact_mean_and_covariance():
    white = whitening(C)
    h = ready(tiles(1.0), white, M0)
    post = posterior(h, white(Y), 200_000, np.random.default_rng(1))
    mean, covariance = conditioned()
    spread = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(post.local.mean(0), mean, rtol=0, atol=5 * spread.max() / np.sqrt(200_000))
    # the scatter of 200 000 draws; the prior of the oracle (standard deviation 10) shifts less
    np.testing.assert_allclose(np.cov(post.local.T), covariance, rtol=0.02, atol=1e-7)
    np.testing.assert_allclose(post.modulus, M0 * post.local[:, 0], rtol=1e-15)
    # the coordinate moves by ξ at the modulus that goes with it
    np.testing.assert_allclose(post.at[:, 0], 3.0 + post.local[:, 1] / post.local[:, 0], rtol=1e-12)
    logarithmic = posterior(ready(tiles(1.0, log=True), white, M0), white(Y), 1000, np.random.default_rng(1))
    # forces are linear in the size within a tile, down to where it ends
    moved = np.maximum(1.0 + logarithmic.local[:, 1] / logarithmic.local[:, 0], np.exp(-4 * SD))
    np.testing.assert_allclose(logarithmic.at[:, 0], 3.0 * moved, rtol=1e-12)


def test_draws_say_where_the_data_lead_away_from_what_a_tile_knows():
    white, h = whitening(C), ready(tiles(1.0), whitening(C), M0)
    near = posterior(h, white(Y), 1000, np.random.default_rng(1))
    far = posterior(h, white(M0 * A + SHIFT + 20 * M0 * DIRECTION), 1000, np.random.default_rng(1))
    assert not near.strayed.any() and far.strayed.all()
    # it stays at the end of its surroundings
    np.testing.assert_allclose(far.at, 3.0 + MAX_TILE_DEVIATION_SD * SD, rtol=1e-12)


def test_draws_choose_tiles_by_their_evidence():
    white = whitening(C)
    h = ready(tiles(1.0, 0.2, -1.0), white, M0)
    logs = log_tiles(h, white(Y)[None])[0]
    weight = np.exp(logs - logs.max())
    weight /= weight.sum()
    post = posterior(h, white(Y), 100_000, np.random.default_rng(2))
    # 4 standard errors of a share
    np.testing.assert_allclose(np.bincount(post.tile, minlength=3) / 100_000, weight, rtol=0, atol=4 * 0.5 / 316)


def test_simulated_data_have_the_predictive_mean_and_covariance():
    white = whitening(C)
    h = ready(tiles(1.0), white, M0)
    rng = np.random.default_rng(3)
    found = whitened_draws(h, posterior(h, white(Y), 200_000, rng), rng) @ white.L.T
    mean, covariance = conditioned()
    G = M0 * np.stack([A, DIRECTION], 1)
    expected = C + G @ covariance @ G.T
    np.testing.assert_allclose(np.cov(found.T), expected, rtol=0, atol=0.015 * expected.max())
    np.testing.assert_allclose(found.mean(0), G @ mean + SHIFT, rtol=0, atol=0.005)
    np.testing.assert_allclose(white.L @ mean_prediction(h, white(Y)), G @ mean + SHIFT, rtol=1e-4)


# ------------------------------------------------------------------------------------------------------------ where


def small():
    """A plan of three experiments and a linear base model on it: force ∝ u^1.5, one direction ∝ u^2.5."""
    rng = np.random.default_rng(4)
    names = ("one", "two", "three")
    plan = make_test_plan([toy.experiment(n, toy.recorded(toy.TRUTH, rng, unload=n == "two")) for n in names])
    u = np.concatenate([item.depth for item, _, _ in plan.rows()])
    h0 = Tiles(
        (u**1.5)[None],
        np.zeros((1, len(u))),
        (0.05 * u**2.5)[None, None],
        np.array([5.0]),
        np.zeros((1, 1)),
        np.zeros(1),
        (0,),
        (False,),
    )
    sd = 2e-3 + 2e-4 * u
    cov = np.diag(sd**2) + 4e-6 * np.exp(-np.abs(u[:, None] - u) / 0.5)
    h = ready(h0, whitening(cov), 0.01)
    return plan, h, cov, u


def test_regions_are_what_leaving_them_out_says():
    plan, h, cov, u = small()
    rng = np.random.default_rng(5)
    y = 0.011 * u**1.5 + 0.03 * u * (u < 1.3) + np.linalg.cholesky(cov) @ rng.standard_normal(len(u))
    found = localise(plan, h, cov, y, 0)
    J = np.stack([u**1.5, u**2.5], 1)
    assert len(found.regions) > 6
    for g in found.regions:
        rows = np.array(g.rows)
        rest = np.setdiff1d(np.arange(len(u)), rows)
        V = np.linalg.inv(cov[np.ix_(rest, rest)])
        S = np.linalg.inv(J[rest].T @ V @ J[rest])
        θ = S @ J[rest].T @ V @ y[rest]
        K = cov[np.ix_(rows, rest)] @ V
        r = y[rows] - J[rows] @ θ - K @ (y[rest] - J[rest] @ θ)
        B = J[rows] - K @ J[rest]
        P = np.linalg.inv(cov[np.ix_(rows, rows)] - K @ cov[np.ix_(rest, rows)] + B @ S @ B.T)
        F = 0.01 * u[rows] ** 1.5
        α, sd = (F @ P @ r) / (F @ P @ F), 1 / np.sqrt(F @ P @ F)
        # the diagnosis has a wide prior where this has none
        np.testing.assert_allclose([g.amplitude, g.amplitude_sd, g.z], [α, sd, α / sd], rtol=2e-3, atol=1e-4)
    worst = found.regions[0]
    assert abs(worst.z) > found.threshold and "loading 0.0" in worst.region and worst.z > 0


def test_the_largest_region_of_null_data_exceeds_the_threshold_in_five_percent():
    plan, h, cov, u = small()
    rng = np.random.default_rng(6)
    L, n = np.linalg.cholesky(cov), 200
    above = 0
    for k in range(n):
        found = localise(plan, h, cov, 0.0105 * u**1.5 + L @ rng.standard_normal(len(u)), k)
        above += abs(found.regions[0].z) > found.threshold
    assert 2 <= above <= 20  # binomial(200, 0.05): 99.8 %


# ---- a modulus that is not free


@pytest.mark.parametrize("tied", [None, 0])
def test_evidence_and_draws_with_a_known_modulus_are_those_along_the_line(tied):
    """m = m_t, or m = m_t + ξ where the coordinate is ln μ: one integral over ξ."""
    own = 1.07
    t = dataclasses.replace(tiles(1.0), moduli=np.array([own * M0]), tied=tied)
    white = whitening(C)
    h = ready(t, white, M0)
    ξ = np.linspace(-6 * SD, 6 * SD, 24001)
    m = np.full(len(ξ), own) if tied is None else own + ξ
    r = Y - SHIFT - M0 * (m[:, None] * A + ξ[:, None] * DIRECTION)
    q = np.exp(-0.5 * np.einsum("xi,ij,xj->x", r, np.linalg.inv(C), r) - 0.5 * (ξ / SD) ** 2)
    density = q.sum() * (ξ[1] - ξ[0]) / (np.sqrt(2 * np.pi) ** 5 * np.sqrt(np.linalg.det(C)) * SD)
    # whether one prior of the modulus has a density or not is the same factor for all tiles and hypotheses
    np.testing.assert_allclose(
        mixture_log_evidence(h, white(Y)[None])[0], np.log(density) + 0.5 * np.log(2 * np.pi), atol=1e-9
    )
    post = posterior(h, white(Y), 40_000, np.random.default_rng(3))
    mean = np.sum(m * q) / q.sum()
    spread = np.sqrt(np.sum((m - mean) ** 2 * q) / q.sum())
    np.testing.assert_allclose(post.modulus.mean(), M0 * mean, rtol=0, atol=1e-12 + 5 * M0 * spread / 200)
    np.testing.assert_allclose(post.modulus.std(), M0 * spread, rtol=0.02, atol=1e-12)
    if tied is not None:
        np.testing.assert_array_equal(post.at[:, 0], np.log(post.modulus))
    W = whitened_draws(h, post, np.random.default_rng(4)) @ white.L.T
    best = np.sum(q[:, None] * (Y - r), axis=0) / q.sum()
    np.testing.assert_allclose(W.mean(0), best, rtol=0, atol=5 * np.sqrt(W.var(0).max()) / 200)
    np.testing.assert_allclose(white.L @ mean_prediction(h, white(Y)), best, rtol=0, atol=1e-9)


def test_a_hypothesis_of_which_nothing_is_open_is_a_density():
    t = tiles(1.0)
    t = dataclasses.replace(t, D=t.D[:, :0], sd=t.sd[:0], axes=(), log=(), moduli=np.array([M0]))
    white = whitening(C)
    h, r = ready(t, white, M0), Y - SHIFT - M0 * A
    wanted = -0.5 * (r @ np.linalg.solve(C, r) + np.linalg.slogdet(2 * np.pi * C)[1])
    np.testing.assert_allclose(mixture_log_evidence(h, white(Y)[None])[0] - 0.5 * np.log(2 * np.pi), wanted, rtol=1e-12)
    post = posterior(h, white(Y), 7, np.random.default_rng(0))
    np.testing.assert_array_equal(post.modulus, np.full(7, M0))
