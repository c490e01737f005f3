"""The same mesh in felupe and here: python benchmarks/fe_felupe.py [--level coarse] [--venv FOLDER]

Neo-Hookean specimen, held below, ball on the top to 4 mm.  felupe is GPL-3 and no dependency: it is installed with
pypardiso into an environment of its own (a temporary folder unless one is named) and runs there, in another process.
Its contact is of nodes with a penalty, so forces agree to about 1 % only.  CPU seconds of one thread, without imports
and set-up; here with augmentation and all derivatives, there without.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PACKAGES = ("felupe==11.3.0", "pypardiso", "numpy", "scipy")
ASKED = (1.0, 2.0, 3.0, 4.0)  # mm
VALUES = {"mu": 0.0099997, "D1": 5.8}
RADIUS = 3.0
PENALTY = 1.0  # N/mm at a node
INCREMENTS = (10, 20, 40)  # to 4 mm: the first number that does not end without a number


def theirs(path: str, increments: int) -> dict[str, object]:
    """Run of felupe with a solution of its linear systems by Pardiso: force (N) at the asked travels, CPU s."""
    import felupe as fem
    import numpy as np
    import pypardiso

    data = np.load(path)
    points = np.vstack([data["nodes"], [0.0, 0.0, data["nodes"][:, 2].max() + RADIUS]])
    field = fem.FieldContainer([fem.Field(fem.RegionQuadraticTetra(fem.Mesh(points, data["cells"], "tetra10")), dim=3)])
    solid = fem.SolidBody(fem.NeoHooke(mu=VALUES["mu"], bulk=2.0 / VALUES["D1"]), field)

    class Ball(fem.mechanics.ContactRigidBase):
        def _kinematics(self, dx):  # type: ignore[no-untyped-def]
            distance = np.linalg.norm(dx, axis=1)
            n = dx / distance[:, None]
            turn = (np.eye(3) - n[:, :, None] * n[:, None, :]) / distance[:, None, None]
            return distance - RADIUS, n, turn

    ball = Ball(field, data["near"], -1, multiplier=PENALTY)
    held = np.vstack([data["held"], [True, True, False]])
    bounds = {
        c: fem.Boundary(field[0], mask=held[:, i], skip=tuple(k != i for k in range(3))) for i, c in enumerate("xyz")
    }
    bounds["move"] = fem.Boundary(field[0], mask=np.arange(len(points)) == len(points) - 1, skip=(1, 1, 0))
    ramp = {bounds["move"]: -np.linspace(0.0, ASKED[-1], increments + 1)[1:]}
    step, force, iterations = fem.Step(items=[solid, ball], ramp=ramp, boundaries=bounds), {}, 0
    start = time.process_time()
    for state in step.generate(x0=field, solver=pypardiso.spsolve, verbose=0):
        travel = -float(field[0].values[-1, 2])
        force[round(travel, 6)] = 4.0 * abs(float(ball.assemble.vector(field).toarray()[-1, 0]))
        iterations += state.iterations
    spent = time.process_time() - start
    return {
        "cpu_s": spent,
        "iterations": iterations,
        "increments": increments,
        "Fz": [force.get(a) for a in ASKED],
        "dofs": int(np.count_nonzero(~held)) - 1,
    }


def ours(level: str, target: Path) -> tuple[list[float], float, dict[str, object]]:
    """Run of the finite elements here; writes the mesh with what is held and what may touch."""
    import numpy as np

    from fem_backend.backend import BACKEND
    from rso.contract import Case, Programme

    case = Case("peer", Programme.ramp(ASKED), {"mesh": {"level": level}})
    solved = BACKEND.solve(VALUES, case)
    body = solved.model.body
    surface = np.unique(solved.model.facets)
    near = surface[np.linalg.norm(body.nodes[surface] - [0.0, 0.0, 35.0], axis=1) < 3.0 * RADIUS]
    np.savez(target, nodes=body.nodes, cells=body.cells, near=near, held=body.free.reshape(-1, 3) < 0)
    start = time.process_time()
    response = BACKEND(VALUES, case)
    return list(response.channels["Fz"]), time.process_time() - start, dict(response.info)


def main() -> None:
    """Print both and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--level", default="coarse")
    parser.add_argument("--venv", type=Path, help="environment with felupe; made where it is missing")
    parser.add_argument("--peer", nargs=2, metavar=("MESH", "INCREMENTS"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peer:
        print(json.dumps(theirs(options.peer[0], int(options.peer[1]))))
        return
    with tempfile.TemporaryDirectory() as folder:
        mesh, venv = Path(folder) / "mesh.npz", options.venv or Path(folder) / "venv"
        force, seconds, info = ours(options.level, mesh)
        here = " ".join(f"{f:.4f}" for f in force)
        print(f"{'here':8s} {seconds:7.2f} s {info['dofs']:6d} dofs {info['iterations']:4d} iterations  {here} N")
        python = venv / "bin" / "python"
        if not python.exists():
            subprocess.run([sys.executable, "-m", "venv", str(venv)], check=True)
            subprocess.run([str(python), "-m", "pip", "install", "-q", *PACKAGES], check=True)
        for increments in INCREMENTS:
            command = [str(python), __file__, "--peer", str(mesh), str(increments)]
            done = subprocess.run(command, capture_output=True, text=True, check=False, env=one_thread())
            if done.returncode == 0:
                break
            print(f"felupe, {increments} increments: {done.stderr.strip().splitlines()[-1]}")
        else:
            raise SystemExit("felupe found no solution")
        there = json.loads(done.stdout.splitlines()[-1])
        shown = " ".join("-" if f is None else f"{f:.4f}" for f in there["Fz"])
        print(
            f"{'felupe':8s} {there['cpu_s']:7.2f} s {there['dofs']:6d} dofs {there['iterations']:4d} iterations  "
            f"{shown} N ({there['increments']} increments)"
        )
        print(f"ratio {there['cpu_s'] / seconds:.1f}  (goal 5)")


def one_thread() -> dict[str, str]:
    """The environment with one thread for every library."""
    return {**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


if __name__ == "__main__":
    main()
