"""Draws docs/figures/architecture.svg from the imports of both packages: `python docs/figures/architecture.py`.

A room stands above all that it imports; what it says of itself is the first sentence of its docstring.
"""

from __future__ import annotations

import ast
import html
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILE = Path(__file__).with_suffix(".svg")
PACKAGES = ("fem_backend", "rso")
WIDTH, LINE, PAD, GAP, TITLE = 1000, 15, 9, 10, 17
STYLE = "text{font:12px sans-serif;fill:#222}.t{font-weight:bold;font-size:13px}.h{font-weight:bold;font-size:16px}"


def rooms(package: str) -> dict[str, tuple[str, set[str], int]]:
    """Room of a package → its sentence, the rooms that it imports, and how many modules it has."""
    found: dict[str, tuple[str, set[str], int]] = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        room = path.relative_to(ROOT / package).parts[0].removesuffix(".py")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        sentence, below, number = found.get(room, ("", set(), 0))
        if path.parent == ROOT / package or (path.name == "__init__.py" and path.parent.parent == ROOT / package):
            sentence = (ast.get_docstring(tree) or "").split("\n")[0]
        found[room] = (sentence, below | _imported(tree, package), number + (path.name != "__init__.py"))
    found = {k: v for k, v in found.items() if k not in ("__init__", "__main__")}
    return {k: (s, {b for b in below if b in found and b != k}, n) for k, (s, below, n) in found.items()}


def _imported(tree: ast.Module, package: str) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names |= {f"{node.module}.{a.name}" for a in node.names}
        elif isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
    return {n.split(".")[1] for n in names if n.split(".")[0] == package and "." in n}


def floors(package: str) -> list[list[str]]:
    """Rooms from the lowest floor up: each as low as what it imports allows."""
    return _stacked(package, rooms(package))


def _stacked(package: str, left: dict[str, tuple[str, set[str], int]]) -> list[list[str]]:
    below: set[str] = set()
    found = []
    while left:
        floor = sorted(k for k, (_, needs, _) in left.items() if needs <= below)
        if not floor:
            raise ValueError(f"{package}: these rooms import one another: {', '.join(sorted(left))}")
        found.append(floor)
        below |= set(floor)
        left = {k: v for k, v in left.items() if k not in below}
    return found


def _room(name: str, sentence: str, number: int, x: float, y: float, width: float, height: float) -> list[str]:
    many = f" · {number} modules" if number > 1 else ""
    lines = textwrap.wrap(sentence.replace("`", ""), int((width - 2 * PAD) / 6.3))
    place = f'x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{height:.0f}"'
    out = [f'<rect {place} rx="4" fill="#f4f1ea" stroke="#b8b0a0"/>']
    out.append(f'<text class="t" x="{x + PAD:.0f}" y="{y + PAD + 10:.0f}">{name}{many}</text>')
    for k, line in enumerate(lines):
        out.append(f'<text x="{x + PAD:.0f}" y="{y + PAD + 10 + TITLE + k * LINE:.0f}">{html.escape(line)}</text>')
    return out


def picture() -> str:
    """The whole house as SVG: both packages, top floor first, `rso` above `fem_backend`, which it never imports."""
    body: list[str] = []
    y = 0.0
    for package in reversed(PACKAGES):
        known = rooms(package)
        y += 26
        body.append(f'<text class="h" x="0" y="{y - 8:.0f}">{package}</text>')
        for floor in reversed(_stacked(package, known)):
            width = (WIDTH - GAP * (len(floor) - 1)) / len(floor)
            most = max(len(textwrap.wrap(known[r][0].replace("`", ""), int((width - 2 * PAD) / 6.3))) for r in floor)
            height = 2 * PAD + TITLE + most * LINE
            for k, room in enumerate(floor):
                sentence, _, number = known[room]
                body += _room(room, sentence, number, k * (width + GAP), y, width, height)
            y += height + GAP
        y += GAP
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-10 0 {WIDTH + 20} {y:.0f}" width="{WIDTH + 20}">'
    return "\n".join(
        [
            head,
            f"<style>{STYLE}</style>",
            '<rect x="-10" width="100%" height="100%" fill="white"/>',
            *body,
            "</svg>",
            "",
        ]
    )


if __name__ == "__main__":
    FILE.write_text(picture(), encoding="utf-8")
