"""What a contest says: which verdict follows from probabilities, and when a sure cause is only a part."""

import diagnosis_backend as toy
import numpy as np
import pytest

from rso.diagnosis.attribute import Contest
from rso.diagnosis.hypotheses import Hypothesis
from rso.diagnosis.judge import BEYOND, _beyond, judge
from rso.diagnosis.mixture import Posterior

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
