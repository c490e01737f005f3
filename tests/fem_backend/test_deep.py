"""Deep indentation: what is refused before a run, and what a run says of itself where it ends or is doubtful."""

import numpy as np
import pytest

from fem_backend.simulation.experiment import read_settings

DOWN = np.array([0.0, 0.0, -1.0])


def test_a_travel_is_refused_only_where_it_leads_through_the_whole_body():
    """Widths of an ellipsoid by points of its surface; a slab is as thick as it is, a half-space has no end."""
    body = read_settings({"specimen": {"semi_axes": [60, 40, 30]}}).specimen
    rng = np.random.default_rng(1)
    points = rng.normal(size=(200_000, 3))
    points *= [60, 40, 30] / np.linalg.norm(points, axis=1)[:, None]
    for way in (DOWN, np.array([0.48, 0.6, -0.64])):
        width = np.ptp(points @ way)
        assert body.thickness_along(way) == pytest.approx(width, rel=1e-3) and body.thickness_along(way) >= width
    flat = read_settings({"specimen": {"shape": "slab", "thickness": 4.0}, "support": {"kind": "bonded"}}).specimen
    assert flat.thickness_along(DOWN) == 4.0
    without_end = read_settings({"specimen": {"shape": "half_space"}, "support": {"kind": "bonded"}}).specimen
    assert without_end.thickness_along(DOWN) == np.inf
