"""The results dictionary as typed views: what sections and figures share.  Missing keys give empty views."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeGuard

import numpy as np

from rso.core.curves import loading
from rso.core.digits import known, significant
from rso.core.plain_results import RUN_STAGES
from rso.core.symbols import in_units
from rso.report.layout.digits import Unit, channel_text, clean, largest, sentence, shortest, shown, symbol

Results = Mapping[str, Any]
NOISE_ABOUT_ZERO_NRMSE = 2.0  # times its mean by which a curve scatters that is hardly more than noise about zero


@dataclass(frozen=True)
class ParameterView:
    """One parameter: its letter, the unit people use (values stay in base units), range and scale."""

    name: str
    letter: str
    description: str
    base: str
    unit: Unit
    low: float
    high: float
    log: bool
    fixed: float | None

    def show(self, value: float | None, digits: int = 4) -> str:
        """A value with its unit."""
        return f"{significant(value * self.unit.factor, digits)}{self.unit.after}" if known(value) else "–"

    def share(self, low: float, high: float) -> float:
        """How much of the range [low, high] covers, on the scale of the parameter."""
        if not self.high > self.low:
            return 1.0
        log = self.log and min(low, self.low) > 0
        a, b, x, y = (math.log(v) if log else v for v in (self.low, self.high, low, high))
        return max(0.0, min(y, b) - max(x, a)) / (b - a)


@dataclass(frozen=True)
class OutputView:
    """One scalar of the response: a short label and the unit people use for it."""

    id: str
    experiment: str
    label: str
    base: str
    unit: Unit


@dataclass(frozen=True)
class CandidateView:
    """One candidate of one search, with its entry in the results."""

    search: str
    name: str
    order: int
    best: bool
    data: Mapping[str, Any]

    @property
    def label(self) -> str:
        """The name by which the whole report knows it."""
        return self.name if self.name.startswith(self.search) else f"{self.search} {self.name}"

    @property
    def mark(self) -> str:
        """At most two characters for a mark in a figure: the name without the search, or its place in the table."""
        rest = self.name.removeprefix(self.search).strip(" -_#:")
        return rest if 0 < len(rest) <= 2 else str(self.order)

    @property
    def verified(self) -> bool:
        """Recomputed, and predicted = recomputed within the study's tolerance."""
        return self.data.get("verified") is True

    def value(self, parameter: str) -> float | None:
        """Value of a parameter in base units."""
        return number((self.data.get("values") or {}).get(parameter))

    def metrics(self, experiment: str) -> Mapping[str, Any]:
        """Error metrics for an experiment, empty if there are none."""
        return (self.data.get("metrics") or {}).get(experiment) or {}

    def error(self, experiment: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Depths (mm) and estimated numerical error of that curve, empty if there is none."""
        curve = (self.data.get("curves") or {}).get(experiment) or {}
        return points(curve.get("depth"), curve.get("error"))

    def curve(self, experiment: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Depths (mm) and values of the recomputed curve of an experiment, empty if there is none."""
        curve = (self.data.get("curves") or {}).get(experiment) or {}
        return points(curve.get("depth"), curve.get("value"))

    def hold(self, experiment: str) -> Mapping[str, Any]:
        """`since` (s), `value` and `error` of the recomputed hold of an experiment, empty if there is none."""
        return ((self.data.get("curves") or {}).get(experiment) or {}).get("hold") or {}


def on_the_way(row: Mapping[str, Any]) -> dict[str, Any]:
    """The readings of a row of parallel lists that were taken while loading; all of them without a hold."""
    return _readings(row, lambda since: since == 0)


def at_rest(row: Mapping[str, Any]) -> dict[str, Any]:
    """Those of its hold; none without one."""
    return _readings(row, lambda since: since > 0)


def _readings(row: Mapping[str, Any], keep: Callable[[float], bool]) -> dict[str, Any]:
    depth = row.get("depth") or []
    since = row.get("since") or [0.0] * len(depth)
    rows = [k for k, s in enumerate(since) if keep(number(s) or 0.0)]
    return {
        key: [v[k] for k in rows] if isinstance(v, list) and len(v) == len(since) else v
        for key, v in {**row, "since": list(since)}.items()
    }


def drawn_at(x: Sequence[float], f: Sequence[float], at: np.ndarray) -> np.ndarray:
    """A simulated curve (x, f) at depths `at` (n,) between contact and its end: the one that its metrics were taken of.

    A curve is computed at a few travels only; straight lines between them lie above it by more than the noise.  A way
    back that goes above contact is computed at many, with straight lines between them.
    """
    if len(x) and x[0] <= 0.0:
        return np.interp(at, x, f)
    return loading(np.array(x), np.array(f))(at)


def number(x: object) -> float | None:
    """A finite number, or None."""
    return float(x) if known(x) else None


def about_zero(base: Mapping[str, Any]) -> bool:
    """Whether a curve, by the metrics `base` of its mean as a model of it, has no mean to which an error is related.

    Of a force that grows as depth^p from zero the NRMSE of the mean is p/√(2p + 1), 1.1 at p = 3.
    """
    return known(base.get("nrmse")) and base["nrmse"] > NOISE_ABOUT_ZERO_NRMSE


def points(x: Sequence[Any] | None, y: Sequence[Any] | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The pairs of which both numbers are known."""
    pairs = [(float(a), float(b)) for a, b in zip(x or (), y or (), strict=False) if known(a) and known(b)]
    return tuple(a for a, _ in pairs), tuple(b for _, b in pairs)


def pair(x: object) -> TypeGuard[Sequence[float]]:
    """True for two known numbers, the ends of an interval."""
    return isinstance(x, list | tuple) and len(x) == 2 and all(map(known, x))


def listed(results: Results, key: str) -> list[Mapping[str, Any]]:
    """The list under a key, empty where it is missing or null."""
    return list(results.get(key) or ())


def parameters(results: Results, free: bool = False) -> tuple[ParameterView, ...]:
    """Every parameter, or only those that are not fixed."""
    views = []
    for p in listed(results, "parameters"):
        fixed = number(p.get("fixed"))
        low, high = (number(p.get(k)) for k in ("low", "high"))
        unit = shown(p.get("unit", ""), largest([high, fixed]))
        views.append(
            ParameterView(
                clean(p["name"]),
                symbol(p["name"]),
                clean(p.get("description")),
                clean(p.get("unit", "")),
                unit,
                math.nan if low is None else low,
                math.nan if high is None else high,
                bool(p.get("log")),
                fixed,
            )
        )
    return tuple(v for v in views if not (free and v.fixed is not None))


def lettered(results: Results, text: object) -> str:
    """A sentence of the program as people write it: D1 → D₁, 1/MPa → MPa⁻¹, <= → ≤."""
    said = sentence(text)
    for p in parameters(results):
        said = re.sub(rf"(?<![\w.]){re.escape(p.name)}(?!\w)", p.letter, said) if p.letter != p.name else said
    said = in_units(said)
    said = said.replace(" <= ", " ≤ ").replace(" >= ", " ≥ ")
    return re.sub(r"(?<=\w) \* (?=[^\W\d])", " ", said)


def outputs(results: Results) -> dict[str, OutputView]:
    """Every output by its id; the experiment is part of the label only where there are several."""
    every = listed(results, "outputs")
    several = len({o["experiment"] for o in every}) > 1
    views = {}
    for o in every:
        label = f"{channel_text(o['channel'])} {at_reading(o)}"
        sizes = [number((r.get("outputs") or {}).get(o["id"])) for r in listed(results, "runs")]
        sizes += [number(e.get("predicted")) for c in candidates(results) for e in output_rows(c, o["id"])]
        unit = shown(o.get("unit", ""), largest(sizes))
        label = f"{clean(o['experiment'])}: {label}" if several else label
        views[o["id"]] = OutputView(o["id"], clean(o["experiment"]), label, o.get("unit", ""), unit)
    return views


def at_reading(row: Mapping[str, Any]) -> str:
    """Where an output or a target is read: ``at 2 mm``, in a hold ``at 2 mm, 5 s held``."""
    since = row.get("since_s")
    held = f", {shortest(float(f'{since:.2g}'))} s held" if known(since) and since else ""
    return f"at {shortest(row['depth_mm'])} mm{held}"


def drowned(results: Results) -> dict[str, tuple[float, float]]:
    """Outputs that are smaller than their own numerical error in every candidate: largest value and error by id."""
    found: dict[str, list[tuple[float, float]]] = {}
    for c in candidates(results):
        for o in c.data.get("outputs") or ():
            value, error = number(o.get("recomputed")), number(o.get("numerical_error"))
            if value is not None and error is not None:
                found.setdefault(clean(o["output"]), []).append((abs(value), error))
    return {
        i: (max(v for v, _ in rows), max(e for _, e in rows))
        for i, rows in found.items()
        if all(v < e for v, e in rows)
    }


def seen(results: Results, rows: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Those rows that are about an output which is more than its numerical error."""
    lost = drowned(results)
    return [r for r in rows if clean(r.get("output")) not in lost]


def output_rows(candidate: CandidateView, output: str) -> list[Mapping[str, Any]]:
    """The entry of a candidate for one output: a list of one, or empty."""
    return [o for o in candidate.data.get("outputs") or () if o.get("output") == output]


def candidates(results: Results) -> tuple[CandidateView, ...]:
    """Every candidate of every search."""
    best = results.get("best") or {}
    return tuple(
        CandidateView(
            clean(s["name"]),
            clean(c["name"]),
            k,
            best.get("search") == s["name"] and best.get("candidate") == c["name"],
            c,
        )
        for s in listed(results, "searches")
        for k, c in enumerate(s.get("candidates") or (), 1)
    )


def best_candidate(results: Results) -> CandidateView | None:
    """The candidate named as the best, if one is."""
    return next((c for c in candidates(results) if c.best), None)


def fitted_model(results: Results) -> CandidateView | None:
    """What a report draws as the fitted model: the most likely point as it was rerun, else the best candidate.

    With one answer in the headline, text and figures speak of that one.
    """
    again = (results.get("identification") or {}).get("recomputed") or {}
    if not again.get("curves"):
        return best_candidate(results)
    data = {**again, "state": "done"}
    return CandidateView("", "most likely", 0, True, data)


@dataclass(frozen=True, eq=False)
class BandView:
    """What readings (n,) of a curve are expected to be: `value`, and the standard deviation of a reading about it.

    `moved` (n,) is by how much errors of the whole test lie in it, `since` (n,) s the time in a hold.
    """

    depth: np.ndarray
    since: np.ndarray
    value: np.ndarray
    moved: np.ndarray
    sd: np.ndarray
    data: Mapping[str, Any]

    @property
    def loading(self) -> BandView:
        """The readings while loading."""
        return self._rows(self.since == 0.0)

    @property
    def hold(self) -> BandView:
        """Those of the hold."""
        return self._rows(self.since > 0.0)

    def _rows(self, keep: np.ndarray) -> BandView:
        u, t, y, moved, sd = (v[keep] for v in (self.depth, self.since, self.value, self.moved, self.sd))
        return BandView(u, t, y, moved, sd, self.data)

    def over(self, x: np.ndarray, f: np.ndarray) -> np.ndarray:
        """The simulated curve (x, f) moved as the fit has moved it; nothing moves it at contact."""
        u, moved = np.append(0.0, self.depth), np.append(0.0, self.moved)
        return f + np.interp(x, u, moved)


def fitted_band(results: Results, e: Mapping[str, Any]) -> BandView | None:
    """What was fitted to a compared curve; None where results do not hold it, or where a candidate is drawn."""
    model = fitted_model(results)
    if model is None or model.search:
        return None
    rows = listed(results.get("identification") or {}, "data")
    mine = (e.get("experiment", e["name"]), e.get("channel"))
    found = next((r.get("fitted") for r in rows if (r.get("experiment"), r.get("channel")) == mine), None)
    return None if found is None else _band(found, "value", "moved", "reading_sd")


def predicted_band(e: Mapping[str, Any], v: Mapping[str, Any] | None) -> BandView | None:
    """What the most likely values predict of a curve that was not fitted, from its entry `v` in `predictions`."""
    mine = next((c for c in (v or {}).get("channels") or () if c.get("channel") == e.get("channel")), None)
    if mine is None:
        return None
    parts = [[number(x) or 0.0 for x in mine.get(k) or ()] for k in ("sigma", "spread", "numerical_error")]
    n = len(mine.get("depth") or ())
    if any(len(p) != n for p in parts):
        return None
    sd = np.sqrt(np.sum(np.square(parts), axis=0))
    return _band({**mine, "sd": sd.tolist(), "moved": [0.0] * n}, "predicted", "moved", "sd")


def _band(row: Mapping[str, Any], value: str, moved: str, sd: str) -> BandView | None:
    u, y, m, s = ([number(v) for v in row.get(k) or ()] for k in ("depth", value, moved, sd))
    since = [number(v) or 0.0 for v in row.get("since") or [0.0] * len(u)]
    whole = [r for r in zip(u, since, y, m, s, strict=False) if None not in r]
    if len(whole) < 2:
        return None
    ordered = sorted(whole, key=lambda r: (r[1] or 0.0, r[0] or 0.0))
    columns = np.array(ordered, float).T
    return BandView(columns[0], columns[1], columns[2], columns[3], columns[4], row)


def compared_models(results: Results) -> tuple[CandidateView, ...]:
    """Every candidate and the fitted model, which alone counts as the best."""
    fitted = fitted_model(results)
    if fitted is None or fitted.search:
        return candidates(results)
    return (fitted, *(replace(c, best=False) for c in candidates(results)))


def lead_search(results: Results) -> str:
    """The search whose candidates are numbered in the figures: that of the best candidate, else the first."""
    every = candidates(results)
    return next((c.search for c in every if c.best), every[0].search if every else "")


def front(search: Mapping[str, Any]) -> tuple[list[Mapping[str, Any]], np.ndarray]:
    """Values and objectives (n, m) of the points of a front that are wholly known."""
    data = search.get("front") or {}
    pairs = zip(data.get("values") or (), data.get("objectives") or (), strict=False)
    whole = [(v, o) for v, o in pairs if o and all(map(known, o)) and all(map(known, v.values()))]
    return [v for v, _ in whole], np.array([o for _, o in whole], float)


def grids(results: Results) -> list[Mapping[str, Any]]:
    """Surfaces whose axes are known and of which at least one value is."""

    def whole(axis: Mapping[str, Any] | None) -> bool:
        values = (axis or {}).get("values") or ()
        return all(map(known, values))

    found = []
    for s in seen(results, listed(results, "surfaces")):
        some = any(known(v) for row in s.get("mean") or () for v in (row if isinstance(row, list) else [row]))
        if some and (s.get("x") or {}).get("values") and whole(s["x"]) and whole(s.get("y")):
            found.append(s)
    return found


def experiments(results: Results, *roles: str) -> tuple[Mapping[str, Any], ...]:
    """Compared curves of the experiments of these roles, those of one experiment after another."""
    return tuple(v for e in listed(results, "experiments") if e.get("role") in roles for v in views(e))


def views(e: Mapping[str, Any]) -> tuple[Mapping[str, Any], ...]:
    """Every compared channel of an experiment as an entry of its own: the first has its name, the others theirs too."""
    rest = [{**e, **o, "name": f"{e['name']} {o['channel']}", "experiment": e["name"]} for o in e.get("others") or ()]
    return ({**e, "experiment": e["name"]}, *rest)


def validations(results: Results, e: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Rows of the validation with one compared curve."""
    mine = [v for v in listed(results, "validation") if v.get("experiment") == e.get("experiment", e["name"])]
    return [v for v in mine if v.get("channel", e.get("channel")) == e.get("channel")]


def fitted_curves(results: Results) -> tuple[Mapping[str, Any], ...]:
    """Force curves that the search knows; profiles of these roles are only kept."""
    return tuple(e for e in experiments(results, "fit", "select") if e.get("kind") not in ("profile", "surface"))


def experiment(results: Results, name: str) -> Mapping[str, Any]:
    """The entry of an experiment or of a compared curve by its name, empty if it is unknown."""
    return next((v for e in listed(results, "experiments") for v in views(e) if v.get("name") == name), {})


def curve_unit(results: Results, name: str) -> Unit:
    """The unit people use for the measured channel of an experiment."""
    e = experiment(results, name)
    return shown(e.get("unit", ""), largest((e.get("measured") or {}).get("value") or ()))


def target_output(target: Mapping[str, Any]) -> str:
    """Id of the output that a target asks for."""
    depth = f"{target['depth_mm']:.6g}" if known(target["depth_mm"]) else "–"
    since = target.get("since_s")
    held = f"+{since:.6g}s" if known(since) and since else ""
    return f"{target['experiment']}:{target['channel']}@{depth}{held}"


def finished(results: Results, stage: str) -> bool:
    """Whether the study has come as far as this stage."""
    last = results.get("stage")
    return last in RUN_STAGES and RUN_STAGES.index(last) >= RUN_STAGES.index(stage)
