"""Sudden jumps are found whichever way they go, and neither scatter nor a bending curve counts as one."""

import dataclasses

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.data import Repeat
from rso.discrepancy import make_test_plan
from rso.discrepancy.detectors.jumps import jumps
from rso.discrepancy.detectors.steps import step_statistics


@pytest.fixture(autouse=True, scope="module")
def inverses_once():
    """Records of equal depths share their windows, and so these matrices: each is inverted once, to the same bits."""
    known, invert = {}, np.linalg.pinv

    def inverse(A):
        key = A.shape, A.tobytes()
        if key not in known:
            known[key] = invert(A)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.linalg, "pinv", inverse)
        yield


def plan_with(change, seed: int = 0, repeats: int = 5):
    rng = np.random.default_rng(seed)
    recorded = toy.recorded(toy.TRUTH, rng, readings=50, repeats=repeats)
    new = [
        dataclasses.replace(r, channels={**r.channels, "Fz": change(r.depth, r.channels["Fz"], rng)}) for r in recorded
    ]
    return make_test_plan([toy.experiment("a", tuple(new))])


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_saw_tooth_is_found_and_its_sense_is_told(sense):
    def saw(u, F, rng):
        return F * (1 - sense * 0.12 * ((u / 0.5) % 1.0))

    found = jumps(plan_with(saw))
    assert found.sudden and np.sign(found.z) == sense and found.experiment == "a"
    assert np.sign(found.size) == sense and len(found.depths) == 5
    # the largest jumps are at multiples of 0.5 mm, to one spacing of the readings
    far = np.abs(np.array(found.depths) - 0.5 * np.round(np.array(found.depths) / 0.5))
    assert np.median(far) < 0.1


def test_steps_that_are_ordinary_in_other_records_are_no_jumps_of_a_quiet_one():
    """Four steps of one σ of the other four records, in a record that scatters by a hundredth of it."""

    def stairs(u, F, rng):
        σ, stairs.calls = 0.02 * F.max(), stairs.calls + 1
        if stairs.calls > 1:
            return F.max() * u / u.max() + σ * rng.standard_normal(len(u))
        up = np.searchsorted([0.8, 1.6, 2.4, 3.2], u)
        return F.max() * u / u.max() + σ * (up + 0.01 * rng.standard_normal(len(u)))

    found = []
    for seed in range(10):
        stairs.calls = 0
        found.append(jumps(plan_with(stairs, seed)).sudden)
    assert sum(found) <= 1


def test_one_crack_is_found():
    assert jumps(plan_with(lambda u, F, rng: F - 0.2 * F.max() * (u > 2.6))).sudden


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_one_small_crack_in_one_of_five_records_is_found_where_it_is(sense):
    """Nine times what readings scatter by: too little for the skewness of all steps."""

    def crack(u, F, rng):
        crack.calls += 1
        there = crack.calls == 3
        return F + sense * 0.09 * F.max() * (u > 2.6) * there

    found = []
    for seed in range(20):
        crack.calls = 0
        found.append(jumps(plan_with(crack, seed)))
    there = [j.crack for j in found if j.crack is not None]
    assert len(there) > 12 and all(j.sudden for j in found if j.crack is not None)
    assert sum(j.skewed for j in found) < 10
    assert all(np.sign(c.size) == sense and abs(c.depth - 2.6) < 0.1 and c.experiment == "a" for c in there)


def test_a_ball_that_snaps_in_at_contact_is_no_crack():
    """Adhesion is in the catalogue; the same step deeper is one."""
    rng, found = np.random.default_rng(7), {}
    for at in (0.0, 2.0):
        u = np.linspace(-1.0, 4.0, 61)
        F = 0.05 * np.maximum(u, 0.0) ** 1.5 - 0.03 * (u > at) + 0.002 * rng.standard_normal(61)
        r = dataclasses.replace(toy.recorded(toy.TRUTH, rng, readings=61)[0], depth=u, channels={"Fz": F})
        found[at] = jumps(make_test_plan([toy.experiment("a", (r,))])).crack
    assert found[0.0] is None and found[2.0] is not None and abs(found[2.0].depth - 2.0) < 0.1


@pytest.mark.parametrize("spacing", [0.0, 0.9])
def test_neither_one_wild_reading_nor_uneven_depths_are_a_crack(spacing):
    """A step of the depth is one of the force too; a reading far out goes up and down again."""

    def uneven(u, F, rng):
        e = 0.005 * F.max() * rng.standard_normal(len(u))
        e[20] += 0.07 * F.max()
        return F + e

    for seed in range(20):
        plan = plan_with(uneven, seed)
        assert jumps(plan).crack is None
    rng = np.random.default_rng(5)
    u = np.sort(rng.uniform(0.1, 4.0, 40))
    u[20:] += spacing
    z, least, _, _ = step_statistics(u, 0.05 * u**1.5 + 0.003 * rng.standard_normal(40))
    assert least.max() / (1.48 * np.median(np.abs(z))) < 4.0


def test_a_slip_every_millimetre_is_found():
    """Slips of 6 % of the force, few of which stand out of the scatter of single steps: their number shows them."""

    def slips(u, F, rng):
        return F + 0.06 * F.max() * (u % 1.0) + 0.005 * F.max() * rng.standard_normal(len(u))

    assert sum(jumps(plan_with(slips, seed, repeats=8)).sudden for seed in range(20)) > 15


@pytest.mark.parametrize("plans", [100, pytest.param(400, marks=pytest.mark.verification)])
@pytest.mark.parametrize("tail", [3.0, np.inf])
def test_alarms_of_scatter_are_as_rare_as_said(tail, plans):
    """At most 1 % of many plans of scatter alone, with tails of Student's t of 3 degrees of freedom or normal ones.

    Root mean square of t 1 at most: it is a normal variable but for steps up and down again, of which heavy tails have
    more, and for what is taken out as smooth.
    """

    def scatter(u, F, rng):
        e = rng.standard_t(tail, len(u)) if np.isfinite(tail) else rng.standard_normal(len(u))
        return F + 0.01 * F.max() * e

    found = [jumps(plan_with(scatter, seed)) for seed in range(plans)]
    assert np.mean([j.sudden for j in found]) <= 0.01
    assert (0.6 if np.isfinite(tail) else 0.7) < np.sqrt(np.mean([j.t**2 for j in found])) < 1.1


def coloured(u, F, rng, ρ=0.85):
    e = rng.standard_normal(len(u))
    for k in range(1, len(u)):
        e[k] = ρ * e[k - 1] + np.sqrt(1 - ρ**2) * e[k]
    return F + 0.01 * F.max() * e


def wave(u, F, rng):
    return F + 0.03 * np.sin(5 * u) * F.max()


@pytest.mark.parametrize("change", [lambda u, F, rng: F, coloured, wave])
def test_scatter_and_waves_are_no_jumps(change):
    assert not any(jumps(plan_with(change, seed)).sudden for seed in range(25))


def test_too_few_readings_say_nothing():
    rng = np.random.default_rng(0)
    found = jumps(make_test_plan([toy.experiment("a", toy.recorded(toy.TRUTH, rng, readings=9))]))
    assert found.n == 0 and not found.sudden


LONG = pytest.mark.verification


@pytest.mark.parametrize("share", [0.004, pytest.param(0.01, marks=LONG), 0.02, pytest.param(0.04, marks=LONG), 0.08])
@pytest.mark.parametrize("noise", [0.0, 0.15, 0.4])
def test_counts_of_a_coarse_sensor_are_no_jumps(share, noise):
    """Readings in steps of a share of the largest force, of a sensor that scatters by a share of such a step."""

    def counted(u, F, rng):
        step = share * F.max()
        return step * np.round((F + noise * step * rng.standard_normal(len(u))) / step)

    assert not any(jumps(plan_with(counted, seed)).sudden for seed in range(20))


def test_slips_show_in_a_coarse_sensor():
    def slips(u, F, rng):
        slipped = F * (1 - 0.12 * ((u / 0.5) % 1.0)) + 0.003 * F.max() * rng.standard_normal(len(u))
        return 0.01 * F.max() * np.round(slipped / (0.01 * F.max()))

    assert all(jumps(plan_with(slips, seed)).sudden for seed in range(20))


def plan_of(records):
    each = [Repeat("1", u, None, {"Fz": F}, {}, np.full(len(u), "loading")) for u, F in records]
    return make_test_plan([toy.experiment(f"e{k}", (r,)) for k, r in enumerate(each)])


def ball(u):
    return 0.05 * u**1.5 * (1.0 + 0.1 * u)


def loops_of(force, seed: int, noise: float = 0.005, n: int = 60):
    """Five records that are pressed and come back; `force` of the travel (2 n − 1,) and number of a record."""
    rng, records = np.random.default_rng(seed), []
    d = np.linspace(0.0, 4.0, n + 1)[1:]
    u, branch = np.r_[d, d[-2::-1]], np.r_[np.full(n, "loading"), np.full(n - 1, "unloading")]
    for k in range(5):
        F = force(u, n, k)
        F = F + noise * F.max() * rng.standard_normal(len(u))
        records.append(toy.experiment(f"e{k}", (Repeat("1", u, None, {"Fz": F}, {}, branch),)))
    return make_test_plan(records)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_step_of_an_unloading_is_found_with_its_sign(sense):
    """The zero of a cell that jumps while the indenter comes back, sixteen times what readings scatter by."""

    def jumped(u, n, k):
        return ball(u) + sense * 0.08 * ball(4.0) * (k == 2) * (np.arange(len(u)) >= n + n // 2)

    found = [jumps(loops_of(jumped, seed)).crack for seed in range(6)]
    there = [c for c in found if c is not None]
    assert len(there) >= 4 and {(c.experiment, c.branch) for c in there} == {("e2", "unloading")}
    assert all(np.sign(c.size) == sense and abs(c.depth - 2.0) < 0.2 for c in there)


def came_back_late(u, n, k):
    """Play of a drive, of a tenth of the travel: the force waits at the turn."""
    return ball(np.r_[u[:n], np.minimum(u[n - 1], u[n:] + 0.4)])


def rubbed(u, n, k):
    """A loop of friction that turns round within a fiftieth of the travel."""
    return ball(u) * (1.0 + 0.1 * np.r_[np.ones(n), 2.0 * np.exp(-(u[n - 1] - u[n:]) / 0.08) - 1.0])


def stuck(u, n, k):
    """A body that draws at the ball the more the smaller the contact."""
    return ball(u) - 0.1 * ball(4.0) * np.exp(-u / 0.3) * (np.arange(len(u)) >= n)


@pytest.mark.parametrize("force", [came_back_late, rubbed, stuck, lambda u, n, k: ball(u)])
@pytest.mark.parametrize("noise", [1e-5, 0.005])
def test_what_bends_an_unloading_is_no_step(force, noise):
    assert not any(jumps(loops_of(force, seed, noise)).crack for seed in range(5))


@pytest.mark.parametrize("n", [41, 201])
def test_rows_that_were_lost_are_no_jumps(n):
    """The force goes on where they were: a step twice as long, always upwards."""
    for seed in range(5):
        rng, records = np.random.default_rng(seed), []
        for _ in range(5):
            u = np.delete(np.linspace(0.0, 4.0, n), rng.choice(np.arange(3, n - 3), max(2, n // 25), replace=False))
            records.append((u, ball(u) + 5e-4 * rng.standard_normal(len(u))))
        assert not jumps(plan_of(records)).skewed


@pytest.mark.parametrize("n", [41, 201])
@pytest.mark.parametrize("share", [0.005, 0.01])
def test_scatter_in_proportion_to_the_force_is_no_crack_and_one_in_it_is_seen(n, share):
    found, u = [], np.linspace(0.0, 4.0, n)
    for step in (0.0, 0.05):
        rng, found_here = np.random.default_rng(3), []
        for _ in range(8):
            noise = np.hypot(1e-3, share * ball(u)) * rng.standard_normal((5, n))
            torn = [ball(u) + e - step * (k == 2) * (u > 2.5) for k, e in enumerate(noise)]
            found_here.append(jumps(plan_of([(u, F) for F in torn])).crack is not None)
        found.append(sum(found_here))
    assert found[0] == 0 and found[1] > 4
