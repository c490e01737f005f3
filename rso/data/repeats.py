"""Repeats of one test → one curve with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rso.core.correlation import exponential
from rso.core.digits import quantity_text, range_text
from rso.core.distributions import student
from rso.core.power_law import LEADING_EXPONENT
from rso.core.units import COLUMN_UNITS
from rso.data import usual_errors
from rso.data.drift import Baseline
from rso.data.files.reading import Measurement, Repeat
from rso.data.holds import Hold, held, relaxing_curve, stop_time
from rso.data.measured_curve import MeasuredCurve, Noise
from rso.data.outliers import without_spikes
from rso.data.scatter import White, beyond_said, of_record, of_scale, ratio_of, repeat_scatter, step_of_scale
from rso.data.variance_components import variance_parts

PULL_OFF_FORCE_SHARE = 0.1  # of its range: a force that is negative by more pulls
KEPT_AIR_SHARE = 0.05  # of the deepest travel: so much before contact still tells where that is
# Dense records are averaged in blocks: a curve of this many points says all that such a test knows.
MAX_AVERAGED_POINTS = 200


def combine(
    measurement: Measurement,
    noise: Noise,
    channel: str = "Fz",
    segment: str = "loading",
    hold: Hold | None = None,
) -> MeasuredCurve:
    """Average the repeats on a common grid of the depths that all of them reach.

        C = (κ w² + c² e^{−|Δu|/ℓ} + g² ŷ ŷᵀ + o² ŷ' ŷ'ᵀ)/r      scatter of the r repeats, usual errors of a test
          + (s sᵀ + F²) e^{−|Δu|/ℓ} + diag((d ŷ')²)/m         stated of readings: column, force, depth
          + (G² + K²) ŷ ŷᵀ + O² ŷ' ŷ'ᵀ                        stated of the test: gain, calibration, contact
          + P² 1 1ᵀ                                           a pull into contact that a model may lack
          + σ_b² 1 1ᵀ + σ_s² (x − x̄)(x − x̄)ᵀ                  what a line through the approach is off by

    What is stated of a single reading, white (ℓ = 0), goes with the square root of how many were averaged, m: repeats,
    and readings of a block; what has a length of correlation is of the curve and does not.

    The repeats' deviations are split into white noise w, of one variance or, where that shows, of one that changes
    smoothly, a noise c correlated along the depth, and parts along ŷ (gain g) and ŷ' (contact o), estimated together
    (:func:`~rso.data.variance_components.variance_parts`); how well w is known is the curve's `freedom`.  g, o and c
    that nobody states are of the usual size, the less so the more repeats there are; one record has these alone
    (:mod:`~rso.data.usual_errors`).  What is stated counts as it is, unless repeats differ by more.
    White noise that is stated is what the readings show, once more: the former counts, unless they clearly scatter by
    more, whether about a smooth curve (one repeat alone, which shows no other) or about each other.
    ŷ is a polynomial of degree 4 through the mean y: a gain of the readings themselves would take their noise along
    and pull every fit low, by g² times their number (Peelle's puzzle; D'Agostini, Nucl. Instrum. Methods A 346 (1994)
    306), one of ŷ by some g².  ValueError if channel or segment is not there, or the repeats share no depths.

    Readings of a `hold` come behind those of loading, a few moments for all.  There u of the first equation is the way
    that the indenter would have gone since, at its speed: errors that go together along the way do so in time.  ŷ is
    that of :func:`~rso.data.holds.relaxing_curve`, and ŷ' what it is at the end of loading times F/F(end): a contact
    found late is late for all.
    """
    if channel not in measurement.channels:
        raise ValueError(f"{measurement.where}: no channel {channel!r}; there are {', '.join(measurement.channels)}")
    if measurement.kind == "profile":
        return _combine_profile(measurement, noise, channel)
    clean = without_spikes(measurement)[0]
    means = _averaged(clean, channel, segment, hold)
    u, y, smooth, slope, n = means.along, means.each, means.smooth, means.slope, means.loading
    said, deep = _stated(means, noise, channel)
    if len(y) > 1:
        white_said = np.diag(said) if not noise.correlation else deep
        seen, freedom, shared, left = _scatter(u, y, smooth, slope, white_said, np.diag(said), noise, n)
    else:
        mean = y[0]
        # small force, steep bend: not to be noise
        there = of_record(u[:n], mean[:n] - _power_series(u[:n], mean[:n])(u[:n]), smooth[:n], said[:n, :n])
        noisy = there if hold is None else _both(there, n, _of_hold(hold, mean[n:], smooth[n:], said[n:, n:]))
        noisy = _on_a_scale(noisy, measurement.repeats[0], channel, segment, means)
        seen, freedom, shared, left = np.diag(noisy.variance), noisy.freedom, {}, _of_one(u, smooth, slope, noise, n)
    covariance = seen + said
    untold = len(y) == 1 and not noise.correlation
    white = np.sqrt(np.diag(covariance)) if untold else None
    whole = {"gain": noise.gain, "calibration": noise.calibration, "contact": noise.contact}
    for name, size in whole.items():
        if size:
            shared[name] = size * (slope if name == "contact" else smooth)
            covariance = covariance + np.outer(shared[name], shared[name])
    drifts, unstated = _of_drift(clean, channel, segment, means, hold)
    for name, column in drifts.items():
        shared[name] = column
        covariance = covariance + np.outer(column, column)
    left = {**left, **unstated, **_of_pull(clean, channel, means)}
    for name, U in left.items():
        covariance = covariance + U @ U.T
        if U.shape[1] == 1:
            shared[name] = U[:, 0]
    sigma = np.sqrt(np.diag(covariance))
    return MeasuredCurve(
        channel,
        COLUMN_UNITS[channel],
        means.depth,
        y.mean(axis=0),
        sigma,
        len(y),
        covariance,
        freedom=freedom,
        shared=shared,
        white=white,
        usual=left,
        since=means.since,
        back=segment == "unloading",
    )


def _of_drift(
    measurement: Measurement, channel: str, segment: str, means: _Means, hold: Hold | None
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """What lines that were subtracted are off by (n,), by name, and U (n, 1) of a drift that nobody has stated.

    Lines of repeats are off one by one; a drift of one rig is taken for the same in all of them.
    """
    stated: dict[str, np.ndarray] = {}
    unstated, many = np.zeros(len(means.depth)), len(means.each)
    for k, r in enumerate(measurement.repeats):
        if channel not in r.drift:
            continue
        line, of = r.drift[channel], f" of repeat {k + 1}" * (many > 1)
        x = _along(line, r, segment, means, hold)
        if not line.subtracted:
            unstated = unstated + line.line(x) / many
            continue
        stated |= dict(zip((f"level{of}", f"drift{of}"), line.errors(x).T / many, strict=True))
    return stated, {"drift": unstated[:, None]} if unstated.any() else {}


def _of_pull(measurement: Measurement, channel: str, means: _Means) -> dict[str, np.ndarray]:
    """U (n, 1) of the attraction that bodies show at contact and a model may lack: as much less force all the way."""
    pull = float(np.mean([r.pull for r in measurement.repeats])) if channel == "Fz" else 0.0
    return {"pull": np.full((len(means.depth), 1), pull)} if pull > 0.0 else {}


def _along(line: Baseline, r: Repeat, segment: str, means: _Means, hold: Hold | None) -> np.ndarray:
    """Times or travels (n,) of a repeat at the points of the grid."""
    if line.along == "travel" or r.time is None:
        return means.depth
    n, rows = means.loading, np.nonzero(r.segment == segment)[0]
    rows = rows[np.argsort(r.depth[rows], kind="stable")]
    there = np.interp(means.depth[:n], r.depth[rows], r.time[rows])
    if hold is None or means.since is None:
        return there
    return np.append(there, stop_time(r, r.time, hold.speed) + means.since[n:])


@dataclass(frozen=True)
class _Means:
    """Repeats on one grid (n,) of loading with the moments of a hold behind it.

    Way of the indenter u, readings of each repeat (r, n), how many of its readings each averages and the mean square
    of what is stated of these (both (r, n)); ŷ, ŷ', depth, time of the hold; and how many points are of loading.
    """

    along: np.ndarray
    each: np.ndarray
    many: np.ndarray
    power: np.ndarray
    smooth: np.ndarray
    slope: np.ndarray
    depth: np.ndarray
    since: np.ndarray | None
    loading: int


def _averaged(measurement: Measurement, channel: str, segment: str, hold: Hold | None) -> _Means:
    """The repeats of one segment on a grid of the depths that all reach; ValueError as :func:`combine`."""
    branches = [_branch(r, channel, segment) for r in measurement.repeats if np.any(r.segment == segment)]
    if not branches:
        present = sorted({str(s) for r in measurement.repeats for s in r.segment})
        raise ValueError(f"{measurement.where}: no segment {segment!r}; there are {', '.join(present)}")
    u = _grid(measurement, [b[0] for b in branches])
    y = np.array([_between(depth, value, u) for depth, value, *_ in branches])
    many = len(branches) * np.array([np.interp(u, b[0], b[3]) for b in branches])  # averaged, if all were like this one
    power = np.array([np.interp(u, depth, square) for depth, _, square, _ in branches])
    smooth, slope = _smooth(u, y.mean(axis=0))
    if hold is None:
        return _Means(u, y, many, power, smooth, slope, u, None, len(u))
    exponent = float(slope[-1] * u[-1] / smooth[-1]) if smooth[-1] else LEADING_EXPONENT
    rows = [held(r, hold, channel, exponent) for r in measurement.repeats]
    y, power = (np.hstack([a, [b[k] for b in rows]]) for k, a in enumerate((y, power)))
    many = np.hstack([many, len(rows) * np.array([b[2] for b in rows])])
    smooth, slope = _continued(hold, y.mean(axis=0), smooth, slope)
    depth, since = np.append(u, np.full(len(hold.since), hold.depth)), np.append(np.zeros(len(u)), hold.since)
    along = np.append(u, hold.depth + hold.speed * hold.since)
    return _Means(along, y, many, power, smooth, slope, depth, since, len(u))


def _stated(means: _Means, noise: Noise, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (n, n) of what is stated of single readings, and the variance (n,) of their depths within it."""
    length = noise.correlation or 0.0
    together = 1.0 if length > 0 else means.many
    stated = np.sqrt(np.mean(means.power / together, axis=0))
    along = exponential(means.along, length) if length > 0 else np.eye(len(means.along))
    deep = (noise.depth * means.slope) ** 2 * np.mean(1.0 / means.many, axis=0)
    own = noise.of(channel) * np.sqrt(np.mean(1.0 / np.broadcast_to(together, means.each.shape), axis=0))
    return (np.outer(stated, stated) + np.outer(own, own)) * along + np.diag(deep), deep


def _continued(hold: Hold, mean: np.ndarray, smooth: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ŷ and ŷ' of loading (n,) and of the hold behind it (n + m,), whose means are those of `mean` (n + m,)."""
    along = relaxing_curve(list(hold.since[:, None]), mean[len(smooth) :])(hold.since)
    share = along / smooth[-1] if smooth[-1] else np.ones(len(along))
    return np.append(smooth, along), np.append(slope, slope[-1] * share)


def _on_a_scale(seen: White, repeat: Repeat, channel: str, segment: str, means: _Means) -> White:
    """White noise of one record (n,), no less than the scale of its readings rounds off."""
    values = repeat.channels[channel][repeat.segment == segment]
    step = step_of_scale(values)
    if not step or len(means.along) < 2:
        return seen
    rise = np.where(means.many[0] > 1.0, np.abs(means.slope) * np.gradient(means.along), 0.0)
    return of_scale(seen, values, step, rise)


def _of_hold(hold: Hold, mean: np.ndarray, smooth: np.ndarray, said: np.ndarray) -> White:
    """White noise of the moments of a hold of one record."""
    return of_record(np.log(hold.since), mean - smooth, smooth, said)


def _both(there: White, n: int, resting: White) -> White:
    """Noise of loading (n,) and hold (m,) together, known as well as that of the larger part is, where of the other it
    was not taken from readings."""
    taken = [v.freedom for v in (there, resting) if math.isfinite(v.freedom)]
    larger = there if n >= len(resting.variance) else resting
    freedom = sum(taken) if len(taken) == 2 else larger.freedom
    return White(np.append(there.variance, resting.variance), freedom)


def value_at(curve: MeasuredCurve, depth: float) -> tuple[float, float]:
    """Value and standard uncertainty of a measured curve at one depth (mm), between the readings on either side.

    A straight line lies above the force of a rounded tip, by 4 % in the second interval: interpolated is what is left
    beside a smooth a u^{3/2} + b u² + c u + d (as many of these terms as there are readings less one).  Half a point
    spacing beyond either end is still granted (recorded depths scatter about the nominal ones), along the slope of
    the end; ValueError farther out.
    """
    u, y = curve.depth, curve.value
    slack = 0.5 * float(np.median(np.diff(u))) if len(u) > 1 else 1e-6 * max(1.0, abs(float(u[0])))
    if not u[0] - slack <= depth <= u[-1] + slack:
        raise ValueError(
            f"depth {quantity_text(depth, 'mm', 6)} is outside the measured range "
            f"{range_text(u[0], u[-1], 'mm', 'to', 6)}"
        )
    inside = float(np.clip(depth, u[0], u[-1]))
    value = float(_between(u, y, np.array([inside]))[0])
    if inside != depth:
        value += (depth - inside) * float(_smooth(u, y)[1][0 if depth < inside else -1])
    return value, float(np.interp(depth, u, curve.sigma))


def _between(u: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Readings y (n,) at depths u (n,), increasing, at other depths (m,) in their range; at their own as they are."""
    straight = np.interp(at, u, y)
    if len(u) < 2 or np.isin(at, u).all():
        return straight
    series = _power_series(u, y)
    return straight + series(at) - np.interp(at, u, series(u))


def _power_series(u: np.ndarray, y: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """a u^{3/2} + b u² + c u + d through readings y (n,) at u (n,): as many of these terms as readings less one."""

    def terms(depth: np.ndarray) -> np.ndarray:
        s = np.maximum(depth, 0.0) / (np.abs(u).max() or 1.0)
        return np.stack([s**LEADING_EXPONENT, s**2, s, np.ones_like(s)], axis=-1)[..., : min(4, max(len(u) - 1, 1))]

    c = np.linalg.lstsq(terms(u), y, rcond=None)[0]
    return lambda depth: terms(depth) @ c


def _branch(repeat: Repeat, channel: str, segment: str) -> tuple[np.ndarray, ...]:
    """Depth, value, square of the stated sigma and number of readings, of one segment, sorted.

    Equal depths are merged, dense records averaged in blocks; of an approach through air only its end is kept, as a
    polynomial through the whole would bend for it.
    """
    rows = repeat.segment == segment
    near = repeat.depth >= -KEPT_AIR_SHARE * max(float(repeat.depth[rows].max()), 0.0)
    if segment == "unloading":
        near = _adhering(repeat, channel, rows)
    rows = rows & near if np.sum(rows & near) > 1 else rows
    depth = repeat.depth[rows]
    stated = repeat.sigma.get(channel, np.zeros_like(repeat.depth))[rows]
    block = np.unique(depth, return_inverse=True)[1].ravel()
    distinct = block.max() + 1
    if distinct > MAX_AVERAGED_POINTS:
        block = block * MAX_AVERAGED_POINTS // distinct
    count = np.bincount(block)
    each = (depth, repeat.channels[channel][rows], stated**2)
    return *(np.bincount(block, weights=v) / count for v in each), count


def pulls_off(measurement: Measurement) -> bool:
    """Whether Fz pulls in unloading of every repeat by more than a tare or scatter may: by a tenth of its range.

    Means over three readings count.
    """
    found = []
    for r in measurement.repeats:
        rows = r.segment == "unloading"
        if "Fz" not in r.channels or rows.sum() < 6:
            return False
        mean = np.convolve(r.channels["Fz"][rows], np.ones(3) / 3.0, mode="valid")
        found.append(float(mean.min()) < -PULL_OFF_FORCE_SHARE * float(np.ptp(mean)))
    return bool(found) and all(found)


def _adhering(repeat: Repeat, channel: str, rows: np.ndarray) -> np.ndarray:
    """(n,) whether a reading of the unloading lies before the strongest pull, where contact is for certain.

    Beyond that a record is steep, and where it lets go depends on the stiffness of the machine.  The strongest pull is
    the least of means over three readings; without one it is where contact ends.
    """
    at = np.nonzero(rows)[0]
    at = at[np.argsort(repeat.depth[at], kind="stable")]
    force = repeat.channels["Fz"][at] if "Fz" in repeat.channels else repeat.channels[channel][at]
    mean = np.convolve(force, np.ones(3) / 3.0, mode="valid") if len(force) > 3 else force
    k = int(np.argmin(mean)) + (1 if len(force) > 3 else 0)
    out = np.zeros(len(repeat.depth), bool)
    out[at[k:]] = True
    return out if force[k] < 0.0 else rows & (repeat.depth > 0.0)


def _grid(measurement: Measurement, depths: list[np.ndarray]) -> np.ndarray:
    """Depths common to all repeats: their own if they agree, else as many evenly spaced ones."""
    first = depths[0]
    if all(len(d) == len(first) and np.allclose(d, first, rtol=0, atol=1e-9) for d in depths):
        return first
    low, high = max(d[0] for d in depths), min(d[-1] for d in depths)
    if low >= high:
        raise ValueError(
            f"{measurement.where}: the repeats share no range of depths ({quantity_text(low, 'mm', 6)} against "
            f"{quantity_text(high, 'mm', 6)})"
        )
    return np.linspace(low, high, int(np.median([len(d) for d in depths])))


def _smooth(u: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A smooth curve through the points and its dy/du; one point alone is taken as y ~ u^{3/2}."""
    if len(u) == 1:
        return y, LEADING_EXPONENT * y / u if u[0] > 0 else np.zeros(1)
    # full=True: badly spread depths give the least-norm fit, without a warning.
    fit = np.polynomial.Polynomial.fit(u, y, min(4, len(u) - 1), full=True)[0]
    return fit(u), fit.deriv()(u)


def _of_one(u: np.ndarray, smooth: np.ndarray, slope: np.ndarray, noise: Noise, loading: int) -> dict[str, np.ndarray]:
    """What one record is usually off by, as parts U (n, q) of C = U Uᵀ, where nothing is stated; the first readings are
    those of `loading`."""
    there = u[:loading]
    sizes = {
        "gain": usual_errors.USUAL_GAIN_ERROR,
        "contact": usual_errors.USUAL_CONTACT_ERROR_SHARE * float(there.max()),
        "correlation": _correlated(smooth),
    }
    length = usual_errors.USUAL_CORRELATION_LENGTH_SHARE * float(np.ptp(there))
    return _parts(u, smooth, slope, {n: v for n, v in sizes.items() if n in noise.unstated}, length)


def _correlated(smooth: np.ndarray) -> float:
    return usual_errors.USUAL_CORRELATED_ERROR_SHARE * float(np.abs(smooth).max())


def _parts(
    u: np.ndarray, smooth: np.ndarray, slope: np.ndarray, sizes: Mapping[str, float], length: float | None = None
) -> dict[str, np.ndarray]:
    """U (n, q) of errors of these standard deviations; correlated ones over a length, usually of half the travel."""
    found = {n: sizes[n] * s[:, None] for n, s in (("gain", smooth), ("contact", slope)) if sizes.get(n, 0.0) > 0.0}
    if sizes.get("correlation", 0.0) > 0.0 and len(u) > 1:
        length = length or usual_errors.USUAL_CORRELATION_LENGTH_SHARE * float(np.ptp(u))
        found["correlation"] = sizes["correlation"] * _root(exponential(u, length))
    return found


def _root(K: np.ndarray) -> np.ndarray:
    """U of U Uᵀ = K (n, n)."""
    λ, Q = np.linalg.eigh(K)
    keep = λ > 1e-9 * λ.max()
    return np.asarray(Q[:, keep] * np.sqrt(λ[keep]))


def _scatter(
    u: np.ndarray,
    y: np.ndarray,
    smooth: np.ndarray,
    slope: np.ndarray,
    white_said: np.ndarray,
    said: np.ndarray,
    noise: Noise,
    loading: int,
) -> tuple[np.ndarray, float, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Covariance (n, n) of the mean of two repeats y (r, n) and more beyond what is stated as white of it, `white_said`
    (n,), its degrees of freedom, what is shared of it, and what is usual beyond it, in parts.

    White noise of a size that was taken from readings and makes the share p of all noise, that which is `said` (n,)
    included, counts m/p² of its own m (Satterthwaite, Biometrics Bull. 2 (1946) 110).  What gain and contact scatter by
    is shared with other channels, a part for each repeat, whose sum has the correlation that the repeats have.
    """
    r = len(y)
    found, part = repeat_scatter(y, smooth, slope)
    contrasts = np.linalg.svd(np.eye(r) - 1.0 / r)[0][:, : r - 1].T @ y
    prior = {n: v for n, v in zip(("correlation", "gain", "contact"), _priors(u[:loading], smooth, noise), strict=True)}
    variance = np.maximum(found.variance, (1e-9 * float(np.abs(smooth).max() or 1.0)) ** 2)
    p = variance_parts(
        u, contrasts, variance, np.stack([smooth, slope]), tuple(prior.values()), usual_errors.USUAL_ERROR_FREEDOM
    )
    ratio = p.white * ratio_of(y, smooth, slope, r * white_said)
    white = beyond_said(White(p.white * found.variance, found.freedom), ratio, r * white_said)
    mean = white.variance / r
    taken = np.where(mean > 0.0, mean + white_said, 0.0)
    share = float(np.mean(taken / np.maximum(mean + said, 1e-300)))
    dof = {"gain": r - 1.0, "contact": r - 1.0, "correlation": (r - 1) * (1.0 + 0.5 * float(np.ptp(u)) / p.length)}
    shown, rest = {}, {}
    for name, v in (("gain", p.gain), ("contact", p.contact), ("correlation", p.correlated)):
        v0, k = prior[name], dof[name]
        s2 = (
            v
            if v0 is None
            else max(v * (usual_errors.USUAL_ERROR_FREEDOM + k) - usual_errors.USUAL_ERROR_FREEDOM * v0**2, 0.0) / k
        )
        a, b = (
            usual_errors.counted_variance(v0 or 0.0, k, s2)
            if v0 is not None
            else (student(usual_errors.USUAL_ERROR_FREEDOM + k) ** 2 * v, 0.0)
        )
        stated = {"gain": noise.gain, "contact": noise.contact, "correlation": None}[name] or 0.0
        shown[name], rest[name] = max(a / r - stated**2, 0.0), math.sqrt(b / r) if name in noise.unstated else 0.0
    shared: dict[str, np.ndarray] = {}
    for name, shape, row in (("gain", smooth, part[0]), ("contact", slope, part[1])):
        size = math.sqrt(shown[name] / max(float(row @ row), 1e-300))
        shared |= {f"{name} of repeat {k + 1}": a * size * shape for k, a in enumerate(row) if a * size != 0.0}
    K = exponential(u, p.length)
    C = np.diag(mean) + shown["correlation"] * K + sum(np.outer(s, s) for s in shared.values())
    freedom = white.freedom / share**2 if share > 0 else math.inf
    return C, freedom, shared, _parts(u, smooth, slope, rest, p.length)


def _priors(u: np.ndarray, smooth: np.ndarray, noise: Noise) -> tuple[float | None, float | None, float | None]:
    """Deviations of correlated noise, gain and contact of a test that are expected; None: nothing is known, or 0."""
    sizes = (
        _correlated(smooth),
        usual_errors.USUAL_GAIN_ERROR,
        usual_errors.USUAL_CONTACT_ERROR_SHARE * float(u.max()),
    )
    given = (None, noise.gain, noise.contact)
    names = ("correlation", "gain", "contact")
    return tuple(
        usual_errors.deviation_of_size(v) if n in noise.unstated else (usual_errors.deviation_of_size(g) if g else None)
        for n, v, g in zip(names, sizes, given, strict=True)
    )  # type: ignore[return-value]


def _combine_profile(measurement: Measurement, noise: Noise, channel: str) -> MeasuredCurve:
    """Average a profile over repeats, place by place; places are those of the first repeat."""
    tables = []
    for repeat in measurement.repeats:
        places = np.stack([repeat.depth, repeat.channels["x"], repeat.channels["y"]], axis=1)
        order = np.lexsort(places.T[::-1])
        stated = repeat.sigma.get(channel, np.zeros(len(order)))
        tables.append((places[order], repeat.channels[channel][order], stated[order]))
    places = tables[0][0]
    if any(t[0].shape != places.shape or not np.allclose(t[0], places, rtol=0, atol=1e-9) for t in tables):
        raise ValueError(f"{measurement.where}: the repeats of a profile need the same depths and places")
    y = np.array([t[1] for t in tables])
    r, n = y.shape
    said = np.mean([t[2] ** 2 for t in tables], axis=0) + noise.of(channel) ** 2
    q = np.var(y, axis=0, ddof=1) if r > 1 else np.zeros(n)
    seen = White(np.full(n, q.mean()), (r - 1) * n if r > 1 else math.inf)
    scatter = beyond_said(seen, float(np.mean(q / said)) if said.min() > 0.0 else math.inf, said)
    variance = (scatter.variance + said) / r
    share = float(np.mean(scatter.variance > 0.0))
    freedom = scatter.freedom / share**2 if share > 0 else math.inf
    return MeasuredCurve(
        channel,
        COLUMN_UNITS[channel],
        places[:, 0],
        y.mean(axis=0),
        np.sqrt(variance),
        len(y),
        np.diag(variance),
        places[:, 1:],
        freedom,
    )
