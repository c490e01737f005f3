"""What a stated size that counts as exact would move, were it larger: said by a closed form, held to whole fits."""

import numpy as np
import pytest
import sample_studies as studies

from fem_backend.backend import BACKEND
from rso.calibration.assumptions import _forms
from rso.calibration.plan import make_plan
from rso.contract import Case, Programme
from rso.inference import CurvePlace
from rso.report.calibration.inputs import assumed
from rso.study.loader import load_study

DEPTH = np.linspace(0.1, 0.8, 8)
SLAB = {"shape": "slab", "thickness": 2.3}
WIDE = {"indenter": {"shape": "sphere", "radius": 3.0}, "mesh": {"level": "coarse"}}
NOISE = "10 mN"  # so much that no shape of a curve speaks against another size or support
PUCK = {"shape": "cylinder", "radius": 2.0, "height": 6.0}


def identified(folder, specimen, more="", support="", D1="{ value = 5 }"):
    """The identification of μ, and of D₁ where a range is given, from forces of a body that is as stated."""
    case = Case("press", Programme.ramp(tuple(DEPTH)), {**WIDE, "specimen": specimen})
    force = np.asarray(BACKEND({"mu": 0.01, "D1": 5.0}, case).channels["Fz"])
    rows = "".join(f"{h!r},{F!r}\n" for h, F in zip(DEPTH.tolist(), force.tolist(), strict=True))
    folder.mkdir()
    (folder / "top.csv").write_text("depth_mm,Fz_N\n" + rows)
    inline = ", ".join(f"{k} = {v!r}" for k, v in specimen.items())
    return studies.run(
        folder,
        backend='use = "fem_backend.backend:BACKEND"',
        **{
            "backend.settings": f'mesh = {{ level = "coarse" }}\nindenter = {{ shape = "sphere", radius = 3 }}\n'
            f"specimen = {{ {inline} }}\n{support}",
            "parameters": 'mu = { low = "6 kPa", high = "20 kPa", scale = "log" }\n' + f"D1 = {D1}\n{more}",
            "search": 'method = "gauss_newton"',
        },
        experiments=studies.SECTIONS["[experiments]"].replace("0.02 mN", NOISE),
        doe=None,
        surrogate=None,
        sensitivity=None,
    )


@pytest.mark.parametrize(
    ("name", "size"), [("delta_thickness", 2.3), pytest.param("delta_R", 3.0, marks=pytest.mark.verification)]
)
def test_a_closed_form_says_what_a_larger_size_makes_of_the_modulus(tmp_path, name, size):
    """Beside a whole fit of a body 5 % larger: within a fifth, as strains are large and the closed form's are small."""
    found = identified(tmp_path / "stated", SLAB)["identification"]
    said = {r["name"]: r["moves"] for r in found["assumptions"]}
    assert set(said) == {"delta_thickness", "delta_R", "plate"}
    other = identified(tmp_path / name, SLAB, f"{name} = {{ value = {0.05 * size} }}")["identification"]
    moved = other["values"]["mu"] / found["values"]["mu"] - 1.0
    assert said[name]["mu"] == pytest.approx(moved, rel=0.2)
    assert said[name]["E"] == pytest.approx(said[name]["mu"], rel=0.02)  # ν is another with D₁ as stated
    assert name not in {r["name"] for r in other["assumptions"]}  # its size was stated


@pytest.mark.verification
def test_a_closed_form_says_what_another_support_makes_of_the_modulus(tmp_path):
    """A slab that slides is softer: beside a whole fit of it, within a tenth."""
    found = identified(tmp_path / "held", SLAB)["identification"]
    said = {r["name"]: r["moves"]["mu"] for r in found["assumptions"]}
    slides = identified(tmp_path / "slides", SLAB, support='support = { kind = "plate" }')["identification"]
    moved = slides["values"]["mu"] / found["values"]["mu"] - 1.0
    assert moved > 0.2 and said["plate"] == pytest.approx(moved, rel=0.1)


@pytest.mark.verification
def test_two_parameters_that_a_support_moves_are_those_of_a_whole_fit(tmp_path):
    """Along a valley a step to first order goes far beyond all sense; the fit stays within the ranges."""
    wide = '{ low = 0.5, high = 60, scale = "log" }'
    found = identified(tmp_path / "held", SLAB, D1=wide)["identification"]
    said = {r["name"]: r["moves"] for r in found["assumptions"]}["plate"]
    slides = identified(tmp_path / "slides", SLAB, support='support = { kind = "plate" }', D1=wide)["identification"]
    E, other = ({q["name"]: q["value"] for q in f["derived"]}["E"] for f in (found, slides))
    assert said["E"] == pytest.approx(other / E - 1.0, abs=0.1)


def test_a_body_that_no_closed_form_describes_has_none(tmp_path):
    """A high puck narrower than its indenter: a layer without end is 50 % stiffer and more."""
    found = identified(tmp_path / "puck", PUCK)
    assert found["identification"]["exact_inputs"]
    assert not found["identification"]["assumptions"] and assumed(found) == []


def test_the_forms_of_an_unloading_are_those_of_the_loading(tmp_path):
    """Its programme asks for moments of the way back: travels are as many as the forces, whichever branch it is."""
    rows = [(t, u, u**1.5) for t, u in enumerate([*np.linspace(0.0, 0.8, 9), *np.linspace(0.7, 0.1, 7)])]
    (tmp_path / "top.csv").write_text("time_s,depth_mm,Fz_N\n" + "".join(f"{t},{u:.3f},{F:.5f}\n" for t, u, F in rows))
    body = studies.SECTIONS["[experiments]"].replace("0.02 mN", NOISE)
    both = body + "\n[[experiments]]\n" + body.replace('"top"', '"back"', 1) + '\nbranch = "unloading"'
    backend = {"backend": 'use = "fem_backend.backend:BACKEND"', "search": 'method = "gauss_newton"'}
    settings = {"backend.settings": 'specimen = { shape = "slab", thickness = 2.3 }'}
    gone = dict.fromkeys(("doe", "surrogate", "sensitivity"))
    plan = make_plan(load_study(studies.write(tmp_path, **backend, **settings, **gone, experiments=both)))
    u = np.array([0.001, 0.2, 0.4, 0.8])
    forms = [_forms(plan, CurvePlace(e, "Fz", u), {"mu": 0.01, "D1": 5.0}, {}, u) for e in ("top", "back")]
    assert forms[0] and forms[0].keys() == forms[1].keys()
    for name, F in forms[0].items():
        np.testing.assert_array_equal(F, forms[1][name])
        assert F.shape == u.shape


def results(*rows):
    return {
        "parameters": [{"name": "mu", "unit": "MPa", "low": 0.001, "high": 1.0}],
        "determined": {"mu": {"determined": True, "interval": [0.009, 0.011], "story": ""}},
        "identification": {
            "assumptions": [
                {"name": n, "experiment": "", "description": f"error of {n}", "larger": 0.05, "moves": {"mu": v}}
                for n, v in rows
            ]
        },
    }


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ((("a", 0.064), ("b", -0.066)), "were a 5 % larger than stated, μ would be about 6.4 % larger"),
        ((("a", 0.02), ("b", -0.066)), "were b 5 % larger than stated, μ would be about 6.6 % smaller"),
    ],
)
def test_the_first_page_names_the_specimens_size_unless_another_matters_much_more(rows, said):
    (line,) = assumed(results(*rows))
    assert line.replace("\N{NO-BREAK SPACE}", " ").endswith(said)


def test_what_hardly_moves_is_not_named():
    assert assumed(results(("a", 0.014), ("b", -0.013))) == []


def test_nothing_is_said_of_what_is_not_known():
    found = results(("a", 0.064))
    found["determined"]["mu"]["determined"] = False
    assert assumed(found) == []
