"""How many verdicts of an identification change where one of its rules is halved or doubled.

    python benchmarks/identification_rules.py [CASES] [SEED]

A ball of 3 mm is pressed into bonded layers in closed form (`rso.benchmarks.indentation`).  Thickness, depth, noise and
truth are drawn; in a third of the cases the readings come from a layer that is 10 % thicker than stated, or thinner.
The second row has the same cases with that uncertainty stated.
Each case is identified once with the rules as they are (`rso/inference/rules.py`), and judged again with one of them
changed; a chance is halved and doubled, of a factor f it is f - 1.  Counted are parameters: two in each case.
"""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass

import numpy as np

from rso.benchmarks import indentation
from rso.doe import Box
from rso.inference import Data, Determination, Misfit, Model, determine, error_covariance
from rso.inference.rules import RULES, IdentificationRules
from rso.inference.verdict import judge_parameter

RADIUS = 3.0  # mm
BOX = Box(("mu", "D1"), ("MPa", "1/MPa"), (0.002, 1.0), (0.05, 200.0), (True, True))
VARIED = ("determined_factor", "leaning_factor", "uninformative_share", "refuted_error_ratio", "refuted_fit_chance")
FACTORS = ("determined_factor", "leaning_factor")


@dataclass(frozen=True, eq=False)
class Identified:
    """A case: its misfit, the truth (2,) in the unit cube, whether the model is right, and what is determined."""

    misfit: Misfit
    truth: np.ndarray
    right: bool
    found: Determination
    thickness: float


def drawn(rng: np.random.Generator, seed: int) -> Identified:
    """A case, identified with the rules as they are."""
    x = rng.uniform(0.1, 0.9, 2)
    mu, D1 = BOX.from_unit(x[None])[0]
    thickness, h = rng.uniform(4.0, 20.0), np.linspace(0.0, rng.uniform(0.5, 3.0), 31)[1:]
    right = rng.random() < 2 / 3
    real = thickness if right else thickness * rng.choice([0.9, 1.1])
    F = indentation(h, mu, D1, RADIUS, real)
    white = F[-1] * 10 ** rng.uniform(-3.0, -1.5)
    C = error_covariance(h, F, np.gradient(F, h), white=white, contact=0.01 * h[-1], gain=0.01)
    y = F + np.linalg.cholesky(C + 1e-18 * np.eye(len(h))) @ rng.standard_normal(len(h))
    model = Model(BOX, lambda X: np.array([indentation(h, m, d, RADIUS, thickness) for m, d in BOX.from_unit(X)]))
    misfit = Misfit(model, (Data("press", "N", h, y, C),))
    return Identified(misfit, x, right, determine(misfit, seed=seed, mcmc=False), thickness)


def with_uncertain_thickness(case: Identified, seed: int) -> Identified:
    """The same where the study says that the thickness is known to 10 % (GUM, 5.1.3, note 2)."""
    (data,), (mu, D1) = case.misfit.data, case.found.fit.theta
    thick, thin = (indentation(data.depth, mu, D1, RADIUS, f * case.thickness) for f in (1.1, 0.9))
    misfit = dataclasses.replace(case.misfit, data=(data.with_input("thickness", 0.5 * (thick - thin)),))
    return dataclasses.replace(case, misfit=misfit, found=determine(misfit, seed=seed, mcmc=False))


def words(case: Identified, rules: IdentificationRules, seed: int) -> list[str]:
    """The verdict of each parameter by other rules."""
    found = case.found
    if rules.refuted_fit_chance != RULES.refuted_fit_chance:
        found = determine(case.misfit, seed=seed, mcmc=False, rules=rules)
    out = []
    for k, known in enumerate(found.known):
        leaning = tuple(BOX.names[j] for j in known.profile.leaning(0.9))
        out.append(judge_parameter(BOX, k, known.profile_interval, leaning, found.scale, None, rules).word)
    return out


def inside(case: Identified) -> list[bool]:
    """Whether the interval of each parameter holds the truth."""
    intervals = [k.profile_interval for k in case.found.known]
    return [bool(i.low <= x <= i.high) for i, x in zip(intervals, case.truth, strict=True)]


def changed(name: str, times: float) -> IdentificationRules:
    """The rules with one of them halved or doubled; of a factor, what it is above 1."""
    value = getattr(RULES, name)
    other = 1.0 + times * (value - 1.0) if name in FACTORS else min(times * value, 1.0)
    if name == "refuted_error_ratio":
        other = times * value
    return dataclasses.replace(RULES, **{name: other})


def main(cases: int = 200, seed: int = 0) -> None:
    """Print both tables as Markdown."""
    rng = np.random.default_rng(seed)
    found = [drawn(rng, seed + k) for k in range(cases)]
    now = [words(c, RULES, seed + k) for k, c in enumerate(found)]
    print(f"{cases} cases, {sum(c.right for c in found)} of a right model; seed {seed}\n")
    print(
        "| rule | value | determined | of these without the truth: right model | wrong model | verdicts that change |"
    )
    print("|---|---|---|---|---|---|")
    print(_row("as they are", "", found, now, now))
    known = [with_uncertain_thickness(c, seed + k) for k, c in enumerate(found)]
    print(
        _row("the thickness stated to 10 %", "", known, [words(c, RULES, seed + k) for k, c in enumerate(known)], now)
    )
    for name in VARIED:
        for times in (0.5, 2.0):
            rules = changed(name, times)
            other = [words(c, rules, seed + k) for k, c in enumerate(found)]
            print(_row(name, f"{getattr(rules, name):.3g}", found, other, now))


def _row(name: str, value: str, found: list[Identified], said: list[list[str]], now: list[list[str]]) -> str:
    flat = [
        (w, o, i, c.right)
        for c, ws, os in zip(found, said, now, strict=True)
        for w, o, i in zip(ws, os, inside(c), strict=True)
    ]
    sure = [row for row in flat if row[0] == "determined"]
    lost = [sum(not i for _, _, i, r in sure if r is right) for right in (True, False)]
    of = [sum(r is right for *_, r in sure) for right in (True, False)]
    moved = sum(w != o for w, o, *_ in flat) / len(flat)
    share = len(sure) / len(flat)
    return f"| {name} | {value} | {share:.2f} | {lost[0]} of {of[0]} | {lost[1]} of {of[1]} | {100 * moved:.1f} % |"


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
