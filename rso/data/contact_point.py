"""Where a record touches the body: contact by the shape of the force, and what it is uncertain by."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rso.core.digits import quantity_text
from rso.core.power_law import LEADING_EXPONENT, POWER_LAW_FAMILIES, ROUNDED_EXPONENTS, STIFFENING_EXPONENT

PULLED_PRIOR = 0.1  # of a rounded tip that the body draws in: the force falls at contact before it rises
# Priors of what a force does before contact: it stays, drifts, or relaxes over so much of the way from its start.
CONSTANT_FORCE_PRIOR, DRIFTING_FORCE_PRIOR, RELAXING_FORCE_PRIOR, RELAXING_WAY_SHARES = 0.5, 0.3, 0.2, (0.05, 0.15, 0.4)
MAX_FORCE_BEFORE_CONTACT_SHARE = 0.2  # of the range of the force that it does so by, at most
MIN_CHI2_FALL = 25.0  # fall of χ² with one number more that is no scatter
LEAST_SCATTER_SHARE = 1e-3  # of the range of the force: a reading is not known better
MAX_CONTACT_FORCE_SHARE = 0.7  # of the largest force: what tells the contact
# the whole of that and half of it, whose contacts are compared
CONTACT_FORCE_SHARES = (MAX_CONTACT_FORCE_SHARE, 0.5 * MAX_CONTACT_FORCE_SHARE)
# of the travel pressed up to there by which two powers miss the contact of a soft curved body
CONTACT_BIAS_SHARE = 0.005
MIN_APPROACH_SD = 2.0  # standard deviations after the first reading
# of the travel: a contact this late is taken, or remarked upon, where nobody has asked for it
LATE_CONTACT_SHARE = 0.03
MAX_FORCE_POWER = 4.0  # power beyond which no tissue stiffens; twice that is the β of the steepest e^{βt}
MAX_CONTACT_READINGS = 200  # means of readings that tell the shape of a curve
N_CONTACT_CANDIDATES = 181  # places of contact that are tried
MAX_CONTACT_WAY_SHARE = 0.95  # of the way
MIN_READINGS_FOR_CONTACT = 6  # readings up to there
MIN_AIR_READINGS = 3  # readings in air, at least, that show that there was an approach
# of the range of the force, at most: a body that is pressed when the record begins is steeper
MAX_DRIFT_FORCE_SHARE = 0.1
MIN_DRIFT_STANDARD_ERRORS = 4.0  # standard errors of the slope of an approach beyond which it drifts
SNAP_IN_FORCE_SHARE, SNAP_IN_DEPTH_SHARE = 0.01, 0.03  # of the range of force and of depth: a jump into contact
MIN_MEANS_IN_AIR = 8  # means of readings apart that show what a force scatters by in air
# times the largest deviation of a force in air, by means of so many readings
SNAP_IN_SCATTER_RATIO, SNAP_IN_WINDOWS = 4.0, (1, 5, 15, 31)
MAX_NEIGHBOUR_CORRELATION = 0.98  # correlation of a reading with the next, at most


@dataclass(frozen=True)
class Onset:
    """Where the force rises: depth (mm), what it scatters by from record to record, and what it is off by in all.

    `pull` (N) is by how much the force falls there, as far as the record shows it: the body draws the indenter in.
    """

    depth: float
    scatter: float
    bias: float
    pull: float = 0.0

    @property
    def deviation(self) -> float:
        """Standard deviation (mm) of both."""
        return math.hypot(self.scatter, self.bias)


@dataclass(frozen=True)
class _Fit:
    """Contact c and its variance, in shares of `way` from the first reading `t` (n,), χ² and variance of a reading."""

    c: float
    spread: float
    left: float
    variance: float
    way: float
    t: np.ndarray
    F: np.ndarray


def contact_onset(depth: np.ndarray, force: np.ndarray) -> Onset | None:
    """The contact of a loading curve (n,) in mm and N that begins in air; None where too few readings show it.

    The contact is a rounded tip's (:func:`_of_rounded`) with the weight that the record leaves to such tips, else the
    average of alternatives m of the shape beyond contact and of what the force does before it.  Its bias holds by how
    much it may lie elsewhere by any of them, Σ w_m (var_m + (c_m − c)²) (S. T. Buckland, K. P. Burnham, N. H. Augustin,
    Biometrics 53 (1997) 603), or by half of the window.
    """
    u, F = _pressed(depth, force)
    contact = _of_rounded(u, F)
    return None if contact is None else _widened(contact, u, F)


def _of_rounded(u: np.ndarray, F: np.ndarray) -> Onset | None:
    """The contact of a rounded tip by means u, F (n,); None where too few of them show it.

    Least squares of F = b + Σ_p a_p (u − c)^p, p of ROUNDED_EXPONENTS, up to MAX_CONTACT_FORCE_SHARE of the largest
    force, for c from the first reading on, with a drift b' u and a third power where they are clear; c is the mean, its
    scatter the standard deviation, of exp(−χ²/2) over c, with the residual's memory.  Its bias is that of two powers on
    a soft body, or by how much more than scatter the contact moves if half of the force shows it. Valid for a rounded
    tip on a smooth body without adhesion, with what stiffens or softens beyond small depths.
    """
    whole, half = (_fit(u, F, share) for share in CONTACT_FORCE_SHARES)
    if whole is None:
        return None
    bias = CONTACT_BIAS_SHARE * (1.0 - whole.c) * whole.way
    if half is not None:
        moves = whole.c * whole.way - half.c * half.way
        scatter = sum(fit.spread * fit.way**2 for fit in (whole, half))
        bias = math.hypot(bias, math.sqrt(max(moves**2 - scatter, 0.0)))
    return Onset(float(u[0]) + whole.way * whole.c, whole.way * math.sqrt(whole.spread), bias)


def _widened(contact: Onset, u: np.ndarray, F: np.ndarray) -> Onset:
    """The same contact, by how much the alternatives say that it may be off beside its scatter."""
    found = [average for share in CONTACT_FORCE_SHARES if (average := _averaged(u, F, share)) is not None]
    if not found:
        return contact
    (c, within, between, weight, pull), less = found[0], found[1:]
    moves = max(((c - other) ** 2 - within - between - v - w for other, v, w, *_ in less), default=0.0)
    depth = weight * contact.depth + (1.0 - weight) * (float(u[0]) + c)
    off = between + (float(u[0]) + c - depth) ** 2 + max(moves, 0.0)
    return Onset(depth, max(contact.scatter, math.sqrt(within)), max(contact.bias, math.sqrt(off)), pull)


def jump_in(depth: np.ndarray, force: np.ndarray) -> Onset | None:
    """Where a body draws the indenter in after an approach in air: between two readings of a loading curve (n,) in mm
    and N; None without such a jump.

    It falls by SNAP_IN_FORCE_SHARE of its range from a level that it had in air up to there, within SNAP_IN_DEPTH_SHARE
    of the way, and by SNAP_IN_SCATTER_RATIO times what the force in air scatters by; means of SNAP_IN_WINDOWS readings
    show a fall that single ones hide.  A rigid indenter without a reach of adhesion jumps at contact (Johnson, Kendall
    & Roberts, Proc. R. Soc. A 324 (1971) 301); that reach is unknown and taken for 1 % of the way pressed.
    """
    found = _jump(depth, force)
    return None if found is None else replace(found[0], pull=found[1])


def drawn_by(depth: np.ndarray, force: np.ndarray) -> float:
    """By how much (N) the force of :func:`jump_in` falls below its level in air; 0 without such a jump."""
    found = _jump(depth, force)
    return 0.0 if found is None else found[1]


def _jump(depth: np.ndarray, force: np.ndarray) -> tuple[Onset, float] | None:
    """The jump that the shortest means show."""
    order = np.argsort(depth, kind="stable")
    found = (_jump_of_means(depth[order], force[order], window) for window in SNAP_IN_WINDOWS)
    return next(filter(None, found), None)


def _jump_of_means(u: np.ndarray, F: np.ndarray, window: int) -> tuple[Onset, float] | None:
    """A jump into contact and how far the force falls (N), by the mean of so many readings u, F (n,) at each of them;
    None where these show none."""
    if len(u) < 2 * MIN_MEANS_IN_AIR * window:
        return None
    x, means_of = u[window // 2 : len(u) - window // 2], np.convolve(F, np.full(window, 1.0 / window), "valid")
    least = int(np.argmin(means_of))
    if least < MIN_MEANS_IN_AIR * window or x[-1] <= x[least]:
        return None
    level = float(np.median(means_of[:least]))
    fall = level - float(means_of[least])
    first = int(np.nonzero(means_of[:least] > level - 0.5 * fall)[0][-1])  # the last reading in air
    air = means_of[: first + 1 - window // 2] - level
    way, apart = float(x[-1] - x[0]), window * float(x[first + 1] - x[first])
    sudden = x[least] - x[first] <= SNAP_IN_DEPTH_SHARE * way + (window > 1) * apart
    if len(air) < MIN_MEANS_IN_AIR * window or not sudden:
        return None
    scatter = float(np.abs(air[:-1]).max())
    if fall < max(SNAP_IN_FORCE_SHARE * float(np.ptp(F)), SNAP_IN_SCATTER_RATIO * scatter):
        return None
    if not _rises(x[first + 1 :], means_of[first + 1 :], fall, way, scatter):
        return None  # a cell that was tared in air falls as well, and stays
    return Onset(0.5 * float(x[first] + x[first + 1]), apart / 12**0.5, 0.01 * float(x[-1] - x[first])), fall


def _rises(u: np.ndarray, F: np.ndarray, fall: float, way: float, scatter: float) -> bool:
    """Whether a force (n,) that fell begins to rise at once: by a tenth of its fall, and more than it scatters by, soon
    after.

    A body that drew the indenter in has all of the fall back a₀²/3R further on, a₀ the contact without a load.
    """
    least = int(np.argmin(F[u <= u[0] + SNAP_IN_DEPTH_SHARE * way]))
    soon = np.nonzero(u <= u[least] + 2.0 * SNAP_IN_DEPTH_SHARE * way)[0]
    if len(soon) - least < MIN_AIR_READINGS:
        return False
    here, there = (
        float(np.median(F[part])) for part in (slice(least, least + MIN_AIR_READINGS), soon[-MIN_AIR_READINGS:])
    )
    return there - here > max(0.1 * fall, scatter)


def approached(depth: np.ndarray, force: np.ndarray) -> Onset:
    """The contact of a loading curve that begins in air; ValueError where it does not show one."""
    if (jump := jump_in(depth, force)) is not None:
        return jump
    u, F = _pressed(depth, force) if len(depth) >= MIN_READINGS_FOR_CONTACT else (depth, force)
    return _widened(_seen(depth, _of_rounded(u, F) if len(depth) >= MIN_READINGS_FOR_CONTACT else None), u, F)


def _seen(depth: np.ndarray, contact: Onset | None) -> Onset:
    """The contact of a rounded tip where there is air before it beyond doubt; ValueError where there is not."""
    if contact is None:
        raise ValueError("too few readings before 0.7 of the largest force to find the contact")
    before = int(np.sum(depth < contact.depth))
    if before < MIN_AIR_READINGS or contact.depth - float(depth.min()) < MIN_APPROACH_SD * contact.deviation:
        where = f"{contact.depth:.3g} ± {quantity_text(contact.deviation, 'mm', 2)}"
        raise ValueError(f"no approach is seen: {before} reading(s) before {where}, where the force begins to rise")
    return contact


def begins_in_air(depth: np.ndarray, force: np.ndarray) -> bool:
    """Whether a loading curve (n,) has an approach beyond doubt: no curve that begins with it does as well.

    Such are b + a t^p with p up to MAX_FORCE_POWER and b + a t^1.5 e^{βt}, t from the first reading: tissue that
    stiffens much is no later contact.
    """
    if len(depth) < MIN_READINGS_FOR_CONTACT:
        return False
    if (jump := jump_in(depth, force)) is not None:
        return jump.depth - float(depth.min()) > LATE_CONTACT_SHARE * float(np.ptp(depth))
    u, F = _pressed(depth, force)
    try:
        found = _seen(depth, _of_rounded(u, F))
    except ValueError:
        return False
    fit = _fit(u, F, MAX_CONTACT_FORCE_SHARE)
    if fit is None or found.depth - float(depth.min()) < LATE_CONTACT_SHARE * float(np.ptp(depth)):
        return False
    return _from_start(fit)[0] > fit.left + MIN_CHI2_FALL * fit.variance


def _from_start(fit: _Fit) -> tuple[float, float]:
    """Squares left by the best of the curves that begin at contact with the first reading, and the variance of a
    reading about it, as of `_profile`."""
    shapes = [fit.t**p for p in np.linspace(1.0, MAX_FORCE_POWER, 61)]
    shapes += [fit.t**LEADING_EXPONENT * np.exp(b * fit.t) for b in np.linspace(0.1, 2.0 * MAX_FORCE_POWER, 80)]
    left, rest = min((_left(np.stack([np.ones_like(s), s], axis=1), fit.F) for s in shapes), key=lambda found: found[0])
    least, n = (LEAST_SCATTER_SHARE * float(np.ptp(fit.F))) ** 2, len(rest)
    return left, max(left / max(n - 4, 1) / own_share(rest, n), least)  # a level, a size, a power and the place


def open_contact(depth: np.ndarray, force: np.ndarray) -> Onset | None:
    """Where the contact of a loading curve (n,) in mm and N may be beside 0; None where it is hardly elsewhere.

    A machine's 0 is where somebody set it.  A record that neither begins in air beyond doubt nor at contact beyond
    doubt leaves both open: the contact by its shape is then one of two, and the bias of the other holds their distance.
    Where the force has grown by more than a drift before it, that is no contact but a base or a stiffer layer beneath.
    """
    if len(depth) < MIN_READINGS_FOR_CONTACT or (found := contact_onset(depth, force)) is None:
        return None
    if abs(found.depth) <= max(LATE_CONTACT_SHARE * float(np.ptp(depth)), found.deviation):
        return None
    fit = _fit(*_pressed(depth, force), MAX_CONTACT_FORCE_SHARE)
    if fit is None or _grown(depth, force, found.depth) > MAX_DRIFT_FORCE_SHARE:
        return None
    # by what a reading scatters about the better of the two: a shape that does not fit is left with more
    left, variance = _from_start(fit)
    return None if left < fit.left - MIN_CHI2_FALL * min(variance, fit.variance) else found


def _grown(depth: np.ndarray, force: np.ndarray, contact: float) -> float:
    """By how much of its range the force (n,) has grown from the first readings to a contact (mm)."""
    order = np.argsort(depth, kind="stable")
    u, F = depth[order], force[order]
    k = int(np.searchsorted(u, contact))
    before, first = (F[max(k - MIN_AIR_READINGS, 0) : k], F[:MIN_AIR_READINGS])
    return float(np.median(before) - np.median(first)) / float(np.ptp(F)) if k > MIN_READINGS_FOR_CONTACT else 0.0


def zeroed(
    depth: np.ndarray, channels: Mapping[str, np.ndarray], loading: np.ndarray, names: Sequence[str]
) -> tuple[np.ndarray, dict[str, np.ndarray], Onset]:
    """Depth (n,) and channels of one repeat with the columns `names`, depth and forces, 0 at contact; where that was.

    ValueError where loading, where `loading` (n,), does not show an approach.
    """
    if "Fz" not in channels:
        raise ValueError("it is found from Fz, which is missing")
    found = approached(depth[loading], channels["Fz"][loading])
    first = float(depth[loading].min())
    air = loading & (depth < found.depth - min(found.deviation, 0.5 * (found.depth - first)))
    own = dict(channels)
    for name in names:
        if name in own:
            own[name] = own[name] - _level(depth[air], own[name][air], found.depth)
    return depth - found.depth if "depth" in names else depth, own, found


def _level(depth: np.ndarray, force: np.ndarray, contact: float) -> float:
    """The force (N) that readings (n,) of an approach have come to at the contact (mm): by a line where they clearly
    drift, else their median."""
    line = drift_of_approach(depth, force, contact)
    return float(np.median(force)) if line is None else line[0]


def drift_of_approach(depth: np.ndarray, force: np.ndarray, contact: float = 0.0) -> tuple[float, float] | None:
    """Level (N) at the contact (mm) and slope (N/mm) of readings (n,) of an approach; None where they do not drift."""
    n = len(depth)
    if n < MIN_READINGS_FOR_CONTACT or np.ptp(depth) == 0.0:
        return None
    t = depth - contact
    A = np.stack([np.ones(n), t], axis=1)
    (level, slope), *_ = np.linalg.lstsq(A, force, rcond=None)
    rest = force - A @ (level, slope)
    spread = float(np.sum((t - t.mean()) ** 2))
    error = math.sqrt(float(rest @ rest) / (n - 2) / spread / own_share(rest, n))
    drifts = bool(abs(slope) > MIN_DRIFT_STANDARD_ERRORS * error)
    return (float(level), float(slope)) if drifts else None


def _pressed(depth: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means u, F (n,) of readings by depth, with about as much air before the contact as the tip is pressed."""
    order = np.argsort(depth, kind="stable")
    u, F = means(depth[order], force[order])
    low, high = float(np.quantile(F, 0.1)), float(np.median(F[-3:]))
    tenth, half = (u[np.nonzero(low + share * (high - low) > F)[0][-1:]] for share in (0.1, 0.5))
    if len(tenth) and len(half):
        c = float(tenth[0] - (half[0] - tenth[0]))
        order = order[depth[order] >= c - (u[-1] - c)]
    return means(depth[order], force[order])


def means(u: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most MAX_CONTACT_READINGS means of readings u, F (n,) in their order."""
    n = min(len(u), MAX_CONTACT_READINGS)
    block = np.arange(len(u)) * n // len(u)
    count = np.bincount(block)
    return np.bincount(block, weights=u) / count, np.bincount(block, weights=F) / count


def _fit(u: np.ndarray, F: np.ndarray, share: float) -> _Fit | None:
    """The contact by the readings up to a share of the largest force."""
    low, high = float(np.quantile(F, 0.1)), float(np.median(F[-3:]))
    n = int(np.sum(low + share * (high - low) > F))  # a count: a reading out of line moves it by one
    if n < MIN_READINGS_FOR_CONTACT or u[n - 1] <= u[0]:
        return None
    way, least = float(u[n - 1] - u[0]), (LEAST_SCATTER_SHARE * float(np.ptp(F))) ** 2
    t, F = (u[:n] - u[0]) / way, F[:n]
    best, more = (
        _profile(t, F, ROUNDED_EXPONENTS, False, least),
        [(ROUNDED_EXPONENTS, True), ((*ROUNDED_EXPONENTS, STIFFENING_EXPONENT), False)],
    )
    while best is not None and more and n > MIN_READINGS_FOR_CONTACT + 3:
        found = [p for terms in more if (p := _profile(t, F, *terms, least)) is not None]
        better = min(found, key=lambda p: p[1], default=None)
        if better is None or best[1] - better[1] < MIN_CHI2_FALL * better[2]:
            break
        best, more = better, [((*ROUNDED_EXPONENTS, STIFFENING_EXPONENT), True)] * (len(more) > 1)
    if best is None:
        return None
    left, smallest, variance = best
    c = np.linspace(0.0, MAX_CONTACT_WAY_SHARE, N_CONTACT_CANDIDATES)
    weight = np.exp(-0.5 * (left - smallest) / variance)
    mean = float(weight @ c / weight.sum())
    spread = float(weight @ (c - mean) ** 2 / weight.sum()) + (c[1] - c[0]) ** 2 / 12.0
    return _Fit(mean, spread, smallest, variance, way, t, F)


def _profile(
    t: np.ndarray, F: np.ndarray, powers: Sequence[float], drift: bool, least: float
) -> tuple[np.ndarray, float, float] | None:
    """Squares left for each place of contact, the smallest, and the variance of a reading, times what its memory does.

    Of readings that remember their neighbours by ρ, (1 + ρ)/(1 − ρ) count as one: residuals of a shape that does not
    fit do so, too.
    """
    x = np.maximum(t - np.linspace(0.0, MAX_CONTACT_WAY_SHARE, N_CONTACT_CANDIDATES)[:, None], 0.0)
    before = [np.ones_like(t), t] if drift else [np.ones_like(t)]
    a, rest = _shapes(F, [_column(x**p) for p in powers], [_column(np.broadcast_to(b, x.shape)) for b in before])
    good = _pressing(a, len(powers))
    if drift:
        good &= np.abs(a[:, -1]) <= MAX_DRIFT_FORCE_SHARE * np.ptp(F)
    left = np.where(good, (rest * rest).sum(axis=1), np.inf)
    k = int(np.argmin(left))
    if not np.isfinite(left[k]):
        return None
    variance = float(left[k]) / max(len(t) - 1 - a.shape[1], 1)
    if variance <= least:
        return left, float(left[k]), least
    r = float(rest[k][1:] @ rest[k][:-1]) / float(left[k])
    r = min(max(r, 0.0), MAX_NEIGHBOUR_CORRELATION)
    return left, float(left[k]), max(variance * (1.0 + r) / (1.0 - r), least)


def _averaged(u: np.ndarray, F: np.ndarray, share: float) -> tuple[float, float, float, float, float] | None:
    """Contact (mm from the first reading), its variance within and between alternatives, the weight of rounded tips,
    and the pull (N) at contact, by the readings up to a share of the largest force; None where too few show it.

    Mean and variance of c over all alternatives m, of POWER_LAW_FAMILIES beyond contact and of what the force does
    before it, with weights π_m exp(−(χ²(m, c) + k_m ln n)/2).  Of a rounded tip the force may also fall at contact,
    F = b − f H(t − c) + Σ_p a_p (t − c)^p, f ≥ 0: what is attracted is pressed by nearly so much less all the way, f in
    the DMT limit, 1 to 0.8 f in the JKR limit (Maugis, Contact, adhesion and rupture of elastic solids, 2000, §4.2.9).
    The pull is the root mean square of f.
    """
    low, high = float(np.quantile(F, 0.1)), float(np.median(F[-3:]))
    n = int(np.sum(low + share * (high - low) > F))  # a count: a reading out of line moves it by one
    if n < MIN_READINGS_FOR_CONTACT or u[n - 1] <= u[0]:
        return None
    way, c = float(u[n - 1] - u[0]), np.linspace(0.0, MAX_CONTACT_WAY_SHARE, N_CONTACT_CANDIDATES)
    t, F = (u[:n] - u[0]) / way, F[:n]
    every: list[tuple[float, int, np.ndarray, np.ndarray]] = []
    rounded: list[bool] = []
    falls: list[np.ndarray] = []
    x = np.maximum(t - c[:, None], 0.0)
    pressed = {p: _column(x**p) for p in {p for _, family in POWER_LAW_FAMILIES for powers in family for p in powers}}
    for prior, columns, falling in [*((p * (1.0 - PULLED_PRIOR), v, False) for p, v in _before(t)), _fallen(x)]:
        before = [_column(np.broadcast_to(b, x.shape)) for b in columns]
        for share_of, family in POWER_LAW_FAMILIES[: 1 if falling else None]:
            for powers in family:
                k = len(powers) + len(before)
                fit = _squares(F, [pressed[p] for p in powers], before, falling) if n > k + 2 else None
                if fit is not None:
                    every.append((prior * share_of / len(family), k, *fit[:2]))
                    rounded.append(ROUNDED_EXPONENTS in family and not falling)
                    falls.append(fit[2] if falling else np.zeros(len(c)))
    if not every:
        return None
    least = (LEAST_SCATTER_SHARE * float(np.ptp(F))) ** 2
    variances = [max(float(left.min()) / max(n - 1 - k, 1), least) for _, k, left, _ in every]
    at = min(range(len(every)), key=lambda j: n * math.log(variances[j]) + every[j][1] * math.log(n))
    many = n * own_share(every[at][3], n)
    variance = max(variances[at] * n / many, least)
    loss = np.stack([left / variance + k * math.log(max(many, 2.0)) - 2.0 * math.log(p) for p, k, left, _ in every])
    weight = np.exp(-0.5 * (loss - loss.min()))
    weight /= weight.sum()
    each, own = weight.sum(axis=1), weight @ c
    mean, between = float(own.sum()), float(np.sum(own**2 / np.maximum(each, 1e-300)) - own.sum() ** 2)
    within = float(weight.sum(axis=0) @ c**2) - mean**2 - between + (c[1] - c[0]) ** 2 / 12.0
    of_rounded = float(sum(e for e, p in zip(each, rounded, strict=True) if p))
    pull = math.sqrt(float(np.sum(weight * np.stack(falls) ** 2)))
    return way * mean, way**2 * max(within, 0.0), way**2 * max(between, 0.0), of_rounded, pull


def own_share(rest: np.ndarray, n: int) -> float:
    """(1 − ρ)/(1 + ρ) of residuals (n,) that are autocorrelated by ρ: as many of them count as readings.

    ρ of n of them is too small by (1 + 3ρ)/n (M. G. Kendall, Biometrika 41 (1954) 403).
    """
    power = float(rest @ rest)
    r = float(rest[1:] @ rest[:-1]) / power if power > 0.0 else 0.0
    r = min(max(r + (1.0 + 3.0 * r) / n, 0.0), MAX_NEIGHBOUR_CORRELATION)
    return (1.0 - r) / (1.0 + r)


def _before(t: np.ndarray) -> list[tuple[float, list[np.ndarray]]]:
    """What a force may do before contact, with its prior: columns (n,), the last of several bounded."""
    one = np.ones_like(t)
    relaxes = [
        (RELAXING_FORCE_PRIOR / len(RELAXING_WAY_SHARES), [one, np.exp(-t / tau)]) for tau in RELAXING_WAY_SHARES
    ]
    return [(CONSTANT_FORCE_PRIOR, [one]), (DRIFTING_FORCE_PRIOR, [one, t]), *relaxes]


def _fallen(x: np.ndarray) -> tuple[float, list[np.ndarray], bool]:
    """The alternative of a force that falls at contact, x (m, n) how far beyond it: its prior, its columns and that."""
    return PULLED_PRIOR / POWER_LAW_FAMILIES[0][0], [np.ones_like(x), np.where(x > 0.0, 1.0, 0.0)], True


def _squares(
    F: np.ndarray, pressed: Sequence[_Column], before: Sequence[_Column], falling: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Squares left (m,) of F = Σ_p a_p (t − c)^p + what is before, for contacts c (m,), infinite where no body is
    pressed so, what is left (n,) at the best, and the last coefficient (m,), which is no rise where it is `falling`;
    None where that is nowhere."""
    a, rest = _shapes(F, pressed, before)
    good = _pressing(a, len(pressed))
    if falling:
        in_air = np.sum(before[-1][0] == 0.0, axis=1)
        good &= (a[:, -1] <= 0.0) & (in_air >= MIN_AIR_READINGS)
    if len(before) > 1:
        good &= np.abs(a[:, -1]) <= MAX_FORCE_BEFORE_CONTACT_SHARE * np.ptp(F)
    left = np.where(good, np.einsum("mn,mn->m", rest, rest), np.inf)
    k = int(np.argmin(left))
    return (left, rest[k], np.where(good, a[:, -1], 0.0)) if np.isfinite(left[k]) else None


_Column = tuple[np.ndarray, np.ndarray]  # a column for each contact, (m, n), of size 1, and its size (m, 1)


def _column(values: np.ndarray) -> _Column:
    """Values (m, n) over their root sum of squares (m, 1)."""
    size = np.maximum(np.sqrt(np.einsum("mn,mn->m", values, values)), 1e-300)[:, None]
    return values / size, size


def _shapes(F: np.ndarray, pressed: Sequence[_Column], before: Sequence[_Column]) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (m, k) of F = Σ_p a_p (t − c)^p + what is before, by least squares for each contact, and what they
    leave (m, n)."""
    A = np.stack([column for column, _ in (*pressed, *before)], axis=1)
    G = A @ A.transpose(0, 2, 1) + 1e-13 * np.eye(A.shape[1])  # of columns of size 1
    a = np.linalg.solve(G, (A @ F)[..., None])
    rest = F - (a.transpose(0, 2, 1) @ A)[:, 0]
    return a[..., 0] / np.concatenate([size for _, size in (*pressed, *before)], axis=1), rest


def _pressing(a: np.ndarray, powers: int) -> np.ndarray:
    """(m,) whether coefficients (m, k), the first of powers, are those of a body that is pressed."""
    return np.asarray((a[:, 0] > 0.0) & (a[:, :powers].sum(axis=1) > 0.0))


def _left(A: np.ndarray, F: np.ndarray) -> tuple[float, np.ndarray]:
    rest = F - A @ np.linalg.lstsq(A, F, rcond=None)[0]
    return float(rest @ rest), rest
