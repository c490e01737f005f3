"""Which simulations a library is made of: the base model and every effect at their nodes, at every place."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rso.contract import run_key
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.interpolation import Nodes, nodes
from rso.discrepancy.library.simulations import Base, LibraryJob, Pass, jobs_of, knobs_at, passes, rated, task_of
from rso.discrepancy.library.test_plan import Test, TestPlan

BASE_NODES = {1: 6, 2: 4}  # per base axis, by the number of axes
FEW_BASE_NODES = {1: 3, 2: 3}  # where the ratio to the primary place is enough


@dataclass(frozen=True, eq=False)
class LibraryFrame:
    """What is known of a library before any simulation.

    The place where most was measured, slowest and fastest speed (mm/s), nodes of the base there and elsewhere, the
    ways of the indenter at each place, and whether the base model depends on the rate.
    """

    primary: int
    speeds: tuple[float, float]
    levels: tuple[np.ndarray, ...]
    few: tuple[np.ndarray, ...]
    every: tuple[tuple[Pass, ...], ...]
    by_rate: bool


@dataclass(frozen=True, eq=False)
class Sizes:
    """What the base model's runs show of each place (n_places,): whether they are costly, and the body pushed aside."""

    dear: np.ndarray
    aside: np.ndarray


def framed(base: Base, plan: TestPlan) -> LibraryFrame:
    """The frame of a library; ValueError for a base model that cannot have one."""
    d = len(base.simulated)
    if d not in (0, *BASE_NODES):
        held = f" (what stays where the modulus moves, {', '.join(base.held)}, counts as one)" if base.held else ""
        raise ValueError(f"diagnosis handles at most two open parameters besides the modulus, not {d}{held}: fix some")
    by_rate = rated(base, plan)
    if by_rate and any(t.held.any() or round(np.log(t.speed), 1) != 0.0 for t in plan.tests):
        raise ValueError(
            "the base model has more than one share and time of relaxation among the parameters. Tests with a "
            "hold, or at another speed than 1 mm/s, cannot be diagnosed with it. Open one share and its time, or "
            "none: the diagnosis looks for relaxation itself"
        )
    # rounded: data sets recorded with the same nominal speeds share their library
    slowest, fastest = (float(f"{v([t.speed for t in plan.tests]):.2g}") for v in (min, max))
    judged = plan.seen().tests or plan.tests
    return LibraryFrame(
        int(np.argmax([sum(_pressed(t) for t in judged if t.place == k) for k in range(len(plan.places))])),
        (slowest, fastest),
        tuple(_chebyshev(*a.ends, BASE_NODES[d]) for a in base.simulated),
        tuple(_chebyshev(*a.ends, FEW_BASE_NODES[d]) for a in base.simulated),
        tuple(passes(plan, k) for k in range(len(plan.places))),
        by_rate,
    )


def _pressed(test: Test) -> int:
    """Bins of a test while it pressed: how many lie in the air is chance, and data sets of one plan share a library."""
    return int(np.sum(test.depth > 0.0))


def planned_simulations(base: Base, plan: TestPlan, effects: Sequence[Effect]) -> list[LibraryJob]:
    """Different simulations that a library asks for at most; fewer where runs at a place turn out to be costly.

    Raises ValueError for a base model that cannot have one.
    """
    frame, anywhere = framed(base, plan), np.ones(len(plan.places), bool)
    modelled = simulated_effects(base, effects)
    jobs = jobs_of_base(base, plan, frame)
    jobs += jobs_of_effects(base, plan, modelled, frame, Sizes(~anywhere, anywhere))[1]
    return list({key_of(base, j): j for j in reversed(jobs)}.values())[::-1]


def simulated_effects(base: Base, effects: Sequence[Effect]) -> list[Effect]:
    """Effects of the model, and what relaxes in the base model: their changes are simulated."""
    return [*([base.relaxing.effect] if base.relaxing else []), *(e for e in effects if e.family == "model")]


def key_of(base: Base, job: LibraryJob) -> str:
    """Equal for jobs that are the same simulation."""
    return run_key(base.backend, *base.backend.canonical(job.task.values, job.task.case))


def jobs_of_base(base: Base, plan: TestPlan, frame: LibraryFrame) -> list[LibraryJob]:
    """Runs of the base model at every place."""
    jobs = []
    for k, ways in enumerate(frame.every):
        levels = frame.levels if k == frame.primary else frame.few
        jobs += _of_base(base, plan, k, itertools.product(*levels), ways, frame.by_rate)
    return jobs


def jobs_of_effects(
    base: Base, plan: TestPlan, modelled: Sequence[Effect], frame: LibraryFrame, sizes: Sizes
) -> tuple[dict[tuple[str, int], Nodes], list[LibraryJob], set[str]]:
    """Nodes of every effect at every place, their runs, and effects of the contact whose way matters."""
    grid: dict[tuple[str, int], Nodes] = {}
    jobs: list[LibraryJob] = []
    rubbing = set()
    alone = len(plan.places) == 1
    for e, k in itertools.product(modelled, range(len(plan.places))):
        grid[e.name, k] = nodes(e, k == frame.primary, frame.speeds, sizes.dear[k], alone)
        if not e.acts(plan.places[k].settings):
            continue
        all_of_it = not _supports(e) or alone or sizes.aside[k]
        for n, at in enumerate(grid[e.name, k].points):
            if not (all_of_it or grid[e.name, k].middling[n]):
                continue
            values = {**base.values(base.centre), **knobs_at(base, e, at)}
            mine = jobs_of(base, plan, k, e, n, values, frame.every[k], by_rate=frame.by_rate)
            if _rubs(e, mine):
                rubbing.add(e.name)
            jobs += mine
    return grid, jobs, rubbing


def _of_base(
    base: Base, plan: TestPlan, k: int, nodes: Iterable[Sequence[float]], ways: Sequence[Pass], by_rate: bool
) -> list[LibraryJob]:
    """Runs of the base model at place k: its nodes, its centre on every way that matters, and on the study's mesh."""
    jobs = [LibraryJob(k, None, n, None, task_of(base, plan, k, base.values(x), None, {})) for n, x in enumerate(nodes)]
    centre = base.values(base.centre)
    jobs.append(LibraryJob(k, None, -1, None, task_of(base, plan, k, centre, None, {})))
    each = jobs_of(base, plan, k, None, -1, centre, ways, by_rate=by_rate)
    jobs += each if len(each) > 1 else []
    return [*jobs, LibraryJob(k, None, -1, None, task_of(base, plan, k, centre, None, {}, finer=True), True)]


def _rubs(effect: Effect, jobs: Sequence[LibraryJob]) -> bool:
    """Whether an effect is one of the contact whose way matters, all in one size, such as friction."""
    plain = not effect.settings and not effect.shape and effect.size.neutral is not None
    return plain and len(effect.size.ends()) == 1 and jobs[0].passing is not None


def _supports(effect: Effect) -> bool:
    """Whether an effect is another support with shapes, such as its friction.

    They decide whether a body that is pushed aside slides there or sticks; pressed straight down it does neither.
    """
    return bool(effect.settings) and bool(effect.shape)


def _chebyshev(low: float, high: float, n: int) -> np.ndarray:
    """Nodes from end to end, denser towards the ends."""
    return 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * np.arange(n) / (n - 1))
