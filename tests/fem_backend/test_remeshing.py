"""New meshes of a deformed meridian: triangles, places traced back, fields carried over, runs that go on."""

from dataclasses import replace

import numpy as np
import pytest

from fem_backend.accuracy import two_grid
from fem_backend.accuracy.error_estimate import stated_errors
from fem_backend.backend import BACKEND
from fem_backend.contact import tractions
from fem_backend.contact.self_contact import met_itself
from fem_backend.kinematics import axisymmetric
from fem_backend.meshing import triangulated
from fem_backend.remeshing import location
from fem_backend.remeshing.section import DeformedMeridian, NoMesh, rezoned
from fem_backend.remeshing.triangulation import NoTriangles, filled, inside, quality, size_field
from fem_backend.simulation import assembly, controlled, indentation, rezoning
from fem_backend.simulation.experiment import read_settings
from fem_backend.simulation.initial_state import initial_state
from fem_backend.solver import history_steps, load_steps
from fem_backend.solver.controlled_steps import Drive, Leg
from fem_backend.solver.load_steps import Instant, Stopped
from fem_backend.solver.newton import Counters, NotConverged


def grid(n: int = 8):
    return triangulated(np.linspace(0.0, 2.0, n + 1), np.linspace(0.0, 1.0, n + 1))


def crescent(n: int = 24) -> np.ndarray:
    """A half disc with a notch: an outline that is not convex, counterclockwise."""
    turn = np.linspace(-0.5, 0.5, n) * np.pi
    outer = 2.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    inner = np.column_stack([0.6 * np.cos(turn[::-1][1:-1]), 1.0 + 0.6 * np.sin(turn[::-1][1:-1])])
    axis = np.linspace(2.0, 1.6, 4)[1:], np.linspace(0.4, -2.0, 14)[:-1]
    return np.concatenate(
        [outer, np.column_stack([0 * axis[0], axis[0]]), inner, np.column_stack([0 * axis[1], axis[1]])]
    )


def test_triangles_fill_their_polygon_well_shaped_and_the_same_every_time():
    outline = crescent()
    sizes = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
    line = np.column_stack([np.linspace(0.2, 1.2, 9), np.full(9, -0.6)])
    points, triangles = filled(outline, [line], size_field(outline, sizes, 0.3))
    q = quality(points[triangles])
    x, y = outline.T
    whole = 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    a, b = points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    assert 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() == pytest.approx(whole, rel=1e-12)
    assert q.min() > 0.3 and np.median(q) > 0.85
    assert inside(outline, points[triangles].mean(1)).all()
    sides = {frozenset(s) for t in triangles.tolist() for s in zip(t, t[1:] + t[:1], strict=True)}
    first = len(outline)
    assert all(frozenset((first + k, first + k + 1)) in sides for k in range(8))
    again = filled(outline, [line], size_field(outline, sizes, 0.3))
    assert (again[0] == points).all() and (again[1] == triangles).all()


def test_a_polygon_that_crosses_itself_is_refused():
    bow = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    with pytest.raises(NoTriangles):
        filled(bow, [], size_field(bow, np.full(4, 0.3), 0.3))


def test_places_are_found_in_curved_cells_and_fields_carried_exactly_where_they_can_be():
    """A quadratic map of the grid: u of degree two is in the element, and traced back to round-off."""
    mesh = grid()
    X = mesh.points
    u = np.column_stack([0.1 * X[:, 0] * X[:, 1], 0.05 * X[:, 0] ** 2 - 0.2 * X[:, 1] ** 2])
    rng = np.random.default_rng(3)
    at = rng.uniform([0.0, 0.0], [2.0, 1.0], (200, 2))
    now = at + np.column_stack([0.1 * at[:, 0] * at[:, 1], 0.05 * at[:, 0] ** 2 - 0.2 * at[:, 1] ** 2])
    cell, xi = location.located(X + u, mesh.cells, now)
    np.testing.assert_allclose(location.at_nodes(X, mesh.cells, cell, xi), at, atol=1e-9)
    with pytest.raises(location.Lost):
        location.located(X, mesh.cells, np.array([[5.0, 0.5]]))


def test_places_are_found_in_thin_cells_whatever_middles_are_nearer():
    """Cells 400 times as long as wide: those of many others have their middles nearer to an end."""
    mesh = grid(40)
    flat = mesh.points * [1.0, 0.0025]
    at = np.random.default_rng(5).uniform([0.0, 0.0], [2.0, 0.0025], (300, 2))
    cell, xi = location.located(flat, mesh.cells, at)
    np.testing.assert_allclose(location.at_nodes(flat, mesh.cells, cell, xi), at, atol=1e-12)
    assert (xi >= -1e-9).all() and (xi.sum(1) <= 1.0 + 1e-9).all()


def test_a_linear_field_at_points_is_carried_exactly_and_no_field_gets_new_extremes():
    mesh = grid()
    body = axisymmetric.discretise(mesh.points, mesh.cells, np.zeros((len(mesh.points), 3), bool))
    x = location.quadrature_points(mesh.points, mesh.cells, axisymmetric.shape_functions())
    inner = np.random.default_rng(4).uniform([0.4, 0.2], [1.6, 0.8], (100, 2))
    cell, xi = location.located(mesh.points, mesh.cells, inner)
    middle = np.full_like(xi, 1.0 / 3.0)
    found = location.at_points(2.0 + x @ [1.0, -3.0], body.Q, cell, middle)
    at = location.at_nodes(mesh.points, mesh.cells, cell, middle)
    np.testing.assert_allclose(found, 2.0 + at @ [1.0, -3.0], rtol=1e-10)
    steep = np.where(x[..., 0] > 1.0, 1.0, 0.0)
    assert location.at_points(steep, body.Q, cell, xi).min() >= 0.0
    assert location.at_points(steep, body.Q, cell, xi).max() <= 1.0


@pytest.mark.parametrize("layers", [1, 2])
def test_a_sheared_section_is_meshed_anew_well_shaped_with_the_same_volume(layers):
    """Stretched twofold along the top: new cells are well shaped now, fill the old body, and keep its layers."""
    mesh = grid(12)
    X = mesh.points
    u = np.column_stack([X[:, 0] * X[:, 1] ** 2, -0.35 * X[:, 1] ** 2])
    part = np.zeros(len(mesh.cells), int) if layers == 1 else (X[mesh.cells[:, 6], 1] > 0.5).astype(int)
    held = np.where(X[:, 1] == 0.0, 3, 0)
    section = DeformedMeridian(X, u, mesh.cells, mesh.outline(), held, part)
    new = rezoned(section, np.ones(len(mesh.cells), bool), lambda x: np.full(len(x), 0.25), 0.3)
    body = axisymmetric.discretise(new.points, new.cells, np.zeros((len(new.points), 3), bool))
    assert body.w.sum() == pytest.approx(4.0 * np.pi, rel=1e-9)
    cell, xi = location.located(X, mesh.cells, new.points)
    now = new.points + location.at_nodes(u, mesh.cells, cell, xi)
    q, worn = quality(now[new.cells[:, :3]]), quality((X + u)[mesh.cells[:, :3]])
    assert q.min() > 0.1 and np.median(q) > 0.8 > np.median(worn)  # the corner of the outline is sharp
    top = np.unique(X[mesh.outline()[:, 0], 1])
    assert top.max() == new.points[:, 1].max()
    if layers == 2:
        above = (new.points[new.cells[:, :3], 1] > 0.5 + 1e-9).any(1)
        below = (new.points[new.cells[:, :3], 1] < 0.5 - 1e-9).any(1)
        assert not (above & below).any()


def test_a_part_with_a_hole_is_refused():
    mesh = grid(6)
    middle = mesh.points[mesh.cells[:, 6]]
    near = np.hypot(middle[:, 0] - 1.0, middle[:, 1] - 0.5) > 0.2
    flat = np.zeros_like(mesh.points)
    section = DeformedMeridian(
        mesh.points, flat, mesh.cells, mesh.outline(), np.zeros(len(flat), int), np.zeros(len(near), int)
    )
    with pytest.raises(NoMesh):
        rezoned(section, near, lambda x: np.full(len(x), 0.2), 0.3)


def test_a_surface_that_crosses_itself_has_met_itself():
    """A groove whose walls come together: apart, and one through the other."""
    for gap, met in ((0.1, False), (-0.1, True)):
        ends = np.array([[0.0, 1.0], [1.0 - gap, 1.0], [1.0, 0.0], [1.0 + gap, 1.05], [2.0, 1.0]])
        middles = 0.5 * (ends[1:] + ends[:-1])
        x = np.column_stack([np.concatenate([ends, middles])[:, 0], np.zeros(9), np.concatenate([ends, middles])[:, 1]])
        edges = np.array([[k, k + 1, 5 + k] for k in range(4)])
        assert met_itself(x, edges) is met


DEPTHS, SOFT = (3.0, 6.0), {"mu": 0.01, "D1": 40.0}


def ready(remesh, knobs):
    """A ball on a thick soft slab, on crude elements."""
    settings = read_settings(
        {
            "specimen": {"shape": "slab", "thickness": 12.0},
            "support": {"kind": "bonded"},
            "indenter": {"shape": "sphere", "radius": 3.0, "shaft": True},
            "profile": [[2.0, 0.0], [5.0, 0.0]],
            "mesh": {"level": "coarse", "remesh": remesh},
        }
    )
    settings = replace(settings, fineness=3.0)
    values = BACKEND.knobs(knobs, settings)
    placement = assembly.placement_of(settings, values)
    return settings, values, placement, assembly.model_for(settings, values, placement, None)


def run(remesh, depths, knobs, gradients=(), programme=None):
    way = programme or [Instant(d, d, True) for d in depths]
    return indentation.simulate_indentation(*ready(remesh, knobs), way, None, gradients)


@pytest.fixture(scope="module")
def renewed():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 1.7)  # sooner than usual: a shallow run is cheap
        new = run("when_needed", DEPTHS, SOFT, ("mu", "D1"))
    return new, run("never", DEPTHS, SOFT, ("mu", "D1"))


def test_a_deep_run_goes_on_with_a_new_mesh(renewed):
    """Force, marks and derivatives are those of the old mesh but for what crude elements miss, 1 to 2 %."""
    new, old = renewed
    assert new.legs and not old.legs and new.notes["meshes"] == 1 + len(new.legs)
    assert all(3.0 < began < 6.0 and jump < 0.01 for began, jump in new.legs)
    assert new.Fz[0] == old.Fz[0] and new.Fz[1] != old.Fz[1]
    np.testing.assert_allclose(new.Fz, old.Fz, rtol=0.02)
    for name in ("uz(2,0)", "uz(5,0)"):
        np.testing.assert_allclose(new.channels[name], old.channels[name], atol=0.1)  # elements of 1 mm
    for knob in ("mu", "D1"):
        least = 0.02 * old.Fz[-1] / SOFT[knob]
        np.testing.assert_allclose(new.gradients[knob]["Fz"], old.gradients[knob]["Fz"], rtol=0.02, atol=least)


@pytest.mark.parametrize("remesh", ["when_needed", "never"])
def test_no_mesh_is_looked_at_on_a_way_that_ends_before_it_may_be_outworn(remesh, monkeypatch):
    """Below 1.5 radii every state is good enough, whatever its edges; beyond, none is with edges that may not grow."""
    monkeypatch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 0.0)
    settings, values, placement, model = ready(remesh, SOFT)
    leg = rezoning.MeshLeg(initial_state(settings, values, placement, model, Counters()), None)
    u = np.zeros_like(model.body.nodes)
    assert rezoning._watching([leg], 0.0, 4.5) is None and not rezoning.wear(leg)(u, 4.5)
    legs = [leg]
    looks = rezoning._watching(legs, 0.0, 4.6)
    assert looks(u, 4.6) == (remesh == "when_needed") and np.isfinite(legs[0].outworn) == (remesh == "never")


def test_the_reaction_of_the_support_balances_the_force_on_every_mesh(renewed):
    new, _ = renewed
    np.testing.assert_allclose(new.reaction[:, 2], new.Fz, rtol=1e-4)


def test_histories_are_carried_over(monkeypatch):
    """A body that relaxes and softens: within 2 % of the run on one mesh, loading, resting and back."""
    knobs = {**SOFT, "prony_g": 0.4, "prony_tau": 2.0, "mullins": 0.5, "mullins_m": 0.3}
    way = [Instant(3.0, 3.0, True), Instant(6.0, 6.0, True), Instant(10.0, 6.0, True), Instant(12.0, 4.5, True)]
    old = run("never", (), knobs, programme=way)
    monkeypatch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 1.7)
    new = run("when_needed", (), knobs, programme=way)
    assert new.legs and all(jump < 0.01 for _, jump in new.legs)
    assert new.Fz[2] < 0.95 * new.Fz[1]  # it relaxes on the new mesh, as before
    np.testing.assert_allclose(new.Fz, old.Fz, rtol=0.02)


def test_friction_is_carried_over(monkeypatch):
    """A ball that sticks, on crude elements: within 2 % of the run on one mesh."""
    knobs = {**SOFT, "friction": 1.0}
    way = [Instant(3.0, 3.0, True), Instant(5.0, 5.0, True)]
    old = run("never", (), knobs, programme=way)
    monkeypatch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 1.7)
    monkeypatch.setattr(rezoning, "NEW_EDGE_RATIO", 0.7)
    new = run("when_needed", (), knobs, programme=way)
    assert new.legs and all(jump < 0.015 for _, jump in new.legs)
    np.testing.assert_allclose(new.Fz, old.Fz, rtol=0.02)
    assert new.channels["slipping"][-1] < 0.2


def test_a_traction_between_points_of_contact_is_that_of_its_neighbours():
    """Linear along an undeformed line: exact on other points of it."""
    at = initial_state(*ready("when_needed", {**SOFT, "friction": 0.5}), Counters())
    other = replace(at, model=assembly.model_for(replace(at.settings, fineness=2.0), at.knobs, at.placement, None))
    other = replace(other, system=assembly.system(at.settings, at.knobs, at.placement, other.model))
    here = history_steps.begin_path(at.system, at.start, at.settings.control, Counters(), at.seated)[0]
    r = tractions.contact_points(at.system.pressing.surface, at.model.body.nodes)[..., :1]
    before = replace(here.before[0], traction=np.concatenate([2.0 + r, 0.0 * r, 1.0 - 0.5 * r], axis=-1))
    here = replace(here, before=(before, *here.before[1:]), pressures=[r[..., 0], *here.pressures[1:]])
    found, pressure = rezoning.rubbing(at, other, np.zeros_like(other.model.body.nodes), here, 0)
    R = tractions.contact_points(other.system.pressing.surface, other.model.body.nodes)[..., 0]
    inside = R < r.max()  # beyond the last point it stays
    np.testing.assert_allclose(found.traction[inside, 0], 2.0 + R[inside], atol=0.02)
    np.testing.assert_allclose(pressure[inside], R[inside], atol=0.02)


def test_a_force_leads_over_a_new_mesh(monkeypatch):
    """A body that creeps, pressed by a force that rests: it is met, travels are those of one mesh within 2 %."""
    knobs = {**SOFT, "prony_g": 0.4, "prony_tau": 0.5}
    drive = Drive((Leg(True, 0.2, to_N=0.6), Leg(True, lasts=0.5, asked=(0.5,))), (), (0.3, 0.6), 10.0, "the end")
    old, _ = controlled.simulate_programme(*ready("never", knobs), drive)
    monkeypatch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 1.3)
    monkeypatch.setattr(rezoning, "NEW_EDGE_RATIO", 0.7)
    new, _ = controlled.simulate_programme(*ready("when_needed", knobs), drive)
    assert new.legs and new.points[0].leg == 0 and new.points[-1].leg == len(new.legs)
    np.testing.assert_allclose(new.Fz, [0.3, 0.6, 0.6], rtol=1e-6)
    np.testing.assert_allclose(new.travel, old.travel, rtol=0.02)


def test_an_outworn_mesh_that_is_kept_is_said_and_states_more(renewed):
    """On one mesh, allowed or not: errors grow with the sixth power of the travel from where it is outworn."""
    experiment = ready("never", SOFT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 1.7)
        kept = two_grid.checked_on_coarse_mesh(*experiment, [Instant(d, d, True) for d in DEPTHS])
    began = kept.notes["outworn_mm"]
    assert began == kept.outworn[-1] and 4.5 < began < 6.0 and "outworn_mm" not in renewed[0].notes
    mine, other = (stated_errors(*experiment[:2], r)["Fz"] for r in (kept, replace(kept, outworn=None)))
    grown = (DEPTHS[1] / began) ** 6
    assert mine[0] == other[0]
    assert 0.9 * grown < mine[1] / other[1] < grown  # contact and steps leave the same


def test_an_answer_hangs_on_the_other_depths_by_no_more_than_what_it_states(renewed, monkeypatch):
    """The mesh is made anew after other steps, so at other travels."""
    monkeypatch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 1.7)
    experiment = ready("when_needed", SOFT)
    alone = two_grid.checked_on_coarse_mesh(*experiment, [Instant(6.0, 6.0, True)])
    among = run("when_needed", (1.0, 4.3, 5.2, 6.0), SOFT)
    assert alone.legs and among.legs and alone.legs != among.legs
    error = stated_errors(*experiment[:2], alone)
    for name in ("Fz", "uz(5,0)"):
        assert abs(among.channels[name][-1] - alone.channels[name][-1]) <= 2.0 * error[name][-1]  # each has its own


def test_another_size_is_tried_where_the_first_mesh_has_no_equilibrium(monkeypatch):
    """The run goes on as with a mesh that has one, on smaller elements."""
    tried = []

    def unlucky(at, state, size):
        tried.append(size)
        if size == rezoning.TRIED_EDGE_FACTORS[0]:
            raise NotConverged("contact", "none on this mesh", ())
        return made(at, state, size)

    made = rezoning.renewed
    monkeypatch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 1.7)
    monkeypatch.setattr(rezoning, "renewed", unlucky)
    found = run("when_needed", (6.0,), SOFT)
    assert found.legs and tried[:2] == list(rezoning.TRIED_EDGE_FACTORS) and "outworn_mm" not in found.notes
    assert max(jump for _, jump in found.legs) < 0.01


def losing(monkeypatch, *, beyond):
    """No mesh is seen to be outworn, and no step beyond that travel (mm) has an equilibrium on a first mesh."""
    find, nodes = load_steps.find_equilibrium, ready("never", SOFT)[3].body.nodes.shape
    begun = 12.0 + 3.0  # height of the ball's centre before the test

    def lost(system, u, load, *rest):
        if system.body.nodes.shape == nodes and begun - load.touches[0].centre[2] > beyond:
            raise NotConverged("contact", "none on this mesh", ())
        return find(system, u, load, *rest)

    monkeypatch.setattr(load_steps, "find_equilibrium", lost)


def test_a_run_that_finds_no_equilibrium_goes_on_with_a_new_mesh(renewed, monkeypatch):
    """As one whose mesh was outworn there; where no mesh can be made it ends as it would have."""
    losing(monkeypatch, beyond=5.5)
    found = run("when_needed", DEPTHS, SOFT)
    assert len(found.legs) == 1 and 5.0 < found.legs[0][0] <= 5.5 and found.legs[0][1] < 0.02
    np.testing.assert_allclose(found.Fz, renewed[1].Fz, rtol=0.02)
    for remesh in ("never", "when_needed"):
        monkeypatch.setattr(rezoning, "rezoned", none_at_all)
        with pytest.raises(Stopped, match=r"no equilibrium beyond 5\.\d+ mm") as stopped:
            run(remesh, DEPTHS, SOFT)
        assert stopped.value.cause == "step_limit" and [p.travel for p in stopped.value.points] == [3.0]


def none_at_all(*_):
    raise NoMesh("none")


def test_a_mesh_that_cannot_be_made_anew_is_kept(renewed, monkeypatch):
    monkeypatch.setattr(rezoning, "MAX_FIRST_EDGE_RATIO", 1.7)
    monkeypatch.setattr(rezoning, "rezoned", none_at_all)
    kept = run("when_needed", DEPTHS, SOFT)
    np.testing.assert_allclose(kept.Fz, renewed[1].Fz, rtol=1e-6)
    assert not kept.legs and kept.notes["outworn_mm"] == kept.outworn[-1] < DEPTHS[1]
