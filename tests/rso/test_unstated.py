"""Errors of a whole test that nobody stated: said where they would move the answer, by how much, and not otherwise."""

import re

import numpy as np
import pytest
import sample_studies as studies

STATED = studies.SECTIONS["[experiments]"]
SILENT = STATED.replace(', contact = "0 mm"', "")


def run(folder, experiments, shift=0.0, repeats=1):
    folder.mkdir()
    u, force = np.loadtxt(studies.measured().splitlines(), delimiter=",", skiprows=1).T
    rng, rows = np.random.default_rng(1), []
    for k in range(repeats):
        each = zip((u + shift).tolist(), (force + 2e-5 * k * rng.standard_normal(len(u))).tolist(), strict=True)
        rows += [f"{a!r},{b!r}" + (f",{k}" if repeats > 1 else "") for a, b in each]
    (folder / "top.csv").write_text("\n".join(["depth_mm,Fz_N" + (",repeat" if repeats > 1 else ""), *rows]) + "\n")
    return studies.run(folder, experiments=experiments, surrogate='kind = "kriging"')


def said(found):
    return [w for w in found["warnings"] if "noise.contact" in w]


def test_what_a_contact_nobody_stated_would_move_is_said(tmp_path):
    """The linear prediction against a study of the same record with its depths moved by as much; to a quarter."""
    found = run(tmp_path / "a", SILENT)
    (warning,) = said(found)
    off, percent = re.search(r"a contact ([\d.]+) mm off moves .*?mu by ([-+][\d.]+) %", warning).groups()
    moved = run(tmp_path / "b", SILENT, shift=-float(off))
    ratio = moved["identification"]["values"]["mu"] / found["identification"]["values"]["mu"]
    assert abs(float(percent)) > 0.5
    assert 100 * (ratio - 1) == pytest.approx(float(percent), rel=0.25)


@pytest.mark.parametrize("stated", ['contact = "0 mm"', 'gain = "1 %"', 'contact = "20 um"', 'calibration = "1 %"'])
def test_what_is_stated_is_not_asked_for(tmp_path, stated):
    assert not said(run(tmp_path / "a", STATED.replace('contact = "0 mm"', stated)))


def test_an_experiment_may_have_a_space_in_its_name_and_another_one_reading(tmp_path):
    one = '\n[[experiments]]\nname = "single"\nrole = "fit"\ndata = "one.csv"\nnoise = { Fz = "0.02 mN" }'
    (tmp_path / "a").mkdir()
    u, force = np.loadtxt(studies.measured().splitlines(), delimiter=",", skiprows=1).T
    (tmp_path / "a" / "one.csv").write_text(f"depth_mm,Fz_N\n{float(u[12])!r},{float(force[12])!r}\n")
    (tmp_path / "a" / "top.csv").write_text(studies.measured())
    spaced = SILENT.replace('name = "top"', 'name = "the top"') + one
    search = studies.SECTIONS["search"].replace('experiment = "top"', 'experiment = "the top"')
    found = studies.run(tmp_path / "a", experiments=spaced, search=search, surrogate='kind = "kriging"')
    (warning,) = said(found)
    assert "of the top is stated" in warning


def test_repeats_show_it_themselves_and_much_noise_drowns_it(tmp_path):
    assert not said(run(tmp_path / "a", SILENT, repeats=3))
    assert not said(run(tmp_path / "b", SILENT.replace("0.02 mN", "0.1 N")))
