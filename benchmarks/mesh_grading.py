"""Which grading of the quarter mesh buys most accuracy: python benchmarks/mesh_grading.py [--templates]

Prints, for every grading and a few meshes of each (fTetWild scatters), the error of the force against a Richardson
limit at all depths and for two ratios K/μ, and what it costs.  With --templates it makes the meshes that are shipped
anew and writes them into the package: the best of several of each level, by the worst error over all depths among the
meshes whose elements are good.  Times are CPU seconds of one thread; the whole takes about half an hour.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from fem_backend.simulation import assembly, experiment, indentation

from fem_backend import meshing  # isort: skip (pins the threads before numpy)
from fem_backend.meshing import Mesh, Sizing, templates
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver.load_steps import Instant

import numpy as np  # isort: skip

ASKED = np.array([0.5, 1.0, 2.0, 3.0, 4.0])  # mm
LAWS = (Knobs(mu=0.01, D1=5.8), Knobs(mu=0.01, D1=1.0))  # K/μ = 34.5 and 200
HMAX = 1.15 * 35.0
BASE = Sizing(1.6, 2.5, 0.9, HMAX)  # of the limit: a crude mesh and the shipped coarse one, each cut into 1 and 8
GRADINGS = {
    "fine centre": Sizing(0.3, 0.3, 0.5, HMAX),
    "small core": Sizing(0.45, 0.8, 0.5, HMAX),
    "small core, slower": Sizing(0.45, 0.8, 0.4, HMAX),
    "middle core": Sizing(0.6, 1.2, 0.45, HMAX),
    "wide core": Sizing(0.8, 2.5, 0.45, HMAX),
    "wide core, faster": Sizing(0.8, 2.5, 0.6, HMAX),
    "wide core, finer": Sizing(0.6, 2.5, 0.4, HMAX),
    "wider core": Sizing(0.7, 3.0, 0.55, HMAX),
    "wide core, hmax 15": Sizing(0.8, 2.5, 0.45, 15.0),
    "deep (lift -2)": Sizing(0.7, 2.5, 0.45, HMAX, -2.0),
    "lens (lift 1)": Sizing(0.75, 3.0, 0.65, HMAX, 1.0),
    "lens (lift 3)": Sizing(0.9, 2.5, 0.65, HMAX, 3.0),
    "lens (lift 3), finer": Sizing(0.7, 2.5, 0.5, HMAX, 3.0),
}
TRIES = {"coarse": 6, "standard": 4, "fine": 2}  # meshes of a level to choose from
JITTER = 0.01  # of h0 from mesh to mesh of one grading: fTetWild then goes another way
GOOD = 0.2  # scaled Jacobian


@dataclass(frozen=True)
class Row:
    """A mesh and what it gave: forces (law, depth) N, CPU seconds per factorisation and of a run."""

    mesh: Mesh
    sizing: Sizing | None
    dofs: int
    worst: float
    force: np.ndarray
    factor_s: float
    run_s: float


def measure(mesh: Mesh, sizing: Sizing | None = None) -> Row:
    """Forces of one mesh for both laws."""
    settings = experiment.read_settings({})
    place = assembly.placement_of(settings, LAWS[0])
    made = assembly.build_model(settings, mesh, place.specimen, place.planes)
    instants = [Instant(d, d, True) for d in ASKED]
    results = [indentation.simulate_indentation(settings, law, place, made, instants) for law in LAWS]
    work, seconds = results[0].counters, results[0].cpu_s
    worst = float(meshing.scaled_jacobian(made.mesh).min())
    force = np.array([r.Fz for r in results])
    return Row(mesh, sizing, made.body.pattern.size, worst, force, seconds / work.factorisations, seconds)


def tries(sizing: Sizing, count: int) -> list[Row]:
    """Several meshes of one grading, those that cannot be used left out."""
    rows = []
    for k in range(count):
        jittered = replace(sizing, h0=sizing.h0 * (1.0 + JITTER * k))
        try:
            rows.append(measure(meshing.make_mesh(meshing.tetwild_recipe(templates.TEMPLATE_BODY, jittered)), jittered))
        except (meshing.BadMesh, ArithmeticError, ValueError) as error:
            print(f"  a mesh of {asdict(jittered)} is left out: {error}")
    return rows


def limit(crude: Row, good: Row) -> np.ndarray:
    """Richardson limit (law, depth) N from two meshes, each cut into 1 and into 8.

    F(h/2) − F = k (F(h) − F) for both: the median of k over depths and laws is used for all of them, since depth by
    depth it scatters.  The error of the limit is about 0.15 %, seen from other pairs and from k between 1/8 and 1/4.
    """
    first, second = (
        (row.force, measure(meshing.subdivided(templates.TEMPLATE_BODY, row.mesh, 2)).force) for row in (crude, good)
    )
    k = float(np.median((first[1] - second[1]) / (first[0] - second[0])))
    print(f"rate of convergence h^{-np.log2(k):.1f}; limit for K/μ = 34 and 200, N")
    force = (second[1] - k * second[0]) / (1.0 - k)
    print("\n".join(" ".join(f"{f:.5f}" for f in law) for law in force))
    return force


def errors(row: Row, force: np.ndarray) -> np.ndarray:
    """Errors of the force in % (law, depth)."""
    return 100.0 * (row.force / force - 1.0)


def table(rows: dict[str, list[Row]], force: np.ndarray) -> None:
    """One line a mesh, in the order of cost."""
    depths = " ".join(f"{d:5g}" for d in ASKED)
    print(f"\n{'grading':20} {'dofs':>6} {'s/fact.':>7} {'run s':>6} {'Jac.':>5}   error % at {depths} mm, K/μ 34; 200")
    for name, row in sorted(((n, r) for n, rs in rows.items() for r in rs), key=lambda pair: pair[1].dofs):
        e = "   ".join(" ".join(f"{v:+5.2f}" for v in law) for law in errors(row, force))
        print(f"{name:20} {row.dofs:6d} {row.factor_s:7.3f} {row.run_s:6.1f} {row.worst:5.2f}            {e}")


def best(rows: list[Row], force: np.ndarray) -> Row:
    """The smallest mean square error over all depths and both laws among the meshes with good elements."""
    good = [r for r in rows if r.worst > GOOD] or rows
    return min(good, key=lambda r: float(np.mean(errors(r, force) ** 2)))


def write_templates(force: np.ndarray) -> dict[str, list[Row]]:
    """Make every level several times, keep the best in the package."""
    folder = Path(templates.__file__).parent
    rows = {level: tries(templates.TEMPLATE_SIZINGS[level], count) for level, count in TRIES.items()}
    chosen = {level: best(found, force) for level, found in rows.items()}
    chosen["reference"] = measure(meshing.subdivided(templates.TEMPLATE_BODY, chosen["coarse"].mesh, 2))
    for level, row in chosen.items():
        words = json.dumps(asdict(row.sizing)) if row.sizing else "coarse, every tetrahedron cut into eight"
        (folder / f"{level}.npz").write_bytes(templates.template_bytes(row.mesh, words))
    return {**rows, "reference": [chosen["reference"]]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--templates", action="store_true", help="make the shipped meshes anew")
    again = parser.parse_args().templates
    FORCE = limit(tries(BASE, 1)[0], measure(meshing.template_mesh("coarse")))
    table(write_templates(FORCE) if again else {n: tries(s, 2) for n, s in GRADINGS.items()}, FORCE)
    if not again:
        table({level: [measure(meshing.template_mesh(level))] for level in templates.TEMPLATE_SIZINGS}, FORCE)
