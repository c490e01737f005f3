"""A diagnosis as typed views: what its sections and figures share.  Missing keys give empty views."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rso.core.digits import DASH, NBSP, fixed, known, places, significant
from rso.discrepancy.parameters import called
from rso.discrepancy.wording import UNDECIDED, undecided
from rso.report.layout.digits import Unit, clean, percent, shortest, shown, unit_text
from rso.report.reading import listed, number, pair

Found = Mapping[str, Any]
# parts of the names of hypotheses: no effect, a gap of no known cause
NO_EFFECT, NO_KNOWN_CAUSE = "none", "unexplained"
PARAMETER_BANDS = "before", "if_nothing_else", "after"  # bands of parameters
_RAISED_DIGITS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_BRANCH_ORDER = {"loading": 0, "unloading": 1, "held": 2}  # as in `rso.discrepancy.library.test_plan`


@dataclass(frozen=True, eq=False)
class RecordView:
    """One curve of one channel: arrays (n,), all known; `cause` is what is left with the cause, or None.

    During a hold `depth` is the time since the indenter came to rest.
    """

    depth: np.ndarray
    branch: np.ndarray
    measured: np.ndarray
    sd: np.ndarray
    base: np.ndarray
    cause: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Signature:
    """What each hypothesis adds to the base model along one curve of one channel: arrays (n,), all known.

    During a hold `depth` is the time since the indenter came to rest.
    """

    depth: np.ndarray
    branch: np.ndarray
    added: Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Panel:
    """All records of one channel of one experiment while the indenter moves or, `held`, rests, and its regions (branch
    or None, low, high) beyond noise."""

    experiment: str
    channel: str
    profile: bool
    unit: Unit
    records: tuple[RecordView, ...]
    regions: tuple[tuple[int | None, float, float], ...]
    held: bool = False


def core(found: Found) -> Mapping[str, Any]:
    """The block of results.json."""
    return found.get("diagnosis") or {}


def verdict_of(found: Found) -> str:
    """The verdict's key."""
    return str(core(found).get("verdict") or "")


def told(found: Found) -> str:
    """What a reader sees: the verdict's key, or `UNDECIDED` where no gap is one on the border."""
    return UNDECIDED if undecided(core(found)) else verdict_of(found)


def parts(name: str) -> list[str]:
    """Names of what a hypothesis is made of."""
    return [p for p in name.split(" + ") if p]


def effects_of(name: str) -> list[str]:
    """Names of the effects of a hypothesis; the base model and what is unexplained are none."""
    return [p for p in parts(name) if p not in (NO_EFFECT, NO_KNOWN_CAUSE)]


def chosen(found: Found) -> str | None:
    """The hypothesis with effects whose residuals the diagnosis holds beside those of the base model."""
    for r in listed(found, "residuals"):
        for name in r.get("residual") or {}:
            if effects_of(name):
                return str(name)
    return None


def descriptions(found: Found) -> dict[str, str]:
    """What every effect of the catalogue is, in words."""
    return {clean(e.get("name")): clean(e.get("description")) for e in listed(found, "effects")}


def label(found: Found, name: str) -> str:
    """A hypothesis in words."""
    effects, rest = effects_of(name), NO_KNOWN_CAUSE in parts(name)
    if not effects:
        return "something that is not in the catalogue" if rest else "nothing: the base model alone"
    text = " and ".join(clean(called(found, e)) for e in effects)
    return f"{text}, and something more" if rest else text


def brief(found: Found, name: str) -> str:
    """A hypothesis by what people call its effects, for the heading of a column."""
    effects = " + ".join(clean(called(found, e)) for e in effects_of(name))
    if NO_KNOWN_CAUSE not in parts(name):
        return effects or "base model"
    return f"{effects} and more" if effects else "not in the catalogue"


def chance(q: object) -> str:
    """A probability in per cent, without digits that nobody can claim."""
    if not known(q):
        return DASH
    if q > 0.995:
        return f">{NBSP}99{NBSP}%"
    return percent(q, 2 if q >= 0.1 else 1) if q >= 0.001 else f"<{NBSP}0.1{NBSP}%"


def p_text(p: object) -> str:
    """A p-value: below 0.005 the simulated null is too short to say more."""
    if not known(p):
        return DASH
    return f"<{NBSP}0.005" if p < 0.005 else significant(p, 2)


def unit_of(unit: object, size: float | None = None) -> Unit:
    """The unit people use for a quantity of this size, powers raised."""
    use = shown("" if unit is None else str(unit), size)
    raised = re.sub(r"\^(\d+)", lambda m: m.group(1).translate(_RAISED_DIGITS), use.label)
    return Unit(unit_text(raised), use.factor)


def amount(x: object, unit: object, digits: int = 3) -> str:
    """A number with its unit."""
    use = unit_of(unit, number(x))
    return f"{significant(x * use.factor, digits)}{use.after}" if known(x) else DASH


def interval(values: tuple[float, float, float], unit: object) -> tuple[str, str]:
    """(median, interval) of (low, median, high) with one unit, to two digits of the half-width."""
    use = unit_of(unit, max(map(abs, values)))
    low, mid, high = (v * use.factor for v in values)
    if low > 0 and high > 3 * low:  # a factor: each end has its own digits
        texts = [significant(v, 2) for v in (low, mid, high)]
    else:
        decimals = places((high - low) / 2, 2) if high > low else places(max(abs(low), abs(high)), 4)
        texts = [fixed(round(v, decimals), decimals) for v in (low, mid, high)]
    return f"{texts[1]}{use.after}", f"{texts[0]} to {texts[2]}{use.after}"


def sized(cause: Mapping[str, Any]) -> tuple[str, str, str]:
    """Size, interval and neutral value of a named cause, in one unit."""
    size, ends, unit = number(cause.get("size")), cause.get("interval"), cause.get("unit")
    neutral = number(cause.get("neutral"))
    if size is None or not pair(ends):
        return amount(size, unit), DASH, amount(neutral, unit)
    use = unit_of(unit, max(map(abs, (size, *ends))))
    zero = DASH if neutral is None else f"{shortest(neutral * use.factor)}{use.after}"
    return *interval((ends[0], size, ends[1]), unit), zero


def band(d: Mapping[str, Any] | None) -> tuple[float, float, float] | None:
    """(low, median, high) of a parameter, None unless all are known."""
    low, median, high = (number((d or {}).get(k)) for k in ("low", "median", "high"))
    return None if low is None or median is None or high is None else (low, median, high)


def said_when(found: Found) -> dict[str, str]:
    """Which bands of parameters are shown, and what each is called; without a cause the first two are the same."""
    said = {"before": "without the cause", "if_nothing_else": "with it, if nothing else is there"}
    bands = core(found).get("parameters") or {}
    if not chosen(found):
        said = {"if_nothing_else" if "if_nothing_else" in bands else "before": "if nothing is missing"}
    return said | {"after": "with all that the data allow"}


def parameter_bands(found: Found) -> list[tuple[str, str, dict[str, tuple[float, float, float]]]]:
    """(name, unit, {when: (low, median, high)}) of every base parameter."""
    data = core(found).get("parameters") or {}
    names = dict.fromkeys(k for when in PARAMETER_BANDS for k in data.get(when) or {})
    rows = []
    for k in names:
        known_bands = {w: b for w in PARAMETER_BANDS if (b := band((data.get(w) or {}).get(k)))}
        if known_bands:
            rows.append((clean(k), str((found.get("units") or {}).get(k) or ""), known_bands))
    return rows


def panels(found: Found) -> list[Panel]:
    """One per experiment and channel, a hold for itself: first by the regions in the order of their strength, then by
    the residual."""
    groups: dict[tuple[str, str, bool], list[Mapping[str, Any]]] = {}
    for r in listed(found, "residuals"):
        groups.setdefault((str(r.get("experiment")), str(r.get("channel")), "since" in r), []).append(r)
    where = list(core(found).get("where") or ())
    first = [(str(r.get("experiment")), str(r.get("channel")), str(r.get("region")).startswith("held")) for r in where]
    kinds = {str(e.get("name")): e.get("kind") for e in listed(found, "experiments")}
    cause = chosen(found)
    rows = []
    for key, members in groups.items():
        records = tuple(v for m in members if (v := _record(m, cause)) is not None)
        if not records:
            continue
        size = float(np.mean([np.mean((v.base / v.sd) ** 2) for v in records]))
        place = first.index(key) if key in first else len(first)
        regions = tuple(
            a
            for r, k in zip(where, first, strict=True)
            if k == key and r.get("beyond_noise") and (a := _region(r.get("region")))
        )
        profile = kinds.get(key[0]) == "profile"
        force = key[1].startswith("F")
        unit = shown("N" if force else "mm", max(float(np.maximum(np.abs(v.base), v.sd).max()) for v in records))
        rows.append(((place, -size), Panel(clean(key[0]), clean(key[1]), profile, unit, records, regions, key[2])))
    return [v for _, v in sorted(rows, key=lambda v: v[0])]


def _record(r: Mapping[str, Any], cause: str | None) -> RecordView | None:
    """The readings of which everything is known."""
    residual = r.get("residual") or {}
    names = ["since" if "since" in r else "depth", "branch", "measured", "sd"]
    columns = [r.get(k) for k in names] + [residual.get(NO_EFFECT)] + ([residual[cause]] if cause in residual else [])
    data = _known(columns)
    if data is None or not np.any(keep := data[3] > 0):
        return None
    data = data[:, keep]
    return RecordView(data[0], data[1].astype(int), data[2], data[3], data[4], data[5] if len(data) > 5 else None)


def _known(columns: Sequence[Sequence[Any] | None]) -> np.ndarray | None:
    """Columns (k, n) of the rows of which all is known, None where there is none."""
    whole = [c for c in columns if c is not None]
    if len(whole) < len(columns):
        return None
    rows = [v for v in zip(*whole, strict=False) if all(map(known, v))]
    return np.array(rows, float).T if rows else None


def _region(text: object) -> tuple[int | None, float, float] | None:
    """Branch and depths (mm) or times (s) of a region from its words, None where they hold none."""
    if m := re.fullmatch(r"held ([\d.e+-]+)–([\d.e+-]+) s", str(text)):
        return _BRANCH_ORDER["held"], float(m[1]), float(m[2])
    if m := re.fullmatch(r"(loading|unloading) ([\d.]+)–([\d.]+) mm", str(text)):
        return _BRANCH_ORDER[m[1]], float(m[2]), float(m[3])
    if m := re.fullmatch(r"profile at ([\d.]+) mm", str(text)):
        return None, float(m[1]), float(m[1])
    return None


def signatures(found: Found) -> list[tuple[Panel, tuple[Signature, ...]]]:
    """The panels of which it is known what hypotheses add to the base model, in their order, with that."""
    groups: dict[tuple[str, str, bool], list[Signature]] = {}
    for r in listed(found, "signatures"):
        key = (clean(r.get("experiment")), clean(r.get("channel")), "since" in r)
        if (s := _signature(r)) is not None:
            groups.setdefault(key, []).append(s)
    rows = [(p, groups.get((p.experiment, p.channel, p.held))) for p in panels(found)]
    return [(p, tuple(v)) for p, v in rows if v]


def _signature(r: Mapping[str, Any]) -> Signature | None:
    """The readings of which everything is known."""
    added = r.get("added") or {}
    data = _known([r.get("since" if "since" in r else "depth"), r.get("branch"), *added.values()])
    if data is None or not added:
        return None
    return Signature(data[0], data[1].astype(int), dict(zip(map(str, added), data[2:], strict=True)))


def place_text(place: object) -> str:
    """A point of the specimen in words."""
    if pair(place):
        x, y = map(shortest, place)
        return f"({x}, {y}){NBSP}mm"
    return clean(place)
