"""What was run before, of the same model, joins what a changed study learns from."""

import dataclasses

import pytest
import sample_studies as studies

from rso.calibration.joined_runs import find_stored_points
from rso.calibration.plan import make_plan
from rso.calibration.stored_runs import stored_points, stored_responses
from rso.evaluation.store import RunStore
from rso.study.loader import load_study

# What joins is all that is asked here: one target, no sensitivities.
SMALL = {
    "sensitivity": "sobol = false\nlocal = false",
    "search": "repair = false\npopulation = 8\ngenerations = 4\ncandidates = 1\n"
    'targets = [{ experiment = "top", depth = 2 }]',
}
FULL = SMALL | {"doe": "runs = 12\nheld_out = 3\nreduce = false"}
NARROW = 'mu = {{ low = "6 kPa", high = "{} kPa", scale = "log" }}\nD1 = {{ low = 10, high = 150, scale = "log" }}'


def of(found, purpose):
    return [r for r in found["runs"] if r["purpose"] == purpose]


def within(values, high):
    return 0.006 <= values["mu"] <= high and 10 <= values["D1"] <= 150


@pytest.fixture(scope="module")
def changed(tmp_path_factory):
    """A study, and the same after its range was changed."""
    folder = tmp_path_factory.mktemp("changed")
    first = studies.run(folder, **FULL)
    return folder, first, studies.run(folder, **FULL, parameters=NARROW.format(16))


def test_finished_runs_within_the_new_ranges_are_learnt_too(changed):
    _, first, second = changed
    before = {tuple(r["values"].items()) for r in first["runs"] if within(r["values"], 0.016)}
    stored = {tuple(r["values"].items()) for r in of(second, "stored")}
    assert len(stored) > 8 and stored == before
    assert len(of(second, "design")) == 12 and all(s["n"] >= 12 + len(stored) for s in second["surrogates"])
    assert len(second["joined"]["points"]) == len(stored) and second["joined"]["outside"] > 0
    assert f"{len(stored)} earlier runs of this model" in second["joined"]["story"]
    assert second["exit_code"] == 0


def test_the_first_run_of_a_study_has_nothing_to_join(changed):
    assert of(changed[1], "stored") == [] and changed[1]["joined"]["story"] == ""


def test_going_on_changes_nothing(changed):
    """What joins is noted when a study begins: its own later runs do not."""
    folder, _, second = changed
    again = studies.run(folder, **FULL, parameters=NARROW.format(16))
    assert studies.timeless(again) == studies.timeless(second)
    assert again["counts"]["from_store"] == again["counts"]["fe_runs"]


def test_what_joins_does_not_hang_on_the_order_of_storing(changed, tmp_path):
    """With more jobs, or a faster machine, runs are stored in another order."""
    plan = make_plan(load_study(studies.write(changed[0], **FULL)))
    with RunStore(changed[0] / "results", read_only=True) as store, RunStore(tmp_path) as other:
        for row in reversed(store.rows()):
            other.put_done(store.get(row.key))
        known = stored_points(plan, store)
        assert (
            len(known) > 20
            and stored_points(plan, other) == known
            and find_stored_points(plan, other) == find_stored_points(plan, store)
        )
        assert (
            stored_responses(other, known[3])[0].channels["Fz"].tolist()
            == stored_responses(store, known[3])[0].channels["Fz"].tolist()
        )
    studies.write(changed[0], **FULL, parameters=NARROW.format(16))


@pytest.mark.verification
def test_a_study_that_was_killed_goes_on_as_it_would_have(changed, tmp_path):
    first = studies.run(tmp_path, **FULL)
    plan = make_plan(load_study(studies.write(tmp_path, **FULL, parameters=NARROW.format(16))))
    left = 9  # simulations that it may still do

    class Killed(studies.Inline):
        def submit(self, fn, /, *args, **kwargs):
            nonlocal left
            left -= 1
            if left < 0:
                raise KeyboardInterrupt
            return super().submit(fn, *args, **kwargs)

    from rso.calibration.pipeline import run_study

    with RunStore(tmp_path / "results") as store, pytest.raises(KeyboardInterrupt):
        run_study(plan, store, Killed(), tmp_path / "results", command="test", jobs=1)
    resumed = studies.run(tmp_path, **FULL, parameters=NARROW.format(16))
    assert studies.timeless(resumed) == studies.timeless(changed[2]) and first["exit_code"] == 0


def test_another_model_does_not_join(changed):
    folder = changed[0]
    with RunStore(folder / "results", read_only=True) as store:
        plan = make_plan(load_study(studies.write(folder, **FULL)))
        assert len(find_stored_points(plan, store).points) > 20
        thinner = make_plan(load_study(studies.write(folder, **FULL, backend__settings="thickness = 7")))
        found = find_stored_points(thinner, store)
        assert found.points == () and found.other == len(store.rows()) and "other settings" in found.story
        newer = dataclasses.replace(plan, backend=type("Newer", (type(plan.backend),), {"numerics": 99})())
        assert find_stored_points(newer, store).points == ()
    studies.write(folder, **FULL, parameters=NARROW.format(16))


def test_by_similarity_runs_of_another_modulus_join(tmp_path):
    """Ranges of another middle have another modulus of reference: what was run at the old one stands for the new."""
    studies.run(tmp_path, **SMALL)
    found = studies.run(tmp_path, **SMALL, parameters=NARROW.format(18))
    assert found["design"]["similarity"]["applied"] and len(of(found, "stored")) > 5
    assert found["exit_code"] == 0
    assert all(s["cross_validation"]["q2"] > 0.99 for s in found["surrogates"] if s["output"].startswith("top:Fz@2"))
