"""The layer of indentation_backend.py with derivatives of its own: settings `slopes` is "true", "wrong" or "none".

`hole` = [mu_low, mu_high, D1_low, D1_high]: no answer in there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from indentation_backend import Layer

from rso.contract import Case, Response, SimulationFailed

STEP = 1e-6  # of a parameter, for central differences of a closed form: exact to 1e-10


class Sloped(Layer):
    """Backend of `rso.contract`."""

    def check(self, case: Case) -> None:
        super().check(plain(case))

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        found, _ = super().canonical(values, plain(case))
        return found, case

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        hole = case.settings.get("hole")
        if hole and hole[0] < values["mu"] < hole[1] and hole[2] < values.get("D1", 0.0) < hole[3]:
            raise SimulationFailed("contact", "in the hole")
        kind, inner = case.settings.get("slopes", "true"), plain(case)
        answer = super().__call__(values, inner)
        if kind == "none":
            return answer
        quiet = dataclasses.replace(inner, settings={k: v for k, v in inner.settings.items() if k != "log"})
        gradients = {}
        for name in values:
            up, down = (
                super(Sloped, self).__call__({**values, name: values[name] * (1 + s * STEP)}, quiet).channels
                for s in (1, -1)
            )
            sign = -1.0 if kind == "wrong" and name == "D1" else 1.0
            width = 2 * STEP * values[name]
            gradients[name] = {c: sign * (np.asarray(up[c]) - down[c]) / width for c in ("Fz", "uz_max")}
        return dataclasses.replace(answer, gradients=gradients)


def plain(case: Case) -> Case:
    """The case as the layer knows it."""
    settings = {k: v for k, v in case.settings.items() if k not in ("slopes", "hole")}
    return dataclasses.replace(case, settings=settings)


BACKEND = Sloped()
