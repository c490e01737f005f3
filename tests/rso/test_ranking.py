"""Which test next: the information that one is expected to give, against quadrature, and the order by it and price."""

import math

import numpy as np
import pytest

from rso.optimal_design import Worth, about_causes, about_parameter, ranked

X = np.linspace(-30.0, 30.0, 60_001)


def exactly(P, means):
    """Mutual information of a cause and a reading of unit noise, by quadrature."""
    each = np.exp(-0.5 * (X - np.array(means)[:, None]) ** 2) / math.sqrt(2 * math.pi)
    whole = np.array(P) @ each
    inside = np.where(each > 0, each * np.log(np.maximum(each, 1e-300) / np.maximum(whole, 1e-300)), 0.0)
    return float(np.array(P) @ np.trapezoid(inside, X, axis=1))


@pytest.mark.parametrize("P", [(0.5, 0.5), (0.9, 0.1), (0.6, 0.3, 0.1)])
@pytest.mark.parametrize("D", [0.0, 0.5, 2.0, 4.0, 12.0])
def test_information_about_causes_is_a_lower_bound_and_exact_at_both_ends(P, D):
    names = "abc"[: len(P)]
    means = [D * (k - 1) for k in range(len(P))]
    distance = {(names[i], names[j]): D * (j - i) for i in range(len(P)) for j in range(i + 1, len(P))}
    found, true = about_causes(distance, dict(zip(names, P, strict=True))), exactly(P, means)
    entropy = -sum(p * math.log(p) for p in P)
    assert -1e-9 <= found <= true + 1e-6 <= entropy + 2e-6
    assert found > 0.2 * true - 1e-9
    if D in (0.0, 12.0):
        assert found == pytest.approx(true, abs=1e-6)


def test_what_cannot_be_simulated_is_not_learnt_about():
    """Causes that hold a tenth of the probability: a tenth of the information, and none of "it is neither"."""
    D = {("a", "b"): 20.0}
    assert about_causes(D, {"a": 0.05, "b": 0.05}) == pytest.approx(0.1 * about_causes(D, {"a": 0.5, "b": 0.5}))
    assert about_causes({("b", "a"): 20.0}, {"a": 1.0, "b": 1.0}) == pytest.approx(math.log(2.0))


def test_information_about_a_parameter_is_the_difference_of_gaussian_entropies():
    def entropy(sd):
        return 0.5 * math.log(2 * math.pi * math.e * sd**2)

    before, after = [0.3, 0.2], [0.1, 0.15]
    expected = np.mean([entropy(b) - entropy(a) for b, a in zip(before, after, strict=True)])
    assert about_parameter(before, after) == pytest.approx(expected)


def test_the_cheapest_of_those_that_tell_as_much_comes_first():
    worth = {
        "deep": Worth(1.05, 3),
        "gauge": Worth(1.0, 1),
        "shallow": Worth(0.6, 1),
        "idle": Worth(0.01, 0),
        "little": Worth(0.05, 9),
        "worse": Worth(-0.2, 0),
    }
    assert ranked(list(worth), worth.__getitem__) == ["gauge", "deep", "shallow", "little", "idle", "worse"]
    assert ranked([], worth.__getitem__) == []
