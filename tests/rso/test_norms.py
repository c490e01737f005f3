"""A curve from the norms of its distance to known curves: closed-form known curves, truths drawn from the prior."""

import numpy as np
import pytest

from rso.core.curves import baseline, metrics
from rso.norms import (
    Printed,
    TrilaterationProblem,
    TrilaterationShape,
    fit_trilateration,
    norm,
    sample_trilateration,
    shared_votes,
    trilateration_log_evidence,
)

U = np.arange(1, 41) / 10
K = 30
NOISE = 0.004
SHAPE = TrilaterationShape(U, 0.546, 0.0003)


def family(seed: int, bend: float) -> np.ndarray:
    """Known curves (K, 40): a stiffness and a flattening each, `bend` common to all."""
    rng = np.random.default_rng(seed)
    stiff, flat = rng.uniform(0.045, 0.1, (K, 1)), rng.uniform(0.0, 0.25, (K, 1))
    return stiff * U**1.5 * (1 - flat * np.sqrt(U / 4)) * (1 - bend * U / 4)


def problem(seed: int, made_with: float = 0.0, read_with: float = 0.0, kinds=("nrmse", "mre")):
    """Norms of one family against a truth drawn from the prior, to be read with another; the truth; the former."""
    rng = np.random.default_rng([seed, 5])
    y = SHAPE(rng.standard_normal((1, SHAPE.size)))[0]
    made = (1 + 0.012 * rng.standard_normal()) * family(seed, made_with)
    known = family(seed, read_with)
    printed = [Printed(k, np.arange(K), norm(k, y, made) + NOISE * rng.standard_t(4, K), 0.0003, 0.005) for k in kinds]
    printed.append(Printed("spread", 0, norm("spread", y, y[None]), 0.0003))
    return TrilaterationProblem(SHAPE, lambda ν: (1 + 0.012 * ν[:, :1, None]) * known, 1, tuple(printed)), y, made


def test_norms_are_those_of_the_literature():
    y, f = 0.1 * U**1.2, 0.09 * U**1.4
    m, b = metrics(y, f), baseline(y)
    for kind, value in (("nrmse", m.nrmse), ("mre", m.mre), ("rrmse", m.rrmse), ("spread", b.nrmse)):
        np.testing.assert_allclose(norm(kind, y, f[None]), value, rtol=1e-12)
    np.testing.assert_allclose(norm("mad", y, f[None]), np.mean(np.abs(y - y.mean())) / y.mean(), rtol=1e-12)


def test_points_at_zero_belong_to_the_absolute_norms_only():
    y, f = 0.1 * U**1.2, 0.09 * U**1.4
    y0, f0 = np.append(0.0, y), np.append(0.0, f)
    np.testing.assert_allclose(norm("nrmse", y, f[None], zeros=1), metrics(y0, f0).nrmse, rtol=1e-12)
    np.testing.assert_allclose(norm("spread", y, f[None], zeros=1), baseline(y0).nrmse, rtol=1e-12)
    mad = np.mean(np.abs(y0 - y0.mean())) / y0.mean()
    np.testing.assert_allclose(norm("mad", y, f[None], zeros=1), mad, rtol=1e-12)
    np.testing.assert_allclose(norm("mre", y, f[None], zeros=1), metrics(y, f).mre, rtol=1e-12)


def test_curves_of_the_prior_rise_and_end_where_they_must():
    z = np.random.default_rng(1).standard_normal((200, SHAPE.size))
    y = SHAPE(z)
    assert np.all(np.diff(y, axis=1) > 0) and np.all(y > 0)
    np.testing.assert_allclose(y[:, -1], 0.546 + 0.0003 * z[:, -1], rtol=1e-12)
    # ln p = ln 1.3 everywhere in the middle of the prior: a power law.
    np.testing.assert_allclose(SHAPE(np.zeros((1, SHAPE.size)))[0], 0.546 * (U / 4) ** 1.3, rtol=1e-9)
    # The slope has the stated spread (200 draws: 5 %), and the curve has the slope (linear interpolation, 1e-3).
    at, p = SHAPE.slopes(z)
    assert np.std(np.log(p), axis=0) == pytest.approx(0.35, rel=0.2)
    numeric = np.gradient(np.log(y[0]), np.log(U))[5:-5]
    np.testing.assert_allclose(numeric, np.interp(U[5:-5], at, p[0]), rtol=0.01)


def test_near_duplicates_share_one_vote():
    theta = np.array([[1.0, 10.0], [1.004, 10.5], [1.008, 10.9], [1.0, 20.0], [2.0, 10.0]])
    np.testing.assert_allclose(shared_votes(theta, (0.005, 0.06)), [1 / 3, 1 / 3, 1 / 3, 1, 1])  # a chain is a cluster


def test_known_curves_are_found_within_their_band():
    inside, error, ratio = [], [], []
    for seed in range(10):
        p, y, _ = problem(seed)
        found = fit_trilateration(p, seed, starts=2)
        drawn = p.shape(p.split(found.draws(1000, seed))[0])
        r = (drawn.mean(axis=0) - y)[:-1] / drawn.std(axis=0)[:-1]
        inside.append(np.abs(r) < 1.645)
        ratio.append(np.sqrt(np.mean(r**2)))
        error.append(np.max(np.abs(drawn.mean(axis=0) - y)))
    # 400 points but only some four independent ones a curve: 90 % with a standard deviation of about 5 %.
    assert 0.76 < np.mean(inside) <= 1.0
    assert 0.6 < np.median(ratio) < 1.4
    assert np.median(error) < 0.012  # of 0.546 N


def test_one_list_predicts_the_other():
    inside = []
    for seed in range(6):
        p, y, made = problem(seed, kinds=("nrmse",))
        found = fit_trilateration(p, seed, starts=2)
        other = Printed("mre", np.arange(K), norm("mre", y, made), 0.0003)
        drawn = p.predict(found.draws(1000, seed), [other])[0]
        inside.append(np.abs(drawn.mean(axis=0) - other.value) < 2.0 * np.hypot(drawn.std(axis=0), NOISE))
    assert np.mean(inside) > 0.8  # the norms of one truth go astray together


@pytest.mark.parametrize(("made", "other"), [(0.0, 0.2), (0.2, 0.0)])
def test_norms_of_other_curves_are_rejected(made, other):
    # Negative control: the right family has the higher evidence, and less is left over.
    gain, left = [], []
    for seed in range(3):
        right, wrong = problem(seed, made, made)[0], problem(seed, made, other)[0]
        a, b = fit_trilateration(right, seed, starts=2), fit_trilateration(wrong, seed, starts=2)
        gain.append(a.log_evidence - b.log_evidence)
        left.append(right.split(a.x[None])[2].sum() < wrong.split(b.x[None])[2].sum())
    assert np.min(gain) > 5.0 and all(left)


def test_gaussian_and_chain_agree():
    p, _, _ = problem(3)
    found = fit_trilateration(p, 0)
    a, x = p.shape(p.split(found.draws(2000, 1))[0]), sample_trilateration(p, found, 1, steps=500, burn=300, keep=1000)
    b = p.shape(p.split(x)[0])
    np.testing.assert_array_equal(*(sample_trilateration(p, found, 1, steps=20, burn=5, keep=50) for _ in range(2)))
    wide = b.std(axis=0)[:-1]
    assert np.max(np.abs(a.mean(axis=0) - b.mean(axis=0))[:-1] / wide) < 1.0
    assert np.median(a.std(axis=0)[:-1] / wide) == pytest.approx(1.0, abs=0.3)
    assert trilateration_log_evidence(p, x, found.log_posterior) == pytest.approx(found.log_evidence, abs=2.0)


def test_outliers_do_not_move_the_curve():
    p, _, _ = problem(2)
    q = p.printed[0]
    value = q.value.copy()
    value[4] += 0.1  # a slip of the pen
    spoiled = TrilaterationProblem(
        p.shape, p.known, 1, (Printed("nrmse", q.rows, value, q.sigma, q.scale), *p.printed[1:])
    )
    a, b = fit_trilateration(p), fit_trilateration(spoiled)
    y, z = (p.shape(p.split(f.x[None])[0])[0] for f in (a, b))
    sd = p.shape(p.split(a.draws(1000, 0))[0]).std(axis=0)
    assert np.max(np.abs(y - z)[:-1] / sd[:-1]) < 1.5


def test_misuse_is_told():
    with pytest.raises(ValueError, match="increasing positive"):
        TrilaterationShape(np.array([0.0, 1.0, 2.0]), 1.0, 0.1)
    with pytest.raises(ValueError, match="slope"):
        TrilaterationShape(U, 1.0, 0.1, slope=0.0)
    with pytest.raises(ValueError, match="no norm"):
        Printed("rmse", 0, 0.1, 0.001)
    with pytest.raises(ValueError, match="2 values"):
        Printed("mre", 0, [0.1, 0.2], 0.001)
    with pytest.raises(ValueError, match="sigma > 0"):
        Printed("mre", 0, 0.1, 0.0)
