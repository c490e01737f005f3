"""A curve that is missed over many readings alike determines nothing, unless its noise is said to go together."""

from pathlib import Path

import numpy as np
import pytest

from rso.calibration.readings import as_data
from rso.cli.answer import verdict_lines
from rso.core.correlation import exponential
from rso.data import Measurement, Noise, Repeat, combine
from rso.doe import Box
from rso.inference import Misfit, Model, determine, with_autocorrelation
from rso.inference.error_model import NUMERICAL_ERROR
from rso.inference.systematic_residuals import systematic_misfit
from rso.report.calibration.verdict import answers, known_sentences

U, BOX = np.linspace(0.0, 2.0, 61)[1:], Box(("a",), ("N",), (0.2,), (5.0,), (True,))


def fitted(power, noise=None, white=0.003, seed=0, numerical=0.0, scatter=0.002):
    """F = a u^{3/2} fitted to readings of another power, of gain, contact and correlated errors of the usual size."""
    rng = np.random.default_rng(seed)
    F = (U / U[-1]) ** power
    F = F * (1.0 + 0.01 * rng.standard_normal()) + np.gradient(F, U) * 0.01 * rng.standard_normal()
    along = np.linalg.cholesky(exponential(U, 0.3) + 1e-10 * np.eye(60)) @ rng.standard_normal(60)
    y = F + scatter * along + white * rng.standard_normal(60)
    repeat = Repeat("1", U, None, {"Fz": y}, {}, np.full(60, "loading"))
    curve = combine(Measurement(Path("x.csv"), "force", (repeat,), ()), noise or Noise())
    data = as_data("test", "test", curve, curve.compared)
    data = data.plus(np.diag(np.full(60, numerical) ** 2), NUMERICAL_ERROR) if numerical else data
    model = Model(BOX, lambda X: BOX.from_unit(X)[:, :1] * (U / U[-1]) ** 1.5)
    misfit = Misfit(model, (data,))
    return determine(with_autocorrelation(misfit, np.array([0.5])), seed=0, mcmc=False)


@pytest.mark.parametrize("white", [0.0005, 0.003, 0.015])
def test_a_right_model_is_not_doubted(white):
    """White noise, a gain, a late contact and usual correlated errors are no systematic misfit of 12 records."""
    assert not [k for k in range(12) if systematic_misfit(fitted(1.5, white=white, seed=k))]


@pytest.mark.parametrize("white", [0.0005, 0.003])
def test_a_wrong_power_is_seen(white):
    """(u)^{2.2} lies up to 9 % from the best a u^{3/2}, and no contact nor gain makes up for it."""
    said = [systematic_misfit(fitted(2.2, white=white, seed=k)) for k in range(4)]
    assert all("misses test by" in s and "noise.correlation" in s for s in said)


def test_who_states_that_noise_goes_together_is_believed():
    assert systematic_misfit(fitted(2.2))
    assert not systematic_misfit(fitted(2.2, Noise(Fz=0.05, correlation=0.5)))


def test_what_simulations_may_be_off_by_is_no_misfit_of_the_model():
    assert systematic_misfit(fitted(1.7))
    assert not systematic_misfit(fitted(1.7, numerical=0.05))


def test_a_doubted_fit_has_its_reason_with_the_share():
    """The residuals of the sentence are those of the readings about the curve, in per cent of the largest."""
    d = fitted(2.2, white=1e-4, scatter=1e-5)
    said = systematic_misfit(d)
    share = float(said.split("misses test by ")[1].split(" %")[0])
    left = (d.misfit.model.predict(d.fit.x[None])[0] - d.misfit.data[0].value) / np.abs(d.misfit.data[0].value).max()
    assert 0.1 < share <= 100.0 * float(np.sqrt(np.mean(left**2)))  # gain and contact took some of it


@pytest.mark.parametrize(
    "doubts", ["", "The fitted curve misses press by 1.2 % of its largest value. Errors are smaller."]
)
def test_nothing_is_said_to_agree_with_data_that_are_missed(doubts):
    """The terminal and the first page mark the fit, and call what is left of the intervals by its name."""
    row = {"parameter": "mu", "value": 0.01, "interval": [0.008, 0.012], "verdict": "weakly"}
    found = {
        "parameters": [{"name": "mu", "unit": "MPa", "low": 0.001, "high": 1.0}],
        "determined": {"mu": {"determined": False, "interval": [0.008, 0.012], "story": ""}},
        "identification": {"level": 0.9, "parameters": [row], "doubts": doubts},
    }
    lines = dict(reversed(line) for line in verdict_lines(found))
    page = " ".join(known_sentences(found))
    assert ("bad" in lines.values()) is bool(doubts) is any(f.mark == "bad" for f in answers(found))
    assert any("agrees with the data" in text for text in lines) is not bool(doubts)
    assert ("agrees with the data" in page) is not bool(doubts)
    assert not doubts or "the fit is not believed: the fitted curve misses press by 1.2 % of its largest value" in lines
