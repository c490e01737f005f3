"""Derivatives of every channel by the material knobs, by direct differentiation of converged states."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from fem_backend.laws import LAWS
from fem_backend.simulation import assembly as modelling
from fem_backend.simulation.initial_state import InitialState
from fem_backend.simulation.outputs import FORCES, channels, units, whole
from fem_backend.solver import load_steps, newton
from fem_backend.solver.newton import Load, System
from fem_backend.specimens import own_laws

KNOB_DIFFERENCE_SHARE = 1e-5  # of a knob: truncation and round-off (K/μ = 10³) alike
# of a derivative's residual, and how often at most
DERIVATIVE_RESIDUAL_TOLERANCE, MAX_DERIVATIVE_REFINEMENTS = 1e-4, 10
UNITS_OF_STRESS = ("N", "MPa")  # units of what grows with all moduli
ZONE_KNOBS = ("skin_ratio", "inclusion_ratio")


def material_knobs() -> tuple[str, ...]:
    """Knobs by which runs are differentiated."""
    own = sorted(own_laws.everything())
    return ("mu", "D1", *(f.name for k in LAWS.knobs() for f in fields(k)), "fibre", "fibre_k2", *ZONE_KNOBS, *own)


def stress_powers() -> dict[str, int]:
    """Power of a stress in the knobs that have one, besides mu."""
    of_laws = {k: p for law in LAWS.members.values() for k, p in law.powers.items()}
    return {"D1": -1, **of_laws, "fibre": 1, **own_laws.own_law_powers()}


class Slopes:
    """d(channel)/d(knob) at converged points by direct differentiation, also through the multipliers.

    K du/dθ = −∂R/∂θ − ∂R/∂λ dλ/dθ at each stage, with the last factor of that stage and iterative refinement; every
    derivative along (u, θ, λ) is a forward difference of the residual or of the channels, which costs no factorisation.
    Refinement starts at the derivative of the stage before.  What a residual r that is left makes of the indenter's
    force along its way d is known to first order and added: ∂(F·d)/∂u = −∂R/∂s, so that K⁻¹r takes (du/ds)·r from it
    (the adjoint of a potential needs no solution of its own).

    μ is not differentiated: all moduli grown alike change no displacement, so a channel c of the dimension stressⁿ has
    μ ∂c/∂μ = n c − Σ p θ ∂c/∂θ over the knobs θ of the dimension stressᵖ (Euler's identity).
    """

    def __init__(self, at: InitialState, names: Sequence[str]) -> None:
        self.at, self.names = at, tuple(names)
        self.rows: dict[str, dict[float, dict[str, float]]] = {name: {} for name in names}
        self._powers = {n: p for n, p in stress_powers().items() if getattr(at.knobs, n)} if "mu" in names else {}
        self._ends: dict[str, tuple[float, System]] = {}
        for name in dict.fromkeys([n for n in names if n != "mu"] + list(self._powers)):
            value = getattr(at.knobs, name)
            h = KNOB_DIFFERENCE_SHARE * (
                abs(value) or (at.system.material.shear_modulus if name in stress_powers() else 1.0)
            )
            end = replace(at.knobs, **{name: value + h})
            high = modelling.system(at.settings, end, at.placement, at.model, at.system)
            if name in ZONE_KNOBS:
                scale = modelling.stiffening(at.settings, end, at.placement, at.model.body)
                high = high if scale is None else replace(high, scale=scale)
            self._ends[name] = h, high
        self._dlambda: dict[str, list[np.ndarray]] = {}
        self._known: dict[str, tuple[np.ndarray, float]] = {}  # du/dθ, |∂R/∂θ| of the stage before
        self.cpu_s = 0.0

    def __call__(self, stage: load_steps.Stage, last: bool) -> None:
        """Differentiate one stage; the derivatives of its pressures are those of the next stage's multipliers."""
        at, body, started = stage.equilibrium.evaluation, self.at.system.body, time.process_time()
        here = channels(self.at, self.at.system, at, stage.load) if last and self.names else {}
        rows: dict[str, dict[str, float]] = {}
        for name, (h, high) in self._ends.items():
            du, first = self._known.get(name, (np.zeros_like(at.u), 0.0))
            dlambda = self._dlambda.pop(name, None)
            if dlambda is None or not any(t.multiplier.any() for t in stage.load.touches):
                # a first stage; what is kept may be of an attempt that broke off
                dlambda = [np.zeros_like(t.multiplier) for t in stage.load.touches]
                du, first = np.zeros_like(at.u), 0.0
            touches = tuple(
                replace(t, multiplier=t.multiplier + h * d) for t, d in zip(stage.load.touches, dlambda, strict=True)
            )
            load, left = stage.load.touching(touches), np.inf
            for k in range(MAX_DERIVATIVE_REFINEMENTS + 1):  # the factor may be of an earlier iterate
                change = (newton.evaluate_system(high, at.u + h * du, load).residual - at.residual) / h
                before, left = left, float(np.linalg.norm(newton.reduced(body, change)))
                first = first or left
                if (
                    left <= DERIVATIVE_RESIDUAL_TOLERANCE * first
                    or left > 0.9 * before
                    or k == MAX_DERIVATIVE_REFINEMENTS
                ):
                    break
                assert stage.equilibrium.linear is not None  # which was asked for
                du = du - stage.equilibrium.linear(change)
                if not last and before < np.inf and left**2 / before <= 0.3 * DERIVATIVE_RESIDUAL_TOLERANCE * first:
                    break  # the step just made leaves about the share that the one before it left
            self._known[name] = du, first
            end = replace(at, u=at.u + h * du, contacts=newton.contact_states(high, at.u + h * du, load))
            if last:
                there = channels(self.at, high, end, stage.load)
                rows[name] = {c: (v - here[c]) / h for c, v in there.items()}
                taken = float(newton.reduced(body, stage.equilibrium.rate) @ newton.reduced(body, change))
                for c, v in zip(FORCES, whole(self.at.placement, -taken * self.at.placement.direction), strict=True):
                    rows[name][c] += v
            else:
                self._dlambda[name] = [
                    (b.multiplier - a.multiplier) / h for a, b in zip(at.contacts, end.contacts, strict=True)
                ]
        if last:
            rows |= {"mu": self._similar(here, rows)} if "mu" in self.names else {}
            for name in self.names:
                self.rows[name][travel_of(self.at, stage.load)] = rows[name]
        self.cpu_s += time.process_time() - started

    def on(self, at: InitialState) -> Slopes:
        """The same on another mesh, with the rows so far."""
        other = Slopes(at, self.names)
        other.rows = self.rows
        return other

    def field(self, name: str) -> np.ndarray:
        """du/dθ (n, 3) mm per unit of the knob at the stage differentiated last."""
        return self._known[name][0]

    def _similar(self, here: Mapping[str, float], rows: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
        """∂c/∂μ of every channel c from its value and its derivatives by the other moduli."""
        knobs, unit = self.at.knobs, units(self.at.settings)

        def others(c: str) -> float:
            return sum(p * getattr(knobs, n) * rows[n][c] for n, p in self._powers.items())

        return {c: (float(unit[c] in UNITS_OF_STRESS) * v - others(c)) / knobs.mu for c, v in here.items()}

    def at_travels(self, travels: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
        """Gradients (k,) in the order of the points."""
        out: dict[str, dict[str, np.ndarray]] = {}
        for name, rows in self.rows.items():
            known = np.array(list(rows))
            chosen = [rows[known[np.argmin(np.abs(known - s))]] for s in travels] if rows else []
            out[name] = {c: np.array([r[c] for r in chosen]) for c in chosen[0]} if chosen else {}
        return out


def travel_of(at: InitialState, load: Load) -> float:
    """Travel (mm) of the indenter in a load."""
    return float((load.pressing.centre - at.placement.touch) @ at.placement.direction) - at.lag
