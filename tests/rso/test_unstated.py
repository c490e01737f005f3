"""Usual errors of a whole test that nobody stated widen the interval, are named, and a statement replaces them."""

import re

import numpy as np
import pytest
import sample_studies as studies

from rso.inference import Interval, elsewhere

STATED = studies.SECTIONS["[experiments]"]
SILENT = STATED.replace(', contact = "0 mm", gain = 0, correlation = "0 mm"', "")


def run(folder, experiments, shift=0.0, repeats=1):
    folder.mkdir()
    u, force = np.loadtxt(studies.measured().splitlines(), delimiter=",", skiprows=1).T
    rng, rows = np.random.default_rng(1), []
    for k in range(repeats):
        each = zip((u + shift).tolist(), (force + 2e-5 * k * rng.standard_normal(len(u))).tolist(), strict=True)
        rows += [f"{a!r},{b!r}" + (f",{k}" if repeats > 1 else "") for a, b in each]
    (folder / "top.csv").write_text("\n".join(["depth_mm,Fz_N" + (",repeat" if repeats > 1 else ""), *rows]) + "\n")
    return studies.run(folder, experiments=experiments)


def mu(found):
    return next(p for p in found["identification"]["parameters"] if p["parameter"] == "mu")


def width(ends):
    return np.log(ends[1] / ends[0])


def test_a_contact_that_is_off_is_in_the_interval_though_nobody_stated_it(tmp_path):
    """20 µm of 2 mm: the truth is outside what is stated alone, inside the interval that counts; an error is named."""
    found = run(tmp_path / "a", SILENT, shift=-0.02)
    known = mu(found)
    assert known["interval"][0] <= studies.MU <= known["interval"][1]
    assert not known["as_stated"][0] <= studies.MU <= known["as_stated"][1]
    assert width(known["interval"]) > 2 * width(known["as_stated"])
    (warning,) = [w for w in found["warnings"] if w.startswith("identification: mu is known to")]
    assert re.search(r"of top, .* counts most: noise\.(gain|contact|correlation) states", warning)
    assert sum(known["usual_errors"].values()) == pytest.approx(1.0)


def test_what_is_stated_is_not_asked_for(tmp_path):
    assert SILENT != STATED
    known = mu(run(tmp_path / "a", STATED))
    assert known["as_stated"] is None and known["usual_errors"] == {} and "usual" not in known["reason"]


def test_repeats_narrow_it(tmp_path):
    one, three = (mu(run(tmp_path / f"{r}", SILENT, repeats=r)) for r in (1, 3))
    assert width(three["interval"]) < width(one["interval"])


@pytest.mark.parametrize("noise, said", [(0.0, True), (1e-3, False)])
def test_readings_without_noise_are_called_so_beside_usual_errors(tmp_path, noise, said):
    """Exact readings of which nothing is stated; the control scatters by 0.3 % of the largest force."""
    (tmp_path / "top.csv").write_text(studies.measured(noise=noise))
    found = studies.run(tmp_path, experiments=STATED.split("\nnoise")[0])
    assert any("show no noise" in w for w in found["warnings"]) is said


@pytest.mark.parametrize("at, said", [(0.8, True), (0.32, False)])
def test_intervals_that_lie_apart_are_two_answers(at, said):
    """What is stated says 0.3 to 0.5: a wider interval that begins at 0.4 is no wider one of the same."""
    assert elsewhere(Interval(0.3, 0.5), Interval(0.5 * at, 0.9)) is said
