"""Values and intervals as text: the same digits in terminal and page, and nothing that contradicts itself."""

import numpy as np
import pytest

from rso.cli.answer import estimate_text, interval_in_unit
from rso.core.digits import estimate, interval_ends, quantity_text, range_text, two_digits
from rso.report.calibration.derived import derived_span, derived_value


def number(text: str) -> float:
    mantissa, _, power = text.replace("−", "-").replace("\xa0", " ").partition(" × 10")
    return float(mantissa) * 10.0 ** int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 0)


def test_a_written_value_lies_in_its_written_interval_whose_ends_differ():
    rng = np.random.default_rng(4)
    for _ in range(2000):
        middle = 10.0 ** rng.uniform(-7.0, 7.0) * rng.choice([-1.0, 1.0])
        half = abs(middle) * 10.0 ** rng.uniform(-3.0, 1.0)
        value = rng.uniform(middle - half, middle + half)
        low, high = map(number, interval_ends(middle - half, middle + half))
        assert low <= number(estimate(value, middle - half, middle + half)) <= high
        assert low < high
        # what rounding moves an end by: half of a second digit of the half-width, or of a third of its own
        most = max(0.05 * half, 0.005 * abs(middle) + 0.005 * half)
        assert abs(low - middle + half) <= most and abs(high - middle - half) <= most


def test_terminal_and_page_write_the_same_digits():
    """The same interval was 27.2 to 28.9 in one and 27.19 to 28.95 in the other."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        low = 10.0 ** rng.uniform(-4.0, 1.0)
        high = low * (1.0 + 10.0 ** rng.uniform(-3.0, 1.0))
        value = rng.uniform(low, high)
        q = {"unit": "MPa", "value": value, "interval": [low, high], "known": True}
        assert derived_span(q).replace("\xa0", " ") == interval_in_unit((low, high), "MPa").replace("\xa0", " ")
        assert derived_value(q).replace("\xa0", " ") == estimate_text(value, (low, high), "MPa").replace("\xa0", " ")


@pytest.mark.parametrize(
    ("x", "unit", "said"),
    [
        (7e-9, "N", "7 nN"),
        (-2.5e-4, "N", "-0.25 mN"),
        (0.02, "N", "0.02 N"),  # a unit is kept as long as its number is read at once
        (0.0, "mm", "0 mm"),
        (5e-4, "mm", "0.5 µm"),
        (1234.5, "mm", "1.23e+03 mm"),
    ],
)
def test_a_quantity_far_below_its_unit_has_a_smaller_one(x, unit, said):
    assert quantity_text(x, unit) == said


def test_two_ends_have_one_unit_that_of_the_larger():
    assert range_text(1e-9, 7e-9, "N") == "1 to 7 nN"
    assert range_text(0.0, 2.0, "mm", "and") == "0 and 2 mm"
    assert range_text(-3e-4, 1e-5, "mm", digits=2) == "-0.3 to 0.01 µm"


def test_percentages_have_no_power_of_ten():
    assert [two_digits(x) for x in (0.034, 7.0, 99.7, 138.2, 2500.0)] == ["0.034", "7", "100", "138", "2500"]


def test_the_end_of_an_interval_that_round_off_missed_is_nothing():
    """A Poisson ratio of −1e-10, beside one of 0.4; a compressibility of 1e-10 on a logarithm is a number."""
    assert interval_ends(-1.1e-10, 0.435) == ("0", "0.435")
    assert interval_ends(1.1e-10, 0.435)[0] != "0"
    assert interval_ends(-0.012, 0.435) == ("−0.0120", "0.435")
