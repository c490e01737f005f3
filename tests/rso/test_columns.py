"""Files as testing machines write them: read as the plain table, or refused with file, line, column and choices."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import sample_studies as studies

from rso.calibration.plan import make_plan
from rso.calibration.results import begun_results
from rso.cli.checking import check_lines
from rso.data import Column, combine, read_measurement
from rso.data.measured_curve import Noise
from rso.study.cases import measured_curves
from rso.study.columns_table import ColumnsTable
from rso.study.errors import StudyError
from rso.study.loader import load_study

# 4 mm there in 8 s, 4 s of rest, and back.
U = np.r_[np.linspace(0, 4, 41), np.full(20, 4.0), np.linspace(3.9, 0, 40)]
TEXTS = [(f"{0.2 * k:.1f}", f"{u:.4f}", f"{0.04 * u**1.5:.5f}") for k, u in enumerate(U)]  # s, mm, N


def minus(text: str) -> str:
    return "-" + text


def comma(text: str) -> str:
    return text.replace(".", ",")


def plain(rows=TEXTS) -> str:
    return "time_s,depth_mm,Fz_N\n" + "".join(f"{t},{u},{F}\n" for t, u, F in rows)


def zwick(rows=TEXTS) -> str:
    """Semicolons, decimal commas, metadata and units, compression negative, a separator at the end of each line."""
    head = ['"Prüfprotokoll";"Niere 3"', '"Prüfer:";"Jörg Müller";', "Vorkraft;0,01;N", "Datum;01.02.2024", ""]
    head += ['"Prüfzeit";"Standardweg";"Standardkraft";"Druckspannung";', '"s";"mm";"N";"MPa";']
    lines = [";".join((t, minus(u), minus(F), f"{float(F) / 30:.6f}", "")) for t, u, F in rows]
    return "\r\n".join([*head, *map(comma, lines), ";;;;", "", ""])


def instron(rows=TEXTS) -> str:
    """Everything in quotes, a table of results above, a units row in brackets, compression negative, force in kN."""
    head = ['"Specimen label","kidney, 3"', '"Thickness : ","60"', '"Results Table 1"', '"1","0.32"', '""']
    head += ['"Time","Extension","Load","Cycle, total"', '"(s)","(mm)","(kN)",""']
    lines = [f'"{t}","{minus(u)}","{minus(F)}E-03","1"' for t, u, F in rows]
    return "\n".join([*head, *lines, ""])


def labview(rows=TEXTS) -> str:
    """Tabs, no units, cells of a comment left away."""
    head = ["LabVIEW Measurement\t", "Separator\tTab", "Channels\t2\t", "***End_of_Header***\t"]
    head += ["X_Value\tDraht\tKraft\tComment"]
    return "\n".join([*head, *(comma("\t".join(row)) for row in rows)])


def texture(rows=TEXTS) -> str:
    """Weights for forces."""
    lines = [f"{1000 * float(F) / 9.80665!r}\t{u}\t{t}" for t, u, F in rows]
    return "\n".join(["Force (g)\tDistance (mm)\tTime (sec)", *lines, ""])


def stage(rows=TEXTS) -> str:
    """Units behind commas between tabs, tags around the notes, a stage that counts upwards, forces as weights."""
    head = ["<Stage File>", "<INFO>", "Load Cell Offset:\t-291.25", "<END INFO>", "Velocity, mm/s:\t0.5", "<DATA>"]
    lines = [f"{t}\t{minus(u)}\t{-1000 * float(F) / 9.80665!r}" for t, u, F in rows]
    return "\n".join([*head, "Time, s\tPosition (z), mm\tFz, gf", *lines, ""])


def quoted(rows=TEXTS) -> str:
    """Everything in quotes between commas, and decimal commas within."""
    lines = [",".join(f'"{comma(cell)}"' for cell in row) for row in rows]
    return "\n".join(['"Zeit","Weg","Kraft"', '"(s)","(mm)","(N)"', *lines, ""])


ZWICK = {"depth": Column("Standardweg", flip=True), "Fz": Column("Standardkraft", "N", True)}
ZWICK |= {"time": Column("Prüfzeit")}
INSTRON = {"depth": Column("Extension", flip=True), "Fz": Column("Load", "kN", True), "time": Column("Time", "s")}
LABVIEW = {"depth": Column("Draht", "mm"), "Fz": Column("Kraft", "N"), "time": Column("X_Value", "s")}
QUOTED = {"depth": Column("Weg"), "Fz": Column("Kraft"), "time": Column("Zeit")}
TEXTURE = {"depth": Column("Distance (mm)"), "Fz": Column("Force (g)", "gf"), "time": Column("Time (sec)")}
STAGE = {"depth": Column("Position (z), mm", flip=True), "Fz": Column("Fz, gf", flip=True), "time": Column("Time, s")}
TEXTURE_WORDS = TEXTURE | {"Fz": Column("Force (Grams)", "gf")}
MACHINES = {  # text, encoding, columns, some of the notes, what is not read
    "Zwick": (zwick(), "latin-1", ZWICK, ("Prüfprotokoll Niere 3", "Vorkraft 0,01 N"), ("Druckspannung",)),
    "Instron": (instron(), "utf-8", INSTRON, ("Specimen label kidney, 3", "1 0.32"), ("Cycle, total",)),
    "quoted": (quoted(), "utf-8", QUOTED, (), ()),
    "LabVIEW": (labview(), "utf-8", LABVIEW, ("LabVIEW Measurement", "Separator Tab"), ("Comment",)),
    "stage": (stage(), "utf-8", STAGE, ("<Stage File>", "Velocity, mm/s: 0.5"), ()),
    "texture analyser": (texture(), "utf-8", TEXTURE, (), ()),
    "texture in words": (texture().replace("(g)", "(Grams)"), "utf-8", TEXTURE_WORDS, (), ()),
}


def write(tmp_path: Path, text: str, encoding: str = "utf-8", name: str = "data.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def refusal(path, columns=None) -> str:
    with pytest.raises(ValueError) as caught:
        read_measurement(path, columns)
    return str(caught.value)


@pytest.mark.parametrize("machine", MACHINES)
def test_files_of_machines_hold_the_numbers_of_the_plain_table(tmp_path, machine):
    text, encoding, columns, notes, unread = MACHINES[machine]
    (expected,) = read_measurement(write(tmp_path, plain())).repeats
    m = read_measurement(write(tmp_path, text, encoding), columns)
    (r,) = m.repeats
    assert set(notes) <= set(m.notes) and m.unread == unread
    assert list(r.segment) == list(expected.segment) and np.sum(r.segment == "hold") == 20
    # A unit costs the rounding of one product and of the number written.
    rtol = 4e-16 if machine.startswith(("Instron", "texture", "stage")) else 0.0
    np.testing.assert_array_equal(r.time, expected.time)
    np.testing.assert_array_equal(r.depth, expected.depth)
    np.testing.assert_allclose(r.channels["Fz"], expected.channels["Fz"], rtol=rtol, atol=0)
    assert not np.signbit(r.depth).any() and not np.signbit(r.channels["Fz"]).any()


@pytest.mark.parametrize("machine", ["Zwick", "quoted", "stage"])
def test_customary_names_need_no_columns(tmp_path, machine):
    """The same numbers as with [columns], signs turned where force and travel of pressing are negative, and said."""
    text, encoding, columns, notes, unread = MACHINES[machine]
    path = write(tmp_path, text, encoding)
    m, asked = read_measurement(path), read_measurement(path, columns)
    (r,), (expected,) = m.repeats, asked.repeats
    np.testing.assert_array_equal(r.depth, expected.depth)
    np.testing.assert_array_equal(r.time, expected.time)
    np.testing.assert_array_equal(r.channels["Fz"], expected.channels["Fz"])
    assert set(notes) <= set(m.notes) and m.unread == unread
    said = m.doubts[0]
    for name, column in columns.items():
        assert f"{column.header!r} is read as {name}" in said
        assert (f"as {name}, its sign turned" in said) is column.flip
    assert m.doubts[1:] == asked.doubts


def test_a_machine_whose_units_are_not_what_they_seem_is_asked_about(tmp_path):
    assert "'g' is a mass" in refusal(write(tmp_path, texture()))
    assert "'Load'" in (said := refusal(write(tmp_path, instron().replace('"(kN)"', '""')))) and "says no unit" in said
    assert "unknown column" in refusal(write(tmp_path, labview()))


TABLE = [(0.0, 0.0), (1.0, 0.05), (2.0, 0.15), (3.0, 0.3), (4.0, 0.5)]


def table(head: str, row: str = "{u},{F}") -> str:
    return "\n".join([head, *(row.format(u=u, F=F, t=2 * u) for u, F in TABLE), ""])


@pytest.mark.parametrize(
    "head",
    [
        "Displacement (mm),Force (N)",
        "Extension [mm],Load [N]",
        "disp_mm,force_N",
        "Position/mm,Normal force/N",
        "STROKE (mm),LOAD (N)",
        "Crosshead travel, mm\tAxial Force, N",
        "Weg (mm);Kraft (N)",
    ],
)
def test_travel_and_force_by_their_usual_names(tmp_path, head):
    separator = next(s for s in "\t;," if s in head)
    m = read_measurement(write(tmp_path, table(head, f"{{u}}{separator}{{F}}")))
    (r,) = m.repeats
    assert r.depth.tolist() == [u for u, _ in TABLE] and r.channels["Fz"].tolist() == [F for _, F in TABLE]
    assert "read as depth" in m.doubts[0] and r.time is None


def test_what_may_be_two_things_or_is_misspelt_is_not_guessed(tmp_path):
    two = table("Extension (mm),Crosshead (mm),Load (N)", "{u},{u},{F}")
    assert "'Extension (mm)' and 'Crosshead (mm)' may each be depth" in refusal(write(tmp_path, two))
    assert "unknown column 'Peak load (N)'" in refusal(write(tmp_path, table("Extension (mm),Peak load (N)")))
    assert "unknown column 'Temp (C)'" in refusal(write(tmp_path, table("Displacement (mm),Temp (C)")))
    # known names stay as strict as they were
    assert "unknown column 'deph_mm'" in refusal(write(tmp_path, table("deph_mm,Fz_N")))
    assert "unknown column 'T (C)'" in refusal(write(tmp_path, table("depth_mm,Fz_N,T (C)", "{u},{F},{t}")))


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("Time (s),Force (N)", ["no column is called a depth", "'Time (s)', 'Force (N)'", "steady speed", "depth_mm"]),
        ("Z (mm),Load (mN)", ["no column is called a depth", "'Z (mm)', 'Load (mN)'"]),
        ("Time (s),Extension (mm)", ["no column is called a force", "'Extension (mm)'"]),
    ],
)
def test_a_file_without_a_depth_or_a_force_is_told_that(tmp_path, head, words):
    """Its other columns have usual names: none of them is unknown."""
    rows = "".join(f"{0.1 * k:g},{0.01 * k:g}\n" for k in range(9))
    said = refusal(write(tmp_path, f"{head}\n{rows}"))
    assert all(word in said for word in words) and "unknown" not in said


def test_customary_names_stand_beside_known_ones_and_columns_have_the_last_word(tmp_path):
    path = write(tmp_path, table("Time (s),Displacement (um),Fx_N,Load (N),Cycle", "{t},{u},0.1,{F},1"))
    m = read_measurement(path)
    (r,) = m.repeats
    assert r.depth.max() == 4e-3 and set(r.channels) == {"Fx", "Fz"} and m.unread == ("Cycle",)
    assert r.time.tolist() == [2 * u for u, _ in TABLE]
    m = read_measurement(path, {"depth": Column("Displacement (um)"), "Fz": Column("Load (N)")})
    assert set(m.repeats[0].channels) == {"Fz"} and not any("read as" in d for d in m.doubts)


def test_a_position_that_falls_while_the_force_grows_is_turned(tmp_path):
    text = "\n".join(["Position (mm),Force (N)", *(f"{1.0 - u},{-F}" for u, F in TABLE), ""])
    m = read_measurement(write(tmp_path, text))
    assert m.repeats[0].depth.tolist() == [u - 1.0 for u, _ in TABLE]
    assert m.repeats[0].channels["Fz"].max() == 0.5 and m.doubts[0].count("its sign turned") == 2


@pytest.mark.parametrize("clock", ["10:00:{t:06.3f}", "2026-11-25T10:00:{t:06.3f}", "25.11.2026 10:00:{t:06.3f}"])
@pytest.mark.parametrize("head", ["time", "Time (s)", "Timestamp"])
def test_a_time_of_day_is_seconds(tmp_path, clock, head):
    row = clock.replace("{t", "{t") + ",{u},{F}"
    (r,) = read_measurement(write(tmp_path, table(f"{head},Displacement (mm),Force (N)", row))).repeats
    np.testing.assert_allclose(np.diff(r.time), 2.0, rtol=1e-12)  # differences of seconds of a day
    columns = {"time": Column(head), "depth": Column("Displacement (mm)"), "Fz": Column("Force (N)")}
    (same,) = read_measurement(write(tmp_path, table(f"{head},Displacement (mm),Force (N)", row)), columns).repeats
    np.testing.assert_array_equal(same.time, r.time)


OWN = {  # headers that say themselves what they are
    "square": "time [s],depth [mm],Fz [N]",
    "round, in capitals": "TIME (s),Depth (mm),FZ(N)",
    "slash": "time / s,depth/mm,fz/N",
    "mixed, quoted": '"time_s","depth (mm)",Fz_N',
    "units beneath": "time,Depth,Fz\ns,mm,N",
    "units twice": "time_s,depth [mm],Fz\n(s),,[N]",
    "below other lines": "Specimen,kidney 3\nOperator,\n\ntime_s,depth_mm,Fz_N",
}


@pytest.mark.parametrize("how", OWN)
def test_own_headers(tmp_path, how):
    (expected,) = read_measurement(write(tmp_path, plain())).repeats
    m = read_measurement(write(tmp_path, plain().replace("time_s,depth_mm,Fz_N", OWN[how])))
    assert m.notes == (("Specimen kidney 3", "Operator") if how.startswith("below") else ()) and m.unread == ()
    (r,) = m.repeats
    for a, b in ((r.time, expected.time), (r.depth, expected.depth), (r.channels["Fz"], expected.channels["Fz"])):
        np.testing.assert_array_equal(a, b)


def test_separators_at_the_end_and_empty_lines_are_no_columns_and_no_readings(tmp_path):
    text = "depth_mm;Fz_N;\n0;0;\n;;\n1;0,5;\n;;\n\n"
    assert read_measurement(write(tmp_path, text)).repeats[0].depth.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("more, beneath", [("", ";"), ("", ";;"), (";", ""), (";;", ";"), (";", ";;;")])
def test_separators_at_the_end_of_header_or_rows_alone_are_no_columns(tmp_path, more, beneath):
    """Loggers write them behind each reading, exports of sheets behind the header."""
    (r,) = read_measurement(write(tmp_path, f"depth_mm;Fz_N{more}\n0;0{beneath}\n1;0,5{beneath}\n2;1,4\n")).repeats
    assert r.depth.tolist() == [0.0, 1.0, 2.0] and r.channels["Fz"].tolist() == [0.0, 0.5, 1.4]


def test_an_index_without_a_header_is_not_read(tmp_path):
    """As pandas writes it."""
    rows = [f"{k},{t},{u},{F}\n" for k, (t, u, F) in enumerate(TEXTS)]
    m = read_measurement(write(tmp_path, "".join([",time_s,depth_mm,Fz_N\n", *rows])))
    assert m.repeats[0].depth.tolist() == [float(u) for _, u, _ in TEXTS] and m.unread == ()
    assert "unknown column 'frame'" in refusal(write(tmp_path, ",frame,depth_mm,Fz_N\n0,0,0,0\n1,1,1,1\n"))


def test_a_row_of_readings_is_no_row_of_units_whatever_its_label_is(tmp_path):
    m = read_measurement(write(tmp_path, "depth_mm,Fz_N,repeat\n0,0,s\n1,1,s\n0,0,m\n1,1,m\n"))
    assert [(r.label, len(r.depth)) for r in m.repeats] == [("s", 2), ("m", 2)]


def test_headers_are_compared_as_written_and_parted_outside_quotes(tmp_path):
    text = '"Load; raw",Load,load,Travel\n0,0,0,0\n3,2,1,4\n'
    columns = {"depth": Column("Travel", "mm"), "Fz": Column("load", "N"), "Fx": Column("Load; raw", "N")}
    m = read_measurement(write(tmp_path, text), columns)
    assert {k: v[-1] for k, v in m.repeats[0].channels.items()} == {"Fz": 1.0, "Fx": 3.0} and m.unread == ("Load",)


def test_a_wall_of_numbers_above_the_header_of_a_machine_is_a_note_and_above_a_plain_one_refused(tmp_path):
    text = "1,2,3\n" + plain()
    columns = {"depth": Column("depth_mm"), "Fz": Column("Fz_N")}
    assert read_measurement(write(tmp_path, text), columns).notes == ("1 2 3",)
    assert "data.csv:1: unknown column '1'" in refusal(write(tmp_path, text))


SHORT = "Weg;Kraft;Zeit\nmm;N;s\n0;0;0\n0,5;0,1;1\n"
SHORT_COLUMNS = {"depth": Column("Weg"), "Fz": Column("Kraft")}
COUNTED = "Nr;Weg;Kraft\n1;0;0\n2;0,5;0,1\n3;1;0,2\n4;4,0;0,32\n"
COUNTED_COLUMNS = {"depth": Column("Weg", "mm"), "Fz": Column("Kraft", "N")}
REFUSED = {  # text, columns, words
    "a name of nowhere": (
        zwick(),
        ZWICK | {"depth": Column("Standartweg")},
        [":6:", "no header 'Standartweg' (depth)", "choose from 'Standardweg', 'Standardkraft'"],
    ),
    "two of nowhere": (SHORT, {"depth": Column("weg"), "Fz": Column("Last")}, [":1:", "'weg' (depth), 'Last' (Fz)"]),
    "not the file of a machine": (plain(), ZWICK, [":1:", "choose from", "'depth_mm'", "columns = {}"]),
    "none of the names": (zwick(), SHORT_COLUMNS, [":6:", "choose from 'Standardweg'"]),
    "no header at all": (
        "0;0\n1;1\n",
        SHORT_COLUMNS,
        [":1:", "no header 'Weg' (depth), 'Kraft' (Fz)", "no header stands above these numbers: write one"],
    ),
    "no header at all, nor names": (
        "0;0\n1;1\n",
        None,
        [":1:", "unknown column '0'", "above these numbers: write one"],
    ),
    "twice the same header": (
        "Weg;Kraft;Weg\n0;0;0\n",
        {"depth": Column("Weg", "mm"), "Fz": Column("Kraft", "N")},
        [":1:", "header 'Weg' appears twice", "rename one", "side by side"],
    ),
    "cycles without a count": (
        plain(TEXTS[:41] + TEXTS[61:] + TEXTS[:41]).replace("time_s", "t_s"),
        {"depth": Column("depth_mm"), "Fz": Column("Fz_N")},
        ["turns back more than once", "repeat = { header = "],
    ),
    "no unit": (
        "Weg;Kraft [N]\n0;0\n",
        {"depth": Column("Weg"), "Fz": Column("Kraft [N]")},
        [":1:", "'depth'", "'Weg' says no unit", "mm, um"],
    ),
    "no unit that is known": (SHORT.replace("mm", "Klafter"), SHORT_COLUMNS, [":1:", "'Klafter' beneath"]),
    "another unit in the header": (
        "Weg [mm];Kraft (kN)\n0;0\n",
        {"depth": Column("Weg [mm]"), "Fz": Column("Kraft (kN)", "N")},
        [":1:", "'Fz' ('Kraft (kN)')", "the study says 'N'", "the header 'kN'"],
    ),
    "another unit before other words": (
        "Weg [mm];Kraft [kN] (gefiltert)\n0;0\n",
        {"depth": Column("Weg [mm]"), "Fz": Column("Kraft [kN] (gefiltert)", "N")},
        [":1:", "the study says 'N'", "the header 'kN'"],
    ),
    "another unit behind a comma": (
        stage(),
        STAGE | {"Fz": Column("Fz, gf", "N", flip=True)},
        [":7:", "'Fz' ('Fz, gf')", "the study says 'N'", "the header 'gf'"],
    ),
    "a channel behind a comma": (
        "Weg, mm;Kraft, A\n0;0\n",
        {"depth": Column("Weg, mm"), "Fz": Column("Kraft, A")},
        [":1:", "'Kraft, A' says no unit"],
    ),
    "another unit in capitals": (
        "Weg [mm];Kraft [KN]\n0;0\n",
        {"depth": Column("Weg [mm]"), "Fz": Column("Kraft [KN]", "N")},
        [":1:", "the header says 'KN'"],
    ),
    "another unit beneath, in capitals": (
        SHORT.replace("N;s", "KN;s"),
        SHORT_COLUMNS | {"Fz": Column("Kraft", "N")},
        [":1:", "'Fz' ('Kraft')", "the study says 'N'", "beneath the header 'KN'"],
    ),
    "decimal commas between commas": ("depth_mm,Fz_N\n0,0,0,0\n1,5,0,04\n", None, [":2:", "are these decimal commas?"]),
    "a force in meganewtons": (
        "Weg;FORCE (MN)\n0;0\n1;320\n",
        {"depth": Column("Weg", "mm"), "Fz": Column("FORCE (MN)")},
        [":1:", "'Fz'", "'MN' is a meganewton"],
    ),
    "a force beyond all": (
        "Weg;FORCE (kN)\n0;0\n1;32000\n",
        {"depth": Column("Weg", "mm"), "Fz": Column("FORCE (kN)")},
        [":3:", "'Fz'", "3.2e+07 N", "read as 'kN'"],
    ),
    "a depth beyond all": ("depth [Mm];Fz [N]\n0;0\n4;1\n", None, [":3:", "'depth'", "4e+09 mm", "read as 'Mm'"]),
    "a depth beyond all, turned": (
        "Weg [Mm];Fz [N]\n0;0\n4;1\n",
        {"depth": Column("Weg [Mm]", flip=True), "Fz": Column("Fz [N]")},
        [":3:", "-4e+09 mm"],
    ),
    "another unit beneath": (
        SHORT,
        SHORT_COLUMNS | {"Fz": Column("Kraft", "mN")},
        [":1:", "the study says 'mN'", "the row beneath the header 'N'"],
    ),
    "header and row": (
        "Weg_um;Fz\nmm;N\n0;0\n",
        {"depth": Column("Weg_um"), "Fz": Column("Fz")},
        ["the header says 'um'", "the row beneath the header 'mm'"],
    ),
    "own header and row": ("depth_um;Fz\nmm;N\n0;0\n", None, ["the header says 'um'", "beneath the header 'mm'"]),
    "a unit of another kind": (
        SHORT,
        SHORT_COLUMNS | {"Fz": Column("Zeit")},
        [":1:", "'Fz' ('Zeit')", "'s' is not a unit of the kind 'N'", "choose from N, mN"],
    ),
    "a stated unit of another kind": (SHORT, SHORT_COLUMNS | {"Fz": Column("Kraft", "mm")}, ["the study says 'mm'"]),
    "a mass": (texture(), TEXTURE | {"Fz": Column("Force (g)")}, [":1:", "'g' is a mass", "unit = 'gf'"]),
    "a mass in words": (
        texture().replace("Force (g)", "Scale (grams)"),
        TEXTURE | {"Fz": Column("Scale (grams)")},
        [":1:", "'grams' is a mass", "unit = 'gf'"],
    ),
    "a mass as newtons": (texture(), TEXTURE | {"Fz": Column("Force (g)", "N")}, ["the header 'g'", "'N'"]),
    "own header without a unit": ("depth;Fz_N\n0;0\n", None, [":1:", "'depth' has no unit", "[columns]"]),
    "own header of other names": (
        zwick().replace("Standardweg", "Kanal 1"),
        None,
        [":6:", "unknown column 'Kanal 1'", "depth_mm", "[columns]"],
    ),
    "own header below others, misspelt": ("a,b,c\nx\ntime_s,deph_mm,Fz_N\n0,0,0\n", None, [":3:", "'deph_mm'"]),
    "a second table": (
        SHORT + "Zeit;Weg;Kraft\ns;mm;N\n0;0;0\n",
        SHORT_COLUMNS,
        [":5:", "'Zeit Weg Kraft' is no reading beneath the header 'Weg Kraft Zeit'", "its own file", "with #"],
    ),
    "a second table in other units": (
        SHORT + SHORT.replace("N", "mN"),
        SHORT_COLUMNS,
        [":6:", "'Fz'", "'mN' beneath the header of this table, 'N' beneath that of the first"],
    ),
    "numbers under no header": ("Weg;Kraft;\nmm;N;\n0;0;7\n", SHORT_COLUMNS, [":3:", "'7' stands beneath no header"]),
    "comma decimals between commas": (
        "Weg [mm],Kraft [N]\n0,5,0,1\n",
        {"depth": Column("Weg [mm]"), "Fz": Column("Kraft [N]")},
        [":2:", "4 values", "2 columns"],
    ),
    "neither units nor numbers": (
        "Weg [mm];Kraft [N]\n-;-\n0;0\n",
        {"depth": Column("Weg [mm]"), "Fz": Column("Kraft [N]")},
        [":2:", "'-'", "not a finite number"],
    ),
    "a truncated end": (SHORT + "1;0,2", SHORT_COLUMNS, [":5:", "2 values", "3 columns", "delete"]),
    "an empty cell": (SHORT + "1;;2\n", SHORT_COLUMNS, [":5:", "'Fz'", "''", "delete the row"]),
    "thousands": (SHORT + "1.000,5;0,2;2\n", SHORT_COLUMNS, [":5:", "'depth'", "'1.000,5'"]),
    "perhaps thousands": ("Weg;Kraft\num;mN\n500;1\n750;2\n1,000;3\n", SHORT_COLUMNS, [":5:", "'depth'", "'1,000'"]),
    "perhaps thousands after 0": (
        "depth [um]\tFz [mN]\n0\t0\n1,000\t40\n2,000\t113\n",
        None,
        [":3:", "'depth'", "'1,000' beside '0'"],
    ),
    "nothing but thousands": (
        "depth [um]\tFz [mN]\n10,000\t0\n11,000\t40\n12,000\t113\n",
        None,
        [":2:", "'depth'", "'10,000'", "write 10000 or 10,0000"],
    ),
    "perhaps thousands with a point": (
        "Weg;Kraft\num;mN\n0;0\n50;1\n1.000;2\n2.000;3\n",
        SHORT_COLUMNS,
        [":5:", "'depth'", "'1.000'"],
    ),
    "thousands in quotes": (
        'Weg,Kraft\num,mN\n0,"0"\n500,"14"\n"1,000","40"\n',
        SHORT_COLUMNS,
        [":5:", "'depth'", "'1,000' beside '0'"],
    ),
    "thousands in quotes beside decimals": (
        'Weg,Kraft\num,mN\n0.0,0\n"1,000.5",14\n',
        SHORT_COLUMNS,
        [":4:", "'1,000.5'"],
    ),
    "a summary between": (
        COUNTED + "Max;4,0;0,32\n4;4,1;0,33\n",
        COUNTED_COLUMNS,
        [":6:", "'Nr'", "'Max'", "summary; delete"],
    ),
    "sigma of nothing": (SHORT, SHORT_COLUMNS | {"Fx_sigma": Column("Zeit", "N")}, ["'Fx_sigma'", "not there"]),
    "comment as a number": (labview(), LABVIEW | {"Fz": Column("Comment", "N")}, [":6:", "3 values", "4 columns"]),
    "travel negative": (zwick(), ZWICK | {"depth": Column("Standardweg")}, ["mostly negative", "flip = true"]),
    "travel negative, no way back": (
        zwick(TEXTS[:41]),
        ZWICK | {"depth": Column("Standardweg")},
        ["'depth' falls from 0 to -4", "flip = true"],
    ),
    "compression negative": (zwick(), ZWICK | {"Fz": Column("Standardkraft")}, ["'Fz' falls", "flip = true"]),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_wrong_is_said_with_file_line_column_and_choices(tmp_path, what):
    text, columns, words = REFUSED[what]
    path = write(tmp_path, text)
    said = refusal(path, columns)
    for word in [str(path), *words]:
        assert word in said


CODED = "Phase;Weg [mm];Kraft [N]\n0;-0,5;0\n0;-0,2;0\n1;0;0\n1;1;0,1\n1;2;0,3\n2.0;2;0,25\n3;1;0,05\n3;0;0\n"
CODES = {"0": "skip", "1": "loading", "2": "hold", "3": "unloading"}


def coded(values) -> dict[str, Column]:
    return {"depth": Column("Weg [mm]"), "Fz": Column("Kraft [N]"), "segment": Column("Phase", values=values)}


def test_codes_of_a_machine_are_its_segments_and_what_is_no_test_is_skipped(tmp_path):
    """An approach through air would be refused as a depth; what a skipped row holds is nobody's affair."""
    text = CODED.replace("0;-0,2;0", "0;offen;---")
    (r,) = read_measurement(write(tmp_path, text), coded(CODES)).repeats
    assert r.segment.tolist() == ["loading"] * 3 + ["hold"] + ["unloading"] * 2
    np.testing.assert_array_equal(r.depth, [0, 1, 2, 2, 1, 0])
    np.testing.assert_array_equal(r.channels["Fz"], [0, 0.1, 0.3, 0.25, 0.05, 0])
    words = write(tmp_path, CODED.replace("1;", "Belasten;").replace(";Belasten;", ";1;"), name="words.csv")
    (same,) = read_measurement(words, coded({**CODES, "Belasten": "loading"})).repeats
    np.testing.assert_array_equal(same.depth, r.depth)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {k: v for k, v in CODES.items() if k != "2"},
            [":7:", "'segment' ('Phase')", "'2.0' is none of '0', '1', '3'", "skip"],
        ),
        (None, [":2:", "'0' is none of loading, hold, creep, unloading", 'values = { "0" = "loading"']),
    ],
)
def test_codes_that_nobody_explained_are_refused(tmp_path, values, words):
    said = refusal(write(tmp_path, CODED), coded(values))
    for word in words:
        assert word in said


@pytest.mark.parametrize(
    "cells",
    [
        ("0", "0,5", "1", "1,125"),
        ("0.000", "0.500", "1.000", "1.125"),
        ("0,000", "1,000", "2,000", "3,000"),
        ("0", "0.5", "1.000", "2.000"),
        ("0,125", "1", "1,250", "2"),
        ("0", "1", "2", "3000"),
    ],
)
def test_decimals_that_show_themselves_part_no_thousands(tmp_path, cells):
    rows = [f"{cell};{k}\n" for k, cell in enumerate(cells)]
    (r,) = read_measurement(write(tmp_path, "depth_um;Fz_mN\n" + "".join(rows))).repeats
    np.testing.assert_allclose(r.depth, [float(c.replace(",", ".")) / 1000 for c in cells], rtol=1e-15, atol=0)


@pytest.mark.parametrize("cells", [("0", "1.125", "2.250", "3.375"), ("0", "0.125", "1", "1.250"), ("0", "3.250")])
def test_between_commas_a_point_parts_no_thousands(tmp_path, cells):
    rows = [f"{cell},{k}\n" for k, cell in enumerate(cells)]
    (r,) = read_measurement(write(tmp_path, "depth_um,Fz_mN\n" + "".join(rows))).repeats
    np.testing.assert_allclose(r.depth, [float(c) / 1000 for c in cells], rtol=1e-15, atol=0)


@pytest.mark.parametrize("cells", [("", "8", "start", ""), ("999,5", "1.000,5", "---", "NaN"), ("start", "1", "", "2")])
def test_what_is_not_read_may_hold_markers_overflows_and_parted_thousands(tmp_path, cells):
    rows = [f"{cell};{k};{0.1 * k:.1f}\n" for k, cell in enumerate(cells)]
    m = read_measurement(write(tmp_path, "Druck;Weg;Kraft\n" + "".join(rows)), COUNTED_COLUMNS)
    assert m.repeats[0].depth.tolist() == [0.0, 1.0, 2.0, 3.0] and m.unread == ("Druck",)


@pytest.mark.parametrize(
    "written, wanted",
    [
        ("Weg [\u00b5m]", "Weg [\u03bcm]"),
        ("Weg [\u03bcm]", "Weg [\u00b5m]"),
        ("Pru\u0308fweg [um]", "Pr\u00fcfweg [um]"),
        ("Pr\u00fcfweg [um]", "Pru\u0308fweg [um]"),
        ("Weg\u00a0[um]", "Weg [um]"),
    ],
)
def test_letters_that_look_alike_are_alike_in_headers(tmp_path, written, wanted):
    path = write(tmp_path, f"{written};Kraft [N]\n0;0\n4000;3\n")
    (r,) = read_measurement(path, {"depth": Column(wanted), "Fz": Column("Kraft [N]")}).repeats
    assert r.depth.tolist() == [0.0, 4.0]


@pytest.mark.parametrize("columns", [None, {"depth": Column("depth_mm"), "Fz": Column("Fz_N")}])
@pytest.mark.parametrize("separator", [",", ";"])
def test_a_header_in_the_comment_above_bare_numbers_is_read(tmp_path, separator, columns):
    """As numpy.savetxt(..., header="depth_mm,Fz_N") writes it."""
    m = read_measurement(write(tmp_path, "# Niere 3\n# depth_mm,Fz_N\n0,0\n4,3\n".replace(",", separator)), columns)
    assert m.notes == ("Niere 3",) and m.repeats[0].depth.tolist() == [0.0, 4.0]


@pytest.mark.parametrize("separator", [",", ";", " "])
def test_such_a_header_may_hold_usual_names(tmp_path, separator):
    m = read_measurement(write(tmp_path, "# Niere 3\n# Weg (mm),Kraft (mN)\n0,0\n4,3\n".replace(",", separator)))
    assert m.notes == ("Niere 3",) and m.repeats[0].channels["Fz"].tolist() == [0.0, 0.003]


BLANKS = {  # header, columns, decimal comma
    "of numpy": ("# depth_mm Fz_N", None, False),
    "own": ("depth_mm Fz_N", None, False),
    "aligned": ("  Depth (mm)    Load (N)", {"depth": Column("Depth (mm)"), "Fz": Column("Load (N)")}, False),
    "units behind one blank": ("Depth (mm) Fz [N]", None, False),
    "units behind a slash": ("depth / mm Fz / N", None, False),
    "quoted": ('"Depth (mm)" "Load, raw"', {"depth": Column("Depth (mm)"), "Fz": Column("Load, raw", "N")}, False),
    "units beneath": ("Weg Kraft\n mm   N", {"depth": Column("Weg"), "Fz": Column("Kraft")}, True),
    "a title above": ("Probe 3 of Weg, Kraft\nWeg Kraft\nmm N", {"depth": Column("Weg"), "Fz": Column("Kraft")}, False),
}


@pytest.mark.parametrize("how", BLANKS)
def test_columns_parted_by_blanks(tmp_path, how):
    head, columns, decimal_comma = BLANKS[how]
    rows = "".join(f"   {u:>8}  {F:>10}\n" for _, u, F in TEXTS)
    m = read_measurement(
        write(tmp_path, "# Niere 3\n" + head + "\n" + (comma(rows) if decimal_comma else rows)), columns
    )
    (expected,) = read_measurement(write(tmp_path, plain(), name="plain.csv")).repeats
    np.testing.assert_array_equal(m.repeats[0].depth, expected.depth)
    np.testing.assert_array_equal(m.repeats[0].channels["Fz"], expected.channels["Fz"])
    assert m.notes[0] == "Niere 3"


@pytest.mark.parametrize("cells", [("{u}", "", "{F}"), ("", "{u}", "{F}"), ("{u}", "{note}", "{F}")])
@pytest.mark.parametrize("title", ["", "Probe 3\n"])
def test_a_column_between_tabs_may_be_empty(tmp_path, cells, title):
    """What parts the numbers of such a row is nothing but blanks, too."""
    head = ["depth_mm" if c == "{u}" else "Fz_N" if c == "{F}" else "note" for c in cells]
    rows = ["\t".join(cells).format(u=u, F=F, note="" if k else "start") for k, (_, u, F) in enumerate(TEXTS)]
    columns = {"depth": Column("depth_mm"), "Fz": Column("Fz_N")}
    m = read_measurement(write(tmp_path, title + "\n".join(["\t".join(head), *rows, ""])), columns)
    assert m.repeats[0].depth.tolist() == [float(u) for _, u, _ in TEXTS] and m.unread == ("note",)


@pytest.mark.parametrize("head", ["depth_mm\tFz_N", "depth_mm\t\tFz_N"])
def test_several_tabs_may_part_two_columns(tmp_path, head):
    (r,) = read_measurement(write(tmp_path, head + "\n0\t\t0\n1\t\t0.5\n2\t\t1.4\n")).repeats
    assert r.depth.tolist() == [0.0, 1.0, 2.0] and r.channels["Fz"].tolist() == [0.0, 0.5, 1.4]


@pytest.mark.parametrize("text", ["depth_mm;Fz_N\n0;0\n1;0.5\n2 3\n", "depth_mm, Fz_N\n0, 0\n1, 0.5\n2 3\n"])
def test_a_last_line_with_blanks_makes_no_table_of_them(tmp_path, text):
    assert "data.csv:4: 1 values in a table of 2 columns" in refusal(write(tmp_path, text))


def test_a_header_in_a_comment_may_stand_above_words_that_are_not_read(tmp_path):
    text = "# force\theight\tretracts\n0\t0\tFalse\n1\t4\tTrue\n"
    columns = {"depth": Column("height", "um"), "Fz": Column("force", "nN")}
    m = read_measurement(write(tmp_path, text), columns)
    assert m.repeats[0].depth.tolist() == [0.0, 0.004] and m.unread == ("retracts",)
    assert "'False'" in refusal(tmp_path / "data.csv", columns | {"time": Column("retracts", "s")})
    m = read_measurement(write(tmp_path, "# height,force\nheight,force\n0,0\n4,1\n"), columns)
    assert m.notes == ("height,force",) and m.repeats[0].depth.tolist() == [0.0, 0.004]


def test_other_comments_are_no_headers(tmp_path):
    assert "'0'" in refusal(write(tmp_path, "# Weg, Last\n0,0\n4,3\n"))
    asked = refusal(write(tmp_path, "# Weg (mm),Position (mm),Kraft (N)\n0,0,0\n4,4,3\n"))
    assert "'Weg (mm)' and 'Position (mm)' may each be depth" in asked
    assert "'Weg' says no unit" in refusal(write(tmp_path, "# Weg, Kraft\n0,0\n4,3\n"))
    m = read_measurement(write(tmp_path, "# depth_mm,Fz_N\ndepth_um,Fz_mN\n0,0\n4,3\n"))
    assert m.notes == ("depth_mm,Fz_N",) and m.repeats[0].depth.tolist() == [0.0, 0.004]


FAULTS = ["########", "##", "#DIV/0!", "#NV", "#N/A", "#WERT!", "#REF!", "#NAME?"]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_row_that_begins_with_the_fault_of_a_spreadsheet_is_no_comment(tmp_path, fault, separator):
    path = write(tmp_path, f"Fz_N,depth_mm\n0,0\n{fault},1\n3,2\n".replace(",", separator))
    said = refusal(path)
    assert f"{path}:3: column 'Fz': {fault!r} is not a finite number" in said


@pytest.mark.parametrize("note", ["# a, b", "## a, b", "########", "####,", "#N/A here, 5", "#1,2", "#, 2"])
def test_comments_below_the_header_stay_notes(tmp_path, note):
    m = read_measurement(write(tmp_path, f"depth_mm,Fz_N\n0,0\n{note}\n3,2\n"))
    assert m.notes == (note[1:].strip(),) and len(m.repeats[0].depth) == 2


def test_a_repeat_that_ends_early_or_begins_late_is_named_with_what_is_left_out(tmp_path):
    for name, low, high in (("long", 0.0, 4.0), ("short", 0.0, 0.5), ("like", 0.1, 3.9)):
        u = np.linspace(low, high, 21)
        write(tmp_path, "depth_mm,Fz_N\n" + "".join(f"{v},{0.04 * v**1.5}\n" for v in u), name=f"{name}.csv")
    write(tmp_path, "depth_mm,Fz_N\n1,0.04\n2,0.11\n4,0.32\n", name="late.csv")
    (doubt,) = read_measurement([tmp_path / "long.csv", tmp_path / "short.csv", tmp_path / "like.csv"]).doubts
    assert doubt.startswith("repeat short ends at 0.5 mm, others go to 4 mm") and "the rest is left out" in doubt
    (doubt,) = read_measurement([tmp_path / "long.csv", tmp_path / "late.csv"]).doubts
    assert doubt.startswith("repeat late begins at 1 mm, others at 0 mm")
    assert read_measurement([tmp_path / "long.csv", tmp_path / "like.csv"]).doubts == ()


ODD = ["kp", "10^-3 N", "mN, tared", "mN*", "N x 1000", "raw", "mV/V", "Gramm", "%", "-"]


@pytest.mark.parametrize("unit", [None, "N"])
@pytest.mark.parametrize("odd", ODD)
def test_what_stands_in_brackets_and_is_no_unit_is_refused_whatever_the_study_says(tmp_path, odd, unit):
    path = write(tmp_path, f"Weg [mm];Kraft [{odd}]\n0;0\n4;320\n")
    said = refusal(path, {"depth": Column("Weg [mm]"), "Fz": Column(f"Kraft [{odd}]", unit)})
    for word in (f"{path}:1: column 'Fz'", f"the header {'' if unit else 'says '}{odd!r}", "not a known unit", "N, mN"):
        assert word in said


@pytest.mark.parametrize("header", ["Weg [1/100 mm]", "Weg (1/100 mm)", "Weg (%)", "Weg [px]", "Weg (mm, rel.)"])
def test_shares_and_fractions_of_a_unit_in_brackets_are_refused(tmp_path, header):
    path = write(tmp_path, f"{header};Kraft\n0;0\n4;320\n")
    said = refusal(path, {"depth": Column(header, "mm"), "Fz": Column("Kraft", "N")})
    assert "column 'depth'" in said and "the study says 'mm', the header" in said and "not a known unit" in said


@pytest.mark.parametrize("header", ["Kraft (Kanal 1)", "Kraft (gefiltert)", "Load/Unload", "Kraft []"])
def test_words_in_round_brackets_are_no_units(tmp_path, header):
    path = write(tmp_path, f"Weg;{header}\n0;0\n4;0,3\n")
    (r,) = read_measurement(path, {"depth": Column("Weg", "mm"), "Fz": Column(header, "N")}).repeats
    assert r.channels["Fz"].tolist() == [0.0, 0.3]


@pytest.mark.parametrize("header", ["depth_px,Fz_N", "depth [px],Fz [N]", "depth_mm,x_mm,y_mm,uz_px"])
def test_pixels_are_no_length_of_a_body(tmp_path, header):
    said = refusal(write(tmp_path, header + "\n" + ",".join("0" for _ in header.split(",")) + "\n"))
    assert "data.csv:1: column" in said and "'px' is a pixel" in said


def test_units_in_capitals_are_understood_with_the_study(tmp_path):
    """In capitals S is a siemens and MM a molar: no file is lost for that."""
    columns = {"depth": Column("TRAVEL (MM)", "mm"), "Fz": Column("FORCE (N)"), "time": Column("TIME (S)", "s")}
    m = read_measurement(
        write(tmp_path, plain().replace("time_s,depth_mm,Fz_N", "TIME (S),TRAVEL (MM),FORCE (N)")), columns
    )
    assert m.repeats[0].depth.max() == 4.0
    rows = "TRAVEL (Mm);FORCE (MN)\n0;0\n500;1\n"
    columns |= {"depth": Column("TRAVEL (Mm)", "mm"), "Fz": Column("FORCE (MN)", "mN")}
    (r,) = read_measurement(write(tmp_path, rows, name="mega.csv"), {k: columns[k] for k in ("depth", "Fz")}).repeats
    assert (r.depth[1], r.channels["Fz"][1]) == (500.0, 0.001)
    columns |= {"depth": Column("TRAVEL (MM)", "mm"), "Fz": Column("FORCE (N)")}
    assert "'S' is not a unit of the kind 's'" in refusal(tmp_path / "data.csv", columns | {"time": Column("TIME (S)")})


def test_a_zero_is_what_the_file_says_at_contact_in_its_own_unit_and_sign(tmp_path):
    """A stage that counts downwards from 60 mm and a load cell that was not tared."""
    rows = "".join(f"{60000 - 1000 * k};{3.0 - 0.1 * k**1.5!r}\n" for k in range(5))
    path = write(tmp_path, "Position [um];Load [mN]\n" + rows)
    columns = {"depth": Column("Position [um]", None, True, 60000.0), "Fz": Column("Load [mN]", None, True, 3.0)}
    (r,) = read_measurement(path, columns).repeats
    np.testing.assert_allclose(r.depth, range(5), rtol=0, atol=1e-12)
    np.testing.assert_allclose(r.channels["Fz"], 1e-4 * np.arange(5) ** 1.5, rtol=0, atol=1e-12)


@pytest.mark.parametrize("unit, beneath", [("s", "Sec"), ("s", "Seconds"), ("sec", "Sec"), ("min", "Minutes")])
def test_a_unit_in_other_letters_is_that_of_the_study(tmp_path, unit, beneath):
    path = write(tmp_path, plain().replace("time_s,depth_mm,Fz_N", f"Time,Disp,Load\n {beneath}, mm, N"))
    columns = {"depth": Column("Disp"), "Fz": Column("Load"), "time": Column("Time", unit)}
    assert read_measurement(path, columns).repeats[0].time[1] == pytest.approx(
        12.0 if unit == "min" else 0.2, rel=1e-15
    )
    said = refusal(path, columns | {"time": Column("Time", "ms")})
    assert f"the study says 'ms', the row beneath the header '{beneath}'" in said


@pytest.mark.parametrize("head", ["Weg;Kraft;;\nmm;N", "Weg;Kraft\nmm;N;;"])
def test_a_row_of_units_may_end_elsewhere_than_the_header(tmp_path, head):
    m = read_measurement(write(tmp_path, head + "\n0;0\n1;0,5\n"), SHORT_COLUMNS)
    assert m.repeats[0].depth.tolist() == [0.0, 1.0]


# ---- several files


def scaled(factor: float, step: int = 1) -> str:
    return zwick([(t, u, f"{factor * float(F):.5f}") for t, u, F in TEXTS[::step]])


def test_files_of_one_test_are_its_repeats(tmp_path):
    paths = [write(tmp_path, scaled(1 + k / 100), "latin-1", f"niere_{k}.tra") for k in range(3)]
    m = read_measurement(paths, ZWICK)
    assert [r.label for r in m.repeats] == ["niere_0", "niere_1", "niere_2"]
    assert (m.path, m.more, m.where) == (paths[0], tuple(paths[1:]), f"{paths[0]} and 2 more")
    assert m.notes.count("Vorkraft 0,01 N") == 1 and m.unread == ("Druckspannung",)
    rows = [(k, t, u, repr(float(f"{(1 + k / 100) * float(F):.5f}"))) for k in range(3) for t, u, F in TEXTS]
    one = write(tmp_path, "repeat,time_s,depth_mm,Fz_N\n" + "".join(f"{k},{t},{u},{F}\n" for k, t, u, F in rows))
    a, b = (combine(v, Noise(Fz=0.001)) for v in (m, read_measurement(one)))
    assert a.n_repeats == 3
    np.testing.assert_array_equal(a.value, b.value)
    np.testing.assert_array_equal(a.covariance, b.covariance)


def test_files_with_repeats_of_their_own_and_files_of_one_name(tmp_path):
    for day in ("monday", "friday"):
        (tmp_path / day).mkdir()
        rows = [f"{u},{F},{k}\n" for k in (1, 2) for _, u, F in TEXTS[:41]]
        write(tmp_path / day, f"# {day}\ndepth_mm,Fz_N,repeat\n" + "".join(rows), name="top.csv")
    m = read_measurement([tmp_path / day / "top.csv" for day in ("monday", "friday")])
    assert [r.label for r in m.repeats] == [f"{d}/top.csv {k}" for d in ("monday", "friday") for k in (1, 2)]
    assert read_measurement([tmp_path / "monday" / "top.csv"]).repeats[0].label == "1"


def test_what_is_not_read_is_told_of_all_files(tmp_path):
    texts = [f"Weg;Kraft;Druck;{more}\n0;0;0;0\n1;0,5;1;1\n" for more in ("Nr", "Temperatur")]
    paths = [write(tmp_path, text, name=f"{k}.csv") for k, text in enumerate(texts)]
    assert read_measurement(paths, COUNTED_COLUMNS).unread == ("Druck", "Nr", "Temperatur")


OTHERS = {  # the second of two files, and words
    "another channel": (plain().replace("Fz_N", "Fx_N"), ["b.csv", "same columns", "depth, Fx", "a.csv holds time"]),
    "no clock": ("depth_mm,Fz_N\n" + "".join(f"{u},{F}\n" for _, u, F in TEXTS), ["b.csv", "same columns"]),
    "a profile": ("depth_mm,x_mm,y_mm,uz_mm\n1,0,5,0\n", ["b.csv", "same columns", "uz"]),
    "another unit": (
        plain([(t, u, f"{9.81 * float(F):.5f}") for t, u, F in TEXTS]),
        ["a.csv and 1 more", "'a' is 0.32 N", "'b' 3.14 N", "another sign, unit or tare"],
    ),
    "one reading": ("time_s,depth_mm,Fz_N\n0,1,1\n", ["'b' has too few points"]),
    "a bad cell": (plain().replace("4.0000", "4.0x", 1), ["b.csv:42:", "'depth'", "'4.0x'"]),
}


@pytest.mark.parametrize("what", OTHERS)
def test_files_that_are_no_repeats_of_each_other_are_refused(tmp_path, what):
    text, words = OTHERS[what]
    said = refusal([write(tmp_path, plain(), name="a.csv"), write(tmp_path, text, name="b.csv")])
    for word in words:
        assert word in said


def test_a_file_counts_once(tmp_path):
    path = write(tmp_path, plain())
    assert "data.csv: is listed twice" in refusal([path, tmp_path / "." / "data.csv"])
    with pytest.raises(ValueError, match="at least one file"):
        read_measurement([])


def test_repeats_without_a_common_depth_name_all_files(tmp_path):
    near = [(t, u, F) for t, u, F in TEXTS[:41] if float(u) < 1]
    far = [(t, u, F) for t, u, F in TEXTS[:41] if float(u) > 2]
    m = read_measurement([write(tmp_path, plain(rows), name=n) for rows, n in ((near, "a.csv"), (far, "b.csv"))])
    with pytest.raises(ValueError, match=r"a\.csv and 1 more: the repeats share no range"):
        combine(m, Noise())


# ---- in a study

COLUMNS = """depth = { header = "Standardweg", flip = true }
Fz = { header = "Standardkraft", unit = "N", flip = true }
time = { header = "Prüfzeit" }"""
EXPERIMENT = 'name = "top"\nrole = "fit"\nnoise = { Fz = "0.02 mN", contact = "0 mm" }\n'


def shallow(factor: float = 1.0) -> str:
    """The curve of the sample study as Zwick writes it."""
    rows = [line.split(",") for line in studies.measured().split()[1:]]
    return zwick([(f"{k}", u, repr(factor * float(F))) for k, (u, F) in enumerate(rows)])


@pytest.fixture
def folder(tmp_path):
    for k in range(2):
        write(tmp_path, shallow(1 + k / 1000), "latin-1", f"niere_{k}.tra")
    write(tmp_path, shallow(), "latin-1", "niere_2.tra")  # a copy of the first
    write(tmp_path, shallow().replace("Standardweg", "Kanal 1"), "latin-1", "kanal.tra")
    return tmp_path


def study(folder: Path, data: str, columns: str | None = COLUMNS, more: str = "") -> Path:
    return studies.write(folder, experiments=f"{EXPERIMENT}data = {data}\n{more}", columns=columns)


def test_a_study_names_the_columns_of_all_experiments(folder):
    path = study(
        folder,
        '"niere_0.tra"',
        more='[[experiments]]\nname = "own"\nrole = "select"\ndata = "top.csv"\n'
        'columns = {}\n[[experiments]]\nname = "other"\nrole = "select"\ndata = "other.csv"\n'
        'columns = { depth = { header = "Weg (um)" }, Fz = { header = "F", unit = "mN" } }',
    )
    (folder / "other.csv").write_text("Weg (um);F\n0;0\n500,5;1\n2000;4\n")
    loaded = load_study(path)
    curves = measured_curves(loaded)
    np.testing.assert_array_equal(curves["top"].value, curves["own"].value)
    np.testing.assert_array_equal(curves["top"].depth, curves["own"].depth)
    np.testing.assert_allclose(curves["other"].depth, [0, 0.5005, 2.0], rtol=1e-15, atol=0)
    assert loaded.measurement("other").repeats[0].channels["Fz"].tolist() == [0.0, 0.001, 0.004]


def test_a_study_takes_files_as_repeats_and_says_what_it_does_not_read(folder):
    path = study(folder, '["niere_0.tra", "niere_1.tra"]')
    plan = make_plan(load_study(path))
    assert [r.label for r in plan.study.measurement("top").repeats] == ["niere_0", "niere_1"]
    said = check_lines(plan.study, folder / "results", trust=True)
    assert any("2 repeat(s)" in line for line in said)
    assert [line.strip() for line in said if "not read" in line] == ["not read: Druckspannung"]
    found = begun_results(plan, "test", "now", 1)
    assert set(found["provenance"]["data_sha256"]) == {"niere_0.tra", "niere_1.tra"}
    assert found["experiments"][0]["file"] == "niere_0.tra, niere_1.tra" and found["experiments"][0]["n_repeats"] == 2


HEADED = 'columns = { depth = { header = "depth_mm", zero = %g }, Fz = { header = "Fz_N" } }'
SAME = {  # data of the first and of the second, role of the first, files in words
    "same path": ('data = "copy.csv"', 'data = "copy.csv"', "fit", "(copy.csv)"),
    "same bytes": ('data = "top.csv"', 'data = "copy.csv"', "fit", "(copy.csv and top.csv)"),
    "one of the repeats": ('data = ["other.csv", "top.csv"]', 'data = "copy.csv"', "fit", "(copy.csv and top.csv)"),
    "selected": ('data = "top.csv"', 'data = "copy.csv"', "select", "(copy.csv and top.csv)"),
    "by its own header": ('data = "copy.csv"', f'data = "copy.csv"\n{HEADED % 0.0}', "fit", "(copy.csv)"),
    "another zero": (f'data = "copy.csv"\n{HEADED % 0.0}', f'data = "copy.csv"\n{HEADED % 0.001}', "fit", "(copy.csv)"),
}


@pytest.mark.parametrize("what", SAME)
def test_data_that_are_fitted_validate_nothing(tmp_path, what):
    first, second, role, files = SAME[what]
    write(tmp_path, studies.measured(), name="copy.csv")
    write(tmp_path, studies.measured().replace("0.1,", "0.1001,"), name="other.csv")
    more = f'[[experiments]]\nname = "used"\nrole = "{role}"\n{first}\n' if role != "fit" else ""
    fitted = first if role == "fit" else 'data = "other.csv"'
    kept = f'[[experiments]]\nname = "kept"\nrole = "validate"\n{second}\n'
    path = studies.write(tmp_path, experiments=f"{EXPERIMENT}{fitted}\n{more}{kept}")
    with pytest.raises(StudyError) as caught:
        load_study(path)
    (problem,) = caught.value.problems
    used = "top" if role == "fit" else "used"
    for word in ("'kept' (role = 'validate')", f"{used!r} (role = {role!r})", files, "validates nothing"):
        assert word in problem


@pytest.mark.parametrize(
    ("role", "data", "said"),
    [
        ("fit", "twin.csv", "state the same data in both"),
        ("validate", "copy.csv", 'Fit both, each with role = "fit"'),
        ("fit", "copy.csv", None),
    ],
)
def test_both_branches_of_a_record_share_its_errors(tmp_path, role, data, said):
    """They are no repeat of each other, and the unloading was not used before: what is said is why it is refused."""
    rows = [(t, d, 0.01 * d**1.5) for t, d in enumerate([*np.linspace(0, 1, 20), *np.linspace(1, 0, 20)[1:]])]
    text = "time_s,depth_mm,Fz_N\n" + "".join(f"{t},{d:.4f},{F:.6f}\n" for t, d, F in rows)
    for name in ("copy.csv", "twin.csv"):
        write(tmp_path, text, name=name)
    noise = EXPERIMENT.splitlines()[-1]
    back = f'[[experiments]]\nname = "back"\nrole = "{role}"\nbranch = "unloading"\ndata = "{data}"\n{noise}\n'
    path = studies.write(tmp_path, experiments=f'{EXPERIMENT}data = "copy.csv"\n{back}')
    with pytest.raises(StudyError) as caught:
        load_study(path)  # its targets are deeper than the record
    problem = next((p for p in caught.value.problems if "the same data" in p), None)
    if said is None:
        assert problem is None
        return
    assert problem is not None
    assert "loading and unloading share contact and gain" in problem and said in problem
    assert "repeat" not in problem and "used before" not in problem


@pytest.mark.parametrize("what", SAME)
@pytest.mark.parametrize("role", ["fit", "select"])
def test_the_same_readings_are_fitted_or_selected_on_once(tmp_path, what, role):
    """Intervals would be too narrow by the root of two, and nobody would see it."""
    first, second, *_ = SAME[what]
    write(tmp_path, studies.measured(), name="copy.csv")
    write(tmp_path, studies.measured().replace("0.1,", "0.1001,"), name="other.csv")
    more = f'[[experiments]]\nname = "again"\nrole = "{role}"\n{second}\n'
    with pytest.raises(StudyError) as caught:
        load_study(studies.write(tmp_path, experiments=f"{EXPERIMENT}{first}\n{more}"))
    (problem,) = caught.value.problems
    for word in ("experiments[1].data", "'again'", "'top' (role = 'fit')", "a repeat counts once"):
        assert word in problem


@pytest.mark.parametrize(
    "more",
    [
        'role = "select"\nchannels = ["Fx"]\n',
        'role = "validate"\nchannels = ["Fx"]\n',
        'role = "fit"\nsettings = { thickness = 9 }\n',
    ],
)
def test_the_same_file_may_be_fitted_elsewhere_or_validate_by_another_channel(tmp_path, more):
    text = "depth_mm,Fz_N,Fx_N\n" + "".join(f"{u},{0.04 * u**1.5},{0.004 * u}\n" for u in np.linspace(0.1, 2, 20))
    write(tmp_path, text, name="top.csv")
    more = f'[[experiments]]\nname = "other"\ndata = "top.csv"\n{more}'
    assert (
        len(load_study(studies.write(tmp_path, experiments=f'{EXPERIMENT}data = "top.csv"\n{more}')).experiments) == 2
    )


TWICE = {  # more of the study, the key
    'channels = ["Fz", "Fz"]\n': "experiments[0].channels = ['Fz', 'Fz']: 'Fz' is listed twice",
    '[[next.experiments]]\nname = "n"\nchannels = ["Fz", "Fz"]\n': "next.experiments[0].channels",
    '[[next.experiments]]\nname = "n"\nmarks = [[1, 2], [1, 2]]\ndepths = [1]\n': "next.experiments[0].marks",
    '[[next.experiments]]\nname = "n"\nmarks = [[1, 2]]\ndepths = [1, "1 mm"]\n': "next.experiments[0].depths",
}


@pytest.mark.parametrize("more", TWICE)
def test_what_is_read_is_listed_once(tmp_path, more):
    with pytest.raises(StudyError, match="a reading counts once") as caught:
        load_study(studies.write(tmp_path, experiments=f'{EXPERIMENT}data = "top.csv"\n{more}'))
    (problem,) = caught.value.problems
    assert TWICE[more] in problem


LOUD = {  # noise, what a check says of it
    'Fz = "2 N"': "noise.Fz = 2 N is more than half of the",
    'depth = "5 mm"': "noise.depth = 5 mm is more than half of the 2 mm that depth goes over: is its unit right?",
}


@pytest.mark.parametrize("noise", LOUD)
def test_noise_larger_than_half_of_what_was_measured_is_remarked_upon(tmp_path, noise):
    experiment = EXPERIMENT.replace('Fz = "0.02 mN"', noise) + 'data = "top.csv"'
    loaded = load_study(studies.write(tmp_path, experiments=experiment))
    said = [line.strip() for line in check_lines(loaded, tmp_path / "results", trust=True)]
    (remark,) = [line for line in said if "noise." in line]
    assert remark.startswith(LOUD[noise])
    key, value = noise.replace('"', "").split(" = ")
    assert any(line.startswith(f"stated noise: {key} {value};") for line in said)
    assert "usual errors count: gain 2 %" in " ".join(" ".join(said).split())


def test_a_check_says_the_stated_noise(tmp_path):
    said = check_lines(load_study(studies.write(tmp_path)), tmp_path / "results", trust=True)
    assert any(line.startswith("    stated noise: Fz 2e-05 N") for line in said)
    assert not [line for line in said if "is its unit right" in line]


def test_what_is_doubtful_is_among_the_remarks_of_a_check_and_the_warnings_of_a_run(folder):
    late = [(t, f"{float(u) + 0.9:.4f}" if float(u) else "0", F) for t, u, F in TEXTS[:41]]
    air = [("", f"{0.1 * k:.1f}", "0") for k in range(9)]
    rows = [(f"{k}", u, F) for k, (_, u, F) in enumerate([*air, *late[1:]])]
    write(folder, zwick(rows), "latin-1", "niere_0.tra")
    plan = make_plan(load_study(study(folder, '"niere_0.tra"')))
    (said,) = [
        line.strip() for line in check_lines(plan.study, folder / "results", trust=True) if "contact lies" in line
    ]
    assert begun_results(plan, "test", "now", 1)["warnings"] == [f"top, {said}"]


def test_the_example_of_the_docs_reads_such_files(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "data.md").read_text(encoding="utf-8")
    example = tomllib.loads(next(part for part in text.split("```toml\n")[1:] if "[columns]" in part).split("```")[0])
    paths = [tmp_path / name for name in example["experiments"][0]["data"]]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        write(path.parent, zwick().replace("Niere 3", path.stem), "latin-1", path.name)
    m = read_measurement(paths, ColumnsTable.model_validate(example["columns"]).columns())
    assert [r.label for r in m.repeats] == ["top_1", "top_2"] and m.repeats[0].channels["Fz"].max() == 0.32


BAD = {  # columns, data, key, words
    "an unknown name": (COLUMNS.replace("Fz", "FZ"), '"niere_0.tra"', "columns.FZ", ["unknown key", "'Fz'"]),
    "an unknown key": (COLUMNS.replace("flip", "flop", 1), '"niere_0.tra"', "columns.depth.flop", ["'flip'"]),
    "no header": ("depth = {}", '"niere_0.tra"', "columns.depth.header", ["is missing"]),
    "no text": ('depth = { header = " " }', '"niere_0.tra"', "columns.depth.header", ["must not be blank"]),
    "a unit of another kind": (COLUMNS.replace('"N"', '"mm"'), '"niere_0.tra"', "columns.Fz", ["'mm'", "N, mN"]),
    "one header twice": (COLUMNS.replace("Standardkraft", "Standardweg"), '"niere_0.tra"', "columns", ["same header"]),
    "the sign of a label": (
        COLUMNS + '\nrepeat = { header = "Nr", flip = true }',
        '"niere_0.tra"',
        "columns.repeat",
        ["flip", "repeat"],
    ),
    "the sign of a sigma": (
        COLUMNS + '\nFz_sigma = { header = "s", flip = true }',
        '"niere_0.tra"',
        "columns.Fz_sigma",
        ["flip"],
    ),
    "the zero of a label": (
        COLUMNS + '\nrepeat = { header = "Nr", zero = 1 }',
        '"niere_0.tra"',
        "columns.repeat",
        ["zero", "repeat"],
    ),
    "a zero that is none": (
        COLUMNS.replace("flip = true", "zero = inf", 1),
        '"niere_0.tra"',
        "columns.depth.zero",
        ["finite"],
    ),
    "zeros that are none": (
        COLUMNS.replace("flip = true", 'zero = ["0"]', 1),
        '"niere_0.tra"',
        "columns.depth.zero",
        ["a list with one for each file"],
    ),
    "zeros for other files": (
        COLUMNS.replace("flip = true", "flip = true, zero = [0, 0.0]", 1),
        '"niere_0.tra"',
        "experiments[0].data",
        ["column 'depth'", "zero = [0.0, 0.0] are 2 for 1 file"],
    ),
    "a count of another kind": (
        COLUMNS.replace('"N"', '"0.2 mm"'),
        '"niere_0.tra"',
        "columns.Fz",
        ["'mm'", '"0.00125 N" for what one count is'],
    ),
    "a count of nothing": (COLUMNS.replace('"N"', '"0 N"'), '"niere_0.tra"', "columns.Fz", ["must be positive"]),
    "a count turned": (COLUMNS.replace('"N"', '"-1 N"'), '"niere_0.tra"', "columns.Fz", ["positive", "flip"]),
    "the unit of a label": (
        COLUMNS + '\nsegment = { header = "A", unit = "s" }',
        '"niere_0.tra"',
        "columns.segment",
        ["no unit"],
    ),
    "a header of nowhere": (
        COLUMNS.replace("Standardweg", "Standartweg"),
        '"niere_0.tra"',
        "experiments[0].data",
        ["niere_0.tra:6", "'Standartweg' (depth)", "'Standardweg'"],
    ),
    "no table": (None, '"kanal.tra"', "experiments[0].data", ["kanal.tra:6", "'Kanal 1'", "[columns]"]),
    "no files": (COLUMNS, "[]", "experiments[0].data", ["at least 1"]),
    "no text for a file": (COLUMNS, "3", "experiments[0].data", ["a list of files"]),
    "one of two is missing": (
        COLUMNS,
        '["niere_0.tra", "niere_9.tra"]',
        "experiments[0].data",
        ["niere_9.tra", "no such file"],
    ),
    "a file twice": (COLUMNS, '["niere_0.tra", "niere_0.tra"]', "experiments[0].data", ["listed twice"]),
    "a copy as a repeat": (
        COLUMNS,
        '["niere_0.tra", "niere_2.tra"]',
        "experiments[0].data",
        ["niere_2.tra: holds the same bytes as", "niere_0.tra", "a repeat counts once"],
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_wrong_in_a_study_is_one_problem_at_its_key(folder, what):
    columns, data, key, words = BAD[what]
    with pytest.raises(StudyError) as caught:
        load_study(study(folder, data, columns))
    (problem,) = caught.value.problems
    assert f": {key}" in problem
    for word in words:
        assert word in problem


COUNTS = "Schritte [steps];Kraft [V]\n12000;0.5\n12800;0.6\n13600;0.8\n"


def test_what_one_count_is_makes_a_length_of_steps_and_a_force_of_volts(tmp_path):
    columns = {"depth": Column("Schritte [steps]", "0.00125 mm", zero=12000.0)}
    columns |= {"Fz": Column("Kraft [V]", "2.5 N", zero=0.5)}
    (r,) = read_measurement(write(tmp_path, COUNTS), columns).repeats
    np.testing.assert_allclose(r.depth, [0.0, 1.0, 2.0], rtol=1e-12)
    np.testing.assert_allclose(r.channels["Fz"], [0.0, 0.25, 0.75], rtol=1e-12)
    turned = {**columns, "depth": Column("Schritte [steps]", "1.25 um", flip=True, zero=13600.0)}
    (r,) = read_measurement(write(tmp_path, COUNTS.replace("0.5", "0.9")), turned).repeats
    np.testing.assert_allclose(r.depth, [2.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("head", ["Weg [1/100 mm]", "Weg [mV/V]", "Weg (1/100 mm)", "Weg [px]", "Weg", "Weg [V]"])
def test_a_stated_count_holds_whatever_the_file_calls_it(tmp_path, head):
    columns = {"depth": Column(head, "0.01 mm"), "Fz": Column("Fz_N")}
    (r,) = read_measurement(write(tmp_path, f"{head};Fz_N\n0;0\n400;3\n"), columns).repeats
    assert r.depth.tolist() == [0.0, 4.0]


def test_a_count_and_another_unit_of_its_kind_disagree(tmp_path):
    path = write(tmp_path, "Weg [mm];Fz_N\n0;0\n4;3\n")
    said = refusal(path, {"depth": Column("Weg [mm]", "0.00125 mm"), "Fz": Column("Fz_N")})
    assert "the study says '0.00125 mm', the header 'mm'" in said
    assert (
        read_measurement(path, {"depth": Column("Weg [mm]", "1 mm"), "Fz": Column("Fz_N")}).repeats[0].depth[-1] == 4.0
    )


@pytest.mark.parametrize("head, unit", [("Weg", None), ("Weg [V]", None), ("Weg [steps]", None), ("Weg [steps]", "mm")])
def test_a_raw_channel_is_told_how_to_say_its_calibration(tmp_path, head, unit):
    path = write(tmp_path, f"{head};Fz_N\n0;0\n4;3\n")
    said = refusal(path, {"depth": Column(head, unit), "Fz": Column("Fz_N")})
    assert f"{path}:1: column 'depth'" in said and '"0.00125 mm" for what one count is' in said


def test_each_file_has_its_own_zero(tmp_path):
    for k, zero in enumerate((35.0, 34.5)):
        write(tmp_path, "pos_mm,Fz_N\n" + "".join(f"{zero + u},{0.1 * u}\n" for u in range(5)), name=f"{k}.csv")
    files = [tmp_path / "0.csv", tmp_path / "1.csv"]
    columns = {"depth": Column("pos_mm", zero=(35.0, 34.5)), "Fz": Column("Fz_N")}
    assert [r.depth.tolist() for r in read_measurement(files, columns).repeats] == [[0.0, 1.0, 2.0, 3.0, 4.0]] * 2
    with pytest.raises(ValueError, match=r"column 'depth': zero = \[35.0, 34.5\] are 2 for 1 file"):
        read_measurement(files[:1], columns)


@pytest.mark.parametrize(
    "force,weight", [("Force (N)", "Weight (N)"), ("Kraft (N)", "Gewicht (N)"), ("Load (N)", "Mass")]
)
def test_the_weight_of_a_specimen_is_no_force_beside_one(tmp_path, force, weight):
    rows = [f"{u},{F}" for _, u, F in TEXTS[:41]]
    (tmp_path / "both.csv").write_text("\n".join([f"Displacement (mm),{force},{weight}", *(f"{r},0.2" for r in rows)]))
    (tmp_path / "alone.csv").write_text("\n".join(["Displacement (mm),Weight (N)", *rows]))
    for name in ("both.csv", "alone.csv"):
        (r,) = read_measurement(tmp_path / name).repeats
        np.testing.assert_allclose(r.channels["Fz"], [float(F) for _, _, F in TEXTS[:41]])
