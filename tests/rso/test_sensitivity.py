import numpy as np
import pytest
from scipy.stats import sobol_indices, uniform

from rso.benchmarks import ishigami, ishigami_indices, sobol_g, sobol_g_indices
from rso.doe import Box
from rso.emulation.sensitivity import local, morris, response_curve, saltelli_indices

A = np.array([0.0, 1.0, 4.5, 9.0])


def standard_error(interval):
    return (interval[:, 1] - interval[:, 0]) / (2 * 1.645)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(
    "f,d,exact", [(ishigami, 3, ishigami_indices()), (lambda X: sobol_g(X, A), 4, sobol_g_indices(A))]
)
def test_sobol_indices_within_three_standard_errors_of_the_exact_ones(f, d, exact, seed):
    r = saltelli_indices(f, d, seed)
    for found, interval, truth in zip((r.first, r.total), (r.first_interval, r.total_interval), exact, strict=True):
        assert np.all(np.abs(found - truth) < 3 * standard_error(interval) + 1e-12)
        assert standard_error(interval).max() < 0.03
    assert r.excluded == 0


def test_sobol_agrees_with_scipy_and_repeats_to_the_bit():
    mine = saltelli_indices(ishigami, 3, 0, n=4096)
    theirs = sobol_indices(func=lambda x: ishigami(x.T), n=4096, dists=[uniform(0, 1)] * 3, rng=1)
    # Two independent low-discrepancy estimates: each within about 0.01 of the truth at n = 4096.
    np.testing.assert_allclose(mine.first, theirs.first_order, atol=0.03)
    np.testing.assert_allclose(mine.total, theirs.total_order, atol=0.03)
    again = saltelli_indices(ishigami, 3, 0, n=4096)
    assert np.array_equal(mine.first_interval, again.first_interval) and np.array_equal(mine.total, again.total)


def test_sobol_on_a_triangle_has_its_own_exact_answer():
    # y = x1 + x2 uniform on x1 + x2 < 1: Var = 1/18, E[y|x1] = (1 + x1)/2, Var(y|x2) = (1 − x2)²/12: S = 1/4, T = 3/4.
    r = saltelli_indices(lambda X: X.sum(axis=1), 2, 0, constraint=lambda X: X.sum(axis=1) < 1)
    assert np.all(np.abs(r.first - 0.25) < 3 * standard_error(r.first_interval))
    assert np.all(np.abs(r.total - 0.75) < 3 * standard_error(r.total_interval))
    np.testing.assert_allclose([r.excluded, r.variance], [0.5, 1 / 18], rtol=0.05)  # 8192 points: 1 to 2 %
    free = saltelli_indices(lambda X: X.sum(axis=1), 2, 0)  # negative control: independent inputs give 1/2 each
    np.testing.assert_allclose(free.first, 0.5, atol=0.02)  # 4096 points


def test_sobol_never_looks_at_infeasible_points_and_refuses_empty_sets():
    def f(X):
        assert np.all(X[:, 0] < 0.5)
        return X[:, 0]

    saltelli_indices(f, 2, 0, n=256, constraint=lambda X: X[:, 0] < 0.5)
    with pytest.raises(ValueError, match="less than 1 %"):
        saltelli_indices(f, 2, 0, n=64, constraint=lambda X: X[:, 0] < 1e-4)
    with pytest.raises(ValueError, match="power of two"):
        saltelli_indices(f, 2, 0, n=100)


def test_sobol_of_a_constant_is_undefined():
    r = saltelli_indices(lambda X: np.full(len(X), 2.0), 2, 0, n=64)
    assert np.isnan(r.first).all() and r.variance == 0


def test_morris_is_exact_for_a_linear_function():
    c = np.array([3.0, -2.0, 0.0, 0.5])
    r = morris(lambda X: X @ c + 1, 4, 0)
    # Differences of sums of a few numbers, divided by 2/3.
    np.testing.assert_allclose(r.mu, c, atol=1e-12)
    np.testing.assert_allclose(r.mu_star, np.abs(c), atol=1e-12)
    np.testing.assert_allclose(r.sigma, 0, atol=1e-12)
    assert morris(lambda X: X[:, 0] * X[:, 1], 2, 0).sigma.min() > 0.1  # negative control: an interaction


def test_morris_of_ishigami_is_the_mean_over_the_grid():
    # All elementary effects of x1 on the 4-level grid: sin goes from level k to k + 2.
    def s(k):
        return np.sin(np.pi * (2 * k / 3 - 1))

    b = np.mean([0.1 * (np.pi * (2 * k / 3 - 1)) ** 4 for k in range(4)])
    exact = np.mean([abs(s(k + 2) - s(k)) for k in (0, 1)]) * (1 + b) * 1.5
    r = morris(ishigami, 3, 0, trajectories=2000)
    assert abs(r.mu_star[0] - exact) < 4 * r.sigma[0] / np.sqrt(2000)
    np.testing.assert_allclose(r.mu_star[1], 7.875, rtol=1e-12)  # 7 sin²(π/3) · 1.5, the same for each step


def test_local_bars_of_a_power_law():
    box = Box(("a", "b"), ("1", "1"), (1.0, 2.0), (4.0, 3.0), (True, False))

    def f(X):
        theta = box.from_unit(X)
        return theta[:, 0] ** 2 / theta[:, 1]

    bars = local(f, np.array([0.5, 0.0]), box.names, box)
    # Elasticities of a power law are its exponents; central or one-sided differences of logarithms are exact.
    np.testing.assert_allclose([b.elasticity for b in bars], [2, -1], rtol=1e-6)
    np.testing.assert_allclose([bars[0].at_low, bars[0].at_high, bars[0].change], [0.5, 8, 7.5], rtol=1e-12)
    np.testing.assert_allclose([bars[1].at_low, bars[1].at_high, bars[1].change], [2, 4 / 3, 2 / 3], rtol=1e-12)
    assert local(f, np.array([0.5, 0.0]), box.names)[0].elasticity is None


def test_local_sees_a_bump_that_the_ends_do_not():
    (bar,) = local(lambda X: X[:, 0] * (1 - X[:, 0]), np.array([0.5]), ("x",))
    assert bar.at_low == bar.at_high == 0
    np.testing.assert_allclose(bar.change, 0.25, rtol=1e-12)  # the middle is one of the 41 points
    x, y = response_curve(lambda X: X[:, 0] + X[:, 1], np.array([0.2, 0.4]), 1, n=5)
    np.testing.assert_allclose(y, 0.2 + x, rtol=1e-12)


def test_morris_keeps_to_the_feasible_set():
    def f(X):
        assert np.all(X.sum(axis=1) < 1.5)
        return X @ np.array([2.0, -1.0])

    r = morris(f, 2, 0, trajectories=30, constraint=lambda X: X.sum(axis=1) < 1.5)
    np.testing.assert_allclose(r.mu, [2, -1], atol=1e-12)  # exact for a linear function
    assert r.trajectories == 30
    with pytest.raises(ValueError, match="hardly any trajectory"):
        morris(lambda X: X[:, 0], 2, 0, constraint=lambda X: X[:, 0] < 0.1)


@pytest.mark.parametrize(
    "f, d, exact",
    [
        (ishigami, 3, ishigami_indices()),
        (lambda X: sobol_g(X, A), 4, sobol_g_indices(A)),
        (lambda X: X @ np.array([1.0, 2.0, 3.0]), 3, (np.array([1, 4, 9]) / 14,) * 2),
    ],
)
def test_intervals_are_as_wide_as_the_estimates_scatter(f, d, exact):
    found = [saltelli_indices(f, d, seed, n=1024) for seed in range(25)]
    for name, truth in zip(("first", "total"), exact, strict=True):
        ends = np.array([getattr(r, f"{name}_interval") for r in found])
        inside = (ends[..., 0] <= truth + 1e-12) & (truth - 1e-12 <= ends[..., 1])
        # 25 d indices, of one function not independent: 0.90 ± 0.05 and more.
        assert inside.mean() > 0.75
        half = np.diff(ends, axis=-1)[..., 0].mean(axis=0) / 2
        scatter = np.sqrt(np.mean([(getattr(r, name) - truth) ** 2 for r in found], axis=0))
        # 1.645 for a known σ, 1.9 for eight scrambles; near 0 and 1 the interval is cut.
        assert np.all(half < 3 * scatter + 1e-4)


def test_indices_and_their_intervals_stay_between_0_and_1_whatever_the_level():
    for level in (0.0, 1e5):
        r = saltelli_indices(lambda X: X[:, 0] + 1e-3 * X[:, 1] + level, 2, 0, n=64)  # noqa: B023
        values = np.concatenate([r.first, r.total, r.first_interval.ravel(), r.total_interval.ravel()])
        assert values.min() >= 0 and values.max() <= 1
        np.testing.assert_allclose(r.first, [1, 0], atol=5e-3)  # 8 times 64 points: 0.003


def test_the_intervals_hold_the_error_of_the_surrogate():
    # A surrogate of x1 + 0.25 x2 that has missed x2, and says that it may be off by 1.6 times that.
    truth = np.array([1.0, 0.25**2]) / (1 + 0.25**2)

    def surrogate(X):
        return X[:, 0]

    def sd(X):
        return np.full(len(X), 0.4 / np.sqrt(12))

    blind, told = saltelli_indices(surrogate, 2, 0, n=512), saltelli_indices(surrogate, 2, 0, n=512, sd=sd)
    assert np.array_equal(blind.first, told.first)
    for ends, holds in ((blind.first_interval, False), (told.first_interval, True)):
        assert np.all((ends[:, 0] <= truth) & (truth <= ends[:, 1])) == holds
    exact = saltelli_indices(surrogate, 2, 0, n=512, sd=lambda X: np.zeros(len(X)))  # negative control
    np.testing.assert_allclose(exact.first_interval, blind.first_interval, atol=1e-12)
