"""The same meridian in felupe and here: `python benchmarks/meridian_felupe.py [--level standard] [--venv FOLDER]`.

Neo-Hookean slab of 6 mm bonded to a plate, ball of 3 mm to 1.5 mm in 20 depths (felupe ends before 2.1 mm).  felupe is
GPL-3 and no dependency: it is installed with pypardiso into an environment of its own (a temporary folder unless one is
named) and runs there, in another process.  It gets the same triangles without their bubbles, and the fewest increments
with which it ends.  Its contact is of nodes with a penalty; it has no derivatives and no second mesh for its error.
CPU seconds of one thread, without imports and set-up; medians of three.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fe_felupe import PACKAGES, one_thread

THICKNESS, RADIUS, DEPTH, DEPTHS = 6.0, 3.0, 1.5, 20  # mm, but for the number of depths; deeper felupe ends
VALUES = {"mu": 0.0099997, "D1": 5.8}
PENALTY = 1.0  # N/mm at a node
INCREMENTS = (1, 2, 4, 8)  # to every depth: the first number that does not end without a number
ROUNDS = 3


def theirs(path: str, increments: int) -> dict[str, object]:
    """Run of felupe: force (N) at the depths, CPU s, iterations and unknowns."""
    import felupe as fem
    import numpy as np
    import pypardiso

    data = np.load(path)
    top = len(data["points"])
    points = np.vstack([data["points"], [-(THICKNESS + RADIUS), 0.0]])
    region = fem.RegionQuadraticTriangle(fem.Mesh(points, data["cells"], "triangle6"))
    field = fem.FieldContainer([fem.FieldAxisymmetric(region, dim=2)])
    solid = fem.SolidBody(fem.NeoHooke(mu=VALUES["mu"], bulk=2.0 / VALUES["D1"]), field)

    class Ball(fem.mechanics.ContactRigidBase):
        def _kinematics(self, dx):  # type: ignore[no-untyped-def]
            distance = np.linalg.norm(dx, axis=1)
            n = dx / distance[:, None]
            return distance - RADIUS, n, (np.eye(2) - n[:, :, None] * n[:, None, :]) / distance[:, None, None]

    ball = Ball(field, data["near"], -1, multiplier=PENALTY)
    held = np.vstack([data["held"], [False, True]])
    bounds = {
        c: fem.Boundary(field[0], mask=held[:, i], skip=(int(i == 1), int(i == 0))) for i, c in enumerate(("z", "r"))
    }
    bounds["move"] = fem.Boundary(field[0], mask=np.arange(top + 1) == top, skip=(0, 1))
    ramp = {bounds["move"]: np.linspace(0.0, DEPTH, DEPTHS * increments + 1)[1:]}
    step, force, iterations = fem.Step(items=[solid, ball], ramp=ramp, boundaries=bounds), [], 0
    start = time.process_time()
    for state in step.generate(x0=field, solver=pypardiso.spsolve, verbose=0):
        force.append(abs(float(ball.assemble.vector(field).toarray()[-2, 0])))
        iterations += state.iterations
    return {
        "cpu_s": time.process_time() - start,
        "iterations": iterations,
        "Fz": force[increments - 1 :: increments],
        "dofs": int(np.count_nonzero(~held)) - 1,
    }


def ours(level: str, target: Path) -> tuple[list[float], list[float], dict[str, object]]:
    """Run of the finite elements here: force (N), CPU s of each round, info; writes the mesh for the other."""
    import numpy as np

    from fem_backend.backend import BACKEND
    from rso.contract import Case, Programme

    depths = tuple(DEPTH * (i + 1) / DEPTHS for i in range(DEPTHS))
    settings = {
        "specimen": {"shape": "slab", "thickness": THICKNESS},
        "indenter": {"shape": "sphere", "radius": RADIUS, "shaft": False},
        "support": {"kind": "bonded"},
        "mesh": {"level": level},
    }
    case = Case("peer", Programme.ramp(depths), settings)
    body = BACKEND.solve(VALUES, case).model.body
    corners = np.unique(body.cells[:, :6])
    where = np.full(len(body.nodes), -1)
    where[corners] = np.arange(len(corners))
    r, z = body.nodes[corners, 0], body.nodes[corners, 2]
    near = np.flatnonzero((np.abs(z - THICKNESS) < 1e-9) & (r < 3.0 * RADIUS))
    held = body.free.reshape(-1, 3)[corners][:, [2, 0]] < 0
    np.savez(target, points=np.stack([-z, r], axis=1), cells=where[body.cells[:, :6]], near=near, held=held)
    spent = []
    for _ in range(ROUNDS):
        start = time.process_time()
        response = BACKEND(VALUES, case)
        spent.append(time.process_time() - start)
    return [float(f) for f in response.channels["Fz"]], spent, dict(response.info)


def main() -> None:
    """Print both, the largest difference of the forces and the ratio of the times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--level", default="standard")
    parser.add_argument("--venv", type=Path, help="environment with felupe; made where it is missing")
    parser.add_argument("--peer", nargs=2, metavar=("MESH", "INCREMENTS"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peer:
        print(json.dumps(theirs(options.peer[0], int(options.peer[1]))))
        return
    with tempfile.TemporaryDirectory() as folder:
        mesh, venv = Path(folder) / "mesh.npz", options.venv or Path(folder) / "venv"
        force, spent, info = ours(options.level, mesh)
        seconds = statistics.median(spent)
        print(f"here   {seconds:6.2f} s  {info['dofs']:5d} unknowns  {info['iterations']:4d} iterations")
        python = venv / "bin" / "python"
        if not python.exists():
            subprocess.run([sys.executable, "-m", "venv", str(venv)], check=True)
            subprocess.run([str(python), "-m", "pip", "install", "-q", *PACKAGES], check=True)
        for increments in INCREMENTS:
            command = [str(python), __file__, "--peer", str(mesh), str(increments)]
            runs = [
                subprocess.run(command, capture_output=True, text=True, check=False, env=one_thread())
                for _ in range(ROUNDS)
            ]
            if all(run.returncode == 0 for run in runs):
                break
            print(f"felupe, {increments} increments a depth: {runs[0].stderr.strip().splitlines()[-1]}")
        else:
            raise SystemExit("felupe found no solution")
        found = [json.loads(run.stdout.splitlines()[-1]) for run in runs]
        there, slow = found[0], statistics.median(f["cpu_s"] for f in found)
        apart = max(abs(a / b - 1.0) for a, b in zip(there["Fz"], force, strict=True))
        print(
            f"felupe {slow:6.2f} s  {there['dofs']:5d} unknowns  {there['iterations']:4d} iterations"
            f"  ({increments} increments a depth)"
        )
        print(f"forces within {100 * apart:.1f} % of each other; ratio of times {slow / seconds:.1f}  (goal 10)")


if __name__ == "__main__":
    main()
