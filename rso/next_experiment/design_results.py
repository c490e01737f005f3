"""`next.json`: what further experiments would show, as plain data and in words (layout in docs/results.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

import rso
from rso.calibration import result_files
from rso.calibration.plan import Plan
from rso.calibration.results import data_hashes
from rso.calibration.stated_settings import exact_dimensions
from rso.core.distributions import chi2_ppf
from rso.core.symbols import symbol, unit_text
from rso.core.units import spaced
from rso.inference.error_model import shares
from rso.inference.rules import RULES
from rso.inference.verdict import physical
from rso.next_experiment.study_design import REPEAT_SUFFIX, DesignResult, Joint, Learnt
from rso.optimal_design import SAME_INFORMATION_NATS, ExpectedInformation, Worth, about_parameter, ranked
from rso.study.cases import sketches

NEXT_FILE, NEXT_SCHEMA = "next.json", 1  # raised when keys of the file change their meaning
DETERMINED_SD_LN = math.log(RULES.determined_factor) / 1.645  # sd of ln θ with which a 90 % interval is a value
EXCLUDED_TRUTH_CONFIDENCE = 0.99  # confidence with which the data exclude a truth that is worth a word
LIKELIEST_BOUND_TOLERANCE = 1e-6  # of the unit cube
MENTIONED_WIDTH_DISAGREEMENT = 1.5  # factor between Fisher information and made-up data that is worth a word


def design_data(plan: Plan, found: DesignResult, command: str) -> dict[str, Any]:
    """Everything that the page shows, as strict JSON data."""
    box, focus = found.axes.box, found.axes.box.names[found.weakest]
    theta = box.from_unit(found.truths)
    singles, pairs = ranked_sets(found, 1), ranked_sets(found, 2)
    return result_files.plainly(
        {
            "schema": NEXT_SCHEMA,
            "study": {
                "title": plan.study.study.title,
                "file": plan.study.file.name,
                "seed": plan.seed,
                "units": plan.study.study.units,
            },
            "sketches": sketches(plan.study, plan.backend),
            "focus": focus,
            "enough": DETERMINED_SD_LN,
            "draws": plan.study.next.draws,
            "parameters": [
                {"name": n, "unit": box.units[k], "low": box.low[k], "high": box.high[k]}
                for k, n in enumerate(box.names)
            ],
            "truths": [dict(zip(box.names, map(float, row), strict=True)) for row in theta],
            "words": design_sentences(found, singles, pairs),
            "experiments": [_experiment(v) for v in found.learnt],
            "warnings": design_warnings(found),
            "stated_inputs": [i.name for i in plan.resolved.inputs],
            "exact_inputs": exact_dimensions(plan),
            "problems": dict(found.problems),
            "fits": [_fit(box, j) for j in found.joint],
            "told": [_row(found, n) for n in [(), *singles, *pairs]],
            "best": {"one": list(singles[0]) if singles else None, "two": list(pairs[0]) if pairs else None},
            "timings": {"fe_cpu": sum(v.cpu_s for v in found.learnt)},
            "counts": {"runs": sum(v.runs for v in found.learnt)},
            "provenance": {
                "rso": rso.__version__,
                "backend": plan.backend.name,
                "numerics": plan.backend.numerics,
                "command": command,
                "finished": datetime.now(UTC).isoformat(timespec="seconds"),
                "data_sha256": data_hashes(plan.study),
            },
        }
    )


def ranked_sets(found: DesignResult, size: int) -> list[tuple[str, ...]]:
    """Sets of so many experiments, best first by what they are expected to show of the weakest parameter."""
    sets = [t.added for t in found.told[0] if len(t.added) == size]
    return ranked(sets, lambda n: worth_of_set(found, n))


def worth_of_set(found: DesignResult, added: Sequence[str]) -> Worth:
    """What a set shows of the weakest parameter in the mean over the truths, and how many tests it takes."""
    return Worth(about_parameter(_sizes(found, ()), _sizes(found, added)), len(added))


def _of(found: DesignResult, added: Sequence[str]) -> list[ExpectedInformation]:
    """What a set shows, truth by truth."""
    return [next(t for t in row if t.added == tuple(added)) for row in found.told]


def _sizes(found: DesignResult, added: Sequence[str]) -> list[float]:
    """Expected sd of ln θ of the weakest parameter at each truth."""
    focus = found.axes.box.names[found.weakest]
    return [float((t.expected or t.fisher)[focus]) for t in _of(found, added)]


def design_sentences(
    found: DesignResult, singles: Sequence[tuple[str, ...]], pairs: Sequence[tuple[str, ...]]
) -> list[str]:
    """The answer in sentences."""
    box, k = found.axes.box, found.weakest
    name, at = box.names[k], [f"{v:.3g}" for v in box.from_unit(found.truths)[:, k]]
    before = _sizes(found, ())

    def known(sizes: Sequence[float]) -> str:
        return by_truth(at, sizes, box.units[k])

    said = [f"So far {name} is known to {known(before)}: one standard deviation, either way."]
    if singles:
        best, after = singles[0], _sizes(found, singles[0])
        said.append(f"The best next experiment is “{best[0]}”: with it {name} would be known to {known(after)}.")
        close = [n[0] for n in singles[1:] if np.mean(np.log(_sizes(found, n)) - np.log(after)) < SAME_INFORMATION_NATS]
        if close:
            said.append(f"Hardly worse: {', '.join(f'“{n}”' for n in close)}.")
        again = [n for n in singles if n[0].endswith(REPEAT_SUFFIX)]
        if again and best not in again:
            least, new = _sizes(found, again[0]), [n for n in singles if n not in again]
            no = [n[0] for n in new if np.mean(np.log(_sizes(found, n)) - np.log(least)) > -SAME_INFORMATION_NATS]
            said.append(
                f"“{again[0][0]}” would bring it to {known(least)}"
                + (f"; hardly more would come from {', '.join(f'“{n}”' for n in no)}." if no else ".")
            )
    if pairs:
        two = _sizes(found, pairs[0])
        said.append(f"The best two are “{pairs[0][0]}” and “{pairs[0][1]}”: {known(two)}.")
    every = [*singles, *pairs]
    lost, weak = [], []
    for j, v in enumerate(at):
        sizes = {n: _sizes(found, n)[j] for n in every}
        best_size = min(sizes.values(), default=before[j])
        if best_size > DETERMINED_SD_LN:
            lost.append(f"{name} = {v} (at best {_factor(best_size)})")
        elif all(s > DETERMINED_SD_LN for n, s in sizes.items() if len(n) == 1):
            weak.append(f"{name} = {v}")
    if lost:
        said.append(f"Nothing that was asked about, alone or two together, would determine {_or(lost)}.")
    if weak:
        said.append(f"Two of them are needed for {_or(weak)}.")
    off = [_sizes(found, n)[j] / _of(found, n)[j].fisher[name] for n in every for j in range(len(at))]
    if off and (max(off) > MENTIONED_WIDTH_DISAGREEMENT or min(off) < 1 / MENTIONED_WIDTH_DISAGREEMENT):
        said.append(
            f"Fisher information alone would have been off by factors of {1 / max(off):.2g} to {1 / min(off):.2g}: "
            "the numbers here come from simulated data."
        )
    return said


def design_warnings(found: DesignResult) -> list[str]:
    """Where the model misses the data, and the truths that these exclude."""
    box, k, said = found.axes.box, found.weakest, []
    if found.scale > 1.0:
        text = (
            f"The model misses what has been measured by {found.scale:.2g} times the stated errors. The errors of "
            "all experiments, future ones too, are enlarged by that factor"
        )
        cure = (
            "; what it lacks has to be found before a further experiment is chosen"
            if found.scale > RULES.refuted_error_ratio
            else ""
        )
        said.append(f"{text}{cure}.")
    limit = float(chi2_ppf(EXCLUDED_TRUTH_CONFIDENCE, 1))
    for x, theta, rise in zip(found.truths, box.from_unit(found.truths), found.rise, strict=True):
        if rise > limit:
            on = [
                n
                for j, n in enumerate(box.names)
                if j != k and not LIKELIEST_BOUND_TOLERANCE < x[j] < 1 - LIKELIEST_BOUND_TOLERANCE
            ]
            held = (
                f" with {' and '.join(on)} at the end of {'its range' if len(on) == 1 else 'their ranges'}"
                if on
                else ""
            )
            value = f"{box.names[k]} = {theta[k]:.3g}{spaced(box.units[k])}"
            said.append(
                f"The data speak against {value}: χ² is {rise:.3g} above its least value there{held}; "
                "what is expected for it is not expected of this specimen."
            )
    return said


def _or(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} or {texts[-1]}"


def by_truth(at: Sequence[str], sizes: Sequence[float], unit: str) -> str:
    """'a factor of 1.9 if it is 1 or 3 1/MPa, to ±17 % if it is 10 1/MPa': true values that give the same, once."""
    groups: dict[str, list[str]] = {}
    for value, sd in zip(at, sizes, strict=True):
        groups.setdefault(f"±{100 * sd:.2g} %" if sd < 0.2 else f"a factor of {math.exp(sd):.2g}", []).append(value)
    return ", to ".join(f"{text} if it is {_or(values)}{spaced(unit)}" for text, values in groups.items())


def _factor(sd: float) -> str:
    """One standard deviation of ln θ as people say it."""
    return f"±{100 * sd:.2g} %" if sd < 0.2 else f"×{math.exp(sd):.2g}"


def _experiment(v: Learnt) -> dict[str, Any]:
    return {
        "name": v.item.name,
        "words": v.item.words,
        "done": v.item.done,
        "readings": sum(len(b.depth) for b in v.item.blocks),
        "channels": sorted(
            {p.channel if not p.channel.startswith("uz(") else "uz" for b in v.item.blocks for p in b.places}
        ),
        "runs": v.runs,
        "cpu_s": v.cpu_s,
        "left_out": v.left_out,
    }


def _fit(box: Any, j: Joint) -> dict[str, Any]:
    d = j.determination
    rows = []
    for k, known in enumerate(d.known):
        low, high = physical(box, k, known.profile_interval)
        rows.append(
            {
                "name": known.name,
                "value": known.value,
                "interval": [low, high],
                "sd_log": known.sd_log,
                "verdict": known.verdict.word,
                "story": known.story,
            }
        )
    return {
        "experiments": list(j.names),
        "chi2": d.fit.chi2,
        "degrees": d.degrees,
        "p_value": d.p_value,
        "scale": d.scale,
        "story": d.story,
        "errors": {v.name: shares(v) for v in d.misfit.data},
        "parameters": rows,
    }


def _row(found: DesignResult, added: Sequence[str]) -> dict[str, Any]:
    return {
        "added": list(added),
        "information": worth_of_set(found, added).information,
        "price": len(added),
        "at": [
            {
                "alone": dict(t.alone),
                "fisher": dict(t.fisher),
                "expected": None if t.expected is None else dict(t.expected),
                "coverage": t.coverage,
            }
            for t in _of(found, added)
        ],
    }


def markdown(data: Mapping[str, Any], pairs: int = 3) -> list[str]:
    """The expected uncertainties of next.json as a table in Markdown: each experiment, the best `pairs`."""
    focus, kept = data["focus"], [r for r in data["told"] if len(r["added"]) < 2]
    kept += [r for r in data["told"] if len(r["added"]) == 2][:pairs]
    unit = next((spaced(unit_text(p["unit"])) for p in data["parameters"] if p["name"] == focus), "")
    heads = [f"{symbol(focus)} = {t[focus]:.3g}{unit}" for t in data["truths"]]
    rows = [f"| added | {' | '.join(heads)} |", f"|{'---|' * (1 + len(heads))}"]
    for r in kept:
        sizes = [(at["expected"] or at["fisher"])[focus] for at in r["at"]]
        cells = [f"**{_factor(s)}**" if s <= data["enough"] else _factor(s) for s in sizes]
        rows.append(f"| {' + '.join(r['added']) or 'nothing'} | {' | '.join(cells)} |")
    return rows


def write_design(folder: Path, found: Mapping[str, Any]) -> Path:
    """Write next.json at once or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / NEXT_FILE
    result_files.write_results(path, found)
    return path
