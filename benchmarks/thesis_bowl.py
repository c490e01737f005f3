"""Set 4 of the thesis in its bowl, and the stress under its ball: python benchmarks/thesis_bowl.py [--pictures FOLDER]

Prints Fz at 4 and 8 mm for clearances of the bowl, which the thesis does not say, beside its 1.3951 N at 8 mm, and what
the stresses on the axis below a shallow contact are beside Hertz's for the same force:

    a³ = 3 F R / 4 E*,    p₀ = 3 F / 2π a²
    σ_z/p₀ = −1/(1 + ζ²),    σ_r/p₀ = −(1 + ν)(1 − ζ arctan 1/ζ) + 1/(2 (1 + ζ²)),    ζ = z/a

(Johnson 1985, eq. 3.43 and 3.45.)
"""

from __future__ import annotations

import fem_backend  # noqa: F401 - before numpy: it sees to one thread, and waiting threads count as CPU time

# isort: split
import argparse
import tomllib
from pathlib import Path

import numpy as np

from fem_backend import output, post
from fem_backend.backend import BACKEND
from rso.contract import Case, Programme, SimulationFailed

THESIS = tomllib.loads((Path(__file__).parents[1] / "studies/thesis/printed.toml").read_text(encoding="utf-8"))
SET_4 = {"mu": 1e-6 * THESIS["sets"]["4"]["mu_Pa"], "D1": THESIS["sets"]["4"]["D1"]}
PRINTED = THESIS["deeper"]["set4_8mm_N"]
CLEARANCES = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
SHALLOW = 0.3  # mm: the contact is small against ball and body, and several elements wide
R = 1.0 / (1.0 / 3.0 + 0.5 * (35.0 / 60.0**2 + 1.0 / 35.0))  # mm, of ball and body at its top
BALL = {"shape": "sphere", "radius": 3.0, "shaft": True}


def forces(level: str) -> None:
    """A row per clearance."""
    print("| clearance mm | Fz N at 4 mm | at 8 mm | of the thesis's |\n|---|---|---|---|")
    for g in CLEARANCES:
        support = {"kind": "bowl", "clearance": g, "friction": 0.2}
        case = Case(
            "bowl",
            Programme.ramp((2.0, 4.0, 6.0, 8.0)),
            {"support": support, "indenter": BALL, "mesh": {"level": level}},
        )
        try:
            found = BACKEND(SET_4, case)
        except SimulationFailed as failed:
            print(f"| {g:g} | – | {failed.cause} | – |", flush=True)
            continue
        F, s = found.channels["Fz"], found.error["Fz"]
        print(
            f"| {g:g} | {F[1]:.4f} ± {s[1]:.4f} | {F[3]:.4f} ± {s[3]:.4f} | {100 * (F[3] / PRINTED - 1):+.1f} % |",
            flush=True,
        )


def stress(folder: Path | None) -> None:
    """Stresses at the nodes on the axis down to three contact radii."""
    settings = {"support": {"kind": "fixed"}, "indenter": BALL, "mesh": {"level": "fine"}}
    solved = BACKEND.solve(SET_4, Case("shallow", Programme.ramp((SHALLOW,)), settings))
    found = BACKEND.response(solved)
    F, k = float(found.channels["Fz"][0]), 2.0 / (SET_4["mu"] * SET_4["D1"])  # K/μ
    ν = (3.0 * k - 2.0) / (6.0 * k + 2.0)
    a = (0.75 * F * R * (1.0 - ν) / (2.0 * SET_4["mu"])) ** (1.0 / 3.0)  # E* = 2 μ/(1 − ν)
    body, point = solved.model.body, solved.result.points[0]
    nodal = post.nodal(body, output.state_fields(solved, point))
    x = body.nodes + point.evaluation.u
    z = point.load.indenter.centre[2] - 3.0 - x[:, 2]
    on = (np.hypot(x[:, 0], x[:, 1]) < 1e-6) & (z > 0.1 * a) & (z < 3.0 * a)
    order = np.argsort(z[on])
    ζ, σ = z[on][order] / a, nodal.cauchy[on][order]
    p0 = 3.0 * F / (2.0 * np.pi * a**2)
    σz, σr = -1 / (1 + ζ**2), -(1 + ν) * (1 - ζ * np.arctan(1 / ζ)) + 1 / (2 * (1 + ζ**2))
    print(
        f"\ntravel {SHALLOW} mm: Fz = {F:.5f} N, a = {a:.3f} mm (of the contact found: "
        f"{float(found.channels['contact_radius'][0]):.3f}), p0 = {p0:.5f} MPa"
    )
    print("\n| z/a | σ_z/p₀ | Hertz | (σ_r − σ_z)/p₀ | Hertz |\n|---|---|---|---|---|")
    for k, one in enumerate(ζ):
        own = σ[k] / p0
        r = 0.5 * (own[0, 0] + own[1, 1])
        print(f"| {one:.2f} | {own[2, 2]:.3f} | {σz[k]:.3f} | {r - own[2, 2]:.3f} | {σr[k] - σz[k]:.3f} |")
    if folder is not None:
        print("\n".join(map(str, output.draw_pictures(solved, folder))))


def main() -> None:
    """Both."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--level", default="coarse")
    parser.add_argument("--pictures", type=Path)
    o = parser.parse_args()
    stress(o.pictures)
    forces(o.level)


if __name__ == "__main__":
    main()
