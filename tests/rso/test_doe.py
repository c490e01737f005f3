import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.stats import qmc

from rso.doe import (
    SAMPLERS,
    Box,
    box_behnken,
    central_composite,
    design,
    extend,
    extend_design,
    extend_latin,
    factorial,
    latin,
    read_condition,
    registry,
    samplers,
    star_distance,
)


def is_latin(X):
    n = len(X)
    return all(np.array_equal(np.sort(np.floor(column * n).astype(int)), np.arange(n)) for column in X.T)


@pytest.mark.parametrize("d", [1, 2, 5])
@pytest.mark.parametrize("runs", [2, 7, 20])
def test_latin_hypercubes_have_one_point_per_row_of_cells(d, runs):
    for X in (design("lhs", d, runs, 0), design("lhs", d, runs, 0, optimise=False), design("osf", d, runs, 0)):
        assert X.shape == (runs, d)
        assert is_latin(X)


@pytest.mark.parametrize("d,runs,optimise", [(1, 9, True), (2, 1, True), (2, 40, True), (3, 13, True), (4, 8, False)])
def test_latin_hypercubes_are_those_of_scipy_to_the_bit(d, runs, optimise):
    """Designs of stored studies were made by scipy, whose import is slow."""
    for seed in range(3):
        how = "random-cd" if optimise and d > 1 else None
        own = qmc.LatinHypercube(d, optimization=how, rng=np.random.default_rng(seed)).random(runs)
        assert np.array_equal(latin(d, runs, seed, optimise), own)


def test_a_sobol_sample_is_not_latin_at_an_odd_count():
    # Negative control of `is_latin`.
    assert not is_latin(design("sobol", 3, 20, 0))


def test_optimised_designs_are_better_at_what_they_optimise():
    plain, optimised = design("lhs", 3, 30, 5, optimise=False), design("lhs", 3, 30, 5)
    assert qmc.discrepancy(optimised) < 0.7 * qmc.discrepancy(plain)
    random = [pdist(design("lhs", 3, 30, s, optimise=False)).min() for s in range(20)]
    assert pdist(design("osf", 3, 30, 5)).min() > max(random)


@pytest.mark.parametrize("kind,runs", [("lhs", 16), ("sobol", 16), ("osf", 16), ("ccd", None), ("box_behnken", None)])
def test_every_design_is_in_the_cube_and_repeats_to_the_bit(kind, runs):
    X = design(kind, 4, runs, 3)
    assert X.min() >= 0 and X.max() <= 1
    assert np.array_equal(X, design(kind, 4, runs, 3))
    if kind in ("lhs", "sobol", "osf"):
        assert not np.array_equal(X, design(kind, 4, runs, 4))


@pytest.mark.parametrize("d", range(2, 9))
def test_rotatable_ccd_has_the_moments_of_a_rotatable_design(d):
    coded = 2 * central_composite(d) - 1
    m2, m4 = (coded**2).sum(0), (coded**4).sum(0)
    mixed = (coded[:, :, None] ** 2 * coded[:, None, :] ** 2).sum(0)[~np.eye(d, dtype=bool)]
    odd = (coded[:, :, None] * coded[:, None, :]).sum(0)[~np.eye(d, dtype=bool)]
    # Sums of at most 80 numbers below 1: rounding only.
    np.testing.assert_allclose(coded.sum(0), 0, atol=1e-12)
    np.testing.assert_allclose(odd, 0, atol=1e-12)
    np.testing.assert_allclose(m2, m2[0], rtol=1e-12)
    # Box & Hunter 1957: rotatable if and only if Σx_i⁴ = 3 Σx_i²x_j².
    np.testing.assert_allclose(m4, 3 * mixed[0], rtol=1e-12)
    np.testing.assert_allclose(mixed, mixed[0], rtol=1e-12)


def test_fractional_ccd_does_not_confuse_pairs_of_factors():
    for d in (5, 6, 7, 8):
        X = 2 * central_composite(d, "face") - 1
        corners = X[np.all(np.abs(X) == 1, axis=1)]
        assert len(corners) == 2 ** (d - (2 if d == 8 else 1))
        i, j = np.triu_indices(d, 1)
        effects = np.column_stack([np.ones(len(corners)), corners, corners[:, i] * corners[:, j]])
        # Resolution V: constant, main effects and pairs are mutually orthogonal; integers, hence exact.
        assert np.array_equal(effects.T @ effects, len(corners) * np.eye(effects.shape[1]))


def test_face_centred_points_lie_on_faces_and_stars_never_leave_the_box():
    X = central_composite(3, "face")
    assert len(X) == 15
    on_face = np.isin(X, (0.0, 1.0)).sum(axis=1)
    assert sorted(on_face) == [0] + [1] * 6 + [3] * 8
    for star in ("circumscribed", "inscribed"):
        X = central_composite(3, star, alpha=1.7)
        assert X.min() == 0 and X.max() == 1
        # Corners at 0.5 ± 0.5/α; one rounding.
        np.testing.assert_allclose(np.sort(np.unique(X))[1], 0.5 - 0.5 / 1.7, rtol=1e-14)


@pytest.mark.parametrize(
    "d,centres,published",
    [
        (2, 1, 1.000),
        (3, 1, 1.216),
        (4, 1, 1.414),
        (5, 1, 1.547),
        (6, 1, 1.724),
        (2, 5, 1.267),
        (3, 6, 1.525),
        (4, 12, 2),
    ],
)
def test_an_orthogonal_ccd_has_uncorrelated_squares(d, centres, published):
    # Khuri & Cornell 1996, table 4.5 and Myers, Montgomery & Anderson-Cook 2009, table 8.4, to the printed digits.
    a = star_distance(d, "circumscribed", "orthogonal", centres)
    assert abs(a - published) < 6e-4

    def correlation(X):
        coded = np.vstack([(2 * X - 1) * a, np.zeros((centres - 1, d))])  # a repeated centre counts in least squares
        squares = coded**2 - np.mean(coded**2, axis=0)
        return np.abs(np.triu(squares.T @ squares, 1)).max()

    assert correlation(central_composite(d, "circumscribed", "orthogonal", centres)) < 1e-12 * 100
    assert correlation(central_composite(d, "circumscribed", a + 0.1, centres)) > 0.1  # negative control


def test_an_unknown_alpha_or_number_of_centres_is_refused():
    assert star_distance(3, "inscribed", "rotatable") == star_distance(3)
    for alpha, centres, words in (("orthagonal", 1, "rotatable, orthogonal"), (None, 0, "1 to 100 centres")):
        with pytest.raises(ValueError, match=words):
            star_distance(3, "inscribed", alpha, centres)


@pytest.mark.parametrize("d,runs", [(3, 13), (4, 25), (5, 41), (6, 49), (7, 57)])
def test_box_behnken_counts_and_balance(d, runs):
    X = 2 * box_behnken(d) - 1
    assert len(X) == runs == len(np.unique(X, axis=0))
    assert not np.any(np.all(np.abs(X) == 1, axis=1))
    assert np.array_equal(X.sum(0), np.zeros(d))
    assert len(set((X**2).sum(0))) == 1


def test_factorial():
    assert np.array_equal(np.unique(factorial(2, 9)), [0, 0.5, 1])
    assert len(np.unique(factorial(2, levels=(2, 5)), axis=0)) == 10


@pytest.mark.parametrize(
    "kind,d,runs,words",
    [
        ("lloyd", 2, 5, "choose one of"),
        ("lhs", 2, 1, "runs >= 2"),
        ("sobol", 2, None, "runs >= 2"),
        ("factorial", 3, 20, r"\[8, 27, 64\]"),
        ("ccd", 2, 20, "has 9 runs, not 20"),
        ("ccd", 9, None, "2 to 8"),
        ("ccd", 1, None, "2 to 8"),
        ("box_behnken", 2, None, "3 to 7"),
    ],
)
def test_impossible_counts_are_refused_with_the_possible_ones(kind, d, runs, words):
    with pytest.raises(ValueError, match=words):
        design(kind, d, runs, 0)


def test_extend_goes_where_the_gap_is():
    # With all corners but one taken, the farthest point of the square is the last corner.
    existing = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(extend(existing, 1, 0), [[1, 1]], atol=1e-12)  # clipped to the face, exact
    X = design("lhs", 3, 20, 1)
    new = extend(X, 10, 2)
    assert np.array_equal(new, extend(X, 10, 2))
    random = np.random.default_rng(0).random((10, 3))
    assert pdist(np.vstack([X, new])).min() > pdist(np.vstack([X, random])).min()
    assert pdist(np.vstack([X, new])).min() >= pdist(X).min()


BOX = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.006, 1.0), (0.015, 160.0), (False, True))


def test_box_maps_both_ways_and_hits_its_ends_exactly():
    X = np.random.default_rng(0).random((50, 2))
    theta = BOX.from_unit(X)
    assert BOX.contains(theta).all()
    np.testing.assert_allclose(BOX.to_unit(theta), X, atol=1e-14)  # a few roundings of numbers up to 1
    ends = BOX.from_unit(np.array([[0.0, 0.0], [1.0, 1.0]]))
    assert np.array_equal(ends, [BOX.low, BOX.high])
    assert np.array_equal(BOX.to_unit(ends), [[0, 0], [1, 1]])
    # The middle of a log scale is the geometric mean: pow and sqrt agree to rounding.
    np.testing.assert_allclose(BOX.from_unit(np.array([0.5, 0.5])), [0.0105, np.sqrt(160)], rtol=1e-14)
    assert not BOX.contains(np.array([0.016, 10.0]))


def test_box_refuses_nonsense():
    with pytest.raises(ValueError, match="low < high"):
        Box(("a",), ("1",), (1.0,), (1.0,), (False,))
    with pytest.raises(ValueError, match="low > 0"):
        Box(("a",), ("1",), (0.0,), (1.0,), (True,))
    with pytest.raises(ValueError, match="D1 must be > 0"):
        BOX.to_unit(np.array([0.01, -1.0]))
    with pytest.raises(ValueError, match="expected 2 values"):
        BOX.from_unit(np.zeros((4, 3)))


def test_slope_of_the_box_is_its_derivative():
    X, h = np.random.default_rng(1).random((20, 2)), 1e-6
    for j in range(2):
        step = h * np.eye(2)[j]
        difference = (BOX.from_unit(X + step) - BOX.from_unit(X - step))[:, j] / (2 * h)
        np.testing.assert_allclose(BOX.slope(X)[:, j], difference, rtol=1e-7)  # h² and rounding/h


@pytest.mark.parametrize("alpha", [None, 1.3])
def test_a_circumscribed_design_has_its_corners_at_the_ends_of_the_ranges(alpha):
    wide = BOX.widened(star_distance(2, "circumscribed", alpha))
    theta = wide.from_unit(central_composite(2, "circumscribed", alpha))
    corners = theta[:4]
    np.testing.assert_allclose(corners.min(0), BOX.low, rtol=1e-12)  # a few roundings
    np.testing.assert_allclose(corners.max(0), BOX.high, rtol=1e-12)
    assert np.all(theta[4:8].min(0) < BOX.low) and np.all(theta[4:8].max(0) > BOX.high)


# ------------------------------------------------------------------------------------------------------ extension


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("d", [1, 3])
def test_a_latin_hypercube_extended_by_a_multiple_stays_latin(d, times):
    X = design("lhs", d, 8, 0)
    new = extend_latin(X, 8 * times, 1)
    assert is_latin(np.vstack([X, new])) and np.array_equal(new, extend_latin(X, 8 * times, 1))
    assert not is_latin(np.vstack([X, design("lhs", d, 8 * times, 1)]))  # negative control


def test_a_latin_extension_by_any_number_has_rows_of_its_own():
    X = design("lhs", 2, 10, 0)
    new = extend_latin(X, 7, 1)
    for old, column in zip(X.T, new.T, strict=True):
        rows = np.floor(column * 17).astype(int)
        assert len(set(rows)) == 7 and not set(rows) & set(np.floor(old * 17).astype(int))


def test_sobol_goes_on_with_its_sequence():
    X = design("sobol", 3, 12, 4)
    assert np.array_equal(np.vstack([X, extend_design("sobol", X, 9, 4)]), design("sobol", 3, 21, 4))
    with pytest.raises(ValueError, match="not the beginning"):
        extend_design("sobol", X[::-1], 9, 4)


# ------------------------------------------------------------------------------------------------------ constraints


def triangle(X):
    return X.sum(axis=1) < 1


@pytest.mark.parametrize("kind", ["lhs", "sobol", "osf"])
def test_designs_keep_to_constraints_and_repeat_to_the_bit(kind):
    X = design(kind, 2, 20, 3, feasible=triangle)
    assert X.shape == (20, 2) and triangle(X).all() and X.min() >= 0
    assert len(np.unique(X, axis=0)) == 20 and np.array_equal(X, design(kind, 2, 20, 3, feasible=triangle))
    new = extend_design(kind, X, 10, 3, triangle)
    assert triangle(new).all() and pdist(np.vstack([X, new])).min() > 1e-4
    assert not triangle(design(kind, 2, 20, 3)).all()  # negative control


def test_a_constraint_that_a_latin_hypercube_can_meet_leaves_it_latin():
    def most(X):
        return X[:, 0] < X[:, 1] + 0.4

    X = design("lhs", 2, 30, 0, feasible=most)
    assert most(X).all() and is_latin(X)
    assert not is_latin(design("lhs", 2, 30, 0, feasible=triangle))  # impossible: both means would be a half


def test_structured_designs_and_constraints():
    X = design("factorial", 2, 9, 0, feasible=lambda X: X.sum(axis=1) <= 1)
    assert len(X) == 6
    with pytest.raises(ValueError, match="3 of the 9 points of ccd violate"):
        design("ccd", 2, None, 0, star="face", feasible=lambda X: X.sum(axis=1) <= 1)
    with pytest.raises(ValueError, match="less than 1 %"):
        design("lhs", 2, 10, 0, feasible=lambda X: X[:, 0] < 1e-5)


def test_conditions_are_read_and_say_by_how_much_they_are_violated():
    theta = {"mu": np.array([0.01, 0.02]), "D1": np.array([50.0, 200.0])}
    assert np.array_equal(read_condition("mu * D1 <= 2", ("mu", "D1")).holds(theta), [True, False])
    np.testing.assert_allclose(read_condition("mu * D1 <= 2", ("mu", "D1")).excess(theta), [-1.5, 2.0], rtol=1e-12)
    assert np.array_equal(read_condition("1 < D1 / 10 < 10", ("mu", "D1")).holds(theta), [True, False])
    assert np.array_equal(read_condition("sqrt(mu - 0.015) >= 0", ("mu", "D1")).holds(theta), [False, True])
    assert not read_condition("D1 > 50", ("mu", "D1")).holds(theta)[0]  # strict
    assert np.array_equal(read_condition("1 < 2 <= D1 / 50", ("mu", "D1")).holds(theta), [False, True])


@pytest.mark.parametrize(
    "text",
    [
        "mu",
        "mu == 1",
        "nu < 1",
        "__import__('os').system('true') < 1",
        "mu.real < 1",
        "mu[0] < 1",
        "1 < 2",
        "mu <",
        "(lambda: mu)() < 1",
        "mu < 1 and mu > 0",
        "mu < True",
        "open(mu) < 1",
        "mu < 1e400",
        "mu < '1'",
        "(" * 150,
        "mu < " + "9" * 400,
    ],
)
def test_whatever_is_no_inequality_is_refused_and_not_executed(text):
    with pytest.raises(ValueError):
        read_condition(text, ("mu", "D1"))


HALTON = """
from scipy.stats import qmc
from rso.doe.farthest import extend_by
from rso.doe.sampler import Sampler, enough
SAMPLER = Sampler(
    "halton", "Halton", lambda t: qmc.Halton(t.d, rng=t.seed).random(enough("halton", t)), extend_by, free=True
)
"""


def test_a_file_is_all_that_a_sampler_takes(tmp_path, monkeypatch):
    (tmp_path / "halton_of_a_user.py").write_text(HALTON, encoding="utf-8")
    monkeypatch.setattr(samplers, "__path__", [*samplers.__path__, str(tmp_path)])
    found = registry._found()
    assert set(found) == {*SAMPLERS, "halton"}
    monkeypatch.setattr("rso.doe.SAMPLERS", found)
    X = design("halton", 3, 16, 5)
    assert X.shape == (16, 3) and X.min() >= 0 and X.max() <= 1
    assert extend_design("halton", X, 2, 5).shape == (2, 3)
    with pytest.raises(ValueError, match="halton needs runs >= 2"):
        design("halton", 3, None, 5)
