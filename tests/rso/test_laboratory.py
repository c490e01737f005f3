"""A laboratory's folder as a study: names of files, noise and support are understood or refused, never guessed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rso.measurement import Measurement, Repeat, recorded_speed
from rso.study.laboratory import study_text

NOMINAL = {
    "specimen": {"semi_axes_mm": [60, 35, 35]},
    "indenter": {"radius_mm": 3.0},
    "support": "fixed: lower half bonded",
    "noise": {"force_N": 0.003},
}


def folder(tmp_path: Path, names=("mp_load.csv",), **changes) -> Path:
    (tmp_path / "nominal.json").write_text(json.dumps({**NOMINAL, **changes}), encoding="utf-8-sig")
    for name in names:
        (tmp_path / name).write_text("depth_mm,Fz_N\n0,0\n1,0.1\n")
    return tmp_path


def text(lab: Path) -> str:
    return study_text(lab, 0, lab)


def test_places_come_from_names_whatever_their_case(tmp_path):
    made = text(folder(tmp_path, ("mp_load.csv", "point_20_0.CSV", "Point_-2.5_3.csv")))
    assert text(folder(tmp_path, ("ptfe_ball.csv", "midpoint_load.csv"))).count("point = [0.0, 0.0]") == 3
    for words in ("point = [20.0, 0.0]", "point = [-2.5, 3.0]", "point = [0.0, 0.0]", '"point_20_0.CSV"'):
        assert words in made


def test_lateral_forces_are_seen_below_other_lines_too(tmp_path):
    lab = folder(tmp_path)
    (lab / "mp_load.csv").write_text("# neither Fx nor Fy\ndepth_mm,Fz_N\n0,0\n1,0.1\n")
    assert "channels" not in text(lab)
    (lab / "mp_load.csv").write_text("# Fx, Fy\nOperator,x\ndepth [mm],FZ [N],fx [N],fy [N]\n0,0,0,0\n1,0.1,0,0\n")
    assert 'channels = ["Fz", "Fx", "Fy"]' in text(lab)


def test_lateral_forces_are_columns_and_not_words_above_them(tmp_path):
    lab = folder(tmp_path)
    (lab / "mp_load.csv").write_text("Remark;no Fx, Fy measured\ndepth_mm;Fz_N\n0;0\n1;0,1\n")
    assert "channels" not in text(lab)
    (lab / "mp_load.csv").write_text("depth_mm;Fz_N\n0;0\n1;Fx\n")
    with pytest.raises(ValueError, match=r"mp_load\.csv:3: column 'Fz': 'Fx' is not a finite number"):
        text(lab)


@pytest.mark.parametrize("name", ["point_20_0_rep2.csv", "point 20 0.csv", "pt_20_0.csv", "point_20,5_0.csv"])
def test_a_place_that_is_not_understood_is_not_taken_for_the_top(tmp_path, name):
    with pytest.raises(ValueError, match="does not say where it was pressed"):
        text(folder(tmp_path, (name,)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"noise": {"force_mN": 3}}, ["noise.force_mN", "force_N"]),
        ({"noise": {"force_N": None}}, ["noise.force_N = None", "a number"]),
        ({"noise": {"force_N": "3 mN"}}, ["noise.force_N = '3 mN'", "a number"]),
        ({"support": "lying loose on a plate"}, ["support", "bonded", "bowl"]),
        ({"support": {"kind": "bowl", "clearance_mm": None}}, ["support.clearance_mm = None"]),
        ({"support": {"kind": "bowl", "clearance": 2}}, ["support.clearance is unknown", "clearance_mm"]),
    ],
)
def test_what_is_not_understood_is_refused(tmp_path, changes, words):
    with pytest.raises(ValueError) as caught:
        text(folder(tmp_path, **changes))
    for word in ["nominal.json", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("support", "setting"),
    [
        ("glued, no bowl", 'kind = "fixed"'),
        ("lower half bonded", 'kind = "fixed"'),
        ("in a bowl, not fixed", "clearance = 1.0"),
        ("bowl", "clearance = 1.0, friction = 0.2"),
        ({"kind": "bowl", "clearance_mm": 2, "friction": 0.3}, "clearance = 2.0, friction = 0.3"),
    ],
)
def test_supports(tmp_path, support, setting):
    assert setting in text(folder(tmp_path, support=support))


WAYS = {  # time and depth of one test at 0.5 mm/s
    "a ramp": ([0, 8], [0, 4]),
    "a wait at contact": ([0, 30, 38], [0, 0, 4]),
    "a fast way through air": ([0, 1, 9], [-20, 0, 4]),
    "slow at its end": ([0, 7.2, 20], [0, 3.6, 4]),
    "from two on": ([0, 4], [2, 4]),
    "creeping up to a tenth": ([0, 40, 47.2], [0, 0.4, 4]),
}


@pytest.mark.parametrize("way", WAYS)
def test_the_speed_is_that_of_the_middle_of_the_stroke(way):
    t, u = (np.array(v, float) for v in WAYS[way])
    time = np.linspace(0.0, t[-1], 400)
    depth = np.interp(time, t, u)
    r = Repeat("1", depth, time, {"Fz": depth}, {}, np.full(400, "loading"))
    m = Measurement(Path("x"), "force", (r,), ())
    np.testing.assert_allclose(recorded_speed(m), 0.5, rtol=0.01)  # readings are 0.1 s and less apart
