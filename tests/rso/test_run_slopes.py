"""Slopes of simulated curves: a run's own derivatives, runs beside it for the others, no guess where none answers."""

import numpy as np
import pytest

from rso.doe import Box
from rso.inference.output_derivatives import NoSlopes, jacobian

BOX = Box(("mu", "c"), ("MPa", "1"), (1.0, 0.0), (100.0, 2.0), (True, False))
U = np.linspace(0.1, 2.0, 7)


def curve(x):
    mu, c = BOX.from_unit(np.asarray(x, float))
    return mu * U**1.5 * (1 + c * U)


def exact(x):
    """∂f/∂x in the unit cube: mu = 100^x₀, c = 2 x₁."""
    mu, _ = BOX.from_unit(np.asarray(x, float))
    return np.stack([np.log(100.0) * curve(x), 2.0 * mu * U**2.5], axis=1)


def own(x, *names):
    mu, c = BOX.from_unit(x)
    every = {"mu": U**1.5 * (1 + c * U), "c": mu * U**2.5}
    return {n: every[n] for n in names}


@pytest.mark.parametrize("names", [(), ("mu",), ("c",), ("mu", "c")])
@pytest.mark.parametrize("x", [(0.3, 0.6), (0.0, 1.0)])
def test_slopes_are_those_of_the_curve_however_they_are_got(names, x):
    x, asked = np.array(x), []

    def look(points):
        asked.extend(points)
        return [curve(p) for p in points]

    J = jacobian(BOX, x, curve(x), own(x, *names), look)
    # Forward differences over 1e-3 of a range of two decades are off by 1e-3 ln(100)/2.
    np.testing.assert_allclose(J, exact(x), rtol=3e-3)
    assert len(asked) == 2 - len(names) and all(np.all((0 <= p) & (p <= 1)) for p in asked)


def test_where_one_side_has_no_answer_the_other_is_asked_and_without_both_nothing_is_said():
    x = np.array([0.3, 0.6])

    def only(side):
        return lambda points: [curve(p) if side * (p[1] - x[1]) > 0 else "too soft" for p in points]

    for side in (1.0, -1.0):
        J = jacobian(BOX, x, curve(x), own(x, "mu"), only(side))
        np.testing.assert_allclose(J[:, 1], exact(x)[:, 1], rtol=3e-3)
    with pytest.raises(NoSlopes, match=r"changes with c is not known.*too soft"):
        jacobian(BOX, x, curve(x), own(x, "mu"), lambda points: ["too soft"] * len(points))
