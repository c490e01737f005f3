"""What a contest says: which verdict follows from probabilities, and when a sure cause is only a part."""

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.diagnosis.attribute import Contest
from rso.diagnosis.hypotheses import Hypothesis
from rso.diagnosis.judge import BEYOND, _beyond, judge
from rso.diagnosis.mixture import Posterior
from rso.diagnosis.shrinkage import Gap, summarise

STIFF, SKIN = toy.effects("stiff", "skin")
BIAS, SCATTER = toy.effects("bias", "offset_each")
EVERY = (
    Hypothesis(()), Hypothesis((STIFF,)), Hypothesis((SKIN,)), Hypothesis((BIAS,)), Hypothesis((STIFF,), True),
    Hypothesis((STIFF, SKIN)), Hypothesis((), True),
)  # fmt: skip


def contest(**log_evidence: float) -> Contest:
    names = {"none": 0, "stiff": 1, "skin": 2, "bias": 3, "more": 4, "pair": 5, "free": 6}
    z = np.full(len(EVERY), -50.0)
    for name, value in log_evidence.items():
        z[names[name]] = value
    return Contest(EVERY, z, np.log(np.full(len(EVERY), 1 / len(EVERY))))


@pytest.mark.parametrize(
    ("found", "verdict", "named"),
    [
        ({"stiff": 20.0}, "explained", ("stiff",)),
        ({"bias": 20.0}, "measurement", ("bias",)),
        ({"stiff": 20.0, "skin": 19.0}, "ambiguous", ("stiff", "skin")),
        ({"more": 20.0}, "partly", ("stiff",)),
        ({"free": 20.0}, "unexplained", ()),
        ({"pair": 20.0}, "partly", ("stiff", "skin")),  # sure of both, and yet not taken for the whole truth
    ],
)
def test_verdicts(found, verdict, named):
    said = judge(contest(**found), True)
    assert said.verdict == verdict and set(said.named) == set(named)
    assert judge(contest(**found), False).verdict == "no_gap"


def test_a_size_beyond_what_is_plausible_is_noticed_in_pairs_with_scatter_too():
    far = max(abs(v) for side in STIFF.size.ends() for v in side)

    def drawn(size: float, strayed: float = 0.0) -> Posterior:
        at = np.tile([0.0, size], (9, 1))  # one coordinate of the base, one size; scatter has none
        off = np.column_stack([np.ones(9, bool), np.arange(9) < 9 * strayed])
        return Posterior(np.ones(9), at, np.zeros(9, int), np.ones((9, 2)), off)

    for h in (Hypothesis((STIFF,)), Hypothesis((SCATTER, STIFF)), Hypothesis((STIFF, SCATTER))):
        assert _beyond(h, drawn(1.01 * BEYOND * far)) and not _beyond(h, drawn(0.99 * BEYOND * far))
        assert _beyond(h, drawn(0.5 * far, 0.6)) and not _beyond(h, drawn(0.5 * far, 0.4))
    assert not _beyond(Hypothesis((SCATTER,)), drawn(1e9))


def test_the_share_closed_of_a_gap_in_one_curve_has_an_interval_that_means_something():
    """Resamples without that curve have no gap: a share of nothing is no number in the millions."""
    curves = [Gap(f"curve {k}", "N", 30.0 if k == 0 else 0.97, 30.0, 2.0 if k == 0 else 1.1, (0.0, 0.0, 0.0))
              for k in range(5)]  # fmt: skip
    found = summarise(curves, [40] * 5, "each left out", 1)
    low, high = found.interval
    assert low < found.closed < high and -3.0 < low and high < 1.0 + 1e-9
    even = summarise([Gap(f"curve {k}", "N", 5.0, 5.0, 1.0, (0.0, 0.0, 0.0)) for k in range(5)], [40] * 5, "", 1)
    np.testing.assert_allclose((even.closed, *even.interval), 1.0, rtol=1e-12)
