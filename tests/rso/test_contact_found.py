"""Contact found in the record of an approach: where it is, how sure, and what becomes of it in a study."""

import re
from itertools import product

import contact_records
import numpy as np
import pytest
import sample_studies as studies

from rso.data import ZERO_AT_CONTACT, Column, contact_point, read_measurement
from rso.data.contact_point import approached, begins_in_air, contact_onset, open_contact
from rso.data.files import header_aliases
from rso.study.loader import load_study

TRUE, AIR = 0.0, 2.0


def pressed(u, stiffens=0.1):
    """Force (N) of a ball that stiffens: no power of the depth."""
    u = np.maximum(u, 0.0)
    return 0.05 * u**1.5 * (1.0 + stiffens * u)


def record(rng, n=61, noise=0.003, start=-AIR, stiffens=0.1):
    u = np.linspace(start, 4.0, n)
    return u, pressed(u, stiffens) + noise * rng.standard_normal(n)


def write(path, head, *columns):
    path.write_text("\n".join([head, *(",".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True)), ""]))
    return path


@pytest.mark.parametrize(
    "noise, n, records",
    [
        *((noise, n, 15) for noise, n in ((1e-4, 121), (1e-3, 41), (4e-3, 41))),
        *(pytest.param(*case, 40, marks=pytest.mark.verification) for case in product((1e-4, 1e-3, 4e-3), (41, 121))),
    ],
)
def test_the_stated_deviation_is_what_the_contact_is_off_by(noise, n, records):
    """Of many records: errors over stated deviations, which hold what other bodies than this one would do, too."""
    rng = np.random.default_rng(3)
    found = [approached(*record(rng, n, noise)) for _ in range(records)]
    error, stated = (np.array([getattr(f, k) for f in found]) for k in ("depth", "deviation"))
    assert 0.15 < np.sqrt(np.mean((error - TRUE) ** 2) / np.mean(stated**2)) < 1.5
    assert np.mean(abs(error) < 2.5 * stated) > 0.9


def test_shifted_or_turned_axes_find_the_same_place():
    u, F = record(np.random.default_rng(0))
    a, b = approached(u, F), approached(u + 117.0, 3.0 * F + 0.4)
    np.testing.assert_allclose([b.depth - 117.0, b.deviation], [a.depth, a.deviation], atol=1e-9)


@pytest.mark.parametrize("start", [0.0, 0.2])
def test_a_record_that_begins_at_contact_shows_no_approach(start):
    rng = np.random.default_rng(1)
    for _ in range(50):
        with pytest.raises(ValueError, match=r"no approach is seen|too few"):
            approached(*record(rng, start=start, noise=1e-3))


STIFF = {  # from the first reading on, N: none of these is a later contact
    "exponential": lambda u: 0.01 * u**1.5 * np.exp(0.5 * u),
    "cubic": lambda u: 0.01 * u**3,
    "Fung": lambda u: 0.005 * (np.exp(1.2 * u) - 1.0 - 1.2 * u),
    "touched before": lambda u: pressed(u + 0.5) - pressed(np.array(0.5)),
}


@pytest.mark.parametrize("noise", [1e-5, pytest.param(1e-3, marks=pytest.mark.verification), 5e-3])
@pytest.mark.parametrize("body", STIFF)
def test_a_body_that_stiffens_much_is_no_later_contact(body, noise):
    rng, u = np.random.default_rng(7), np.linspace(0.0, 4.0, 401)
    assert not any(begins_in_air(u, STIFF[body](u) + noise * rng.standard_normal(401)) for _ in range(5))


@pytest.mark.parametrize("body", STIFF)
def test_nor_is_it_remarked_upon_as_one(tmp_path, body):
    u = np.linspace(0.0, 4.0, 401)
    F = STIFF[body](u) + 1e-3 * np.random.default_rng(7).standard_normal(401)
    assert not any(
        "the contact lies near" in d for d in read_measurement(write(tmp_path / "a.csv", "depth_mm,Fz_N", u, F)).doubts
    )


@pytest.mark.parametrize("air", [0.5, 2.0, 60.0])
def test_an_approach_of_any_length_is_seen_and_does_not_move_the_contact(air):
    rng, n, wide = np.random.default_rng(8), int(50 * (air + 4.0)), []
    for _ in range(5):
        u, F = record(rng, n, 1e-3, start=-air)
        found = approached(u, F)
        assert begins_in_air(u, F) and abs(found.depth - TRUE) < 3 * found.deviation
        wide.append(found.deviation)
    assert np.median(wide) < 0.2 / 3  # another body may not be excluded in one of them


def remembering(rng, n, rho, sd):
    e = sd * rng.standard_normal(n)
    e[1:] *= np.sqrt(1.0 - rho**2)
    for k in range(1, n):
        e[k] += rho * e[k - 1]
    return e


def test_noise_that_remembers_and_a_drift_are_in_the_deviation():
    """Taken as white the first states a third of its error, the second, 1 mN/mm, is off by four times that."""
    rng, u = np.random.default_rng(9), np.linspace(-AIR, 4.0, 121)
    found = [approached(u, pressed(u) + remembering(rng, 121, 0.9, 3e-3)) for _ in range(30)]
    assert np.mean([abs(f.depth) < 2.5 * f.deviation for f in found]) > 0.8
    u = np.linspace(-10.0, 4.0, 281)
    found = [approached(u, pressed(u) + 1e-3 * u + 1e-3 * rng.standard_normal(281)) for _ in range(10)]
    assert all(abs(f.depth) < 2.5 * f.deviation for f in found) and np.median([f.deviation for f in found]) < 0.04


def test_a_shape_that_does_not_fit_is_in_the_deviation():
    """Off by 0.29 mm, of which the scatter of the readings has 0.06."""
    rng, u = np.random.default_rng(14), np.linspace(-AIR, 4.0, 121)
    F = 0.0125 * np.maximum(u, 0.0) ** 1.5 * np.exp(0.6 * np.maximum(u, 0.0))
    found = [approached(u, F + 1e-3 * rng.standard_normal(121)) for _ in range(20)]
    assert np.mean([abs(f.depth) < 2.5 * f.deviation for f in found]) > 0.8
    assert np.mean([abs(f.depth) < 2.5 * f.scatter for f in found]) < 0.5


def test_the_contact_of_many_repeats_is_known_better_than_that_of_one(tmp_path):
    rng, u = np.random.default_rng(10), np.linspace(-AIR, 4.0, 121)
    files = [
        write(tmp_path / f"{k}.csv", "Displacement (mm),Force (N)", u, pressed(u) + noise)
        for k, noise in enumerate(0.005 * rng.standard_normal((9, 121)))
    ]
    # what the shape of one record leaves open does not average out
    assert 0.0 < read_measurement(files).contact < 0.85 * read_measurement(files[0]).contact


def test_repeats_of_one_test_all_count_from_contact_or_none_does(tmp_path):
    """Noise that hides the approach beyond doubt in some of them, alone."""
    rng, u = np.random.default_rng(10), np.linspace(-AIR, 4.0, 121)
    files = [
        write(tmp_path / f"{k}.csv", "Displacement (mm),Force (N)", u, pressed(u) + noise)
        for k, noise in enumerate(0.02 * rng.standard_normal((9, 121)))
    ]
    alone = [any("contact is found" in d for d in read_measurement(file).doubts) for file in files]
    assert any(alone) and not all(alone)
    m = read_measurement(files)
    np.testing.assert_allclose([r.depth.max() for r in m.repeats], 4.0, atol=0.5)
    assert sum("contact is found" in d for d in m.doubts) == len(files)
    flat = write(tmp_path / "flat.csv", "Displacement (mm),Force (N)", u[u >= 0] + 9.0, pressed(u[u >= 0]))
    with pytest.raises(ValueError, match=r"flat\.csv: .* begins in air, by other repeats: no approach is seen"):
        read_measurement([files[alone.index(True)], flat])


def test_a_position_without_an_approach_counts_from_its_first_reading(tmp_path):
    u = np.linspace(0.0, 4.0, 81)
    m = read_measurement(write(tmp_path / "a.csv", "Position (mm),Force (N)", u + 3.9, pressed(u)))
    np.testing.assert_allclose(m.repeats[0].depth, u, atol=1e-6)
    assert m.contact > 0 and any("from the first reading, at 3.9" in d for d in m.doubts)
    noisy = pressed(u - 0.5) + 0.02 * np.random.default_rng(11).standard_normal(81)  # 0, set by hand, is on its way
    assert (
        read_measurement(write(tmp_path / "c.csv", "Position (mm),Force (N)", u - 0.5, noisy)).repeats[0].depth[0]
        == -0.5
    )
    m = read_measurement(
        write(tmp_path / "b.csv", "Indentation (mm),Force (N)", u + 1.0, pressed(u + 1.0))
    )  # from contact by name
    assert m.repeats[0].depth[0] == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["Indentation (nm)", "Penetration (nm)", "Displacement (nm)"])
def test_a_travel_that_begins_in_air_counts_from_contact_whatever_its_name_says(tmp_path, name):
    """Nanoindenters call the piezo's travel less the bending indentation from the start of the record on."""
    rng, u = np.random.default_rng(3), np.linspace(-AIR, 4.0, 241)
    F = pressed(u) + 0.005 * pressed(u).max() * rng.standard_normal(241)
    m = read_measurement(write(tmp_path / "a.csv", f"{name},Load (uN)", (u + AIR) * 1e3, F))
    assert abs(m.repeats[0].depth.max() - 4e-3) < 3.0 * m.contact < 1e-3
    (said,) = [d for d in m.doubts if "contact is found" in d]
    assert "e+" not in said


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_an_indentation_with_an_approach_below_0_counts_from_its_own_0(tmp_path, noise):
    """Who set the 0 of an indentation where its force begins to rise knows it better than the shape of the force."""
    rng, u = np.random.default_rng(4), np.linspace(-AIR, 4.0, 241)
    F = pressed(u) + noise * pressed(u).max() * rng.standard_normal(241)
    m = read_measurement(write(tmp_path / "a.csv", "Indentation (mm),Load (N)", u, F))
    np.testing.assert_allclose(m.repeats[0].depth, u, atol=1e-6)
    assert m.contact == 0.0 and not [d for d in m.doubts if "contact is found" in d]


@pytest.mark.parametrize("rate", [3.0, 5.0])
def test_a_body_that_stiffens_from_the_first_reading_on_has_its_contact_there(rate):
    """A later contact leaves 4 to 20 000 times the squares, by a shape that does not fit and scatters the more."""
    u = np.linspace(0.0, 1.0, 60)
    assert open_contact(u, 0.01 * u**1.5 * np.exp(rate * u)) is None


def test_the_zero_of_a_machine_is_no_contact_that_its_record_doubts(tmp_path):
    """Half a millimetre in air of 4.5 mm under 3 % of noise is no approach beyond doubt, and no contact at 0 either."""
    rng, u = np.random.default_rng(5), np.linspace(-0.5, 4.0, 121)
    off, said = [], []
    for k in range(20):
        F = pressed(u) + 0.03 * pressed(u).max() * rng.standard_normal(121)
        m = read_measurement(write(tmp_path / f"{k}.csv", "Displacement (mm),Force (N)", u + 0.5, F))
        true = 4.0 - float(m.repeats[0].depth.max())  # where the contact is in what was read
        off.append(abs(true) / max(m.contact, 0.01 * 4.5))
        said += [any("contact is found" in d or "puts the contact" in d for d in m.doubts)]
    assert np.mean(said) > 0.8
    assert np.mean(np.array(off) < 1.645) > 0.8  # nine in ten of the 90 % intervals, less what 20 scatter by


def test_a_contact_at_the_zero_of_a_machine_stays_certain(tmp_path):
    rng, u = np.random.default_rng(6), np.linspace(0.0, 4.0, 121)
    for k in range(10):
        F = pressed(u) + 0.002 * pressed(u).max() * rng.standard_normal(121)
        m = read_measurement(write(tmp_path / f"{k}.csv", "Displacement (mm),Force (N)", u, F))
        assert m.contact == 0.0 and m.repeats[0].depth[0] == 0.0


def sensed(tmp_path, u, F):
    return read_measurement(write(tmp_path / "s.csv", "Position (mm),Force (N)", u, F))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_was_tared_on_the_way_and_spikes_turn_no_sign(sign):
    u, names = np.linspace(-AIR, 4.0, 121), ("depth", "Fz")
    spiked, wanted = pressed(u), list(names) if sign < 0 else []
    spiked[40] = -2.0
    tared = [pressed(u) + np.where(np.arange(121) < k, level, 0.0) for k, level in ((5, 2.0), (20, 2.0), (20, 0.4))]
    back = np.r_[pressed(u), pressed(u[::-1]) - 1.2 * (u[::-1] < 0) * np.exp(u[::-1])]  # it pulls more than it pressed
    for travel, F in [(u, F) for F in (spiked, *tared)] + [(np.r_[u, u[::-1]], back)]:
        columns = {"depth": sign * travel, "Fz": sign * F}
        assert header_aliases.reversed_columns(columns, np.full(len(F), "1"), names) == wanted


@pytest.mark.parametrize("last", [0.0, -AIR])
def test_a_way_back_alone_is_no_loading(tmp_path, last):
    u = np.linspace(4.0, last, 121)
    for travel in (4.0 - u, 36.0 - u, u):
        with pytest.raises(ValueError, match="unloading alone"):
            sensed(tmp_path, travel, pressed(u))


def test_the_zero_of_a_machine_is_found_in_each_repeat(tmp_path):
    """Position and force of a machine that counts otherwise: depth from contact, force without the tare."""
    rng = np.random.default_rng(2)
    u, F = record(rng, 121, 1e-3)
    files = [write(tmp_path / f"{k}.csv", "Pos (mm),F (N)", 50.0 + s - u, 0.3 - F) for k, s in enumerate((0.0, 0.7))]
    columns = {
        "depth": Column("Pos (mm)", flip=True, zero=ZERO_AT_CONTACT),
        "Fz": Column("F (N)", flip=True, zero=ZERO_AT_CONTACT),
    }
    m = read_measurement(files, columns)
    for r in m.repeats:
        np.testing.assert_allclose(r.depth, u, atol=4 * m.contact)
        np.testing.assert_allclose(r.channels["Fz"], F, atol=1e-3)  # the median of 40 readings of 1 mN
    assert 0.0 < m.contact < 0.05
    found = [float(re.search(r"found at (\S+) mm", d)[1]) for d in m.doubts if "0.3 N is taken off" in d]
    np.testing.assert_allclose(found, [50.0, 50.7], atol=0.1)  # as the file counts
    columns["depth"] = Column("Pos (mm)", flip=True, zero=50.0)
    own = read_measurement(files[0], columns)  # of which only the force is off by what the record says
    assert own.contact == 0.0 and abs(own.repeats[0].depth[0] + AIR) < 1e-6
    with pytest.raises(ValueError, match=r"zero = 'contact': no approach is seen"):
        read_measurement(
            write(tmp_path / "a.csv", "Pos (mm),F (N)", u[u >= 0], F[u >= 0]),
            {"depth": Column("Pos (mm)", zero=ZERO_AT_CONTACT), "Fz": Column("F (N)")},
        )


def test_a_file_of_customary_names_counts_from_contact_and_others_do_as_they_say(tmp_path):
    u, F = record(np.random.default_rng(4), 121, 1e-3)
    usual = read_measurement(write(tmp_path / "usual.csv", "Displacement (mm),Force (N)", u + 7.0, -F - 0.2))
    assert usual.contact > 0 and any(
        "contact is found at 7." in d or "contact is found at 6.9" in d for d in usual.doubts
    )
    np.testing.assert_allclose(usual.repeats[0].depth, u, atol=4 * usual.contact)
    own = read_measurement(write(tmp_path / "own.csv", "depth_mm,Fz_N", u + AIR, F))
    assert own.contact == 0.0 and own.repeats[0].depth[0] == 0.0
    assert any("the contact lies near" in d and "contact" in d for d in own.doubts)
    at = read_measurement(write(tmp_path / "at.csv", "Displacement (mm),Force (N)", u[u >= 0], F[u >= 0]))
    assert at.contact == 0.0 and at.repeats[0].depth[0] == u[u >= 0][0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_repeats_in_one_file_have_their_own_contact_and_all_one_sense(tmp_path, sign):
    """Tables beneath one another whose positions lie further apart than one of them is long."""
    rng = np.random.default_rng(6)
    tests = [(record(rng, 61, 1e-3), start) for start in (8.0, 25.0, 1.0)]
    table = [
        np.concatenate(v)
        for v in zip(*[(np.full(61, k), sign * (u + s), -F) for k, ((u, F), s) in enumerate(tests)], strict=True)
    ]
    m = read_measurement(write(tmp_path / "three.csv", "repeat,Position (mm),Load (N)", *table))
    assert len(m.repeats) == 3 and m.doubts[0].count("its sign turned") == (1 if sign > 0 else 2)
    for r, ((u, F), _) in zip(m.repeats, tests, strict=True):
        np.testing.assert_allclose(r.depth, u, atol=5 * m.contact)
        np.testing.assert_allclose(r.channels["Fz"], F, atol=1e-3)


def test_a_study_takes_what_the_contact_is_uncertain_by_unless_it_states_it(tmp_path):
    u, F = record(np.random.default_rng(5), 121, 1e-4)
    table = "\n".join(["Displacement (mm),Force (N)", *(f"{a:.5f},{b:.7f}" for a, b in zip(u + 9, F, strict=True))])
    for stated, wanted in ((None, True), ("0.2 mm", False)):
        noise = "" if stated is None else f'\nnoise = {{ contact = "{stated}" }}'
        folder = tmp_path / str(wanted)
        folder.mkdir()
        path = studies.write(folder, experiments=f'name = "top"\nrole = "fit"\ndata = "usual.csv"{noise}')
        (folder / "usual.csv").write_text(table)
        study = load_study(path)
        found = study.measurement("top").contact
        assert 0 < found < 0.05 and study.noise_of("top").contact == (found if wanted else 0.2)


HEADS = {  # what machines write, and how often u, F, t stand in it
    "Time (Sec),Extension (mm),Load (N)": "tuF",
    "Time_S,Position (mm),Load (N)": "tuF",
    "Elapsed Time,Disp,Load\nSec,mm,N": "tuF",
    "Time (s),Extension (mm),Extension (%),Load (N)": "tuuF",
    "Time (s),Position (mm),Position (mm/s),Force (g),Force (N)": "tutFF",
    "Time (s),Position (mm),Load (N),Load (N/mm2)": "tuFt",
}


@pytest.mark.parametrize("head", HEADS)
def test_columns_of_another_kind_are_no_rivals_and_units_of_time_may_be_in_capitals(tmp_path, head):
    u, F = record(np.random.default_rng(12), 121, 1e-4)
    t = np.arange(121.0)
    r = read_measurement(write(tmp_path / "a.csv", head, *({"t": t, "u": u, "F": F}[k] for k in HEADS[head]))).repeats[
        0
    ]
    np.testing.assert_allclose(r.time, t)
    np.testing.assert_allclose(r.depth, u, atol=0.05)
    np.testing.assert_allclose(r.channels["Fz"], F, atol=1e-3)


def test_lateral_forces_of_a_record_that_begins_in_air_are_zero_there(tmp_path):
    u, F = record(np.random.default_rng(13), 121, 1e-4)
    m = read_measurement(write(tmp_path / "a.csv", "Displacement (mm),Force (N),Fx_N", u + 7.0, F + 0.3, 0.1 * F - 0.2))
    np.testing.assert_allclose(m.repeats[0].channels["Fx"], 0.1 * F, atol=1e-3)
    assert any("depth, Fx, Fz count from there" in d for d in m.doubts)


def test_what_is_refused_after_its_sign_was_turned_says_so(tmp_path):
    u = np.linspace(-AIR, 4.0, 121)
    with pytest.raises(ValueError, match=r"the sign of depth and Fz was turned"):
        sensed(tmp_path, -u, -pressed(u) - np.where(np.arange(121) < 30, 2.0, 0.0))


def test_a_contact_in_counts_is_said_in_counts(tmp_path):
    u, F = record(np.random.default_rng(0), noise=1e-3)
    path = write(tmp_path / "a.csv", "Step (steps),Load (N)", np.round((u + AIR) / 0.005), F)
    columns = {
        "depth": Column("Step (steps)", "0.005 mm", zero=ZERO_AT_CONTACT),
        "Fz": Column("Load (N)", zero=ZERO_AT_CONTACT),
    }
    (said,) = (d for d in read_measurement(path, columns).doubts if "contact is found" in d)
    place = re.search(r"found at ([\d.]+) × 0\.005 mm ± ([\d.]+) × 0\.005 mm", said)
    assert abs(float(place[1]) - AIR / 0.005) < 3.0 * float(place[2])


@pytest.mark.parametrize(("body", "before"), [("sphere", "creep"), ("flat end", "nothing"), ("cone", "drift")])
def test_what_shape_and_approach_leave_open_is_in_the_deviation(body, before):
    """By the scatter of a ball's fit alone a flat end is off by five standard deviations; more in the verification."""
    rng = np.random.default_rng(16)
    found = [contact_onset(*contact_records.record(rng, body, before)) for _ in range(12)]
    away = np.array([abs(f.depth) / f.deviation for f in found])
    assert np.mean(away < 2.5) > 0.8 and np.median([f.deviation for f in found]) < 0.2


def jkr(d, w=3e-5, R=5.0, E=4e-3):
    """Force (N) by Johnson, Kendall & Roberts over depths (n,) mm, stable branch; 0 beyond pull-off."""
    a = np.linspace(0.05, 3.0, 100_000)
    depth = a**2 / R - np.sqrt(2 * np.pi * w * a / E)
    force = 4 * E * a**3 / (3 * R) - np.sqrt(8 * np.pi * w * E * a**3)
    k = int(np.argmin(depth))
    return np.interp(d, depth[k:], force[k:])


@pytest.mark.parametrize("noise", [0.0, 1e-5, 4e-5])
def test_a_body_that_draws_the_indenter_in_is_touched_there(tmp_path, noise):
    """An adhesive record begins in air too, and its force falls before it rises."""
    down, up = np.linspace(-0.4, 0.5, 540), np.linspace(0.5, -0.5, 600)
    u = np.r_[down, up[1:]]
    force = np.r_[np.where(down >= 0.0, jkr(down), 0.0), np.where(up > -0.105, jkr(up), 0.0)[1:]]
    force = force + noise * np.random.default_rng(5).standard_normal(len(u))
    m = read_measurement(write(tmp_path / "a.csv", "Position (mm),Load (mN)", u + 0.4, 1e3 * force))
    assert abs(float(m.repeats[0].depth.max()) - 0.5) < 0.002  # a step is 0.0017
    assert not any("Depth must count from contact" in d for d in m.doubts)


@pytest.mark.parametrize(("share", "noise"), [(0.02, 1e-6), (0.05, 4e-6), (0.08, 4e-6)])
def test_a_small_pull_is_seen_where_noise_allows_it_and_said(tmp_path, share, noise):
    """As a ball without adhesion a pull of 5 % of the range puts the contact 0.05 mm, several deviations, too deep."""
    w = share * 4.1e-3 / (8 / 9 * 1.5 * np.pi * 5.0)  # by which the force falls at contact, of 4.1 mN
    u = np.linspace(-0.5, 0.5, 300)
    force = np.where(u >= 0.0, jkr(np.maximum(u, 0.0), w), 0.0)
    for seed in range(3):
        noisy = force + noise * np.random.default_rng(seed).standard_normal(300)
        m = read_measurement(write(tmp_path / "a.csv", "Position (mm),Load (mN)", u + 0.5, 1e3 * noisy))
        assert abs(float(m.repeats[0].depth.max()) - 0.5) < 2.0 * m.contact < 0.03
        assert any("draws it in" in d for d in m.doubts)


@pytest.mark.parametrize("before", ["white", "remembers", "hum", "drifts", "relaxes"])
def test_what_a_force_does_in_air_is_no_pull(before):
    rng, n = np.random.default_rng(11), 300
    u = np.linspace(-1.0, 1.0, n)
    for size in (1e-4, 2e-3):
        extra = {
            "white": np.zeros(n),
            "remembers": remembering(rng, n, 0.9, 3.0 * size),
            "hum": 3.0 * size * np.sin(0.7 * np.arange(n)),
            "drifts": -2e-3 * u,
            "relaxes": 2e-3 * np.exp(-5.0 * (u + 1.0)),
        }[before]
        found = [
            contact_point.drawn_by(u, 0.03 * np.maximum(u, 0.0) ** 1.5 + extra + size * rng.standard_normal(n))
            for _ in range(5)
        ]
        assert found == [0.0] * 5


def test_a_force_that_slips_while_it_presses_is_no_jump_into_contact():
    u = np.linspace(0.0, 1.0, 200)
    force = u**1.5 - 0.3 * (u > 0.5)
    assert contact_point.jump_in(u, force) is None
    assert contact_point.jump_in(u, u**1.5) is None
    tared = np.maximum(u - 0.5, 0.0) ** 1.5 + 0.1 * (u < 0.2)  # in air: it falls and stays
    assert contact_point.jump_in(u, tared) is None


@pytest.mark.parametrize("drift", [0.0, 0.05, -0.05])
def test_a_force_that_drifts_in_air_is_tared_as_it_comes_to_contact(drift):
    """Half of the drift of the approach would be left as an error of zero by the middle of it."""
    rng = np.random.default_rng(8)
    u = np.linspace(-2.0, 1.0, 600)
    pure, size = pressed(u), float(pressed(np.array(1.0)))
    force = pure + size * (0.3 + drift * u / 2.0) + 0.003 * size * rng.standard_normal(600)
    _, own, _ = contact_point.zeroed(u, {"Fz": force}, np.ones(600, bool), ("depth", "Fz"))
    left = (force - own["Fz"])[0] - 0.3 * size
    # a line through 400 readings is known at its end to 2/√400 of their scatter; three of these
    assert abs(left) < 0.003 * size * 3 * 2 / 20
