"""`rso new` for slabs, pucks, layers: settings by the options of members, and what is said of wrong ones."""

import tomllib

import numpy as np
import pytest

from fem_backend import members
from fem_backend.backend import BACKEND
from fem_backend.specimens import SPECIMENS
from rso.cli import main
from rso.contract import NewStudies, Option, capability
from rso.study.new_study import NewTest, study_text

CURVE = "depth_mm,Fz_N\n" + "".join(f"{0.05 * k:.2f},{0.02 * (0.05 * k) ** 1.5:.6f}\n" for k in range(1, 11))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curve.csv").write_text(CURVE)
    return tmp_path


def settings(folder, **given):
    """The settings of a study begun with these options."""
    text = study_text(
        folder / "study.toml", BACKEND, NewTest({k.replace("_", "-"): v for k, v in given.items()}), ["curve.csv"]
    )
    return tomllib.loads(text)["backend"]["settings"]


def test_a_slab_under_a_ball(folder):
    found = settings(folder, slab=(2.3,), ball=(1.0,))
    assert found["specimen"] == {"shape": "slab", "thickness": 2.3}
    assert found["indenter"]["shape"] == "sphere" and found["indenter"]["radius"] == 1.0
    assert found["support"] == {"kind": "bonded"}


@pytest.mark.parametrize(
    ("given", "specimen", "support"),
    [
        ({"puck": (10.0, 5.0)}, {"shape": "cylinder", "radius": 10.0, "height": 5.0}, "bonded"),
        ({"well": (8.0, 5.0)}, {"shape": "slab", "thickness": 5.0}, "well"),
        ({"block": (30.0, 20.0, 8.0)}, {"shape": "block", "size": [30.0, 20.0, 8.0]}, "bonded"),
        ({"half-space": ()}, {"shape": "half_space"}, "bonded"),
        ({"ellipsoid": (60.0, 35.0, 35.0)}, {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}, "fixed"),
        ({"semi_axes": (60.0, 35.0, 35.0)}, {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0]}, "fixed"),
        (
            {"slab": (5.0,), "layers": ("0.3:5", "1:0.5")},
            {
                "shape": "slab",
                "thickness": 5.0,
                "layers": [{"thickness": 0.3, "ratio": 5.0}, {"thickness": 1.0, "ratio": 0.5}],
            },
            "bonded",
        ),
    ],
)
def test_each_specimen_has_its_options_and_its_usual_support(folder, given, specimen, support):
    found = settings(folder, ball=(1.0,), **given)
    assert found["specimen"] == specimen
    assert found["support"]["kind"] == support


def test_layers_may_come_before_the_slab_that_has_them(folder):
    first = settings(folder, layers=("0.3:5",), slab=(5.0,), ball=(1.0,))
    assert first == settings(folder, slab=(5.0,), ball=(1.0,), layers=("0.3:5",))


def test_older_names_mean_the_same(folder):
    assert settings(folder, slab=(5.0,), ball=(1.0,)) == settings(folder, slab=(5.0,), radius=(1.0,))


def test_a_bowl_is_chosen_and_its_friction_is_marked_as_a_guess(folder):
    given = {"ellipsoid": (60.0, 35.0, 35.0), "ball": (3.0,), "bowl": (1.5,)}
    text = study_text(folder / "study.toml", BACKEND, NewTest(given), ["curve.csv"])
    assert 'support = { kind = "bowl", clearance = 1.5, friction = 0.2 }  # <- its friction' in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--slab 0 --ball 1", ["--slab 0 mm", "specimen.thickness = 0.0 mm: must be positive"]),
        ("--slab 2.3 --ball -1", ["--ball -1 mm", "indenter.radius = -1.0 mm"]),
        ("--slab x --ball 1", ["--slab THICKNESS: 'x'", "a number in mm"]),
        ("--slab nan --ball 1", ["--slab THICKNESS: nan is not finite", "a number in mm"]),
        ("--slab 2kPa --ball 1", ["--slab THICKNESS", "a number in mm"]),
        (
            "--slab 2.3 --ellipsoid 1 2 3 --ball 1",
            ["--slab 2.3 mm", "--ellipsoid 1 mm 2 mm 3 mm", "2 specimens", "one is"],
        ),
        ("--slab 2.3 --ball 1 --radius 2", ["--ball 1 mm and --radius 2 mm: 2 indenters are given"]),
        ("--slab 2.3 --layers 1:2 2:1 --ball 1", ["--layers 1:2 2:1", "layers of 3 mm", "specimen.thickness = 2.3 mm"]),
        ("--slab 2.3 --layers 1 --ball 1", ["--layers 1: '1': THICKNESS:RATIO is expected, in mm"]),
        ("--slab 2.3 --layers 1:-2 --ball 1", ["--layers 1:-2", "specimen.layers.ratio = -2.0"]),
        ("--ellipsoid 9 9 9 --layers 1:2 --ball 1", ["--layers 1:2", "specimen.layers", "unknown"]),
        ("--layers 1:2 --ball 1", ["no specimen is given", "--slab THICKNESS", "--puck RADIUS HEIGHT", "mm"]),
        ("--slab 2.3", ["no indenter is given", "--ball R"]),
        ("--slab 2.3 --ball 1 --bowl 1", ["--slab 2.3 mm --bowl 1 mm", 'support.kind = "bowl"']),
    ],
)
def test_a_wrong_option_is_named_with_its_value_and_unit(folder, capsys, words, said):
    assert main(["new", "curve.csv", *words.split()]) == 2
    error = capsys.readouterr().err
    assert [s for s in said if s not in error] == []
    assert not (folder / "study.toml").exists()


def test_a_length_may_have_a_unit(folder, capsys):
    """The support that does not suit makes both end in a message with the length in mm, before anything is checked."""
    for words in ("2.3", "2300um", "0.23 cm"):
        assert main(["new", "curve.csv", "--slab", words, "--ball", "1", "--bowl", "1"]) == 2
        assert "--slab 2.3 mm" in capsys.readouterr().err


def test_a_member_brings_its_own_option(folder, monkeypatch, capsys):
    """What a file of a new specimen declares is offered, asked for and used; without it nobody knows the option."""
    member = SPECIMENS.members["slab"]
    own = members.SettingsOption(
        "gel",
        ("T", "[RATIO]"),
        ("mm", "text"),
        "a gel",
        least=1,
        settings=lambda t, k="2": {
            "specimen": {"shape": "slab", "thickness": t, "layers": [{"thickness": 0.1 * t, "ratio": float(k)}]}
        },
        guess="the ratio of its skin",
    )
    assert "gel" not in [o.name for o in BACKEND.options()]
    monkeypatch.setattr(member, "options", (*member.options, own))
    assert "gel" in [o.name for o in BACKEND.options()]
    text = study_text(folder / "study.toml", BACKEND, NewTest({"gel": (5.0,), "ball": (1.0,)}), ["curve.csv"])
    assert "# <- the ratio of its skin" in text
    with pytest.raises(SystemExit):
        main(["new", "--help"])
    assert "--gel T [RATIO" in capsys.readouterr().out
    assert main(["new", "curve.csv", "--gel", "1", "2", "3", "--ball", "1"]) == 2
    assert "--gel 1 2 3: --gel T [RATIO] is expected" in capsys.readouterr().err


def test_a_file_is_handed_over_by_its_path(folder, monkeypatch, capsys):
    asked = []

    class Asks:
        def options(self):
            return (Option("scan", ("FILE",), ("file",), "a file"),)

        def first_settings(self, given, depths):
            asked.append(given["scan"])
            raise ValueError("enough")

        def first_parameters(self, settings, depth, force): ...

    assert capability(Asks(), NewStudies) is not None
    monkeypatch.setattr("rso.evaluation.adapters.load_backend", lambda *a, **k: Asks())
    (folder / "body.stl").write_text("solid")
    (folder / "studies").mkdir()
    assert main(["new", "curve.csv", "--scan", "body.stl", "--out", "studies/study.toml"]) == 2
    assert asked == [(str(folder / "body.stl"),)]
    assert main(["new", "curve.csv", "--scan", "none.stl"]) == 2
    assert "--scan none.stl: there is no such file" in capsys.readouterr().err


def test_a_study_holds_the_path_of_a_file_as_it_finds_it(folder):
    (folder / "tip.csv").write_text("r_mm,z_mm\n" + "".join(f"{0.02 * k},{0.5 * (0.02 * k) ** 2}\n" for k in range(40)))
    (folder / "studies").mkdir()
    given = {"slab": (5.0,), "profile": (str(folder / "tip.csv"),)}
    text = study_text(folder / "studies" / "study.toml", BACKEND, NewTest(given), ["curve.csv"])
    assert tomllib.loads(text)["backend"]["settings"]["indenter"] == {"shape": "profile", "file": "../tip.csv"}


@pytest.mark.parametrize(
    ("given", "indenter", "guess"),
    [
        ({"flat": (2.0,)}, {"shape": "flat", "radius": 2.0, "fillet": 0.1}, "its fillet"),
        ({"flat": (2.0, 0.2)}, {"shape": "flat", "radius": 2.0, "fillet": 0.2}, ""),
        ({"cone": (60.0,)}, {"shape": "cone", "half_angle": 60.0, "tip_radius": 0.03}, "the radius of its tip"),
        ({"cone": (60.0, 0.1)}, {"shape": "cone", "half_angle": 60.0, "tip_radius": 0.1}, ""),
    ],
)
def test_each_indenter_has_its_options_and_what_was_left_out_is_a_guess(folder, given, indenter, guess):
    text = study_text(folder / "study.toml", BACKEND, NewTest({"slab": (5.0,), **given}), ["curve.csv"])
    assert tomllib.loads(text)["backend"]["settings"]["indenter"] == indenter
    (line,) = [v for v in text.splitlines() if v.startswith("indenter")]
    assert line.partition("# <- ")[2].startswith(guess) and ("<-" in line) is bool(guess)


@pytest.mark.parametrize(("deepest", "tip"), [(0.002, 1e-4), (4.0, 0.2)])
def test_a_tip_that_nobody_said_goes_with_the_depth_of_the_record(folder, deepest, tip):
    rows = "".join(f"{deepest * k / 20!r},{1e-3 * (k / 20) ** 2!r}\n" for k in range(1, 21))
    (folder / "curve.csv").write_text("depth_mm,Fz_N\n" + rows)
    text = study_text(folder / "study.toml", BACKEND, NewTest({"half-space": (), "cone": (60.0,)}), ["curve.csv"])
    assert tomllib.loads(text)["backend"]["settings"]["indenter"]["tip_radius"] == tip
    (line,) = [v for v in text.splitlines() if v.startswith("indenter")]
    assert "a twentieth of the depth of the record" in line


def test_the_range_of_a_slab_is_about_the_modulus_of_a_layer(folder):
    """Forces by Dimitriadis' series at a thickness of 5 R, where its fourth order is below a percent: not Hertz's."""
    R, h, mu = 1.0, 5.0, 0.01
    rows = []
    for k in range(1, 11):
        d = 0.01 * k
        x = (R * d) ** 0.5 / h
        factor = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4
        rows.append(f"{d:.3f},{16 / 3 * mu * R**0.5 * d**1.5 * factor:.9g}")
    (folder / "curve.csv").write_text("depth_mm,Fz_N\n" + "\n".join(rows) + "\n")
    text = study_text(folder / "study.toml", BACKEND, NewTest({"slab": (h,), "ball": (R,)}), ["curve.csv"])
    mu_ = tomllib.loads(text)["parameters"]["mu"]
    low, high = (float(mu_[k].split()[0]) for k in ("low", "high"))
    assert (low * high) ** 0.5 == pytest.approx(10.0, rel=0.02)  # two digits are written; Hertz alone is 6 % above


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("depth", [[0.2], [0.1, 0.2], np.linspace(0.12, 0.2, 20)], ids=["one", "two", "deep ones"])
def test_readings_that_are_all_deep_give_a_range_too(folder, depth):
    """None lies in the shallow half: a modulus of Hertz's half-space, 16/3 μ √R d^1.5, not of nothing."""
    rows = "".join(f"{d:.4f},{16 / 3 * 0.01 * 10.0**0.5 * d**1.5:.9g}\n" for d in depth)
    (folder / "curve.csv").write_text("depth_mm,Fz_N\n" + rows)
    given = NewTest({"half-space": (), "ball": (10.0,)})
    mu = tomllib.loads(study_text(folder / "study.toml", BACKEND, given, ["curve.csv"]))["parameters"]["mu"]
    low, high = (float(mu[k].split()[0]) for k in ("low", "high"))
    assert (low * high) ** 0.5 == pytest.approx(10.0, rel=0.03)


def test_a_plate_on_a_puck_has_a_range_about_its_modulus(folder):
    """Uniform compression by hand: F = π a² μ (λ⁻² − λ), neo-Hooke, incompressible, to a tenth of the height."""
    mu, a, h = 2.5, 8.0, 6.0  # MPa: a rubber, beyond any wide range
    depth = np.linspace(0.0, 0.6, 25)
    stretch = 1.0 - depth / h
    force = np.pi * a**2 * mu * (stretch**-2 - stretch)
    rows = "".join(f"{u:.4f},{f:.6f}\n" for u, f in zip(depth, force, strict=True))
    (folder / "curve.csv").write_text("depth_mm,Fz_N\n" + rows)
    given = {"puck": (a, h), "plate": ()}
    found = tomllib.loads(study_text(folder / "study.toml", BACKEND, NewTest(given), ["curve.csv"]))["parameters"]
    low, high = (float(found["mu"][end].split()[0]) for end in ("low", "high"))
    assert found["mu"]["low"].endswith("kPa")
    assert (low * high) ** 0.5 == pytest.approx(1e3 * mu, rel=0.08)  # it stiffens by 5 % to half the way; two digits


@pytest.mark.parametrize("endless", [{"slab": (2.0,)}, {"half-space": ()}])
def test_a_plate_on_a_body_without_an_end_is_refused(folder, endless):
    """Its force would be that of the width that the mesh happens to have."""
    with pytest.raises(ValueError, match=r'indenter.shape = "plate": .* no end to the sides.* "cylinder" or "block"'):
        study_text(folder / "study.toml", BACKEND, NewTest({**endless, "plate": ()}), ["curve.csv"])
