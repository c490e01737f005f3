"""What a diagnosis says of the base parameters where its hypothesis leaves more than noise."""

import pytest

from rso.discrepancy.parameters import is_far_from_the_data, parameter_sentences
from rso.report.language.catalogue import sentences_of

BANDS = {
    "before": {"mu": {"low": 0.0103, "median": 0.0107, "high": 0.0111}},
    "after": {"mu": {"low": 0.0037, "median": 0.0045, "high": 0.0052}},
}


def said(**change):
    d = {"verdict": "partly", "parameters": BANDS, "chosen": ["prony_g"], "left": 20.4, "odd": None, **change}
    return parameter_sentences(d, {"units": {"mu": "MPa"}})[0]


def test_no_interval_is_stated_where_the_named_cause_leaves_more_than_noise():
    """The interval of a hypothesis that misses the data by 4.5 times their noise holds no parameter."""
    words = said()
    assert "90 %" not in words and "4.5 times the noise" in words and "4.5 kPa" in words and "10.7 kPa" in words
    german = sentences_of("de", frozenset({"mu"}))
    german.text(words)
    assert not german.missing


@pytest.mark.parametrize("change", [{"left": 1.2}, {"left": None}, {"chosen": []}])
def test_an_interval_is_stated_where_nothing_but_noise_is_left_or_nothing_is_named(change):
    assert "90 % 3.7" in said(**change)


def test_one_odd_experiment_spoils_no_interval_of_the_others():
    assert not is_far_from_the_data({"chosen": ["skin"], "left": 9.0, "odd": {"experiment": "deep"}})
