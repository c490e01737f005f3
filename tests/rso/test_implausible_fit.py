"""A fit that leaves what was stated and asks for an unlikely material determines nothing."""

from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pytest

from rso.calibration import identification_stage as stage
from rso.doe import Box
from rso.inference import Data, Misfit, Model, determine

A = np.array([[1.0, 0.3], [0.5, 1.0], [1.0, -1.0]])
ODD = "a Poisson's ratio below 0.3 is unlikely"


def fitted(at, stated_high=1.0):
    """Two parameters from three readings with errors of 1 %, in a box that was widened to twice what was stated."""
    box = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.0, 0.0), (1.0, 2.0 * stated_high), (False, False))
    y = A @ np.array(at)
    data = Data("c", "N", np.arange(1.0, 4.0), y, 1e-4 * np.eye(3))
    model = Model(box, lambda X: box.from_unit(X) @ A.T)
    return determine(Misfit(model, (data,)), seed=0, mcmc=False)


def judged(monkeypatch, at, unlikely):
    stated = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.0, 0.0), (1.0, 1.0), (False, False))
    monkeypatch.setattr(stage, "stated_ranges", lambda plan: stated)
    monkeypatch.setattr(stage, "derived_quantities", lambda plan, d: [{"unlikely": unlikely}])
    return [k.verdict.word for k in stage.implausible(Some(), fitted(at)).known]


@pytest.mark.parametrize(
    ("at", "unlikely", "sure"),
    [
        ((0.5, 0.5), "", True),
        ((0.5, 0.5), ODD, True),  # a rare material within what was stated is a finding
        ((0.5, 1.5), "", True),  # a narrow range says little about an ordinary material
        ((0.5, 1.5), ODD, False),
        ((0.5, 2.5), ODD, False),  # at the end of what was searched
        ((0.5, 1.01), ODD, True),  # its interval reaches into the stated range
    ],
)
def test_both_signs_together_take_the_certainty(monkeypatch, at, unlikely, sure):
    words = judged(monkeypatch, at, unlikely)
    assert (words[0] == "determined") == sure


def test_the_reason_names_the_parameter_and_what_to_check(monkeypatch):
    monkeypatch.setattr(stage, "derived_quantities", lambda plan, d: [{"unlikely": f"{ODD}. Check the radius"}])
    d = fitted((0.5, 1.5))
    narrow = replace(d.misfit.model.box, high=(1.0, 1.0))
    monkeypatch.setattr(stage, "stated_ranges", lambda plan: narrow)
    mu = stage.implausible(Some(), d).of("mu")
    assert "The best fit has D₁ beyond the stated range or at its end. A Poisson's ratio" in mu.reason
    assert mu.story.startswith("mu is weakly determined: ") and "by surrogates" not in mu.story
