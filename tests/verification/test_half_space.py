"""The half space of the long verification on its two coarsest meshes: in the daily tests, so that it keeps running."""

import numpy as np
from half_space import half_space

from fem_backend import closed_forms
from fem_backend.simulation.knobs import Knobs


def test_a_ball_on_a_half_space_nears_hertz_from_above():
    """Elements too few across the contact are too stiff: +14 and +8 % at 8 and 10 layers (limit: see the long set)."""
    law, R, L = Knobs(mu=0.01, D1=5.8), 3.0, 60.0
    h = np.array([0.07, 0.1])
    E, nu = closed_forms.youngs_modulus(law.mu, 2 / law.D1), closed_forms.poisson_ratio(law.mu, 2 / law.D1)
    hertz = closed_forms.hertz_force(h, R, E, nu)
    crude, finer = ((half_space(n, 1.2 / n, L, R, h[-1]).solve(law, h).Fz / hertz - 1).mean() for n in (8, 10))
    assert 0.0 < finer < crude < 0.2
