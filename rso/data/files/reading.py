"""Reading measured CSV files.  Whatever is wrong is a ValueError naming file, line, column, value and choices.

Header: names with units (:func:`rso.core.units.header`), or what a machine writes there (:class:`rso.data.Column`).
Separator: semicolon, tab or comma, whichever the header has first in this order, or blanks where none of them parts the
rows (:mod:`.whitespace_tables`); a decimal comma is understood, between commas in quotes.  Lines that start with
'#' and lines above the header are notes, but for rows that start with #DIV/0!, #### or another fault of a spreadsheet,
and a header in the last comment above bare numbers.  Tables beneath one another may be repeats
(:mod:`rso.data.files.tables`); of tables beside one another one is named (:mod:`rso.data.files.tables_beside`).
"""

from __future__ import annotations

import hashlib
import math
import os
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from rso.contract.responses import FORCE_CHANNELS
from rso.core.digits import quantity_text, two_digits
from rso.core.inline_toml import inline
from rso.core.units import conversion_factor, is_counted, is_of, kind_of
from rso.data import contact_point, curve_shape, drift, force_holds, plausibility, preload
from rso.data.branches import SEGMENTS, SKIP_SEGMENT, cycle_rows, segments
from rso.data.contact_point import Onset
from rso.data.drift import Baseline, DriftAlong
from rso.data.files import header_aliases, tables
from rso.data.files.cantilever import Unsaid, bending, is_corrected
from rso.data.files.cells import (
    cell_number,
    counters,
    no_summary,
    no_thousands,
    require_plausible,
    row_of,
    segment_words,
    segments_of,
)
from rso.data.files.columns import (
    SUBTRACTED_COLUMN,
    ZERO_AT_CONTACT,
    Column,
    Head,
    HeaderError,
    Row,
    cells_of,
    columns_of_file,
    decimal_number,
    fail,
    find_head,
    is_clock,
    is_head,
    with_less,
)
from rso.data.files.commented_header import head_of
from rso.data.files.header_words import SPREAD_WORDS
from rso.data.files.lines import file_text, numbered_lines
from rso.data.files.rows import rows_by_label
from rso.data.files.tables_beside import table_beside
from rso.data.files.whitespace_tables import parted, width_of
from rso.data.files.workbook import ZIP_START, block_of, sheet_of
from rso.data.force_holds import HeldForce

DISPLACEMENT_COLUMNS = ("ux", "uy", "uz")
BOTH_SIGNS_TURNED_DOUBT = "a pull looks the same where pressing counts as positive"
EARLIER_CYCLES_DOUBT = "the cycles before this one are not simulated: what they left in the body is in its readings"
CALENDAR_TIME_S = 1e8  # s: no test takes three years, so such a time counts from a date, mostly 1970
MIN_RIVAL_CORRELATION = 0.995  # of a column that is not read with one that is: both are of one motion
SAME_RANGE_TOLERANCE = 0.01  # of the range: two columns of one motion that say the same
MAX_LISTED_CODES = 8  # codes of segments that a message shows
MAX_CLOCK_RESTARTS_SHARE = 0.1  # of the steps of time that fall: where more do, rows stand in no order
SAME_DEPTH_SHARE = 0.05  # of the range of depth: two readings this near each other go on
BACKWARDS_ADVICE = "; all rows run backwards in time: sort them by it"
HALF_DAY_S = 43_200.0  # s: a time of day that falls by more has passed midnight
REPORTED_SUBTRACTION_SHARE = 0.5  # of the depth: where more was subtracted of it, that is said


@dataclass(frozen=True, eq=False)
class Repeat:
    """One test as recorded: arrays (n,) in N, mm, s.

    `channels` holds forces (kind force) or x, y and displacements (kind profile); `sigma` the stated standard
    uncertainty of each reading where the file has such a column; `segment` one of loading, hold, unloading.  `creep`
    are the readings of a hold at constant force, which end the others, or why they cannot be compared; "" without one.
    `tared` says that Fz counts from the contact that was found in the record.  `drift` holds by channel the line that
    was subtracted of a force, or the drift that its approach shows where nobody has stated any.  `pull` (N) is by how
    much Fz falls at contact, as the body draws the indenter in.
    """

    label: str
    depth: np.ndarray
    time: np.ndarray | None
    channels: Mapping[str, np.ndarray]
    sigma: Mapping[str, np.ndarray]
    segment: np.ndarray
    creep: HeldForce | str = ""
    tared: bool = False
    drift: Mapping[str, Baseline] = field(default_factory=dict)
    pull: float = 0.0


@dataclass(frozen=True, eq=False)
class Measurement:
    """One measured file, or several of one kind: repeats, notes, what is doubtful and which columns are not read.

    `path` is the file, of several the first, `more` the others.  `contact` (mm) is the standard deviation of where the
    contact of all was found in their records, 0 where it was not sought there; `headers` are what the columns are
    called in the file; `guessed` whether the signs of depth and force were both turned by their shape.  Notes are
    comment lines without '#' and what stands above the header.
    """

    path: Path
    kind: Literal["force", "profile"]
    repeats: tuple[Repeat, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()
    more: tuple[Path, ...] = ()
    contact: float = 0.0
    headers: Mapping[str, str] = field(default_factory=dict)
    guessed: bool = False

    @property
    def where(self) -> str:
        """The files in words, for messages about all of them."""
        return str(self.path) + (f" and {len(self.more)} more" if self.more else "")

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the measured channels (without places)."""
        return tuple(k for k in self.repeats[0].channels if k not in ("x", "y", "z"))


@dataclass(frozen=True, eq=False)
class _Table:
    """Columns by name in base units, the label of each row's repeat and segment, and where each row stood.

    `found` are columns whose zero is sought, `customary` whether depth has a machine's name, `position` whether that is
    none of a travel from contact, `own` what one mm or N
    of a column is in the file, `headers` what the columns are called there, `turned` those whose sign was turned,
    `less` what was subtracted of the depth (n,) mm and `computed` that in words.
    """

    path: Path
    columns: Mapping[str, np.ndarray]
    labels: np.ndarray
    segments: np.ndarray | None
    line: np.ndarray
    notes: tuple[str, ...]
    unread: tuple[str, ...]
    doubts: tuple[str, ...]
    found: tuple[str, ...]
    customary: bool
    position: bool
    own: Mapping[str, tuple[float, str]]
    headers: Mapping[str, str]
    turned: tuple[str, ...]
    less: np.ndarray | None
    reckoned: tuple[str, ...]

    @cached_property
    def rows(self) -> dict[str, np.ndarray]:
        """Indices of the rows of each repeat."""
        return rows_by_label(self.labels.tolist())


def read_measurement(
    path: str | Path | Sequence[str | Path],
    columns: Mapping[str, Column] | None = None,
    begins_at: float | None = None,
    drifts: DriftAlong | Literal["none"] | None = None,
) -> Measurement:
    """Read a measured file, or repeats of one test from several; ValueError for what is no clean table of numbers.

    `begins_at` (N) is the preload at which depth is 0, None where that is contact.  `drifts` says along what a line
    through the forces of the approach is subtracted (:mod:`rso.data.drift`), None where nobody says.  `columns` says by
    known name which columns of a machine's file are read; without them its header must say it.  Of several files each
    holds one repeat, or several by its column `repeat`, and all hold the same columns.
    """
    paths = [Path(path)] if isinstance(path, str | Path) else [Path(p) for p in path]
    if not paths:
        raise ValueError("a measurement needs at least one file")
    own = [columns_of_file(columns or {}, k, len(paths)) for k in range(len(paths))]
    found = [_table(p, c, label) for p, c, label in zip(paths, own, _labels(paths), strict=True)]
    _apart(paths)
    kinds = [_kind(t, bool(columns)) for t in found]
    for table, kind in zip(found, kinds, strict=True):
        if (kind, table.columns.keys()) != (kinds[0], found[0].columns.keys()):
            raise ValueError(
                f"{table.path}: repeats need the same columns; it holds {', '.join(table.columns)}, "
                f"{paths[0].name} holds {', '.join(found[0].columns)}"
            )
    each: list[tuple[_Table, Repeat]] = []
    for table, kind in zip(found, kinds, strict=True):
        with _reckoned(table):
            each += [(table, _repeat(table, kind, label)) for label in table.rows]
    in_air = any(_in_air(table, r) for table, r in each)
    repeats: list[Repeat] = []
    everywhere = dict.fromkeys(words for table in found for words in table.doubts)
    doubts = [f"{', '.join(t.path.name for t in found if words in t.doubts)}: {words}" for words in everywhere]
    onsets: list[Onset] = []
    for table, raw in each:
        with _reckoned(table):

            def counted(
                raw: Repeat, table: _Table = table
            ) -> tuple[Repeat, Onset | None, list[str]]:  # bound now: a loop goes on
                if begins_at is None:
                    return _from_contact(table, raw, in_air)
                return _from_preload(table, raw, begins_at)

            r, onset, told = counted(raw)
            if kinds[0] == "force" and drifts is None:
                r = _with_drift_seen(r, onset)
            elif kinds[0] == "force" and drifts is not None and drifts != "none":
                r, onset, told = _without_drift(table, raw, counted, drifts)
            r = replace(r, pull=_pull(r, onset)) if kinds[0] == "force" else r
            repeats.append(r)
            doubts += told
            onsets += [onset] if onset is not None else []
            if kinds[0] == "force":
                doubts += [*_plausible(table, r, onset is not None, drifts is None), *_left(table, r)]
                repeats[-1], said = _without_creep(r)
                doubts += said
            elif "uz" in r.channels:
                doubts += plausibility.check_profile(r.label, r.depth, r.channels["uz"])
    if kinds[0] == "force":
        doubts += plausibility.check_common_depths([(r.label, r.depth[r.segment == "loading"]) for r in repeats])
    notes, unread = (tuple(dict.fromkeys(v for t in found for v in getattr(t, k))) for k in ("notes", "unread"))
    m = Measurement(
        paths[0],
        kinds[0],
        tuple(repeats),
        notes,
        tuple(d.removeprefix(f"repeat {repeats[0].label}: ") if len(repeats) == 1 else d for d in doubts),
        unread,
        tuple(paths[1:]),
        _off(onsets),
        found[0].headers,
        any({"depth", "Fz"} <= set(t.turned) for t in found),
    )
    alike = plausibility.check_alike(
        m.where, [(r.label, r.depth, r.channels["Fz"]) for r in repeats if "Fz" in r.channels]
    )
    m = replace(m, doubts=(*m.doubts, *alike))
    for repeat in repeats:
        if len(repeat.depth) == 1 and len(repeats) > 1 and m.kind == "force":
            raise ValueError(f"{m.where}: repeat {repeat.label!r} has too few points (1) to be a curve")
    return m


@contextmanager
def _reckoned(table: _Table) -> Iterator[None]:
    """Says in every ValueError what was computed from the columns of the file, and no repeat of a file that has one."""
    try:
        yield
    except ValueError as error:
        text = str(error)
        for label in table.rows if len(table.rows) == 1 else ():
            text = text.replace(f"repeat {label!r}: ", "", 1)
        if not table.reckoned and text == str(error):
            raise
        raise ValueError(f"{text} ({'; '.join(table.reckoned)})" if table.reckoned else text) from error


def _left(table: _Table, r: Repeat) -> list[str]:
    """What to say of a depth that is the smaller part of what it was computed from, at the deepest reading."""
    if table.less is None:
        return []
    less, k = table.less[table.rows[r.label]], int(np.argmax(r.depth))
    off, depth = float(less[k] - less[int(np.argmin(np.abs(r.depth)))]), float(r.depth[k])
    if off <= REPORTED_SUBTRACTION_SHARE * depth:
        return []
    per, unit = table.own["depth"]
    return [
        f"repeat {r.label}: at the deepest reading {off * abs(per):.3g} {unit} are subtracted and "
        f"{depth * abs(per):.3g} {unit} are left: 1 % of what is subtracted is {off / depth:.2g} % of depth"
    ]


def _without_creep(r: Repeat) -> tuple[Repeat, list[str]]:
    """A repeat up to where it is held at constant force, with the readings of that apart, and what to say of them."""
    force = r.channels.get("Fz")
    found = force_holds.until(r.depth, force, r.time, r.segment) if force is not None else None
    if force is None or found is None or found[0] < contact_point.MIN_READINGS_FOR_CONTACT:
        return r, []
    n, words = found
    sigma = r.sigma.get("depth", np.zeros(len(r.depth)))
    ends = force_holds.at_its_end(r.depth, r.time, r.segment, n)
    creep = "" if ends else force_holds.hold_readings(n, r.depth, force, r.time, r.segment, sigma)
    lost = len(r.depth) - n - (len(creep.depth) if isinstance(creep, HeldForce) else 0)
    told = f"repeat {r.label}: {words}, held at constant force or a sensor at its end: "
    if ends:
        told = f"repeat {r.label}: {words}, and the indenter goes on as fast as before: a sensor at its end; "
        told += f"these {lost} readings are left out"
    elif isinstance(creep, str):
        told += f"that creep is not compared, as {creep}; "
    else:
        told += f"its {len(creep.depth)} readings are those of creep, depth over time; "
    if not ends:
        told += f"the {lost} readings behind it are left out" if lost else "there are none behind it"
    channels, sigmas = ({c: v[:n] for c, v in part.items()} for part in (r.channels, r.sigma))
    time = None if r.time is None else r.time[:n]
    kept = replace(r, depth=r.depth[:n], time=time, segment=r.segment[:n], channels=channels, sigma=sigmas, creep=creep)
    return kept, [told]


def _plausible(table: _Table, r: Repeat, found: bool, open_drift: bool) -> list[str]:
    """Remarks on a force curve, whose contact was `found` or stated, and whose drift is open; what refuses it says,
    too, which signs were turned."""
    lines, force = table.line[table.rows[r.label]], r.channels.get("Fz")
    try:
        return plausibility.check_repeat(
            table.path,
            r.label,
            r.depth,
            r.segment,
            force,
            r.time,
            lines,
            table.segments is None,
            found,
            open_drift,
            r.pull,
        )
    except ValueError as error:
        if not table.turned:
            raise
        raise ValueError(
            f"{error} (the sign of {' and '.join(table.turned)} was turned, as the force seemed to grow "
            "that way; [columns] in the study file says what the columns are)"
        ) from error


def _off(onsets: Sequence[Onset]) -> float:
    """Standard deviation (mm) of the contact of all repeats together: what scatters averages out, a bias stays."""
    if not onsets:
        return 0.0
    scatter, bias = (np.mean(np.square([getattr(o, k) for o in onsets])) for k in ("scatter", "bias"))
    return float(np.sqrt(scatter / len(onsets) + bias))


def _sought(table: _Table, r: Repeat) -> bool:
    """Whether a machine's travel may count from where its force shows the contact."""
    return (
        table.customary
        and not table.found
        and "Fz" in r.channels
        and np.sum(r.segment == "loading") > contact_point.MIN_READINGS_FOR_CONTACT
    )


def _in_air(table: _Table, r: Repeat) -> bool:
    """Whether such a record has an approach beyond doubt.

    One whose name says that it counts from contact, and whose force rises where it is 0, counts from there.
    """
    at = r.segment == "loading"
    if not _sought(table, r) or not contact_point.begins_in_air(r.depth[at], r.channels["Fz"][at]):
        return False
    if table.position:
        return True
    found = contact_point.approached(r.depth[at], r.channels["Fz"][at])
    return abs(found.depth) > contact_point.MIN_APPROACH_SD * found.deviation


def _from_contact(table: _Table, r: Repeat, in_air: bool) -> tuple[Repeat, Onset | None, list[str]]:
    """A repeat with depth, and forces, counted from contact where that is to be found in its record; and what to say.

    Machines' travels are taken so where one of the repeats is `in_air` at first, whatever their names say: some call
    the travel less the bending indentation from the start of the record on.  Positions else count from their first
    readings.
    """
    loading, names = r.segment == "loading", table.found
    if _sought(table, r):
        if not in_air:
            return _from_first(table, r) if table.position else (r, None, [])
        names = ("depth", *(n for n in FORCE_CHANNELS if n in r.channels))
    if not names:
        return r, None, []
    try:
        depth, channels, onset = contact_point.zeroed(r.depth, r.channels, loading, names)
    except ValueError as error:
        by = (
            f"zero = {ZERO_AT_CONTACT!r}"
            if table.found
            else f"{table.headers['depth']!r} begins in air, by other repeats"
        )
        raise ValueError(
            f"{table.path}: repeat {r.label!r}: {by}: {error}; {plausibility.SUBTRACT_ZERO_ADVICE}"
        ) from error
    told = f"repeat {r.label}: contact is found at {_own(table, onset.depth, onset.deviation)} by the shape of Fz"
    told += f"; {', '.join(names)} count{'s' * (len(names) == 1)} from there"
    level, (per, unit) = float(np.median(r.channels["Fz"] - channels["Fz"])), table.own["Fz"]
    told += f", {level * per + 0.0:.2g} {unit} is taken off" if "Fz" in names else ""
    counted = replace(r, depth=depth, channels=channels, tared="Fz" in names)
    return counted, onset if "depth" in names else None, [told]


def _from_preload(table: _Table, r: Repeat, force: float) -> tuple[Repeat, Onset, list[str]]:
    """A repeat whose depth is 0 at a preload (N), counted from contact; and what to say."""
    if "Fz" not in r.channels or table.found:
        why = (
            "zero = 'contact' counts from there already"
            if table.found
            else "the contact is found from Fz, which is missing"
        )
        raise ValueError(f"{table.path}: preload = {quantity_text(force, 'N', 6)}: {why}; leave one of them out")
    own, at, F = dict(r.channels), r.segment == "loading", r.channels["Fz"]
    pressed = at & (r.depth >= 0.0)
    approach = int(np.sum(at & (r.depth < 0.0)))
    try:
        taken = preload.tared(r.depth[pressed], F[pressed], force)
        own["Fz"] = F + force if taken else F
        found = (
            contact_point.approached(r.depth[at], own["Fz"][at])
            if approach > contact_point.MIN_AIR_READINGS
            else preload.contact(r.depth[at], own["Fz"][at], force)
        )
    except ValueError as error:
        raise ValueError(f"{table.path}: repeat {r.label!r}: {error}") from error
    where = f"{_own(table, found.depth, found.deviation)}"
    how = "by its approach" if approach > contact_point.MIN_AIR_READINGS else "by the shape of Fz beyond it"
    said = (
        f"repeat {r.label}: depth is 0 at a preload of {quantity_text(force, 'N')}; contact is found at {where} {how}"
    )
    said += "; depth counts from there"
    said += f", and {quantity_text(force, 'N')} are added to Fz, which was tared at the preload" if taken else ""
    return replace(r, depth=r.depth - found.depth, channels=own), found, [said]


def _without_drift(
    table: _Table,
    raw: Repeat,
    counted: Callable[[Repeat], tuple[Repeat, Onset | None, list[str]]],
    along: DriftAlong,
) -> tuple[Repeat, Onset | None, list[str]]:
    """A repeat counted from contact, its forces less the lines of their approach; and what to say.

    A slope moves the contact that is found: it is found again without.
    """
    try:
        there, before, _ = counted(raw)
        first, x = _lines(there, before, along), drift.drift_coordinate(along, raw.depth, raw.time)
        off = float(x[0] - drift.drift_coordinate(along, there.depth, there.time)[0])
        sloped = {c: replace(v, level=0.0, middle=v.middle + off) for c, v in first.items()}
        r, onset, told = counted(replace(raw, channels=drift.without_baselines(sloped, raw.channels, x)))
        again = _lines(r, onset, along)
    except ValueError as error:
        raise ValueError(f"{table.path}: repeat {raw.label!r}: {error}") from error
    x = drift.drift_coordinate(along, r.depth, r.time)
    lines = {c: first[c].moved_by(v) for c, v in again.items()}
    kept = replace(r, channels=drift.without_baselines(again, r.channels, x), drift=lines)
    if onset is not None and before is not None and "Fz" in lines:  # it moves as far as the slope is off
        moves = (onset.depth - before.depth) * min(lines["Fz"].share_off, 1.0)
        onset = replace(onset, bias=math.hypot(onset.bias, moves))
    said = [drift.drift_words(c, v, x, r.depth, kept.channels[c]) for c, v in lines.items()]
    return kept, onset, [*told, *(f"repeat {r.label}: {words}" for words in said)]


def _pull(r: Repeat, onset: Onset | None) -> float:
    """By how much (N) Fz falls at contact, as the record of a contact that was found or stated shows it."""
    if onset is not None:
        return onset.pull
    at = r.segment == "loading"
    return contact_point.drawn_by(r.depth[at], r.channels["Fz"][at]) if "Fz" in r.channels and at.any() else 0.0


def _lines(r: Repeat, onset: Onset | None, along: DriftAlong) -> dict[str, Baseline]:
    """The line of each force before contact."""
    x = drift.drift_coordinate(along, r.depth, r.time)
    before = drift.approach_readings(r.depth, r.segment == "loading", 0.0 if onset is None else onset.deviation)
    return {c: drift.fitted_baseline(along, x[before], v[before]) for c, v in r.channels.items() if c in FORCE_CHANNELS}


def _with_drift_seen(r: Repeat, onset: Onset | None) -> Repeat:
    """A repeat with the drift that its approach shows of its forces, which nobody has stated."""
    along: DriftAlong = "travel" if r.time is None else "time"
    x = drift.drift_coordinate(along, r.depth, r.time)
    before = drift.approach_readings(r.depth, r.segment == "loading", 0.0 if onset is None else onset.deviation)
    each = {c: drift.unstated_drift(along, x, before, r.depth, v) for c, v in r.channels.items() if c in FORCE_CHANNELS}
    return replace(r, drift={c: line for c, line in each.items() if line is not None})


def _from_first(table: _Table, r: Repeat) -> tuple[Repeat, Onset | None, list[str]]:
    """A repeat whose record begins at contact from its first reading, where 0 is no place near or on its way."""
    loading = r.segment == "loading"
    first, way = float(r.depth[loading][0]), float(np.ptp(r.depth[loading]))
    if -way < first <= curve_shape.CURVE_EDGE_SHARE * way:
        return _from_zero(table, r)
    found = contact_point.contact_onset(r.depth[loading], r.channels["Fz"][loading])
    found = Onset(first, contact_point.LATE_CONTACT_SHARE * way, 0.0) if found is None else replace(found, depth=first)
    told = f"repeat {r.label}: depth counts from the first reading, at {_own(table, first, found.deviation)}"
    return replace(r, depth=r.depth - first), found, [f"{told}, as no approach is seen before it"]


def _from_zero(table: _Table, r: Repeat) -> tuple[Repeat, Onset | None, list[str]]:
    """A repeat that counts from the machine's 0, with what that may be off as a contact by the shape of its force."""
    loading = r.segment == "loading"
    found = contact_point.open_contact(r.depth[loading], r.channels["Fz"][loading])
    if found is None:
        return r, None, []
    off = replace(found, depth=0.0, bias=math.hypot(found.bias, found.depth))
    at = _own(table, found.depth, found.deviation)
    told = f"repeat {r.label}: depth counts from where {table.headers['depth']!r} is 0, but the shape of Fz puts the "
    told += f"contact at {at}. The contact counts as uncertain by {quantity_text(off.deviation, 'mm', 2)}, which "
    told += (
        "holds both. If you know it better, state noise.contact of the experiment, or zero in [columns] of the study"
    )
    return r, off, [told]


def _own(table: _Table, depth: float, deviation: float) -> str:
    """A depth and its deviation as the file has them, to the digits that the deviation allows."""
    per, unit = table.own["depth"]
    off = abs(deviation * per)
    digits = max(1 - math.floor(math.log10(off)), 0) if off > 0.0 else 3
    return f"{depth * per:.{digits}f} {unit} ± {two_digits(off)} {unit}"


def _labels(paths: Sequence[Path]) -> list[str]:
    """What repeats are called by their file: nothing for a single one, else its sheet or stem, or its path where these
    agree."""
    if len(paths) < 2:
        return [""] * len(paths)
    whole = [os.path.abspath(p) for p in paths]
    if twice := [p for k, p in enumerate(paths) if whole[k] in whole[:k]]:
        raise ValueError(f"{twice[0]}: is listed twice; a repeat counts once")
    stems = [
        f"{p.stem}#{b}" if (b := block_of(one)) else sheet or p.stem
        for one, (p, sheet) in zip(paths, map(sheet_of, paths), strict=True)
    ]
    return stems if len(set(stems)) == len(stems) else [os.path.relpath(p, os.path.commonpath(whole)) for p in whole]


def fingerprint(path: Path) -> str:
    """SHA-256 of what is read of a file: of its bytes, of a workbook of its sheet's, named or the only one."""
    with sheet_of(path)[0].open("rb") as file:
        if file.read(len(ZIP_START)) == ZIP_START:
            digest = hashlib.sha256(file_text(path)[0].encode())
        else:
            file.seek(0)
            digest = hashlib.file_digest(file, "sha256")
        if block := block_of(path):
            digest.update(f"#{block}".encode())
        return digest.hexdigest()


def _apart(paths: Sequence[Path]) -> None:
    """ValueError where two files hold the same bytes."""
    seen: dict[str, Path] = {}
    for path in paths if len(paths) > 1 else ():
        if (first := seen.setdefault(fingerprint(path), path)) is not path:
            raise ValueError(f"{path}: holds the same bytes as {first}; a repeat counts once")


@dataclass(frozen=True, eq=False)
class _Rows:
    """The rows of a file under its header, by table, each with the line of its header.

    `segments` say of each line what the word of its segment means, where one has; `cycle` is the number of the cycle
    that is asked for, 0 for all; `gaps` are lines that were left out.  The remarks are of the file, of its lines and
    of its segments.
    """

    head: Head
    parts: Sequence[tuple[int, list[Row]]]
    segments: Mapping[int, str] | None
    cycle: int
    gaps: Sequence[int]
    notes: Sequence[str]
    of_file: Sequence[str]
    of_lines: Sequence[str]
    of_segments: Sequence[str]

    @property
    def rows(self) -> list[Row]:
        """Those of all tables."""
        return [row for _, part in self.parts for row in part]


def _rows_of(path: Path, wanted: Mapping[str, Column]) -> _Rows:
    """The header of a file and the rows that are read."""
    comments: list[Row] = []
    contents, of_file = file_text(path)
    lines = list(numbered_lines(contents, comments))
    width, block = width_of(lines), block_of(path)
    rows, beside = table_beside(path, [parted(row, width) for row in lines], block)
    above = [c for c in comments if rows and c[0] < rows[0][0]]
    if above and is_head(path, nearest := parted(above[-1], width), rows, wanted):
        rows.insert(0, nearest)
        comments.remove(above[-1])
    elif above:
        rows[:0] = head_of(path, comments, rows)
    notes = [text for _, text in comments]
    if not rows:
        raise ValueError(f"{path}: holds no header line such as depth_mm,Fz_N")
    try:
        found = find_head(path, rows, wanted, notes)
    except Unsaid:
        raise
    except ValueError as error:
        raise HeaderError(str(error)) from error
    head, own, of_segments = _segmented(found, rows)
    notes += [" ".join(filter(None, cells_of(row, head.separator))) for _, row in rows[: head.above]]
    parts, between, of_lines = tables.tables_beneath(path, rows, head)
    cycle = 0
    if block and not beside:
        one = tables.table_block(path, parts, block)
        cycle, parts = block * (one == parts), one
    codes = wanted["segment"].values if "segment" in wanted else own or None
    segments = None
    if codes is not None:
        segments = {k: v for _, part in parts for k, v in segments_of(path, part, head, codes).items()}
        parts = [(at, [row for row in part if segments[row[0]] != SKIP_SEGMENT]) for at, part in parts]
    parts, gaps = tables.without_gaps(parts, head)
    return _Rows(head, parts, segments, cycle, gaps, [*notes, *between], of_file, of_lines, of_segments)


def _values_of(path: Path, found: _Rows) -> tuple[dict[str, np.ndarray], dict[str, list[str]], np.ndarray]:
    """Columns of numbers in base units and columns of words by name, and the line of each row."""
    head, rows = found.head, found.rows
    no_thousands(path, rows, head)
    columns = {name: array("d") for name in head.at if name not in ("repeat", "segment")}
    words = {name: list[str]() for name in head.at if name not in columns}
    line = array("q")
    counting = counters(head, range(len(head.cells)), cells_of(rows[0][1], head.separator)) if rows else []
    for number, row in rows:
        cells = row_of(path, number, row, head)
        line.append(number)
        for name, values in words.items():
            values.append(cells[head.at[name]])
        for name, column in columns.items():
            column.append(cell_number(path, number, name, cells, head))
        no_summary(path, number, cells, head, counting)
        counting = counters(head, counting, cells)
    if not line:
        raise ValueError(f"{path}: too few points: there is no row of numbers below the header")
    # + 0.0: no negative zero where the sign is turned
    arrays = {name: (np.array(column) - head.zero[name]) * head.factor[name] + 0.0 for name, column in columns.items()}
    if "time" in arrays and rows and is_clock(cells_of(rows[0][1], head.separator)[head.at["time"]]):
        arrays["time"] += 2.0 * HALF_DAY_S * np.cumsum(np.diff(arrays["time"], prepend=arrays["time"][0]) < -HALF_DAY_S)
    if "time" in arrays and arrays["time"][0] > CALENDAR_TIME_S:
        arrays["time"] -= arrays["time"][0]
    for name, values_of in arrays.items():
        require_plausible(path, line, name, values_of, head.unit[name])
    return arrays, words, np.array(line)


def _table(path: Path, wanted: Mapping[str, Column], file_label: str) -> _Table:
    """The file as columns; `file_label` goes before the labels of its repeats."""
    wanted = with_less(wanted)
    found = _rows_of(path, wanted)
    head = found.head
    arrays, words, lines = _values_of(path, found)
    beside = _beside(found, arrays)
    less = arrays.pop(SUBTRACTED_COLUMN, None)
    if less is not None:
        arrays["depth"] = arrays["depth"] - less
    stated = None
    if found.segments is not None:
        stated = np.array([found.segments[number] for number, _ in found.rows])
    elif "segment" in words:
        stated = segment_words(path, lines, words["segment"])
    unbroken = lines - np.searchsorted(found.gaps, lines)  # a row that was left out parts no blocks
    labels, doubts = tables.labels_of(path, found.parts, unbroken, arrays, words.get("repeat", []), stated)
    try:
        turned = header_aliases.reversed_columns(arrays, labels, head.customary) if head.customary else []
    except ValueError as error:
        backwards = "time" in arrays and len(lines) > 2 and bool(np.all(np.diff(arrays["time"]) < 0.0))
        raise ValueError(f"{path}: {BACKWARDS_ADVICE.strip('; ') if backwards else error}") from error
    arrays |= {name: 0.0 - arrays[name] for name in turned}
    left_out = tables.left_out_note(found.gaps, len(lines))
    if found.cycle:
        plain = "repeat" not in words and stated is None and "depth" in arrays
        at = cycle_rows(path, found.cycle, arrays["depth"] if plain else np.zeros(1))
        arrays = {name: values[at] for name, values in arrays.items()}
        labels, lines, less = labels[at], lines[at], None if less is None else less[at]
        doubts += [EARLIER_CYCLES_DOUBT] if found.cycle > 1 else []
    if file_label:
        several = "repeat" in words or len(set(labels)) > 1
        labels = np.array([f"{file_label} {label}" if several else file_label for label in labels])
    units = {n: f"× {unit}" if is_counted(unit) else unit for n, unit in head.unit.items() if n in arrays and unit}
    in_file = {n: ((-1.0 if n in turned else 1.0) / head.factor[n], unit) for n, unit in units.items()}
    headers = {name: head.cells[k] for name, k in head.at.items() if name != SUBTRACTED_COLUMN}
    reckoned = _in_words(wanted)
    customary = "depth" in head.customary
    return _Table(
        path,
        arrays,
        labels,
        stated,
        lines,
        tuple(found.notes),
        head.unread,
        (
            *found.of_file,
            *found.of_lines,
            *_taken(head, turned),
            *found.of_segments,
            *left_out,
            *doubts,
            *reckoned,
            *_unsubtracted(head, wanted),
            *beside,
            *_pulled(path, head, found.notes),
        ),
        head.found,
        customary,
        customary and not header_aliases.from_contact(headers["depth"]),
        in_file,
        headers,
        tuple(turned),
        less,
        tuple(reckoned),
    )


def _beside(found: _Rows, arrays: Mapping[str, np.ndarray]) -> list[str]:
    """What to say of columns of the same kind that are not read, move with what is read and go less or further."""
    head, said = found.head, []
    for name in ("depth", "Fz"):
        if name not in head.customary or (name == "depth" and is_corrected(head.cells[head.at[name]])):
            continue
        read = arrays[name]
        for k, cell in enumerate(head.cells):
            unit = header_aliases.header_unit(cell, head.units[k], name)
            if k in head.at.values() or not is_of(kind_of(name), unit):
                continue
            own = _numbers_of(found, k) * float(conversion_factor(unit, kind_of(name)))
            if not np.isfinite(own).all() or np.ptp(own) == 0.0 or np.ptp(read) == 0.0:
                continue
            ratio = abs(float(np.polyfit(read, own, 1)[0]))
            if abs(np.corrcoef(own, read)[0, 1]) < MIN_RIVAL_CORRELATION or abs(ratio - 1.0) < SAME_RANGE_TOLERANCE:
                continue
            if SPREAD_WORDS & set(re.split(r"[\W_]+", cell.lower())):
                text = (
                    f"{cell!r} is not read. Is it the standard uncertainty of {head.cells[head.at[name]]!r}? Then say "
                )
                said.append(f"{text}{name}_sigma = {{ header = {inline(cell)} }} beside depth and Fz in [columns]")
                continue
            text = f"{cell!r} is not read. It moves with {head.cells[head.at[name]]!r}, {ratio:.3g} times as far. "
            near = "The gauge nearer to the specimen has the depth" if name == "depth" else "One of them is the force"
            near += ": name it in [columns] of the study"
            said.append(text + near)
    return said


def _numbers_of(found: _Rows, k: int) -> np.ndarray:
    """The k-th column (n,) of the rows as it stands, NaN where there is no number."""
    cells = (cells_of(row, found.head.separator) for _, row in found.rows)
    values = (decimal_number(row[k]) if k < len(row) else None for row in cells)
    return np.array([math.nan if v is None else v for v in values])


def _pulled(path: Path, head: Head, notes: Sequence[str]) -> list[str]:
    """What to say of a record that calls itself one of tension; ValueError where its columns were guessed besides."""
    pulled = header_aliases.tensile([*head.cells, *notes])
    if not pulled:
        return []
    if head.customary:
        raise ValueError(f"{path}: {pulled[:60]!r} says that the specimen was pulled; a record of pressing is expected")
    return [f"{pulled[:60]!r} says that the specimen was pulled: is this a record of pressing?"]


def _in_words(columns: Mapping[str, Column]) -> list[str]:
    """What is computed from the columns of a file, one sentence for each."""
    said = []
    for name, column in columns.items():
        less = column.minus
        if name != SUBTRACTED_COLUMN and (less is not None or column.stiffness is not None):
            first = f"{name} is {'−' * column.flip}{column.header!r}{_times(column)}"
            sign = "" if less is None else " + " if less.flip else " − "
            said.append(f"{first}{sign}{'' if less is None else repr(less.header) + _times(less, SUBTRACTED_COLUMN)}")
    return said


def _unsubtracted(head: Head, columns: Mapping[str, Column]) -> list[str]:
    """What to say of a travel that a study calls depth beside a deflection, which it does not subtract."""
    found = (
        bending(head.cells, head.units, [None] * len(head.cells))
        if columns and SUBTRACTED_COLUMN not in columns
        else None
    )
    if found is None or head.at.get("depth") != found[0]:
        return []
    depth, bends = (head.cells[k] for k in found[:2])
    return [f"depth is {depth!r} as it stands, beside {bends!r}: what bends is subtracted by minus in [columns]"]


def _times(column: Column, name: str = "") -> str:
    """By what the values of a column are multiplied, or divided where it is subtracted, in words."""
    k = column.stiffness
    times = "" if k is None else f" / ({1e3 * k:.4g} N/m)" if name == SUBTRACTED_COLUMN else f" · {1e3 * k:.4g} N/m"
    return times or ("" if column.compliance is None else f" · {column.compliance:.4g} mm/N")


def _segmented(head: Head, rows: Sequence[Row]) -> tuple[Head, dict[str, str], list[str]]:
    """The header with a column of a machine's segments, what its words mean, and what to say; where no column has that
    name in files that are read by their usual names."""
    k = head.at.get("segment", header_aliases.segment_column(head.cells) if head.customary else None)
    if k is None:
        return head, {}, []
    below = (cells_of(text, head.separator) for _, text in rows[head.below :])
    values = [cells[k] for cells in below if len(cells) == len(head.cells) and cells[k] not in ("", head.cells[k])]
    codes, header = header_aliases.segment_codes(values), head.cells[k]
    if not codes:
        shown = [] if "segment" in head.at else list(dict.fromkeys(values))
        each = ", ".join(f'"{v[:20]}" = "…"' for v in shown[:MAX_LISTED_CODES])
        table = f'segment = {{ header = "{header}", values = {{ {each} }} }}'
        kinds = f"{', '.join(SEGMENTS)} or {SKIP_SEGMENT}"
        text = f"{header!r} is not read: {table} in [columns] says which of its codes are {kinds}"
        return head, {}, [text] if 1 < len(shown) <= MAX_LISTED_CODES else []
    meant = ", ".join(f"{word!r} is {what}" for word, what in codes.items() if word != what)
    more = replace(
        head,
        at={**head.at, "segment": k},
        unit={**head.unit, "segment": ""},
        factor={**head.factor, "segment": 1.0},
        zero={**head.zero, "segment": 0.0},
    )
    return more, codes, [f"{header!r} is read as segment: {meant}"] if meant else []


def _taken(head: Head, turned: Sequence[str]) -> list[str]:
    """What to say of columns that were taken by their usual names."""
    if not head.customary:
        return []
    both = (
        f"; both signs were turned, which is a guess: {BOTH_SIGNS_TURNED_DOUBT}"
        if set(turned) >= {"depth", "Fz"}
        else ""
    )
    each = [
        f"{head.cells[head.at[n]]!r} is read as {n}" + (", its sign turned" if n in turned else "")
        for n in head.customary
    ]
    return [f"{'; '.join(each)}{both}; [columns] in the study file says it otherwise"]


def _kind(table: _Table, named: bool) -> Literal["force", "profile"]:
    """Force curve or surface profile, by the columns present."""
    names = [n for n in table.columns if not n.endswith("_sigma")]
    forces = [n for n in names if n in FORCE_CHANNELS]
    surface = [n for n in names if n in DISPLACEMENT_COLUMNS]
    found = f"; found are {', '.join(names)}"
    if "depth" not in names:
        also = ", and where [columns] names one column it names all that are read" if named else ""
        raise HeaderError(f"{table.path}: column depth_mm is missing{found}{also}")
    if bool(forces) == bool(surface):
        raise HeaderError(
            f"{table.path}: either forces (Fz_N, Fx_N, Fy_N) or a profile (x_mm, y_mm, uz_mm) is expected{found}"
        )
    if surface and not {"x", "y"} <= set(names):
        raise HeaderError(f"{table.path}: a profile needs the columns x_mm and y_mm{found}")
    if forces and {"x", "y", "z"} & set(names):
        raise HeaderError(
            f"{table.path}: x_mm, y_mm and z_mm belong to a profile; a force curve's place is a setting{found}"
        )
    return "profile" if surface else "force"


def _against(less: np.ndarray, force: np.ndarray) -> bool:
    """Whether a deflection (n,) and a force (n,) clearly go against each other."""
    x, y = less - less.mean(), force - force.mean()
    return float(x @ y) < -0.5 * float(np.sqrt((x @ x) * (y @ y)))


def _way(table: _Table, rows: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """How far the drive went (n,) mm where something bends beneath it, else the depth.

    A drive that rests is a hold though the depth grows: what bends gives way as the force relaxes.
    """
    if table.less is None:
        return depth
    way = depth + table.less[rows]
    return way - way[0]


def _clock_advice(time: np.ndarray, depth: np.ndarray, data: Mapping[str, np.ndarray], several: bool) -> str:
    """What to do about times (n,) that do not grow, by what depth (n,) and the other columns do there."""
    step = np.diff(time)
    if np.all(step < 0.0):
        return BACKWARDS_ADVICE
    k = int(np.argmax(step <= 0.0))
    if step[k] == 0.0:
        rests = [np.diff(v)[step == 0.0] for v in (depth, *data.values())]
        if not any(v.any() for v in rests):
            return "; such rows stand twice: delete one of each"
        few = np.sum(step == 0.0) <= max(1.0, 0.02 * len(time))
        return "; " + (
            "delete one of the two rows" if few else "a clock this coarse says nothing, leave its column out"
        )
    falls = step < 0.0
    if np.mean(falls) > MAX_CLOCK_RESTARTS_SHARE:
        return "; the rows stand in no order of time: sort them by it"
    if np.abs(np.diff(depth)[falls]).max() < SAME_DEPTH_SHARE * float(np.ptp(depth)):
        return (
            "; the clock begins again where the depth goes on: add the times up from part to part, or leave the column "
            "out"
        )
    return "" if several else "; several tests in one file need a column 'repeat'"


def _repeat(table: _Table, kind: str, label: str) -> Repeat:
    """The rows of one repeat, checked."""
    rows = table.rows[label]
    data = {name: column[rows] for name, column in table.columns.items()}
    if table.less is not None and "Fz" in data and _against(table.less[rows], data["Fz"]):
        raise ValueError(
            f"{table.path}: repeat {label!r}: what is subtracted from depth falls while Fz grows, which nothing "
            "elastic does. Change its sign (flip = true in minus), or that of Fz"
        )
    depth, time = data.pop("depth"), data.pop("time", None)
    if kind == "force" and time is not None and np.any(np.diff(time) <= 0):
        k = int(np.argmax(np.diff(time) <= 0)) + 1
        hint = _clock_advice(time, depth, data, len(set(table.labels.tolist())) > 1)
        fail(
            table.path,
            int(table.line[rows][k]),
            f"column 'time': {time[k]:g} s does not follow {time[k - 1]:g} s{hint}",
        )
    if table.segments is not None:
        segment = table.segments[rows]
        if kind == "force":
            plausibility.check_stated_loading(
                f"{table.path}: repeat {label!r}", depth[segment == "loading"], bool(np.any(segment == "unloading"))
            )
    elif kind == "profile":
        segment = np.full(len(depth), "loading")
    else:
        segment = segments(table.path, label, _way(table, rows, depth), time)
    channels = {k: v for k, v in data.items() if not k.endswith("_sigma")}
    sigma = {k.removesuffix("_sigma"): v for k, v in data.items() if k.endswith("_sigma")}
    return Repeat(label, depth, time, channels, sigma, segment)
