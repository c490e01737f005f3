"""`rso new`: a study from data files that loads, holds what they tell, and says what they do not."""

import tomllib
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import sample_studies as studies

from fem_backend.backend import BACKEND
from rso.cli import main
from rso.population import plans
from rso.study.errors import StudyError
from rso.study.loader import load_study
from rso.study.new_study import NewTest, study_text
from rso.study.specimens import load_specimens

BODY = ("--semi-axes", "60", "35", "35", "--radius", "3")


def hertz(mu: float = 0.008, gain: float = 1.0) -> str:
    """Hertz's limit by hand, incompressible, E* = 4 mu: F = 16/3 mu √R d^1.5, 1/R = 1/3 + (35/60² + 1/35)/2."""
    R = 1 / (1 / 3 + 0.5 * (35 / 60**2 + 1 / 35))
    rows = [f"{0.1 * k:.1f},{gain * 16 / 3 * mu * R**0.5 * (0.1 * k) ** 1.5:.8g}" for k in range(31)]
    return "\n".join(["depth_mm,Fz_N", *rows]) + "\n"


def new(folder, *arguments: str) -> int:
    return main(["new", *arguments, *BODY, "--out", str(folder / "study.toml")])


def test_the_modulus_of_the_readings_is_the_middle_of_its_range(tmp_path, capsys):
    (tmp_path / "top 1.csv").write_text(hertz())
    (tmp_path / "point_20_-5.csv").write_text(hertz(gain=0.9))
    assert new(tmp_path, str(tmp_path / "top 1.csv"), "--validate", str(tmp_path / "point_20_-5.csv")) == 0
    assert "study.toml: good" in capsys.readouterr().out
    study = load_study(tmp_path)
    mu = study.parameters["mu"]
    low, high = (float(str(v).split()[0]) for v in (mu.low, mu.high))
    assert mu.low.endswith(" kPa")
    assert (low * high) ** 0.5 == pytest.approx(8.0, rel=0.02)  # two digits are written
    assert [e.role for e in study.experiments] == ["fit", "validate"]
    assert [e.settings["point"] for e in study.experiments] == [[0.0, 0.0], [20.0, -5.0]]
    assert study.backend.settings["specimen"]["semi_axes"] == [60.0, 35.0, 35.0]
    assert (tmp_path / "study.toml").read_text().count("no times in the file") == 2


@pytest.mark.usefixtures("no_library")
def test_the_poisson_ratio_stays_positive_in_every_corner(tmp_path):
    (tmp_path / "top.csv").write_text(hertz(mu=0.5))
    assert new(tmp_path, str(tmp_path / "top.csv")) == 0
    p = load_study(tmp_path).parameters
    K, mu = 2 / float(p["D1"].high.split()[0]), 1e-3 * float(p["mu"].high.split()[0])
    assert (3 * K - 2 * mu) / (2 * (3 * K + mu)) == pytest.approx(0.15, abs=0.02)  # digits again


def test_repeats_cycles_lateral_forces_and_a_bowl(tmp_path):
    rows = [*range(11), *range(9, -1, -1)]
    cycle = "depth_mm,Fz_N,Fx_N,Fy_N\n" + "".join(f"{0.3 * k:.1f},{0.01 * k**1.5:.6f},0,0\n" for k in rows)
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for f in files:
        f.write_text(cycle)
    files[1].write_text(cycle.replace("0.010000", "0.010100"))
    assert new(tmp_path, *map(str, files), "--repeats", "--bowl", "1.5", "--point", "3", "0") == 0
    study = load_study(tmp_path)
    (e,) = study.experiments
    assert e.data == ("a.csv", "b.csv")
    assert e.channels == ("Fz", "Fx", "Fy")
    assert e.settings == {"point": [3.0, 0.0], "unload": True}
    assert study.backend.settings["support"] == {"kind": "bowl", "clearance": 1.5, "friction": 0.2}


@pytest.mark.usefixtures("no_library")
def test_columns_that_a_file_does_not_tell_are_given_and_until_then_nothing_is_written(tmp_path, capsys):
    rows = hertz().replace("depth_mm,Fz_N", "weg;kraft").replace(",", ";").replace(";0.", ";-0.")
    (tmp_path / "weg.csv").write_text(rows)
    file = str(tmp_path / "weg.csv")
    assert new(tmp_path, file) == 2
    said = capsys.readouterr()
    assert said.out == "" and not (tmp_path / "study.toml").exists()
    assert "'weg' says no unit" in said.err and "--column depth HEADER mm" in said.err
    assert new(tmp_path, file, "--column", "depth", "weg", "mm", "--column", "Fz", "kraft", "N", "flip") == 0
    study = load_study(tmp_path)
    assert study.columns.Fz.flip and study.columns.depth.unit == "mm"
    mu = study.parameters["mu"]
    assert float(mu.low.split()[0]) < 8 < float(mu.high.split()[0])


@pytest.mark.usefixtures("no_library")
def test_a_zero_may_be_the_contact_that_the_record_shows(tmp_path):
    rows = [f"{0.05 * k:.2f},{0.0 if k < 40 else -0.02 * (0.05 * (k - 40)) ** 1.5:.6f}" for k in range(100)]
    (tmp_path / "air.csv").write_text("\n".join(["depth_mm,Kraft", *rows]))
    columns = ("--column", "depth", "depth_mm", "contact", "--column", "Fz", "Kraft", "N", "contact", "flip")
    assert new(tmp_path, str(tmp_path / "air.csv"), *columns) == 0
    study = load_study(tmp_path)
    assert study.columns.Fz.zero == study.columns.depth.zero == "contact" and study.columns.Fz.flip
    assert study.measurement("air").repeats[0].depth[0] < -1.5


def test_a_height_is_turned_and_its_zero_given_where_the_message_says_so(tmp_path, capsys):
    """Nothing but the header of a gauge says that it falls while the indenter is pressed."""
    rows = [(25.0 - 0.05 * k, 0.02 * (0.05 * k) ** 1.5) for k in range(41)]
    text = "".join(f"{gap:.3f};{force:.6f}\n" for gap, force in rows)
    (tmp_path / "gap.csv").write_text(f"Gap (mm);Fz (N)\n{text}")
    file, turned = str(tmp_path / "gap.csv"), ("--column", "depth", "Gap (mm)", "flip")
    assert new(tmp_path, file, *turned, "--column", "Fz", "Fz (N)") == 2
    assert "--column depth HEADER UNIT [flip] [zero VALUE]" in capsys.readouterr().err
    assert new(tmp_path, file, *turned, "zero", "25mm", "--column", "Fz", "Fz (N)") == 2
    assert "zero 25mm: give a number as the file has it" in capsys.readouterr().err
    assert new(tmp_path, file, *turned, "zero", "25", "--column", "Fz", "Fz (N)") == 0
    study = load_study(tmp_path / "study.toml")
    assert study.columns.depth.zero == 25.0 and study.columns.depth.flip


@pytest.mark.parametrize(
    ("column", "said"), [(["Fq", "kraft"], "no column 'Fq'; did you mean"), (["Fz"], "--column Fz: give NAME HEADER")]
)
def test_a_column_that_is_none_is_named(tmp_path, capsys, column, said):
    (tmp_path / "top.csv").write_text(hertz())
    assert new(tmp_path, str(tmp_path / "top.csv"), "--column", *column) == 2
    assert said in capsys.readouterr().err


@pytest.mark.usefixtures("no_library")
def test_names_are_apart_and_allowed(tmp_path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "Versuch 3 (Öl), #7.csv").write_text(hertz(gain=1.0 if folder == "one" else 1.01))
    files = [str(tmp_path / f / "Versuch 3 (Öl), #7.csv") for f in ("one", "two")]
    assert new(tmp_path, *files) == 0
    names = [e.name for e in load_study(tmp_path).experiments]
    assert len(set(names)) == 2
    assert all(n.startswith("Versuch 3 Öl 7") for n in names)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.csv"], "nowhere.csv: there is no such file"),
        (["top.csv", "top.csv"], "top.csv: is given twice"),
        (["top.csv", "--radius", "40"], "indenter.radius = 40.0 mm"),
        ([".", "--radius", "3"], ".: is a folder"),
        (["top.csv", "--out", "no/study.toml"], "there is no folder no"),
        (["point_10_0.csv", "--point", "0", "10"], "pressed at (10, 0) mm by its name, elsewhere by --point"),
        (["profile.csv"], "displacements are not fitted; give a profile behind --validate"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_written(tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    for name in ("top.csv", "point_10_0.csv"):
        (tmp_path / name).write_text(hertz())
    marks = "".join(f"1,{x},0,-0.1\n" for x in range(5, 15))
    (tmp_path / "profile.csv").write_text("depth_mm,x_mm,y_mm,uz_mm\n" + marks)
    assert main(["new", *arguments, *(() if "--radius" in arguments else BODY[4:]), *BODY[:4]]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "study.toml").exists()


@pytest.mark.usefixtures("no_library")
def test_a_name_that_another_file_has_by_itself_is_left_to_it(tmp_path):
    (tmp_path / "b").mkdir()
    files = ["b/top.csv", "top.csv", "top_2.csv"]
    for k, f in enumerate(files):
        (tmp_path / f).write_text(hertz(gain=1 + 0.01 * k))
    assert new(tmp_path, *(str(tmp_path / f) for f in files)) == 0
    assert {e.name: e.data for e in load_study(tmp_path).experiments} == {
        "top": ("b/top.csv",),
        "top_3": ("top.csv",),
        "top_2": ("top_2.csv",),
    }


def points(folder):
    return [tuple(e.settings["point"]) for e in load_study(folder).experiments]


@pytest.mark.usefixtures("no_library")
def test_the_place_is_that_of_the_file_or_sheet_and_not_of_a_made_up_name(tmp_path):
    for k, f in enumerate(["a/point_20_0.csv", "b/point_20_0.csv", "a/p20.csv", "b/p20.csv"]):
        (tmp_path / f).parent.mkdir(exist_ok=True)
        (tmp_path / f).write_text(hertz(gain=1 + 0.01 * k))
    given = [str(tmp_path / f) for f in ("a/point_20_0.csv", "b/point_20_0.csv", "a/p20.csv", "b/p20.csv")]
    assert new(tmp_path, *given) == 0
    assert points(tmp_path) == [(20, 0), (20, 0), (0, 0), (0, 0)]
    text = (tmp_path / "study.toml").read_text()
    assert text.count("<- by the name of the file") == 2 and text.count("<- the top") == 2


@pytest.mark.usefixtures("no_library")
def test_the_name_of_a_sheet_may_say_the_place(tmp_path):
    book = openpyxl.Workbook()
    for k, name in enumerate(("point_20_0", "point_0_10")):
        sheet = book.active if k == 0 else book.create_sheet()
        sheet.title = name
        for row in hertz(gain=1 + 0.01 * k).splitlines():
            cells = row.split(",")
            sheet.append([float(c) for c in cells] if cells[0][0].isdigit() else cells)
    book.save(tmp_path / "book.xlsx")
    assert new(tmp_path, *(f"{tmp_path / 'book.xlsx'}#{n}" for n in ("point_20_0", "point_0_10"))) == 0
    assert points(tmp_path) == [(20, 0), (0, 10)]


@pytest.mark.parametrize(
    ("files", "more", "said"),
    [
        (["point_20_0.csv", "point_0_20.csv"], ["--repeats"], "were pressed at several points, and are no repeats"),
        (["point_20mm_0mm.csv"], [], "does not say where it was pressed as point_20_0 does; give --point X Y"),
        (["top.csv"], ["--validate", "point_100_0.csv"], "it was not written"),
        (["top.csv", "./top.csv"], [], "is given twice"),
        (["top.csv"], ["--column", "Fz", "Fz_N", "N", "--column", "Fz", "b"], "--column Fz: is given twice"),
        (["top.csv"], ["--column", "Fz", "Fz_N", "kg"], "--column Fz: "),
        (["to\x7fp.csv"], [], "a study file cannot name this"),
        (["t\udcfcp.csv"], [], "a study file cannot name this"),
    ],
)
def test_what_cannot_be_told_or_run_leaves_nothing_behind(tmp_path, monkeypatch, capsys, files, more, said):
    monkeypatch.chdir(tmp_path)
    for k, f in enumerate({*files, "point_100_0.csv"}):
        Path(f).write_text(hertz(gain=1 + 0.01 * k))
    before = sorted(p.name for p in tmp_path.iterdir())
    assert main(["new", *files, *BODY, *more]) == 2
    told = capsys.readouterr().err
    assert said in told and "pydantic" not in told
    assert sorted(p.name for p in tmp_path.iterdir()) == before


@pytest.mark.usefixtures("no_library")
def test_a_study_behind_a_link_finds_its_data(tmp_path):
    (tmp_path / "far" / "deep").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "far" / "deep")
    (tmp_path / "top.csv").write_text(hertz())
    assert main(["new", str(tmp_path / "top.csv"), *BODY, "--out", str(tmp_path / "link" / "study.toml")]) == 0


@pytest.mark.usefixtures("no_library")
def test_what_may_be_repeats_and_a_second_study_in_a_folder_are_said(tmp_path, capsys):
    files = [str(tmp_path / f"rep_{k}.csv") for k in (1, 2)]
    for k, f in enumerate(files):
        (tmp_path / f).write_text(hertz(gain=1 + 0.01 * k))
    assert main(["new", *files, *BODY, "--out", str(tmp_path / "a b.toml")]) == 0
    out = capsys.readouterr().out
    assert "repeats of one test are begun with --repeats" in out
    assert f"then: rso run '{tmp_path / 'a b.toml'}' --out '{tmp_path / 'results_a b'}'" in out
    assert new(tmp_path, *files, "--repeats") == 0
    assert "are tests of their own" not in capsys.readouterr().out


@pytest.mark.usefixtures("no_library")
def test_a_study_that_is_there_is_not_written_over(tmp_path, capsys):
    (tmp_path / "top.csv").write_text(hertz())
    path = studies.write(tmp_path)
    before = path.read_text()
    assert new(tmp_path, str(tmp_path / "top.csv")) == 2
    assert "is there already" in capsys.readouterr().err
    assert path.read_text() == before


def test_a_ball_that_is_pulled_in_opens_adhesion_about_what_was_put_in(tmp_path):
    """JKR with E* = 4 μ, written down here again by its equations."""
    R, mu, w, contact = 3.0, 0.5, 0.08, 0.2
    a = np.linspace(0.6, 3.0, 4000)
    depth = a**2 / R - np.sqrt(2 * np.pi * w * a / (4 * mu))
    force = 16 * mu * a**3 / (3 * R) - np.sqrt(8 * np.pi * w * 4 * mu * a**3)
    u = np.linspace(0.0, 0.9, 40)
    air = np.linspace(0.0, 0.19, 20)
    rows = [
        f"{v:.5f},{f:.5f}"
        for v, f in [*zip(air, 0 * air, strict=True), *zip(contact + u, np.interp(u, depth, force), strict=True)]
    ]
    (tmp_path / "a.csv").write_text("\n".join(["depth_mm,Fz_N", *rows, ""]))
    text = study_text(
        tmp_path / "study.toml",
        BACKEND,
        NewTest({"semi-axes": (30.0, 30.0, 30.0), "radius": (R,)}),
        [str(tmp_path / "a.csv")],
    )
    read = tomllib.loads(text)["parameters"]
    for name, unit, truth in (("mu", 1e-3, mu), ("adhesion", 1.0, w)):
        low, high = (unit * float(read[name][k].split()[0]) for k in ("low", "high"))
        assert abs(np.sqrt(low * high) / truth - 1.0) < 0.15
    assert "adhesion" in text and "JKR" in text


def test_a_modulus_that_is_none_is_refused(tmp_path):
    u = np.linspace(0.0, 1.0, 30)
    rows = [f"{v:.4f},{-0.4 * v:.4f}" for v in u]
    (tmp_path / "a.csv").write_text("\n".join(["depth_mm,Fz_N", *rows, ""]))
    with pytest.raises(ValueError, match="falls"):
        study_text(
            tmp_path / "study.toml",
            BACKEND,
            NewTest({"semi-axes": (30.0, 30.0, 30.0), "radius": (3.0,)}),
            [str(tmp_path / "a.csv")],
        )


@pytest.mark.parametrize(
    ("text", "ball"), [(hertz(gain=1e-5), "3"), (hertz().replace("depth_mm", "depth_m"), "3"), (hertz(), "3e8")]
)
def test_a_modulus_that_no_material_has_is_asked_about(tmp_path, capsys, text, ball):
    """A force, a depth or a radius in another unit: said of the file, not of a study that nobody saw."""
    (tmp_path / "a.csv").write_text(text)
    given = ["--half-space", "--ball", ball, "--out", str(tmp_path / "study.toml")]
    assert main(["new", str(tmp_path / "a.csv"), *given]) == 2
    said = capsys.readouterr().err
    assert "a.csv: " in said and "mu = " in said and "no material has" in said and "unit" in said
    assert "study.toml" not in said and not (tmp_path / "study.toml").exists()


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.usefixtures("no_library")
def test_two_signs_that_were_turned_are_marked_as_a_guess(tmp_path, sign):
    rows = [line.split(",") for line in hertz().splitlines()[1:]]
    (tmp_path / "top.csv").write_text(
        "\n".join(["Position (mm),Load (N)", *(f"{sign * float(u):g},{sign * float(F):g}" for u, F in rows), ""])
    )
    assert new(tmp_path, str(tmp_path / "top.csv")) == 0
    (line,) = (v for v in (tmp_path / "study.toml").read_text().splitlines() if v.startswith("data"))
    assert ("# <- pressed, as both signs were turned; a pull looks the same" in line) == (sign < 0)


@pytest.mark.usefixtures("no_library")
def test_many_specimens_are_a_study_with_a_table(tmp_path, capsys):
    """Each file is one specimen's; what is not the same for all stands in the table, and ranges hold those of each."""
    for name, mu in (("gel 1", 0.004), ("gel 2", 0.008), ("point_10_0", 0.016)):
        (tmp_path / f"{name}.csv").write_text(hertz(mu))
    files = [str(tmp_path / f"{name}.csv") for name in ("gel 1", "gel 2", "point_10_0")]
    assert new(tmp_path, *files, "--specimens") == 0
    said = capsys.readouterr().out
    assert "specimens.csv: written" in said and "3 specimens" in said and "rso run" in said
    assert said.index("first: write the sizes of each specimen") < said.index("then: rso run")
    found = load_specimens(tmp_path / "study.toml")
    assert found.names == ["gel 1", "gel 2", "point_10_0"]
    assert [s.experiments[0].settings["point"] for s in found.studies] == [[0, 0], [0, 0], [10, 0]]
    low, high = (
        float(str(v).split()[0])
        for v in (found.studies[0].parameters["mu"].low, found.studies[0].parameters["mu"].high)
    )
    alone = []
    for k, file in enumerate(files):
        (tmp_path / str(k)).mkdir()
        assert new(tmp_path / str(k), file) == 0
        own = load_study(tmp_path / str(k)).parameters["mu"]
        alone += [float(str(v).split()[0]) for v in (own.low, own.high)]
    assert (low, high) == (min(alone), max(alone)) and high / low > 4 * alone[1] / alone[0]


@pytest.mark.usefixtures("no_library")
def test_a_table_of_specimens_is_neither_overwritten_nor_left_behind(tmp_path, capsys, monkeypatch):
    (tmp_path / "a.csv").write_text(hertz())
    (tmp_path / "pulled.csv").write_text("depth_mm,Fz_N\n" + "".join(f"{0.1 * k},{-0.01 * k}\n" for k in range(30)))
    assert new(tmp_path, str(tmp_path / "a.csv"), str(tmp_path / "pulled.csv"), "--specimens") == 2
    assert not list(tmp_path.glob("*.toml*")) and not (tmp_path / "specimens.csv").exists()
    assert "pulled.csv" in capsys.readouterr().err

    def refused(found):
        raise StudyError([f"{found.file}: cannot run"])

    with monkeypatch.context() as planned:
        planned.setattr(plans, "specimen_plans", refused)
        assert new(tmp_path, str(tmp_path / "a.csv"), "--specimens") == 2
    assert "it was not written" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.toml*")) and not (tmp_path / "specimens.csv").exists()
    (tmp_path / "specimens.csv").write_text("mine")
    assert new(tmp_path, str(tmp_path / "a.csv"), "--specimens") == 2
    assert "specimens.csv: is there already" in capsys.readouterr().err
    assert (tmp_path / "specimens.csv").read_text() == "mine" and not (tmp_path / "study.toml").exists()


def test_the_header_that_is_named_is_as_wide_as_its_units(tmp_path, capsys):
    """Words above it that belong to the test are no header."""
    path = tmp_path / "a.txt"
    rows = "".join(f"{0.1 * k:.1f}\t{k:d}\t{0.1 * k:.1f}\n" for k in range(20))
    path.write_text(f"Test ID\tBatch\nWay\tPush\tClock\n(mm)\t(N)\t(sec)\n{rows}")
    assert new(tmp_path, str(path)) == 2
    assert "its header seems to be line 2: 'Way', 'Push', 'Clock'" in capsys.readouterr().err
