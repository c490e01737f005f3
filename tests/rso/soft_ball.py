"""A closed form that mimics the source's FE curves: F = mu f(mu D1, u), with the sensitivities of the full model.

    F = 54.6 mu (u/4)^1.335 [Q(c)/Q(c0)]^p(u),  Q = (6 + c)/(6 + 4c),  c = mu D1,  c0 = 0.058,  p = 1.343/(1 + u/1.7)

Q is how an elastic half space softens with compressibility (Hertz); p lets that fade with depth, so that at c0
d ln F/d ln K is 0.030 at 0.4 mm and 0.011 at 4 mm, as finite elements give.  N, mm, MPa.
"""

import numpy as np

from rso.doe import Box
from rso.inference import Data, Model, error_covariance

BOX = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.0034, 1.0), (0.037, 168.0), (True, True))
C0 = 0.058
DEPTH = np.linspace(0.1, 4.0, 40)


def force(mu, D1, u):
    """Force in N; arguments broadcast."""
    mu, D1, u = (np.asarray(v, float) for v in (mu, D1, u))

    def Q(c):
        return (6 + c) / (6 + 4 * c)

    return 54.6 * mu * (u / 4) ** 1.335 * (Q(mu * D1) / Q(C0)) ** (1.343 / (1 + u / 1.7))


def model(box=BOX, depth=DEPTH):
    def predict(X):
        theta = box.from_unit(X)
        return force(theta[:, :1], theta[:, 1:2], depth)

    return Model(box, predict)


def data(mu, D1, noise, rng=None, depth=DEPTH, **more):
    """A measured curve with white noise (N) and whatever `covariance` knows, drawn once (exact without an rng)."""
    F = force(mu, D1, depth)
    C = error_covariance(depth, F, 1.335 * F / depth, white=noise, **more)
    if rng is not None:
        F = F + np.linalg.cholesky(C + 1e-18 * np.eye(len(F))) @ rng.standard_normal(len(F))
    return Data("top", "N", depth, F, C)
