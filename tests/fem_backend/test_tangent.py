"""The matrix that Newton factors is the derivative of the residual that it drives to zero, effect by effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from fem_backend.contact import tractions
from fem_backend.materials import stress
from fem_backend.solver import load_steps, newton
from fem_backend.solver.load_steps import Control
from fem_backend.solver.newton import Counters, Load, System

BOWL = {"support": {"kind": "bowl", "clearance": 0.5, "friction": 0.0}}
EFFECTS = {
    "plain": ({}, {}),
    "linear elastic": ({}, {"material": {"law": "linear_elastic"}}),
    "mooney_rivlin": ({"C01": 2e-3}, {}),
    "yeoh": ({"C20": 1e-3, "C30": 5e-4}, {}),
    "ogden": ({"alpha": 6.0}, {"material": {"law": "ogden", "ogden": [[-3.0, 0.4]]}}),
    "fibre": ({"fibre": 1e-2, "fibre_k2": 1.0, "fibre_angle": 30.0}, {}),
    "scale": ({"skin_ratio": 3.0, "inclusion_ratio": 5.0}, {}),
    "friction": ({"friction": 0.2}, {}),
    "adhesion": ({"adhesion": 1e-3}, {}),
    "bowl with springs": ({}, BOWL),
    "friction in a bowl": ({"friction": 0.2, "bowl_friction": 0.3}, BOWL),
    "Prony step": ({"prony_g": 0.4, "prony_tau": 1.0, "prony_g2": 0.2}, {}),
    "Mullins": ({"mullins": 0.5}, {}),
    "dead load": ({"weight": 1e-5}, {}),
    "all of it": (
        {"friction": 0.2, "prony_g": 0.3, "mullins": 0.4, "skin_ratio": 2.0, "C20": 1e-3, "adhesion": 1e-4},
        {},
    ),
}


@pytest.fixture(scope="module")
def dimple(graded) -> np.ndarray:
    """The plain body under the ball at 2 mm, (n, 3) mm."""
    return graded.travel([2.0], Control(augmentations=0))[0].evaluation.u


@pytest.fixture
def experiment(make_bench):
    """Effect → its experiment on the graded mesh."""
    mesh = {"mesher": "mapped", "n": 8, "slip": 0.5}
    return lambda effect: make_bench(EFFECTS[effect][0], mesh, **EFFECTS[effect][1])


def deformed(dimple, b) -> np.ndarray:
    """The plain body at 2 mm and a smooth wave, zero where b is held: nowhere in equilibrium and nowhere smooth by
    symmetry; in a bowl, pressed 0.05 mm into it.
    """
    X = b.model.body.nodes
    if len(X) == len(dimple):
        u = dimple
    else:  # a model without symmetry planes: the dimple by a formula
        r = np.linalg.norm(X - b.settings.specimen.top, axis=1)
        u = np.c_[0.0 * r, 0.0 * r, -2.0 * np.exp(-((r / 6.0) ** 2))]
    u = u + 0.02 * np.sin(X @ np.random.default_rng(1).normal(size=(3, 3)) / 10.0)
    if b.knobs.fibre:  # slack fibres carry nothing: where they tighten the force has a kink, so all of them are tight
        along = np.array(b.system().material.fibre.direction)
        u += 0.04 * np.outer(X @ along, along)
    if b.settings.support.loose:
        u[:, 2] -= 0.05
    u[b.model.body.free.reshape(u.shape) < 0] = 0.0
    return u


def state(dimple, b) -> tuple[System, np.ndarray, Load]:
    """System, displacement and a load whose step has a past: Δt, history, start of the friction."""
    system, u = b.system(), deformed(dimple, b)
    load = replace(b.load(2.2), springs=2.0, dt=0.5)
    history = stress.virgin(system.material, *b.model.body.w.shape)
    before = []
    for pair, touch in zip(system.pairs, b.load(2.0).touches, strict=True):
        x = b.model.body.nodes + 0.99 * u
        before.append(
            tractions.contact_history(pair, x, touch, tractions.evaluate_contact(replace(pair, friction=0.0), x, touch))
        )
    if history is not None:
        H = newton.evaluate_system(system, 0.9 * u, replace(load.touching(_with(load, before)), history=history))
        history = H.history
    return system, u, replace(load.touching(_with(load, before)), history=history)


def _with(load: Load, before: list) -> tuple:
    return tuple(replace(t, before=b) for t, b in zip(load.touches, before, strict=True))


def matrix(system: System, u: np.ndarray, load: Load) -> tuple[sparse.csr_matrix, np.ndarray]:
    """What `newton.factorise` hands to the solver, as a whole matrix, and ∂R/∂s."""
    caught: list[np.ndarray] = []

    def keep(data: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        caught.append(data)
        return lambda b: b

    _, moving = newton.factorise(
        replace(system, factor=keep), newton.evaluate_system(system, u, load), load, Counters()
    )
    p = system.body.pattern
    K = sparse.csr_matrix((caught[0], p.indices, p.indptr), shape=(p.size, p.size))
    return (K + sparse.triu(K, 1).T if p.symmetric else K).tocsr(), newton.reduced(system.body, moving)


@pytest.mark.parametrize("effect", EFFECTS)
def test_tangent_is_the_derivative_of_the_residual(dimple, experiment, slopes, effect):
    """‖R(u + tv) − R(u) − t K v‖ = O(t²), and one per mille in K is seen."""
    system, u, load = state(dimple, b := experiment(effect))
    v = np.cos(b.model.body.nodes @ np.random.default_rng(2).normal(size=(3, 3)) / 5.0)
    v[b.model.body.free.reshape(u.shape) < 0] = 0.0
    K, _ = matrix(system, u, load)
    R = newton.reduced(b.model.body, newton.evaluate_system(system, u, load).residual)
    Kv = K @ newton.reduced(b.model.body, v)
    steps = 10.0 ** np.array([-4.0, -4.5, -5.0, -5.5])  # small: contact points must not change sides
    change = [newton.reduced(b.model.body, newton.evaluate_system(system, u + t * v, load).residual) - R for t in steps]
    error = np.array([np.linalg.norm(c - t * Kv) for c, t in zip(change, steps, strict=True)])
    at = newton.evaluate_system(system, u, load).contacts
    assert all((s.pressure > 0).sum() >= 8 for s in at), [(s.pressure > 0).sum() for s in at]  # every pair in contact
    if b.knobs.friction:
        assert 0 < at[0].slipping[at[0].pressure > 0].mean() < 1  # some stick, some slip
    np.testing.assert_allclose(slopes(error, steps), 2.0, atol=0.15, err_msg=str(error / np.linalg.norm(Kv) / steps))
    wrong = np.array([np.linalg.norm(c - 1.001 * t * Kv) for c, t in zip(change, steps, strict=True)])
    assert slopes(wrong, steps)[-1] < 1.3


@pytest.mark.parametrize("effect", ["plain", "friction"])
def test_derivative_by_the_travel(dimple, experiment, slopes, effect):
    """∂R/∂s of a step that ends at travel s."""
    system, u, load = state(dimple, b := experiment(effect))
    _, moving = matrix(system, u, load)
    R = newton.reduced(b.model.body, newton.evaluate_system(system, u, load).residual)
    steps = 10.0 ** np.array([-4.0, -4.5, -5.0, -5.5])
    error = []
    for t in steps:
        centre = load.indenter.centre + t * load.indenter.direction
        moved = replace(load, indenter=replace(load.indenter, centre=centre))
        change = newton.reduced(b.model.body, newton.evaluate_system(system, u, moved).residual) - R
        error.append(np.linalg.norm(change - t * moving))
    np.testing.assert_allclose(slopes(np.array(error), steps), 2.0, atol=0.15)


@pytest.mark.parametrize("effect", [k for k in EFFECTS if "friction" not in k and k != "all of it"])
def test_residual_is_the_derivative_of_the_potential(dimple, experiment, slopes, effect):
    """|Π(u + tv) − Π(u) − t R·v| = O(t²) wherever newton searches along the potential.

    Viscous and softening steps: the potential is the incremental one.
    """
    system, u, load = state(dimple, b := experiment(effect))
    v = deformed(dimple, b)
    at = newton.evaluate_system(system, u, load)
    first = float((at.residual * v).sum())
    steps = 10.0 ** np.array([-2.0, -2.5, -3.0])
    error = np.array(
        [abs(newton.evaluate_system(system, u + t * v, load).energy - at.energy - t * first) for t in steps]
    )
    np.testing.assert_allclose(slopes(error, steps), 2.0, atol=0.15, err_msg=str(error))


def test_only_friction_makes_the_matrix_unsymmetric(dimple, graded, experiment):
    """The same step stored both ways is the same matrix; friction that slips has an unsymmetric one."""
    for friction in (0.0, 0.2):
        b = experiment("friction")  # a full pattern
        system, u, load = state(dimple, b)
        system = system.each(lambda p, friction=friction: replace(p, friction=friction))
        K, _ = matrix(system, u, load)
        skew = np.abs((K - K.T).data).max() / np.abs(K.data).max()
        assert skew < 1e-14 if friction == 0.0 else skew > 1e-4
        if friction == 0.0:
            upper, u2, load2 = state(dimple, graded)
            other, _ = matrix(upper, u2, load2)
            perm = full_order(b.model.body.free, graded.model.body.free)
            np.testing.assert_allclose((K[perm][:, perm] - other).data, 0.0, atol=1e-13 * np.abs(K.data).max())


def full_order(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Numbers in `a` of the dofs in the order of `b`."""
    order = np.empty((b >= 0).sum(), np.int64)
    order[b[b >= 0]] = a[b >= 0]
    return order


def test_search_without_a_potential_finds_the_same_state(small):
    """Friction's line search (residual normal to the step) on a problem that has a potential."""
    system, load = small.system(), small.load(0.8)
    frictional = replace(system, indenter=replace(system.indenter, friction=1e-30))
    x = small.model.body.nodes
    touch = load.indenter
    before = tractions.contact_history(system.indenter, x, touch, tractions.evaluate_contact(system.indenter, x, touch))
    u = np.zeros_like(x)
    one = newton.solve(system, u, load, 1e-10, Counters())
    two = newton.solve(frictional, u, replace(load, indenter=replace(touch, before=before)), 1e-10, Counters())
    np.testing.assert_allclose(two.evaluation.u, one.evaluation.u, atol=1e-9)
    assert load_steps.Control().tight < 1e-8
