"""Reading, averaging and the measurement chain."""

import gzip
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from rso.contract import parameters_of
from rso.core.digits import quantity_text
from rso.data import (
    Chain,
    MeasuredCurve,
    Measurement,
    Noise,
    Repeat,
    combine,
    correct,
    curve_shape,
    read_measurement,
    record,
    value_at,
    without_spikes,
)
from rso.data.files import lines as lines_module

U = np.linspace(0.1, 4.0, 40)
NONE = {"gain": 0.0, "contact": 0.0, "correlation": 0.0}  # errors of a test as a whole: it is said that there are none


def write(tmp_path: Path, content: str, encoding: str = "utf-8") -> Path:
    path = tmp_path / "data.csv"
    path.write_bytes(content.encode(encoding))
    return path


def table(head: str, rows) -> str:
    return head + "\n" + "\n".join(",".join(str(float(v)) for v in row) for row in rows) + "\n"


# ---- reading


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_dialects_read_the_same(tmp_path, encoding, separator, newline):
    lines = ["# Prüfstand", "", '"depth_um";Fz_mN;time_min', "100;10.5;0.5", "200;30.25;1", "400 ; 90 ;1.5"]
    content = newline.join(lines).replace(";", separator)
    if separator != ",":
        content = content.replace(".", ",")
    m = read_measurement(write(tmp_path, content, encoding))
    (r,) = m.repeats
    assert m.notes == ("Prüfstand",) and m.kind == "force" and m.channels == ("Fz",)
    np.testing.assert_allclose(r.depth, [0.1, 0.2, 0.4], rtol=1e-15, atol=0)
    np.testing.assert_allclose(r.channels["Fz"], [0.0105, 0.03025, 0.09], rtol=1e-15, atol=0)
    np.testing.assert_allclose(r.time, [30, 60, 90], rtol=1e-15, atol=0)


def test_single_row_sigma_and_profile(tmp_path):
    m = read_measurement(write(tmp_path, "depth_mm,Fz_N,Fz_sigma_mN\n8,1.283,2\n"))
    assert m.repeats[0].sigma["Fz"].tolist() == [0.002]
    curve = combine(m, Noise(**NONE))
    assert (curve.depth.tolist(), curve.value.tolist(), curve.sigma.tolist()) == ([8.0], [1.283], [0.002])
    assert value_at(curve, 8.0) == (1.283, 0.002)
    p = read_measurement(write(tmp_path, "depth_mm,x_mm,y_mm,uz_mm\n1,5,5,-0.1\n1,-5,5,-0.2\n2,0,5,-0.3\n"))
    c = combine(p, Noise(uz=0.05), "uz")
    assert p.kind == "profile" and c.position.tolist() == [[-5, 5], [5, 5], [0, 5]]
    np.testing.assert_allclose(c.sigma, 0.05, rtol=1e-12, atol=0)


def test_segments_follow_the_direction_of_travel(tmp_path):
    up, down = np.arange(0, 5.0), np.arange(3.0, -1, -1)
    depth = np.r_[up, down]
    m = read_measurement(write(tmp_path, table("depth_mm,Fz_N", zip(depth, depth, strict=True))))
    assert m.repeats[0].segment.tolist() == ["loading"] * 5 + ["unloading"] * 4
    jitter = np.r_[up, 3.99]  # the last reading falls back by less than the noise: still loading
    m = read_measurement(write(tmp_path, table("depth_mm,Fz_N", zip(jitter, jitter, strict=True))))
    assert set(m.repeats[0].segment) == {"loading"}
    stacked = np.r_[up, up]
    with pytest.raises(ValueError, match=r"turns back more than once .* Add a column 'repeat'"):
        read_measurement(write(tmp_path, table("depth_mm,Fz_N", zip(stacked, stacked, strict=True))))
    m = read_measurement(write(tmp_path, "depth_mm,Fz_N,segment\n1,1,loading\n1,0.9,hold\n0.5,0.2,unloading\n"))
    assert m.repeats[0].segment.tolist() == ["loading", "hold", "unloading"]


@pytest.mark.parametrize("rest_s, back", [(0.0, True), (0.0, False), (2.0, True), (2.0, False), (60.0, True)])
@pytest.mark.parametrize("rate_hz", [5.0, 50.0])
def test_a_rest_at_the_deepest_point_is_a_hold_where_times_are_known(tmp_path, rest_s, back, rate_hz):
    """4 mm at 0.5 mm/s with a turn that the machine rounds within 0.1 s, 5 um of noise, a rest or none."""
    t = np.arange(0.0, 8.0 + rest_s + 8.0 * back, 1.0 / rate_hz)
    u = 0.5 * np.minimum(np.minimum(t, 8.0), 16.0 + rest_s - t if back else 8.0)
    u = np.minimum(u, 4.0 - 0.02 * np.exp(-np.abs(t - 8.0) / 0.1))
    u = u + 0.005 * np.random.default_rng(3).normal(size=len(t))
    rows = table("time_s,depth_mm,Fz_N", zip(t, u, u, strict=True))
    (r,) = read_measurement(write(tmp_path, rows)).repeats
    held = r.segment == "hold"
    if rest_s == 0.0:
        assert not held.any()
    else:
        assert abs(np.ptp(r.time[held]) - rest_s) < 0.3 + 2.0 / rate_hz
        assert back or held[-1]
        assert np.all(r.time[r.segment == "loading"] < r.time[held][0])
        assert r.depth[r.segment == "loading"].max() > 3.97  # the way there is kept to its end, but for the brake
        returning = r.segment == "unloading"
        assert np.all(r.time[returning] > r.time[held][-1]) and returning.any() == back
    timeless = write(tmp_path, table("depth_mm,Fz_N", zip(u, u, strict=True)))
    if rest_s == 0.0:
        assert "hold" not in read_measurement(timeless).repeats[0].segment
    elif rest_s > 10.0:
        assert any("If that is a hold" in doubt for doubt in read_measurement(timeless).doubts)


T_WAY = np.linspace(0.0, 16.0, 401)
WAYS = {  # depth over time without any rest at the top
    "a sine": (T_WAY, 2.0 - 2.0 * np.cos(2 * np.pi * T_WAY / 16.0)),
    "half a sine there": (T_WAY[:201], 4.0 * np.sin(np.pi * T_WAY[:201] / 16.0)),
    "ten times slower back": (np.r_[T_WAY, 16.0 + 10 * T_WAY[1:]], 4.0 - 4.0 * np.abs(1 - np.arange(801) / 400)),
    "slower at its end": (np.r_[T_WAY, 16.0 + T_WAY[1:]], np.r_[3.6 * T_WAY / 16.0, 3.6 + 0.4 * T_WAY[1:] / 16.0]),
    "through air": (np.r_[T_WAY / 8, 2.0 + T_WAY[1:]], np.r_[-20.0 + 20.0 * T_WAY / 16.0, 4.0 * T_WAY[1:] / 16.0]),
    "few readings": (np.arange(9.0), 4.0 - np.abs(np.arange(9.0) - 4.0)),
}


@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_what_slows_down_or_turns_is_no_hold(tmp_path, name, noise):
    t, u = WAYS[name]
    u = u + noise * np.random.default_rng(4).normal(size=len(u))
    (r,) = read_measurement(
        write(tmp_path, table("time_s,depth_mm,Fz_N", zip(t, u, np.maximum(u, 0), strict=True)))
    ).repeats
    assert "hold" not in r.segment


def test_a_hold_of_two_readings_by_hand_and_one_after_a_fast_way_through_air(tmp_path):
    rows = "0,0,0\n2,1,1\n4,2,2\n6,3,3\n8,4,4\n68,4,3\n70,3,2\n72,2,1\n"
    (r,) = read_measurement(write(tmp_path, "time_s,depth_mm,Fz_N\n" + rows)).repeats
    assert r.segment.tolist() == ["loading"] * 5 + ["hold"] + ["unloading"] * 2
    t, u = WAYS["through air"]
    t, u = np.r_[t, t[-1] + np.arange(1, 201) * 0.1], np.r_[u, np.full(200, 4.0)]
    (r,) = read_measurement(
        write(tmp_path, table("time_s,depth_mm,Fz_N", zip(t, u, np.maximum(u, 0), strict=True)))
    ).repeats
    assert np.sum(r.segment == "hold") == 200


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", ["holds no header line"]),
        ("# only a note\n", ["holds no header line"]),
        ("depth_mm,Fz_N\n", ["too few points"]),
        ("depth_mm,Fz_N\n1,2\n2,abc\n", [":3:", "'Fz'", "'abc'", "finite"]),
        ("depth_mm,Fz_N\n1,2\n2,NaN\n", [":3:", "'Fz'", "'NaN'"]),
        ("depth_mm,Fz_N\n1,2\n2,inf\n", [":3:", "'inf'"]),
        ("depth_mm,Fz_N\n1,2\n2,\n", [":3:", "''"]),
        ("depth_mm,Fz_N\n1,1_0\n", [":2:", "'1_0'"]),
        ("depth_mm,Fz_N\n1,1e300\n", [":2:", "'1e300'", "larger than"]),
        ("depth_mm,Fz_N\n1,2\n2\n", [":3:", "1 values", "2 columns"]),
        ("depth_mm;Fz_N\n1.000,5;2,0\n", [":2:", "'depth'", "'1.000,5'"]),
        ("depth_mm,power\n1,2\n", [":1:", "'power'", "understood are depth_mm"]),
        ("depth_mm,force\n1,2\n", [":1:", "'force'", "says no unit"]),
        ("depth_mm,depth_um,Fz_N\n1,1,2\n", [":1:", "'depth'", "twice"]),
        ("Fz_N\n1\n", ["depth_mm is missing", "Fz"]),
        ("depth_mm,time_s\n1,2\n", ["either forces"]),
        ("depth_mm,Fz_N,uz_mm,x_mm,y_mm\n1,2,3,4,5\n", ["either forces"]),
        ("depth_mm,uz_mm\n1,2\n", ["x_mm and y_mm"]),
        ("depth_mm,Fz_N,x_mm\n1,2,3\n", ["belong to a profile"]),
        ("depth_mm,Fz_N,Fx_sigma_N\n1,2,3\n", [":1:", "'Fx_sigma'", "not there"]),
        ("depth_mm,Fz_N,Fz_sigma_N\n1,2,-3\n", [":2:", "'Fz_sigma'", "negative"]),
        ("time_s,depth_mm,Fz_N\n0,1,1\n1,2,1\n1,3,1\n", [":4:", "'time'", "does not follow", "delete one"]),
        ("depth_mm,Fz_N,segment\n1,2,up\n", [":2:", "'segment'", "'up'", "loading, hold, creep, unloading"]),
        ("depth_mm,Fz_N,repeat\n1,2,1\n2,3,1\n1,2,2\n", ["repeat '2'", "too few points"]),
    ],
)
def test_bad_tables_are_answered_with_place_and_choices(tmp_path, content, words):
    path = write(tmp_path, content)
    with pytest.raises(ValueError) as caught:
        read_measurement(path)
    for word in [str(path), *words]:
        assert word in str(caught.value)


def test_bad_files(tmp_path, monkeypatch):
    binary = [(content, "not a text file") for content in (b"PK\0\0", b"\xff\xfe\0\0d\0\0\0")]
    for content, word in [(b"\xff\xfed", "UTF-16"), *binary]:
        (tmp_path / "x.csv").write_bytes(content)
        with pytest.raises(ValueError, match=word):
            read_measurement(tmp_path / "x.csv")
    with pytest.raises(ValueError, match="no such file"):
        read_measurement(tmp_path / "none.csv")
    with pytest.raises(ValueError, match="is not a file"):
        read_measurement(tmp_path)
    assert lines_module.MAX_FILE_BYTES == 200_000_000
    monkeypatch.setattr(lines_module, "MAX_FILE_BYTES", 10)
    with pytest.raises(ValueError, match="is more than the"):
        read_measurement(write(tmp_path, "depth_mm,Fz_N\n1,2\n"))


OTHER_FILES = {  # contents → what the message calls it, and what it says to do
    "pdf": (b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n1 0 obj <</Type /Catalog>>", "a document (PDF)", "export"),
    "rtf": (b"{\\rtf1\\ansi Time (s)\\tab Force (N)\\par}", "a document (RTF)", "export"),
    "hdf": (b"\x89HDF\r\n\x1a\n" + bytes(40), "an HDF5 file", "export"),
    "matlab": (b"MATLAB 5.0 MAT-file, Platform: PCWIN64".ljust(116) + bytes(40), "a MATLAB file", "export"),
    "gzip": (gzip.compress(b"depth_mm,Fz_N\n0,0\n1,1\n"), "packed (gzip)", "unpack"),
    "html": (b"<html><body><table><tr><td>Force (N)</td></tr></table></body></html>", "HTML or XML", "export"),
    "xml": (b'\xef\xbb\xbf<?xml version="1.0"?>\n<Workbook></Workbook>', "HTML or XML", "export"),
    "json": (b'[{"depth_mm": 0.1,\n "Fz_N": 2}]', "JSON", "export"),
    "a line for each": (b'{"depth_mm": 0.1}\n{"depth_mm": 0.2}\n', "JSON", "export"),
    "raw numbers": (bytes(1 + k % 255 for k in range(0, 4000, 7)), "control characters", "export"),
}


@pytest.mark.parametrize("what", OTHER_FILES)
def test_files_of_other_kinds_are_called_by_it_and_not_taken_for_a_header(tmp_path, what):
    content, called, advice = OTHER_FILES[what]
    (tmp_path / "x.csv").write_bytes(content)
    with pytest.raises(ValueError) as error:
        read_measurement(tmp_path / "x.csv")
    assert called in str(error.value) and advice in str(error.value) and "unknown column" not in str(error.value)


@pytest.mark.parametrize(
    "first", ["<measured in air>", "[test of the 3rd of May]", "{lab}", "PAR1,PAR2", "%PDF made of"]
)
def test_notes_that_look_like_another_kind_are_notes(tmp_path, first):
    content = table("depth_mm,Fz_N", zip(PRESS, PULL, strict=True))
    assert len(read_measurement(write(tmp_path, f"{first}\n{content}\x1a")).repeats[0].depth) == len(PRESS)


# ---- averaging


def repeats(tmp_path, rng, n=5, white=0.003, gain=0.0, depth_noise=0.0, p=1.4):
    rows = []
    for k in range(n):
        g = 1 + gain * rng.standard_normal()
        u = U + depth_noise * rng.standard_normal(U.size)
        rows += [(k, d, g * 0.06 * x**p + white * rng.standard_normal()) for d, x in zip(u, U, strict=True)]
    return read_measurement(write(tmp_path, table("repeat,depth_mm,Fz_N", rows)))


def test_identical_repeats_average_to_themselves(tmp_path):
    m = repeats(tmp_path, np.random.default_rng(0), white=0.0)
    curve = combine(m, Noise(Fz=0.01, **NONE))
    np.testing.assert_allclose(curve.depth, U, rtol=1e-12, atol=0)
    np.testing.assert_allclose(curve.value, 0.06 * U**1.4, rtol=1e-12, atol=0)
    np.testing.assert_allclose(curve.sigma, 0.01 / np.sqrt(5), rtol=1e-6, atol=0)  # nothing but what was stated of each
    assert curve.n_repeats == 5 and curve.unit == "N"


def test_sigma_is_honest_for_white_noise_gain_scatter_and_depth_noise(tmp_path):
    """χ² of the error against the stated covariance has mean 1 per point over many synthetic experiments."""
    rng, chi2, naive = np.random.default_rng(3), [], []
    for _ in range(60):
        curve = combine(repeats(tmp_path, rng, white=0.003, gain=0.03, depth_noise=0.005), Noise())
        error = curve.value - 0.06 * curve.depth**1.4
        chi2.append(np.mean((error / curve.sigma) ** 2))
        naive.append(np.mean((error / (0.003 / np.sqrt(5))) ** 2))
    # Gain scatter is one number per experiment, known from 5 repeats (Student's t with 4 degrees: mean χ² 2 in
    # part), hence the width of the band; standard error of the mean over 60 experiments about 0.2.
    assert 0.6 < np.mean(chi2) < 2.0
    assert np.mean(naive) > 3  # negative control: white noise alone does not cover it


def test_one_repeat_shows_its_white_noise(tmp_path):
    m = repeats(tmp_path, np.random.default_rng(5), n=1, white=0.003)
    # 37 third differences of correlated terms: about 20 % standard error; three of them.
    assert combine(m, Noise(**NONE)).sigma[0] == pytest.approx(0.003, rel=0.6)


@pytest.mark.parametrize(
    "depth",
    [U, np.sort(np.r_[0.05, 4.0, np.random.default_rng(1).uniform(0.05, 4.0, 60)]), np.geomspace(0.05, 4.0, 40)],
    ids=["even", "random", "geometric"],
)
def test_white_noise_of_one_repeat_does_not_hang_on_where_the_readings_are(tmp_path, depth):
    """A smooth curve without noise has none; with noise it is found to the scatter of 30 files of 40 readings."""
    rows = table("depth_mm,Fz_N", zip(depth, 0.1 * depth**1.4, strict=True))
    smooth = combine(read_measurement(write(tmp_path, rows)), Noise(**NONE))
    assert smooth.sigma.max() < 1e-4 * smooth.value.max()
    rng, found = np.random.default_rng(0), []
    for _ in range(30):
        noisy = 0.1 * depth**1.4 + 0.003 * rng.standard_normal(len(depth))
        rows = table("depth_mm,Fz_N", zip(depth, noisy, strict=True))
        found.append(combine(read_measurement(write(tmp_path, rows)), Noise(**NONE)))
    np.testing.assert_allclose(np.sqrt(np.mean([c.sigma[0] ** 2 for c in found])), 0.003, rtol=0.12, atol=0)


def fitted(curve: MeasuredCurve, shape: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """Generalised least squares of curve = a shape: a and its standard deviation."""
    white = np.linalg.solve(np.linalg.cholesky(covariance), np.stack([curve.value, shape], axis=1))
    return float(white[:, 0] @ white[:, 1] / (white[:, 1] @ white[:, 1])), float((white[:, 1] @ white[:, 1]) ** -0.5)


@pytest.mark.parametrize(
    "count, noise",
    [(1, Noise(Fz=0.002, gain=0.03)), *(pytest.param(n, Noise(), marks=pytest.mark.verification) for n in (3, 5))],
)
def test_a_gain_error_neither_pulls_a_fit_nor_spoils_its_interval(tmp_path, count, noise):
    """Peelle's puzzle: 200 readings whose own values carry the gain are fitted 200 g² too low, of which 5 g² may stay.

    90 % intervals of 120 data sets hold the truth in 82 to 97 %; the spread of the mean is a 120th part of g².
    """
    u = np.linspace(0.02, 4.0, 200)
    shape, rng, found, spoilt = 0.08 * u**1.5, np.random.default_rng(2), [], []
    text = table("depth_mm,Fz_N,repeat", [(d, f, i) for i in range(count) for d, f in zip(u, shape, strict=True)])
    empty = read_measurement(write(tmp_path, text))  # of the same depths
    for _ in range(120):
        gains = 1.0 + 0.03 * rng.standard_normal(count)
        forces = [g * shape + 0.002 * rng.standard_normal(len(u)) for g in gains]
        rows = [replace(r, channels={"Fz": F}) for r, F in zip(empty.repeats, forces, strict=True)]
        curve = combine(replace(empty, repeats=tuple(rows)), noise)
        found.append(fitted(curve, shape, curve.covariance))
        if count == 1:  # as it was: the control
            own = 0.002**2 * np.eye(len(u)) + 0.03**2 * np.outer(curve.value, curve.value)
            spoilt.append(fitted(curve, shape, own)[0])
    a, sd = np.array(found).T
    # 0.90 ± 0.03; gains of 3 % where 2 % are usual are drawn towards these
    assert 0.78 <= np.mean(np.abs(a - 1.0) <= 1.645 * sd) <= 0.98
    assert abs(a.mean() - 1.0) < 5 * 0.03**2 + 3 * 0.03 / np.sqrt(120 * count)
    assert not spoilt or np.mean(spoilt) < 0.95


def test_noise_that_is_stated_and_seen_counts_once(tmp_path):
    rng = np.random.default_rng(3)
    u = np.linspace(0.02, 4.0, 200)
    m = read_measurement(
        write(tmp_path, table("depth_mm,Fz_N", zip(u, 0.1 * u + 0.003 * rng.standard_normal(200), strict=True)))
    )
    seen = combine(m, Noise(**NONE)).sigma[0]
    for stated, counted in ((0.001, seen), (seen, seen), (0.02, 0.02)):
        np.testing.assert_allclose(combine(m, Noise(Fz=stated, **NONE)).sigma, counted, rtol=1e-12, atol=0)


def test_stated_noise_adds_as_written(tmp_path):
    m = repeats(tmp_path, np.random.default_rng(0), white=0.0, n=2, p=1.0)  # slope 0.06 everywhere
    noise = Noise(Fz=0.003, depth=0.1, gain=0.05, contact=0.0, correlation=0.5)
    curve = combine(m, noise)
    expected = np.sqrt(0.003**2 + (0.1 * 0.06) ** 2 / 2 + (0.05 * 0.06 * U) ** 2)  # depths are each reading's own
    np.testing.assert_allclose(curve.sigma, expected, rtol=1e-6, atol=0)  # round-off of the polynomial slope
    off = 0.003**2 * np.exp(-(U[5] - U[0]) / 0.5) + 0.05**2 * 0.06**2 * U[0] * U[5]
    np.testing.assert_allclose(curve.covariance[0, 5], off, rtol=1e-6, atol=0)
    assert np.linalg.eigvalsh(curve.covariance).min() > 0


def test_grid_is_what_all_repeats_reach(tmp_path):
    rows = [(1, d, d) for d in np.linspace(0, 3, 31)] + [(2, d, d) for d in np.linspace(0.55, 4, 30)]
    curve = combine(read_measurement(write(tmp_path, table("repeat,depth_mm,Fz_N", rows))), Noise(**NONE))
    assert (curve.depth[0], curve.depth[-1]) == (0.55, 3.0)
    np.testing.assert_allclose(curve.value, curve.depth, rtol=1e-12, atol=0)
    rows = [(1, d, d) for d in (0.0, 1.0)] + [(2, d, d) for d in (2.0, 3.0)]
    with pytest.raises(ValueError, match="share no range"):
        combine(read_measurement(write(tmp_path, table("repeat,depth_mm,Fz_N", rows))), Noise(**NONE))


def test_dense_records_shrink_without_bias(tmp_path):
    u = np.linspace(0, 4, 8001)
    curve = combine(read_measurement(write(tmp_path, table("depth_mm,Fz_N", zip(u, u, strict=True)))), Noise(**NONE))
    assert len(curve.depth) == 200
    np.testing.assert_allclose(curve.value, curve.depth, rtol=0, atol=1e-12)


def test_value_at_grants_half_a_spacing(tmp_path):
    m = read_measurement(write(tmp_path, table("depth_mm,Fz_N", [(d, 2 * d) for d in np.linspace(0.2, 3.99, 20)])))
    curve = combine(m, Noise(**NONE))
    assert value_at(curve, 1.0)[0] == pytest.approx(2.0, rel=1e-12)
    assert value_at(curve, 4.0)[0] == pytest.approx(8.0, rel=1e-9)
    for depth in (4.2, 0.05, 40.0):
        with pytest.raises(ValueError, match=r"outside the measured range 0\.2 to 3\.99 mm"):
            value_at(curve, depth)


@pytest.mark.parametrize("n", [2, 3, 4, 8, 40])
def test_between_readings_the_force_of_a_ball_is_read(tmp_path, n):
    """Straight lines are 4 % above it in the second interval, whatever the step: targets are missed by less."""
    u = np.linspace(4 / n, 4, n)
    rows = zip(u, 0.07 * u**1.5, strict=True)
    curve = combine(read_measurement(write(tmp_path, table("depth_mm,Fz_N", rows))), Noise(**NONE))
    middle = 0.5 * (u[0] + u[1])
    straight = float(np.interp(middle, u, curve.value))
    assert value_at(curve, middle)[0] == pytest.approx(0.07 * middle**1.5, rel=1e-9)
    assert straight > 1.04 * 0.07 * middle**1.5  # negative control
    assert value_at(curve, float(u[1]))[0] == curve.value[1]


@pytest.mark.parametrize("n", [8, 20, 80])
def test_repeats_at_other_depths_are_averaged_as_the_force_of_a_ball(tmp_path, n):
    """Exact readings, each repeat at depths of its own.  Negative control: straight lines are off in the first one."""
    rng, step, rows = np.random.default_rng(1), 4 / n, []
    for k in range(3):
        u = np.linspace(step, 4, n) - step * rng.uniform(0.1, 0.9)
        rows += [(v, 0.07 * v**1.5, k) for v in u]
    curve = combine(read_measurement(write(tmp_path, table("depth_mm,Fz_N,repeat", rows))), Noise(**NONE))
    np.testing.assert_allclose(curve.value, 0.07 * curve.depth**1.5, rtol=1e-9)
    each = [[r for r in rows if r[2] == k] for k in range(3)]
    straight = np.mean([np.interp(curve.depth, *np.array(e)[:, :2].T) for e in each], axis=0)
    assert straight[0] > 1.005 * curve.value[0]


def test_between_noisy_readings_nothing_is_amplified():
    """What is beside the smooth curve is interpolated on a straight line: no more scatter than the readings have."""
    u, rng, found = np.linspace(0.1, 4, 40), np.random.default_rng(0), []
    for _ in range(300):
        y = 0.07 * u**1.5 + 0.01 + 1e-3 * rng.standard_normal(40)  # and not tared
        curve = MeasuredCurve("Fz", "N", u, y, np.full(40, 1e-3), 1, 1e-6 * np.eye(40))
        found.append(value_at(curve, 0.15)[0] - 0.07 * 0.15**1.5 - 0.01)
    assert np.std(found) < 1e-3 and abs(np.mean(found)) < 2e-4


def test_combine_names_choices(tmp_path):
    m = read_measurement(write(tmp_path, "depth_mm,Fz_N\n1,1\n2,2\n3,3\n"))
    with pytest.raises(ValueError, match="no channel 'Fx'; there are Fz"):
        combine(m, Noise(**NONE), "Fx")
    with pytest.raises(ValueError, match="no segment 'unloading'; there are loading"):
        combine(m, Noise(**NONE), segment="unloading")
    with pytest.raises(ValueError, match="gain = -1"):
        Noise(gain=-1)


# ---- the chain

T = U / 0.5
FORCES = {"Fx": 0.01 * U, "Fy": -0.02 * U**2, "Fz": 0.06 * U**1.5}
HALF = np.sqrt(0.75)
# One non-neutral value for each knob, and what it must do, written without the code under test.
EFFECTS = {
    "offset": (0.05, lambda u, F: (u - 0.05, F["Fx"], F["Fy"], F["Fz"])),
    "compliance": (0.3, lambda u, F: (u + 0.3 * F["Fz"], F["Fx"], F["Fy"], F["Fz"])),
    "gain": (1.1, lambda u, F: (u, F["Fx"], F["Fy"], 1.1 * F["Fz"])),
    "bias": (0.01, lambda u, F: (u, F["Fx"], F["Fy"], F["Fz"] + 0.01)),
    "drift": (0.001, lambda u, F: (u, F["Fx"], F["Fy"], F["Fz"] + 0.001 * T)),
    "cross_x": (0.02, lambda u, F: (u, F["Fx"] + 0.02 * F["Fz"], F["Fy"], F["Fz"])),
    "cross_y": (0.02, lambda u, F: (u, F["Fx"], F["Fy"] + 0.02 * F["Fz"], F["Fz"])),
    # One reading late: 0.1 mm at 0.5 mm/s.
    "lag": (0.2, lambda u, F: (u, *(np.r_[F[k][0], F[k][:-1]] for k in ("Fx", "Fy", "Fz")))),
    "lag_filter": (0.3, lambda u, F: (u, *(smoothed(F[k], 0.3) for k in ("Fx", "Fy", "Fz")))),
    "creep": (0.3, lambda u, F: (u + 0.3 * smoothed(F["Fz"], 5.0), F["Fx"], F["Fy"], F["Fz"])),
    "depth_scale": (-0.04, lambda u, F: (0.96 * u, F["Fx"], F["Fy"], F["Fz"])),
    "nonlinearity": (0.05, lambda u, F: (u, F["Fx"], F["Fy"], F["Fz"] + 0.05 * F["Fz"] ** 2)),
    "bias_side": (-0.02, lambda u, F: (u, F["Fx"] - 0.02, F["Fy"], F["Fz"])),
    # a sensor turned to the left feels a force along x to its right
    "turn": (30.0, lambda u, F: (u, HALF * F["Fx"] + F["Fy"] / 2, HALF * F["Fy"] - F["Fx"] / 2, F["Fz"])),
}


def smoothed(v: np.ndarray, τ: float) -> np.ndarray:
    """Linear system 1 / (τ s + 1) with a first-order hold."""
    return v[0] + lsim(([1.0], [τ, 1.0]), v - v[0], T - T[0])[1]


def test_neutral_chain_changes_nothing():
    for time in (None, T):
        r = record(Chain(), U, FORCES, time)
        assert np.array_equal(r.depth, U)
        for k, v in FORCES.items():
            np.testing.assert_allclose(r.forces[k], v, rtol=1e-15, atol=0)


def test_every_knob_is_tested_and_is_an_effect():
    knobs = [p for p in parameters_of(Chain) if p.name not in ("creep_tau", "bias_angle")]  # shapes
    one_loading_does_not_show = {"backlash", "ageing", "permanent_set"}
    assert {p.name for p in knobs} == {*EFFECTS, *one_loading_does_not_show}
    for p in knobs:
        assert p.low < p.neutral < p.high or (p.low == p.neutral == 0)
        assert p.low <= p.typical <= p.high and p.typical != p.neutral and p.default == p.neutral


def test_backlash_shows_on_the_way_back_alone():
    b, top = 0.12, 4.0
    u = np.r_[U, U[-2::-1]]
    t = np.arange(1, len(u) + 1) * 0.2
    r = record(Chain(backlash=b), u, {"Fz": 0.06 * u**1.5}, t)
    there, back = slice(0, len(U)), slice(len(U), None)
    np.testing.assert_array_equal(r.depth[there], u[there])
    # the drive has gone back by b before the indenter moves: at a recorded depth d it still stands at d + b
    np.testing.assert_allclose(r.forces["Fz"][back], 0.06 * (r.depth[back] + b) ** 1.5, rtol=1e-12, atol=0)
    assert np.array_equal(record(Chain(backlash=b), U, FORCES, T).depth, U)
    sticks = record(Chain(backlash=-b), u, {"Fz": 0.06 * u**1.5}, t)  # the gauge stays deep while the indenter rises
    np.testing.assert_allclose(sticks.forces["Fz"][back], 0.06 * (sticks.depth[back] - b) ** 1.5, rtol=1e-12, atol=0)
    again = correct(Chain(backlash=b), r.depth, r.forces, t)
    np.testing.assert_allclose(again.depth, np.minimum(u, top), rtol=1e-12, atol=0)


@pytest.mark.parametrize("age, factor", [(-0.5, 0.9), (0.0, 1.0), (0.25, 1.05), (0.5, 1.1)])
def test_ageing_changes_all_forces_from_the_first_test_to_the_last(age, factor):
    """And with them what a compliance adds to the depth."""
    chain = Chain(ageing=0.2, compliance=0.3, bias=0.01)
    r = record(chain, U, FORCES, T, age)
    np.testing.assert_allclose(r.depth, U + 0.3 * factor * FORCES["Fz"], rtol=1e-14)
    for c in FORCES:
        np.testing.assert_allclose(r.forces[c], factor * FORCES[c] + 0.01 * (c == "Fz"), rtol=1e-14)
    again = correct(chain, r.depth, r.forces, T, age)
    np.testing.assert_allclose(again.depth, U, rtol=1e-13)
    np.testing.assert_allclose(again.forces["Fy"], FORCES["Fy"], rtol=1e-13)


@pytest.mark.parametrize("earlier, dent", [(0.0, 0.0), (2.0, 0.1), (4.0, 0.2)])
def test_what_stays_of_an_earlier_test_is_a_dent_that_the_record_counts_as_depth(earlier, dent):
    chain = Chain(permanent_set=0.05, compliance=0.3)
    r = record(chain, U, FORCES, T, earlier=earlier)
    np.testing.assert_allclose(r.depth, U + dent + 0.3 * FORCES["Fz"], rtol=1e-14)
    assert np.array_equal(r.forces["Fz"], FORCES["Fz"])
    np.testing.assert_allclose(correct(chain, r.depth, r.forces, T, earlier=earlier).depth, U, rtol=1e-13)


@pytest.mark.parametrize("name", EFFECTS)
def test_each_knob_does_what_its_definition_says(name):
    value, law = EFFECTS[name]
    r = record(Chain(**{name: value}), U, FORCES, T)
    expected = law(U, FORCES)
    got = (r.depth, r.forces["Fx"], r.forces["Fy"], r.forces["Fz"])
    for g, e in zip(got, expected, strict=True):
        np.testing.assert_allclose(g, e, rtol=1e-12, atol=1e-15)  # T / 0.2 s is an integer to round-off only
    # Negative control: the knob shows at all.
    assert any(np.max(np.abs(g - v)) > 1e-4 for g, v in zip(got, (U, *FORCES.values()), strict=True))


def test_correct_undoes_record():
    chain = Chain(
        0.05,
        0.3,
        1.1,
        0.01,
        0.001,
        0.0,
        0.02,
        -0.03,
        depth_scale=0.1,
        nonlinearity=-0.2,
        turn=-25.0,
        creep=0.2,
        creep_tau=2.0,
        bias_side=-0.01,
        bias_angle=70.0,
    )
    r = record(chain, U, FORCES, T)
    back = correct(chain, r.depth, r.forces, T)
    np.testing.assert_allclose(back.depth, U, rtol=1e-13, atol=0)
    for k, v in FORCES.items():
        np.testing.assert_allclose(back.forces[k], v, rtol=0, atol=1e-15)
    wrong = correct(Chain(), r.depth, r.forces, T)
    assert np.max(np.abs(wrong.depth - U)) > 0.01  # negative control


@pytest.mark.parametrize("angle, Fx, Fy", [(0.0, 0.01, 0.0), (90.0, 0.0, 0.01), (-60.0, 0.005, -0.01 * HALF)])
def test_a_zero_error_beside_the_axis_has_a_direction(angle, Fx, Fy):
    r = record(Chain(bias_side=0.01, bias_angle=angle), U, FORCES, T)
    for c, off in (("Fx", Fx), ("Fy", Fy), ("Fz", 0.0)):
        np.testing.assert_allclose(r.forces[c] - FORCES[c], off, rtol=0, atol=1e-15)


def test_a_filter_follows_a_ramp_as_its_equation_says():
    t = np.linspace(0.0, 3.0, 40) ** 1.3
    τ, zero = 0.4, np.zeros_like(t)
    for forces in ({"Fz": 2.0 * t}, {"Fz": 2.0 * t, "Fx": zero}):
        got = record(Chain(lag_filter=τ), t, forces, t).forces["Fz"]
        # τ y' + y = 2 t, y(0) = 0
        np.testing.assert_allclose(got, 2.0 * (t - τ * (1.0 - np.exp(-t / τ))), rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="cannot be undone"):
        correct(Chain(lag_filter=τ), t, {"Fz": t}, t)
    with pytest.raises(ValueError, match=r"lag_filter = 0\.4 s: the time of each reading is needed"):
        record(Chain(lag_filter=τ), t, {"Fz": t})


def test_lag_is_undone_inside_the_record():
    chain = Chain(lag=0.3)
    r = record(chain, U, FORCES, T)
    back = correct(chain, r.depth, r.forces, T)
    inside = (T > T[0] + 0.6) & (T < T[-1] - 0.6)  # what was shifted out at the ends is lost
    h = 0.1  # mm; two linear interpolations, each off by at most h²/8 |F''|, F'' < 0.07 N/mm² inside
    np.testing.assert_allclose(back.forces["Fz"][inside], FORCES["Fz"][inside], rtol=0, atol=2 * h**2 / 8 * 0.07)


def test_chain_refuses():
    with pytest.raises(ValueError, match="gain = 3"):
        Chain(gain=3)
    with pytest.raises(ValueError, match=r"drift = 0\.001 N/s and creep = 0\.1 mm/N: the time of each"):
        record(Chain(drift=0.001, creep=0.1), U, FORCES)
    with pytest.raises(ValueError, match="needs Fz"):
        record(Chain(), U, {"Fx": U})
    with pytest.raises(ValueError, match="knows Fx, Fy, Fz"):
        record(Chain(), U, {"Fz": U, "Mx": U})
    with pytest.raises(ValueError, match="differ in length"):
        record(Chain(), U, {"Fz": U[1:]})
    with pytest.raises(ValueError, match="time must increase"):
        record(Chain(), U, FORCES, T[::-1])
    with pytest.raises(ValueError, match="turn = 5 deg needs both Fx and Fy; got Fx, Fz"):
        record(Chain(turn=5.0), U, {k: FORCES[k] for k in ("Fx", "Fz")})
    with pytest.raises(ValueError, match=r"no force makes a cell with nonlinearity = -0\.3 1/N read 2 N"):
        correct(Chain(nonlinearity=-0.3), U, {"Fz": U / U.max() * 2.0})


# ------------------------------------------------------------------------------------------ what cannot be a test

PRESS = np.linspace(0.0, 4.0, 81)
PULL = 0.04 * PRESS**1.5 + 0.003 * np.random.default_rng(1).normal(size=81)


def curve(depth=PRESS, force=PULL, time=None, head="depth_mm,Fz_N"):
    columns = (depth, force) if time is None else (time, depth, force)
    return table(head if time is None else "time_s," + head, zip(*columns, strict=True))


def along(*ways: tuple[float, float, int], noise: float = 0.0) -> str:
    """A test along straight ways of depth, from, to, readings."""
    depth = np.concatenate([np.linspace(*w) for w in ways])
    depth += noise * np.random.default_rng(6).normal(size=len(depth))
    return curve(depth, 0.04 * np.maximum(depth, 0) ** 1.5)


def once(value, at, to):
    out = value.copy()
    out[at] = to
    return out


IMPOSSIBLE = {  # content, words of the answer
    "compression negative": (curve(force=-PULL), ["'Fz' falls", "turn its sign"]),
    "no tare": (curve(force=PULL + 1.85), ["'Fz' is 1.85 N", "Subtract", "zero = "]),
    "position falls": (curve(depth=4.0 - PRESS), ["'depth' falls from 4 to 0 mm", "must grow"]),
    "no travel": (curve(depth=np.ones(81)), ["'depth' is 1 mm throughout"]),
    "no force": (curve(force=np.zeros(81)), ["'Fz' is 0 N throughout, the indenter felt nothing"]),
    "a position": (curve(depth=35.2 + PRESS), ["'depth' begins at 35.2 mm", "at least", "zero = "]),
    "a position of few rows": (curve(10 + np.arange(5.0), np.arange(5.0)), ["'depth' begins at 10 mm", "zero = "]),
    "a height turned": (curve(depth=PRESS - 60.0), ["'depth' lies between -60 and -56 mm", "zero = "]),
    "one wild depth": (curve(depth=once(PRESS, 50, 9.0)), [":52:", "jumps to 9 mm", "2.45 and 2.55"]),
    "a sum at the end": (curve(np.r_[PRESS, 162.0], np.r_[PULL, 9.0]), [":83:", "jumps to 162 mm", "last"]),
    "thousands": ("depth_um;Fz_mN\n0;0\n250;5\n500;14\n750;26\n1,000;40\n1,250;56\n", [":6:", "'1,000'", "1250"]),
    "thousands beside decimals": ("depth_um;Fz_mN\n0.10;0.5\n1,250;5.00\n", ["'0.10'", "'1,250'", "thousands"]),
}


@pytest.mark.parametrize("what", IMPOSSIBLE)
def test_what_cannot_be_a_test_is_refused_with_the_reason(tmp_path, what):
    content, words = IMPOSSIBLE[what]
    with pytest.raises(ValueError) as caught:
        read_measurement(write(tmp_path, content))
    for word in words:
        assert word in str(caught.value)


DISPLACED = {  # factor and addition to uz, words
    "right": (1.0, 0.0, None),
    "sign turned": (-1.0, 0.0, "go up by 2 mm while the indenter goes 4 mm down; uz is positive upwards: turn its"),
    "micrometres": (1000.0, 0.0, "uz goes from -2e+03 to"),
    "heights": (1.0, 35.0, "the displacement, not the height, of a mark: is its unit right?"),
    "noise and a bulge": (0.01, 0.05, None),
}


@pytest.mark.parametrize("what", DISPLACED)
def test_profiles_of_another_sign_or_unit_are_remarked_upon(tmp_path, what):
    factor, more, words = DISPLACED[what]
    places = [(d, float(x)) for d in (2.0, 4.0) for x in range(-20, 21, 5)]
    rows = [(d, x, 0.0, factor * -0.5 * d / (1.0 + (x / 5.0) ** 2) + more) for d, x in places]
    doubts = read_measurement(write(tmp_path, table("depth_mm,x_mm,y_mm,uz_mm", rows))).doubts
    assert [words in doubt for doubt in doubts] == [True] if words else doubts == ()


BY_HAND = {  # depth, force, words
    "compression negative": ([0, 1, 2, 4], [0, -0.04, -0.11, -0.32], "'Fz' falls from 0 to -0.32 N"),
    "upside down": ([4, 2, 1, 0], [0, 0.04, 0.11, 0.32], "'depth' falls from 4 to 0 mm"),
    "pulled in": ([0, 1, 2, 4], [-4, -3.9, -3, 1], "the body pulls the indenter in, keep the approach"),
    "untared": ([0, 1, 2, 4], [5, 5.04, 5.11, 5.32], "'Fz' is 5 N where the indenter begins to press"),
}


@pytest.mark.parametrize("what", BY_HAND)
@pytest.mark.parametrize("fine", [1, 2])
def test_tables_by_hand_have_sign_order_and_tare(tmp_path, what, fine):
    """Of four and of seven rows."""
    depth, force, words = BY_HAND[what]
    at = np.linspace(0, 3, 3 * fine + 1)
    rows = curve(np.interp(at, range(4), depth), np.interp(at, range(4), force))
    with pytest.raises(ValueError, match=r"data\.csv: column") as caught:
        read_measurement(write(tmp_path, rows))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "depth, force",
    [
        ([0, 1, 2, 4], [0, 0.04, 0.11, 0.32]),
        ([0, 4, 2, 0], [0, 0.32, 0.1, 0]),
        ([0.5, 1, 1.5, 2], [0.01, 0.04, 0.07, 0.1]),
        ([0, 0.1, 0.2, 4], [0.001, 0.002, 0.004, 0.32]),
        ([0, 2, 4, 4, 2, 0], [0, 0.1, 0.3, 0.25, 0.1, 0]),
    ],
)
def test_good_tables_by_hand_are_not_doubted(tmp_path, depth, force):
    assert read_measurement(write(tmp_path, curve(np.array(depth), np.array(force)))).doubts == ()


@pytest.mark.parametrize("n", [4, 5, 7])
@pytest.mark.parametrize("first", [0.5, 0.0])
@pytest.mark.parametrize(("column", "factor"), [("Fz", 10.0), ("Fz", 0.1), ("depth", 10.0), ("depth", 100.0)])
def test_a_decimal_point_that_slipped_in_a_table_by_hand_is_remarked_upon(tmp_path, n, first, column, factor):
    """Whichever row it is in; nothing refuses a table of a few rows for its shape."""
    for row in range(n):
        depth = 0.5 * np.arange(1, n + 1)
        force = 0.01 * depth**1.5 * (1.0 + 0.02 * (-1.0) ** np.arange(n))
        (force if column == "Fz" else depth)[row] *= factor
        depth, force = (np.append([0.0] * (first == 0.0), v) for v in (depth, force))
        if len(depth) > 7:
            continue
        try:
            doubts = read_measurement(write(tmp_path, curve(depth, force))).doubts
        except ValueError as error:
            assert "turns back" in str(error) or "depth" in str(error)
            continue
        (doubt,) = (d for d in doubts if "mistyped" in d)
        assert f"(line {row + 2 + (first == 0.0)})" in doubt


@pytest.mark.parametrize("factor", [1e-3, 9.81])
def test_a_repeat_in_another_unit_is_refused(tmp_path, factor):
    rows = [(u, f, 1) for u, f in zip(PRESS, PULL, strict=True)]
    rows += [(u, factor * f, 2) for u, f in zip(PRESS, PULL, strict=True)]
    with pytest.raises(ValueError, match="another sign, unit or tare"):
        read_measurement(write(tmp_path, table("depth_mm,Fz_N,repeat", rows)))


@pytest.mark.parametrize(("factor", "refused"), [(1e3, True), (1e-3, True), (0.3, False)])
def test_a_repeat_whose_depths_have_another_unit_is_refused(tmp_path, factor, refused):
    """In the mean over the depths that both have, it would count as a body without a force."""
    rows = [(u, f, 1) for u, f in zip(PRESS, PULL, strict=True)]
    rows += [(factor * u, f if refused else factor**1.5 * f, 2) for u, f in zip(PRESS, PULL, strict=True)]
    path = write(tmp_path, table("depth_mm,Fz_N,repeat", rows))
    with pytest.raises(ValueError, match="Has one of them another unit") if refused else nullcontext():
        read_measurement(path)


@pytest.mark.parametrize(("factor", "said"), [(1.2, False), (2.3, True), (0.5, True)])
def test_repeats_of_several_specimens_are_remarked_upon(tmp_path, factor, said):
    """Their mean is fitted, which is nobody's."""
    rows = [(u, f, 1) for u, f in zip(PRESS, PULL, strict=True)]
    rows += [(u, factor * f, 2) for u, f in zip(PRESS, PULL, strict=True)]
    doubts = read_measurement(write(tmp_path, table("depth_mm,Fz_N,repeat", rows))).doubts
    assert any("Are they of several specimens" in doubt for doubt in doubts) == said


@pytest.mark.parametrize("relaxes", [0.8, 1.0])
@pytest.mark.parametrize("reversed_rows", [False, True])
def test_work_that_a_body_cannot_give_back_is_remarked_upon(tmp_path, relaxes, reversed_rows):
    """A record in reverse order has its unloading first, which nothing else in it shows."""
    up = np.linspace(0.0, 4.0, 41)
    depth, force = np.r_[up, up[-2::-1]], np.r_[0.04 * up**1.5, relaxes * 0.04 * up[-2::-1] ** 1.5]
    force += 1e-3 * np.random.default_rng(2).normal(size=len(force))
    order = slice(None, None, -1 if reversed_rows else 1)
    doubts = read_measurement(write(tmp_path, curve(depth[order], force[order]))).doubts
    assert any("reverse order" in doubt for doubt in doubts) == (reversed_rows and relaxes < 1.0)


@pytest.mark.parametrize("jitter", [0.0, 2e-4])
def test_a_cycle_sorted_by_depth_is_two_curves(tmp_path, jitter):
    """Its mean lies 10 % below the loading, and no column tells."""
    rng, up = np.random.default_rng(5), np.linspace(0.0, 4.0, 61)
    depth = np.r_[up, up[-2::-1]] + jitter * rng.normal(size=121)
    force = np.r_[0.04 * up**1.5, 0.8 * 0.04 * up[-2::-1] ** 1.5] + 3e-4 * rng.normal(size=121)
    order = np.argsort(depth, kind="stable")
    assert any("two curves" in d for d in read_measurement(write(tmp_path, curve(depth[order], force[order]))).doubts)


@pytest.mark.parametrize("noise", ["white", "hum", "coarse", "remembers"])
def test_noise_of_one_curve_is_no_second_curve(noise):
    for seed in range(20):
        rng, n = np.random.default_rng(seed), 120
        up = np.linspace(0.0, 4.0, n)
        force, e = 0.04 * up**1.5, rng.normal(size=n)
        extra = {
            "white": 0.01 * e,
            "hum": 0.01 * np.sin(rng.uniform(0.2, 3.0) * np.arange(n)) + 1e-3 * e,
            "coarse": np.round((force + 5e-3 * e) / 0.012) * 0.012 - force,
            "remembers": 0.01 * np.convolve(e, np.ones(3) / 3**0.5, "same"),
        }[noise]
        assert curve_shape.two_curves(up, force + extra) == 0.0


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        (lambda force: np.maximum(force - 0.02, 0.0), True),  # a cell tared too high that shows nothing negative
        (lambda force: np.where(force < 0.02, 0.0, force), True),  # a threshold
        (lambda force: np.round(force / 0.01) * 0.01, False),  # a display of few digits
        (lambda force: np.round(0.32 * (PRESS / 4.0) ** 1.5 / 1.6e-3) * 1.6e-3, False),  # of which it passes several
        (lambda force: force, False),
    ],
)
def test_a_cell_that_shows_nothing_at_first_is_asked_about(tmp_path, shown, said):
    """A fit takes the place where it begins for the contact, 0.6 mm too deep, and says so to 0.02 mm."""
    rng = np.random.default_rng(3)
    force = shown(0.32 * (PRESS / 4.0) ** 1.5 + 1e-3 * rng.normal(size=len(PRESS)))
    text = curve(PRESS, force).replace("depth_mm,Fz_N", "Travel (mm),Force (N)")
    assert (
        any("shows nothing" in d or "show nothing" in d for d in read_measurement(write(tmp_path, text)).doubts) == said
    )


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_an_encoder_of_one_step_is_read_without_a_word_of_numpy(tmp_path):
    """It stands at 0 on the whole way, and at the deepest point from there on."""
    depth = np.r_[np.zeros(20), np.full(20, 0.1)]
    rows = zip(np.arange(40.0), depth, 0.01 * depth + 1e-5 * np.arange(40), strict=True)
    (r,) = read_measurement(write(tmp_path, table("time_s,depth_mm,Fz_N", rows))).repeats
    assert len(r.depth) == 40


def test_a_base_that_is_hit_is_no_contact(tmp_path):
    """The force has grown by a tenth of all before it: more than any drift in air."""
    u = np.linspace(0.0, 4.9, 200)
    force = 0.03 * u**1.5 + 5.0 * np.maximum(u - 4.5, 0.0)
    text = curve(u, force).replace("depth_mm,Fz_N", "Travel (mm),Force (N)")
    assert read_measurement(write(tmp_path, text)).contact == 0.0


def test_a_fall_of_the_force_is_said_though_readings_are_far_apart(tmp_path):
    """By 9 % of the range, five steps: a body that is pressed deeper gives none back."""
    force = 0.32 * (PRESS / 4.0) ** 1.5
    k = int(0.6 * len(PRESS))
    slipped = np.r_[force[:k], force[k:] - 0.03]
    assert any("Fz jumps by -0.0" in d for d in read_measurement(write(tmp_path, curve(PRESS, slipped))).doubts)


DOUBTFUL = {
    "a little untared": (PULL + 0.1, "not tared"),
    "untared by less": (PULL + 0.03, "N at 0 mm; not tared"),
    "untared downwards": (PULL - 0.03, "Fz is -0.0"),
    "untared by hand": (np.array([0.06, 0.08, 0.16, 0.38]), "not tared"),
    "touched before": (0.04 * (PRESS + 0.3) ** 1.5 + 0.1 * (PULL - 0.04 * PRESS**1.5), "touched before?"),
    "contact late": (0.04 * np.maximum(PRESS - 2.0, 0) ** 1.5, "contact lies near 2 mm"),
    "contact hardly late": (0.04 * np.maximum(PRESS - 0.3, 0) ** 1.5, "contact lies near 0.3"),
    "a noisy sensor at its end": (np.minimum(PULL, 0.2) + 1e-4 * np.sin(99 * PRESS), "Fz stays at 0.2 N from 2."),
    "creep": (np.r_[PULL, np.full(40, PULL[-1]) + 0.001 * np.sin(np.arange(40))], "held at constant force"),
    "broken through": (np.where(PRESS > 3.5, 0.5, 1.0) * PULL, "Fz falls from 0.2"),
    "taken off before the end": (
        np.where(PRESS > 3.92, 0.0, PULL),
        "N while the indenter goes on to 4 mm. Did it slip",
    ),
    "sensor at its end": (np.minimum(0.04 * PRESS**1.5, 0.2), "a sensor at its end"),
}


@pytest.mark.parametrize("what", DOUBTFUL)
def test_what_is_doubtful_is_said(tmp_path, what):
    force, words = DOUBTFUL[what]
    depth = np.linspace(0.0, 4.0, len(force))
    assert any(words in doubt for doubt in read_measurement(write(tmp_path, curve(depth, force))).doubts)


@pytest.mark.parametrize("air, noise, n", [(0.3, 1e-3, 41), (0.3, 3e-3, 400), (0.6, 3e-3, 81), (0.9, 3e-3, 41)])
def test_air_counted_as_depth_is_said_with_where_the_force_begins(tmp_path, air, noise, n):
    """7 to 18 % of the travel, which a fit would take for a softer body; noise as a share of the largest force."""
    u = np.linspace(0.0, 4.0 + air, n)
    force = 0.6 * (np.maximum(u - air, 0.0) / 4.0) ** 1.4 + 0.6 * noise * np.random.default_rng(7).normal(size=n)
    (doubt,) = read_measurement(write(tmp_path, curve(u, force))).doubts
    assert abs(float(doubt.split("contact lies near ")[1].split(" mm")[0]) - air) < 0.1
    assert "subtract" in doubt and "'offset'" in doubt


@pytest.mark.parametrize("start", [1.0, 2.2, 3.0])
@pytest.mark.parametrize("power", [1.0, 1.5, 2.2, 4.0])
def test_a_record_whose_first_readings_were_left_out_is_no_position(tmp_path, power, start):
    depth = np.linspace(start, 4.0, 41)
    force = 0.32 * (depth / 4.0) ** power + 0.001 * np.random.default_rng(4).normal(size=41)
    assert len(read_measurement(write(tmp_path, curve(depth, force))).repeats[0].depth) == 41


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("noise, n", [(0.0, 41), (0.003, 41), (0.01, 81), (0.01, 400), (0.03, 400)])
def test_curves_from_contact_on_are_not_said_to_be_late(tmp_path, seed, noise, n):
    """Punch to stiffening body, a compliant machine, a relaxing body, a spike, an approach, a coarse sensor."""
    u, rng = np.linspace(0.0, 4.0, n), np.random.default_rng(seed)
    ball = 0.04 * u**1.5
    curves = {f"power {p}": (u, 0.32 * (u / 4.0) ** p) for p in (1.0, 1.3, 1.5, 2.0, 2.2)}
    curves["compliant"] = (u + 2.0 * ball, ball)
    curves["relaxing"] = (u, ball * (0.5 + 0.5 * np.exp(-u)))
    if noise < 0.01:  # else the layer is seen as little as air
        curves["soft layer"] = (u, 0.005 * u + 0.04 * np.maximum(u - 1.0, 0.0) ** 1.5)
    curves["stiffening"] = (u, ball * (1.0 + 0.1 * u**2))
    curves["spike at the end"] = (u, once(ball, -1, 3.0))
    curves["approach"] = (np.r_[np.linspace(-4.0, -0.1, n), u], np.r_[np.zeros(n), ball])
    curves["coarse"] = (u, np.round(ball / 0.01) * 0.01)
    for what, (depth, force) in curves.items():
        scatter = 0.32 * noise * rng.normal(size=len(force))
        doubts = read_measurement(write(tmp_path, curve(depth, force + scatter))).doubts
        words = ("contact", "tared", "stays at", *(() if "spike" in what else ("falls from",)))
        assert not [doubt for doubt in doubts if any(word in doubt for word in words)], what


BEFORE = "before its deepest point"


def test_a_block_before_the_test_is_remarked_upon(tmp_path):
    block = (0.0, 0.5, 11), (0.5, 0.0, 11), (0.0, 4.0, 81)
    assert [
        doubt
        for doubt in read_measurement(write(tmp_path, along(*block))).doubts
        if "back by 0.5 mm " + BEFORE in doubt
    ]
    assert [doubt for doubt in read_measurement(write(tmp_path, along(*block, noise=0.005))).doubts if BEFORE in doubt]


def stairs(rest_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, depth and force of four steps in 2 s each and a rest after each, in which the force relaxes by a third."""
    rest = np.arange(0.1, rest_s + 0.1, 0.1)
    depth = np.concatenate([np.r_[np.linspace(k, k + 1, 21), np.full(len(rest), k + 1.0)] for k in range(4)])
    relaxed = np.tile(np.r_[np.ones(21), 0.7 + 0.3 * np.exp(-rest / 5)], 4)
    return 0.1 * np.arange(len(depth)), depth, 0.04 * depth**1.5 * relaxed


def test_steps_with_rests_are_remarked_upon(tmp_path):
    time, depth, force = stairs(30.0)
    (doubt,) = read_measurement(write(tmp_path, curve(depth, force, time))).doubts
    assert "rests for 30 s near " in doubt and "one loading at a steady speed" in doubt
    time, depth, force = stairs(0.5)
    assert read_measurement(write(tmp_path, curve(depth, force, time))).doubts == ()
    time, depth, force = (v[-1200:] for v in stairs(30.0))
    assert not [d for d in read_measurement(write(tmp_path, curve(depth, force))).doubts if "falls from" in d]


ONE_WAY = {  # ways of depth and their noise, none of them with a block before the test
    "back by jitter": (((0.0, 2.0, 41), (2.0, 1.85, 4), (1.85, 4.0, 41)), 0.0),
    "about in the air": (((-1.0, -0.1, 11), (-0.1, -0.8, 8), (-0.8, 4.0, 81)), 0.0),
    "noise": (((0.0, 1.0, 401), (1.0, 0.0, 401)), 0.02),
    "back after the deepest point": (((0.0, 4.0, 81), (4.0, 3.4, 13), (3.4, 3.9, 11), (3.9, 0.0, 81)), 0.0),
}


@pytest.mark.parametrize("what", ONE_WAY)
def test_one_way_there_is_not_remarked_upon(tmp_path, what):
    ways, noise = ONE_WAY[what]
    assert not [
        doubt for doubt in read_measurement(write(tmp_path, along(*ways, noise=noise))).doubts if BEFORE in doubt
    ]


def test_nothing_is_doubtful_in_the_records_of_the_studies():
    records = sorted((Path(__file__).parents[2] / "studies").glob("**/measured/*.csv"))
    assert len(records) > 10
    said = [(path.parent.parent.name, doubt) for path in records for doubt in read_measurement(path).doubts]
    assert [study for study, doubt in said if "are those of creep" in doubt] == [
        "creep"
    ] * 2  # held by force, knowingly
    assert [doubt for study, doubt in said if study != "creep"] == []


@pytest.mark.parametrize("power", [1.0, 1.5, 2.2])
@pytest.mark.parametrize("level", [0.0, -0.01])
def test_good_curves_are_neither_refused_nor_doubted(tmp_path, power, level):
    """From a flat punch to a stiffening body, with a little adhesion, noise and decimal commas."""
    force = 0.32 * (PRESS / 4.0) ** power + level + 0.003 * np.random.default_rng(2).normal(size=81)
    text = curve(force=force, head="depth_mm;Fz_N").replace(",", ";").replace(".", ",")
    m = read_measurement(write(tmp_path, text))
    assert m.doubts == ()
    np.testing.assert_allclose(m.repeats[0].channels["Fz"], force, rtol=0, atol=1e-6)


def test_up_again_on_the_way_is_no_rest_and_steps_of_an_encoder_neither(tmp_path):
    ways = (0.0, 4.0, 80), (4.0, 3.3, 15), (3.3, 4.0, 15), (4.0, 0.0, 80)
    up = np.concatenate([np.linspace(*w) for w in ways])
    steps = np.round(np.linspace(0, 4, 801) / 0.1) * 0.1
    for depth in (up, steps):
        text = curve(depth, 0.04 * np.maximum(depth, 0) ** 1.5, 0.05 * np.arange(len(depth)))
        assert "hold" not in read_measurement(write(tmp_path, text)).repeats[0].segment


FINE = {  # what laboratories do, none of it wrong
    "home through the air": np.r_[np.linspace(0, 4, 81), np.linspace(3.95, -6, 200)],
    "a wait, then few readings": np.r_[np.zeros(40), np.linspace(0.25, 4, 16), np.linspace(3.75, 0, 16)],
    "geometric, there and back": np.r_[np.geomspace(0.01, 4, 40), np.geomspace(4, 0.01, 40)[1:]],
    "few and deep": np.array([0.1, 3.0, 3.2, 3.4, 3.5, 3.6, 3.7, 3.8, 3.9, 4.0]),
    "slowing down": 4.0 * (1 - np.exp(-np.linspace(0, 5, 200))),
    "in levels": np.repeat(np.linspace(0.5, 4, 8), 11),
}


@pytest.mark.parametrize("what", FINE)
def test_ways_of_laboratories_are_not_refused(tmp_path, what):
    depth = FINE[what]
    m = read_measurement(write(tmp_path, curve(depth, 0.04 * np.maximum(depth, 0.0) ** 1.5)))
    (r,) = m.repeats
    assert not [doubt for doubt in m.doubts if BEFORE in doubt]
    assert np.ptp(r.depth[r.segment == "loading"]) > 3.0


def test_repeats_of_noise_and_repeats_with_a_spike_are_not_told_to_have_another_sign(tmp_path):
    rng = np.random.default_rng(5)
    silent = [(u, f, k) for k in range(3) for u, f in zip(0.1 * PRESS, 0.003 * rng.normal(size=81), strict=True)]
    spiked = [(u, f, k) for k in range(2) for u, f in zip(PRESS, once(PULL, 60, 5.0 if k else PULL[60]), strict=True)]
    for rows in (silent, spiked):
        assert len(read_measurement(write(tmp_path, table("depth_mm,Fz_N,repeat", rows))).repeats) > 1


def test_whole_numbers_beside_decimals_part_no_thousands(tmp_path):
    m = read_measurement(write(tmp_path, "depth_mm;Fz_N\n0.0;0\n1.0;0,04\n2.0;0,1\n"))
    assert m.channels == ("Fz",) and m.repeats[0].depth.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("stop_s", [6.71, 6.73, 6.78])
@pytest.mark.parametrize("brake_s", [0.0, 0.05])
@pytest.mark.parametrize("settling", [0.0, 2e-4])
def test_a_hold_begins_where_the_machine_stops_between_two_readings(tmp_path, stop_s, brake_s, settling):
    """1 mm/s and 10 readings a second: what the body relaxes until the first reading at rest is not of the way there.

    A testing machine wrote such records of muscle: a tenth of the force within the first tenth of a second.
    """
    t = np.arange(0.0, 17.0, 0.1)
    u = np.where(t < stop_s, t, stop_s) - np.where(t >= stop_s, settling * np.exp(stop_s - t), 0.0)
    u = np.minimum(u, stop_s - 0.5 * brake_s * np.clip(1.0 - (t - stop_s) / max(brake_s, 1e-9), 0.0, 1.0) ** 2)
    F = 0.1 * np.minimum(u, 6.7) ** 2 * np.where(t > stop_s, 0.6 + 0.4 * np.exp(-np.maximum(t - stop_s, 0) / 0.4), 1.0)
    (r,) = read_measurement(write(tmp_path, table("time_s,depth_mm,Fz_N", zip(t, u, F, strict=True)))).repeats
    loading = r.segment == "loading"
    # where it stops less than half a step before a reading, that reading is its way's last
    assert r.time[loading][-1] == pytest.approx(6.8 if stop_s > 6.75 else 6.7)
    assert r.depth[loading][-1] > 0.99 * stop_s and np.sum(r.segment == "hold") == np.sum(~loading)


@pytest.mark.parametrize("back", [True, False])
@pytest.mark.parametrize("rest", [10, 20, 30])
def test_a_stage_that_rests_exactly_is_no_encoder(tmp_path, rest, back):
    u = np.r_[np.linspace(0, 4, 9), np.full(rest, 4.0), np.linspace(3.5, 0, 8) if back else []]
    (r,) = read_measurement(write(tmp_path, curve(u, 0.04 * u**1.5, np.arange(len(u)) * 1.0))).repeats
    assert np.sum(r.segment == "hold") == rest and np.sum(r.segment == "loading") == 9


def test_spikes_are_left_out_of_the_mean_too(tmp_path):
    """As in a diagnosis: one reading of 9 N in 81 changes nothing."""
    clean, spiked = (read_measurement(write(tmp_path, curve(force=f))) for f in (PULL, once(PULL, 40, 9.0)))
    a, b = (combine(m, Noise(**NONE)) for m in (clean, spiked))
    np.testing.assert_allclose(np.interp(a.depth, b.depth, b.value), a.value, rtol=0, atol=0.01)
    assert b.sigma.max() < 2.0 * a.sigma.max()


@pytest.mark.parametrize("at, to", [(0, 5.0), (-1, 0.0), (-1, 5.0)])
def test_a_first_or_last_reading_out_of_line_is_left_out_and_not_its_neighbour(tmp_path, at, to):
    """A last row of zeros, a first one before the amplifier settled; how far a stop goes is no matter."""
    m, (note,) = without_spikes(read_measurement(write(tmp_path, curve(force=once(PULL, at, to)))))
    assert "1 reading(s) out of line" in note and m.repeats[0].depth.tolist() == np.delete(PRESS, at).tolist()


@pytest.mark.parametrize("seed", range(20))
def test_what_stands_beside_a_last_reading_out_of_line_is_kept(tmp_path, seed):
    depth = 0.05 * np.arange(46)
    force = 1.9 * depth**1.6 + 0.004 * np.random.default_rng(seed).normal(size=46)
    force[-1] *= 0.4
    m, _ = without_spikes(read_measurement(write(tmp_path, curve(depth, force))))
    np.testing.assert_allclose(m.repeats[0].depth, depth[:-1], rtol=0, atol=1e-12)


def test_a_last_reading_at_a_deeper_point_is_no_spike(tmp_path):
    depth = np.r_[np.linspace(0.0, 1.0, 21), 1.38]
    assert without_spikes(read_measurement(write(tmp_path, curve(depth, 0.04 * depth**4))))[1] == []


@pytest.mark.parametrize("n", [100, 400])
@pytest.mark.parametrize("kind", ["force", "depth"])
def test_noise_that_grows_with_the_force_has_no_spikes(n, kind):
    """3 % of the force, or 0.03 mm of depth: of 200 records at most two lose a reading; a true spike is found."""
    u, rng, lost, found = np.linspace(0.1, 4.0, n), np.random.default_rng(0), 0, 0
    at = n // 2
    for _ in range(200):
        depth = u + (0.03 * rng.standard_normal(n) if kind == "depth" else 0.0)
        y = 0.14 * depth.clip(0) ** 1.5 * (1 + (0.03 * rng.standard_normal(n) if kind == "force" else 0.0))
        y += 0.0005 * rng.standard_normal(n)
        lost += bool(without_spikes(one(u, y))[1])
        y[at] += 0.4
        found += len(without_spikes(one(u, y))[0].repeats[0].depth) == n - 1
    assert lost <= 2 and found >= 196


def one(u, y):
    repeat = Repeat("1", u, None, {"Fz": y}, {}, np.array(["loading"] * len(u)))
    return Measurement(Path("x.csv"), "force", (repeat,), ())


def test_waves_of_a_filtered_signal_are_no_spikes(tmp_path):
    """1 kHz of a cantilever that swings at 60 to 100 Hz, an approach at rest far longer than the rest."""
    t = np.linspace(0.0, 6.0, 6001)
    depth, swing = np.maximum(t - 4.0, 0.0), 1e-3 * np.sin(2 * np.pi * (60 * t + 20 * np.sin(t))) * (t > 4.5)
    noise = 1e-6 * np.random.default_rng(5).normal(size=len(t))
    assert (
        without_spikes(read_measurement(write(tmp_path, curve(depth, 0.04 * depth**1.5 + swing + noise, t))))[1] == []
    )


def test_toggles_of_a_coarse_sensor_are_no_spikes(tmp_path):
    """Steps of 20 mN in 801 readings with 1 mN of noise: a reading on the next step stands out of line by one step."""
    u = np.linspace(0.0, 4.0, 801)
    force = np.round((0.04 * u**1.5 + 1e-3 * np.random.default_rng(3).normal(size=801)) / 0.02) * 0.02
    assert without_spikes(read_measurement(write(tmp_path, curve(u, force))))[1] == []


def test_a_repeat_whose_force_has_another_sign_to_the_same_depth_is_refused(tmp_path):
    """It begins where the ball presses already, so that its zero cannot be checked by itself."""
    late = PRESS > 1.0
    rows = [(u, f, 1) for u, f in zip(PRESS, PULL, strict=True)]
    rows += [(u, f - 0.6, 2) for u, f in zip(PRESS[late], PULL[late], strict=True)]
    with pytest.raises(ValueError, match="another sign, unit or tare"):
        read_measurement(write(tmp_path, table("depth_mm,Fz_N,repeat", rows)))


def test_what_a_column_states_of_each_reading_is_averaged_with_them(tmp_path):
    """4000 readings of 3 mN each were a curve of 3 mN, and five repeats no better; a correlated error stays."""
    rng = np.random.default_rng(4)
    u = np.linspace(0.001, 4.0, 4000)
    rows = [(r + 1, d, 0.1 * d**1.5 + 0.003 * rng.standard_normal()) for r in range(5) for d in u]
    text = "".join(f"{r},{d:.6f},{f:.8f},3\n" for r, d, f in rows)
    m = read_measurement(write(tmp_path, "repeat,depth_mm,Fz_N,Fz_sigma_mN\n" + text))
    white = combine(m, Noise(**NONE))
    true = 0.1 * white.depth**1.5
    honest = float(np.sqrt(np.mean(((white.value - true) / white.sigma)[20:] ** 2)))
    assert 0.6 < honest < 1.2  # stated and shown both count: at most √2 too wide
    assert np.median(white.sigma) < 1.05 * 0.003 / np.sqrt(50)  # both: √2 · 3 mN/√100, known to 1.3 % from 796
    kept = combine(m, Noise(gain=0.0, contact=0.0, correlation=0.5))
    assert np.median(kept.sigma) == pytest.approx(0.003, rel=0.05)


def lossy(cells, n=101):
    """A loading of n readings, in some rows of which a cell is replaced: {row: (column, cell)}."""
    rows = [[f"{d:.3f}", f"{0.04 * d**1.5:.5f}"] for d in np.linspace(0.0, 4.0, n)]
    for k, (column, cell) in cells.items():
        rows[k][column] = cell
    return "depth_mm,Fz_N\n" + "".join(",".join(row) + "\n" for row in rows)


@pytest.mark.parametrize("cell", ["", "NaN", "#N/A"])
def test_a_few_rows_without_a_value_are_left_out_and_said(tmp_path, cell):
    """Samples lost on a bus: what remains is read as if they had never been, in one curve."""
    path = tmp_path / "top.csv"
    path.write_text(lossy({40: (1, cell), 70: (0, cell)}))
    m = read_measurement(path)
    (repeat,) = m.repeats
    keep = np.delete(np.arange(101), [40, 70])
    np.testing.assert_array_equal(repeat.depth, np.round(np.linspace(0.0, 4.0, 101), 3)[keep])
    assert "2 rows have no value (lines 42, 72): left out, 99 remain" in m.doubts[0]


@pytest.mark.parametrize(
    "cells",
    [
        {k: (1, "") for k in range(10, 30, 3)},
        {k: (1, "NaN") for k in (90, 91)},
        {40: (1, "----")},
        {40: (1, "overload")},
    ],
)
def test_many_gaps_and_what_says_something_are_refused(tmp_path, cells):
    path = tmp_path / "top.csv"
    path.write_text(lossy(cells))
    with pytest.raises(ValueError, match=f"{path}:{min(cells) + 2}: "):
        read_measurement(path)


@pytest.mark.parametrize("readings", [150, 400, 4000])
@pytest.mark.parametrize("levels", [10, 30])
def test_a_coarse_scale_is_noise(tmp_path, readings, levels):
    """Readings on the marks of a scale scatter less from one to the next than they are off."""
    depth = np.linspace(0.0, 0.3, readings)
    force = 0.06 * depth**1.5
    step = force.max() / levels
    path = tmp_path / "a.csv"
    rows = [f"{u:.6f},{round(f / step) * step:.9g}" for u, f in zip(depth, force, strict=True)]
    path.write_text("\n".join(["depth_mm,Fz_N", *rows]) + "\n")
    m = read_measurement(path)
    curve = combine(m, Noise())
    off = (curve.value - np.interp(curve.depth, depth, force)) / curve.white
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.15  # an even error within half a step; means over marks are off by less
    assert any(f"steps of {quantity_text(step, 'N')}" in d for d in m.doubts)


def test_scatter_that_blurs_a_scale_is_all_that_counts(tmp_path):
    rng = np.random.default_rng(3)
    depth = np.linspace(0.0, 0.3, 4000)
    force = 0.06 * depth**1.5
    step = force.max() / 30
    path = tmp_path / "a.csv"
    noisy = np.round((force + 0.7 * step * rng.standard_normal(4000)) / step) * step
    path.write_text("depth_mm,Fz_N\n" + "".join(f"{u:.6f},{f:.9g}\n" for u, f in zip(depth, noisy, strict=True)))
    curve = combine(read_measurement(path), Noise())
    off = (curve.value - np.interp(curve.depth, depth, force)) / curve.white
    assert 0.85 < np.sqrt(np.mean(off**2)) < 1.15  # of 200 means: 5 % of sampling, three of these
