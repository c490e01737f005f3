"""Files as instruments write them: the numbers of one plain curve come back, or the message says what to do."""

from pathlib import Path

import numpy as np
import pytest

from rso.data import read_measurement

T = np.round(np.arange(61) * 0.1, 6)
U = np.round(np.linspace(0.0, 1.2, 61), 6)  # mm
F = 0.8 * U**1.5  # N


def table(
    head: list[str], columns: list[np.ndarray], separator: str = "\t", digits: int = 6, comma: bool = False
) -> str:
    rows = [separator.join(f"{v:.{digits}f}" for v in row) for row in zip(*columns, strict=True)]
    rows = [row.replace(".", ",") for row in rows] if comma else rows
    return "\n".join([*head, *rows]) + "\n"


MACHINES = {  # text of the file
    "Hysitron": "Number of Points = 61\n" + table(["Depth (nm)\tLoad (uN)\tTime (s)", "eoh"], [U * 1e6, F * 1e6, T]),
    "plate reader rig": "Rig,7\nWell,X1\n\n"
    + table(["Timestamp(s),Z_Position(mm),Corrected_Force(N)"], [100 + T, -10 - U, -F], ",")
    + "Total_Time(s),6.0\n",
    "footer as wide as the table": table(["Indentation (mm),Force (N)"], [U, F], ",")
    + "Total_Measurement_Time(s),8.0\n",
    "Mach-1": "<Mach-1 File>\n<INFO>\nDate:\tTue\n<END INFO>\n<Stress Relaxation>\nRamp Amplitude, mm:\t1.2\n<DATA>\n"
    + table(["Time, s\tPosition (z), mm\tFz, gf"], [T, U, -F / 9.80665e-3])
    + "<END DATA>\n",
    "Piuma": "Date\t01/02/2024\nTip radius (um)\t50\nk (N/m)\t0.5\n\n"
    + table(
        ["Time (s)\tLoad (uN)\tIndentation (nm)\tCantilever (nm)\tPiezo (nm)"], [T, F * 1e6, U * 1e6, 0 * U, U * 1e6]
    ),
    "nanoindenter": table(
        ["Displacement Into Surface,Load On Sample,Time On Sample", "nm,mN,s"], [U * 1e6, F * 1e3, T], ","
    ),
    "Bluehill": '"Specimen","1"\n\n'
    + table(['"Time","Compressive extension","Compressive load"', '"(sec)","(mm)","(N)"'], [T, U, F], ","),
    "TestXpert": "Prüfer;NN\n" + table(["Prüfzeit;Standardweg;Standardkraft", "s;mm;N"], [T, U, F], ";", comma=True),
    "French": table(["Temps (s);Profondeur (µm);Force normale (mN)"], [T, U * 1e3, F * 1e3], ";", comma=True),
    "Spanish": table(["Tiempo (s);Desplazamiento (mm);Carga (N)"], [T, U, F], ";", comma=True),
    "Italian": table(["Tempo (s);Spostamento (mm);Carico (N)"], [T, U, F], ";", comma=True),
    "Polish": table(["Czas (s);Przemieszczenie (mm);Siła (N)"], [T, U, F], ";", comma=True),
    "Chinese": table(["时间(s),位移(mm),力(N)"], [T, U, F], ","),
    "symbols": table(["t (s)\th (µm)\tP (mN)"], [T, U * 1e3, F * 1e3]),
    "a line drawn beneath": table(["Distance (mm)\tForce (N)", "-----\t-----"], [U, F]) + "--- end of data ---\n",
}


@pytest.mark.parametrize("machine", MACHINES)
def test_the_numbers_of_an_instrument_come_back(tmp_path, machine):
    path = tmp_path / "data.txt"
    path.write_text(MACHINES[machine], encoding="utf-8")
    (r,) = read_measurement(path).repeats
    assert len(r.depth) == len(U)
    np.testing.assert_allclose(np.diff(r.depth), np.diff(U), atol=2e-6)
    np.testing.assert_allclose(r.channels["Fz"] - r.channels["Fz"][0], F, atol=2e-5)


def two_blocks(tmp_path: Path) -> Path:
    block = (
        "<{}>\nStage Axis:\tPosition (z)\nRamp Amplitude, mm:\t0.3\n"
        "<DATA>\nTime, s\tPosition (z), mm\tFz, gf\n{}<END DATA>\n"
    )
    air = table([], [T[:20], U[:20], 0.0 * U[:20] + 0.01 * np.cos(T[:20] * 40)])
    press = table([], [T, 0.4 + U, -F / 9.80665e-3])
    path = tmp_path / "mach.txt"
    path.write_text(
        "<Mach-1 File>\n" + block.format("Find Contact", air.lstrip()) + block.format("Ramp", press.lstrip())
    )
    return path


def test_blocks_that_are_no_repeats_are_named(tmp_path):
    path = two_blocks(tmp_path)
    with pytest.raises(ValueError, match=r'2 tables .* no repeats .*#1 from line .*#2 from line .*data = "mach.txt#2"'):
        read_measurement(path)
    r = read_measurement(f"{path}#2").repeats[0]
    assert len(r.depth) == 61 and abs(float(r.depth[0])) < 0.02
    np.testing.assert_allclose(r.channels["Fz"], F, atol=1e-4)
    with pytest.raises(ValueError, match="has no block 3; it holds 2"):
        read_measurement(f"{path}#3")


def test_blocks_of_one_file_are_different_readings(tmp_path):
    text = table(["depth_mm,Fz_N"], [U, F], ",")
    (tmp_path / "a.csv").write_text(text + text.replace("0.8", "0.8"))
    m = read_measurement([f"{tmp_path}/a.csv#1", f"{tmp_path}/a.csv#2"])
    assert [r.label for r in m.repeats] == ["a#1", "a#2"]


def test_a_ball_taken_off_further_than_it_was_pressed_keeps_its_sign(tmp_path):
    up = np.linspace(1.2, -2.5, 80)[1:]
    depth, force = np.r_[U, up], np.r_[F, 0.75 * np.maximum(up, 0.0) ** 1.5 - 0.05 * (up < 0) * np.exp(up)]
    time = np.arange(len(depth)) * 0.1
    path = tmp_path / "data.txt"
    path.write_text(table(["Time (s)\tPd (mm)\tFn (N)"], [time, depth, force]))
    (r,) = read_measurement(path).repeats
    loading = r.segment == "loading"
    assert float(r.depth.max()) == pytest.approx(1.2, abs=0.02) and r.channels["Fz"][loading].max() > 1.0


def test_a_word_below_the_readings_that_may_be_one_is_told(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(table(["depth_mm,Fz_N"], [U, F], ",") + "Max,1.05\n")
    assert any("'Max 1.05'" in d and "note" in d for d in read_measurement(path).doubts)


def test_a_reading_cut_short_is_still_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(table(["time_s,depth_mm,Fz_N"], [T, U, F], ",") + "6.1,1.25\n")
    with pytest.raises(ValueError, match="2 values in a table of 3 columns"):
        read_measurement(path)


@pytest.mark.parametrize("segments", [False, True])
def test_a_hold_at_constant_force_is_never_loading(tmp_path, segments):
    creep = np.linspace(1.2, 1.29, 40)[1:]
    depth, force = np.r_[U, creep], np.r_[F, np.full(len(creep), F[-1])]
    path = tmp_path / "a.csv"
    rows = [
        f"{0.1 * k:.1f},{u:.6f},{f:.6f}" + (",loading" if k < 61 else ",hold") * segments
        for k, (u, f) in enumerate(zip(depth, force, strict=True))
    ]
    path.write_text("\n".join(["time_s,depth_mm,Fz_N" + ",segment" * segments, *rows, ""]))
    m = read_measurement(path)
    assert m.repeats[0].depth.max() <= 1.2001 and any("readings are those of creep" in d for d in m.doubts)
    held = m.repeats[0].creep
    assert len(held.depth) in (38, 39) and held.depth[-1] == pytest.approx(1.29)


def test_a_record_that_says_that_it_was_pulled_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Test type,Tensile\n" + table(["Extension (mm),Load (N)"], [U, U], ","))
    with pytest.raises(ValueError, match="'Test type Tensile' says that the specimen was pulled"):
        read_measurement(path)
    path.write_text(
        "Test type,Compression\nFixture,tensile and compression\n" + table(["Extension (mm),Load (N)"], [U, F], ",")
    )
    assert len(read_measurement(path).repeats[0].depth) == 61


def test_a_double_turn_is_marked_as_a_guess(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(table(["Position (mm),Load (N)"], [-U, -F], ","))
    m = read_measurement(path)
    assert any("both signs were turned, which is a guess: a pull looks the same" in d for d in m.doubts) and m.guessed
    path.write_text(table(["Position (mm),Load (N)"], [U, -F], ","))
    assert not any("guess" in d for d in read_measurement(path).doubts) and not read_measurement(path).guessed


WORDS = {
    "English": ("Load", "Hold", "Unload"),
    "German": ("Belasten", "Halten", "Entlasten"),
    "microscope": ("extend", "pause", "retract"),
}
THERE = np.r_[np.linspace(0.0, 1.2, 31), np.full(10, 1.2), np.linspace(1.2, 0.0, 21)[1:]]
PARTS = np.r_[np.zeros(31, int), np.ones(10, int), np.full(20, 2)]


def segmented(tmp_path: Path, words: tuple[str, ...], first: bool, name: str = "Segment") -> Path:
    force = 0.8 * THERE**1.5 * np.where(PARTS > 0, 0.9, 1.0)
    rows = [[f"{u:.6f}", f"{f:.6f}"] for u, f in zip(THERE, force, strict=True)]
    rows = [[words[k], *row] if first else [*row, words[k]] for k, row in zip(PARTS, rows, strict=True)]
    head = [name, "Indentation (mm)", "Force (N)"] if first else ["Indentation (mm)", "Force (N)", name]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    return path


@pytest.mark.parametrize("name", ["Segment", "Segment Type"])
@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("language", WORDS)
def test_words_of_segments_are_read_and_said(tmp_path, language, first, name):
    m = read_measurement(segmented(tmp_path, WORDS[language], first, name))
    assert m.repeats[0].segment.tolist() == np.array(["loading", "hold", "unloading"])[PARTS].tolist()
    assert any(f"{name!r} is read as segment: {WORDS[language][0]!r} is loading, " in d for d in m.doubts)
    assert m.unread == ()


@pytest.mark.parametrize("codes", [("1", "2", "3"), ("Load", "Plateau", "Unload")])
def test_codes_of_segments_are_asked_about_and_not_guessed(tmp_path, codes):
    m = read_measurement(segmented(tmp_path, codes, False, "SegmentID"))
    assert "SegmentID" in m.unread and any(f'values = {{ "{codes[0]}" = "…", ' in d for d in m.doubts)
    assert m.repeats[0].segment.tolist() != np.array(["loading", "hold", "unloading"])[PARTS].tolist()


def test_a_penetration_counts_from_contact_as_it_says(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(table(["Time (s)\tPd (mm)\tFn (N)"], [T, U, F]))
    np.testing.assert_allclose(read_measurement(path).repeats[0].depth, U, atol=2e-6)


PAGES = {
    "cp932": "時間(s),ストローク(mm),試験力(N)",
    "gb18030": "时间(s),位移(mm),载荷(N)",
    "cp949": "시간(s),변위(mm),하중(N)",
    "cp1251": "время(s),перемещение(mm),сила(N)",
    "cp1250": "czas(s),głębokość(mm),siła(N)",
    "latin-1": "Prüfzeit(s),Prüfweg(mm),Prüfkraft(N)",
}


@pytest.mark.parametrize("page", PAGES)
def test_names_of_an_older_code_page_are_read(tmp_path, page):
    path = tmp_path / "a.csv"
    path.write_bytes(table([PAGES[page]], [T, U, F], ",").encode(page))
    m = read_measurement(path)
    np.testing.assert_allclose(m.repeats[0].channels["Fz"], F, atol=2e-6)
    assert any("UTF-8 would need no guess" in d for d in m.doubts) == (page != "latin-1")


def test_a_segment_that_is_named_where_it_begins_goes_on_below(tmp_path):
    """As nanoindenters write it; the first reading of a segment may lack what is not read."""
    force = 0.8 * THERE**1.5 * np.where(PARTS > 0, 0.9, 1.0)
    begins = np.r_[True, np.diff(PARTS) > 0]
    words = np.array(["Load Segment Type", "Hold Segment Type", "Unload From Peak Segment Type"])[PARTS]
    rows = [
        f"{word if new else ''}\t{u:.6f}\t{f:.6f}\t{'' if new else '1.5'}"
        for word, new, u, f in zip(words, begins, THERE, force, strict=True)
    ]
    path = tmp_path / "a.txt"
    path.write_text("\n".join(["Segment\tDisplacement (mm)\tLoad (N)\tStiffness (N/m)", *rows]) + "\n")
    (r,) = read_measurement(path).repeats
    assert r.segment.tolist() == np.array(["loading", "hold", "unloading"])[PARTS].tolist()
    np.testing.assert_allclose(r.channels["Fz"], force, atol=2e-6)


@pytest.mark.parametrize(
    ("other", "values", "told"),
    [
        ("LVDT displacement (um)", 1e3 * (U - 0.1 * F), True),  # the frame gives way by 0.1 mm/N
        ("LVDT displacement (mm)", 5.0 - U, False),  # the same travel as a gap
        ("Width (mm)", 8.0 + 0.0 * U, False),
        ("Gauge 2 (mm)", np.sin(7.0 * U), False),
        ("Raw load (mN)", 800.0 * F, True),  # before the calibration
        ("Force filtered (N)", F + 1e-4 * np.cos(90.0 * U), False),
        ("Torque (Nmm)", F, False),
    ],
)
def test_a_second_travel_or_force_that_says_something_else_is_told(tmp_path, other, values, told):
    path = tmp_path / "a.csv"
    path.write_text(table([f"Time (s),Crosshead (mm),Force (N),{other}"], [T, U, F, values], ","))
    said = [d for d in read_measurement(path).doubts if f"{other!r} is not read. It moves with" in d]
    assert len(said) == told


def test_times_since_1970_are_those_of_the_test(tmp_path):
    """Loggers write seconds, milliseconds or nanoseconds since 1970."""
    for unit, per in (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
        path = tmp_path / f"{unit}.csv"
        rows = [
            f"{1615471325 * round(per) + round(10 * k * per)},{b:.6f},{c:.6f}"
            for k, (b, c) in enumerate(zip(U, F, strict=True))
        ]
        path.write_text("\n".join([f"Timestamp ({unit}),Displacement (mm),Force (N)", *rows]) + "\n")
        np.testing.assert_allclose(read_measurement(path).repeats[0].time, 10.0 * np.arange(len(U)), atol=1e-5)


def test_a_sensor_at_its_end_is_no_creep(tmp_path):
    """The drive goes on as before: what a held force lets happen slower and slower is another thing."""
    path, most = tmp_path / "a.csv", 0.6 * F[-1]
    path.write_text(table(["time_s,depth_mm,Fz_N"], [T, U, np.minimum(F, most)], ","))
    m = read_measurement(path)
    assert m.repeats[0].creep == "" and m.repeats[0].depth.max() <= U[F <= most].max() + 0.021  # a step of U is 0.02
    assert any("a sensor at its end; these" in d for d in m.doubts)
    assert not any("creep" in d for d in m.doubts)


def test_a_drift_in_air_is_no_contact_that_nobody_found(tmp_path):
    """The contact was found: to subtract it once more would be wrong."""
    u = np.linspace(-1.5, 0.6, 700)
    force = 0.1 * np.maximum(u, 0.0) ** 1.5
    force += 0.1 * force.max() * np.linspace(0.0, 1.0, 700)
    path = tmp_path / "a.csv"
    path.write_text(table(["Position (mm),Load (N)"], [u + 1.5, force], ","))
    doubts = read_measurement(path).doubts
    assert any("contact is found at" in d for d in doubts)
    (drift,) = (d for d in doubts if "in the approach, before the contact that was found" in d)
    on = 0.1 * (0.1 * 0.6**1.5) * 0.6 / 2.1  # what the drift adds beyond contact
    assert float(drift.split("about ")[1].split(" N")[0]) == pytest.approx(on, rel=0.2)  # a level of the first tenth
    assert not any("depth must count from contact" in d for d in doubts)


@pytest.mark.parametrize("share", [0.06, -0.06, 0.0])
def test_a_small_drift_of_either_sense_is_told_where_noise_does_not_hide_it(tmp_path, share):
    """A cell that cools or warms: three readings at either end scatter by as much, a hundred in air do not."""
    rng, u = np.random.default_rng(4), np.linspace(-0.6, 0.6, 400)
    force = 0.1 * np.maximum(u, 0.0) ** 1.5
    most = float(force.max())
    force += share * most * np.linspace(0.0, 1.0, 400) + 0.006 * most * rng.standard_normal(400)
    path = tmp_path / "a.csv"
    path.write_text(table(["Position (mm),Load (N)"], [u + 0.6, force], ","))
    told = [d for d in read_measurement(path).doubts if "in the approach, before the contact that was found" in d]
    assert len(told) == (share != 0.0)
    if told:
        assert f"Fz {'grows' if share > 0 else 'falls'} by" in told[0]
        on = float(told[0].split("about ")[1].split(" N ")[0])
        assert on == pytest.approx(abs(share) * most / 2.0, rel=0.2)  # half of the drift comes beyond contact


def test_a_cell_that_was_tared_in_the_approach_is_named(tmp_path):
    """No zero mends a record whose force has two of them."""
    u = np.linspace(-1.0, 0.6, 320)
    force = 0.06 * np.maximum(u, 0.0) ** 1.5 + 0.02 * (u < -0.7)
    path = tmp_path / "a.csv"
    path.write_text(table(["Time (s),Position (mm),Load (N)"], [np.arange(320) * 0.1, u + 5.0, force], ","))
    with pytest.raises(ValueError, match=r"Fz jumps by -0\.02 N at 0\.29\d mm .* a cell tared during the test"):
        read_measurement(path)
