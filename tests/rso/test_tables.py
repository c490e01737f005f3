"""Files of several tables, of words among numbers and of footers: read as they are meant, or refused with the place."""

from pathlib import Path

import numpy as np
import pytest

from rso.data import Column, Measurement, read_measurement
from rso.data.files import header_aliases, tables

U = np.round(np.linspace(0.0, 4.0, 41), 6)
COLUMNS = {"depth": Column("Weg", "mm"), "Fz": Column("Kraft", "N")}


def rows(scale: float = 1.0, separator: str = ";") -> list[str]:
    return [f"{u}{separator}{scale * 0.04 * u**1.5:.5f}" for u in U]


def write(tmp_path: Path, lines: list[str], name: str = "data.csv") -> Path:
    path = tmp_path / name
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def refusal(path, columns=None) -> str:
    with pytest.raises(ValueError) as caught:
        read_measurement(path, columns)
    return str(caught.value)


def as_three_repeats(m: Measurement, words: str) -> None:
    assert [(r.label, len(r.depth)) for r in m.repeats] == [("1", 41), ("2", 41), ("3", 41)]
    for r, scale in zip(m.repeats, (1.0, 1.1, 1.2), strict=True):
        np.testing.assert_array_equal(r.depth, U)
        np.testing.assert_allclose(r.channels["Fz"], scale * 0.04 * U**1.5, atol=1e-5)
    (doubt,) = m.doubts
    assert words in doubt and "read as repeats of one test" in doubt


THRICE = (1.0, 1.1, 1.2)
BENEATH = {  # lines above each table
    "headers": ["depth_mm;Fz_N"],
    "headers and units": ["depth;Fz", "mm;N"],
    "an empty line": ["", "depth_mm;Fz_N"],
    "a title": ["", "Test 2", "depth_mm;Fz_N"],
    "what a machine writes above": ['"Prüfer";"Müller"', "Vorkraft;0,01;N", "Nr;2;", "", "depth_mm;Fz_N"],
    "a title in as many cells": ["Test;", "depth_mm;Fz_N"],
}


@pytest.mark.parametrize("how", BENEATH)
def test_tables_with_the_same_header_beneath_one_another_are_repeats(tmp_path, how):
    m = read_measurement(write(tmp_path, [line for s in THRICE for line in (*BENEATH[how], *rows(s))]))
    at = [k * (len(BENEATH[how]) + 41) + len(BENEATH[how]) - ("units" in how) for k in range(3)]
    as_three_repeats(m, f"data.csv: 3 tables stand beneath one another (from the lines {at[0]}, {at[1]}, {at[2]})")
    said = {"a title": {"Test 2"}, "a title in as many cells": {"Test"}}
    said["what a machine writes above"] = {"Prüfer Müller", "Vorkraft 0,01 N", "Nr 2"}
    assert set(m.notes) == said.get(how, set())


@pytest.mark.parametrize("between", [[""], ["", ""], ["# second"], [";"]])
def test_blocks_that_all_begin_at_the_start_are_repeats(tmp_path, between):
    lines = ["depth_mm;Fz_N", *rows(1.0), *between, *rows(1.1), *between, *rows(1.2)]
    m = read_measurement(write(tmp_path, lines))
    as_three_repeats(m, f"3 blocks are parted by empty lines or comments (from the lines 2, {43 + len(between)}, ")


def test_cycles_in_blocks_are_repeats_and_their_clock_may_go_on(tmp_path):
    way = np.r_[U, U[-2::-1]]
    lines = ["time_s;depth_mm;Fz_N"]
    for k in range(2):
        lines += ["", *(f"{81 * k + i};{u};{0.04 * u**1.5:.5f}" for i, u in enumerate(way))]
    m = read_measurement(write(tmp_path, lines))
    assert [np.sum(r.segment == "unloading") for r in m.repeats] == [40, 40]


ONE = {  # what parts a single test
    "the way back": [*rows(), "", *rows()[-2::-1]],
    "pages": [*rows()[:20], "", *rows()[20:]],
    "a line between all": [line for row in rows() for line in (row, "")],
    "a comment on the way": [*rows()[:20], "# dwell", *rows()[20:]],
    "a touch before": [*rows()[:4], "", *rows()],
}


@pytest.mark.parametrize("what", ONE)
def test_empty_lines_within_a_test_part_nothing(tmp_path, what):
    m = read_measurement(write(tmp_path, ["depth_mm;Fz_N", *ONE[what]]))
    assert [r.label for r in m.repeats] == ["1"] and not [d for d in m.doubts if "read as repeats" in d]


def test_a_column_of_repeats_counts_through_tables_beneath_one_another(tmp_path):
    lines = [line for k in (1, 2) for line in ("depth_mm;Fz_N;repeat", *(f"{row};{k}" for row in rows()))]
    assert [(r.label, len(r.depth)) for r in read_measurement(write(tmp_path, lines)).repeats] == [("1", 41), ("2", 41)]
    twice = [line for _ in "12" for line in ("depth_mm;Fz_N;repeat", *(f"{row};1" for row in rows()))]
    path = write(tmp_path, twice)
    assert f"{path}:43: a table begins again, with the repeat '1' of the one above" in refusal(path)


def test_a_reading_that_is_none_is_no_note_before_the_next_table(tmp_path):
    """What a sensor beyond its range writes in the last row of a table."""
    path = write(tmp_path, ["depth_mm;Fz_N", *rows(), "4.1;OVLD", "depth_mm;Fz_N", *rows()])
    assert f"{path}:43: column 'Fz': 'OVLD' is not a finite number" in refusal(path)
    lines = ["Weg;Kraft;Nr", *(f"{row};1" for row in rows()), "4.1;0.3", "Weg;Kraft;Nr", "0;0;1"]
    assert ":43: 2 values in a table of 3 columns" in refusal(write(tmp_path, lines), COLUMNS)


def test_tables_of_several_files_are_repeats_named_by_file_and_place(tmp_path):
    lines = ["depth_mm;Fz_N", *rows(), "depth_mm;Fz_N", *rows(1.1)]
    files = [write(tmp_path, lines, "a.csv"), write(tmp_path, ["depth_mm;Fz_N", *rows(1.2)], "b.csv")]
    assert [r.label for r in read_measurement(files).repeats] == ["a 1", "a 2", "b"]


WORDS = {  # a word in every row, columns
    "behind": ("{u} {F} LOAD", "Weg Kraft Phase"),
    "before": ("LOAD {u} {F}", "Phase Weg Kraft"),
    "between, aligned": ("  {u}    LOAD     {F}", "  Weg    Phase    Kraft"),
    "date and time": ("2024-02-01 10:00:03 {u} {F}", "Date Time Weg Kraft"),
    "quoted": ('{u} {F} "LOAD fast"', 'Weg Kraft "Phase of test"'),
}


@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("how", WORDS)
def test_columns_parted_by_blanks_may_hold_words(tmp_path, how, comma):
    row, head = WORDS[how]
    lines = [row.format(u=u, F=f"{0.04 * u**1.5:.5f}") for u in U]
    lines = [line.replace(".", ",") for line in lines] if comma else lines
    m = read_measurement(write(tmp_path, ["Probe 3", head, *lines]), COLUMNS)
    (r,) = m.repeats
    np.testing.assert_array_equal(r.depth, U)
    np.testing.assert_allclose(r.channels["Fz"], 0.04 * U**1.5, atol=1e-5)
    assert m.notes == ("Probe 3",) and not {"Weg", "Kraft"} & set(m.unread)


def test_a_word_in_a_column_of_segments_parted_by_blanks_is_read(tmp_path):
    lines = [f"{u} {0.04 * u**1.5:.5f} {'loading' if k < 41 else 'unloading'}" for k, u in enumerate([*U, *U[::-1]])]
    (r,) = read_measurement(write(tmp_path, ["depth_mm Fz_N segment", *lines])).repeats
    assert np.sum(r.segment == "loading") == 41 and np.sum(r.segment == "unloading") == 41


FOOTERS = {  # lines beneath a table of two columns, separators between which they are no notes, place and words
    "a sentence": (["End of test."], (), "", []),
    "a summary": (["", "Max 4.0 0.32"], (), "", []),
    "a summary right beneath": (["Max 4.0"], (), "", []),
    "a name and a number": (["Fmax 0.32"], (), "", []),
    "words": (["Test finished"], (), "", []),
    "one word": (["END"], (), "", []),
    "several lines": (["END", "", "Operator NN", "Date 2024-02-01"], (), "", []),
    "a word in the force": (["4.1 OVLD"], " \t", ":43:", ["OVLD"]),
    "a reading after words": (["END", "4.1 0.33"], " \t", ":43:", ["END"]),
}


@pytest.mark.parametrize("separator", [" ", "   ", "\t"])
@pytest.mark.parametrize("what", FOOTERS)
def test_words_beneath_the_last_reading_are_notes_or_refused_with_their_line(tmp_path, what, separator):
    """A footer begins with words where readings begin with numbers."""
    footer, refused, place, words = FOOTERS[what]
    path = write(tmp_path, ["depth_mm Fz_N".replace(" ", separator), *rows(separator=separator), *footer])
    if separator.strip(" ") in refused or (separator.strip() == "" and separator != "\t" and " " in refused):
        said = refusal(path)
        assert f"{path}{place}" in said
        for word in words:
            assert word in said
    else:
        m = read_measurement(path)
        assert m.notes == tuple(filter(None, footer)) and m.repeats[0].depth.tolist() == U.tolist()


@pytest.mark.parametrize(
    "lines",
    [
        ["Weg, Kraft, Phase", *(f"{u}, {0.1 * u}, LOAD" for u in U)],
        ["Weg,Kraft,Phase", *(f"{u},{0.1 * u},LOAD fast" for u in U)],
        ["Weg;Kraft;Phase", *(f"{u}; {0.1 * u}; LOAD" for u in U)],
        ["Weg\tKraft\tPhase", *(f"{u}\t{0.1 * u}\tLOAD 1" for u in U)],
        ["Zeit,Weg,Kraft", *(f"2024-02-01 10:00:00,{u},{0.1 * u}" for u in U)],
    ],
)
def test_words_between_separators_part_nothing_at_blanks(tmp_path, lines):
    assert read_measurement(write(tmp_path, lines), COLUMNS).repeats[0].depth.tolist() == U.tolist()


def test_pages_with_the_same_header_are_one_test(tmp_path):
    """As printed, there and back; also where a column counts the repeats."""
    way = np.r_[U, U[-2::-1]]
    for repeat in ("", ";7"):
        head = "depth_mm;Fz_N" + (";repeat" if repeat else "")
        lines = [f"{u};{0.04 * u**1.5:.5f}{repeat}" for u in way]
        m = read_measurement(write(tmp_path, [head, *lines[:15], head, *lines[15:60], "", head, *lines[60:]]))
        (r,) = m.repeats
        assert r.depth.tolist() == way.tolist() and np.sum(r.segment == "unloading") == 40
        said = "3 tables stand beneath one another (from the lines 1, 17, 64) and are read as one test"
        assert [said in doubt for doubt in m.doubts] == ([] if repeat else [True])


def test_a_way_back_in_a_table_of_its_own_is_told_by_its_segment(tmp_path):
    lines = ["depth_mm;Fz_N;segment"]
    for segment in ("loading", "unloading"):
        lines += [*lines[:1] * (segment == "unloading"), *(f"{row};{segment}" for row in rows())]
    (r,) = read_measurement(write(tmp_path, lines)).repeats
    assert np.sum(r.segment == "loading") == np.sum(r.segment == "unloading") == 41


@pytest.mark.parametrize("loads, said", [(1, False), (2, True), (3, True)])
def test_branches_in_blocks_that_load_anew_are_remarked_upon(tmp_path, loads, said):
    lines = ["depth_mm;Fz_N;segment"]
    for k in range(loads):
        lines += ["", *(f"{row};loading" for row in rows(1.0 + 0.1 * k))]
        lines += ["", *(f"{row};unloading" for row in rows(0.9)[::-1])]
    m = read_measurement(write(tmp_path, lines))
    words = f"{loads} blocks start again (from the lines 3, 87"
    assert [r.label for r in m.repeats] == ["1"] and any(words in d for d in m.doubts) is said


def test_a_header_that_stands_twice_or_at_the_end_begins_one_table(tmp_path):
    for lines in (["depth_mm;Fz_N"] * 2 + rows(), ["depth_mm;Fz_N", *rows(), "depth_mm;Fz_N"]):
        m = read_measurement(write(tmp_path, lines))
        assert [(r.label, len(r.depth)) for r in m.repeats] == [("1", 41)] and m.doubts == ()


@pytest.mark.parametrize("depths, repeats", [((1.0, 2.0), 1), ((1.0, 1.0), 2)])
def test_tables_of_a_profile_are_its_depths_or_its_repeats(tmp_path, depths, repeats):
    lines = [line for d in depths for line in ("depth_mm,x_mm,y_mm,uz_mm", *(f"{d},{x},5,-0.1" for x in range(5)))]
    m = read_measurement(write(tmp_path, lines))
    assert [len(r.depth) for r in m.repeats] == [10 // repeats] * repeats


class Counted(np.ndarray):
    """An array that counts how many of its values are compared."""

    compared = 0

    def __eq__(self, other):
        Counted.compared += self.size
        return np.asarray(self) == other


def counted(values) -> Counted:
    Counted.compared = 0
    return np.asarray(values).view(Counted)


@pytest.mark.parametrize("n", [50, 500])
def test_repeats_and_blocks_are_parted_by_looking_at_each_row_once(n):
    """A mask for each of n labels looks at n times all rows."""
    u = np.tile(np.linspace(0.0, 1.0, 8), n)
    labels = counted(np.repeat(np.arange(n).astype(str), 8))
    assert header_aliases.reversed_columns({"depth": -u, "Fz": u**1.5}, labels, ("depth", "Fz")) == ["depth"]
    assert Counted.compared <= 4 * len(u)
    line = counted(np.arange(8 * n) + np.repeat(np.arange(n), 8))
    rows = [(int(k), "") for k in np.asarray(line)]
    found, told = tables.labels_of(Path("a.csv"), [(0, rows)], line, {"depth": u, "Fz": u**1.5}, [], None)
    assert len(set(found.tolist())) == n and f"{n} blocks" in told[0] and Counted.compared <= 4 * len(u)
