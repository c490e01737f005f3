"""Tables beside one another in a file: each is read as if it stood alone; what is no such file is left as it is."""

import numpy as np
import pytest

from rso.data import read_measurement

DEPTH = np.linspace(0.05, 2.0, 40)
FORCE = [g * 0.04 * DEPTH**1.5 for g in (1.0, 1.1, 0.9)]


def written(path, separator=",", names=("depth_mm", "Fz_N"), spacer=0, again="", units=(), above=(), short=0):
    """Three curves side by side; the last `short` readings of the third are missing."""
    header = [[n + (again.format(k) if k else "") for n in names] + [""] * spacer for k in range(3)]
    lines = [separator.join(v for w in above for v in [w, *[""] * (len(names) + spacer - 1)])] if above else []
    lines += [separator.join(v for one in header for v in one)]
    lines += [separator.join(v for _ in range(3) for v in [*units, *[""] * spacer])] if units else []
    for i, u in enumerate(DEPTH):
        cells = [[f"{u:.6f}", f"{F[i]:.9f}"] + [""] * spacer for F in FORCE]
        if i >= len(DEPTH) - short:
            cells[2] = ["", ""] + [""] * spacer
        row = separator.join(v for one in cells for v in one)
        lines.append(row.replace(".", ",") if separator == ";" else row)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"spacer": 1, "above": ("A1", "A2", "A3")},
        {"separator": ";", "names": ("Weg", "Kraft"), "units": ("mm", "N")},
        {"separator": "\t", "names": ("Depth (mm)", "Force (N)"), "again": ".{}"},
        {"short": 7},
    ],
)
def test_each_of_three_curves_side_by_side(tmp_path, how):
    path = written(tmp_path / "wide.csv", **how)
    for k, F in enumerate(FORCE, 1):
        (r,) = read_measurement(f"{path}#{k}").repeats
        n = len(DEPTH) - how.get("short", 0) * (k == 3)
        np.testing.assert_allclose(r.depth, DEPTH[:n], rtol=0, atol=1e-6)  # written to six digits
        np.testing.assert_allclose(r.channels["Fz"], F[:n], rtol=0, atol=1e-9)
    together = read_measurement([f"{path}#1", f"{path}#3"])
    assert [r.label for r in together.repeats] == ["wide#1", "wide#3"]


def test_which_of_them_is_asked_for(tmp_path):
    path = written(tmp_path / "wide.csv", above=("stiff", "soft", "mid"))
    with pytest.raises(ValueError, match=r"wide.csv:2: 3 tables .* side by side; name one: wide.csv#1 \(stiff\), wide"):
        read_measurement(path)
    with pytest.raises(ValueError, match=r"there is no table 4; name one: wide.csv#1 \(stiff\), wide.csv#2 \(soft\)"):
        read_measurement(f"{path}#4")


def test_a_sheet_of_a_workbook_with_several(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "Gel"
    sheet.append(["depth_mm", "Fz_N", None, "depth_mm", "Fz_N"])
    for u, a, b in zip(DEPTH, FORCE[0], FORCE[1], strict=True):
        sheet.append([float(u), float(a), None, float(u), float(b)])
    book.save(tmp_path / "book.xlsx")
    (r,) = read_measurement(f"{tmp_path / 'book.xlsx'}#Gel#2").repeats
    np.testing.assert_allclose(r.channels["Fz"], FORCE[1], rtol=1e-12)
    assert len(read_measurement([f"{tmp_path / 'book.xlsx'}#Gel#{k}" for k in (1, 2)]).repeats) == 2
    with pytest.raises(ValueError, match=r"book.xlsx#Gel#1, book.xlsx#Gel#2"):
        read_measurement(f"{tmp_path / 'book.xlsx'}#Gel")
    book.create_sheet("Notes").append(["by", "NN"])
    book.save(tmp_path / "book.xlsx")
    with pytest.raises(ValueError, match=r"book.xlsx#Gel#1, book.xlsx#Gel#2"):  # to be typed as it stands
        read_measurement(tmp_path / "book.xlsx")


@pytest.mark.parametrize("header", ["depth_mm,Fz_N,Fx_N,Fy_N", "depth_mm,Fz_N,time_s,Fx_N"])
def test_a_table_with_many_columns_is_one(tmp_path, header):
    rows = [f"{u:.4f},{F:.6f},{k + 1},{k}" for k, (u, F) in enumerate(zip(DEPTH, FORCE[0], strict=True))]
    (tmp_path / "one.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    assert len(read_measurement(tmp_path / "one.csv").repeats[0].depth) == len(DEPTH)


def cycled(path, peaks=(1.0, 1.0, 2.0), bottom=-0.2, first=-0.2):
    """Cycles between `bottom` and the peaks, the record beginning at `first`; noise of depth 2 µm."""
    ways = [np.linspace(first, peaks[0], 80)]
    for a, b in zip(peaks, [*peaks[1:], None], strict=True):
        ways += [np.linspace(a, bottom, 60)[1:], *([] if b is None else [np.linspace(bottom, b, 80)[1:]])]
    u = np.concatenate(ways) + 2e-3 * np.random.default_rng(1).standard_normal(sum(map(len, ways)))
    F = 0.04 * np.maximum(u, 0.0) ** 1.5
    rows = [f"{0.1 * k:.2f},{d:.6f},{v:.9f}" for k, (d, v) in enumerate(zip(u, F, strict=True))]
    path.write_text("\n".join(["time_s,depth_mm,Fz_N", *rows]), encoding="utf-8")
    return path, u


def test_cycles_of_one_record_are_named(tmp_path):
    """Each goes to its own peak and back; all rows of the record are in one of them."""
    path, u = cycled(tmp_path / "cyc.csv")
    with pytest.raises(ValueError, match=r"3 cycles. Name the one .* cyc.csv#1 to 0.9991 mm, .*cyc.csv#3 to 1.999 mm"):
        read_measurement(path)
    each = [read_measurement(f"{path}#{k}") for k in (1, 2, 3)]
    assert [round(float(m.repeats[0].depth.max()), 1) for m in each] == [1.0, 1.0, 2.0]
    np.testing.assert_array_equal(np.concatenate([m.repeats[0].depth for m in each]), np.round(u, 6))
    assert [any("before this one are not simulated" in d for d in m.doubts) for m in each] == [False, True, True]
    assert all(set(m.repeats[0].segment) == {"loading", "unloading"} for m in each)
    with pytest.raises(ValueError, match="has no block 4; it holds 3 cycles"):
        read_measurement(f"{path}#4")


def test_cycles_that_begin_in_the_body_are_no_tests(tmp_path):
    """Down to 0.4 mm only: none of the later ones begins at contact, and none is offered."""
    path, _ = cycled(tmp_path / "cyc.csv", bottom=0.4)
    with pytest.raises(ValueError, match=r"turns back more than once within 2\.\d+ mm. Add"):
        read_measurement(path)
    with pytest.raises(ValueError, match="has no block 2; it holds 1"):
        read_measurement(f"{path}#2")
