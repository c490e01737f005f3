"""What readings scatter by, from repeats and statements, and what a model may be wrong by: never from the misfit.

    C = white + correlated noise of readings + gain and contact of each test + numerical and code error of the model

A gap is what C does not explain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rso.contract import DistortionDepth, capability
from rso.contract.responses import FORCE_CHANNELS
from rso.core.correlation import exponential, gaussian_correlation
from rso.core.distributions import chi2_cdf, chi2_ppf
from rso.data import Measurement, Repeat
from rso.discrepancy.detectors.autocorrelation import autocorrelation_length
from rso.discrepancy.detectors.sensor import count_of, hidden_noise, of_bins
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS, ModelError, UsualNoise
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import LOADING_BRANCH, UNLOADING_BRANCH, SurfaceProfile, Test, TestPlan
from rso.inference.error_model import correlated_along

# times what is expected: of 3 repeats with that one set in 500 differs by more, of 5 one in 20 000
MAX_STATED_NOISE_RATIO = 2.5
TOO_FEW_THIRD_DIFFERENCES = 8  # third differences that tell no noise
# third differences of white noise for each that is independent, 1 + 2 (0.75² + 0.3² + 0.05²)
THIRD_DIFFERENCE_OVERLAP = 2.31
LARGER_NOISE_CHANCE = 0.1  # chance that the noise is larger than taken from the readings
OTHER_SENSOR_NOISE_RATIO = 1.5  # times the usual noise: that of another sensor or range
SAME_HISTORY_MM = 0.3  # mm, of such a plan: tests at a place with no other history than this are repeats


@dataclass(frozen=True)
class NoiseLevel:
    """Noise of a channel: `white` per reading, `correlated` of a bin along `length` mm, `gain`, `contact` of a test.

    `loud` holds the experiments (by index) whose readings have another noise, and how many times this one; `expected`
    are gain and contact as stated or usual, before repeats were looked at, `shown` those that repeats show.
    """

    white: float
    correlated: float
    length: float
    gain: float
    contact: float
    depth: float
    source: str
    loud: Mapping[int, float] = field(default_factory=dict)
    expected: tuple[float, float] = (0.0, 0.0)
    shown: tuple[float, float] = (0.0, 0.0)

    def of(self, experiment: int) -> NoiseLevel:
        """That of the readings of one experiment."""
        k = self.loud.get(experiment, 1.0)
        return replace(self, white=k * self.white, correlated=k * self.correlated)


def noise_levels(
    plan: TestPlan, binding: bool = False, usual: UsualNoise = DIAGNOSIS_SETTINGS.noise
) -> dict[str, NoiseLevel]:
    """Noise by channel of all tests together; 'uz' is that of profiles.

    Where what is stated is `binding`, gain and contact by which repeats differ far more are not noise.
    """
    out = {}
    remembered = autocorrelation_length(plan)
    for c in FORCE_CHANNELS:
        tests = [t for t in plan.tests if c in t.channels]
        if not tests:
            continue
        numbers = list(dict.fromkeys(t.experiment for t in tests))
        seen = [plan.experiments[k] for k in numbers]
        correlation = max(e.noise.stated.correlation for e in seen)
        length = correlation or remembered or 0.0
        w, k = _bins(tests)
        ρ = math.exp(-w / (k * length)) if remembered and not correlation else 0.0
        own = [np.concatenate([_third(r, c) for r in e.measurement.repeats]) for e in seen]
        each, estimated, ν = _estimated(own, 20.0 - 30.0 * ρ + 12.0 * ρ**2 - 2.0 * ρ**3)
        if not estimated:
            estimated, ν = _spread(tests, c, plan.scale)
            each = [estimated] * len(seen)
        said = [max(e.noise.of(c), _written(e.measurement, c)) for e in seen]
        stated = max(said)
        if estimated and not stated:  # a few readings that happen to agree are no quiet sensor
            upwards = math.sqrt(ν / chi2_ppf(LARGER_NOISE_CHANCE, ν))
            estimated, each = upwards * estimated, [upwards * v for v in each]
        largest = max(float(np.max(np.abs(t.values[v]))) for t in tests for v in t.channels)
        least = 1e-4 * largest if stated or estimated else usual.reading * largest
        least = max(least, count_of(seen, c) / math.sqrt(12.0))
        # what is said to be correlated is not white
        white = max(0.0 if correlation else stated, estimated, least)
        whites = [max(0.0 if correlation else v or stated, u, least) for v, u in zip(said, each, strict=True)]
        loud = {n: v / white for n, v in zip(numbers, whites, strict=True) if v != white}
        source = "stated" if stated >= estimated else "from the readings"
        source = source if stated or estimated else "assumed"
        if length:  # readings that remember each other hold less than their number
            share, reach = of_bins(length, w, k)
            correlated, white = share * (stated if correlation else white), white if correlation else 0.3 * white
        else:
            correlated, reach = hidden_noise(seen, c, white)
        depth = max(e.noise.depth for e in seen)
        gain = max(e.noise.stated.gain for e in seen)
        off = max(e.noise.stated.contact for e in seen)
        contact = max(plan.scale * usual.contact, 2 * depth, off)
        known = NoiseLevel(white, correlated, reach, gain, contact, depth, source, loud, (gain or usual.gain, contact))
        *shown, extra, its_reach = _repeats(plan, c, known)
        if extra > correlated:
            known = replace(known, correlated=extra, length=max(its_reach, reach))
        gain, contact = (
            e if binding and said and v > MAX_STATED_NOISE_RATIO * e else v
            for v, e, said in zip(shown, known.expected, (gain, depth or off), strict=True)
        )
        out[c] = replace(
            known,
            gain=max(known.gain, gain) or usual.gain,
            contact=max(known.contact, contact),
            shown=(shown[0], shown[1]),
        )
    if plan.profiles:
        stated = max(plan.experiments[p.experiment].noise.uz for p in plan.profiles)
        out["uz"] = NoiseLevel(
            stated or plan.scale * usual.mark, 0.0, 0.0, 0.0, 0.0, 0.0, "stated" if stated else "assumed"
        )
    return out


def _estimated(own: Sequence[np.ndarray], of_one: float) -> tuple[list[float], float, float]:
    """Noise of a reading in each experiment, and usually, from third differences of `of_one` times its variance.

    The last number is that of independent ones.  Experiments share their noise but for those whose own is clearly
    another (by half and more, one in a thousand, and in the middle of its readings too, which a few jumps do not
    change); 0 where too few readings show.
    """
    if sum(map(len, own)) <= TOO_FEW_THIRD_DIFFERENCES:
        return [0.0] * len(own), 0.0, 0.0
    power = np.array([float(np.sum(v**2)) / of_one for v in own])
    number = np.array([len(v) for v in own], float)
    tells = number > TOO_FEW_THIRD_DIFFERENCES
    typical = float(np.median(np.repeat(power / np.maximum(number, 1.0), number.astype(int))))
    ν = np.maximum(number / THIRD_DIFFERENCE_OVERLAP, 1.0)
    ratio = np.maximum(power / np.maximum(number * typical, 1e-300), 1e-12)
    rare = np.abs(chi2_cdf(ν * ratio, ν) - 0.5) > 0.4995
    middle = np.array([np.median(v**2) if len(v) else 0.0 for v in own]) / (chi2_ppf(0.5, 1) * of_one)
    least = np.minimum(np.abs(np.log(ratio)), np.abs(np.log(np.maximum(middle / max(typical, 1e-300), 1e-12))))
    apart = tells & rare & ((ratio > 1.0) == (middle > typical)) & (least > 2.0 * math.log(OTHER_SENSOR_NOISE_RATIO))
    usual = math.sqrt(typical if apart.all() else power[~apart].sum() / number[~apart].sum())
    each = [math.sqrt(v / n) if lone else usual for v, n, lone in zip(power, number, apart, strict=True)]
    return each, usual, float(number.sum()) / THIRD_DIFFERENCE_OVERLAP


def _spread(tests: Sequence[Test], channel: str, scale: float) -> tuple[float, float]:
    """Noise of a reading from what repeats of one experiment differ by, gain and contact included, and how many
    independent differences that is from; 0 without any."""
    power = count = 0.0
    for mine in _alike(tests, scale):
        u, Y, number = _common(mine, channel)
        if len(mine) > 1 and len(u):
            power += float(np.sum(number * (Y - Y.mean(axis=0)) ** 2))
            count += (len(mine) - 1) * len(u)
    return (math.sqrt(power / count) if count else 0.0), count


def _alike(tests: Sequence[Test], scale: float) -> list[list[Test]]:
    """Tests by experiment and history: a first test is not a repeat of what it softened."""
    groups: dict[tuple[int, int], list[Test]] = {}
    for t in tests:
        groups.setdefault((t.experiment, round(t.earlier / (scale * SAME_HISTORY_MM))), []).append(t)
    return list(groups.values())


def _common(mine: Sequence[Test], channel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths (n,) of the first test's loading that all tests reach, values (k, n) there, readings (n,) behind each."""
    there = [t.branch == LOADING_BRANCH for t in mine]
    own = [t.depth[k] for t, k in zip(mine, there, strict=True)]
    if min(map(len, own)) == 0:
        return np.zeros(0), np.zeros((len(mine), 0)), np.zeros(0)
    slack = 0.02 * (own[0][-1] - own[0][0]) / max(len(own[0]) - 1, 1)  # bins of repeats are not quite the same
    inside = (own[0] >= max(d[0] for d in own) - slack) & (own[0] <= min(d[-1] for d in own) + slack)
    u = own[0][inside]
    Y = np.array([np.interp(u, d, t.values[channel][k]) for t, d, k in zip(mine, own, there, strict=True)])
    return u, Y, mine[0].count[there[0]][inside]


def _written(measurement: Measurement, channel: str) -> float:
    """Root mean square of the standard uncertainties that a file itself states, 0 where it has no such column."""
    found = [r.sigma[channel] for r in measurement.repeats if channel in r.sigma]
    return float(np.sqrt(np.mean(np.concatenate(found) ** 2))) if found else 0.0


def _third(repeat: Repeat, channel: str) -> np.ndarray:
    """Third differences of the readings along each branch."""
    found = []
    for name in ("loading", "unloading"):
        v = repeat.channels[channel][repeat.segment == name] if channel in repeat.channels else np.empty(0)
        if len(v) > 4:
            found.append(np.diff(v, 3))
    return np.concatenate(found) if found else np.empty(0)


def _repeats(plan: TestPlan, channel: str, known: NoiseLevel) -> tuple[float, float, float, float]:
    """(gain, contact mm, correlated noise, its length mm) from what repeats of one experiment differ by.

    Zero where no experiment has three repeats of equal history, and where they differ no more than `known` noise, gain
    and contact make them in 19 of 20 cases.  Gain and contact are what deviations from the mean have along the mean and
    along its slope, less what noise puts there; of two repeats all experiments count together.
    """
    gains, contacts, extras, lengths, of_two = [], [], [], [], []
    for mine in _alike([t for t in plan.tests if channel in t.channels], plan.scale):
        if len(mine) < 2:
            continue
        u, Y, number = _common(mine, channel)
        if len(u) < 4:
            continue
        own = known.of(mine[0].experiment)
        mean = Y.mean(0)
        D, dof, M = Y - mean, len(mine) - 1, np.eye(len(u))
        slope = np.gradient(mean, u) if channel == "Fz" else np.zeros(len(u))
        W = np.diag((own.white**2 + (own.depth * slope) ** 2) / number)
        N = W + _along(own, u)
        if channel == "Fz" and np.ptp(mean) > 10 * own.white:
            B = np.stack([mean, slope], 1)
            P = np.linalg.pinv(B)
            M = M - B @ P
            found, of_noise = np.sum((D @ P.T) ** 2, axis=0) / dof, np.diag(P @ N @ P.T)
            if dof == 1:
                of_two.append((found, of_noise))
                continue
            v = _beyond(known, found, of_noise, dof)
            gains.append(np.sqrt(v[0]))
            contacts.append(np.sqrt(v[1]))
        if dof == 1:
            continue
        rest, left = D @ M.T, np.trace(M)
        variance = np.sum(rest**2) / (dof * left)
        white = np.trace(M @ W) / left
        if variance > 1.6 * np.trace(M @ N) / left:
            extras.append(np.sqrt(variance - white))
            ρ = np.sum(rest[:, 1:] * rest[:, :-1]) / np.sum(rest**2) * variance / (variance - white)
            lengths.append(-np.mean(np.diff(u)) / np.log(np.clip(ρ, 0.05, 0.95)))
    if len(of_two) > 1:
        both, by_noise = np.mean(of_two, axis=0)
        v = _beyond(known, both, by_noise, len(of_two))
        gains.append(np.sqrt(v[0]))
        contacts.append(np.sqrt(v[1]))
    best = lambda v: float(np.max(v)) if v else 0.0  # noqa: E731
    return best(gains), best(contacts), best(extras), best(lengths)


def _beyond(known: NoiseLevel, found: np.ndarray, of_noise: np.ndarray, dof: int) -> np.ndarray:
    """Variances (2,) of gain and contact of which `found` is more than noise and what is `known` make of it."""
    usual = (np.array([known.gain, known.contact]) ** 2 + of_noise) * chi2_ppf(0.95, dof) / dof
    return np.where(found > usual, found - of_noise, 0.0)


def _along(level: NoiseLevel, at: np.ndarray) -> np.ndarray:
    """Covariance (n, n) of the correlated noise of bins at travels `at` (n,)."""
    return level.correlated**2 * exponential(at, max(level.length, 1e-9))


def _bins(tests: Sequence[Test]) -> tuple[float, float]:
    """Width of a bin (mm) and readings in it, along loading."""
    there = [(t, t.branch == LOADING_BRANCH) for t in tests]
    widths = np.concatenate([np.diff(t.depth[b]) for t, b in there])
    counts = np.concatenate([t.count[b] for t, b in there])
    return (float(np.median(widths)), float(np.median(counts))) if len(widths) else (1.0, 1.0)


def data_covariance(
    library: Library,
    level: Mapping[str, NoiseLevel],
    force: np.ndarray,
    slope: np.ndarray,
    error: ModelError = DIAGNOSIS_SETTINGS.model_error,
) -> np.ndarray:
    """C (n, n) of the data vector for a prediction `force` (n,) N (or mm) and its slope (n,) N/mm."""
    return scatter(library.plan, level, force, slope) + _of_model(library, force, error)


def scatter(plan: TestPlan, level: Mapping[str, NoiseLevel], force: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """What tests and readings scatter by (n, n): readings, gain and contact of each test, the contact of all."""
    C = of_tests(plan, level, force, slope)
    for item, c, at in plan.rows():
        if isinstance(item, SurfaceProfile):
            C[at, at] += np.diag(np.full(at.stop - at.start, level["uz"].white ** 2))
            continue
        q = level[c].of(item.experiment)
        C[at, at] += np.diag(_white(q, item, slope[at]))
        if q.correlated:
            on = np.where(item.held, item.speed * item.since, item.depth)  # readings remember each other along time
            C[at, at] += _along(q, on) * (item.branch[:, None] == item.branch)
    return C


def of_tests(plan: TestPlan, level: Mapping[str, NoiseLevel], force: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """What whole tests are off by (n, n): gain and contact of each, the contact of all."""
    C, placed, rows = np.zeros((plan.n, plan.n)), np.zeros(plan.n), plan.rows()
    for item in plan.tests:
        at = _rows_of(rows, item)
        q = level[item.channels[-1]]
        C[at, at] += q.gain**2 * np.outer(force[at], force[at]) + q.contact**2 * np.outer(slope[at], slope[at])
        placed[at] = 1.0
    contact = max((level[t.channels[-1]].contact for t in plan.tests), default=0.0)
    common = contact * placed * slope  # what all tests take for contact
    return C + np.outer(common, common)


def _of_model(library: Library, force: np.ndarray, error: ModelError) -> np.ndarray:
    """What the model may be wrong by (n, n): its stated numerical error, and another code."""
    plan = library.plan
    n = plan.n
    code, grain = np.zeros(n), np.zeros(n)
    u, place, channel = np.zeros(n), np.full(n, -1), np.zeros(n, int)
    for item, c, at in plan.rows():
        if isinstance(item, SurfaceProfile):
            code[at] = 0.01 * np.max(np.abs(force[at]))
            u[at], place[at], channel[at] = item.depth, 100 + item.place, 9 + item.mark
            continue
        u[at], place[at], channel[at] = item.depth, item.place, FORCE_CHANNELS.index(c)
        z = slice(at.start - item.n * item.channels.index(c), None)
        Fz = force[z.start + item.n * item.channels.index("Fz") :][: item.n] if "Fz" in item.channels else force[at]
        stated = _stated(library, item, c)
        size = np.hypot(np.abs(force[at]), (c != "Fz") * error.lateral * np.abs(Fz))
        code[at], grain[at] = np.hypot(error.code, stated) * size, error.grain * size
    same = (place[:, None] == place) & (channel[:, None] == channel)
    deepest = max(p.deepest for p in plan.places)
    along, near = (gaussian_correlation(u, v * deepest) for v in (error.length, error.grain_length))
    meshes = capability(library.base.backend, DistortionDepth)
    distorted = max([deepest, *(meshes.deep(dict(p.settings)) for p in plan.places if meshes)])
    growing = error.deep * (u / distorted) ** error.steep * np.where(place < 100, force, 0.0)
    K = same * (np.outer(code, code) * along + np.outer(grain, grain) * near)
    return K + np.outer(growing, growing) * (channel[:, None] == channel)


def other_code(plan: TestPlan, force: np.ndarray, error: ModelError = DIAGNOSIS_SETTINGS.model_error) -> np.ndarray:
    """What a model may be off by in all tests alike (n, n), as another program is, from its prediction (n,)."""
    u, channel, size = np.zeros(plan.n), np.full(plan.n, -1), np.zeros(plan.n)
    for item, c, at in plan.rows():
        if not isinstance(item, SurfaceProfile):
            u[at], channel[at], size[at] = item.depth, FORCE_CHANNELS.index(c), error.common * force[at]
    deepest = max(p.deepest for p in plan.places)
    return correlated_along(u, size, error.common_length * deepest, gaussian_correlation) * (
        channel[:, None] == channel
    )


def reading_variance(plan: TestPlan, level: Mapping[str, NoiseLevel], slope: np.ndarray) -> np.ndarray:
    """Variance (n,) of each reading by itself, without what a test or a model may be off by as a whole."""
    out = np.zeros(plan.n)
    for item, c, at in plan.rows():
        q = level["uz" if isinstance(item, SurfaceProfile) else c].of(item.experiment)
        out[at] = q.white**2 if isinstance(item, SurfaceProfile) else _white(q, item, slope[at]) + q.correlated**2
    return out


def _white(level: NoiseLevel, test: Test, slope: np.ndarray) -> np.ndarray:
    return (level.white**2 + (level.depth * slope) ** 2) / test.count


def _stated(library: Library, test: Test, channel: str) -> np.ndarray:
    """Stated relative numerical error (n,) of a channel at the depths of a test, over Fz."""
    here = library.places[test.place]
    return np.interp(test.depth, here.u, here.error[FORCE_CHANNELS.index(channel)])


def _rows_of(rows: list[tuple[Test | SurfaceProfile, str, slice]], test: Test) -> slice:
    mine = [at for item, _, at in rows if item is test]
    return slice(mine[0].start, mine[-1].stop)


def gap_covariance(
    library: Library,
    force: np.ndarray,
    amplitude: float,
    length: float,
    lateral: float = DIAGNOSIS_SETTINGS.model_error.lateral,
) -> np.ndarray:
    """K (n, n) of a gap of relative `amplitude` that changes over `length`, a share of the deepest travel: shared by a
    place, by a branch and by a test in equal parts."""
    plan, n = library.plan, library.plan.n
    size, u, rest = np.zeros(n), np.zeros(n), np.zeros(n)
    place, channel, branch, test, speed = (np.full(n, -1) for _ in range(5))
    for k, (item, c, at) in enumerate(plan.rows()):
        if isinstance(item, SurfaceProfile):
            size[at] = 0.5 * np.max(np.abs(force[at]))
            u[at], place[at], channel[at], branch[at], test[at], speed[at] = item.depth, 100, 9 + item.mark, 0, k, 0
            continue
        z = at.start - item.n * item.channels.index(c)
        Fz = force[z + item.n * item.channels.index("Fz") :][: item.n] if "Fz" in item.channels else force[at]
        size[at] = np.maximum(np.hypot(np.abs(force[at]), (c != "Fz") * lateral * np.abs(Fz)), 0.02 * np.abs(Fz).max())
        u[at], place[at], channel[at], branch[at] = item.depth, item.place, FORCE_CHANNELS.index(c), item.branch
        rest[at] = np.log1p(item.since * item.speed / max(item.peak, 1e-9))  # in the time that loading took
        test[at] = [id(t) for t in plan.tests].index(id(item))
        speed[at] = round(1e3 * np.log(item.speed))
    same = lambda v: v[:, None] == v  # noqa: E731
    deepest = max(p.deepest for p in plan.places)
    along = gaussian_correlation(u, length * deepest) * gaussian_correlation(rest, 1.0)
    shared = same(channel) & same(place)
    mix = (shared + (shared & same(branch) & same(speed)) + (shared & same(test) & same(branch))) / 3.0
    return amplitude**2 * np.outer(size, size) * mix * along


def slope_of(library: Library, force: np.ndarray) -> np.ndarray:
    """dF/du (n,) of a prediction along each branch of each test, during a hold that of the end of loading; 0 for
    profiles."""
    slope = np.zeros(len(force))
    for item, _, at in library.plan.rows():
        if isinstance(item, SurfaceProfile):
            continue
        for k in (LOADING_BRANCH, UNLOADING_BRANCH):
            mine = np.nonzero(item.branch == k)[0]
            if len(mine) > 2:
                d = item.depth[mine]
                order = np.argsort(d)
                f = force[at][mine][order]
                g = np.gradient(f, np.maximum.accumulate(d[order] + 1e-6 * library.plan.scale * np.arange(len(d))))
                slope[np.arange(at.start, at.stop)[mine[order]]] = g
                if k == LOADING_BRANCH:
                    slope[np.arange(at.start, at.stop)[item.held]] = g[-1]
    return slope
