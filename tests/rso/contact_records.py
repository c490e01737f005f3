"""Records of an approach whose contact is at 0, by closed forms of contact and nothing of the package."""

from collections.abc import Callable

import numpy as np

E, R = 0.02, 3.0  # MPa of a half-space, with its (1 − ν²), and mm
BODIES: dict[str, Callable[[np.ndarray], np.ndarray]] = {  # force (N) at travels (n,) mm from contact
    "sphere": lambda d: 4.0 / 3.0 * E * R**0.5 * d**1.5,  # Hertz
    "sphere on a soft ellipsoid": lambda d: 4.0 / 3.0 * E * R**0.5 * d**1.5 * (1.0 + 0.1 * d),
    "flat end": lambda d: 2.0 * E * R * d,  # Sneddon (1965)
    "cone": lambda d: 2.0 / np.pi * E * np.tan(np.deg2rad(70.0)) * d**2,  # the same
}
NOISE = 0.004  # of the largest force


def record(rng: np.random.Generator, body: str, before: str, n: int = 121) -> tuple[np.ndarray, np.ndarray]:
    """Depth (mm) and force (N) of readings (n,) that begin 1.2 to 2.8 mm before contact."""
    u = np.linspace(-rng.uniform(1.2, 2.8), 4.0, n)
    force = BODIES[body](np.maximum(u, 0.0))
    most, way = float(force.max()), u - u[0]
    if before == "drift":
        force = force + 0.02 * most * rng.choice([-1.0, 1.0]) * way / way[-1]
    if before == "creep":  # what was touched, or the cell, relaxes since the record began
        force = force + most * rng.uniform(0.02, 0.05) * rng.choice([-1.0, 1.0]) * np.exp(-way / rng.uniform(0.3, 1.3))
    return u, force + NOISE * most * rng.standard_normal(n)
