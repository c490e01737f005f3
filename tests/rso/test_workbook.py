"""Workbooks of a spreadsheet: read as the same table saved as CSV, or refused with what they hold."""

import datetime
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from openpyxl import Workbook
from test_laboratory import NOMINAL

from rso.data import fingerprint, read_measurement
from rso.study.laboratory_folder import study_of_folder

U = np.linspace(0.0, 4.0, 41)
F = 0.04 * U**1.5
START = datetime.datetime(2026, 3, 1, 23, 59, 58)


def saved(path: Path, **sheets) -> Path:
    book = Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


def readings(head: tuple[str, ...], *columns) -> list[list]:
    return [
        list(head),
        *([v if not isinstance(v, np.floating) else float(v) for v in row] for row in zip(*columns, strict=True)),
    ]


def as_text(column: np.ndarray) -> list[str]:
    return [repr(float(v)).replace(".", ",") for v in column]


PLAIN = readings(("depth_mm", "Fz_N"), U, F)
READ = {
    "plain": [("a", PLAIN)],
    "notes above and an empty row": [("a", [["Operator", "M. Muster"], [], *PLAIN])],
    "a row of units": [("a", [["Standardweg", "Standardkraft"], ["mm", "N"], *PLAIN[1:]])],
    "a header of two lines in a cell": [("a", [["depth\n[mm]", "Fz\n[N]"], *PLAIN[1:]])],
    "another sheet of results": [("Max", [["Force", 0.5, 2], ["Depth", 1, 4]]), ("Probe 1", PLAIN), ("empty", [])],
    "numbers as text with commas": [("a", readings(("depth_mm", "Fz_N"), as_text(U), as_text(F)))],
}


@pytest.mark.parametrize("sheets", READ.values(), ids=READ)
def test_a_sheet_of_readings_is_read_to_all_its_digits(tmp_path, sheets):
    m = read_measurement(saved(tmp_path / "data.xlsx", **dict(sheets)))
    # The library that writes them keeps 16 digits.
    assert_allclose(m.repeats[0].depth, U, rtol=1e-15, atol=0.0)
    assert_allclose(m.repeats[0].channels["Fz"], F, rtol=1e-15, atol=0.0)


@pytest.mark.parametrize(
    "clock",
    [
        [START.time().replace(hour=10, minute=5, second=1 + k, microsecond=500_000) for k in range(41)],
        [datetime.timedelta(seconds=k + 0.5) for k in range(41)],
        [datetime.datetime(2026, 3, 1, 10, 5, 1) + datetime.timedelta(seconds=k) for k in range(41)],
    ],
    ids=["time of day", "duration", "date and time"],
)
def test_times_of_a_sheet_are_seconds(tmp_path, clock):
    m = read_measurement(saved(tmp_path / "data.xlsx", a=readings(("time_s", "depth_mm", "Fz_N"), clock, U, F)))
    assert_array_equal(np.diff(m.repeats[0].time), np.ones(40))


def test_a_row_is_named_by_its_number_in_the_sheet(tmp_path):
    rows = [["note"], [], *(PLAIN[:10]), [0.9, "?"], *PLAIN[11:]]
    with pytest.raises(ValueError, match=r"data\.xlsx:13: column 'Fz': '\?' is not a finite number"):
        read_measurement(saved(tmp_path / "data.xlsx", a=rows))


def test_several_sheets_of_readings_are_refused_by_name(tmp_path):
    path = saved(tmp_path / "data.xlsx", **{"Probe 1": PLAIN[:20], "Probe 2": PLAIN, "Max": [["Fmax", 1.0, 2.0]]})
    with pytest.raises(ValueError, match=r"2 of its sheets .*'Probe 1', 'Probe 2'.*data = \"data.xlsx#Probe 2\""):
        read_measurement(path)


def test_sheets_of_a_workbook_are_named_behind_its_name_and_repeats_in_a_list(tmp_path):
    twice = readings(("depth_mm", "Fz_N"), U, 2.0 * F)
    path = saved(tmp_path / "Serie #3.xlsx", **{"Probe 1": PLAIN, "Probe # 2": twice, "empty": []})
    one = read_measurement(f"{path}#Probe # 2")
    assert_allclose(one.repeats[0].channels["Fz"], 2.0 * F, rtol=1e-15, atol=0.0)
    both = read_measurement([f"{path}#Probe 1", f"{path}#Probe # 2"])
    assert [r.label for r in both.repeats] == ["Probe 1", "Probe # 2"]
    with pytest.raises(ValueError, match=r"has no sheet 'Probe 2'; choose from .*'Probe # 2'"):
        read_measurement(f"{path}#Probe 2")
    with pytest.raises(ValueError, match="none of its sheets \\('empty'\\)"):
        read_measurement(f"{path}#empty")
    with pytest.raises(ValueError, match="no such file"):
        read_measurement(tmp_path / "other.xlsx#Probe 1")
    with pytest.raises(ValueError, match="listed twice"):
        read_measurement([f"{path}#Probe 1", f"{path}#Probe 1"])


def test_a_sheet_counts_once_however_it_is_named(tmp_path):
    path = saved(tmp_path / "a.xlsx", **{"Probe 1": PLAIN, "notes": [["Operator", "M. Muster"]]})
    assert fingerprint(path) == fingerprint(Path(f"{path}#Probe 1"))
    two = saved(tmp_path / "b.xlsx", **{"Probe 1": PLAIN, "Probe 2": readings(("depth_mm", "Fz_N"), U, 2.0 * F)})
    assert fingerprint(Path(f"{two}#Probe 1")) == fingerprint(path) != fingerprint(Path(f"{two}#Probe 2"))


def test_what_is_no_workbook_has_no_sheet(tmp_path):
    (tmp_path / "a.xlsx").write_text("depth_mm,Fz_N\n0,0\n1,1\n")
    with pytest.raises(ValueError, match=r"a\.xlsx: is no workbook and has no sheet 'Probe 1'"):
        read_measurement(tmp_path / "a.xlsx#Probe 1")


def test_a_file_whose_own_name_holds_the_mark_is_that_file(tmp_path):
    path = saved(tmp_path / "book.xlsx#1", a=PLAIN)
    assert read_measurement(path).path == path


ZWICK = [  # title, header, units, and what the laboratory reckoned beside the readings
    ["Probe 1"] * 4,
    ["Temps d'essai", "Force standard", "Allongement", "Ecartement entre outils", None, None, 20, 80],
    ["s", "N", "mm", "mm", None, "N0", 0.123, 0.456],
]


@pytest.mark.parametrize("beside", ["few", "full", "none"])
def test_what_was_reckoned_beside_the_readings_is_not_read(tmp_path, beside):
    more = {"few": [[None, 1.5], [None, 2.5]] + 39 * [[]], "full": 41 * [[0.1, None, 7]], "none": 41 * [[]]}[beside]
    rows = [[0.1 * k, float(F[k]), float(U[k]), 10.0 - float(U[k]), *more[k]] for k in range(41)]
    head = ZWICK if beside != "none" else [row[:4] for row in ZWICK]
    m = read_measurement(saved(tmp_path / "data.xlsx", a=[*head, *rows]))
    assert_allclose(m.repeats[0].channels["Fz"], F, rtol=1e-15, atol=0.0)
    assert_allclose(m.repeats[0].time, 0.1 * np.arange(41), rtol=1e-12, atol=0.0)
    letters = {"few": "F, G, H", "full": "E, F, G, H", "none": ""}[beside]
    said = [d.split(": ", 1)[1] for d in m.doubts if "under no header" in d]
    assert said == ([f"column(s) {letters}, under no header of the table, are not read"] if letters else [])
    assert m.unread == ("Ecartement entre outils",)


def test_a_column_with_a_header_stays_however_few_cells_it_has(tmp_path):
    rows = [[*row, "slipped" if k == 5 else None] for k, row in enumerate(PLAIN[1:])]
    m = read_measurement(
        saved(tmp_path / "data.xlsx", a=[["Standardweg", "Standardkraft", "Bemerkung"], ["mm", "N"], *rows])
    )
    assert m.unread == ("Bemerkung",) and not any("not read" in d for d in m.doubts)


def test_a_workbook_of_the_old_kind_is_named_as_one(tmp_path):
    path = tmp_path / "data.xls"
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    with pytest.raises(ValueError, match=r"data.xls: is a workbook of the old kind \(.xls\) or has a password"):
        read_measurement(path)


def test_formulas_never_computed_are_no_readings(tmp_path):
    rows = [["depth_mm", "Fz_N"], *([f"=A{k}*2", f"=B{k}*2"] for k in range(40))]
    with pytest.raises(ValueError, match=r"none of its sheets .* formulas that were never computed"):
        read_measurement(saved(tmp_path / "data.xlsx", a=rows))


def test_units_in_the_cells_of_a_sheet_are_named_as_that(tmp_path):
    rows = [["depth", "Fz"], *([f"{0.1 * k:.1f} mm", f"{k} mN"] for k in range(40))]
    with pytest.raises(ValueError, match=r"write the unit into the header, and numbers alone into the cells"):
        read_measurement(saved(tmp_path / "data.xlsx", a=rows))


def test_another_archive_is_no_workbook(tmp_path):
    path = tmp_path / "data.xlsx"
    path.write_bytes(b"PK\x03\x04 and so on")
    with pytest.raises(ValueError, match="no workbook"):
        read_measurement(path)


def test_what_a_packed_file_holds_is_named(tmp_path):
    path = tmp_path / "data.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("press 1.csv", "depth_mm,Fz_N\n0,0\n1,1\n")
    with pytest.raises(ValueError, match=r"unpack it and give what it holds: 'press 1.csv'"):
        read_measurement(path)


def test_what_only_has_the_name_of_a_workbook_is_said_to_be_damaged(tmp_path):
    (tmp_path / "x.xlsx").write_bytes(bytes(range(200)))
    with pytest.raises(ValueError, match=r"x\.xlsx: is no workbook that can be read; damaged\?"):
        read_measurement(tmp_path / "x.xlsx")


def test_a_workbook_packed_in_another_way_is_refused_as_one(tmp_path):
    """Its parts say that they need a version 8.2 to be unpacked."""
    path = saved(tmp_path / "data.xlsx", a=PLAIN)
    raw = bytearray(path.read_bytes())
    at = raw.index(b"PK\x01\x02")
    raw[at + 6] = 82
    path.write_bytes(bytes(raw))
    with pytest.raises(ValueError, match=r"data\.xlsx: .*no workbook"):
        read_measurement(path)


def test_a_damaged_workbook_is_refused_as_one(tmp_path):
    whole, path = saved(tmp_path / "whole.xlsx", a=PLAIN), tmp_path / "data.xlsx"
    with zipfile.ZipFile(whole) as source, zipfile.ZipFile(path, "w") as copy:
        for name in source.namelist():
            raw = source.read(name)
            copy.writestr(name, raw[: len(raw) // 2] if "sheet1" in name else raw)
    with pytest.raises(ValueError, match=r"data\.xlsx: .*no workbook"):
        read_measurement(path)


def test_a_folder_may_hold_workbooks(tmp_path):
    (tmp_path / "nominal.json").write_text(json.dumps(NOMINAL))
    saved(tmp_path / "mp_load.xlsx", a=PLAIN)
    saved(tmp_path / "~$mp_load.xlsx", a=PLAIN)  # an open workbook's lock
    text = study_of_folder(tmp_path, 1, tmp_path)
    assert text.count("[[experiments]]") == 1 and "mp_load.xlsx" in text
