"""Files of a sloppy laboratory: each is read as meant, remarked upon, or refused with its place and a way out."""

from pathlib import Path

import numpy as np
import pytest
import sample_studies as studies

from rso.cli.checking import check_lines
from rso.data import Column, read_measurement
from rso.study.loader import load_study

U = np.linspace(0.0, 4.0, 41)
F = 0.04 * U**1.5
T = 2.0 * U
W = np.linspace(0.0, 4.0, 401)
FINE = 2.0 * W, W - 0.3 * (W > 2.845), 0.04 * W**1.5  # a motor loses 0.3 mm on its way
LOADED = np.linspace(0.0, 0.0785, 100)  # a force that grows steadily in 10 s and is held for 5 s, while the body creeps
HELD = (
    np.linspace(0.1, 15.0, 150),
    np.r_[(LOADED / 0.04) ** (2 / 3), 1.568 + 0.04 * (1 - np.exp(-np.linspace(0.0, 1.5, 50)))],
    np.r_[LOADED, np.full(50, 0.0785) + 1e-5 * np.sin(np.arange(50))],
)
CYCLE = np.r_[U, U[::-1]]
PLAIN = {"depth": Column("depth_mm"), "Fz": Column("Fz_N")}
CLOCK = [f"00:00:{t:06.3f}" for t in T]


def table(head: str, *columns, separator: str = ",") -> str:
    each = [[v if isinstance(v, str) else f"{v:.6g}" for v in column] for column in columns]
    return "\n".join([head, *(separator.join(row) for row in zip(*each, strict=True)), ""])


def with_cell(cell: str) -> str:
    return table("depth_mm,Fz_N", U, [cell if k == 30 else f"{v:.5f}" for k, v in enumerate(F)])


def grouped(mark: str) -> str:
    return table("depth_um;Fz_mN", [f"{1000 * u:,.0f}".replace(",", mark) for u in U], 1000 * F, separator=";")


def write(tmp_path: Path, text: str, encoding: str = "utf-8") -> Path:
    path = tmp_path / "data.csv"
    path.write_bytes(text.encode(encoding))
    return path


READ = {  # text, encoding, columns
    **{f"brackets, {m}": (table(f"depth [{m}m],Fz (mN)", 1000 * U, 1000 * F), "utf-8", None) for m in "µμu"},
    "µ of an old machine": (table("depth [µm];Fz [mN]", 1000 * U, 1000 * F, separator=";"), "latin-1", None),
    "units in a second row": (table("depth,Fz\n[µm],[mN]", 1000 * U, 1000 * F), "utf-8", None),
    "forces in gf": (table("depth_mm,Fz_gf", U, F / 0.00980665), "utf-8", None),
    "Excel, BOM, semicolons, commas": (
        table("time_s;depth_mm;Fz_N", T, U, F, separator=";").replace(".", ",").replace("\n", "\r\n"),
        "utf-8-sig",
        None,
    ),
    "units as words in capitals": (table("depth (Millimeters),Fz (Newton)", U, F), "utf-8", None),
    "marks of no width": (table("\u200bdepth_mm;Fz_N\u200b", U, F, separator=";"), "utf-8-sig", None),
    "zero bytes of a logger that was cut off": (table("depth_mm,Fz_N", U, F) + "\0" * 40, "utf-8", None),
    "units with a full stop": (table("depth (mm.),Fz [N.]", U, F), "utf-8", None),
    "an en dash for a minus": (table("depth_mm;Fz_N", U, F, separator=";").replace("0;0", "–0.0;0"), "utf-8", None),
    "the first line of Excel": ("sep=;\n" + table("depth_mm;Fz_N", U, F, separator=";"), "utf-8", None),
    "a header cell of two lines": (table('"depth\n[mm]";"Fz\r\n[N]"', U, F, separator=";"), "utf-8", None),
    "a comment in the middle": (table("depth_mm,Fz_N", U, F).replace("\n2,", "\n# paused\n2,"), "utf-8", None),
    "no end of the last line": (table("depth_mm,Fz_N", U, F).rstrip("\n"), "utf-8", None),
    "a clock": (table("time_s,depth_mm,Fz_N", CLOCK, U, F), "utf-8", None),
    "a clock in its header": (
        table("Zeit [hh:mm:ss],depth_mm,Fz_N", CLOCK, U, F),
        "utf-8",
        PLAIN | {"time": Column("Zeit [hh:mm:ss]")},
    ),
    "a clock that is not read": (table("Zeit,depth_mm,Fz_N", CLOCK, U, F), "utf-8", PLAIN),
    "a typographic minus": (
        table("depth_mm,Fz_N", U, [f"−{v:.6g}" for v in F]),
        "utf-8",
        {"depth": Column("depth_mm"), "Fz": Column("Fz_N", flip=True)},
    ),
    "a depth counted downwards, force compressive": (
        table("depth_mm,Fz_N", -U, -F),
        "utf-8",
        {"depth": Column("depth_mm", flip=True), "Fz": Column("Fz_N", flip=True)},
    ),
    "seconds since 1970": (table("time_s,depth_mm,Fz_N", [f"{1.7e9 + t:.3f}" for t in T], U, F), "utf-8", None),
    "inches in a note": ('Ball 1/4"\nHolder 2"\n' + table("depth_mm,Fz_N", U, F), "utf-8", None),
}


@pytest.mark.parametrize("what", READ)
def test_read_as_meant(tmp_path, what):
    text, encoding, columns = READ[what]
    m = read_measurement(write(tmp_path, text, encoding), columns)
    (r,) = m.repeats
    np.testing.assert_allclose(r.depth, U, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(r.channels["Fz"], F, rtol=1e-4, atol=1e-9)
    assert m.doubts == ()


def test_a_quote_in_a_remark_takes_no_readings_with_it(tmp_path):
    """Opened in one row and closed some rows on, as where somebody writes of inches."""
    notes = ['"slipped' if k == 5 else 'again"' if k == 11 else "" for k in range(41)]
    path = write(tmp_path, table("depth_mm;Fz_N;Bemerkung", U, F, notes, separator=";"))
    assert len(read_measurement(path, PLAIN).repeats[0].depth) == 41


@pytest.mark.parametrize("head", ["Depth um,Load mN", "Travel - um;Force - mN", "depth  um,LOAD mN"])
def test_a_unit_behind_a_blank_is_one(tmp_path, head):
    text = table(head, 1e3 * U, 1e3 * F, separator=";" if ";" in head else ",")
    m = read_measurement(write(tmp_path, text))
    np.testing.assert_allclose(m.repeats[0].channels["Fz"], F, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(m.repeats[0].depth, U, rtol=1e-4, atol=1e-9)


def test_a_time_of_day_passes_midnight(tmp_path):
    times = [f"{23 if t < 4 else 0}:{59 if t < 4 else 0:02d}:{56 + t if t < 4 else t - 4:06.3f}" for t in T]
    m = read_measurement(write(tmp_path, table("time_s,depth_mm,Fz_N", times, U, F)))
    np.testing.assert_allclose(m.repeats[0].time - m.repeats[0].time[0], T, atol=1e-6)


def test_a_column_of_spread_is_asked_about_and_no_second_force(tmp_path):
    text = table("Travel (mm),Mean Force (N),Force SD (N)", U, F, 0.03 * F)
    (said,) = (d for d in read_measurement(write(tmp_path, text)).doubts if "not read" in d)
    assert "Fz_sigma = { header = " in said and "moves with" not in said


REFUSED = {  # text, columns, place and words
    "thousands in quotes": (
        table("depth_um,Fz_mN", [f'"{1000 * u:,.0f}"' for u in U], [f"{1e3 * v:.1f}" for v in F]),
        None,
        [":2:", "'1,000'", "parts thousands"],
    ),
    "apostrophes": (grouped("'"), None, [":12:", "'depth'", "1'000", "write thousands without a mark"]),
    "thin blanks": (grouped("\u202f"), None, [":12:", "'depth'", "000'", "write thousands without a mark"]),
    "points": (grouped("."), None, [":12:", "'1.000'"]),
    "a date": (table("time_s,depth_mm,Fz_N", ["2024-02-01T10:00:00"] * 41, U, F), None, [":3:", "does not follow"]),
    "a clock of minutes": (
        table("time_s,depth_mm,Fz_N", [t[3:] for t in CLOCK], U, F),
        None,
        [":2:", "'time'", "'00:00.000'", "no time of day as 10:00:03.5; write seconds", "settings.speed"],
    ),
    **{
        f"overload {cell!r}": (with_cell(cell), None, [":32:", "'Fz'", f"'{cell}'", "delete the row"])
        for cell in ("----", "OVLD", "***")
    },
    **{
        f"overload {cell!r}": (with_cell(cell), None, [":32:", "'Fz'", f"'{cell}'"])
        for cell in ("1.#INF", "9.99E+37", "1.0D+00")
    },
    "a gap as a number": (
        table("depth_mm,Fz_N", U, np.where(abs(U - 2) < 0.15, -9999.0, F)),
        None,
        [":21:", "'Fz' is -9999 N in 3 readings", "delete these rows"],
    ),
    "an overload as a number": (
        table("depth_mm,Fz_N", U, np.where(U > 3.45, 9999.0, F)),
        None,
        [":37:", "'Fz' is 9999 N in 6 readings", "a mark for an overload"],
    ),
    "a depth that is none": (
        table("depth_mm,Fz_N", np.where(U > 3.85, 999.0, U), F),
        None,
        [":41:", "'depth' is 999 mm in 2"],
    ),
    "a gap of either sign": (
        table("depth_mm,Fz_N", U, np.where(abs(U - 2) < 0.12, 9e3 * np.sign(U - 2.05), F)),
        None,
        [":21:", "'Fz' is -9000 N in 3 readings", "delete these rows"],
    ),
    "a single gap": (
        table("depth_mm,Fz_N", U, np.where(abs(U - 2) < 0.05, -9999.0, F)),
        None,
        [":22:", "'Fz' is -9999 N in 1 reading ", "delete this row"],
    ),
    "backwards": (table("time_s,depth_mm,Fz_N", T[::-1], U[::-1], F[::-1]), None, [":3:", "'time'", "sort them"]),
    "a word in some rows": (
        "depth_mm  Fz_N  note\n"
        + "".join(f"{u} {v} {'' if k % 7 else 'x'}\n" for k, (u, v) in enumerate(zip(U, F, strict=True))).rstrip(
            "x \n"
        ),
        None,
        [":1:", "blanks part 3 words of this line and 2 of line 42", "by semicolons"],
    ),
    "one time twice": (
        table("time_s,depth_mm,Fz_N", np.where(T == T[20], T[19], T), U, F),
        None,
        [":22:", "'time'", "3.8 s does not follow 3.8 s", "delete one of the two rows"],
    ),
    "a coarse clock": (table("time_s,depth_mm,Fz_N", np.floor(T), U, F), None, [":3:", "'time'", "clock this coarse"]),
    "depth downwards": (table("depth_mm,Fz_N", -U, F), None, ["'depth' falls from 0 to -4", "flip = true"]),
    "force compressive": (table("depth_mm,Fz_N", U, -F), None, ["'Fz' falls", "flip = true"]),
    "a height, there and back": (
        table("depth_mm,Fz_N", 50 - CYCLE, 0.04 * CYCLE**1.5),
        None,
        ["falls from 50 to 46 mm and comes back, is a height", "flip = true", "zero = "],
    ),
    "a height through 0": (
        table("depth_mm,Fz_N", 2 - CYCLE, 0.04 * CYCLE**1.5),
        None,
        ["falls from 2 to -2 mm and comes back, is a height", "flip = true", "zero = "],
    ),
    "a position": (table("depth_mm,Fz_N", 50 + U, F), None, ["begins at 50 mm", "zero = "]),
    "cycles": (
        table("depth_mm,Fz_N", np.tile(CYCLE, 3), np.tile(0.04 * CYCLE**1.5, 3)),
        None,
        ["turns back more than once within 4 mm", "Add a column 'repeat'"],
    ),
    "units in the cells": (
        table("Travel,Force", [f"{u} mm" for u in U], [f"{v} N" for v in F]),
        None,
        [":1:", "'Travel' says no unit, but '0.0 mm' does", "write the unit into the header"],
    ),
    "units in both": (
        table("depth_mm,Fz_N", [f"{u}mm" for u in U], F),
        None,
        [":2:", "'0.0mm'", "write the unit into the header"],
    ),
    "shares in the cells": (table("depth_mm,Fz_N", [f"{u} %" for u in U], F), None, [":2:", "numbers alone"]),
    **{
        f"header and rows parted otherwise, {name}": (
            table("depth_mm;Fz_N", U, F, separator=mark),
            None,
            [":2:", f"by semicolons, this row by {name}", "part both alike"],
        )
        for mark, name in ((",", "commas"), ("\t", "tabs"))
    },
    "bars between columns": (
        table("depth_mm|Fz_N", U, F, separator="|"),
        None,
        [":1:", "parted by '|'", "by semicolons"],
    ),
    "strain and stress": (
        table("Strain (%),Stress (kPa)", U, F),
        None,
        [":1:", "'Strain (%)' is no depth: multiply it by the length", "'Stress (kPa)' is no force", "the area"],
    ),
    "all rows twice": (
        table("time_s,depth_mm,Fz_N", *(np.repeat(v, 2) for v in (T, U, F))),
        None,
        [":3:", "such rows stand twice: delete one of each"],
    ),
    "segments exchanged": (
        table("depth_mm,Fz_N,segment", CYCLE, np.r_[F, 0.8 * F[::-1]], ["unloading"] * 41 + ["loading"] * 41),
        None,
        ["segment 'loading' goes to 4 mm and ends at 0 mm", "exchanged"],
    ),
    "both ways called loading": (
        table("depth_mm,Fz_N,segment", CYCLE, np.r_[F, 0.8 * F[::-1]], ["loading"] * 82),
        None,
        ["ends at 0 mm", "both called loading"],
    ),
    "rows shuffled": (
        table("depth_mm,Fz_N", *(v[np.random.default_rng(1).permutation(41)] for v in (U, F))),
        None,
        ["stand in no order", "Sort them"],
    ),
    "rows shuffled, with times": (
        table("time_s,depth_mm,Fz_N", *(v[np.random.default_rng(1).permutation(41)] for v in (T, U, F))),
        None,
        ["'time'", "no order of time: sort them by it"],
    ),
    "rows in reverse, with times": (
        table("Time (s),Travel (mm),Force (N)", *(v[::-1] for v in (T, U, F))),
        None,
        ["all rows run backwards in time: sort them by it"],
    ),
    "rows in reverse": (table("Travel (mm),Force (N)", U[::-1], F[::-1]), None, ["reverse order", "sort the rows"]),
    "a clock that begins again in each part": (
        table("time_s,depth_mm,Fz_N", np.r_[T, T], CYCLE, np.r_[F, 0.8 * F[::-1]]),
        None,
        [":43:", "0 s does not follow 8 s", "begins again where the depth goes on: add the times up"],
    ),
    "a mass": (table("depth_mm,Fz [g]", U, F), PLAIN | {"Fz": Column("Fz [g]")}, [":1:", "'g' is a mass", "'gf'"]),
    "cut off": (table("depth_mm,Fz_N", U, F)[:-6], None, [":42:", "1 values in a table of 2 columns", "'4'"]),
    "side by side": (
        table("depth_mm,Fz_N,depth_mm,Fz_N", U, F, U, F),
        None,
        [":1:", "data.csv#1, data.csv#2"],
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_refused_with_its_place_and_a_way_out(tmp_path, what):
    text, columns, words = REFUSED[what]
    path = write(tmp_path, text)
    with pytest.raises(ValueError) as caught:
        read_measurement(path, columns)
    for word in (str(path), *words):
        assert word in str(caught.value)


REMARKED = {  # text, words
    "depth from before contact": (table("depth_mm,Fz_N", U - 2, F), "Fz grows by 0.112 N from -2 mm to 0, where"),
    "exchanged": (table("Fz_N,depth_mm", U, F), "Fz grows only as the power 0.67 of depth"),
    "filled up": (table("depth_mm,Fz_N", np.r_[U, 0, 0, 0], np.r_[F, 0, 0, 0]), "last 3 readings (from line 43)"),
    "filled up with its last": (table("depth_mm,Fz_N", np.r_[U, 9 * [2.5]], np.r_[F, 9 * [0.1]]), "last 9 readings"),
    "a load before": (table("depth_mm,Fz_N", U, F + 0.05), "0.05 N at 0 mm; not tared, or touched before?"),
    "a sensor at its end": (table("depth_mm,Fz_N", U, np.minimum(F, 0.2)), "stays at its largest value, 0.2 N"),
    "Did a counter slip": (table("depth_mm,Fz_N", U + 1.0 * (U > 2.05), F), "jumps by 1.1 mm from 2 mm"),
    "steps lost on the way": (table("time_s,depth_mm,Fz_N", *FINE), "jumps by -0.29 mm from 2.84 mm"),
    "a cell tared on the way": (table("depth_mm,Fz_N", U, F - 0.1 * (U > 3.05)), "Fz jumps by -0.0895 N at 3 mm"),
    "held at constant force": (table("time_s,depth_mm,Fz_N", *HELD), "Fz stays at 0.0785 N from 1.57 to 1.6 mm"),
    "cut within a number": (table("depth_mm,Fz_N", U, F)[:-4], "falls from 0.296 N"),
}


SOUND = {
    "readings left out": table("depth_mm,Fz_N", np.delete(U, range(12, 26)), np.delete(F, range(12, 26))),
    "left out between times": table("time_s,depth_mm,Fz_N", *(np.delete(v, range(12, 26)) for v in (T, U, F))),
    "a coarse scale": table("depth_mm,Fz_N", np.round(np.linspace(0, 4, 400) / 0.25) * 0.25, np.linspace(0, 2, 400)),
    "a quick way back": table("depth_mm,Fz_N", np.r_[U, U[-1:0:-16]], np.r_[F, F[-1:0:-16]]),
}


@pytest.mark.parametrize("what", SOUND)
def test_gaps_coarse_scales_and_other_speeds_are_no_jumps(tmp_path, what):
    assert not any("jumps" in doubt for doubt in read_measurement(write(tmp_path, SOUND[what])).doubts)


@pytest.mark.parametrize("what", REMARKED)
def test_read_and_remarked_upon(tmp_path, what):
    text, words = REMARKED[what]
    assert any(words in doubt for doubt in read_measurement(write(tmp_path, text)).doubts)


def test_what_is_no_such_thing_is_not_remarked_upon(tmp_path):
    """An approach through noise and drift, a slow way back to a rest, a flat punch, a body that relaxes."""
    rng = np.random.default_rng(1)
    air = np.r_[np.linspace(-3, 0, 60)[:-1], U]
    body = 0.04 * np.maximum(air, 0) ** 1.5 + 0.002 * rng.normal(size=len(air)) + 0.002 * air
    rest = np.r_[U, U[::-1], np.zeros(9)]
    for depth, force in ((air, body), (rest, 0.04 * rest**1.5), (U, 0.1 * U), (U, F * (0.4 + 0.6 * np.exp(-2 * U)))):
        doubts = read_measurement(write(tmp_path, table("depth_mm,Fz_N", depth, force))).doubts
        assert not [d for d in doubts if any(w in d for w in ("contact should be", "exchanged", "filled up"))]


@pytest.mark.parametrize("start, unit, said", [(0.0, "s", False), (45000.4, "d", True)])
def test_days_taken_for_seconds_are_remarked_upon_by_a_check(tmp_path, start, unit, said):
    """As a spreadsheet counts them."""
    time = [f"{start + t / (86400.0 if unit == 'd' else 1.0):.11f}" for t in T]
    write(tmp_path, table("time_s,depth_mm,Fz_N", time, U, F))
    experiment = 'name = "top"\nrole = "fit"\ndata = "data.csv"\n'
    loaded = load_study(studies.write(tmp_path, experiments=experiment))
    assert ("is the unit of its time right?" in " ".join(check_lines(loaded, tmp_path, trust=True))) == said
