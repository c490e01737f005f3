import numpy as np
import pytest

from rso.optimise.targets import Constraint, Target, objectives, target_residuals, violations

T = (Target("middle", "Fz", 2.0, 0.5, 0.01, "N"), Target("middle", "Fz", 4.0, 1.5, 0.01, "N"))


def test_objectives_are_distances_to_the_targets():
    y = np.array([[0.5, 1.5], [0.6, 1.0]])
    np.testing.assert_allclose(target_residuals(T, y), [[0, 0], [0.1, -0.5]], atol=1e-15)
    np.testing.assert_allclose(objectives(T, y), [[0, 0], [0.1, 0.5]], atol=1e-15)


def test_violations_are_zero_inside_and_distances_outside():
    c = (Constraint("e", "Fx", 2.0, -0.1, 0.1, "N"), Constraint("e", "Fz", 2.0, -np.inf, 1.0, "N"))
    y = np.array([[0.0, -9.0], [0.1, 1.0], [-0.3, 1.25]])
    np.testing.assert_allclose(violations(c, y), [[0, 0], [0, 0], [0.2, 0.25]], atol=1e-15)


def test_nonsense_is_refused():
    with pytest.raises(ValueError, match="finite"):
        Target("e", "Fz", 2.0, np.nan, 0.1, "N")
    with pytest.raises(ValueError, match="low <= high"):
        Constraint("e", "Fz", 2.0, 1.0, 0.0, "N")
    with pytest.raises(ValueError, match=r"\(n, 2\)"):
        objectives(T, np.zeros((3, 1)))
