"""What the loss of volume under the ball would tell of D1: a formula, finite elements beside it, what to measure.

    ΔV = ∫ (J − 1) dV = −D1/6 · Σ f · x = −D1 F h/6

For W = μ/2 (Ī₁ − 3) + (J − 1)²/D1 a third of the trace of the Cauchy stress is 2 (J − 1)/D1 whatever the deformation,
and the mean of the stress over a body follows from the forces on its surface (Signorini).  For a body that is pressed
with F by a ball above and carried by a smooth bowl below, h is the distance of the contacts: its own height, to 2 %.
Nothing else enters, not μ and not the clearance.  (dV and J dV are taken as one: 2 % at D1 = 100.)

Run from the root of the checkout (half a minute):

    python -m studies.kidney_em2.volume
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from fem_backend.backend import BACKEND
from fem_backend.simulation.assembly import multiplicity
from rso.contract import Case, Programme

FOLDER = Path(__file__).parent
HEIGHT = 70.0  # mm, of the specimen
RESOLUTIONS = (2.0, 20.0)  # mm³, sd of a measured change: a capillary of 1 mm² read to 2 mm, and to 2 cm


def loss(D1: float, force: float, height: float = HEIGHT) -> float:
    """Loss of volume (mm³) by the formula: D1 (1/MPa), force (N), height (mm)."""
    return D1 * force * height / 6.0


def simulated(mu: float, D1: float, depth: float, settings: dict[str, Any]) -> tuple[float, float]:
    """Force (N) and loss of volume (mm³) at a depth (mm), by finite elements."""
    solved = BACKEND.solve({"mu": mu, "D1": D1}, Case("volume", Programme.ramp((depth / 2, depth)), settings))
    J = np.linalg.det(np.eye(3) + solved.result.points[-1].evaluation.H)
    lost = -multiplicity(solved.placement) * float(np.sum((J - 1.0) * solved.model.body.w))
    return float(solved.result.channels["Fz"][-1]), lost


def known(D1: float, lost: float, resolution: float) -> float:
    """sd of ln D1 from a loss of volume (mm³) known to a resolution (mm³): d ln ΔV/d ln D1 is 1."""
    return resolution / lost


def table() -> list[str]:
    """Rows of Markdown: D1, force, loss by finite elements and by the formula, sd of D1."""
    study = tomllib.loads((FOLDER / "study.toml").read_text(encoding="utf-8"))
    settings = study["backend"]["settings"]
    heads = [f"D₁ known to, ΔV read to {r:g} mm³" for r in RESOLUTIONS]
    rows = [
        f"| D₁ MPa⁻¹ | Fz at 4 mm, N | ΔV simulated mm³ | ΔV by D₁Fh/6 mm³ | {' | '.join(heads)} |",
        f"|{'---|' * (4 + len(heads))}",
    ]
    for D1 in study["next"]["truths"]["D1"]:
        force, lost = simulated(0.01, float(D1), 4.0, settings)
        each = [_words(known(D1, lost, r)) for r in RESOLUTIONS]
        rows.append(f"| {D1:g} | {force:.3f} | {lost:.1f} | {loss(D1, force):.1f} | {' | '.join(each)} |")
    return rows


def _words(sd: float) -> str:
    if sd < 0.2:
        return f"±{100 * sd:.2g} %"
    return f"a factor {math.exp(sd):.2g}" if sd < 1.5 else "not at all"


if __name__ == "__main__":
    print("\n".join(table()))
