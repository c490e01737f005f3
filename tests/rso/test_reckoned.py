"""Depth less a deflection, force as stiffness times deflection: what the tip did comes back, or a clear error."""

import numpy as np
import pytest
import sample_studies as studies

from rso.cli import main
from rso.data import ZERO_AT_CONTACT, Column, read_measurement
from rso.study.errors import StudyError
from rso.study.loader import load_study

K = 8.76e-5  # N/mm, 0.0876 N/m
MODULUS = 1e-4  # N/mm^1.5: F = MODULUS δ^1.5 of a ball of 5 µm on some kPa
START, PARKED, LIGHT = -1e-3, 3e-3, 1.2e-4  # mm: where the approach begins, the piezo's 0, the photodiode's 0
Z, D = "Z piezo (nm)", "Deflection (nm)"


def approach(n=300, noise=0.0):
    """Travel of the piezo from contact, deflection and indentation (n,) mm: K d = MODULUS (z − d)^1.5, by bisection."""
    z = np.linspace(START, 2e-3, n)
    low, high = np.zeros(n), np.maximum(z, 0.0)
    for _ in range(80):
        middle = 0.5 * (low + high)
        stiff = MODULUS * middle**1.5 / K + middle > z
        low, high = np.where(stiff, low, middle), np.where(stiff, middle, high)
    d = np.maximum(z, 0.0) - low
    return z, d + noise * np.random.default_rng(0).standard_normal(n), z - d


def write(path, head, *columns):
    path.write_text("\n".join([head, *(",".join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)), ""]))
    return path


def afm(tmp_path, up=1.0, bends=1.0, head=f"{Z},{D}"):
    z, d, _ = approach()
    return write(tmp_path / "afm.csv", head, 1e6 * up * (z + PARKED), 1e6 * bends * (d + LIGHT))


@pytest.mark.parametrize("up", [1.0, -1.0])
@pytest.mark.parametrize("bends", [1.0, -1.0])
def test_a_cantilever_gives_the_indentation_and_the_force(tmp_path, up, bends):
    columns = {
        "depth": Column(Z, flip=up < 0, zero=up * 1e6 * PARKED, minus=Column(D, flip=bends < 0)),
        "Fz": Column(D, flip=bends < 0, zero=bends * 1e6 * LIGHT, stiffness=K),
    }
    m = read_measurement(afm(tmp_path, up, bends), columns)
    _, d, depth = approach()
    (r,) = m.repeats
    np.testing.assert_allclose(r.depth, depth - LIGHT, atol=1e-11)  # the written digits
    np.testing.assert_allclose(r.channels["Fz"], K * d, atol=1e-14)
    assert m.unread == () and any(f"{D!r} · 0.0876 N/m" in doubt for doubt in m.doubts)


def test_contact_is_found_on_what_is_left_of_the_travel(tmp_path):
    z, d, depth = approach(noise=2e-7)
    path = write(tmp_path / "afm.csv", f"{Z},{D}", 1e6 * (z + PARKED), 1e6 * (d + LIGHT))
    columns = {
        "depth": Column(Z, zero=ZERO_AT_CONTACT, minus=Column(D)),
        "Fz": Column(D, zero=ZERO_AT_CONTACT, stiffness=K),
    }
    m = read_measurement(path, columns)
    r = m.repeats[0]
    off = r.depth - depth - (z - d - depth)  # the deflection's noise is in both
    assert np.ptp(off) < 1e-9 and abs(off[0]) < 3.0 * m.contact < 1e-4
    np.testing.assert_allclose(np.median(r.channels["Fz"][z < -2e-4]), 0.0, atol=1e-12)
    plain = read_measurement(
        write(tmp_path / "b.csv", "Z (nm),F (mN)", 1e6 * (z - d), 1e3 * K * d),
        {"depth": Column("Z (nm)", zero=ZERO_AT_CONTACT), "Fz": Column("F (mN)", zero=ZERO_AT_CONTACT)},
    )
    np.testing.assert_allclose(r.depth, plain.repeats[0].depth, atol=1e-9)


@pytest.mark.parametrize("by", [{"stiffness": K}, {"compliance": 1.0 / K}])
def test_a_force_is_subtracted_by_what_bends_under_it(tmp_path, by):
    z, d, depth = approach()
    path = write(tmp_path / "a.csv", "Position (nm),Load (nN)", 1e6 * z, 1e9 * K * d)
    m = read_measurement(
        path, {"depth": Column("Position (nm)", minus=Column("Load (nN)", **by)), "Fz": Column("Load (nN)")}
    )
    np.testing.assert_allclose(m.repeats[0].depth, depth, atol=1e-11)
    np.testing.assert_allclose(m.repeats[0].channels["Fz"], K * d, atol=1e-14)


def test_one_count_of_a_photodiode_is_a_length(tmp_path):
    z, d, depth = approach()
    path = write(tmp_path / "a.csv", "Z (nm),Defl (V)", 1e6 * z, 1e6 * d / 62.0)
    columns = {
        "depth": Column("Z (nm)", minus=Column("Defl (V)", "62 nm")),
        "Fz": Column("Defl (V)", "62 nm", stiffness=K),
    }
    np.testing.assert_allclose(read_measurement(path, columns).repeats[0].depth, depth, atol=1e-10)


def test_what_is_mostly_subtracted_is_said_and_what_is_not_is_not(tmp_path):
    z, d, _ = approach()
    zero = {
        "depth": Column(Z, zero=1e6 * (PARKED - LIGHT), minus=Column(D)),
        "Fz": Column(D, zero=1e6 * LIGHT, stiffness=K),
    }
    soft = [v for v in read_measurement(afm(tmp_path), zero).doubts if "1 % of what is subtracted" in v]
    assert not soft and d[-1] < 0.5 * (z - d)[-1]
    stiff = write(tmp_path / "b.csv", f"{Z},{D}", 1e6 * (z + 40.0 * d), 40e6 * d)
    (said,) = (
        v
        for v in read_measurement(stiff, {"depth": Column(Z, minus=Column(D)), "Fz": Column(D, stiffness=K)}).doubts
        if "1 % of what is subtracted" in v
    )
    ratio = 40.0 * d[-1] / z[-1]
    assert f"is {ratio:.2g} % of depth" in said


WRONG = {  # keys of depth, of minus, of Fz; words of the message
    "sign of minus": ({}, {"flip": True}, {}, "what is subtracted from depth falls while Fz grows"),
    "sign of Fz": ({}, {}, {"flip": True}, "what is subtracted from depth falls while Fz grows"),
    "header of minus": ({}, {"header": "Defl"}, {}, r"there is no header 'Defl' \(depth.minus\); choose from"),
    "both headers": ({}, {"header": "Defl"}, {"header": "Defl"}, r"no header 'Defl' \(Fz, depth.minus\)"),
    "a length by a stiffness": ({}, {"stiffness": K}, {}, "column 'depth.minus' .*'nm' is not a unit of the kind 'N'"),
    "another unit": ({}, {"unit": "um"}, {}, "column 'depth.minus' .*the study 'um'|the study says 'um'"),
    "height": ({"flip": True}, {}, {}, r"\(depth is −'Z piezo \(nm\)' − 'Deflection \(nm\)'"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_cannot_be_is_refused_in_words(tmp_path, wrong):
    depth, minus, Fz, words = WRONG[wrong]
    columns = {
        "depth": Column(**{"header": Z, "zero": 1e6 * PARKED, **depth}, minus=Column(**{"header": D, **minus})),
        "Fz": Column(**{"header": D, "zero": 1e6 * LIGHT, "stiffness": K, **Fz}),
    }
    with pytest.raises(ValueError, match=words) as error:
        read_measurement(afm(tmp_path), columns)
    assert "afm.csv" in str(error.value)


def test_a_force_has_no_stiffness_and_a_force_alone_is_no_deflection(tmp_path):
    z, d, _ = approach()
    path = write(tmp_path / "a.csv", "Z (nm),Load (nN)", 1e6 * z, 1e9 * K * d)
    with pytest.raises(
        ValueError, match=r"'nN' is not a unit of the kind 'mm'.*stiffness makes a force of a deflection"
    ):
        read_measurement(path, {"depth": Column("Z (nm)"), "Fz": Column("Load (nN)", stiffness=K)})
    with pytest.raises(ValueError, match=r"'depth\.minus'.*a force is subtracted with the stiffness or compliance"):
        read_measurement(path, {"depth": Column("Z (nm)", minus=Column("Load (nN)")), "Fz": Column("Load (nN)")})


DEPTH = f'depth = {{ header = "{Z}", zero = "contact", minus = {{ header = "{D}" }} }}'
FZ = f'Fz = {{ header = "{D}", zero = "contact", stiffness = "0.0876 N/m" }}'
KEYS = {  # line of [columns], and what is said of it
    f'Fz = {{ header = "{D}", stiffness = "3 nm" }}': ["columns.Fz.stiffness = '3 nm'", "'nm' is not a unit", "N/mm"],
    f'Fz = {{ header = "{D}", stiffness = 0.0 }}': ["columns.Fz.stiffness", "greater than 0"],
    f'Fz = {{ header = "{D}", unit = "nN", stiffness = 1.0 }}': ["columns.Fz", "unit = 'nN'", "of a deflection"],
    f'Fz = {{ header = "{D}", minus = {{ header = "{Z}" }} }}': ["columns.Fz", "subtracted of depth; Fz has none"],
    f'depth = {{ header = "{Z}", stiffness = 1.0 }}': ["columns.depth", "depth is none", "minus"],
    f'depth = {{ header = "{Z}", minus = {{ header = "{Z}" }} }}': ["columns.depth", "nothing would be left"],
    f'depth = {{ header = "{Z}", minus = {{ header = "{D}", unit = "nN" }} }}': [
        "columns.depth.minus",
        "unit = 'nN'",
        "stiffness or compliance",
    ],
    f'depth = {{ header = "{Z}", minus = {{ header = "{D}", zero = 3 }} }}': ["minus.zero", "unknown key", "flip"],
    f'depth = {{ header = "{Z}", minus = {{ header = "{D}", stiffness = 1.0, compliance = 1.0 }} }}': [
        "compliance is 1 / stiffness"
    ],
}


def study(tmp_path, *lines):
    afm(tmp_path)
    return studies.write(
        tmp_path,
        columns="\n".join(lines),
        search="repair = false",
        experiments='name = "top"\nrole = "fit"\ndata = "afm.csv"',
    )


@pytest.mark.parametrize("line", KEYS)
def test_a_study_says_which_key_is_wrong(tmp_path, line):
    other = FZ if line.startswith("depth") else DEPTH
    path = study(tmp_path, line, other)
    with pytest.raises(StudyError) as error:
        load_study(path)
    assert all(words in str(error.value) for words in ["study.toml:", *KEYS[line]])


def test_a_study_reads_what_it_says(tmp_path):
    m = load_study(study(tmp_path, DEPTH, FZ)).measurement("top")
    np.testing.assert_allclose(m.repeats[0].depth, approach()[2], atol=4.0 * m.contact)
    assert any(f"depth is {Z!r} − {D!r}" in v for v in m.doubts) and 0.0 < m.contact < 1e-4


def new(tmp_path, monkeypatch, *columns):
    monkeypatch.chdir(tmp_path)
    words = [w for c in columns for w in ("--column", *c)]
    return main(["new", "afm.csv", "--semi-axes", "0.1", "0.1", "0.1", "--radius", "0.005", *words])


def test_a_new_study_is_begun_with_them(tmp_path, monkeypatch, capsys):
    afm(tmp_path)
    depth, Fz = ["depth", Z, "contact", "minus", D], ["Fz", D, "stiffness", "0.0876 N/m", "contact"]
    assert new(tmp_path, monkeypatch, depth, Fz) == 0
    text = (tmp_path / "study.toml").read_text()
    assert f'minus = {{ header = "{D}" }}' in text and 'stiffness = "0.0876 N/m"' in text
    assert "depth is 'Z piezo (nm)' − 'Deflection (nm)'" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["minus"], ["minus", D, "nm", "mm"], ["stiffness", "0.1 N/m"], ["minus", D, "nN"]])
def test_words_that_say_no_column_are_refused(tmp_path, monkeypatch, capsys, words):
    afm(tmp_path)
    assert new(tmp_path, monkeypatch, ["depth", Z, *words], ["Fz", D, "stiffness", "0.0876 N/m"]) == 2
    assert "--column depth" in capsys.readouterr().err and not (tmp_path / "study.toml").exists()
