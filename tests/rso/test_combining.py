"""What repeats, a single record and statements say about the errors of a curve, and how well they say it."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri

from rso.calibration.readings import as_data
from rso.core.distributions import student
from rso.data import Measurement, Noise, Repeat, combine
from rso.data.scatter import beyond_said, ratio_of, repeat_scatter
from rso.inference.identifiability import exceeded

U = np.linspace(0.1, 4.0, 40)
SETS = 80  # data sets; 200 in the long verification
NONE = {
    "gain": 0.0,
    "contact": 0.0,
    "correlation": 0.0,
}  # errors of the test as a whole: it is said that there are none


@pytest.fixture(autouse=True, scope="module", params=[80, pytest.param(200, marks=pytest.mark.verification)], ids=str)
def sets(request):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[__name__], "SETS", request.param)
        yield


def ball(u: np.ndarray) -> np.ndarray:
    return 0.14 * u**1.5 * (1 + 0.2 * u)


def measured(u: np.ndarray, curves, sigma=None) -> Measurement:
    stated = {} if sigma is None else {"Fz": sigma}
    rows = np.array(["loading"] * len(u))
    repeats = tuple(Repeat(str(k), u, None, {"Fz": y}, stated, rows) for k, y in enumerate(curves))
    return Measurement(Path("x.csv"), "force", repeats, ())


def fit(curve, shape):
    """a, its standard deviation and χ² of curve = a shape."""
    y, f = np.linalg.solve(np.linalg.cholesky(curve.covariance), np.stack([curve.value, shape], axis=1)).T
    a = float(y @ f / (f @ f))
    return a, float((f @ f) ** -0.5), float(np.sum((y - a * f) ** 2))


def trials(draw, noise=None, u=U, sigma=None, bend=0.0):
    """Share of p < 0.01 of the model a · shape, and coverage of a's 90 % intervals, over `SETS` data sets."""
    rng, refuted, held = np.random.default_rng(1), 0, 0
    shape = ball(u)
    for _ in range(SETS):
        curves = [y + bend * shape.max() * np.sin(6 * u) for y in draw(rng)]
        curve = combine(measured(u, curves, sigma), noise or Noise())
        a, sd, χ2 = fit(curve, shape)
        refuted += exceeded(χ2, len(u) - 1, curve.freedom) < 0.01
        held += abs(a - 1.0) <= ndtri(0.95) * student(curve.freedom) * sd
    return refuted / SETS, held / SETS


def white(r, sd=0.002, u=U):
    return lambda rng: [ball(u) + sd * rng.standard_normal(len(u)) for _ in range(r)]


@pytest.mark.parametrize("r", [1, 2, pytest.param(3, marks=pytest.mark.verification), 5])
def test_few_repeats_do_not_refute_the_true_model(r):
    """Nothing stated: of 200 data sets 2 ± 1.4 have p < 0.01, eight are four standard deviations above that.

    Intervals are too wide where the gain of the tests is known from few of them, and never too narrow: 0.90 ± 0.02 (of
    80 sets ± 0.03).
    """
    refuted, held = trials(white(r))
    assert refuted <= 0.04 and held >= 0.83
    assert trials(white(r), bend=0.02)[0] > 0.95  # the control: a wave of 2 % through noise of 0.1 % is found


def test_stated_noise_is_judged_as_stated():
    """Of white noise that is stated nothing is taken from the readings but where they scatter by clearly more."""
    refuted, held = trials(white(1), Noise(Fz=0.002, **NONE))
    assert refuted <= 0.04 and 0.83 <= held <= 0.97
    rng = np.random.default_rng(0)
    known = [combine(measured(U, white(1)(rng)), Noise(Fz=0.002)) for _ in range(SETS)]
    assert np.mean([np.isinf(c.freedom) for c in known]) > 0.9


STATED = {1.0: 1.0, 0.3: 1.0, 3.0: 1 / 9}  # what is right, too small, too large → χ² per degree of freedom
DAILY = {(1.0, 2), (0.3, 5), (3.0, 3)}


@pytest.mark.parametrize(
    "share, r",
    [
        pytest.param(share, r, marks=() if (share, r) in DAILY else pytest.mark.verification)
        for share in STATED
        for r in (2, 3, 5)
    ],
)
def test_noise_of_each_reading_counts_once_however_many_repeats_show_it(share, r):
    """χ² per degree of freedom of the true model: 1 where what is stated is right or too small, (σ/stated)² else.

    The mean over 200 data sets of 39 degrees of freedom is known to 2 %, over 80 to 3 %; what gain and contact of few
    tests are taken to scatter by takes up to two of the 39; a size known from the 37 degrees of freedom of two repeats
    makes it 37/35, and what of the scatter counts as correlated is missing in the white part.
    """
    rng = np.random.default_rng(2)
    noise = Noise(Fz=0.002 * share, **NONE)
    χ2 = [fit(combine(measured(U, white(r)(rng)), noise), ball(U))[2] for _ in range(SETS)]
    np.testing.assert_allclose(np.mean(χ2) / (len(U) - 1), STATED[share], rtol=0.15, atol=0)


@pytest.mark.parametrize("shape", [1 + 4 * ball(U) / ball(U).max(), 1 + 3 * (np.arange(len(U)) % 2), 0.5 + ball(U)])
@pytest.mark.parametrize("u", [U, U[::6]])
@pytest.mark.parametrize("share, overruled", [(1.0, (0.0, 0.15)), (0.25, (0.9, 1.0))])
def test_a_stated_shape_of_the_noise_is_overruled_by_its_size_alone(shape, u, share, overruled):
    """A right column is overruled in one data set of twenty, whatever its shape and however few its readings; one that
    is four times too small nearly always, and keeps its shape then."""
    rng, sd = np.random.default_rng(4), 0.002 * shape[: len(u)]
    taken = []
    for _ in range(100):
        curves = [ball(u) + sd * rng.standard_normal(len(u)) for _ in range(3)]
        slope = np.gradient(ball(u), u)
        each, said = (np.array(curves), ball(u), slope), (share * sd) ** 2
        beyond = beyond_said(repeat_scatter(*each)[0], ratio_of(*each, said), said).variance
        taken.append(beyond.max() > 0.0)
        if beyond.max() > 0.0:
            np.testing.assert_allclose(np.ptp(beyond / sd**2), 0.0, atol=1e-9 * np.max(beyond / sd**2))  # its shape
    assert overruled[0] <= np.mean(taken) <= overruled[1]


@pytest.mark.parametrize("share", [1.0, pytest.param(0.5, marks=pytest.mark.verification)])
@pytest.mark.parametrize("n, r, ρ", [(160, 3, 0.95), (40, 2, 0.9)])
def test_a_statement_of_white_noise_does_not_hide_that_repeats_remember(n, r, ρ, share):
    """90 % intervals of a parameter of three hold the truth in 0.72 at least (without the memory in 0.40 to 0.67)."""
    rng, u = np.random.default_rng(8), np.linspace(4.0 / n, 4.0, n)
    F = np.stack([u**1.5, u**2.5, u**3.5], axis=1)
    L = np.linalg.cholesky(ρ ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))))
    held = []
    for _ in range(SETS):
        curve = combine(
            measured(u, [F @ [0.1, 0.02, 0.0] + 0.002 * L @ rng.standard_normal(n) for _ in range(r)]),
            Noise(Fz=0.002 * share),
        )
        W = np.linalg.inv(np.linalg.cholesky(curve.covariance))
        C = np.linalg.inv((W @ F).T @ (W @ F))
        best = C @ (W @ F).T @ (W @ curve.value)
        held.append(abs(best[0] - 0.1) <= ndtri(0.95) * student(curve.freedom) * np.sqrt(C[0, 0]))
    assert np.mean(held) >= 0.72


def test_what_is_stated_of_each_reading_averages_out_in_blocks():
    """2000 readings, averaged by tens: χ² per point 1 if their own noise is stated, as a number or as a column."""
    u, rng = np.linspace(0.002, 4.0, 2000), np.random.default_rng(9)
    for noise, sigma in ((Noise(Fz=0.002, **NONE), None), (Noise(**NONE), np.full(2000, 0.002))):
        χ2 = []
        for _ in range(30):
            curve = combine(measured(u, [ball(u) + 0.002 * rng.standard_normal(2000)], sigma), noise)
            χ2.append(np.mean((curve.value - ball(curve.depth)) ** 2 / np.diag(curve.covariance)))
        np.testing.assert_allclose(np.mean(χ2), 1.0, rtol=0.1)  # 30 × 200 squares; some sets are overruled


def test_a_column_that_varies_counts_as_it_is_and_one_that_is_too_small_does_not():
    """Right columns are overruled in 5 % ± 1.5 % of records; one that is three times too small is in nearly all."""
    u = np.linspace(0.1, 4.0, 100)
    sigma = 0.0005 + 0.03 * ball(u)
    rng, kept, lifted = np.random.default_rng(2), 0, 0
    for _ in range(SETS):
        y = ball(u) + sigma * rng.standard_normal(len(u))
        kept += np.allclose(combine(measured(u, [y], sigma), Noise(**NONE)).sigma, sigma, rtol=1e-6, atol=0)
        lifted += np.median(combine(measured(u, [y], sigma / 3), Noise(**NONE)).sigma / sigma) > 0.6
    assert kept / SETS > 0.88 and lifted / SETS > 0.97


@pytest.mark.parametrize("r", [1, pytest.param(3, marks=pytest.mark.verification)])
def test_noise_in_proportion_to_the_force_is_found_to_be(r):
    """3 % of the force and 0.5 mN: intervals hold the truth, the deviation follows the force; even noise is even."""
    u = np.linspace(0.1, 4.0, 100)
    sigma = 0.0005 + 0.03 * ball(u)

    def draw(rng):
        return [ball(u) + sigma * rng.standard_normal(len(u)) for _ in range(r)]

    refuted, held = trials(draw, u=u)
    assert refuted <= 0.05 and held >= 0.82
    rng = np.random.default_rng(3)
    spread = [np.ptp(np.log(combine(measured(u, draw(rng)), Noise(**NONE)).sigma)) for _ in range(50)]
    assert np.median(spread) > 2.0
    even = [np.ptp(np.diag(combine(measured(u, white(1, u=u)(rng)), Noise(**NONE)).covariance)) for _ in range(SETS)]
    assert np.mean(np.array(even) < 1e-12) > 0.94  # 1 % for each of two terms, squares that hang together


@pytest.mark.parametrize("key, right", [("contact", True), ("depth", False)])
def test_a_contact_point_that_is_off_is_stated_as_contact(key, right):
    """Off by 0.03 mm, a standard deviation, of 200 records: 90 ± 2 % of the intervals hold with `contact`; white depth
    noise of that size averages out over 40 readings, and a χ² of a tenth per reading shows it."""
    rng, shape, held, χ2 = np.random.default_rng(5), ball(U), 0, []
    noise = Noise(Fz=0.002, **{**NONE, key: 0.03})
    for _ in range(SETS):
        y = ball(U + 0.03 * rng.standard_normal()) + 0.002 * rng.standard_normal(len(U))
        curve = combine(measured(U, [y]), noise)
        a, sd, left = fit(curve, shape)
        held += abs(a - 1.0) <= ndtri(0.95) * student(curve.freedom) * sd
        χ2.append(left / (len(U) - 1))
    assert (0.83 <= held / SETS <= 0.97 and np.mean(χ2) > 0.7) if right else (held / SETS < 0.6 and np.mean(χ2) < 0.3)


def test_what_channels_of_one_record_share_has_the_correlation_of_the_repeats():
    """Gains of 2 % common to Fz and Fx are shared; gains of their own hang together by chance; white noise does not."""
    u, rng, found = U, np.random.default_rng(6), {"same": [], "own": [], "white": []}
    for _ in range(SETS // 2):
        for kind, values in found.items():
            curves = {"Fz": [], "Fx": []}
            for _ in range(5):
                g = 0.02 * rng.standard_normal(2) * (kind != "white")
                g[1] = g[0] if kind == "same" else g[1]
                curves["Fz"].append((1 + g[0]) * ball(u) + 0.002 * rng.standard_normal(len(u)))
                curves["Fx"].append((1 + g[1]) * 0.5 * ball(u) + 0.002 * rng.standard_normal(len(u)))
            rows = np.array(["loading"] * len(u))
            repeats = [Repeat(str(k), u, None, {c: v[k] for c, v in curves.items()}, {}, rows) for k in range(5)]
            m = Measurement(Path("x.csv"), "force", tuple(repeats), ())
            z, x = combine(m, Noise(**NONE), "Fz"), combine(m, Noise(**NONE), "Fx")  # the usual parts are shared
            together = sum(z.shared[n][-1] * x.shared[n][-1] for n in set(z.shared) & set(x.shared))
            values.append(together / np.sqrt(z.covariance[-1, -1] * x.covariance[-1, -1]))
            assert np.linalg.eigvalsh(z.covariance - sum(np.outer(s, s) for s in z.shared.values())).min() > 0
    assert np.median(found["same"]) > 0.8
    assert abs(np.mean(found["own"])) < 0.2 and abs(np.mean(found["white"])) < 0.2


def test_a_gain_is_of_its_test_and_a_calibration_of_all():
    curve = combine(measured(U, [ball(U)]), Noise(Fz=0.002, gain=0.02, contact=0.01, correlation=0.0, calibration=0.03))
    keep = U > 1.0
    a, b = (as_data(n, n, curve, keep) for n in "ab")
    assert set(a.shared) & set(b.shared) == {"calibration"} and set(a.shared) - set(b.shared) == {
        "a: gain",
        "a: contact",
    }
    own = a.covariance - sum(np.outer(s, s) for s in a.shared.values())
    np.testing.assert_allclose(own, 0.002**2 * np.eye(keep.sum()), rtol=0, atol=1e-12)


def remembering(ρ, r, n=100, sd=0.002):
    u = np.linspace(0.1, 4.0, n)
    L = np.linalg.cholesky(ρ ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))))
    return u, lambda rng: [ball(u) + sd * L @ rng.standard_normal(n) for _ in range(r)]


@pytest.mark.parametrize(
    "ρ, r", [(0.9, 2), *(pytest.param(*v, marks=pytest.mark.verification) for v in ((0.9, 4), (0.5, 3)))]
)
def test_noise_that_remembers_is_seen_in_repeats(ρ, r):
    """AR(1) noise, nothing stated: 0.90 ± 0.02 of the intervals and more hold; as white noise a third is refuted."""
    u, draw = remembering(ρ, r)
    refuted, held = trials(draw, u=u)
    assert refuted <= 0.04 and held >= 0.83
    rng = np.random.default_rng(7)
    found = [combine(measured(u, draw(rng)), Noise()).covariance[50, 51] > 0.3 * 0.002**2 * ρ / r for _ in range(50)]
    assert np.mean(found) > 0.95


def test_white_noise_of_repeats_remembers_little():
    """Neighbours share 25 % of their variance in one data set of ten at most where no correlated error is usual."""
    rng, found = np.random.default_rng(8), []
    for _ in range(50):
        C = combine(measured(U, white(3)(rng)), Noise(**NONE)).covariance
        found.append(C[20, 21] / C[20, 20])
    assert np.mean(np.array(found) > 0.25) <= 0.1 and np.median(found) < 0.15


def test_what_is_usual_is_narrowed_by_repeats_that_do_not_show_it():
    """Of white noise alone less than the usual 0.2 % of the largest force counts as correlated.

    The more repeats there are, the less.
    """
    rng, largest = np.random.default_rng(8), ball(U).max()
    sizes = []
    for r in (1, 3, 10):
        C = combine(measured(U, white(r)(rng)), Noise(gain=0.0, contact=0.0)).covariance
        sizes.append(np.sqrt(C[20, 21]) / largest)
    assert 0.001 < sizes[0] <= 0.002 and np.all(np.diff(sizes) < 0)


@pytest.mark.parametrize("air", [0.0, 10.0, 30.0])
def test_a_long_approach_does_not_bend_what_gain_and_contact_change(air):
    """Shapes of a gain and a contact point, a degree 4 polynomial, beside the force and its slope."""
    u = np.linspace(-air, 4.0, 2001)
    force = np.maximum(u, 0.0) ** 1.5
    curve = combine(measured(u, [force]), Noise(gain=0.02, contact=0.1))
    for name, wanted in (
        ("gain", 0.02 * np.maximum(curve.depth, 0.0) ** 1.5),
        ("contact", 0.15 * np.sqrt(np.abs(curve.depth))),
    ):
        at = curve.depth > 0.5
        np.testing.assert_allclose(curve.shared[name][at], wanted[at], rtol=0.1)  # of the polynomial
