"""The deformed body as a report draws it: of the same size as the body, under the indenter, whole where it is cut."""

from types import SimpleNamespace

import numpy as np
import pytest

from fem_backend.adapter.deformed import MAX_FRAMES, _cut, _loading
from fem_backend.backend import BACKEND
from fem_backend.materials.zones import divided
from rso.contract import Case, Programme

PUCK = {
    "specimen": {"shape": "cylinder", "radius": 8.0, "height": 6.0},
    "indenter": {"shape": "sphere", "radius": 3.0},
    "support": {"kind": "bonded"},
    "mesh": {"level": "coarse"},
}


def areas(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.fixture(scope="module")
def body():
    return BACKEND.deformed({"mu": 0.01, "D1": 0.2}, Case("a", Programme.ramp((0.25, 0.5, 1.0)), PUCK))


def test_a_nearly_incompressible_section_keeps_its_volume(body):
    volumes = []
    for f in body.frames:
        middle = f.points[f.triangles].mean(1)
        volumes.append(2.0 * np.pi * float(middle[:, 0] @ areas(f.points, f.triangles)))
    assert volumes == pytest.approx([np.pi * 8.0**2 * 6.0] * 3, rel=0.01)  # K/μ = 1000, edges by their chords


def test_the_top_lies_on_the_indenter_where_that_is_deepest(body):
    for f in body.frames:
        axis = f.points[np.abs(f.points[:, 0]) < 1e-9, 1].max()
        assert f.indenter[:, 1].min() == pytest.approx(axis, abs=0.02) and f.mirrored
        assert axis == pytest.approx(body.frames[0].points[:, 1].min() + 6.0 - f.travel, abs=0.02)


def test_stress_grows_and_is_largest_near_the_contact(body):
    largest = [float(f.fields["von Mises stress"].max()) for f in body.frames]
    assert largest == sorted(largest) and list(body.units) == list(body.frames[0].fields)
    last = body.frames[-1]
    at = last.points[np.argmax(last.fields["von Mises stress"])]
    assert np.hypot(at[0], at[1] - last.indenter[:, 1].min()) < 3.0
    assert body.frames[-1].force == max(f.force for f in body.frames) > 0.0


def test_the_surface_is_half_of_the_body_in_space(body):
    s = body.surface
    assert s.mirrored == (False, True) and s.points[:, 1].min() > -1e-9
    r = np.hypot(s.points[:, 0], s.points[:, 1])
    assert r.max() == pytest.approx(body.frames[-1].points[:, 0].max(), rel=1e-6)
    assert s.points[:, 1].max() == pytest.approx(r.max(), rel=1e-6) and s.points[:, 0].min() == pytest.approx(-r.max())
    assert s.triangles.max() < len(s.points)


def test_a_cut_through_tetrahedra_has_no_holes():
    at, cells = divided(4)
    nodes = at[:, :3]
    solid = SimpleNamespace(cells=cells)
    for level in (0.1, 0.25, 0.6):  # 0.25 goes through nodes
        rows, triangles = _cut(solid, nodes[:, 1] - level)
        points = rows @ nodes
        np.testing.assert_allclose(points[:, 1], level, atol=1e-6)
        assert areas(points[:, [0, 2]], triangles).sum() == pytest.approx(0.5 * (1.0 - level) ** 2, rel=1e-5)
        edges, count = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0, return_counts=True)
        a, b = points[edges[count == 1]].transpose(1, 0, 2)
        around = (2.0 + np.sqrt(2.0)) * (1.0 - level)
        assert np.linalg.norm(a - b, axis=1).sum() == pytest.approx(around, rel=1e-5)  # nothing lies twice


def test_frames_are_those_of_the_first_loading():
    assert _loading([0.5, 1.0, 0.4, 1.5, 1.5, 0.2]) == [0, 1, 3]
    many = _loading(list(np.linspace(0.1, 4.0, 40)))
    assert len(many) <= MAX_FRAMES and many[-1] == 39
    assert _loading([]) == []
