"""What the most likely values say of tests that took no part in the fit, as the study has judged it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rso.core.digits import significant
from rso.report.calibration.displacements import is_profile
from rso.report.layout.digits import clean, percent, quantity, shortest
from rso.report.reading import Results, listed, number

MIN_VISIBLE_SD = 3.0  # standard deviations below which a single reading is hardly more than noise
_PREDICTION_HEADS = {"yes": "Yes: ", "among": "Yes, within what the fit leaves open: ", "no": "No: "}
_PREDICTED_WORDS = {
    "yes": "is predicted",
    "among": "lies within what the fit leaves open of the prediction",
    "no": "is not predicted",
}


def prediction_of(results: Results, e: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The entry of an experiment in `predictions`; None where nothing was identified that could predict it."""
    mine = e.get("experiment", e["name"])
    return next((v for v in listed(results, "predictions") if v.get("experiment") == mine), None)


def prediction_sentence(e: Mapping[str, Any], v: Mapping[str, Any]) -> str:
    """Yes or no, by how much the readings are missed, and against which uncertainty."""
    verdict, name, channels = clean(v.get("verdict")), clean(e["experiment"]), list(v.get("channels") or ())
    if verdict not in _PREDICTED_WORDS:
        text = f"Whether {name}, which was not used for the fit, is predicted is open: {clean(v.get('why'))}"
        return f"{text}; {_off(channels)}." if channels else f"{text}."
    text = f"{_PREDICTION_HEADS[verdict]}{name}, which was not used for the fit, "
    text += f"{_PREDICTED_WORDS[verdict]} by the most likely values"
    if not is_profile(e) and v.get("points") == 1:
        (c,) = channels
        text += f": at {shortest(c['depth'][0])} mm {quantity(c['measured'][0], c['unit'])} was measured"
        text += f", {quantity(c['predicted'][0], c['unit'])} is predicted"
    text += f"; {_off(channels)}" if not is_profile(e) else ""
    missed = [clean(c["channel"]) for c in channels if c.get("missed")]
    if verdict == "no" and len(channels) > 1 and missed:
        text += f". What misses is {' and '.join(missed)}"
    n = v.get("points")
    chi2 = f"χ² = {significant(number(v.get('chi2')), 3)} for {n} reading{'s' if n != 1 else ''}, {_p(v)},"
    errors = "the errors of measurement and computation and what the fit leaves open of the prediction"
    return f"{text}. {chi2} counts {errors}, {_shares(v)}.{_level(v)}"


def missed(v: Mapping[str, Any]) -> str:
    """Why the most likely values do not have it."""
    chi2 = significant(number(v.get("chi2")), 3)
    z = number(v.get("level"))
    whole = f", as a whole {_away(z)}" if z is not None and abs(z) >= MIN_VISIBLE_SD else ""
    return f"by the most likely values χ² = {chi2} for {v.get('points')} readings{whole}, {_p(v)}"


def _level(v: Mapping[str, Any]) -> str:
    """Where the readings lie as a whole, if that is off by more than hardly."""
    z = number(v.get("level"))
    far = z is not None and abs(z) >= MIN_VISIBLE_SD and (v.get("points") or 0) > 1
    return f" As a whole the readings lie {_away(z)} the prediction." if z is not None and far else ""


def _away(z: float) -> str:
    return f"{significant(abs(z), 2)} standard deviations {'above' if z > 0 else 'below'}"


def missed_channel(e: Mapping[str, Any], v: Mapping[str, Any]) -> bool:
    """Whether the channel of a compared curve alone is missed."""
    return any(c.get("channel") == e.get("channel") and c.get("missed") for c in v.get("channels") or ())


def prediction_note(e: Mapping[str, Any], v: Mapping[str, Any]) -> str:
    """For the tile."""
    channels = list(v.get("channels") or ())
    if not v.get("verdict"):
        return clean(v.get("why"))
    return _p(v) if is_profile(e) else f"{_off(channels)}; {_p(v)}"


def _p(v: Mapping[str, Any]) -> str:
    p = number(v.get("p_value"))
    return "p unknown" if p is None else f"p = {significant(p, 2)}" if p >= 1e-3 else "p < 0.001"


def _off(channels: Sequence[Mapping[str, Any]]) -> str:
    """'0.42 % too high at 8 mm', of several channels each with its name."""
    said = []
    for c in channels:
        y, f, u = (c[k][-1] for k in ("measured", "predicted", "depth"))
        gap = f"{percent(abs(f - y) / abs(y))} too {'high' if abs(f) > abs(y) else 'low'}" if y else ""
        if y and f * y < 0:
            gap = f"{quantity(f, c['unit'])} instead of {quantity(y, c['unit'])}"
        if abs(y) < MIN_VISIBLE_SD * c["sigma"][-1]:  # a per cent of noise says nothing
            gap = f"{quantity(f, c['unit'])} where {quantity(y, c['unit'])}, hardly more than noise, was measured"
        name = f"{clean(c['channel'])} " if len(channels) > 1 else ""
        held = ", at the end of the hold" if (c.get("since") or [0.0])[-1] else ""
        said.append(f"{name}{gap or 'zero was measured'} at {shortest(u)} mm{held}")
    return ", ".join(said)


def _shares(v: Mapping[str, Any]) -> str:
    """One standard deviation of either, in per cent of the largest reading, for each channel."""
    said = []
    for c in v["channels"]:
        size = max(map(abs, c["measured"])) or 1.0
        near = max((s**2 + e**2) ** 0.5 for s, e in zip(c["sigma"], c["numerical_error"], strict=True))
        name = f" of {clean(c['channel'])}" if len(v["channels"]) > 1 else ""
        said.append(f"up to {percent(near / size)} and {percent(max(c['spread']) / size)}{name}")
    return ", ".join(said)
