"""[uncertainty]: what a study states may be off, and the intervals of its parameters say so.

The backend is the closed form of tests/rso/indentation_backend.py, so that an oracle has its derivatives by hand.
"""

import dataclasses
import json

import indentation_backend
import numpy as np
import pytest
import sample_studies as studies
import sloped_backend

from rso.calibration.plan import make_plan
from rso.calibration.stated_settings import exact_dimensions
from rso.calibration.uncertain_inputs import said_of_inputs
from rso.core.distributions import normal_ppf
from rso.study.errors import StudyError
from rso.study.loader import load_study

R, U = 3.0, 0.09  # mm: the radius of the sphere, which nobody measures better than to 3 %
ONE = 'mu = { low = "6 kPa", high = "20 kPa", scale = "log" }\nD1 = { value = 60 }'
NOISE = 2e-3  # N, so much that no reading shows by its shape what the radius was
TOP = studies.SECTIONS["[experiments]"].replace("0.02 mN", "2 mN")
TWO = (
    TOP + '\n[[experiments]]\nname = "thin"\nrole = "fit"\ndata = "thin.csv"\nsettings = { thickness = 6 }\n'
    'noise = { Fz = "2 mN", contact = "0 mm", gain = 0, correlation = "0 mm" }'
)
DIRECT = {
    "backend": 'use = "sloped_backend:BACKEND"',
    "search": 'method = "gauss_newton"',
    **dict.fromkeys(("doe", "surrogate", "sensitivity")),
}


def identified(folder, **changes):
    return studies.run(folder, **{**studies.QUICK, "parameters": ONE, "[experiments]": TOP, **changes})[
        "identification"
    ]


def curve(radius, thickness=studies.THICKNESS, mu=studies.MU):
    """The forces of the truth at the readings, by the closed form itself."""
    h = np.linspace(0, 2.0, 21)[1:]
    return indentation_backend.force(mu, studies.D1, h, thickness, radius)


def slope(thickness=studies.THICKNESS):
    """The derivative of the forces by ln mu."""
    high, low = (curve(R, thickness, studies.MU * f) for f in (1.001, 0.999))
    return (high - low) / np.log(1.001 / 0.999)


def shift(thickness=studies.THICKNESS):
    return 0.5 * (curve(R + U, thickness) - curve(R - U, thickness))


def deviation(J, errors, noise=NOISE):
    """Standard deviation of ln mu by generalised least squares with slopes J (n,)."""
    C = noise**2 * np.eye(len(J)) + sum((np.outer(s, s) for s in errors), np.zeros((len(J),) * 2))
    return 1.0 / np.sqrt(J @ np.linalg.solve(C, J))


def half_width(found):
    low, high = found["parameters"][0]["interval"]
    return 0.5 * np.log(high / low)


@pytest.mark.parametrize("changes", [{}, DIRECT], ids=["surfaces", "gauss_newton"])
def test_an_interval_holds_what_a_stated_radius_may_be_off_by(tmp_path, changes):
    found = identified(tmp_path, uncertainty=f'radius = "{1e3 * U:g} um"', **changes)
    expected = normal_ppf(0.95) * deviation(slope(), [shift()])
    assert half_width(found) == pytest.approx(expected, rel=0.03)  # numerical errors of the backend count too
    (row,) = found["inputs"]
    assert (row["input"], row["unit"], row["uncertainty"]) == ("radius", "mm", pytest.approx(U))
    J, s = slope(), shift()
    C = NOISE**2 * np.eye(20) + np.outer(s, s)
    moved = J @ np.linalg.solve(C, s) / (J @ np.linalg.solve(C, J))
    assert row["moves"]["mu"] == pytest.approx(np.expm1(-moved), rel=0.02)
    assert row["share"]["mu"] == pytest.approx((moved / deviation(J, [s])) ** 2, rel=0.02)


def test_what_a_radius_moves_is_what_another_radius_would_give(tmp_path):
    """A sphere that is larger than stated has been taken for a stiffer gel."""
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    found = identified(tmp_path / "a", uncertainty=f"radius = {U}")
    other = identified(tmp_path / "b", parameters=f"{ONE}\nradius = {{ value = {R + U} }}")
    moved = other["values"]["mu"] / found["values"]["mu"] - 1.0
    assert moved < -0.01
    assert found["inputs"][0]["moves"]["mu"] == pytest.approx(moved, rel=0.1)  # other weights, and u² is 0.1 of u


def test_a_descent_that_goes_on_under_wider_errors_is_no_second_minimum(tmp_path):
    """The sphere was larger than stated, and the readings show it: the minimum moves with what the errors know."""
    quiet = studies.SECTIONS["[experiments]"].replace("top.csv", "large.csv")
    h, F = np.linspace(0, 2.0, 21)[1:], curve(R + 5 * U)
    rows = "depth_mm,Fz_N\n" + "".join(f"{u!r},{f!r}\n" for u, f in zip(h.tolist(), F.tolist(), strict=True))
    (tmp_path / "large.csv").write_text(rows)
    changes = {**studies.QUICK, **DIRECT, "parameters": ONE, "[experiments]": quiet, "uncertainty": f"radius = {U}"}
    results = studies.run(tmp_path, **changes)
    (only,) = results["descent"]["descents"]
    assert only["best"] and only["verified"]
    assert not [w for w in results["warnings"] if "minimum" in w]


def test_a_new_mesh_at_every_run_does_not_bend_the_interval_of_a_descent(tmp_path, monkeypatch):
    """Runs that lie close together differ by their meshes as much as by their values, here by 0.03 %."""
    answer = sloped_backend.Sloped.__call__

    def meshed(self, values, case):
        found = answer(self, values, case)
        force = np.asarray(found.channels["Fz"])
        rough = 1.0 + 3e-4 * np.sin(60.0 * np.log(values["D1"]) + np.arange(len(force)) / 7.0)
        return dataclasses.replace(found, channels={**found.channels, "Fz": force * rough})

    changes = {
        **studies.QUICK,
        **DIRECT,
        "[experiments]": TOP.replace("2 mN", "0.3 mN"),
        "uncertainty": "radius = 0.05",
    }
    smooth, rough = tmp_path / "smooth", tmp_path / "rough"
    for folder in (smooth, rough):
        folder.mkdir()
    expected = studies.run(smooth, **changes)["identification"]["parameters"]
    monkeypatch.setattr(sloped_backend.Sloped, "__call__", meshed)
    found = studies.run(rough, **changes)["identification"]["parameters"]
    for a, b in zip(expected, found, strict=True):
        assert b["interval"] == pytest.approx(a["interval"], rel=0.05)


def test_without_the_table_dimensions_are_exact(tmp_path):
    found = identified(tmp_path)
    assert found["inputs"] == []
    assert half_width(found) == pytest.approx(normal_ppf(0.95) * deviation(slope(), []), rel=0.05)
    assert half_width(found) < 0.8 * normal_ppf(0.95) * deviation(slope(), [shift()])


def test_an_error_that_two_tests_share_does_not_average_out_and_one_of_each_does(tmp_path):
    thin = studies.measured(thickness=6.0)
    shared, own = tmp_path / "shared", tmp_path / "own"
    for folder in (shared, own):
        folder.mkdir()
        (folder / "thin.csv").write_text(thin)
    a = identified(shared, **{"[experiments]": TWO}, uncertainty=f"radius = {U}")
    both = TWO.replace('role = "fit"', f'role = "fit"\nuncertainty = {{ radius = {U} }}')
    b = identified(own, **{"[experiments]": both})
    J, zero = np.concatenate([slope(), slope(6.0)]), np.zeros(20)
    together = [np.concatenate([shift(), shift(6.0)])]
    apart = [np.concatenate([shift(), zero]), np.concatenate([zero, shift(6.0)])]
    z = normal_ppf(0.95)
    assert half_width(a) == pytest.approx(z * deviation(J, together), rel=0.05)
    assert half_width(b) == pytest.approx(z * deviation(J, apart), rel=0.05)
    assert half_width(a) > 1.15 * half_width(b)
    own = [list(d["fitted"]["inputs"]) for d in b["data"]]
    assert own == [["top: radius"], ["thin: radius"]]  # a curve is moved by its own error
    assert [r["experiment"] for r in a["inputs"]] == [""] and [r["experiment"] for r in b["inputs"]] == ["top", "thin"]


def test_tests_without_an_uncertainty_of_their_own_share_that_of_the_study(tmp_path):
    """One test in three had another sphere: the sphere of the other two is still one."""
    for name, thickness in (("thin", 6.0), ("third", 7.0)):
        (tmp_path / f"{name}.csv").write_text(studies.measured(thickness=thickness))
    third = TWO.removeprefix(TOP).replace("thin", "third").replace("= 6", "= 7")
    three = TWO + third.replace('role = "fit"', f'role = "fit"\nuncertainty = {{ radius = {U} }}')
    found = identified(tmp_path, **{"[experiments]": three}, uncertainty=f"radius = {U}")
    zero = np.zeros(20)
    errors = [np.concatenate([shift(), shift(6.0), zero]), np.concatenate([zero, zero, shift(7.0)])]
    J = np.concatenate([slope(), slope(6.0), slope(7.0)])
    assert half_width(found) == pytest.approx(normal_ppf(0.95) * deviation(J, errors), rel=0.05)
    assert [r["experiment"] for r in found["inputs"]] == ["top, thin", "third"]


def test_runs_beside_the_stated_values_are_written_with_units(tmp_path):
    identified(tmp_path, uncertainty=f"radius = {U}")
    header = (tmp_path / "results/runs.csv").read_text("utf-8").splitlines()[0]
    assert "radius [mm]" in header.split(",")


DEEP = 'repair = false\npopulation = 8\ngenerations = 4\ncandidates = 1\ntargets = [{ experiment = "top", depth = 2 }, \
{ experiment = "thin", depth = 2 }]'


@pytest.mark.parametrize(
    ("off", "stated", "met"),
    [(1.0, f"radius = {10 * U}", True), (1.0, None, False), (0.0, None, True), (20.0, f"radius = {U}", False)],
)
@pytest.mark.parametrize("changes", [{"search": DEEP}, DIRECT], ids=["surfaces", "gauss_newton"])
def test_targets_are_met_within_what_the_inputs_may_be_off_by(tmp_path, off, stated, met, changes):
    """One sphere, larger than stated, in a thick and a thin layer: no μ has the forces of both."""
    h, truth = np.linspace(0, 2.0, 21)[1:], R + off * 10 * U
    for name, thickness in (("top", studies.THICKNESS), ("thin", 3.0)):
        rows = zip(h.tolist(), curve(truth, thickness).tolist(), strict=True)
        (tmp_path / f"{name}.csv").write_text("depth_mm,Fz_N\n" + "".join(f"{u!r},{f!r}\n" for u, f in rows))
    both = TWO.replace("2 mN", "0.2 mN").replace("= 6", "= 3")
    found = studies.run(
        tmp_path,
        **{**studies.QUICK, "parameters": ONE, "[experiments]": both, "uncertainty": stated, **changes},
    )
    assert found["searches"][0]["met"] == met
    assert (found["exit_code"] == 6) == (not met)
    errors = [t.get("input_error", 0.0) for t in found["searches"][0]["targets"]]
    assert all(e > 0.0 for e in errors) == (stated is not None)


SLABS = """
[[experiments]]
name = "thin"
role = "fit"
data = "top.csv"
settings = {{ specimen = {{ shape = "slab", thickness = 6.0 }} }}
{}
[[experiments]]
name = "tall"
role = "fit"
data = "top.csv"
settings = {{ specimen = {{ shape = "cylinder", radius = 10.0, height = 12.0 }} }}
"""


@pytest.mark.parametrize(
    ("own", "table", "exact", "names"),
    [
        ("", "", ["delta_thickness", "delta_R", "delta_radius", "delta_height"], []),
        ("", "delta_thickness = 0.1\ndelta_R = 0.1", ["delta_radius", "delta_height"], ["delta_thickness", "delta_R"]),
        (
            "uncertainty = { delta_R = 0.1 }",
            "",
            ["delta_thickness", "delta_R of tall", "delta_radius", "delta_height"],
            ["thin: delta_R"],
        ),
    ],
)
def test_a_specimen_may_be_that_of_each_experiment(tmp_path, own, table, exact, names):
    """A dimension is one of the study if one of its experiments has it: settings of the study need not be whole."""
    (tmp_path / "top.csv").write_text(studies.measured())
    file = tmp_path / "study.toml"
    file.write_text(
        '[study]\ntitle = "slabs"\nseed = 0\n[backend]\nuse = "fem_backend.backend:BACKEND"\n[backend.settings]\n'
        'indenter = { shape = "sphere", radius = 3.0 }\nsupport = { kind = "bonded" }\nmesh = { level = "coarse" }\n'
        f'[parameters]\nmu = {{ low = "4 kPa", high = "25 kPa" }}\nD1 = {{ value = 10 }}\n[uncertainty]\n{table}\n'
        + SLABS.format(own)
    )
    plan = make_plan(load_study(file))
    assert set(exact_dimensions(plan)) == set(exact)
    assert [i.name for i in plan.resolved.inputs] == names
    assert len(said_of_inputs(plan)) == len(names) + 1


def test_a_side_beyond_the_bounds_is_left_out(tmp_path):
    """The radius of this backend is at least 0.5 mm: one standard uncertainty below is not modelled."""
    found = identified(tmp_path, uncertainty="radius = 2.7")
    upwards = curve(R + 2.7) - curve(R)
    assert half_width(found) == pytest.approx(normal_ppf(0.95) * deviation(slope(), [upwards]), rel=0.05)


def test_an_input_without_an_answer_counts_as_exact_and_that_is_said(tmp_path, monkeypatch):
    answer = indentation_backend.Layer.__call__

    def no(self, values, case):
        if values.get("radius", R) != R:
            raise indentation_backend.SimulationFailed("inversion", "another radius")
        return answer(self, values, case)

    monkeypatch.setattr(indentation_backend.Layer, "__call__", no)
    results = studies.run(tmp_path, **studies.QUICK, parameters=ONE, uncertainty=f"radius = {U}")
    assert results["identification"]["inputs"] == []
    (said,) = [w for w in results["warnings"] if w.startswith("uncertainty:")]
    assert "radius counts as exact" in said and "another radius" in said


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('radius = "0 mm"', ("uncertainty.radius", "'0 mm'", "above 0 is expected, up to 19.5 mm")),
        ('radius = "3 N"', ("uncertainty.radius", "'3 N'", "mm")),
        ("mu = 0.001", ("uncertainty.mu = 0.001", "is a parameter that is fitted")),
        ("radios = 0.1", ("uncertainty.radios", "did you mean 'radius'? choose from D1, radius")),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(tmp_path, table, words):
    with pytest.raises(StudyError) as error:
        identified(tmp_path, uncertainty=table)
    assert "study.toml:" in str(error.value) and all(w in str(error.value) for w in words)


def test_ladder_and_next_give_the_same_interval(tmp_path):
    tables = {
        "ladder": 'levels = [{ name = "study" }]\nruns = 8',
        "next": "truths = { mu = [0.012] }\nruns = 8\ndraws = 10",
    }
    changes = {**studies.QUICK, "parameters": ONE, "[experiments]": TOP, "uncertainty": f"radius = {U}", **tables}
    file = studies.write(tmp_path, **changes)
    found = studies.run(tmp_path, **changes)["identification"]
    for way in ("ladder", "next"):
        done = studies.command(way, file)
        assert done.returncode == 0, done.stderr
    ladder, after = (json.loads((tmp_path / "results" / f"{n}.json").read_text("utf-8")) for n in ("ladder", "next"))
    for rows in (ladder["levels"][0]["parameters"], after["fits"][-1]["parameters"]):
        (low, high) = rows[0]["interval"]
        assert 0.5 * np.log(high / low) == pytest.approx(half_width(found), rel=0.02)


def test_a_radius_that_the_readings_show_is_found(tmp_path):
    """The sphere was one standard uncertainty larger than stated, and the noise is small enough to see it."""
    quiet = studies.SECTIONS["[experiments]"]
    h = np.linspace(0, 2.0, 21)[1:].tolist()
    F = (curve(R + U) + 2e-5 * np.random.default_rng(0).standard_normal(20)).tolist()
    rows = "depth_mm,Fz_N\n" + "".join(f"{u!r},{f!r}\n" for u, f in zip(h, F, strict=True))
    found = {}
    for name, table in (("exact", None), ("uncertain", f"radius = {U}")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "large.csv").write_text(rows)
        changes = {"[experiments]": quiet.replace("top.csv", "large.csv"), "uncertainty": table}
        found[name] = identified(tmp_path / name, **changes)
    low, high = found["uncertain"]["parameters"][0]["interval"]
    assert low < studies.MU < high
    assert found["uncertain"]["data"][0]["fitted"]["inputs"]["radius"] == pytest.approx(1.0, abs=0.3)
    low, high = found["exact"]["parameters"][0]["interval"]
    assert not low < studies.MU < high and found["exact"]["data"][0]["fitted"]["inputs"] == {}


def test_several_stated_values_of_one_input_are_refused(tmp_path, monkeypatch):
    nominal = lambda self, settings: {"radius": float(settings.get("remark", R))}  # noqa: E731
    monkeypatch.setattr(indentation_backend.Layer, "nominal", nominal, raising=False)
    (tmp_path / "thin.csv").write_text(studies.measured(thickness=6.0))
    both = TWO.replace("thickness = 6 }", "thickness = 6, remark = 4 }")
    with pytest.raises(StudyError, match=r"uncertainty\.radius: experiments state several values"):
        identified(tmp_path, **{"[experiments]": both}, uncertainty=f"radius = {U}")


def test_a_repeat_of_one_specimen_is_expected_to_show_nothing_of_its_dimensions(tmp_path):
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    exact = identified(tmp_path / "a")["gains"]
    found = identified(tmp_path / "b", uncertainty=f"radius = {U}")["gains"]
    assert [g["test"] for g in found] == [g["test"] for g in exact]
    for a, b in zip(exact, found, strict=True):
        for when in ("before", "after"):
            assert b[when]["mu"] == pytest.approx(a[when]["mu"], rel=0.02)
