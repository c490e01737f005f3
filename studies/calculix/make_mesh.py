"""The mesh of the study: ``python3 make_mesh.py`` writes mesh.inp, which hemisphere.inp includes (see README.md).

A hemisphere and a rigid ball above it, axisymmetric, in the (x, y) plane with y the axis.  Lengths in mm.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

RADIUS, BALL = 35.0, 3.0
FINEST, GROWTH = 0.3, 1.25  # elements at the contact, and how much larger each next one is


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


def included(radius: float, ball: float, h: float, growth: float) -> str:
    """Nodes, elements, sets and surfaces of both bodies."""
    along = [x / radius for x in halved(graded(radius * math.pi / 2, h, growth))]  # angle from the pole
    # Depth below the surface, from the inside to it, so that the corners of an element run anticlockwise in (r, z); the
    # small rest within is held.
    depth = halved(graded(0.9 * radius, h, growth))[::-1]
    rows = [[((radius - t) * math.sin(q), (radius - t) * math.cos(q)) for t in depth] for q in along]
    ids, nodes, elements = mesh(rows, 1, 1)
    n, m = len(rows) - 1, len(depth) - 1
    surface = [e for k, e in enumerate(sorted(elements)) if (k + 1) % (m // 2) == 0]
    held = sorted({i for (p, q), i in ids.items() if p == n or q == 0})
    axis = sorted(i for (p, q), i in ids.items() if p == 0 and i not in held)
    angle = [math.radians(80) * k / 40 for k in range(41)]
    radii = (ball, 0.95 * ball, 0.9 * ball)
    shell = [[(r * math.sin(q), radius + ball - r * math.cos(q)) for r in radii] for q in angle]
    _, b_nodes, b_elements = mesh(shell, 1 + len(nodes), 1 + len(elements))
    lines = ["*NODE"]
    lines += [f"{i}, {r:.9g}, {z:.9g}, 0" for i, (r, z) in {**nodes, **b_nodes}.items()]
    for name, some in (("BODY", elements), ("BALL", b_elements)):
        lines += [f"*ELEMENT, TYPE=CAX8R, ELSET={name}"] + [", ".join(map(str, (e, *v))) for e, v in some.items()]
    for name, some in (("HELD", held), ("AXIS", axis), ("BALLNODES", sorted(b_nodes))):
        lines += [f"*NSET, NSET={name}"] + [f"{i}," for i in some]
    lines += ["*SURFACE, NAME=SKIN"] + [f"{e}, S3" for e in surface]
    lines += ["*SURFACE, NAME=TOOL"] + [f"{e}, S1" for e in b_elements]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("mesh.inp").write_text(included(RADIUS, BALL, FINEST, GROWTH))
