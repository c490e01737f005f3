"""The last section of a diagnosis: data, noise, runs, notes, times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rso.core.digits import DASH, known
from rso.report.discrepancy.reading import Found, place_text
from rso.report.layout.digits import clean, duration, percent, quantity, shortest, symbol
from rso.report.layout.document import Block, Cell, Section, Table, Text, column, table, words
from rso.report.reading import listed, number, pair

_MAX_OPEN_LIST_ROWS = 6  # a longer list starts closed


def background(found: Found) -> Section:
    """Section 9: what was used, and what went wrong."""
    blocks: list[Block] = [t for t in (_model(found), _data(found), _noise(found)) if t is not None]
    blocks.append(Text(_rerun(found.get("rerun") or [])))
    blocks += [Text(clean(n), "note") for n in listed(found, "notes")]
    failed = [clean(f) for f in listed(found, "failed_runs")]
    if failed:
        columns = [column("Run", words(failed, "code"), number=False)]
        note = "Their place is taken by the nearest run that has an answer."
        blocks.append(table(f"Failed runs ({len(failed)})", columns, note, folded=len(failed) > _MAX_OPEN_LIST_ROWS))
    else:
        blocks.append(Text("No run failed."))
    if t := _times(found):
        blocks.append(t)
    return Section("background", "Background", tuple(blocks))


def _model(found: Found) -> Table | None:
    """What the base model is: what all experiments share of the settings, and what is open or fixed."""
    settings = (found.get("settings") or {}).items()
    rows = [(Cell(clean(k), mark="code"), Cell(_setting(v), mark="code")) for k, v in settings]
    units, m = found.get("units") or {}, found.get("modulus") or {}
    if m.get("name"):
        unit = str(units.get(m["name"]) or "")
        ends = [quantity(number(m.get(k)), unit) for k in ("low", "high")]
        rows.append((Cell(symbol(str(m["name"]))), Cell(f"open, {' to '.join(ends)}")))
    for k, low_high in (found.get("ranges") or {}).items():
        ends = [quantity(number(v), str(units.get(k) or "")) for v in low_high]
        rows.append((Cell(symbol(k)), Cell(f"open, {' to '.join(ends)}")))
    if not rows:
        return None
    names, values = (tuple(row[k] for row in rows) for k in (0, 1))
    return table("Base model", [column("", names, number=False), column("", values, number=False)])


def _setting(value: object) -> str:
    """A setting in words: its own names, numbers one behind the other."""
    if isinstance(value, Mapping):
        return ", ".join(f"{clean(k).replace('_', ' ')} {_setting(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        return " × ".join(map(_setting, value))
    return shortest(value) if known(value) else clean(value)


def _data(found: Found) -> Table | None:
    rows = listed(found, "experiments")
    if not rows:
        return None
    speed = [number(e.get("speed")) for e in rows]
    columns = [
        column("Experiment", words([clean(e.get("name")) for e in rows]), number=False),
        column("role", words([clean(e.get("role")) for e in rows]), number=False),
        column("point", words([place_text(e["point"]) if pair(e.get("point")) else DASH for e in rows]), number=False),
        column("speed", words([DASH if v is None else shortest(float(f"{60 * v:.3g}")) for v in speed]), "mm/min"),
        column("channels", words([", ".join(map(clean, e.get("channels") or ())) for e in rows]), number=False),
        column("repeats", words([shortest(e.get("repeats")) for e in rows])),
        column("mounting", words([clean(e.get("mounting")) or DASH for e in rows]), number=False),
    ]
    return table("Experiments", columns, "Validate curves take part in nothing but the gap on held-out curves.")


def _noise(found: Found) -> Table | None:
    rows = [(clean(k), v) for k, v in (found.get("noise") or {}).items() if isinstance(v, Mapping)]
    if not rows:
        return None

    def sizes(key: str, unit: str | None = None) -> tuple[Cell, ...]:
        own = [unit or ("N" if c.startswith("F") else "mm") for c, _ in rows]
        values = [number(v.get(key)) for _, v in rows]
        return words([quantity(x, u, 2) if x else DASH for x, u in zip(values, own, strict=True)])

    columns = [
        column("Channel", words([c for c, _ in rows]), number=False),
        column("white", sizes("white")),
        column("correlated", sizes("correlated")),
        column("over", sizes("length_mm", "mm")),
        column("gain", words([percent(g) if (g := number(v.get("gain"))) else DASH for _, v in rows])),
        column("contact", sizes("contact_mm", "mm")),
        column("depth", sizes("depth_mm", "mm")),
        column("from", words([clean(v.get("source")) for _, v in rows]), number=False),
    ]
    note = (
        "Standard deviations. Gain and contact point belong to a whole curve; white and correlated noise to a reading."
    )
    return table("Noise used", columns, note)


def _rerun(rounds: Sequence[Mapping[str, Any]]) -> str:
    if not any(r.get("runs") for r in rounds):
        return "No effect was simulated again at its estimated size."
    said = []
    for n, r in enumerate(rounds):
        head = "Simulated again at the estimated size: " if n == 0 else "Again, at the size found then: "
        runs = f"{r['runs']} run{'s' * (r['runs'] != 1)}"
        text = f"{head}{', '.join(r['effects'])} ({runs}, {r.get('failed') or 0} failed)."
        if known(r.get("rms")):
            text += f" What the library interpolated was off by {percent(r['rms'])} of Fz (root mean square)"
            text += f", {percent(number(r.get('largest')))} at most over all force components."
        said.append(text)
    return " ".join([*said, "The verdict is that of the library as mended there."])


def _times(found: Found) -> Table | None:
    t = found.get("timings") or {}
    cpu, wall, judging = (duration(number(t.get(k))) for k in ("library_cpu", "library_wall", "judging_cpu"))
    rows = []
    if t:
        made = f"{shortest(t.get('library_runs'))} runs, {cpu} of CPU time when they were made"
        rows.append(("Library", f"{made}; {wall} of wall time now"))
        rows.append(("Judging", f"{judging} of CPU time"))
    cells = [Cell(text) for _, text in rows]
    names = [Cell(name) for name, _ in rows]
    if found.get("command"):
        names.append(Cell("Command"))
        cells.append(Cell(clean(found["command"]), mark="code"))
    if not names:
        return None
    return table("Times and command", [column("", tuple(names), number=False), column("", tuple(cells), number=False)])
