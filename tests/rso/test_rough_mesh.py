"""A numerical error that is a large share of a curve is said: within it every material agrees with the data."""

import pytest

from rso.calibration.pipeline import rough


def candidate(error: float) -> dict:
    value = [0.0, 0.1, 0.4]
    curve = {"experiment": "ball", "channel": "Fz", "value": value, "error": [error * v for v in value]}
    return {"curves": {"ball": curve}}


@pytest.mark.parametrize("shares, told", [((0.01, 0.04), None), ((0.01, 0.234), "23 %"), ((), None)])
def test_what_the_mesh_leaves_open_is_said(shares, told):
    said = rough([candidate(share) for share in shares])
    assert (told is None and said == []) or (told in said[0] and "ball" in said[0] and "mesh.level" in said[0])


def test_candidates_without_an_answer_have_no_curves():
    assert rough([{"curves": {}}, candidate(0.0)]) == []
