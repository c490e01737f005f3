"""Tangents condensed to the dofs that may touch, and equilibria that keep the body's share of them."""

import dataclasses
import hashlib

import numpy as np
import pytest
from scipy import sparse

from fem_backend.backend import BACKEND
from fem_backend.kinematics import tetrahedra
from fem_backend.laws import NeoHooke
from fem_backend.materials import stress
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation import derivatives as slopes_of
from fem_backend.simulation import experiment, initial_state
from fem_backend.solver import modified_newton, newton
from fem_backend.solver.condensation import OutOfReach, condenser
from fem_backend.solver.direct import NotPositiveDefinite
from rso.contract import Case, Programme, SimulationFailed, object_path

pytest.importorskip("pypardiso")
SINGLE = 1e-4  # round-off of single precision, 6e-8, times a condition of some 10³


def stiffness(body: tetrahedra.Body) -> np.ndarray:
    state = stress.evaluate_stress(NeoHooke(0.01, 5.8), np.zeros((*body.w.shape, 3, 3)), tangent=True)
    return tetrahedra.stiffness(body, state.F, state.S_geometric, state.C)


def touching(body: tetrahedra.Body, dofs: np.ndarray, seed: int, size: float) -> np.ndarray:
    """Data of a positive semi-definite matrix on some of the dofs (c,), as contact has."""
    rng, data = np.random.default_rng(seed), np.zeros(len(body.pattern.indices))
    chosen = rng.choice(dofs, 20, replace=False)
    for i in chosen:
        data[body.pattern.find(np.array([[i]]))[0, 0, 0]] += size * rng.uniform(0.5, 2.0)
    return data


def whole(body: tetrahedra.Body, data: np.ndarray) -> np.ndarray:
    n = body.pattern.size
    upper = sparse.csr_matrix((data, body.pattern.indices, body.pattern.indptr), shape=(n, n))
    return (upper + sparse.triu(upper, 1).T).toarray()


@pytest.fixture
def body(small):
    return small.model.body


@pytest.fixture
def dofs(body):
    return np.random.default_rng(1).choice(body.pattern.size, 60, replace=False)


def test_one_factor_serves_many_contacts(body, dofs):
    """(K + C) x = b by a dense solution of the whole matrix, for contacts that were not there when K was factorised."""
    K, b = stiffness(body), np.random.default_rng(0).normal(size=body.pattern.size)
    stiff = K[body.pattern.diagonal].mean()
    kept = condenser(body.pattern)(dofs)(K, touching(body, dofs, 2, stiff))
    answers = []
    for seed, size in ((2, stiff), (3, 10.0 * stiff), (4, 0.0)):
        C = touching(body, dofs, seed, size)
        x = np.linalg.solve(whole(body, K + C), b)
        answers.append(x)
        np.testing.assert_allclose(kept(C)(b), x, atol=SINGLE * np.abs(x).max())
    assert np.abs(answers[0] - answers[1]).max() > 100 * SINGLE * np.abs(answers[0]).max()  # contacts that matter


def test_contact_elsewhere_is_refused(body, dofs):
    """What would be left out of the condensed matrix in silence is an error."""
    kept = condenser(body.pattern)(dofs)(stiffness(body), np.zeros(len(body.pattern.indices)))
    other = np.setdiff1d(np.arange(body.pattern.size), dofs)
    with pytest.raises(OutOfReach):
        kept(touching(body, other, 0, 1.0))


def test_an_indefinite_matrix_is_refused_and_the_next_one_served(body, dofs):
    """By the body or by the contact; a factor that broke off leaves nothing behind."""
    K, none = stiffness(body), np.zeros(len(body.pattern.indices))
    b = np.random.default_rng(0).normal(size=body.pattern.size)
    condense = condenser(body.pattern)(dofs)
    first = condense(K, none)(none)(b)
    for bad in (-K, K - 10.0 * touching(body, dofs, 0, K.max())):
        with pytest.raises(NotPositiveDefinite):
            condense(bad, none)
    kept = condense(K, none)
    with pytest.raises(NotPositiveDefinite):
        kept(-10.0 * touching(body, dofs, 0, K.max()))
    np.testing.assert_array_equal(kept(none)(b), first)


def test_only_what_can_be_condensed_is(body, dofs):
    on = condenser(body.pattern)
    assert on(np.empty(0, np.int64)) is None
    assert on(dofs) is on(dofs[::-1])  # the analysis is kept
    assert condenser(body.pattern, "superlu")(dofs) is None
    assert condenser(dataclasses.replace(body.pattern, symmetric=False))(dofs) is None


# ------------------------------------------------------------------------------------------------------- equilibria

VALUES = {"mu": 0.01, "D1": 12.0}


def anchored(case: Case, folder) -> Case:
    """The case with an anchor, whose body is less compressible."""
    made = BACKEND.make(BACKEND.recipes(VALUES, case)["anchor"])
    sha = hashlib.sha256(made).hexdigest()
    path = object_path(folder, sha)
    path.parent.mkdir(parents=True)
    path.write_bytes(made)
    return dataclasses.replace(case, artefacts={"anchor": sha}, objects=str(folder))


def test_a_kept_tangent_leads_to_the_same_equilibria(tmp_path, monkeypatch):
    """All channels and derivatives as by Newton, for a fraction of its factorisations; the control has none to keep."""
    case = anchored(Case("kept", Programme.ramp((0.5, 1.0, 2.0)), {"mesh": {"level": "coarse"}}), tmp_path)
    # as they are left otherwise, at 1e-5, they differ by 1e-4
    monkeypatch.setattr(slopes_of, "DERIVATIVE_RESIDUAL_TOLERANCE", 1e-8)
    monkeypatch.setattr(slopes_of, "MAX_DERIVATIVE_REFINEMENTS", 40)
    quick = BACKEND(VALUES, case)
    monkeypatch.setattr(modelling, "condensing", lambda system, model, start, end: system)
    plain = BACKEND(VALUES, case)
    for name, value in plain.channels.items():
        np.testing.assert_allclose(quick.channels[name], value, rtol=1e-8, atol=1e-10, err_msg=name)  # both to 1e-9
    for knob, slopes in plain.gradients.items():
        for name in ("Fz", "uz_max"):  # forward differences of 1e-5 in two places
            np.testing.assert_allclose(quick.gradients[knob][name], slopes[name], rtol=1e-4, err_msg=f"{knob} {name}")
    assert quick.info["factorisations"] < 0.5 * plain.info["factorisations"]


def test_where_keeping_fails_newton_goes_on(tmp_path, monkeypatch):
    """Contact beyond the dofs condensed to: the same answer, by the ordinary way."""
    case = anchored(Case("kept", Programme.ramp((0.5, 1.0)), {"mesh": {"level": "coarse"}}), tmp_path)
    expected, lost = BACKEND(VALUES, case), []
    condensing, solve = modelling.condensing, modified_newton.solve

    def too_few(system, model, start, end):
        found = condensing(system, model, start, end)
        few = newton.reduced(model.body, np.arange(model.body.nodes.size).reshape(-1, 3)).argsort()[:30]
        return dataclasses.replace(found, condense=model.condenser(few))

    def watched(*arguments):
        try:
            return solve(*arguments)
        except newton.NotConverged as error:
            lost.append(error)
            raise

    monkeypatch.setattr(modelling, "condensing", too_few)
    monkeypatch.setattr(modified_newton, "solve", watched)
    found = BACKEND(VALUES, case)
    np.testing.assert_allclose(found.channels["Fz"], expected.channels["Fz"], rtol=1e-8)
    assert lost and all(isinstance(e.__cause__, OutOfReach) for e in lost)


def test_a_shift_is_none_of_the_contact(monkeypatch):
    """A body's tangent that is not definite is shifted until it is, all along its diagonal, and still condensed."""
    case = Case("shifted", Programme.ramp((0.5,)), {"mesh": {"level": "coarse"}})
    found = BACKEND.solve(VALUES, case)
    point = found.result.points[-1]
    at = initial_state.initial_state(found.settings, found.knobs, found.placement, found.model, newton.Counters())
    system = modelling.condensing(at.system, at.model, at.start(0.0), at.start(0.5))
    bulk, counters = newton.bulk_tangent, newton.Counters()

    def indefinite(*arguments):
        data = bulk(*arguments)
        data[at.model.body.pattern.diagonal] -= 2e-3 * np.median(data[at.model.body.pattern.diagonal])
        return data

    def make(body, contact):
        return system.condense(body, contact)(contact)

    monkeypatch.setattr(newton, "bulk_tangent", indefinite)
    solution, _ = newton.factorise(system, point.evaluation, point.load, counters, True, make)
    assert counters.shifts > 2  # not the terms of the contact were to blame
    b = np.random.default_rng(0).normal(size=at.model.body.pattern.size)
    assert b @ solution(b) > 0.0


def test_swept_dofs_hold_all_that_touches():
    """A ball of radius 3 mm that has gone 7 mm down no longer reaches the first dofs that it touched, its way does."""
    case = Case("swept", Programme.ramp((0.5,)), {"mesh": {"level": "coarse"}})
    solved = BACKEND.solve(VALUES, case)
    at = initial_state.initial_state(solved.settings, solved.knobs, solved.placement, solved.model, newton.Counters())
    pressed = (solved.result.points[-1].evaluation.contact.pressure > 0).any(1)
    touched = np.unique(at.system.indenter.surface.facets[pressed])
    mine = at.model.body.free.reshape(-1, 3)[touched]
    held = []
    model = dataclasses.replace(at.model, condenser=lambda dofs: held.append(dofs))
    for deepest in (0.5, 7.0):
        modelling.condensing(at.system, model, at.start(0.0), at.start(deepest))
    assert all(np.isin(mine[mine >= 0], dofs).all() for dofs in held)
    assert len(held[1]) > len(held[0])


def test_bowls_and_long_contacts_are_not_condensed():
    """A bowl touches everywhere; a dense matrix larger than the sparse one saves nothing."""
    for settings in ({"support": {"kind": "bowl", "clearance": 1.0}}, {"point": [2.5, 2.5]}):
        read = experiment.read_settings({"mesh": {"level": "coarse"}, **settings})
        knobs = BACKEND.knobs(VALUES, read)
        placement = modelling.placement_of(read, knobs)
        model = modelling.model_for(read, knobs, placement, None)
        system = modelling.system(read, knobs, placement, model)
        start, end = (modelling.load_at(system, placement, s) for s in (0.0, 6.0))
        assert modelling.condensing(system, model, start, end).condense is None


# -------------------------------------------------------------------------------------------------------- round-off


def test_round_off_ends_an_iteration_and_nothing_else_does():
    assert newton.at_round_off([1e-3, 2e-9, 1.5e-9])
    assert not newton.at_round_off([1e-3, 1e-9, 1e-11])  # still falling
    assert not newton.at_round_off([1.0, 1e-3, 1e-3])  # stuck far away
    assert not newton.at_round_off([1e-9])
    assert newton.at_round_off([1e-3, 3e-6, 2e-6], lambda: 1e-6)  # of a body with elements as large as that
    assert not newton.at_round_off([1e-3, 3e-5, 2e-5], lambda: 1e-6)
    assert not newton.at_round_off([1.0, 1e-3, 1e-3], lambda: 1.0)  # that excuses nothing


def test_a_nearly_incompressible_body_hardly_touched_has_an_answer(monkeypatch):
    """K/μ = 1000, 0.03 mm: the residual of round-off is above the tolerance; what F is says Hertz."""
    case = Case("hardly", Programme.ramp((0.03,)), {"mesh": {"level": "coarse"}})
    values = {"mu": 0.01, "D1": 0.2}
    F = BACKEND(values, case).channels["Fz"][0]
    hertz = 4.0 / 3.0 * 4.0 * 0.01 * np.sqrt(3.0) * 0.03**1.5  # E* = 4 μ where ν = 1/2 (Johnson 1985, eq. 4.23)
    assert 0.5 * hertz < F < 2.0 * hertz  # one element under the ball: no more is to be had of that mesh
    monkeypatch.setattr(newton, "at_round_off", lambda *told: False)
    monkeypatch.setattr(modified_newton, "KEPT_TANGENT_ROUND_OFF_RESIDUAL", 0.0)
    with pytest.raises(SimulationFailed, match="no equilibrium"):
        BACKEND(values, case)
