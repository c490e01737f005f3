"""Candidates are rerun by the backend until what was predicted is what comes out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rso.emulator import Emulator, Output
from rso.running import Outcome
from rso.search import Choice
from rso.store import Done


@dataclass(frozen=True, eq=False)
class Candidate:
    """Values, predicted (mean, sd) and recomputed outputs by id, and the largest relative difference of the targets."""

    values: Mapping[str, float]
    predicted: Mapping[str, tuple[float, float]]
    recomputed: Mapping[str, float]
    outcomes: tuple[Outcome, ...]
    agreement: float | None
    verified: bool

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

    A candidate that failed or crashed is not verified and teaches no surrogate; one that failed may teach where not to
    look: `enrich` then returns another emulator of the same samples.  When it returns the same one the loop ends.
    """
    infill = 0
    earlier: list[Candidate] = []
    while True:
        choice = propose(emulator)
        candidates = rerun(emulator, choice)
        wrong = sum(not c.verified for c in candidates)
        learned = enrich(emulator, candidates) if wrong and infill + wrong <= max_infill else emulator
        if learned is emulator:
            return Verified(choice, tuple(candidates), tuple(earlier), infill, emulator)
        earlier += candidates
        infill += len(learned.samples) - len(emulator.samples) + sum(c.state == "failed" for c in candidates)
        emulator = learned


def agreement(
    predicted: Mapping[str, tuple[float, float]], recomputed: Mapping[str, float], ids: Sequence[str]
) -> float:
    """max |predicted − recomputed| / |recomputed| over the outputs `ids`; infinite where 0 was not predicted as 0."""

    def difference(i: str) -> float:
        gap, size = abs(predicted[i][0] - recomputed[i]), abs(recomputed[i])
        return gap / size if size > 0 else (math.inf if gap > 0 else 0.0)

    return max(difference(i) for i in ids)
