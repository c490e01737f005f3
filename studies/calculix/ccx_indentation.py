"""CalculiX as a backend of rso: ``ccx_indentation.py request.json response.json`` (see README.md).

A rigid sphere pressed into the top of a neo-Hookean hemisphere whose plane is held, axisymmetric.  Units N, mm, MPa.
Energy: W = mu/2 (I1bar − 3) + (J − 1)²/D1, which is what ``*HYPERELASTIC, NEO HOOKE`` means with C10 = mu/2.
"""

from __future__ import annotations

import itertools
import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

TIME_S = 8.0  # of one loading; nothing is rate-dependent
SCHEMA = {
    "name": "calculix hemisphere",
    "numerics": 1,
    "parameters": [
        {"name": "mu", "description": "shear modulus", "unit": "MPa", "low": 1e-4, "high": 10.0},
        {"name": "D1", "description": "compressibility, D1 = 2/K", "unit": "1/MPa", "low": 1e-2, "high": 1e4},
    ],
    "channels": {"time": "s", "travel": "mm", "Fz": "N"},
}
SETTINGS = {"radius": 35.0, "ball": 3.0, "h": 0.15, "growth": 1.12}  # mm; h: elements at the contact
WHOLE = 180.0  # ccx computes a wedge of 2 degrees
PENALTY = 1000.0  # contact stiffness over mu, 1/mm: 0.1 % of the force at these depths; similarity stays exact


def graded(length: float, h: float, growth: float) -> list[float]:
    """Positions from 0 to `length` (mm) whose spacing starts at about h and grows."""
    n = max(2, math.ceil(math.log(1.0 + length / h * (growth - 1.0)) / math.log(growth)))
    raw = [(growth**k - 1.0) / (growth - 1.0) for k in range(n + 1)]
    return [length * x / raw[-1] for x in raw]


def mesh(rows: list[list[tuple[float, float]]], first_node: int, first_element: int):
    """8-node quadrilaterals on a grid of (2n + 1) × (2m + 1) points: nodes {id: (r, z)} and elements {id: nodes}."""
    ids: dict[tuple[int, int], int] = {}
    nodes: dict[int, tuple[float, float]] = {}
    for i, row in enumerate(rows):
        for j, point in enumerate(row):
            if not (i % 2 and j % 2):
                ids[i, j] = first_node + len(ids)
                nodes[ids[i, j]] = point
    elements = {}
    for i in range(0, len(rows) - 2, 2):
        for j in range(0, len(rows[0]) - 2, 2):
            around = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
            elements[first_element + len(elements)] = [ids[i + a, j + b] for a, b in around]
    return ids, nodes, elements


def halved(x: list[float]) -> list[float]:
    """The same positions with their midpoints between them."""
    return [v for a, b in itertools.pairwise(x) for v in (a, 0.5 * (a + b))] + [x[-1]]


def deck(mu: float, D1: float, travels: list[float], s: dict[str, float]) -> str:
    """The input file of ccx."""
    R, a = s["radius"], s["ball"]
    along = [x / R for x in halved(graded(R * math.pi / 2, s["h"], s["growth"]))]  # angle from the pole
    inwards = halved(graded(0.9 * R, s["h"], s["growth"]))  # depth below the surface; the small rest is held
    # From the inside to the surface, so that the corners of an element run anticlockwise in (r, z).
    depth = inwards[::-1]
    rows = [[((R - t) * math.sin(q), (R - t) * math.cos(q)) for t in depth] for q in along]
    ids, nodes, elements = mesh(rows, 1, 1)
    n, m = len(rows) - 1, len(depth) - 1
    surface = [e for k, e in enumerate(sorted(elements)) if (k + 1) % (m // 2) == 0]
    held = sorted({i for (p, q), i in ids.items() if p == n or q == 0})
    axis = sorted(i for (p, q), i in ids.items() if p == 0 and i not in held)
    angle = [math.radians(80) * k / 40 for k in range(41)]
    ball = [[(r * math.sin(q), R + a - r * math.cos(q)) for r in (a, 0.95 * a, 0.9 * a)] for q in angle]
    _, b_nodes, b_elements = mesh(ball, 1 + len(nodes), 1 + len(elements))
    lines = ["*NODE"]
    lines += [f"{i}, {r:.9g}, {z:.9g}, 0" for i, (r, z) in {**nodes, **b_nodes}.items()]
    for name, some in (("BODY", elements), ("BALL", b_elements)):
        lines += [f"*ELEMENT, TYPE=CAX8R, ELSET={name}"] + [", ".join(map(str, (e, *v))) for e, v in some.items()]
    for name, some in (("HELD", held), ("AXIS", axis), ("BALLNODES", sorted(b_nodes))):
        lines += [f"*NSET, NSET={name}"] + [f"{i}," for i in some]
    lines += ["*SURFACE, NAME=SKIN"] + [f"{e}, S3" for e in surface]
    lines += ["*SURFACE, NAME=TOOL"] + [f"{e}, S1" for e in b_elements]
    lines += [
        "*MATERIAL, NAME=GEL",
        "*HYPERELASTIC, NEO HOOKE",
        f"{mu / 2:.12g}, {D1:.12g}",
        "*MATERIAL, NAME=STEEL",
        "*ELASTIC",
        f"{1000 * mu:.12g}, 0.3",
        "*SOLID SECTION, ELSET=BODY, MATERIAL=GEL",
        "*SOLID SECTION, ELSET=BALL, MATERIAL=STEEL",
        "*SURFACE INTERACTION, NAME=SMOOTH",
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
        f"{PENALTY * mu:.12g}",
        "*CONTACT PAIR, INTERACTION=SMOOTH, TYPE=SURFACE TO SURFACE",
        "SKIN, TOOL",
        "*BOUNDARY",
        "HELD, 1, 2",
        "AXIS, 1, 1",
        "BALLNODES, 1, 1",
    ]
    for u in travels:
        lines += ["*STEP, NLGEOM, INC=200", "*STATIC", "0.25, 1.0, 1e-4, 0.5"]
        lines += ["*BOUNDARY", f"BALLNODES, 2, 2, {-u:.12g}"]
        lines += ["*NODE PRINT, NSET=BALLNODES, TOTALS=ONLY", "RF", "*END STEP"]
    return "\n".join(lines) + "\n"


def forces(text: str) -> list[tuple[float, float]]:
    """(time, total vertical force on the ball's nodes) of every printed increment of a .dat file."""
    found, time = [], 0.0
    for line in text.splitlines():
        words = line.split()
        if line.strip().startswith("total force"):
            time = float(words[-1])
        elif len(words) == 3:
            found.append((time, float(words[1])))
    return found


def solve(values: dict[str, float], case: dict) -> dict:
    """Run ccx in the working directory, which rso makes for this run alone, and read its answer."""
    unknown = sorted(set(case["settings"]) - set(SETTINGS))
    if unknown:
        raise SystemExit(f"unknown settings {unknown}; there are {', '.join(SETTINGS)}")
    if (ccx := shutil.which("ccx")) is None:
        raise SystemExit("the program ccx is not on the PATH (Debian: apt-get install calculix-ccx)")
    travels = [float(u) for u in case["programme"]["asked_mm"]]
    Path("job.inp").write_text(deck(values["mu"], values["D1"], travels, {**SETTINGS, **case["settings"]}))
    with open("ccx.log", "w") as log:
        code = subprocess.call([ccx, "-i", "job"], stdout=log, stderr=subprocess.STDOUT)
    data = Path("job.dat")
    every = forces(data.read_text()) if data.exists() else []
    F = [max((f for t, f in every if abs(t - k - 1) < 1e-9), key=abs, default=math.nan) for k in range(len(travels))]
    if code != 0 or any(map(math.isnan, F)):
        end = Path("ccx.log").read_text(errors="replace").strip().splitlines()[-3:]
        return {"status": "failed", "cause": "step_limit", "reason": f"ccx stopped (code {code}): {' '.join(end)}"}
    time = [TIME_S * u / travels[-1] for u in travels]
    return {
        "status": "done",
        "channels": {"time": time, "travel": travels, "Fz": [-f * WHOLE for f in F]},
        "units": SCHEMA["channels"],
        "info": {"solver": "CalculiX"},
    }


if __name__ == "__main__":
    if sys.argv[1:] == ["--schema"]:
        print(json.dumps(SCHEMA))
    else:
        request = json.loads(Path(sys.argv[1]).read_text())
        Path(sys.argv[2]).write_text(json.dumps(solve(request["values"], request["case"])))
