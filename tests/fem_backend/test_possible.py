"""What may be otherwise than a study says suits the size of its specimen."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND

BENCH = "specimen and ball on the bench: callipers, a micrometer, a balance"
ALIGNED = "ink on the ball and a level on the holder"
GAUGES = {
    "delta_a": (BENCH, 0.1),
    "delta_b": (BENCH, 0.1),
    "delta_c": (BENCH, 0.1),
    "delta_R": (BENCH, 0.01),
    "offset_x": (ALIGNED, 0.1),
    "offset_y": (ALIGNED, 0.1),
    "tilt_x": (ALIGNED, 0.1),
    "tilt_y": (ALIGNED, 0.1),
    "weight": (BENCH, 2e-7),
}
LENGTHS = ("delta_a", "delta_b", "delta_c", "delta_R", "offset_x", "offset_y")


@pytest.mark.parametrize("k", [1.0, 0.1, 5.0])
def test_gauges_are_as_fine_beside_a_small_body_as_beside_a_large_one(k):
    """Their resolution keeps its share of what is plausible."""
    settings = {
        "specimen": {"shape": "ellipsoid", "semi_axes": [60.0 * k, 35.0 * k, 35.0 * k]},
        "indenter": {"shape": "sphere", "radius": 3.0 * k},
        "support": {"kind": "fixed"},
    }
    found, ranges = BACKEND.gauges(settings), BACKEND.plausible(settings)
    declared = {p.name: p.plausible for p in BACKEND.parameters}
    for name, (words, fine) in GAUGES.items():
        factor = k if name in LENGTHS else 1.0
        assert found[name][0] == words
        np.testing.assert_allclose(found[name][1], factor * fine, rtol=1e-12)
        np.testing.assert_allclose(ranges.get(name, declared[name]), np.multiply(factor, declared[name]), rtol=1e-12)
    assert k != 1.0 or found == GAUGES
