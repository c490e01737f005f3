"""Sensitivities in detail, extrapolated candidates and widened ranges: on the page where they are known, else not."""

import re

import numpy as np
import pytest
from report_fixture import complete

from rso.report.calibration.figures import draw
from rso.report.calibration.influence import extrapolation
from rso.report.calibration.numbers import report
from rso.report.layout.document import Picture, Table, Text


def section(results, name):
    return next(s for s in report(results).sections if s.id == name)


def pictures(results):
    return {b.name: b.caption for b in section(results, "sensitivity").blocks if isinstance(b, Picture)}


def tables(results, name):
    return {b.title: b for b in section(results, name).blocks if isinstance(b, Table)}


def test_each_picture_is_there_if_and_only_if_it_was_asked_for():
    assert list(pictures(complete())) == ["sensitivity", "along-0", "shapes", "morris"]
    for key, name in (("along", "along-0"), ("curves", "shapes"), ("morris", "morris")):
        without = complete()
        without["sensitivity"][key] = []
        assert list(pictures(without)) == [n for n in pictures(complete()) if n != name]
    one = complete()
    one["sensitivity"]["along"] = [a for a in one["sensitivity"]["along"] if a["depth_mm"] == 2.0]
    assert "along-0" not in pictures(one)  # one depth is no curve


def test_captions_say_what_was_found():
    said = {k: v.replace("\xa0", " ") for k, v in pictures(complete()).items()}
    assert "μ takes part in 97 % of the variance at 1 mm and 100 % at 3.9 mm" in said["along-0"]
    assert "the percentage by which Fz changes for 1 % of θ" in said["along-0"]
    assert re.search(r"in order of mean size, μ > D₁\.", said["morris"])
    swapped = complete()
    for m in swapped["sensitivity"]["morris"]:
        m["mu_star"] = 1.0 / m["mu_star"]
    assert "in order of mean size, D₁ > μ." in pictures(swapped)["morris"]


def test_the_change_over_a_range_is_that_of_the_output_that_moves_most():
    results = complete()
    curves = [c for c in results["sensitivity"]["curves"] if c["parameter"] == "mu"]
    y = np.array([c["y"] for c in curves])
    share = y / y[:, [4]] - 1
    low, high = share[np.ptp(share, axis=1).argmax()][[0, -1]]
    assert f"μ −{-100 * low:.0f} % to +{100 * high:.0f} %" in pictures(results)["shapes"].replace("\xa0", " ")


def test_screening_is_in_a_table_with_the_units_of_the_outputs():
    (table,) = (t for title, t in tables(complete(), "sensitivity").items() if "Morris" in title)
    assert [c.title for c in table.columns] == ["Output", "θ", "μ", "μ*", "σ", "σ / μ*"]
    assert {row[-1].text for row in table.rows} == {"0.30"}
    assert len(table.rows) == len(complete()["sensitivity"]["morris"])


@pytest.mark.parametrize("name", ["along-0", "shapes", "morris"])
def test_figures_are_drawn_from_the_numbers(name):
    key = {"along-0": "along", "shapes": "curves", "morris": "morris"}[name]
    changed = complete()
    row = changed["sensitivity"][key][0]
    for k in ("total", "sigma"):
        if k in row:
            row[k] *= 0.5
    if key == "curves":
        row["y"][0] *= 0.5
    assert draw(complete(), name) == draw(complete(), name) != draw(changed, name)


def test_an_output_that_is_zero_in_the_middle_is_no_trouble():
    results = complete()
    for c in results["sensitivity"]["curves"]:
        c["y"] = [0.0] * len(c["y"])
    assert draw(results, "shapes").startswith("<svg")


def test_extrapolated_candidates_are_named_under_their_search():
    notes = {title: t.note for title, t in tables(complete(), "candidates").items()}
    (note,) = (n for title, n in notes.items() if title.startswith("Search 3P"))
    assert (
        "Candidate 1 lies outside the convex hull of the training runs" in note and "only the rerun is reliable" in note
    )
    assert sum("convex hull" in n for n in notes.values()) == 1
    assert extrapolation([], 3) == ""
    assert extrapolation(["a", "b"], 3).startswith("Candidates a, b lie outside") and "extrapolations" in (
        extrapolation(["a", "b"], 3)
    )
    assert extrapolation(["a", "b"], 2).startswith("All candidates lie outside")


def test_widened_ranges_are_told_with_their_reasons():
    (table,) = (t for title, t in tables(complete(), "candidates").items() if title.startswith("Ranges of the main"))
    row = [c.text.replace("\xa0", " ") for c in table.rows[0]]
    assert row[:4] == ["1", "widened", "D₁", "high"]
    assert row[4:7] == ["16.80 MPa⁻¹", "168.0 MPa⁻¹", "4"] and row[7].startswith("a valley of values")
    assert table.note == "In the end every candidate lies inside the ranges and the targets are met."
    stopped = complete()
    stopped["searches"][0]["audit"] = [dict(stopped["searches"][0]["audit"][-1], what="stopped", why="no way out")]
    blocks = section(stopped, "candidates").blocks
    assert any(isinstance(b, Text) and b.text == "Ranges of the main search: no way out." for b in blocks)
    kept = complete()
    kept["searches"][0]["audit"] = [dict(kept["searches"][0]["audit"][-1], what="kept")]
    assert "Ranges of the main" not in str(section(kept, "candidates"))
    old = complete()  # results of an earlier version have no audit
    for s in old["searches"]:
        del s["audit"]
    assert "Ranges of the main" not in str(section(old, "candidates"))
