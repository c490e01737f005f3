"""Loading and unloading of one record, fitted together: what relaxes shows in the loop between them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import sample_studies as studies
import ting_backend

from rso.calibration.confirmed_optimum import fitted_readings
from rso.calibration.pipeline import run_study
from rso.calibration.plan import make_plan
from rso.data import Measurement, Repeat
from rso.data.loading_rate import dwell_time, lost_work, unloading_pace
from rso.evaluation.store import RunStore
from rso.inference.likelihood import Model, split_common_errors
from rso.next_experiment import experiments, study_design
from rso.optimal_design import PossibleExperiment
from rso.study.cases import Turn, programme_back
from rso.study.errors import StudyError
from rso.study.loader import load_study

MU, G, TAU = 0.01, 0.4, 4.0
WAY = np.array([0.0, 4.8, 6.8, 8.8]), np.array([0.0, 1.2, 1.2, 0.0])  # there, a rest, and back faster
QUIET = 'noise = { Fz = "0.2 mN", gain = 0.02, contact = "10 um" }'
BOTH = f"""
[study]
title = "loop"
seed = 1
units = "N-mm-MPa-s"
[backend]
use = "ting_backend:BACKEND"
[parameters]
mu = {{ low = 0.004, high = 0.03, scale = "log" }}
g = {{ low = 0.05, high = 0.8 }}
tau = {{ low = 0.5, high = 40, scale = "log" }}
[[experiments]]
name = "there"
role = "fit"
data = "loop.csv"
{QUIET}
[[experiments]]
name = "back"
role = "fit"
data = "loop.csv"
branch = "unloading"
{QUIET}
[search]
method = "gauss_newton"
derivatives = "differences"
[report]
html = false
pdf = false
"""


@pytest.fixture
def folder(tmp_path):
    """A record without readings at rest, as many instruments write it."""
    there, back = np.linspace(0.0, 4.8, 25)[1:], np.linspace(6.8, 8.8, 25)[:-1]
    time = np.concatenate([there, back])
    F = ting_backend.force(MU, G, TAU, time, WAY) + np.random.default_rng(2).normal(0.0, 2e-4, len(time))
    rows = zip(time.tolist(), np.interp(time, *WAY).tolist(), F.tolist(), strict=True)
    (tmp_path / "loop.csv").write_text(
        "time_s,depth_mm,Fz_N\n" + "".join(f"{t:.4f},{u:.5f},{f:.6f}\n" for t, u, f in rows)
    )
    (tmp_path / "study.toml").write_text(BOTH)
    return tmp_path


def identified(folder):
    plan = make_plan(load_study(folder / "study.toml"))
    with RunStore(folder / "results") as store:
        return run_study(plan, store, studies.Inline(), folder / "results", command="test", jobs=1)


def test_a_loop_says_how_much_relaxes_and_how_fast(folder):
    results = identified(folder)
    found = {p["parameter"]: p["interval"] for p in results["identification"]["parameters"]}
    for name, truth, ratio in (("mu", MU, 1.15), ("g", G, 1.4), ("tau", TAU, 1.7)):
        low, high = found[name]
        assert low <= truth <= high and high < ratio * low
    assert not [w for w in results["warnings"] if "separable" in w]


@pytest.mark.verification
def test_loading_alone_does_not(folder):
    """Negative control."""
    head, _, rest = BOTH.partition('[[experiments]]\nname = "back"')
    (folder / "study.toml").write_text(head + rest[rest.index("[search]") :])
    results = identified(folder)
    assert [w for w in results["warnings"] if "separable" in w]
    assert not results["determined"]["tau"]["determined"]


def test_both_share_contact_and_gain_of_their_record(folder):
    plan = make_plan(load_study(folder / "study.toml"))
    data = [d for _, d in fitted_readings(plan)]
    assert [set(d.shared) for d in data] == [{"there: contact", "there: gain"}] * 2
    assert split_common_errors(data)[1].shape[1] == 2


def test_the_simulated_way_is_the_recorded_one(folder):
    plan = make_plan(load_study(folder / "study.toml"))
    p = plan.cases[plan.case_of["back"]].programme
    np.testing.assert_allclose(p.time_s, WAY[0], rtol=0.05)
    np.testing.assert_allclose(p.travel_mm[:3], WAY[1][:3], rtol=1e-9)
    (r,) = plan.study.measurement("back").repeats
    assert dwell_time(r, 0.25) == pytest.approx(2.0, abs=0.2)  # within a reading
    assert unloading_pace(r, 0.25) == pytest.approx(2.4, rel=0.02)


def test_a_way_back_begins_at_the_deepest_point_of_the_record():
    p = programme_back((0.2, 1.0), Turn(0.5, 1.2, 3.0, 2.0))
    np.testing.assert_allclose(p.time_s, [0.0, 2.4, 5.4, 6.6])
    np.testing.assert_allclose(np.interp(p.asked_s, p.time_s, p.travel_mm), [1.2, 1.0, 0.2])


def test_the_next_test_knows_the_unloading(folder):
    """The readings of a branch are asked for where they were taken, also those of the way back."""
    plan = make_plan(load_study(folder / "study.toml"))
    _, item = experiments.done(plan)
    (block,) = item.blocks
    depth = np.array([u for u, _ in study_design._read_of(item, block.places[0])])
    assert len(depth) >= 8 and np.all(np.diff(depth) > 0.0)
    assert depth[0] <= block.depth.min() and depth[-1] >= block.depth.max()


def test_a_record_is_repeated_as_a_whole(folder):
    """Its branches are one test, whose contact and gain are the same in both; two records stay two tests."""
    plan = make_plan(load_study(folder / "study.toml"))
    have = []
    for item in experiments.done(plan):
        (block,) = item.blocks
        model = Model(plan.box, lambda X, like=block.data.value: np.zeros((len(X), len(like))))
        test = PossibleExperiment(item.name, model, lambda x, C=block.data.covariance: C)
        have.append(SimpleNamespace(item=item, experiment=test))
    (one,) = study_design.records(plan, have)
    x = np.full(3, 0.5)
    there, back = (v.item.blocks[0].data for v in have)
    n = len(there.value)
    assert one.name == "there and back" and one.model.predict(x[None]).shape == (1, n + len(back.value))
    cross = sum(np.outer(there.shared[n], back.shared[n]) for n in ("there: contact", "there: gain"))
    np.testing.assert_allclose(one.covariance(x)[:n, n:], cross, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(one.covariance(x)[:n, :n], there.covariance)
    assert np.all(np.linalg.eigvalsh(one.covariance(x)) > 0.0)

    lines = (folder / "loop.csv").read_text().splitlines(keepends=True)
    (folder / "other.csv").write_text("".join(lines[:-1]))
    (folder / "study.toml").write_text(
        BOTH.replace('"back"\nrole = "fit"\ndata = "loop', '"back"\nrole = "fit"\ndata = "other')
    )
    plan = make_plan(load_study(folder / "study.toml"))
    assert [e.name for e in study_design.records(plan, have)] == ["there", "back"]


@pytest.mark.parametrize(("back", "lost"), [(1.5, 0.0), (2.5, 1.0 - 2.5 / 3.5), (4.0, 0.5)])
def test_the_work_that_is_lost_is_that_of_power_laws(back, lost):
    """∫ u^p du = 1/(p + 1): there u^{3/2}, back u^p to the same force."""
    u = np.linspace(0.0, 1.0, 400)
    depth, force = np.concatenate([u, u[::-1]]), np.concatenate([u**1.5, u[::-1] ** back])
    segment = np.array(["loading"] * 400 + ["unloading"] * 400)
    m = Measurement(Path("x.csv"), "force", (Repeat("1", depth, None, {"Fz": force}, {}, segment),), ())
    assert lost_work(m) == pytest.approx(lost, abs=1e-4)
    cut = np.r_[:400, 480:800]  # an unloading that begins at 0.8 of the depth is no whole loop
    r = Repeat("1", depth[cut], None, {"Fz": force[cut]}, {}, segment[cut])
    assert lost_work(Measurement(Path("x.csv"), "force", (r,), ())) is None


def test_a_loop_that_is_not_fitted_is_said(folder):
    head, _, rest = BOTH.partition('[[experiments]]\nname = "back"')
    (folder / "study.toml").write_text(head + rest[rest.index("[search]") :])
    plan = make_plan(load_study(folder / "study.toml"))
    assert any("of the work of loading" in words for words in plan.remarks("there"))
    (folder / "study.toml").write_text(BOTH)
    plan = make_plan(load_study(folder / "study.toml"))
    assert not any("of the work of loading" in words for words in (*plan.remarks("there"), *plan.remarks("back")))


@pytest.mark.parametrize("n", [25, 100])
def test_an_elastic_record_loses_no_work(n):
    """The deepest reading belongs to both branches, wherever the readings of the other begin and end."""
    there, back = np.linspace(0.0, 1.0, n), np.linspace(1.0, 0.05, n)[1:]
    depth = np.concatenate([there, back])
    segment = np.array(["loading"] * n + ["unloading"] * (n - 1))
    r = Repeat("1", depth, None, {"Fz": depth**1.5}, {}, segment)
    assert abs(lost_work(Measurement(Path("x.csv"), "force", (r,), ()))) < 0.002
    part = depth[n:] > 0.5  # an unloading that ends half-way is of no whole loop
    keep = np.concatenate([np.full(n, True), part])
    r = Repeat("1", depth[keep], None, {"Fz": depth[keep] ** 1.5}, {}, segment[keep])
    assert lost_work(Measurement(Path("x.csv"), "force", (r,), ())) is None


@pytest.mark.parametrize(
    ("change", "key"),
    [('preload = "5 mN"', "preload"), ('mounting = "B"', "mounting"), ('settings = { speed = "1 mm/s" }', "settings")],
)
def test_branches_of_which_the_study_says_different_things_are_no_one_record(folder, change, key):
    (folder / "study.toml").write_text(BOTH.replace('branch = "unloading"', f'branch = "unloading"\n{change}'))
    with pytest.raises(StudyError, match=f"state the same {key} in both"):
        load_study(folder / "study.toml")


def test_a_branch_to_select_by_is_none_of_the_fit(folder):
    """What is selected by must not have the errors of what is fitted."""
    study = BOTH.replace('name = "back"\nrole = "fit"', 'name = "back"\nrole = "select"')
    (folder / "study.toml").write_text(study)
    with pytest.raises(StudyError, match="state the same role in both"):
        load_study(folder / "study.toml")
