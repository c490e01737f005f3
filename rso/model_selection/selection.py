"""Model selection: which levels are rejected, which one is accepted, and why, in words.

Each level is a model fitted to the same curves; whether it is good enough is asked in :mod:`.goodness_of_fit`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rso.model_selection.goodness_of_fit import Goodness

MIN_LOG_EVIDENCE_GAIN = math.log(20.0)  # of ln evidence: below 20 to 1 two levels are not told apart
SELECTION_RULE = (
    "A level is rejected if at most {alarm} % of data sets simulated from it fit as badly. χ² over all readings "
    "and the NRMSE of each curve are one joint test: a perfect model exceeds any limit in {alarm} %. A richer "
    "level is accepted only if its evidence is larger and the data determine every parameter that it adds, or "
    "exclude its absence. The ladder ends at the first accepted level that is good enough."
)


@dataclass(frozen=True)
class ModelLevel:
    """One model of the ladder: what it sets and opens.  Only names and numbers; their meaning is the backend's.

    `title` is its name in sentences.
    `open` maps a parameter to (low, high), `hold` to a value; both are shares of the modulus for those in `relative`
    (a stress is C = value · modulus, a compliance D = value / modulus).  `closed_form` costs no simulation; `extends`
    names the level that this one is where all its own parameters are neutral; one that `adds` is put on the level that
    holds by then instead of standing alone.
    """

    name: str
    description: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    open: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    hold: Mapping[str, float] = field(default_factory=dict)
    relative: frozenset[str] = frozenset()
    closed_form: bool = False
    extends: str = ""
    adds: bool = False
    title: str = ""

    @property
    def label(self) -> str:
        """What it is called in sentences."""
        return self.title or self.name


@dataclass(frozen=True)
class Added:
    """A parameter that a level adds: whether the data determine it, and the sentence that says so.

    One is `shown` where its interval ends before the value at which it would be absent, however far that leaves its
    size open, as of what saturates.
    """

    name: str
    determined: bool
    story: str
    shown: bool = False


@dataclass(frozen=True, eq=False)
class Judged:
    """What was found of one level.

    `problem` says why there is no answer, and then the rest is empty.  `onto` is the level that it was put on,
    `detail` whatever the caller keeps with it.  `if_remembering` is the goodness of a level that is not good enough if
    readings of which nobody knows whether they are autocorrelated do so as what it leaves does; None where that does
    not go together, or is far more than noise.
    """

    level: ModelLevel
    problem: str = ""
    goodness: Goodness | None = None
    added: tuple[Added, ...] = ()
    log_evidence: float = -math.inf
    onto: str = ""
    detail: Any = None
    if_remembering: Goodness | None = None

    @property
    def adequate(self) -> bool:
        """Neither the fitted curves nor those kept to select are worse than noise explains."""
        return self.goodness is not None and self.goodness.passes

    @property
    def undetermined(self) -> tuple[Added, ...]:
        """Parameters that it adds without the data's consent."""
        return tuple(a for a in self.added if not (a.determined or a.shown))


@dataclass(frozen=True)
class SelectionStep:
    """What became of a level: `adequate`, `fails`, `refused`, `no_answer`, `not_better` or `not_needed`, in words."""

    name: str
    rung: int
    verdict: str
    words: str


@dataclass(frozen=True, eq=False)
class Selection:
    """Everything fitted, a step for every level of the ladder, the level that holds and whether it is good enough.

    `rivals` are other levels of its rung that are good enough and not 20 times less likely.
    """

    judged: tuple[Judged, ...]
    steps: tuple[SelectionStep, ...]
    chosen: str | None
    adequate: bool
    rivals: tuple[str, ...]
    words: str

    def of(self, name: str) -> Judged:
        """What was found of a level; KeyError if it was not fitted."""
        return {j.level.name: j for j in self.judged}[name]


# ------------------------------------------------------------------------------------------------------ deciding


def select_model(
    rungs: Sequence[Sequence[ModelLevel]], judge: Callable[[ModelLevel, Judged | None], Judged]
) -> Selection:
    """Compare levels rung by rung; `judge` fits one level, given what holds so far, where it is needed.

    A rung is tried when what holds so far fails.  Of its levels with an answer, nothing undetermined and more evidence
    than what holds, those that are good enough end the selection and the likeliest is chosen; else the likeliest takes
    over and the next rung is tried.
    """
    judged: list[Judged] = []
    steps: list[SelectionStep] = []
    holds: Judged | None = None
    done = False
    rivals: tuple[str, ...] = ()
    for n, rung in enumerate(rungs):
        if done:
            steps += [SelectionStep(v.name, n, "not_needed", f"{v.label} was not needed.") for v in rung]
            continue
        tried = [judge(level, holds) for level in rung]
        judged += tried
        able = [j for j in tried if not j.problem and not j.undetermined]
        better = sorted((j for j in able if _beats(j, holds)), key=lambda j: -j.log_evidence)
        good = [j for j in better if j.adequate]
        taken = good or better
        before, holds = holds, taken[0] if taken else holds
        rivals = tuple(j.level.name for j in good[1:] if j.log_evidence > good[0].log_evidence - MIN_LOG_EVIDENCE_GAIN)
        steps += [_step(j, n, before, holds, rivals) for j in tried]
        done = bool(good)
    label = {v.name: v.label for rung in rungs for v in rung}
    refused = [label[s.name] for s in steps if s.verdict == "refused"]
    words = _conclusion(holds, done, [label[n] for n in rivals], refused)
    name = None if holds is None else holds.level.name
    return Selection(tuple(judged), tuple(steps), name, done, rivals, words)


def _beats(j: Judged, holds: Judged | None) -> bool:
    return holds is None or j.log_evidence > holds.log_evidence


def _step(j: Judged, n: int, before: Judged | None, holds: Judged | None, rivals: tuple[str, ...]) -> SelectionStep:
    name, label = j.level.name, j.level.label
    if j.problem:
        return SelectionStep(name, n, "no_answer", f"{label} has no answer: {j.problem}")
    measured = _measured(j)
    if j.undetermined:
        fits = "It would be good enough" if j.adequate else "It would fail too"
        why = " ".join(a.story for a in j.undetermined)
        return SelectionStep(
            name, n, "refused", f"{label} is refused, what it adds is not determined. {why} {fits}: {measured}"
        )
    if before is not None and not _beats(j, before):
        state = "would be good enough" if j.adequate else "fails too"
        return SelectionStep(
            name, n, "not_better", f"{label} {state} and is less likely than {before.level.label}: {measured}"
        )
    if not j.adequate:
        return SelectionStep(name, n, "fails", f"{label} fails: {measured}")
    text = "is good enough" if holds is j else "is good enough too; the data cannot separate them"
    if holds is not j and name not in rivals:
        text = "is good enough too, but more than 20 times less likely"
    left_open = "".join(f" That it is there is shown, its size is not: {a.story}" for a in j.added if not a.determined)
    return SelectionStep(name, n, "adequate", f"{label} {text}: {measured}{left_open}")


def _measured(j: Judged) -> str:
    """The verdict of a level: every criterion beside its limit, those that are beyond it first and by themselves."""
    g = j.goodness
    assert g is not None
    each = []
    for check, what in zip(g.checks, ("the fitted curves", "the selection curves"), strict=False):
        each.append((check.chi2 > check.limit, f"χ² = {_size(check.chi2)} of {what}", _size(check.limit)))
    for e in g.errors:
        if e.role != "validate":
            each.append((e.nrmse > e.limit, f"NRMSE {100 * e.nrmse:.3g} % on {e.name}", f"{100 * e.limit:.3g} %"))
    beyond = [f"{of} is beyond its limit, {limit}" for over, of, limit in each if over]
    within = [f"{of}, limit {limit}" for over, of, limit in each if not over]
    rest = "; ".join(within)
    said = f"{'; '.join(beyond)}{f' (within theirs: {rest})' if rest else ''}" if beyond else rest
    return f"{said}; together p {goodness_p_value(g)} (below {100 * (1 - g.confidence):.3g} % it fails)."


def _size(x: float) -> str:
    return f"{x:.3g}" if x < 1000 else f"{float(f'{x:.3g}'):.0f}"


def goodness_p_value(g: Goodness) -> str:
    """The smallest p-value that so many draws can give is a bound."""
    least = 1.0 / (1.0 + g.checks[0].draws)
    return f"= {g.p_value:.2g}" if g.p_value > 1.5 * least else f"< {g.p_value:.1g}"


def _conclusion(holds: Judged | None, done: bool, rivals: list[str], refused: list[str]) -> str:
    if holds is None:
        return "No level has an answer that the data determine."
    name = holds.level.label
    if done:
        text = f"{name} is the simplest model consistent with the data."
        if rivals:
            text += f" {' and '.join(rivals)} cannot be excluded either: other data must decide."
        return text
    text = f"No level of this ladder is good enough; {name} is the best that the data support."
    if refused:
        text += f" {' and '.join(refused)} would add what the data do not determine."
    return text + " What is still missing may lie outside of the ladder: ask rso diagnose."
