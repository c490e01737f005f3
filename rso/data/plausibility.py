"""Force curves that cannot be what they are said to be: refused with a reason, or remarked upon.

A sign, a unit or a tare that is wrong gives a curve as smooth as the right one, and a material for it.  What is refused
here is no curve of an indenter that goes deeper into a body at rest; what is doubtful only is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rso.core.digits import quantity_text, range_text, two_digits
from rso.core.power_law import LEADING_EXPONENT
from rso.data import curve_shape
from rso.data.contact_point import (
    LATE_CONTACT_SHARE,
    MAX_FORCE_POWER,
    SNAP_IN_FORCE_SHARE,
    begins_in_air,
    drawn_by,
    drift_of_approach,
)
from rso.data.drift import approach_readings, unstated_drift
from rso.data.scatter import step_of_scale

MAX_FALL_TO_DEEPEST_SHARE = 0.5  # of its range by which a force must not fall while the indenter goes deeper
MAX_UNTARED_FORCE_SHARE = 0.5  # of its range that a force may have where the indenter begins to press
DOUBTED_UNTARED_FORCE_SHARE = 0.01  # the same, from which on it is remarked upon where it is no scatter
MIN_LOADING_STROKE_SHARE = 0.5  # of the stroke that loading must cover
MIN_RETURNING_READINGS, MIN_FALLING_SHARE = 3, 0.9  # readings that return, and the share of them that falls
MIN_FORCE_TO_NOISE = 20.0  # times the noise: a force that tells its sign and unit
MAX_REPEAT_FORCE_RATIO = 5.0  # ratio of the largest forces of two repeats to one depth
MAX_REPEAT_DEPTH_RATIO = 20.0  # ratio of the deepest travels of two repeats
DOUBTED_REPEAT_FORCE_RATIO = 1.5  # the same, from which on it is remarked upon
FALLING_STEP_RATIO = 3.0  # times the steps beside it: a fall of the force of a body that is pressed deeper
DOUBTED_RETURN_SHARE = 0.03  # of its range, on the mean: a force that is larger in unloading
ASSUMED_SCATTER_SHARE = 0.03  # of its range that a force may scatter where too few readings tell it
MAX_AIR_DRIFT_SHARE = 0.01  # of all that the force changes by: a sensor may drift by as much in air
MIN_FORCE_POWER = 0.8  # power below which no force of a pressed body grows
MAX_JUMP_STROKE_SHARE = 0.05  # of the stroke: a single depth this far out of line is a mistake
# of the stroke: a step of depth this long, far beyond those beside it, is remarked upon
REMARKED_STEP_STROKE_SHARE = 0.02
# of the deepest travel: a record that begins beyond it has a force there, or depths from elsewhere
MAX_FIRST_DEPTH_SHARE = 0.5
TURN_SIGN_ADVICE = "turn its sign (flip = true in [columns] of the study, or without it)"
SUBTRACT_ZERO_ADVICE = "subtract the reading at contact (zero = … in [columns] of the study)"
SUBTRACT_DRIFT_ADVICE = (
    'drift = "travel" or "time" of the experiment subtracts it, "none" says that it is none. Until then it counts as '
    "an error"
)
OPEN_ADHESION_ADVICE = "Where [parameters] has no `adhesion`, as much counts as an error of all forces"
COARSE_FORCE_STEP_SHARE = 0.01  # of its range: steps of a force that are remarked upon
# of the deepest travel: a mark that goes up by more, and further than any goes down, has its sign turned
MAX_RISING_MARK_SHARE = 0.1
MAX_MARK_TRAVEL_RATIO = 2.0  # times the deepest travel: no mark goes as far


def check_repeat(
    path: Path,
    label: str,
    depth: np.ndarray,
    segment: np.ndarray,
    force: np.ndarray | None,
    time: np.ndarray | None,
    lines: np.ndarray,
    sorted_here: bool,
    found: bool = False,
    open_drift: bool = True,
    pull: float = 0.0,
) -> list[str]:
    """Remarks on one repeat; ValueError naming file, repeat and column where it cannot be a test.

    `depth` (n,) mm, `force` (n,) N is Fz, `lines` (n,) of the file; `sorted_here` where the segments were not given,
    `found` where depth counts from a contact that was found in this record, `open_drift` where nobody has said whether
    the force drifts; `pull` (N) is by how much Fz falls at that contact, by its shape.
    """
    who = f"{path}: repeat {label!r}"
    few = len(depth) < curve_shape.MIN_MACHINE_READINGS
    if len(depth) < curve_shape.MIN_HAND_READINGS:
        return []
    for name, unit, values in (("depth", "mm", depth), ("Fz", "N", force)):
        if values is not None and not few and len(wild := curve_shape.placeholder_readings(values)):
            count, rows = ("1 reading", "this row") if len(wild) == 1 else (f"{len(wild)} readings", "these rows")
            raise ValueError(
                f"{path}:{lines[wild[0]]}: column {name!r} is {values[wild[0]]:g} {unit} in {count} and quite "
                f"different in all others. It looks like a mark for an overload or a gap: delete {rows}"
            )
    stroke = float(np.ptp(depth))
    if stroke == 0.0:
        raise ValueError(
            f"{who}: column 'depth' is {quantity_text(depth[0], 'mm', 6)} throughout, the indenter does not move"
        )
    if force is not None and np.ptp(force) == 0.0:
        raise ValueError(
            f"{who}: column 'Fz' is {quantity_text(force[0], 'N', 6)} throughout, the indenter felt nothing: "
            f"another column?"
        )
    if not few:
        _jump(path, depth, stroke, lines)
    loading = segment == "loading"
    notes: list[str] = []
    if few and force is not None and (k := curve_shape.slipped(depth, force)) is not None:
        notes.append(
            f"repeat {label}: {quantity_text(force[k], 'N', 6)} at {quantity_text(depth[k], 'mm', 6)} (line "
            f"{lines[k]}) lies far beside a power of the depth "
            "that all other readings follow; mistyped?"
        )
    if pad := 0 if few else curve_shape.padding(depth, force, stroke):
        at = f"{quantity_text(depth[-1], 'mm', 6)}" + (
            "" if force is None else f" and {quantity_text(force[-1], 'N', 6)}"
        )
        notes.append(
            f"repeat {label}: the last {pad} readings (from line {lines[-pad]}) are all {at}, after a jump; filled up "
            "by a logger? Leave them out"
        )
    notes += [] if few else _breaks(label, depth, force, time, loading, lines)
    if sorted_here:
        notes += _of_order(who, label, depth, time, loading)
    if depth.max() <= 0.0:
        raise ValueError(
            f"{who}: column 'depth' lies between {range_text(depth.min(), depth.max(), 'mm', 'and', 6)} and "
            f"never beyond 0, where "
            f"contact is: {SUBTRACT_ZERO_ADVICE}"
        )
    if force is not None and not few and (more := curve_shape.returned(depth, force, segment)) > DOUBTED_RETURN_SHARE:
        notes.append(
            f"repeat {label}: Fz is larger in unloading than in loading at the same depths, by "
            f"{100.0 * more:.2g} % of its range on the mean. No body gives back more work than it took. "
            "Are the rows in reverse order, or the segments "
            "exchanged? Has the drive play, is the force filtered, or does the sensor drift?"
        )
    if force is not None and np.sum(loading) >= curve_shape.MIN_HAND_READINGS:
        try:
            notes += _of_force(who, label, depth, force, time, loading, found, open_drift, pull)
        except ValueError as error:  # a cell that was tared on the way makes a force that no zero mends
            raise ValueError("; ".join([str(error), *(n for n in notes if "Fz jumps" in n)])) from error
    return notes


def check_stated_loading(who: str, depth: np.ndarray, returns: bool) -> None:
    """ValueError where depths (n,) mm that a file calls loading, in their order, come back from the deepest of them.

    A record that falls throughout and has no unloading (`returns`) is a loading sorted from its deepest reading on; one
    that turns again and again has several loadings, and a single reading out of line is a remark of its own.
    """
    if len(depth) < curve_shape.MIN_HAND_READINGS:
        return
    deepest, last = float(depth.max()), float(depth[-1])
    k = int(np.argmax(depth))
    after = np.diff(depth[k:])
    whole = len(after) >= MIN_RETURNING_READINGS and np.mean(after <= 0.0) > MIN_FALLING_SHARE
    if not whole or (k < MIN_RETURNING_READINGS and not returns):
        return
    if deepest - last > MIN_LOADING_STROKE_SHARE * float(np.ptp(depth)):
        raise ValueError(
            f"{who}: its segment 'loading' goes to {quantity_text(deepest, 'mm', 4)} and ends at "
            f"{quantity_text(last, 'mm', 4)}. Are loading and unloading exchanged, or both called loading? "
            f"Is the depth a height? Then {TURN_SIGN_ADVICE}"
        )


def _of_order(who: str, label: str, depth: np.ndarray, time: np.ndarray | None, loading: np.ndarray) -> list[str]:
    """Remarks on the order of readings whose segments were not given; ValueError where they do not press."""
    notes: list[str] = []
    pressed = float(np.ptp(np.maximum(depth, 0.0)))  # how far it went home through the air says nothing
    if (
        np.sum(loading) < (2 if len(depth) < curve_shape.MIN_MACHINE_READINGS else 3)
        or np.ptp(depth[loading]) < MIN_LOADING_STROKE_SHARE * pressed
    ):
        raise ValueError(
            f"{who}: column 'depth' falls from {range_text(depth[0], depth[-1], 'mm', 'to', 6)} and hardly "
            f"rises anywhere. It must "
            f"grow from 0 at contact while the indenter goes deeper: {TURN_SIGN_ADVICE} or subtract its start. "
            "Where the rows stand in reverse order, sort them"
        )
    if back := curve_shape.back(depth):
        notes.append(
            f"repeat {label}: depth falls back by {quantity_text(back, 'mm', 2)} before its deepest point, and "
            f"all is read as one "
            "loading. Separate several tests by a column 'repeat', parts of one by 'segment'"
        )
    if time is None and (near := curve_shape.rest(depth)):
        notes.append(
            f"repeat {label}: {near} of {len(depth)} readings lie at the deepest point. If that is a hold, add a "
            "column time_s, or 'segment' with loading, hold, unloading"
        )
    if time is not None and (rest := curve_shape.rest_on_the_way(depth, time)):
        notes.append(
            f"repeat {label}: the indenter rests for {rest[0]:.2g} s near {quantity_text(rest[1], 'mm', 2)} on "
            f"its way, but all is "
            "read as one loading at a steady speed. If the body relaxes, remove the readings of rests"
        )
    return notes


def _of_force(
    who: str,
    label: str,
    depth: np.ndarray,
    force: np.ndarray,
    time: np.ndarray | None,
    loading: np.ndarray,
    found: bool,
    open_drift: bool,
    pull_of_shape: float,
) -> list[str]:
    """Remarks on where the force of loading begins and how it ends; ValueError where it is none of pressing."""
    d, F = depth[loading], force[loading]
    span = float(np.ptp(force))
    start = _force_at_start(who, d, F, span)
    notes: list[str] = []
    late, level, scatter = curve_shape.force_onset(d, F) or (0.0, start, ASSUMED_SCATTER_SHARE * span)
    if d[0] <= curve_shape.CURVE_EDGE_SHARE * d.max() and abs(level) > max(
        DOUBTED_UNTARED_FORCE_SHARE * span, 5.0 * scatter
    ):
        notes.append(
            f"repeat {label}: Fz is {quantity_text(level, 'N')} at {quantity_text(max(d[0], 0.0), 'mm', 2)}; "
            f"not tared, or touched before? "
            "(depth that counts from a preload: preload of the experiment says it)"
        )
    if not found and late > LATE_CONTACT_SHARE * d.max() and begins_in_air(d, F) and not _presses_before(late, d, F):
        notes.append(
            f"repeat {label}: by the shape of Fz the contact lies near {quantity_text(late, 'mm', 2)}: up to "
            f"there it stays within "
            f"its scatter of {quantity_text(scatter, 'N', 1)}. Depth must count from contact: subtract the "
            f"travel in air (zero = … "
            "or \"contact\" in [columns]; rso diagnose looks at it as 'offset')"
        )
    if pull := drawn_by(d, F):
        notes.append(
            f"repeat {label}: Fz falls by {quantity_text(pull, 'N', 2)} where the indenter touches, and then rises: "
            f"the body draws it in. {OPEN_ADHESION_ADVICE}"
        )
    elif pull_of_shape > SNAP_IN_FORCE_SHARE * span:
        notes.append(
            f"repeat {label}: by the shape of Fz the body draws the indenter in, by about "
            f"{quantity_text(pull_of_shape, 'N', 1)} at contact. {OPEN_ADHESION_ADVICE}"
        )
    if open_drift and (found or _drifts(d, F)) and (drift := _drift(d, F, span)):
        change, on = drift
        where = "the contact that was found" if found else "contact"
        notes.append(
            f"repeat {label}: Fz {'grows' if change > 0.0 else 'falls'} by {quantity_text(abs(change), 'N')} in the "
            f"approach, before {where}. If the sensor drifts, it goes on by about "
            f"{quantity_text(abs(on), 'N', 2)} ({two_digits(100.0 * abs(on) / span)} % of all) up to the deepest "
            f"reading. {SUBTRACT_DRIFT_ADVICE}"
        )
    elif (open_drift or not found) and (grown := curve_shape.before_contact(d, F)):
        notes.append(
            f"repeat {label}: Fz grows by {quantity_text(grown, 'N')} from {quantity_text(d.min(), 'mm')} to 0, "
            f"where contact should be; depth "
            f"must count from contact: {SUBTRACT_ZERO_ADVICE}"
        )
    if not notes and (power := curve_shape.loading_power(d, F)) is not None and power < MIN_FORCE_POWER:
        notes.append(
            f"repeat {label}: Fz grows only as the power {power:.2g} of depth, a pressed body's at least in "
            "proportion; are the columns depth and Fz exchanged?"
        )
    if flat := curve_shape.flat_top(depth, force, float(np.ptp(depth))):
        notes.append(
            f"repeat {label}: Fz stays at its largest value, {quantity_text(force.max(), 'N', 4)}, for {flat} "
            f"readings; a sensor at its "
            "end?"
        )
    elif creep := curve_shape.creep(d, F, None if time is None else time[loading]):
        notes.append(
            f"repeat {label}: Fz stays at {quantity_text(creep[1], 'N')} from "
            f"{range_text(creep[0], d.max(), 'mm', 'to')}. Was it held at "
            "constant force, did the sensor saturate, or did the indenter sink in?"
        )
    if (mute := curve_shape.mute_until(d, F)) is not None:
        notes.append(
            f"repeat {label}: Fz is exactly {quantity_text(F[np.argmin(d)], 'N')} up to {quantity_text(mute, 'mm')} "
            "and scatters beyond. Does the cell show nothing below a threshold, or nothing negative? Then contact is "
            "earlier and Fz is off. Tare the cell so that it scatters in air"
        )
    coarse = step_of_scale(F) > COARSE_FORCE_STEP_SHARE * span
    if not coarse and (apart := curve_shape.two_curves(d, F)):
        notes.append(
            f"repeat {label}: Fz changes from reading to reading between two curves, up to "
            f"{quantity_text(apart, 'N', 2)} apart, and their mean is fitted. Were loading and unloading, or two "
            "tests, sorted by depth? Write them one after the other"
        )
    if (step := step_of_scale(F)) > COARSE_FORCE_STEP_SHARE * span:
        notes.append(
            f"repeat {label}: Fz comes in steps of {quantity_text(step, 'N')}, {100.0 * step / span:.2g} % of "
            f"its range; what they "
            "round off counts as noise"
        )
    # nearer to the deepest point it is a rest, in which the body relaxes
    if (fall := curve_shape.fall(F)) and d.max() - d[fall[0]] > 0.005 * np.ptp(depth):
        top, low = fall
        notes.append(
            f"repeat {label}: Fz falls from {quantity_text(F[top], 'N')} at {quantity_text(d[top], 'mm')} to "
            f"{quantity_text(low, 'N')} while the indenter "
            f"goes on to {quantity_text(d.max(), 'mm')}. Did it slip or break, or was it taken off before the "
            f"record ends? Leave "
            "such readings out"
        )
    return notes


def _drifts(d: np.ndarray, F: np.ndarray) -> bool:
    """Whether a force changes along a line before a contact that was stated, rather than as that of a late contact."""
    before = approach_readings(d, np.ones(len(d), bool), 0.0)
    line = unstated_drift("travel", d, before, d, F)
    if line is None or not line.is_clear:
        return False
    x = d[before] - d.min()
    straight, pressed = (np.stack([np.ones_like(x), x**p], axis=1) for p in (1.0, LEADING_EXPONENT))
    left = [F[before] - A @ np.linalg.lstsq(A, F[before])[0] for A in (straight, pressed)]
    return bool(np.linalg.norm(left[0]) < np.linalg.norm(left[1]))


def _drift(d: np.ndarray, F: np.ndarray, span: float) -> tuple[float, float] | None:
    """By how much (N) a force changes before the contact that was found, and by how much it would until the deepest
    reading; None where it does not, or too little to matter."""
    air = d < 0.0
    if (line := drift_of_approach(d[air], F[air])) is not None:
        grown, on = -line[1] * float(d.min()), line[1] * float(d.max())
        if abs(on) > DOUBTED_UNTARED_FORCE_SHARE * span:
            return grown, on
    if (jump := curve_shape.before_contact(d, F)) is not None:
        return jump, jump * float(d.max()) / abs(float(d.min()))
    return None


def _presses_before(late: float, d: np.ndarray, F: np.ndarray) -> bool:
    """Whether the force grows already up to the depth `late` (mm): along a line, beyond its error and a usual drift."""
    air = d <= late
    if np.unique(d[air]).size < 3:
        return False
    line, cov = np.polyfit(d[air], F[air], 1, cov="unscaled")
    left = F[air] - np.polyval(line, d[air])
    error = np.sqrt(cov[0, 0] * float(left @ left) / (len(left) - 2))
    return bool(line[0] > max(4.0 * error, MAX_AIR_DRIFT_SHARE * float(np.ptp(F)) / np.ptp(d[air])))


def _force_at_start(who: str, d: np.ndarray, F: np.ndarray, span: float) -> float:
    """The force (N) where loading begins; ValueError where it falls, is not tared, or depths are a machine's."""
    n = max(3 if len(F) >= curve_shape.MIN_MACHINE_READINGS else 1, int(curve_shape.CURVE_EDGE_SHARE * len(F)))
    shallow = d <= max(curve_shape.CURVE_EDGE_SHARE * d.max(), float(d.min()))
    start, end = float(np.median(F[shallow])), float(np.median(F[-n:]))
    if end < start - MAX_FALL_TO_DEEPEST_SHARE * span:
        raise ValueError(
            f"{who}: column 'Fz' falls from {range_text(start, end, 'N', 'to')} while the indenter goes deeper. "
            f"Fz is the "
            f"force of the specimen on the indenter, positive upwards: {TURN_SIGN_ADVICE}"
        )
    if d[0] > MAX_FIRST_DEPTH_SHARE * d.max() > 0.0:
        least = (d[0] / d.max()) ** MAX_FORCE_POWER * end
        if start < 0.5 * least and least > MIN_FORCE_TO_NOISE * curve_shape.noise_of(F):
            raise ValueError(
                f"{who}: column 'depth' begins at {quantity_text(d[0], 'mm', 6)} with "
                f"{quantity_text(start, 'N')} and ends at {quantity_text(d.max(), 'mm', 6)} with "
                f"{quantity_text(end, 'N')}. A body pressed from 0 mm on has at least "
                f"{quantity_text(least, 'N', 2)} at the first of these: "
                f"{SUBTRACT_ZERO_ADVICE}"
            )
    if d[0] <= curve_shape.CURVE_EDGE_SHARE * d.max() and abs(start) > MAX_UNTARED_FORCE_SHARE * span:
        raise ValueError(
            f"{who}: column 'Fz' is {quantity_text(start, 'N')} where the indenter begins to press, and changes "
            f"by {quantity_text(span, 'N')} "
            "in all. Subtract the reading before contact (zero = … in [columns] of the study)"
            + ("; where the body pulls the indenter in, keep the approach in the record: it shows that" * (start < 0.0))
        )
    return start


def check_alike(path: str, repeats: Sequence[tuple[str, np.ndarray, np.ndarray]]) -> list[str]:
    """Remarks on repeats (label, depth, Fz) whose largest forces to about one depth differ by a factor
    DOUBTED_REPEAT_FORCE_RATIO; ValueError from MAX_REPEAT_FORCE_RATIO on, and for depths that differ by a factor
    MAX_REPEAT_DEPTH_RATIO."""
    ways = sorted((float(d.max()), label) for label, d, _ in repeats)
    if len(ways) > 1 and ways[-1][0] > MAX_REPEAT_DEPTH_RATIO * ways[0][0] > 0.0:
        raise ValueError(
            f"{path}: repeat {ways[0][1]!r} goes to {quantity_text(ways[0][0], 'mm')}, repeat {ways[-1][1]!r} to "
            f"{quantity_text(ways[-1][0], 'mm')}: no repeats of one test. Has one of them another unit?"
        )
    deepest = ways[-1][0] if ways else 0.0
    ends = []
    for label, d, F in repeats:
        force = (
            float(np.median(F[d > 0.95 * d.max()]))
            if len(d) >= curve_shape.MIN_MACHINE_READINGS and d.max() > 0.8 * deepest
            else 0.0
        )
        if abs(force) > MIN_FORCE_TO_NOISE * curve_shape.noise_of(F):
            ends.append((label, force))
    if len(ends) < 2:
        return []
    low, high = (pick(ends, key=lambda v: v[1]) for pick in (min, max))
    told = (
        f"the largest force of repeat {low[0]!r} is {quantity_text(low[1], 'N')}, that of repeat {high[0]!r} "
        f"{quantity_text(high[1], 'N')}, to about the same depth"
    )
    if low[1] * high[1] <= 0.0 or (high[1] / low[1] > MAX_REPEAT_FORCE_RATIO and low[1] > 0.0):
        raise ValueError(f"{path}: {told}. One of them has another sign, unit or tare")
    if high[1] / low[1] <= DOUBTED_REPEAT_FORCE_RATIO:
        return []
    return [
        f"{told}. Their mean is fitted as one test. Are they of several specimens, or was the body changed in between? "
        "Then give each as a test of its own"
    ]


def check_profile(label: str, depth: np.ndarray, uz: np.ndarray) -> list[str]:
    """Remarks on the vertical displacements uz (n,) mm of one repeat of a profile, recorded at `depth` (n,) mm."""
    deepest, most, least = float(depth.max()), float(uz.max()), float(uz.min())
    if max(most, -least) > MAX_MARK_TRAVEL_RATIO * deepest:
        return [
            f"repeat {label}: uz goes from {range_text(least, most, 'mm', 'to')} at depths to "
            f"{quantity_text(deepest, 'mm')}, further than "
            "the indenter. uz is the displacement, not the height, of a mark: is its unit right?"
        ]
    if most > max(MAX_RISING_MARK_SHARE * deepest, -least):
        return [
            f"repeat {label}: marks go up by {quantity_text(most, 'mm')} while the indenter goes "
            f"{quantity_text(deepest, 'mm')} down; uz is "
            f"positive upwards: {TURN_SIGN_ADVICE}"
        ]
    return []


def check_common_depths(repeats: Sequence[tuple[str, np.ndarray]]) -> list[str]:
    """Remarks on repeats (label, depth of loading in mm) that take from the depths which all of them reach."""
    ways = [(label, float(d.min()), float(d.max())) for label, d in repeats if len(d)]
    if len(ways) < 2:
        return []
    deepest, first = max(end for _, _, end in ways), min(start for _, start, _ in ways)
    slack, notes = curve_shape.CURVE_EDGE_SHARE * deepest, []
    for label, start, end in ways:
        if end < deepest - slack:
            notes.append(
                f"repeat {label} ends at {quantity_text(end, 'mm')}, others go to "
                f"{quantity_text(deepest, 'mm')}: the mean ends there"
            )
        if start > max(first, 0.0) + slack:
            notes.append(
                f"repeat {label} begins at {quantity_text(start, 'mm')}, others at "
                f"{quantity_text(first, 'mm')}: the mean begins there"
            )
    return [f"{note}, the rest is left out; give it as an experiment of its own" for note in notes]


def _jump(path: Path, depth: np.ndarray, stroke: float, lines: np.ndarray) -> None:
    """A single reading of the depth far beside both its neighbours, or the last far beside all steps before."""
    step = np.abs(np.diff(depth))
    before, at, after = depth[1:-3], depth[2:-2], depth[3:-1]
    beside = np.minimum(np.abs(at - before), np.abs(at - after))
    near = np.maximum(step[:-3], step[3:])  # of the readings on both sides, among themselves
    alone = (beside > np.maximum(MAX_JUMP_STROKE_SHARE * stroke, 8.0 * near)) & ((at - before) * (at - after) > 0.0)
    if alone.any():
        k = int(np.argmax(alone)) + 2
        raise ValueError(
            f"{path}:{lines[k]}: column 'depth' jumps to {quantity_text(depth[k], 'mm', 6)} for a single "
            f"reading, between "
            f"{range_text(depth[k - 1], depth[k + 1], 'mm', 'and', 6)}: leave the row out"
        )
    if step[-1] > max(MAX_JUMP_STROKE_SHARE * stroke, 8.0 * step[:-1].max()):
        raise ValueError(
            f"{path}:{lines[-1]}: column 'depth' jumps to {quantity_text(depth[-1], 'mm', 6)} in the last "
            f"reading, after "
            f"{quantity_text(depth[-2], 'mm', 6)}: leave the row out"
        )


def _breaks(
    label: str,
    depth: np.ndarray,
    force: np.ndarray | None,
    time: np.ndarray | None,
    loading: np.ndarray,
    lines: np.ndarray,
) -> list[str]:
    """Remarks on the largest step of depth and of the force of loading that those beside it do not share.

    A counter that slipped, a motor that lost steps and a cell tared on the way leave the rest of a record as smooth as
    it was.  Where only readings are missing the speed, or the force, goes on with it: nothing is remarked upon.
    """
    notes, step = [], np.diff(depth)
    far = curve_shape.isolated_steps(np.abs(step)) & (
        np.abs(step) > max(REMARKED_STEP_STROKE_SHARE * np.ptp(depth), 12.0 * curve_shape.noise_of(depth))
    )
    if time is not None:
        far &= curve_shape.isolated_steps(np.abs(step) / np.maximum(np.diff(time), 1e-12))
    elif force is not None:
        far &= ~curve_shape.isolated_steps(np.abs(np.diff(force)), 3.0)
    far = curve_shape.while_moving(far, depth)
    if far.any():
        k = int(np.argmax(np.abs(step) * far))
        notes.append(
            f"repeat {label}: depth jumps by {quantity_text(step[k], 'mm')} from "
            f"{quantity_text(depth[k], 'mm')} between two readings (line "
            f"{lines[k + 1]}), far more than beside it. Did a counter slip, or a motor lose steps?"
        )
    if force is not None:
        rise = np.diff(force)
        alone = curve_shape.isolated_steps(np.abs(rise))
        alone |= curve_shape.isolated_steps(np.abs(rise), FALLING_STEP_RATIO) & (rise < 0.0)
        far = alone & ~curve_shape.isolated_steps(np.abs(step), 3.0) & loading[:-1] & loading[1:]
        far = curve_shape.while_moving(
            far & (np.abs(rise) > max(MAX_JUMP_STROKE_SHARE * np.ptp(force), 12.0 * curve_shape.noise_of(force))), depth
        )
        if far.any():
            k = int(np.argmax(np.abs(rise) * far))
            drawn = ", a jump into contact" * bool(rise[k] < 0.0 > force[k + 1])
            notes.append(
                f"repeat {label}: Fz jumps by {quantity_text(rise[k], 'N')} at {quantity_text(depth[k], 'mm')} "
                f"between two readings (line "
                f"{lines[k + 1]}), far more than beside it. Was there a slip, a crack{drawn}, or a cell tared "
                "during the test?"
            )
    return notes
