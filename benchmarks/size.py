"""Size of the product: lines and files by room, and what an analysis imports, with all that these import in turn.

    python benchmarks/size.py [FOLDER]

FOLDER is a checkout of the repository, by default this one.  Imports within functions count too.
"""

import ast
import sys
from pathlib import Path

PACKAGES = ("rso", "fem_backend")
ENTRIES = {
    "rso run": "rso.calibration.pipeline",
    "rso ladder": "rso.model_selection.ladder_results",
    "rso next": "rso.next_experiment.design_results",
    "rso diagnose": "rso.discrepancy.study_diagnosis",
}
MOVED = {"rso.next_experiment.design_results": "rso.optimal_design.design_results"}  # as it was before


def modules(root: Path) -> dict[str, Path]:
    """Name of every module of the product → its file."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(path: Path, known: dict[str, Path]) -> set[str]:
    """Modules of the product that one imports, each with the packages around it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
        elif isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
    return {".".join(n.split(".")[:k]) for n in names for k in range(1, n.count(".") + 2)} & set(known)


def closure(entry: str, known: dict[str, Path]) -> set[str]:
    """The modules that one needs, itself included."""
    found, waiting = set[str](), [entry]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += imported(known[name], known)
    return found


def lines(path: Path) -> int:
    """Lines of a file."""
    return len(path.read_text(encoding="utf-8").splitlines())


def rows(root: Path) -> list[str]:
    """The table in Markdown."""
    known = modules(root)
    table = ["| | modules | lines | longest file |", "|---|---|---|---|"]
    rooms = {".".join(n.split(".")[:2]) for n in known}
    groups = {"product": set(known), **{p: {n for n in known if n.split(".")[0] == p} for p in PACKAGES}}
    groups |= {r: {n for n in known if n == r or n.startswith(f"{r}.")} for r in sorted(rooms) if r.count(".")}
    for name, group in groups.items():
        longest = max(group, key=lambda n: lines(known[n]))
        size = sum(lines(known[n]) for n in group)
        table.append(f"| {name} | {len(group)} | {size} | {longest} ({lines(known[longest])}) |")
    for command, entry in ENTRIES.items():
        start = entry if entry in known else MOVED.get(entry, "")
        if start in known:
            group = closure(start, known) - {"rso"}
            table.append(f"| closure of `{command}` | {len(group)} | {sum(lines(known[n]) for n in group)} | |")
    return table


if __name__ == "__main__":
    print("\n".join(rows(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1])))
