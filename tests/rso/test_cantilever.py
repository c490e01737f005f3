"""Text of force microscopes: what its header is, and a question that ends well in place of a wrong depth."""

import re
import shlex
import tomllib

import numpy as np
import pytest

from rso.cli import main
from rso.data import Unsaid, read_measurement
from rso.study.columns_table import ColumnsTable

K, MODULUS, SENSITIVITY = 0.0876e-3, 1e-4, 62e-6  # N/mm, N/mm^1.5, mm/V
PARKED, LIGHT = 8e-3, 1.2e-4  # mm


def approach(n=200):
    """Travel from contact, deflection, indentation (n,) mm; the indentation is chosen, the travel follows."""
    depth = np.r_[np.zeros(n // 3), np.linspace(0.0, 1.5e-3, n - n // 3)]
    d = MODULUS * depth**1.5 / K
    return np.r_[np.linspace(-1e-3, 0.0, n // 3), (depth + d)[n // 3 :]], d, depth


def table(head, *columns, separator=","):
    return "\n".join([*head, *(separator.join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)), ""])


def jpk(names="vDeflection height seriesTime", units="V m s", springs=True):
    z, d, _ = approach()
    t = 0.01 * np.arange(len(z))
    known = {"vDeflection": (d + LIGHT) / SENSITIVITY, "height": 1e-3 * (PARKED - z), "seriesTime": t}
    parts = []
    for segment, turn in (("extend", slice(None)), ("retract", slice(None, None, -1))):
        constants = ["# springConstant: 0.0876", "# sensitivity: 6.2E-8"] * springs
        head = [
            "# fileFormat: ascii",
            f"# segment: {segment}",
            *constants,
            "#",
            f"# columns: {names}",
            f"# units: {units}",
            "#",
        ]
        values = {**{k: v[turn] for k, v in known.items()}, "seriesTime": t + (segment == "retract") * 3.0}
        parts.append(table(head, *(values[n] for n in names.split()), separator=" "))
    return "\n".join(parts)


Z, D, DEPTH = approach()
FILES = {  # text, numbers for the dots
    "table": (table(["Z piezo (nm),Deflection (nm)"], 1e6 * (Z + PARKED), 1e6 * (D + LIGHT)), ["0.0876"]),
    "units beneath": (table(["Z piezo,Deflection", "nm,nm"], 1e6 * (Z + PARKED), 1e6 * (D + LIGHT)), ["0.0876"]),
    "volts": (table(["Piezo (um);Defl (V)"], 1e3 * Z, D / SENSITIVITY, separator=";"), ["62", "62", "0.0876"]),
    "deflection is a force": (table(["Z position (nm),Deflection (nN)"], 1e6 * Z, 1e9 * K * D), ["0.0876"]),
    "beside a load": (table(["Displacement (nm),Load (nN),Cantilever (nm)"], 1e6 * Z, 1e9 * K * D, 1e6 * D), []),
    "a piezo and a load": (table(["Piezo (nm),Load (nN)"], 1e6 * Z, 1e9 * K * D), ["0.0876"]),
    "a height and counts": (table(["Height (nm),Deflection (nm)"], 1e6 * (PARKED - Z), -1e6 * D), ["0.0876"]),
    "comments": (jpk(), []),
    "comments, no constants": (jpk(springs=False), ["62", "62", "0.0876"]),
}


def asked(tmp_path, name):
    (tmp_path / "a.txt").write_text(FILES[name][0])
    with pytest.raises(Unsaid, match=r"a\.txt:\d+: .* no column is the depth") as error:
        read_measurement(tmp_path / "a.txt")
    return str(error.value)


@pytest.mark.parametrize("name", FILES)
def test_what_the_message_says_gives_the_indentation(tmp_path, name):
    lines = asked(tmp_path, name).partition("[columns]\n")[2]
    for number in FILES[name][1]:
        lines = lines.replace("…", number, 1)
    assert "…" not in lines
    columns = ColumnsTable(**tomllib.loads(lines)).columns()
    m = read_measurement(tmp_path / "a.txt", columns)
    (r,) = m.repeats
    loading = r.segment == "loading"
    np.testing.assert_allclose(r.depth[loading][-len(DEPTH) // 2 :], DEPTH[-len(DEPTH) // 2 :], atol=1e-5)  # of contact
    np.testing.assert_allclose(r.channels["Fz"][loading], K * D, atol=1e-3 * K * D.max())
    assert ("time" in columns) == name.startswith("comments")


@pytest.mark.parametrize("name", ["table", "comments"])
@pytest.mark.usefixtures("no_library")
def test_a_new_study_asks_in_its_own_words(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.txt").write_text(FILES[name][0])
    usual = ["new", "a.txt", "--semi-axes", "0.1", "0.1", "0.1", "--radius", "0.005"]
    assert main(usual) == 2
    words = [shlex.split(v.replace("…", "0.0876")) for v in re.findall(r"--column .*", capsys.readouterr().err)]
    assert len(words) >= 2 and main([*usual, *(w for line in words for w in line)]) == 0
    assert "depth is" in capsys.readouterr().out


@pytest.mark.usefixtures("no_library")
def test_tables_that_hold_the_depth_are_not_asked_about(tmp_path):
    for head, u in (
        ("Indentation (nm),Load (nN),Cantilever (nm),Piezo (nm)", DEPTH),
        ("Tip position (nm),Deflection (nN),Height (nm),Piezo (nm)", DEPTH),
    ):
        (tmp_path / "a.csv").write_text(table([head], 1e6 * u, 1e9 * K * D, 1e6 * D, 1e6 * Z))
        r = read_measurement(tmp_path / "a.csv").repeats[0]
        np.testing.assert_allclose(np.ptp(r.depth), np.ptp(DEPTH), rtol=1e-6)
    (tmp_path / "b.csv").write_text(table(["Height (mm),Load (N)"], 1e3 * Z, 1e6 * K * D))
    with pytest.raises(ValueError, match="unknown column 'Height") as error:
        read_measurement(tmp_path / "b.csv")  # of a press, perhaps
    assert not isinstance(error.value, Unsaid)


def test_a_travel_that_a_study_calls_depth_beside_a_deflection_is_told(tmp_path):
    (tmp_path / "a.csv").write_text(FILES["beside a load"][0])
    lines = (
        'depth = { header = "Displacement (nm)", zero = "contact" }\nFz = { header = "Load (nN)", zero = "contact" }'
    )
    m = read_measurement(tmp_path / "a.csv", ColumnsTable(**tomllib.loads(lines)).columns())
    assert any("'Displacement (nm)' as it stands, beside 'Cantilever (nm)'" in d for d in m.doubts)


def test_a_header_in_comments_is_read_where_it_says_a_depth(tmp_path):
    (tmp_path / "a.txt").write_text(
        table(["# columns: verticalTipPosition vDeflection", "# units: m N"], -1e-3 * DEPTH, K * D, separator=" ")
    )
    m = read_measurement(tmp_path / "a.txt")
    np.testing.assert_allclose(m.repeats[0].depth, DEPTH, atol=3e-5)
    assert m.headers["depth"] == "verticalTipPosition"


def test_a_header_in_comments_that_does_not_fit_names_both_counts(tmp_path):
    text = jpk(springs=False)
    for old, new, words in (
        ("# columns: vDeflection height seriesTime", "# columns: vDeflection height", "names 2 columns, .* have 3"),
        (
            "# segment: retract\n#\n# columns: vDeflection height",
            "#\n# columns: height vDeflection",
            "other columns are named",
        ),
    ):
        (tmp_path / "a.txt").write_text(text.replace(old, new))
        with pytest.raises(ValueError, match=words):
            read_measurement(tmp_path / "a.txt")


def test_a_piezo_that_rests_is_a_hold_though_the_tip_goes_on(tmp_path):
    """A body that relaxes lets the cantilever unbend: the depth grows while the piezo waits."""
    t, rest = 0.01 * np.arange(len(Z)), 0.02 * np.arange(1, 151)
    falls = 1.0 - 0.3 * (1.0 - np.exp(-rest))
    wait, relaxed = np.full(len(rest), Z[-1]), D[-1] * falls
    z, d = np.r_[Z, wait, Z[::-1]], np.r_[D, relaxed, 0.7 * D[::-1]]
    time = np.r_[t, t[-1] + rest, t[-1] + rest[-1] + 0.01 + t]
    path = tmp_path / "a.csv"
    path.write_text(table(["Height (nm),Deflection (nm),Time (s)"], 1e6 * (PARKED - z), 1e6 * (d + LIGHT), time))
    with pytest.raises(Unsaid) as asked:
        read_measurement(path)
    said = {name: dict(column) for name, column in asked.value.columns.items()}
    said["Fz"]["stiffness"] = "0.0876 N/m"
    (r,) = read_measurement(path, ColumnsTable(**said).columns()).repeats
    assert [int(np.sum(r.segment == s)) for s in ("loading", "hold", "unloading")] == pytest.approx(
        [len(Z), len(rest), len(Z)], abs=2
    )
    held = r.segment == "hold"
    assert r.depth[held][-1] > r.depth[r.segment == "loading"].max() + 0.2 * D[-1]  # the cantilever's share
