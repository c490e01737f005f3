"""A laboratory's folder as a study: names of files, noise and support are understood or refused, never guessed."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import numpy as np
import pytest

from rso.cli import main
from rso.data import Measurement, Repeat, recorded_speed
from rso.study.laboratory_folder import file_line, files_of, study_of_folder, unread
from rso.study.laboratory_nominal import read_nominal
from rso.study.loader import load_study

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
    return study_of_folder(lab, 0, lab)


def test_order_of_testing(tmp_path):
    names = ["mp_load", "mp_cycle_10", "mp_cycle_100", "mp_deep", "point_20_0"]
    made = text(folder(tmp_path, [f"{n}.csv" for n in reversed(names)]))
    assert re.findall(r'name = "(.*?)"', made) == names
    named_alone = tmp_path / "alone"
    named_alone.mkdir()
    made = text(folder(named_alone, ("mp_deep.csv", "mp_cycle.csv", "mp_load.csv"), rate_mm_per_min=30))
    assert re.findall(r'name = "(.*?)"', made) == ["mp_load", "mp_cycle", "mp_deep"]


def test_numbers_before_names_are_the_order_of_testing(tmp_path):
    names = ["01_mp_load", "02_site_20_0", "10_mp_cycle_30", "11_mp_load"]
    made = text(folder(tmp_path, [f"{n}.csv" for n in reversed(names)]))
    assert re.findall(r'name = "(.*?)"', made) == names and made.count("point = [20.0, 0.0]") == 1
    assert 'speed = "30 mm/min"' in made and 'after = ["01_mp_load", "02_site_20_0"]' in made
    some = tmp_path / "some"
    some.mkdir()
    made = text(folder(some, ("2_mp_load.csv", "mp_deep.csv", "mp_cycle_30.csv")))
    assert re.findall(r'name = "(.*?)"', made) == ["2_mp_load", "mp_cycle_30", "mp_deep"]


def test_files_that_are_not_read_are_named(tmp_path):
    lab = folder(tmp_path)
    (lab / "mp_deep.txt").write_text("depth_mm,Fz_N\n0,0\n1,0.1\n")
    assert unread(lab) == ["mp_deep.txt is not read: only .csv and .xlsx files are"]


def test_a_length_over_which_readings_remember_can_be_stated(tmp_path):
    made = text(folder(tmp_path, noise={"force_N": 0.003, "correlation_mm": 0.2}))
    assert "noise = { Fz = 0.003, correlation = 0.2 }" in made


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


@pytest.mark.parametrize("name", ["point 20 0", "pt_20_0", "P_20_0", "site_20_0", "point20_0", "Position_20_0"])
def test_other_ways_to_write_a_place(tmp_path, name):
    assert "point = [20.0, 0.0]" in text(folder(tmp_path, (f"{name}.csv",)))


@pytest.mark.parametrize("name", ["mp_load_2", "mp_hold_60_s_2", "mp_cycle_30_2", "load2", "relaxation_300s", "mp"])
def test_what_means_the_top(tmp_path, name):
    made = text(folder(tmp_path, (f"{name}.csv",)))
    assert "point = [0.0, 0.0]" in made and ("30 mm/min" in made) == ("cycle" in name)


UNCLEAR = ["point_20_0_rep2", "point_20,5_0", "20_0", "point-20-0", "profile_20_0", "point_left", "2026_11_23"]


@pytest.mark.parametrize("name", UNCLEAR)
def test_a_place_that_is_not_understood_is_not_taken_for_the_top(tmp_path, name):
    with pytest.raises(ValueError, match="does not say where it was pressed") as caught:
        text(folder(tmp_path, (f"{name}.csv",)))
    for word in (name, "point_X_Y", "mp_cycle_V", "less than two numbers"):
        assert word in str(caught.value)


def test_a_rate_in_a_name_or_stated_is_that_of_files_without_times(tmp_path):
    made = text(folder(tmp_path, ("mp_load.csv", "mp_cycle_100.csv"), rate_mm_per_min=30))
    assert 'settings = { point = [0.0, 0.0], speed = "100 mm/min", unload = true }' in made
    assert 'settings = { point = [0.0, 0.0], speed = "30 mm/min" }' in made


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"noise": {"force_mN": 3}}, ["noise.force_mN", "force_N"]),
        ({"noise": {"force_N": None}}, ["noise.force_N = None", "a number"]),
        ({"noise": {"force_N": "3 mN"}}, ["noise.force_N = '3 mN'", "a number"]),
        ({"noise": {"force_N": 10**400}}, ["noise.force_N = 1000", "a number"]),
        ({"specimen": {"semi_axes_mm": [10**400, 35, 35]}}, ["specimen.semi_axes_mm", "3 number(s)"]),
        ({"noise": {"force_N": -2.0}}, ["noise.force_N = -2.0", "at least 0"]),
        ({"support": "lying loose on a plate"}, ["support", "bonded", "bowl"]),
        ({"support": "lies loose on a fixed platform"}, ["support", "'loose'", "bonded", "bowl"]),
        ({"support": "unglued on a fixed table"}, ["support", "'unglued'"]),
        ({"support": "fixed in a bowl"}, ["support", "fixed", "bowl"]),
        ({"support": {"kind": "fixed", "clearance_mm": 1}}, ["support.clearance_mm", "bowl"]),
        ({"specimen": {"semi_axes_mm": [60, 35, 35], "shape": "cylinder"}}, ["specimen.shape = 'cylinder'", "ellips"]),
        ({"specimen": {"semi_axes_mm": [-60, 35, 35]}}, ["specimen.semi_axes_mm", "positive"]),
        ({"specimen": {"axes_mm": [120, 70, 70]}}, ["specimen.axes_mm is unknown", "semi_axes_mm"]),
        ({"indenter": {"radius_mm": 3, "shape": "cone"}}, ["indenter.shape = 'cone'", "sphere"]),
        ({"indenter": {"radius_mm": 3, "friction": 0.3}}, ["indenter.friction = 0.3", "0"]),
        ({"units": "N, m, Pa, s"}, ["units = 'N, m, Pa, s'", "N, mm, MPa, s"]),
        ({"rate_mm_per_min": "fast"}, ["rate_mm_per_min = 'fast'", "a number"]),
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
        ("Glued, and clamped at one end", 'kind = "fixed"'),
        ("glued, no bowl", 'kind = "fixed"'),
        ("bonded; the ball was not lubricated", 'kind = "fixed"'),
        ("not bonded, lies in a bowl", 'kind = "bowl"'),
        ("lower half bonded", 'kind = "fixed"'),
        ("fixed: lower half surface (z<0) bonded to the holder", 'kind = "fixed"'),
        ("lies in a bowl", "clearance = 1.0"),
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


GENERATED = {  # all that the folders of an earlier generator say
    "family": "A",
    "support": "fixed: lower half surface (z<0) bonded to the holder",
    "units": "N, mm, MPa, s",
    "specimen": {"shape": "ellipsoid", "semi_axes_mm": [60, 35, 35]},
    "indenter": {
        "shape": "sphere",
        "radius_mm": 3.0,
        "rigid": True,
        "full_sphere": True,
        "direction": [0, 0, -1],
        "friction": 0.0,
    },
    "frame": "x along the major axis, z up, origin at the specimen centre; MP = (0,0,35)",
    "depth": "indenter travel since first contact",
    "force": "Fz>0 pushes it up",
    "rate_mm_per_min": 30,
    "cycle_rates_mm_per_min": [10, 30, 100],
    "rest_between_tests": "long",
    "order_of_tests": "mp_load, points",
    "points_mm": [[2.5, 2.5], [20, 0]],
    "profile": "marks at y=5 mm",
    "noise": {"force_N": 0.003, "depth_mm": 0.005, "repeat_gain": 0.01, "profile_mm": 0.05},
}


def test_all_that_the_generator_of_blind_cases_says_is_accepted(tmp_path):
    made = text(folder(tmp_path, **GENERATED))
    assert "semi_axes = [60.0, 35.0, 35.0]" in made and "gain = 0.01" in made
    generator = (Path(__file__).parents[2] / "benchmarks" / "blind" / "generate.py").read_text()
    names = [n for n in ast.parse(generator).body if isinstance(n, ast.Assign) and n.targets[0].id == "NOMINAL"]
    nominal = {**ast.literal_eval(names[0].value), "noise": GENERATED["noise"]}  # each case has a noise of its own
    folder(tmp_path, **nominal)
    assert text(tmp_path) == made


def test_what_is_not_used_is_said_and_stops_nothing(tmp_path):
    """Who writes down more than is asked for gets an answer; what is nearly a key that is missing is one misspelled."""
    lab = folder(
        tmp_path,
        weight_N=3.0,
        operator="me",
        noise={"force_N": 0.003, "temperature_K": 0.1},
        indenter={"radius_mm": 3.0, "material": "steel"},
    )
    said = " ".join(read_nominal(lab).assumed)
    for key in ("weight_N", "operator", "noise.temperature_K", "indenter.material"):
        assert f"{key} is not used" in said
    misspelled = {"suport" if k == "support" else k: v for k, v in NOMINAL.items()}
    (lab / "nominal.json").write_text(json.dumps(misspelled))
    with pytest.raises(ValueError, match="suport is unknown"):
        read_nominal(lab)


def test_brackets_without_end_are_no_nominal(tmp_path):
    (tmp_path / "nominal.json").write_text(100_000 * "[")
    with pytest.raises(ValueError, match=r"nominal.json: cannot be read"):
        read_nominal(tmp_path)


def test_what_is_assumed_is_said(tmp_path):
    assert read_nominal(folder(tmp_path)).assumed == ()
    (tmp_path / "nominal.json").write_text(json.dumps({k: NOMINAL[k] for k in ("specimen", "indenter")}))
    support, noise = read_nominal(tmp_path).assumed
    assert "no support" in support and "fixed" in support and "no noise" in noise


def test_what_each_file_was_taken_for_is_said(tmp_path):
    """Place, role, speed and cycle, one line a file, and the same as data."""
    lab = folder(tmp_path, ("mp_load.csv", "mp_cycle_100.csv", "point_2.5_-3.csv"))
    rows = "".join(f"{k / 8},{k / 10},{k / 9}\n" for k in range(20))
    (lab / "mp_load.csv").write_text("time_s,depth_mm,Fz_N\n" + rows)
    (lab / "profile.csv").write_text("depth_mm,x_mm,y_mm,uz_mm\n1,0,5,-0.2\n1,4,5,-0.1\n")
    (lab / "study.toml").write_text(text(lab))
    found = files_of(load_study(lab / "study.toml"))
    assert [(f["file"], f["kind"], f["place_mm"], f["role"], f["cycle"]) for f in found] == [
        ("mp_load.csv", "force", [0.0, 0.0], "fit", False),
        ("mp_cycle_100.csv", "force", [0.0, 0.0], "fit", True),
        ("point_2.5_-3.csv", "force", [2.5, -3.0], "fit", False),
        ("profile.csv", "profile", [0.0, 0.0], "fit", False),
    ]
    assert [f["speed_from"] for f in found] == ["times", "stated", "assumed", None]
    np.testing.assert_allclose([f["speed_mm_per_min"] for f in found[:3]], [48, 100, 30])
    first, second, third, last = map(file_line, found)
    assert first == "mp_load.csv: force curve at (0, 0) mm, role fit, 48 mm/min by its times, 1 repeat(s)"
    assert "a cycle at (0, 0) mm" in second and "100 mm/min as stated" in second
    assert "(2.5, -3) mm" in third and "30 mm/min assumed" in third
    assert last == "profile.csv: surface marks while pressed at (0, 0) mm, role fit, 1 repeat(s)"
    # clocks of two records of one test differ in the third digit, what is stated does not
    assert " 100 mm/min by its times" in file_line(found[0] | {"speed_mm_per_min": 99.6})
    assert "99.6 mm/min as stated" in file_line(found[1] | {"speed_mm_per_min": 99.6})


MACHINE = {"depth": {"header": 'Weg "roh" Ä', "unit": "0.01 mm", "flip": True, "zero": 35}}
MACHINE |= {"Fz": {"header": "Kraft [mN]"}}


def machine(lab: Path, name: str) -> None:
    rows = "".join(f"{35 - 10 * k};{k * k}\n" for k in range(9))
    (lab / name).write_text('"Weg ""roh"" Ä";Kraft [mN]\n' + rows, encoding="utf-8")


def test_columns_of_a_machine_are_named_in_nominal_json(tmp_path):
    lab = folder(tmp_path, ("point_20_0.csv",), columns=MACHINE, columns_of={"point_20_0.csv": {}, "profile.csv": {}})
    machine(lab, "mp_load.csv")
    (lab / "profile.csv").write_text("depth_mm,x_mm,y_mm,uz_mm\n0.8,0,5,-0.2\n0.8,4,5,-0.1\n")
    (lab / "study.toml").write_text(text(lab), encoding="utf-8")
    study = load_study(lab / "study.toml")
    (r,) = study.measurement("mp_load").repeats
    np.testing.assert_allclose(r.depth, 0.1 * np.arange(9), atol=1e-12)
    np.testing.assert_allclose(r.channels["Fz"], 1e-3 * np.arange(9.0) ** 2, atol=1e-12)
    assert study.measurement("point_20_0").repeats[0].depth.tolist() == [0.0, 1.0]


def test_codes_of_segments_are_explained_in_nominal_json(tmp_path):
    codes = {"segment": {"header": "Phase", "values": {"0": "skip", "1": "loading", "ü 2": "unloading"}}}
    lab = folder(tmp_path, (), columns={"depth": {"header": "Weg [mm]"}, "Fz": {"header": "Fz [N]"}} | codes)
    rows = "0;-1;0\n" + "".join(f"1;{k / 4};{k * k}\n" for k in range(9)) + "ü 2;1;9\nü 2;0;0\n"
    (lab / "mp_load.csv").write_text("Phase;Weg [mm];Fz [N]\n" + rows, encoding="utf-8")
    (lab / "study.toml").write_text(text(lab), encoding="utf-8")
    (r,) = load_study(lab / "study.toml").measurement("mp_load").repeats
    assert r.segment.tolist() == ["loading"] * 9 + ["unloading"] * 2 and r.depth[0] == 0.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"columns": {"depth": {"header": "Weg", "values": {"1": "loading"}}}}, "columns.depth: values says what"),
        ({"columns": {"segment": {"header": "P", "values": {"1": "load"}}}}, "columns.segment.values.1 = 'load'"),
        ({"columns": {"segment": {"header": "P", "values": {"1": "hold"}}}}, 'values names no code that is "loading"'),
        ({"columns": {"depht": {"header": "Weg"}}}, "columns.depht: unknown key; did you mean 'depth'"),
        ({"columns": {"depth": {"header": "Weg", "unit": "N"}}}, "columns.depth: unit = 'N'"),
        ({"columns": {"depth": {"unit": "N"}}}, "columns.depth.header: is missing"),
        ({"columns": []}, "columns = []: expected a table"),
        ({"columns_of": {"a.csv": {"depth": {"header": "Weg", "zero": "1"}}}}, "columns_of.a.csv.depth.zero = '1'"),
        (
            {"columns_of": {"mp_laod.csv": {}}},
            "columns_of.mp_laod.csv: there is no such file; did you mean 'mp_load.csv'",
        ),
        ({"columns_of": 3}, "columns_of = 3: a table is expected"),
    ],
)
def test_columns_that_are_wrong_are_refused_at_their_key(tmp_path, changes, words):
    with pytest.raises(ValueError, match=r"nominal\.json: ") as caught:
        text(folder(tmp_path, **changes))
    assert words in str(caught.value)


def test_a_blind_folder_is_told_where_columns_are_named(tmp_path, capsys):
    lab = folder(tmp_path)
    machine(lab, "mp_load.csv")
    assert main(["blind", str(lab), "--out", str(tmp_path / "answers")]) == 2
    said = capsys.readouterr().out
    assert "mp_load.csv:1: unknown column" in said and 'nominal.json: says as "columns" what a study says' in said
