"""The drift of a force before contact: subtracted where a study says so, an error where nobody says it."""

import numpy as np
import pytest
import sample_studies as studies
from contact_records import BODIES

from rso.cli import main
from rso.data import Noise, combine, read_measurement
from rso.data.drift import fitted_baseline
from rso.study.errors import StudyError
from rso.study.loader import load_study

EXACT = Noise(contact=0.0, gain=0.0, correlation=0.0)
DEEPEST, AIR, SPEED = 3.0, 2.0, 0.5  # mm, mm, mm/s
ball = BODIES["sphere"]
MOST = float(ball(np.array(DEEPEST)))


def record(rng, share, air=AIR, noise=0.004, bend=0.0, n=161):
    """Depth and force of a loading; the force drifts by a share of its range, the first half of it by more (bend)."""
    u = np.linspace(-air, DEEPEST, n)
    way = (u - u[0]) / (u[-1] - u[0])
    drift = share * MOST * (way + bend * way * (1.0 - way))
    return u, ball(np.maximum(u, 0.0)) + drift + noise * MOST * rng.standard_normal(n)


def written(path, u, F, head="depth_mm,Fz_N", time=None):
    columns = (u, F) if time is None else (time, u, F)
    head = head if time is None else f"time_s,{head}"
    path.write_text("\n".join([head, *(",".join(f"{v:.8g}" for v in row) for row in zip(*columns, strict=True)), ""]))
    return path


def modulus(m, noise=EXACT):
    """The modulus over the true one and its standard deviation, by least squares with the errors that are stated."""
    c = combine(m, noise)
    f, C = ball(c.depth[c.compared]), c.covariance[np.ix_(c.compared, c.compared)]
    weighted = np.linalg.solve(C, f)
    return float(weighted @ c.value[c.compared]) / float(f @ weighted), float(f @ weighted) ** -0.5


def test_a_drift_that_is_subtracted_leaves_the_modulus(tmp_path):
    """A tenth of the largest force over the record moves the modulus by five times what its interval then says."""
    rng = np.random.default_rng(1)
    for share in (-0.1, 0.1):
        file = written(tmp_path / "a.csv", *record(rng, share))
        found, off = modulus(read_measurement(file, drifts="travel"))
        assert abs(found - 1.0) < 2.5 * off < 0.06
        kept, own = modulus(read_measurement(file, drifts="none"))
        assert abs(kept - 1.0) > 2.5 * own  # the negative control: nothing subtracted, nothing counted


def test_a_slope_that_does_not_change_is_known_as_well_as_is_stated():
    """Scatter of many approaches, beside the share by which drifts change."""
    rng, x = np.random.default_rng(2), np.linspace(0.0, 4.0, 60)
    lines = [fitted_baseline("time", x, 3e-3 * rng.standard_normal(60)) for _ in range(200)]
    assert 0.75 < np.std([v.slope for v in lines]) / np.median([v.slope_scatter for v in lines]) < 1.1
    assert all(v.slope_error >= v.slope_scatter for v in lines)
    assert np.mean([v.bends for v in lines]) < 0.05
    bent = fitted_baseline("time", x, 0.1 * np.exp(-x) + 3e-3 * rng.standard_normal(60))
    assert bent.bends and bent.slope_error > 0.5 * abs(bent.slope)


def test_a_drift_that_nobody_states_counts_as_an_error(tmp_path):
    rng, off = np.random.default_rng(3), []
    for _ in range(10):
        m = read_measurement(written(tmp_path / "a.csv", *record(rng, 0.08)))
        assert any("in the approach, before contact" in d and "drift = " in d for d in m.doubts)
        found, sd = modulus(m)
        off.append((found - 1.0) / sd)
    assert np.mean(np.abs(off) < 1.645) > 0.7
    for _ in range(10):  # a record without one says and widens nothing
        m = read_measurement(written(tmp_path / "b.csv", *record(rng, 0.0)))
        assert not any("drift" in d for d in m.doubts) and modulus(m)[1] < 0.5 * sd


def test_a_contact_that_was_stated_too_late_is_no_drift(tmp_path):
    u, F = record(np.random.default_rng(4), 0.0, noise=0.001)
    m = read_measurement(written(tmp_path / "a.csv", u - 0.8, F))
    assert not m.repeats[0].drift and any("where contact should be" in d for d in m.doubts)


def test_time_and_travel_part_where_the_indenter_returns(tmp_path):
    """What drifts with time goes on during unloading, what drifts with travel comes back."""
    u, F = record(np.random.default_rng(5), 0.0, noise=0.0)
    depth, force = np.r_[u, u[::-1][1:]], np.r_[F, F[::-1][1:]]
    time = np.arange(len(depth)) * (u[1] - u[0]) / SPEED
    for along, x in (("time", time), ("travel", depth)):
        m = read_measurement(written(tmp_path / "a.csv", depth, force + 1e-3 * x, time=time), drifts=along)
        (r,) = m.repeats
        np.testing.assert_allclose(r.channels["Fz"], force, atol=1e-4 * MOST)
        assert r.drift["Fz"].slope == pytest.approx(1e-3, rel=1e-3)
        for branch in ("loading", "unloading"):  # one error in both
            assert {"drift", "level"} <= combine(m, EXACT, segment=branch).shared.keys()


def test_the_contact_is_found_again_without_the_drift(tmp_path):
    """0.6 mm of approach: with the drift the contact is found 0.05 mm early, beyond what readings leave open."""
    rng, away = np.random.default_rng(6), {None: [], "travel": []}
    for _ in range(4):
        u, F = record(rng, 0.1, air=0.6)
        file = written(tmp_path / "a.csv", u + 7.0, F, "Displacement (mm),Force (N)")
        for drifts, found in away.items():
            m = read_measurement(file, drifts=drifts)
            found.append(float(m.repeats[0].depth.max()) - DEEPEST)
            assert abs(found[-1]) < 2.5 * m.contact
    assert abs(np.mean(away["travel"])) < 0.6 * abs(np.mean(away[None]))


def test_an_approach_that_is_too_short_is_refused(tmp_path):
    u, F = record(np.random.default_rng(7), 0.1)
    written(tmp_path / "top.csv", u[u > -0.08], F[u > -0.08])
    text = studies.SECTIONS["[experiments]"] + '\ndrift = "travel"'
    with pytest.raises(StudyError, match=r"top\.csv.*approach is too short for a line, \d reading.*\"none\""):
        load_study(studies.write(tmp_path, experiments=text))
    with pytest.raises(StudyError, match='the record has no times; choose "travel"'):
        load_study(studies.write(tmp_path, experiments=text.replace('"travel"', '"time"')))


def test_a_new_study_has_the_key_where_the_drift_is_beyond_doubt(tmp_path):
    rng = np.random.default_rng(8)
    for name, share, bend, key in (("a", 0.05, 0.0, True), ("b", 0.0, 0.0, False), ("c", 0.1, 4.0, False)):
        file = written(tmp_path / f"{name}.csv", *record(rng, share, bend=bend))
        assert main(["new", str(file), "--half-space", "--ball", "3", "--out", str(tmp_path / f"{name}.toml")]) == 0
        assert ('drift = "travel"' in (tmp_path / f"{name}.toml").read_text()) is key
        if key:
            (said,) = load_study(tmp_path / f"{name}.toml").measurement(name).doubts
            assert said.startswith("a line through Fz of the approach is subtracted")
