"""Contact found in the record of an approach: where it is, how sure, and what becomes of it in a study."""

import re

import numpy as np
import pytest
import sample_studies as studies

from rso.measurement import CONTACT, Column, customary, read
from rso.measurement.contact import approached, begins_in_air
from rso.study import load

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


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 4e-3])
@pytest.mark.parametrize("n", [41, 121])
def test_the_stated_deviation_is_what_the_contact_is_off_by(noise, n):
    """200 records: errors over stated deviations, which hold the bias of bodies other than this one too."""
    rng = np.random.default_rng(3)
    found = [approached(*record(rng, n, noise)) for _ in range(200)]
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


@pytest.mark.parametrize("noise", [1e-5, 1e-3, 5e-3])
@pytest.mark.parametrize("body", STIFF)
def test_a_body_that_stiffens_much_is_no_later_contact(body, noise):
    rng, u = np.random.default_rng(7), np.linspace(0.0, 4.0, 401)
    assert not any(begins_in_air(u, STIFF[body](u) + noise * rng.standard_normal(401)) for _ in range(10))


@pytest.mark.parametrize("air", [0.5, 2.0, 60.0])
def test_an_approach_of_any_length_is_seen_and_does_not_move_the_contact(air):
    rng, n = np.random.default_rng(8), int(50 * (air + 4.0))
    for _ in range(5):
        u, F = record(rng, n, 1e-3, start=-air)
        found = approached(u, F)
        assert begins_in_air(u, F) and abs(found.depth - TRUE) < 3 * found.deviation < 0.2


def remembering(rng, n, rho, sd):
    e = sd * rng.standard_normal(n)
    e[1:] *= np.sqrt(1.0 - rho**2)
    for k in range(1, n):
        e[k] += rho * e[k - 1]
    return e


def test_noise_that_remembers_and_a_drift_are_in_the_deviation():
    """Taken as white the first states a third of its error, the second, 1 mN/mm, is off by four times that."""
    rng, u = np.random.default_rng(9), np.linspace(-AIR, 4.0, 121)
    found = [approached(u, pressed(u) + remembering(rng, 121, 0.9, 3e-3)) for _ in range(60)]
    assert np.mean([abs(f.depth) < 2.5 * f.deviation for f in found]) > 0.8
    u = np.linspace(-10.0, 4.0, 281)
    for _ in range(10):
        f = approached(u, pressed(u) + 1e-3 * u + 1e-3 * rng.standard_normal(281))
        assert abs(f.depth) < 2.5 * f.deviation < 0.1


def test_the_contact_of_many_repeats_is_known_better_than_that_of_one(tmp_path):
    rng, u = np.random.default_rng(10), np.linspace(-AIR, 4.0, 121)
    files = [write(tmp_path / f"{k}.csv", "Displacement (mm),Force (N)", u, pressed(u) + noise) for k, noise in
             enumerate(0.02 * rng.standard_normal((9, 121)))]  # fmt: skip
    assert read(files).contact < 0.6 * read(files[0]).contact


def test_a_position_without_an_approach_counts_from_its_first_reading(tmp_path):
    u = np.linspace(0.0, 4.0, 81)
    m = read(write(tmp_path / "a.csv", "Position (mm),Force (N)", u + 3.9, pressed(u)))
    np.testing.assert_allclose(m.repeats[0].depth, u, atol=1e-6)
    assert m.contact > 0 and any("from the first reading, at 3.9" in d for d in m.doubts)
    m = read(write(tmp_path / "b.csv", "Indentation (mm),Force (N)", u + 1.0, pressed(u + 1.0)))  # from contact by name
    assert m.repeats[0].depth[0] == pytest.approx(1.0)


def sensed(tmp_path, u, F):
    return read(write(tmp_path / "s.csv", "Position (mm),Force (N)", u, F))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_was_tared_on_the_way_and_spikes_turn_no_sign(sign):
    u, names = np.linspace(-AIR, 4.0, 121), ("depth", "Fz")
    spiked, wanted = pressed(u), list(names) if sign < 0 else []
    spiked[40] = -2.0
    tared = [pressed(u) + np.where(np.arange(121) < k, level, 0.0) for k, level in ((5, 2.0), (20, 2.0), (20, 0.4))]
    back = np.r_[pressed(u), pressed(u[::-1]) - 1.2 * (u[::-1] < 0) * np.exp(u[::-1])]  # it pulls more than it pressed
    for travel, F in [(u, F) for F in (spiked, *tared)] + [(np.r_[u, u[::-1]], back)]:
        columns = {"depth": sign * travel, "Fz": sign * F}
        assert customary.turned(columns, np.full(len(F), "1"), names) == wanted


@pytest.mark.parametrize("start", [4.0, 6.0])
def test_a_way_back_alone_is_no_loading(tmp_path, start):
    u = np.linspace(4.0, -AIR, 121)
    for travel in (start - u, u):
        with pytest.raises(ValueError, match="a way back alone"):
            sensed(tmp_path, travel, pressed(u))


def test_the_zero_of_a_machine_is_found_in_each_repeat(tmp_path):
    """Position and force of a machine that counts otherwise: depth from contact, force without the tare."""
    rng = np.random.default_rng(2)
    u, F = record(rng, 121, 1e-3)
    files = [write(tmp_path / f"{k}.csv", "Pos (mm),F (N)", 50.0 + s - u, 0.3 - F) for k, s in enumerate((0.0, 0.7))]
    columns = {"depth": Column("Pos (mm)", flip=True, zero=CONTACT), "Fz": Column("F (N)", flip=True, zero=CONTACT)}
    m = read(files, columns)
    for r in m.repeats:
        np.testing.assert_allclose(r.depth, u, atol=4 * m.contact)
        np.testing.assert_allclose(r.channels["Fz"], F, atol=1e-3)  # the median of 40 readings of 1 mN
    assert 0.0 < m.contact < 0.05
    found = [float(re.search(r"found at (\S+) mm", d)[1]) for d in m.doubts if "0.3 N is taken off" in d]
    np.testing.assert_allclose(found, [50.0, 50.7], atol=0.1)  # as the file counts
    with pytest.raises(ValueError, match=r"zero = 'contact': no approach is seen"):
        read(write(tmp_path / "a.csv", "Pos (mm),F (N)", u[u >= 0], F[u >= 0]),
             {"depth": Column("Pos (mm)", zero=CONTACT), "Fz": Column("F (N)")})  # fmt: skip


def test_a_file_of_customary_names_counts_from_contact_and_others_do_as_they_say(tmp_path):
    u, F = record(np.random.default_rng(4), 121, 1e-3)
    usual = read(write(tmp_path / "usual.csv", "Displacement (mm),Force (N)", u + 7.0, -F - 0.2))
    assert usual.contact > 0 and any(
        "contact is found at 7." in d or "contact is found at 6.9" in d for d in usual.doubts
    )
    np.testing.assert_allclose(usual.repeats[0].depth, u, atol=4 * usual.contact)
    own = read(write(tmp_path / "own.csv", "depth_mm,Fz_N", u + AIR, F))
    assert own.contact == 0.0 and own.repeats[0].depth[0] == 0.0
    assert any("the contact lies near" in d and "contact" in d for d in own.doubts)
    at = read(write(tmp_path / "at.csv", "Displacement (mm),Force (N)", u[u >= 0], F[u >= 0]))
    assert at.contact == 0.0 and at.repeats[0].depth[0] == u[u >= 0][0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_repeats_in_one_file_have_their_own_contact_and_all_one_sense(tmp_path, sign):
    """Tables beneath one another whose positions lie further apart than one of them is long."""
    rng = np.random.default_rng(6)
    tests = [(record(rng, 61, 1e-3), start) for start in (8.0, 25.0, 1.0)]
    table = [np.concatenate(v) for v in zip(*[(np.full(61, k), sign * (u + s), -F) for k, ((u, F), s) in
                                              enumerate(tests)], strict=True)]  # fmt: skip
    m = read(write(tmp_path / "three.csv", "repeat,Position (mm),Load (N)", *table))
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
        study = load(path)
        found = study.measurement("top").contact
        assert 0 < found < 0.05 and study.noise_of("top").contact == (found if wanted else 0.2)
