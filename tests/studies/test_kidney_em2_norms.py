"""The inverse problem of the kidney study on made-up simulations: no finite elements, only the printed lists."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from rso.norms import TrilaterationProblem, fit_trilateration

FOLDER = Path(__file__).parents[2] / "studies" / "kidney_em2"


@pytest.fixture
def modules(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module("simulated"), importlib.import_module("trilateration")


def made_up(simulated, stiff=1.0):
    """Tables of f = 57 (u/4)^1.5 (1 − 0.05 √u) / (1 + 0.3 μD₁), softer by 2 % a doubling of the clearance."""
    nodes, u = np.array(simulated.NODES), simulated.GRID
    f = stiff * 57 * (u / 4) ** 1.5 * (1 - 0.05 * np.sqrt(u)) / (1 + 0.3 * nodes[:, None])
    out = {simulated.HELD: simulated.Table(nodes, u, f * (1 + 0.08 * np.sqrt(u / 4)))}
    for c in simulated.CLEARANCES:
        out[simulated.Support(c)] = simulated.Table(nodes, u, f * c ** (-0.03 * np.sqrt(u / 4)))
    return out


def test_the_lists_are_those_printed(modules):
    _, trilateration = modules
    data = trilateration.lists()
    assert (len(data.nrmse.value), len(data.mre.value), len(data.theta)) == (38, 43, 85)
    assert (data.nrmse.weight.sum(), data.mre.weight.sum()) == (pytest.approx(31), pytest.approx(36))
    # Set 3 is in neither list: it comes in by Table 5.1 alone.
    near = np.max(np.abs(np.log(data.theta[:-4] / data.theta[-2])) / trilateration.NEAR, axis=1)
    assert np.min(near) > 1.0
    assert [p.kind for p in data.table] == ["rrmse", "nrmse", "mre"]


def test_nuisances_do_what_they_say(modules):
    simulated, _ = modules
    theta, u = np.array([[0.01, 5.8], [0.012, 100.0]]), np.arange(1, 41) / 10
    tables = made_up(simulated)
    bowls = [tables[s] for s in simulated.BOWLS]
    S = simulated.Simulations(theta, u, bowls)
    at_half = simulated.ndtr(0.0)  # clearance in the middle of its logarithm
    ν = np.array([0.0, 0.0, -9.0, 0.0, 0.0])  # no penetration
    f = S(ν)[0]
    c = np.sqrt(simulated.CLEARANCES[0] * simulated.CLEARANCES[-1])
    exact = 57 * (u / 4) ** 1.5 * (1 - 0.05 * np.sqrt(u)) * c ** (-0.03 * np.sqrt(u / 4))
    exact = theta[:, :1] * exact / (1 + 0.3 * np.prod(theta, axis=1)[:, None])
    assert at_half == 0.5 and S.clearance(np.zeros(1))[0] == pytest.approx(c)
    # Splines over the nodes, straight lines on the grid and below 0.35 mm: 0.3 %.
    np.testing.assert_allclose(f[:, 3:], exact[:, 3:], rtol=3e-3)
    level, tilt, deep = (S(ν + v)[0] for v in np.array([[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 18, 9, 0]]))
    np.testing.assert_allclose(level, (1 + simulated.LEVEL_SD) * f, rtol=1e-12)
    np.testing.assert_allclose(tilt[:, -1], f[:, -1], rtol=1e-12)
    np.testing.assert_allclose(tilt[:, 0] / f[:, 0], 1 + simulated.TILT_SD * (1 - 0.1 / 4), rtol=1e-12)
    # a = 0.2 mm in proportion to the force: at 4 mm the curve is that of 3.8 mm.
    np.testing.assert_allclose(deep[:, -1], f[:, 37], rtol=1e-6)
    assert np.all(deep < f)


def test_made_up_norms_are_read_back_and_the_other_support_is_rejected(modules):
    simulated, trilateration = modules
    data, tables = trilateration.lists(), made_up(simulated)
    bowl, held = (trilateration.problem(data, tables, held=h, what="lists") for h in (False, True))
    rng = np.random.default_rng(4)
    # The held body is stiffer at depth by 8 %, more than its nuisances can make good.
    for right, wrong in ((bowl, held), (held, bowl)):
        x = np.concatenate([0.5 * rng.standard_normal(right.shape.size), np.zeros(right.nuisances), [-0.2, -0.4]])
        made = trilateration.made_up(right, x, rng)
        a = fit_trilateration(TrilaterationProblem(right.shape, right.known, right.nuisances, made), starts=1)
        b = fit_trilateration(TrilaterationProblem(wrong.shape, wrong.known, wrong.nuisances, made), starts=1)
        assert a.log_evidence > b.log_evidence + 1.0
        y, drawn = right.shape(x[: right.shape.size])[0], right.shape(right.split(a.draws(500, 0))[0])
        off = (drawn.mean(axis=0) - y)[:-1] / drawn.std(axis=0)[:-1]
        assert np.sqrt(np.mean(off**2)) < 2.5
