"""The curve that was fitted is the one that pages draw, and caption, ring and slider speak of it."""

import json
import re

import numpy as np
import pytest
from report_fixture import DEPTH, complete, deformed, force, measured

from rso.report.calibration.figures import draw
from rso.report.calibration.numbers import report
from rso.report.layout.document import Picture
from rso.report.reading import experiment, fitted_band

SHIFT, GAIN, SD = 0.06, 0.012, 0.004
U = DEPTH[1:]


def results(fitted=True):
    """A study whose simulated curve runs beside the readings, and whose fitted curve runs through them."""
    found = complete()
    values = {"mu": 0.01017, "D1": 12.7}
    f, y = force(**values, h=U), measured()[0][1:]
    again = found["identification"]["recomputed"]
    again["values"] = values
    again["curves"] = {
        "middle_point": {"experiment": "middle_point", "channel": "Fz", "depth": U.tolist(), "value": f.tolist()}
    }
    again["curves"]["middle_point"]["error"] = (0.002 * f).tolist()
    again["metrics"] = {"middle_point": _norms(0.034)}
    if fitted:
        found["identification"]["data"][0]["fitted"] = {
            "depth": U.tolist(),
            "value": (y + 0.001).tolist(),
            "moved": (y + 0.001 - f).tolist(),
            "sd": (0 * U + 0.001).tolist(),
            "reading_sd": (0 * U + SD).tolist(),
            "white": np.linspace(-2, 2, len(U)).tolist(),
            "contact": SHIFT,
            "gain": -GAIN,
            "expected": {"contact": 0.04, "gain": 0.01},
            "inputs": {},
            "metrics": _norms(0.006),
        }
    return {**found, "deformed": deformed()}


def _norms(nrmse):
    return {"rmse": nrmse, "nrmse": nrmse, "mre": nrmse, "mape": 100 * nrmse, "rrmse": nrmse, "n": 40, "excluded": 0}


def caption(found, name):
    blocks = [b for s in report(found).sections for b in s.blocks]
    return next(b.caption for b in blocks if isinstance(b, Picture) and b.name == name).replace("\u00a0", " ")


def data_of(svg):
    return json.loads(re.search(r'<metadata class="data">(.*?)</metadata>', svg, re.DOTALL)[1].replace("&lt;", "<"))


@pytest.mark.parametrize("name", ["curve-0", "pressed"])
def test_the_line_through_the_readings_is_the_fitted_one(name):
    found = results()
    series = {s["name"]: s for s in data_of(draw(found, name))["series"] if not s.get("a")}
    y = dict(zip(U, measured()[0][1:], strict=True))
    line, plain = series["fitted"], series["simulated, as it is"]
    assert np.interp(2.0, line["x"], line["y"]) == pytest.approx(y[2.0] + 0.001, rel=2e-3)
    assert abs(np.interp(3.0, plain["x"], plain["y"]) / np.interp(3.0, line["x"], line["y"]) - 1) > 0.02


def test_ring_and_slider_are_on_the_fitted_curve():
    found = results()
    data = data_of(draw(found, "pressed"))
    line = next(s for s in data["series"] if s["name"] == "fitted")
    for (x, y), frame, said in zip(data["dots"], found["deformed"]["frames"], data["said"], strict=True):
        at = np.array(line["p"])
        assert y == pytest.approx(np.interp(x, at[:, 0], at[:, 1]), abs=0.5)
        value = np.interp(frame["travel"], line["x"], line["y"])
        assert float(said.split("\u00a0")[0]) == pytest.approx(value, rel=0.01)


def test_captions_state_shift_gain_and_band_and_measure_from_the_fitted_curve():
    said = caption(results(), "curve-0")
    assert "contact 60 µm deeper than recorded" in said or "contact 0.060 mm deeper than recorded" in said
    assert "force 1.2 % too low (expected ± 1.0 %)" in said
    assert "90 % of such readings" in said and "may run beside" not in said
    assert "by at most 1.0 mN" in said
    assert "90 % band" in caption(results(), "pressed")


def test_a_shift_far_beyond_what_was_expected_is_named():
    found = results()
    assert "times what was expected" not in caption(found, "curve-0")
    found["identification"]["data"][0]["fitted"]["expected"]["contact"] = SHIFT / 3
    assert "The contact shift is 3 times what was expected" in caption(found, "curve-0")


def test_a_stated_dimension_that_the_fit_moved_is_named():
    found = results()
    assert "standard uncertainties" not in caption(found, "curve-0")
    moved = found["identification"]["data"][0]["fitted"]["inputs"]
    moved |= {"delta_thickness": -0.4, "delta_R": 0.05}
    said = caption(found, "curve-0")
    assert "; delta_thickness 0.4 standard uncertainties less than stated." in said and "delta_R" not in said
    moved |= {"delta_R": -0.98, "top: tilt_x": 2.0}
    said = caption(found, "curve-0")
    assert "; delta_R one standard uncertainty less than stated; tilt_x 2 standard uncertainties more" in said
    moved["delta_R"] = 5.0
    assert "The delta_R is 5 times what was expected: check it, or the model." in caption(found, "curve-0")


def test_the_first_row_of_errors_and_the_sentence_are_of_the_fitted_curve():
    found = results()
    text = " ".join(b.text for s in report(found).sections for b in s.blocks if hasattr(b, "text"))
    text = text.replace("\u00a0", " ")
    assert "The fitted curve reproduces middle_point with an NRMSE of 0.60 %" in text
    assert "The simulation by itself reproduces" in text and "3.4 %" in text


def test_results_without_a_fitted_curve_are_drawn_as_before():
    found = results(fitted=False)
    assert fitted_band(found, experiment(found, "middle_point")) is None
    names = {s["name"] for s in data_of(draw(found, "pressed"))["series"]}
    assert names == {"measured", "fitted model"}


def test_a_residual_is_that_of_the_fitted_curve_and_the_quantiles_are_white():
    series = data_of(draw(results(), "residuals"))["series"]
    left, right = (next(s for s in series if s["a"] == k and s["name"]) for k in (0, 1))
    assert left["y"] == pytest.approx([-0.001 / SD] * len(U), rel=1e-3)
    assert (min(right["y"]), max(right["y"])) == pytest.approx((-2, 2))
