"""Whether tests that took no part in the fit are predicted: yes or no, by how much, against which uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rso.core.digits import NBSP, known
from rso.report.calibration.displacements import is_profile, profile_words
from rso.report.calibration.predictive_check import prediction_note, prediction_of, prediction_sentence
from rso.report.layout.digits import clean, percent, quantity, shortest
from rso.report.layout.document import Fact, Mark
from rso.report.reading import Results, best_candidate, candidates, experiments, finished, number, validations

PREDICTED_WITHIN_SD = 2.0  # standard deviations of measurement and computation together
MIN_PREDICTED_SHARE = 0.9  # of the readings: one curve's errors mostly go up and down together
# of the force: a target counts as met within that, so that no candidate can do better elsewhere
MET_TARGET_TOLERANCE = 1e-3
Answer = Literal["yes", "no", "among", ""]
_PREDICTION_TILES = {"yes": "predicted", "no": "not predicted", "among": "within what is open"}
_ANSWER_WORDS = {"yes": "Yes", "no": "No", "among": "Yes, within what the fit leaves open"}


@dataclass(frozen=True, eq=False)
class Prediction:
    """One candidate's prediction of one test: arrays (n,); the numerical error is `None` where nobody has stated it."""

    label: str
    best: bool
    depth: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    sigma: np.ndarray
    numerical: np.ndarray | None

    @property
    def total(self) -> np.ndarray:
        """Standard deviation of measurement and computation together."""
        return np.hypot(self.sigma, 0.0 if self.numerical is None else self.numerical)

    @property
    def near(self) -> np.ndarray:
        """What it may be off by at each reading."""
        return PREDICTED_WITHIN_SD * np.hypot(self.total, MET_TARGET_TOLERANCE * np.abs(self.predicted))

    @property
    def within(self) -> int:
        """Readings that it meets."""
        return int(np.sum(np.abs(self.measured - self.predicted) <= self.near))

    @property
    def met(self) -> bool | None:
        """Whether it meets enough of them; None where no uncertainty is known."""
        return None if not self.total.any() else self.within >= MIN_PREDICTED_SHARE * len(self.depth)


def predictions(results: Results, e: Mapping[str, Any]) -> list[Prediction]:
    """Of a compared curve that was not used, by every candidate that is verified and has an answer; the best first."""
    found = []
    for c in candidates(results):
        for v in validations(results, e):
            mine = (clean(v.get("search")), clean(v.get("candidate"))) == (c.search, c.name)
            if mine and c.verified and v.get("state") == "done" and (p := _prediction(v, c.label, c.best)):
                found.append(p)
    return sorted(found, key=lambda p: not p.best)


def _prediction(v: Mapping[str, Any], label: str, best: bool) -> Prediction | None:
    errors = list(v.get("numerical_error") or ())
    each = [v.get(k) or () for k in ("depth", "measured", "predicted")]
    rows = [(k, *r) for k, r in enumerate(zip(*each, strict=False)) if all(map(known, r))]
    if not rows:
        return None
    at = [k for k, *_ in rows]
    sigma = list(v.get("sigma") or ())
    depth, measured, predicted = (np.array([r[k] for r in rows], float) for k in (1, 2, 3))
    return Prediction(label, best, depth, measured, predicted, _at(sigma, at), _at(errors, at) if errors else None)


def _at(values: Sequence[Any], at: Sequence[int]) -> np.ndarray:
    return np.array([number(values[k]) or 0.0 if k < len(values) else 0.0 for k in at])


def answer(found: Sequence[Prediction]) -> Answer:
    """Whether a test is predicted by the candidates, all of which hit the targets.

    They are far apart where the targets leave a direction open: a measurement among their predictions is predicted as
    far as the fit can show, and one that only some of them meet separates them.
    """
    met = [p.met for p in found]
    if not met or None in met:
        return ""
    if all(met) or len({len(p.depth) for p in found}) > 1:
        return "yes" if all(met) else "no"
    low, high = np.min([p.predicted - p.near for p in found], 0), np.max([p.predicted + p.near for p in found], 0)
    measured = found[0].measured
    return "among" if np.mean((low <= measured) & (measured <= high)) >= MIN_PREDICTED_SHARE else "no"


def prediction_sentences(results: Results) -> list[str]:
    """One per test: yes or no, and by how much."""
    said = []
    for e in experiments(results, "validate"):
        if e["name"] != e["experiment"] and prediction_of(results, e) is not None:
            continue  # one test of all its channels, said with the first
        best, found = best_candidate(results), predictions(results, e)
        mine = [
            v
            for v in validations(results, e)
            if best and (v.get("search"), v.get("candidate")) == (best.search, best.name)
        ]
        if (v := prediction_of(results, e)) is not None:
            said.append(prediction_sentence(e, v))
        elif found:
            said.append(_sentence(e, found, mine))
        elif mine and mine[0].get("state") != "done":
            why = f"{clean(mine[0].get('cause'))}: {clean(mine[0].get('reason'))}"
            said.append(f"Whether {clean(e['name'])} is predicted is open: the run {clean(mine[0]['state'])} ({why}).")
        elif finished(results, "validate"):
            said.append(f"Whether {clean(e['name'])} is predicted is open: no verified candidate has an answer.")
    return said


def _sentence(e: Mapping[str, Any], found: Sequence[Prediction], mine: Sequence[Mapping[str, Any]]) -> str:
    name, unit, first = clean(e["name"]), e.get("unit", ""), found[0]
    verdict = answer(found)
    some = sum(bool(p.met) for p in found)
    not_ = {
        "yes": "is predicted",
        "no": "is not predicted",
        "among": f"lies among the predictions of {len(found)} candidates, {some or 'none'} of which meet"
        f"{'s' if some == 1 else ''} it",
    }
    head = f"{_ANSWER_WORDS[verdict]}: " if verdict else ""
    text = f"{head}{name}, which was not used for the fit, {not_.get(verdict, 'is compared with no known uncertainty')}"
    if is_profile(e):
        text += profile_words(mine[0]) if mine else ""
    elif len(first.depth) == 1:
        whose = first.label if not first.best else "the best candidate"
        text += f": at {shortest(float(first.depth[0]))} mm {quantity(float(first.measured[0]), unit)} was measured"
        text += f" and {whose} has {quantity(float(first.predicted[0]), unit)}"
    text += f"; {off(found)}" if not is_profile(e) else ""
    return f"{text}. {_against(found)}".strip()


def off(found: Sequence[Prediction]) -> str:
    """'8 to 13 % too low over all 4 candidates', at the last depth."""
    gaps = [(p.predicted[-1] - p.measured[-1]) / abs(p.measured[-1]) for p in found if p.measured[-1]]
    if not gaps:
        return "nothing was measured to compare it with"
    low, high = float(min(gaps)), float(max(gaps))
    whom = "" if len(found) == 1 else f" over all {len(found)} candidates"
    where = "" if len(found[0].depth) == 1 else f" at {shortest(float(found[0].depth[-1]))} mm"
    if low * high < 0:
        return f"{percent(-low)} too low to {percent(high)} too high{where}{whom}"
    near, far = sorted((abs(low), abs(high)))
    first = percent(near).removesuffix(f"{NBSP}%")
    span = percent(far) if percent(near) == percent(far) else f"{first} to {percent(far)}"
    return f"{span} too {'high' if high > 0 else 'low'}{where}{whom}"


def _against(found: Sequence[Prediction]) -> str:
    p = found[0]
    if p.met is None:
        return ""
    many = len(p.depth) > 1
    inside = f", and {p.within} of {len(p.depth)} readings lie within twice that" if many else ""
    size = f"up to {noise(p)}" if many else noise(p)
    return f"The uncertainty of {_parts(p)} is {size}{inside}."


def _parts(p: Prediction) -> str:
    return "the measurement alone" if p.numerical is None else "measurement and computation together"


def noise(p: Prediction) -> str:
    """One standard deviation, in per cent of the largest value measured."""
    size = float(np.abs(p.measured).max())
    return percent(float(p.total.max()) / size if size else None)


def prediction_fact(results: Results) -> list[Fact]:
    """The tile of the tests that were not used."""
    rows: list[tuple[Mapping[str, Any], str, str]] = []
    for e in experiments(results, "validate"):
        v, found = prediction_of(results, e), predictions(results, e)
        if v is not None and e["name"] == e["experiment"]:
            rows.append((e, clean(v.get("verdict")), prediction_note(e, v)))
        elif v is None and found:
            note = f"{found[0].within} of {len(found[0].depth)} readings within 2σ" if is_profile(e) else off(found)
            said = answer(found)
            rows.append((e, said, note + (f"; uncertainty {noise(found[0])}" if said else "")))
    if not rows:
        return []
    if len(rows) > 1:
        good, names = sum(v in ("yes", "among") for _, v, _ in rows), ", ".join(clean(e["name"]) for e, *_ in rows)
        every: Mark = "good" if good == len(rows) else "warn"
        return [Fact("Unused tests", f"{good} of {len(rows)} predicted", names, every)]
    ((e, verdict, note),) = rows
    mark: Mark = "good" if verdict == "yes" else "warn" if verdict else ""
    return [Fact("Unused test", _PREDICTION_TILES.get(verdict, "compared"), f"{clean(e['name'])}: {note}", mark)]
