"""Candidates are rerun by the backend until what was predicted is what comes out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rso.emulation.emulator import Emulator, Output
from rso.evaluation import Outcome
from rso.evaluation.store import Done
from rso.optimise import Choice
from rso.optimise.targets import Checked


@dataclass(frozen=True, eq=False)
class Candidate:
    """Values, predicted (mean, sd) and recomputed outputs by id, the largest relative difference of the targets.

    `worst` is the id of that target; `checked` what is demanded of the recomputed outputs (empty without an answer).
    """

    values: Mapping[str, float]
    predicted: Mapping[str, tuple[float, float]]
    recomputed: Mapping[str, float]
    outcomes: tuple[Outcome, ...]
    agreement: float | None
    verified: bool
    worst: str | None = None
    checked: tuple[Checked, ...] = ()

    @property
    def meets(self) -> bool:
        """Whether it has an answer that meets every target and constraint."""
        return self.state == "done" and all(c.met for c in self.checked)

    @property
    def distance(self) -> tuple[float, float]:
        """How far it is from what is demanded: the largest miss of a limit, then of a target (`Checked.size`)."""
        limits, targets = ([c.size for c in self.checked if (c.kind == "target") == t] for t in (False, True))
        return max(limits, default=0.0), max(targets, default=0.0)

    @property
    def state(self) -> str:
        """'done' if every run is done, else the state of the first that is not."""
        other = [o for o in self.outcomes if not isinstance(o, Done)]
        return type(other[0]).__name__.lower() if other else "done"


@dataclass(frozen=True, eq=False)
class Verified:
    """A finished search: the last choice and its candidates, those of the rounds before, the emulator that knows these.

    `infill` counts the points of the rounds before that were new to the emulator.
    """

    choice: Choice
    candidates: tuple[Candidate, ...]
    earlier: tuple[Candidate, ...]
    infill: int
    emulator: Emulator

    @property
    def verified(self) -> bool:
        """Whether every candidate agrees with its prediction."""
        return all(c.verified for c in self.candidates)


def verify(
    emulator: Emulator,
    targets: Sequence[Output],
    propose: Callable[[Emulator], Choice],
    rerun: Callable[[Emulator, Choice], list[Candidate]],
    enrich: Callable[[Emulator, list[Candidate]], Emulator],
    max_infill: int,
) -> Verified:
    """Propose, rerun, learn from the reruns, propose again, until all candidates agree or `max_infill` runs are spent.

    A candidate that was to meet all that is demanded and does not when recomputed does not agree either.

    A candidate that failed or crashed is not verified and teaches no surrogate; one that failed may teach where not to
    look: `enrich` then returns another emulator of the same samples.  When it returns the same one the loop ends.
    Where no candidate of the last round has an answer, the one of the earlier rounds that comes closest joins them.
    """
    infill = 0
    earlier: list[Candidate] = []
    while True:
        choice = propose(emulator)
        candidates = rerun(emulator, choice)
        promised = choice.feasible and choice.reachable
        wrong = sum(not c.verified or (promised and not c.meets) for c in candidates)
        learned = enrich(emulator, candidates) if wrong and infill + wrong <= max_infill else emulator
        if learned is emulator:
            done = [c for c in earlier if c.state == "done"]
            if done and all(c.state != "done" for c in candidates):
                candidates = [*candidates, min(done, key=lambda c: c.distance)]
            return Verified(choice, tuple(candidates), tuple(earlier), infill, emulator)
        earlier += candidates
        infill += len(learned.samples) - len(emulator.samples) + sum(c.state == "failed" for c in candidates)
        emulator = learned


# standard deviations of a target: at 0.5 % a prediction may be off by a tenth of one, however small it is
SMALL_TARGET_FLOOR_SD = 20.0


def agreement(
    predicted: Mapping[str, tuple[float, float]], recomputed: Mapping[str, float], sigma: Mapping[str, float]
) -> tuple[float, str | None]:
    """Largest |predicted − recomputed| / max(|recomputed|, 20 σ) over the outputs of `sigma` (id → σ), and its id.

    Without the floor, no prediction of a value about zero would ever be good enough.
    """

    def difference(i: str) -> float:
        gap, size = abs(predicted[i][0] - recomputed[i]), max(abs(recomputed[i]), SMALL_TARGET_FLOOR_SD * sigma[i])
        return gap / size if size > 0 else (math.inf if gap > 0 else 0.0)

    gaps = {i: difference(i) for i in sigma}
    worst = max(gaps, key=lambda i: gaps[i], default=None)
    return (0.0, None) if worst is None else (gaps[worst], worst)
