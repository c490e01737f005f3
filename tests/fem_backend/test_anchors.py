"""Anchors: starts near the answer, of second order in Poisson's ratio, that do not show in it."""

from __future__ import annotations

import dataclasses
import hashlib
import io

import numpy as np
import pytest

from fem_backend import closed_forms
from fem_backend.accuracy import warm_starts
from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import experiment
from fem_backend.simulation.knobs import Knobs
from rso.contract import Case, Programme, object_path

SMALL = {"mesher": "mapped", "n": 6, "slip": 0.3}
CASE = Case("anchored", Programme.ramp((0.75, 1.5)), {"mesh": SMALL})
BOWL = {"support": {"kind": "bowl", "clearance": 0.5}}


def placed(values, case, folder):
    """The case with its anchor, and where that lies."""
    made = BACKEND.make(BACKEND.recipes(values, case)["anchor"])
    sha = hashlib.sha256(made).hexdigest()
    path = object_path(folder, sha)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(made)
    return dataclasses.replace(case, artefacts={"anchor": sha}, objects=str(folder)), path


@pytest.mark.parametrize(
    ("values", "settings"),
    [
        ({"D1": 12.0}, {}),
        ({"D1": 1.2}, {}),
        ({"D1": 60.0, "C20": 2e-3}, {}),
        ({"D1": 12.0, "bowl_friction": 0.0}, BOWL),
        ({"D1": 12.0}, {"multipliers": False}),
    ],
    ids=["same law", "less compressible", "stiffens", "bowl", "penalty"],
)
def test_the_start_does_not_show_in_an_answer(values, settings, tmp_path):
    """All channels as from a cold run; Newton is converged to 1e-9 of the force (1e-6 without multipliers)."""
    values, case = {"mu": 0.01, **values}, dataclasses.replace(CASE, settings={**CASE.settings, **settings})
    cold, warm = BACKEND(values, case), BACKEND(values, placed(values, case, tmp_path)[0])
    for name, value in cold.channels.items():
        rtol = 1e-8 if settings.get("multipliers", True) else 1e-5
        np.testing.assert_allclose(warm.channels[name], value, rtol=rtol, atol=rtol * np.abs(value).max(), err_msg=name)
    assert warm.info["iterations"] < cold.info["iterations"]


def test_starts_are_of_second_order_in_the_ratio(tmp_path):
    """At half the distance in ν a quarter of the error, at every stage; a half along no tangent (the control)."""
    _, path = placed({"mu": 1.0, "D1": 0.2}, CASE, tmp_path)
    own = closed_forms.poisson_ratio(1.0, 10.0)  # of the anchor
    errors = {True: [], False: []}
    for away in (0.04, 0.02, 0.01):
        D1 = 3.0 * (1.0 - 2.0 * (own - away)) / (1.0 + own - away)  # μ = 1, K = 2/D₁
        assert closed_forms.poisson_ratio(1.0, 2.0 / D1) == pytest.approx(own - away, abs=1e-12)
        run = BACKEND.solve({"mu": 1.0, "D1": D1}, CASE)
        for tangent in errors:
            offer = warm_starts.anchor_guess(str(path), run.model, own - away if tangent else own)
            true = [[stage.equilibrium.evaluation.u for stage in p.stages] for p in run.result.points]
            off = np.array([offer(p.travel) for p in run.result.points]) - np.array(true)
            errors[tangent].append(np.abs(off).max((0, 2, 3)))
    order = {k: np.log2(np.array(e)[:-1] / np.array(e)[1:]) for k, e in errors.items()}
    assert order[True].shape == (2, 2) and (order[True] > 1.7).all() and (order[True] < 2.3).all()
    np.testing.assert_allclose(order[False], 1.0, atol=0.15)  # 0.89, 0.93: it tends to 1
    assert errors[True][0].max() < 0.2 * errors[False][0].max()


def test_an_anchor_says_nothing_where_it_knows_nothing(tmp_path):
    """Another travel, another mesh, and travels that its own body did not reach."""
    case, path = placed({"mu": 0.01, "D1": 12.0}, CASE, tmp_path)
    settings = experiment.read_settings({"mesh": {**SMALL, "n": 7}})
    knobs = Knobs(mu=0.01, D1=12.0)
    other = modelling.model_for(settings, knobs, modelling.placement_of(settings, knobs), None)
    assert warm_starts.anchor_guess(str(path), other, 0.4)(1.5) is None
    own = BACKEND.solve({"mu": 0.01, "D1": 12.0}, case).model
    offer = warm_starts.anchor_guess(str(path), own, 0.4)
    assert offer(1.0) is None and len(offer(1.5)) == 2
    deep = dataclasses.replace(CASE, programme=Programme.ramp((1.0, 30.0)))
    made = BACKEND.make(BACKEND.recipes({"mu": 0.01, "D1": 12.0}, deep)["anchor"])
    with np.load(io.BytesIO(made)) as data:
        assert list(data["travel"]) == [1.0] and data["u"].shape == data["slope"].shape == (1, 2, *own.body.nodes.shape)
