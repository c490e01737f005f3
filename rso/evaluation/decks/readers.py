"""Readers of result files: columns of tables, regular expressions, CalculiX, FEBio, or a Python function.

Each gives numbers in the order of the file and, where the file says them, the times or travels that they belong to;
:func:`at_passages` finds from these the values at the travels that were asked for.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rso.contract import FreeCurve, NotFinite, Programme
from rso.core import disk

SAME_ABSCISSA_TOLERANCE = 1e-6  # of a whole: times and travels this near are one
MAX_LISTED_NAMES = 8  # names of what a file holds that a message lists
_RESULT_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")


@dataclass(frozen=True)
class DeckOutput:
    """Where a channel of a response is read: the file, its reader, what is taken of it, and what it belongs to.

    A value in the file times `factor` is one in the unit of the channel.  `at` says whether values come one for each
    asked travel (order), at the ends of steps (step: time k is the k-th asked travel), or with their times (s) or
    travels (mm), which a column `at_column` holds or the reader knows, times `at_factor`.  With `over` it is a curve
    over an abscissa of that name, in `over_unit`, which these say.
    """

    channel: str
    unit: str
    file: str
    reader: str
    factor: float = 1.0
    column: str | int | None = None
    pattern: str = ""
    set: str = ""
    item: int | None = None
    at: str = "order"
    at_column: str | int | None = None
    at_factor: float = 1.0
    over: str = ""
    over_unit: str = "1"


class NotFound(ValueError):
    """A result file does not hold what is to be read: names the file, what was looked for and what there is."""


Found = tuple[np.ndarray | None, np.ndarray]  # times, travels or numbers of steps (n,), where known, and values (n,)


def read_output(output: DeckOutput, folder: Path, base: Path) -> Found:
    """Values (n,) of a channel in its unit, and what they belong to; NotFound where the file does not hold them.

    `folder` is that of the run, `base` that of the study, where a function's module may lie.
    """
    path = folder / output.file
    if ":" in output.reader:
        at, values = _by_function(output, path, base)
    else:
        try:
            text = disk.read_bytes(path).decode("utf-8", "replace")
        except FileNotFoundError:
            there = _listed(sorted(p.name for p in folder.iterdir() if p.is_file()))
            raise NotFound(f"{output.file}: there is no such file after the run; there are {there}") from None
        except OSError as error:
            raise NotFound(f"{output.file}: {error.strerror}") from error
        at, values = READERS[output.reader](text, output)
    return (None if at is None else output.at_factor * at), output.factor * values


def at_passages(output: DeckOutput, found: Found, programme: Programme) -> tuple[np.ndarray, np.ndarray]:
    """Values at the asked passages (n,) and how far two interpolations differ there (n,).

    Fewer where the file ends before the last of them.  Between two rows the values are those of a monotone cubic
    (Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238), and the difference from a straight line is stated as
    their error.  Raises NotFound where rows do not belong to travels as `at` says.
    """
    at, values = found
    time, travel = programme.passages()
    if output.at in ("order", "step"):
        return _in_order(output, at, values, len(time)), np.zeros(min(len(time), len(values)))
    if at is None:
        raise NotFound(f'{output.file}: at = "{output.at}" needs at_column: what says the {output.at} of each value')
    if output.at == "travel" and np.any(np.diff(programme.travel_mm) < 0):
        raise NotFound(f'{output.file}: at = "travel" is for loading alone; of what returns or rests take at = "time"')
    if output.at == "travel":
        top = int(np.argmax(at))
        at, values = at[: top + 1], values[: top + 1]
    return _interpolated(output, at, values, time if output.at == "time" else travel)


def free_curve(output: DeckOutput, found: Found) -> FreeCurve:
    """A curve over its own abscissa, of rows in any order; NotFound where the file does not say the abscissa."""
    at, values = found
    if at is None:
        raise NotFound(f"{output.file}: {output.channel} over {output.over!r} needs at_column: what says the abscissa")
    order = np.argsort(at, kind="stable")
    try:
        return FreeCurve(at[order], values[order], output.unit, output.over, output.over_unit)
    except ValueError as error:
        if isinstance(error, NotFinite):
            raise
        raise NotFound(f"{output.file}: {output.channel}: {error}") from error


def _in_order(output: DeckOutput, at: np.ndarray | None, values: np.ndarray, n: int) -> np.ndarray:
    """Values by their place in the file, or by the number of the step that ends there."""
    if output.at == "order":
        if len(values) > n:
            words = f"{len(values)} values of {output.channel} for {n} asked travels; say what they belong to by `at`"
            raise NotFound(f"{output.file}: {words}")
        return values
    if at is None:
        raise NotFound(f'{output.file}: at = "step" needs at_column: what says the number of the step')
    steps = []
    for k in range(1, n + 1):
        ended = np.flatnonzero(np.abs(at - k) < SAME_ABSCISSA_TOLERANCE * k)
        if not len(ended):
            break
        steps.append(values[ended[-1]])
    return np.array(steps)


def _interpolated(
    output: DeckOutput, at: np.ndarray, values: np.ndarray, wanted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Values at increasing `wanted` (n,), and the difference of two interpolations between rows."""
    new = (
        np.concatenate(([True], np.diff(at) > SAME_ABSCISSA_TOLERANCE * max(np.ptp(at), 1e-300)))
        if len(at)
        else np.zeros(0, bool)
    )
    if len(at) and np.any(np.diff(at) < -SAME_ABSCISSA_TOLERANCE * np.ptp(at)):
        raise NotFound(f"{output.file}: the {output.at} of {output.channel} does not increase from row to row")
    x, y = at[new], values[np.append(np.flatnonzero(new)[1:] - 1, len(at) - 1)] if len(at) else values
    if not len(x):
        return np.zeros(0), np.zeros(0)
    near = SAME_ABSCISSA_TOLERANCE * max(abs(x[-1]), abs(wanted[-1]))
    if x[0] > wanted[0] + near:
        words = (
            f"begins at {output.at} {x[0]:.6g}, but {wanted[0]:.6g} is asked for: let the program write earlier rows"
        )
        raise NotFound(f"{output.file}: {output.channel} {words}")
    inside = wanted[wanted <= x[-1] + near]
    clipped = np.clip(inside, x[0], x[-1])
    line = np.interp(clipped, x, y)
    if len(x) < 3:
        return line, np.zeros(len(line)) if len(x) < 2 else np.abs(line - _nearest(x, y, clipped))
    from scipy.interpolate import PchipInterpolator  # 0.3 s of start-up that only a deck needs

    smooth = PchipInterpolator(x, y)(clipped)
    return smooth, np.abs(smooth - line)


def _nearest(x: np.ndarray, y: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The value of the nearest row: two rows show nothing of what is between them."""
    return y[np.argmin(np.abs(wanted[:, None] - x), axis=1)]


# --- files ----------------------------------------------------------------------------------------------------------


def _table(text: str, output: DeckOutput) -> Found:
    """Columns of a table separated by commas, semicolons, tabs or blanks, by name or number (from 1).

    The rows are the longest run of lines with equally many numbers; names are the last line of words above them with
    as many parts.
    """
    lines = [line.strip().lstrip("#").strip() for line in text.splitlines()]
    rows = [_split(line) for line in lines]
    numbers = [
        r if r and all(_RESULT_NUMBER.fullmatch(c) or c.lower() in ("nan", "inf", "-inf") for c in r) else []
        for r in rows
    ]
    first, last = _longest([len(r) for r in numbers])
    if first == last:
        raise NotFound(f"{output.file}: no row of numbers; it begins with {_listed(lines)}")
    data = np.array([[float(c.replace("D", "E").replace("d", "e")) for c in r] for r in numbers[first:last]])
    names = next((r for r in rows[:first][::-1] if len(r) == data.shape[1]), [])
    column = data[:, _column(output, output.column, names, data.shape[1])]
    if output.at_column is None:
        return None, column
    return data[:, _column(output, output.at_column, names, data.shape[1])], column


def _split(line: str) -> list[str]:
    for separator in (";", "\t", ","):
        if separator in line:
            return [cell.strip().strip("\"'").strip() for cell in line.rstrip(separator).split(separator)]
    return line.split()


def _longest(counts: list[int]) -> tuple[int, int]:
    """First line and the one behind the last of the longest run of lines with one positive count."""
    best, start = (0, 0), 0
    for k, count in enumerate([*counts, -1]):
        if count != (counts[start] if start < len(counts) else -2):
            if counts[start] > 0 and k - start > best[1] - best[0]:
                best = (start, k)
            start = k
    return best


def _column(output: DeckOutput, wanted: str | int | None, names: list[str], n: int) -> int:
    """Index of a column by name or number; NotFound with the names that there are."""
    if isinstance(wanted, int) and 1 <= wanted <= n:
        return wanted - 1
    if wanted is None and n == 1:
        return 0
    same = [k for k, name in enumerate(names) if name == wanted] or [
        k for k, name in enumerate(names) if name.lower() == str(wanted).lower()
    ]
    if len(same) == 1:
        return same[0]
    there = _listed(names) if names else f"{n} columns without names: give a number from 1 to {n}"
    what = "columns of that name are" if len(same) > 1 else "is no column"
    raise NotFound(f"{output.file}: {len(same) or ''} {what}: {wanted!r}; it holds {there}".replace(":  ", ": "))


def _regex(text: str, output: DeckOutput) -> Found:
    """Every match: the group `value` (or the first) and, where there is one, the group `at`."""
    found = list(re.finditer(output.pattern, text, re.MULTILINE))
    if not found:
        ends = _listed([line.strip() for line in text.splitlines() if line.strip()][-3:])
        raise NotFound(f"{output.file}: nothing matches {output.pattern!r}; its last lines are {ends}")
    groups = found[0].re.groupindex
    values = [_number(output, m["value"] if "value" in groups else m[1]) for m in found]
    at = np.array([_number(output, m["at"]) for m in found]) if "at" in groups else None
    return at, np.array(values)


def _number(output: DeckOutput, text: str | None) -> float:
    if text is None or not _RESULT_NUMBER.fullmatch(text.strip()):
        raise NotFound(f"{output.file}: {output.pattern!r} finds {text!r}, which is no number")
    return float(re.sub("[dD]", "e", text.strip()))


_CALCULIX_BLOCK = re.compile(
    r"^\s*(?P<what>\S.*?)\s*\((?P<names>[^)]*)\) for set (?P<set>\S+) and time\s+(?P<time>\S+)\s*$"
)


def _calculix(text: str, output: DeckOutput) -> Found:
    """Blocks "… (fx,fy,fz) for set NAME and time T" of a .dat file of CalculiX, one column (fx) of one set.

    A total stands in a row of its own; where there are rows of nodes only, forces are summed over the set, and of
    displacements there may be one row.  Times begin with the job: that of step k ends at k where each lasts 1.
    """
    totals: list[tuple[float, float]] = []
    sums: list[tuple[float, float]] = []
    there: dict[str, None] = {}
    lines = text.splitlines()
    heads = [(k, m) for k, line in enumerate(lines) if (m := _CALCULIX_BLOCK.match(line))]
    ends = [k for k, _ in heads[1:]] + [len(lines)]
    for (k, head), end in zip(heads, ends, strict=True):
        names = head["names"].replace(" ", "").split(",")
        there[f"{head['what']} ({head['names']}) for set {head['set']}"] = None
        if head["set"].upper() != output.set.upper() or output.column not in names:
            continue
        index = names.index(str(output.column))
        rows = [words for line in lines[k + 1 : end] if (words := line.split()) and _RESULT_NUMBER.fullmatch(words[0])]
        own = [float(w[-len(names) + index]) for w in rows if len(w) in (len(names), len(names) + 1)]
        if head["what"].startswith("total"):
            totals.append((float(head["time"]), own[0]))
        elif own and (len(own) == 1 or "force" in head["what"]):
            sums.append((float(head["time"]), sum(own)))
        elif own:
            raise NotFound(
                f"{output.file}: {head['what']} of set {output.set} has {len(own)} rows: take a set of one node"
            )
    found = totals or sums
    if not found:
        what = f"{output.column!r} for set {output.set!r}"
        raise NotFound(f"{output.file}: there is no {what}; it holds {_listed(list(there)) or 'no block of a set'}")
    return np.array([t for t, _ in found]), np.array([v for _, v in found])


def _febio(text: str, output: DeckOutput) -> Found:
    """Records "*Step = … *Time = … *Data = Rx;Ry;Rz" of a log file of FEBio, one column of its items (rows).

    The rows of a record are summed, as the reactions of a set of nodes are, but where `item` takes one by its number.
    """
    times: list[float] = []
    values: list[float] = []
    names: list[str] = []
    rows: list[list[str]] = []

    def end() -> None:
        if len(times) > len(values) and rows:
            k = _column(output, output.column, names, len(rows[0]) - 1)
            own = [r for r in rows if output.item is None or int(float(r[0])) == output.item]
            if not own:
                items = _listed([r[0] for r in rows])
                raise NotFound(f"{output.file}: there is no item {output.item}; it holds items {items}")
            values.append(sum(float(r[1 + k]) for r in own))
        rows.clear()

    for line in text.splitlines():
        head = re.match(r"\*(\w+)\s*=\s*(.*)", line.strip())
        if head and head[1] == "Step":
            end()
        elif head and head[1] == "Time":
            times.append(float(head[2]))
        elif head and head[1] == "Data":
            names = [n.strip() for n in head[2].split(";")]
        elif (cells := re.split(r"[,;\s]+", line.strip().rstrip(",;"))) and _RESULT_NUMBER.fullmatch(cells[0]):
            rows.append(cells)
    end()
    n = min(len(times), len(values))
    if not n:
        raise NotFound(f"{output.file}: no record of *Time and rows; it begins with {_listed(text.splitlines()[:3])}")
    return np.array(times[:n]), np.array(values[:n])


def _by_function(output: DeckOutput, path: Path, base: Path) -> Found:
    """What a function of the file gives: values, or what they belong to and values."""
    name, _, attribute = output.reader.partition(":")
    if importlib.util.find_spec(name.partition(".")[0]) is None and str(base) not in sys.path:
        sys.path.append(str(base))
    found = getattr(importlib.import_module(name), attribute)(path)
    at, values = found if isinstance(found, tuple) else (None, found)
    given = np.atleast_1d(np.asarray(values, float))
    belongs = None if at is None else np.atleast_1d(np.asarray(at, float))
    if given.ndim != 1 or (belongs is not None and belongs.shape != given.shape):
        raise NotFound(f"{output.file}: {output.reader} gives arrays of another shape than (n,)")
    return belongs, given


def _listed(names: list[str]) -> str:
    """What there is, cut after some."""
    shown = ", ".join(name[:60] for name in names[:MAX_LISTED_NAMES])
    return f"{shown} and {len(names) - MAX_LISTED_NAMES} more" if len(names) > MAX_LISTED_NAMES else shown


READERS: dict[str, Callable[[str, DeckOutput], Found]] = {
    "table": _table,
    "regex": _regex,
    "calculix": _calculix,
    "febio": _febio,
}
