"""`[search] method = "gauss_newton"`: parameters identified straight on simulations, with their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rso.calibration.confirmed_optimum import ConfirmedOptimum, fitted_readings, searched_ranges
from rso.calibration.identification_stage import Identified
from rso.calibration.plan import PROOF_MODULUS_RATIO, Plan
from rso.calibration.readings import of_response
from rso.calibration.stages import MAX_TOLD_REASONS, SIMILARITY_TOLERANCE, NothingToFit, Proof, Run, Runner
from rso.core.similarity import Group
from rso.doe import sobol_sequence
from rso.evaluation import Done, Outcome, why
from rso.inference import (
    CurvePlace,
    Data,
    Determination,
    EvaluatedPoint,
    GaussNewtonFit,
    Misfit,
    TangentFrame,
    determine,
    on_runs,
    resample,
    tangents,
    with_autocorrelation,
    with_model_errors,
    with_usual,
)
from rso.inference import levenberg_marquardt as descend_along
from rso.inference.gauss_newton import RUN_POINT_DIGITS, chi2_in_frame
from rso.inference.models import RUN_DIFFERENCE_STEP
from rso.study.errors import Problem, study_error

# relative imbalance of derivatives that still agree with similarity: a solver's are not exact
SIMILARITY_IMBALANCE_TOLERANCE = 1e-5
# rounds of runs at the ends of intervals; an end so close to a run (unit cube) needs none
MAX_DESCENT_END_ROUNDS, END_NEARBY_DISTANCE = 3, 0.05


@dataclass(frozen=True, eq=False)
class GaussNewtonRun:
    """All descents, the best of them, what was run for them, and the model that the runs and their derivatives make.

    `first` is the best before it went on under the errors of uncertain inputs, which the other descents know nothing
    of.
    """

    frame: TangentFrame
    descents: tuple[GaussNewtonFit, ...]
    best: GaussNewtonFit
    runs: tuple[Run, ...]
    proofs: tuple[Proof, ...]
    similarity: str
    places: tuple[CurvePlace, ...]
    data: tuple[Data, ...]
    outcomes: tuple[Outcome, ...]
    eyes: _Eyes
    first: GaussNewtonFit

    def likeliest(self) -> dict[str, float]:
        """Values of the best run, fixed ones included; there is one."""
        assert self.best.best is not None
        return self.eyes.values(self.best.best.x)


@dataclass(eq=False)
class _Eyes:
    """Looks at points of the ranges: runs, and what they say of curves and slopes; keeps what was seen."""

    bench: Runner
    frame: TangentFrame
    places: tuple[CurvePlace, ...]
    curves: tuple[Data, ...]
    heard: Callable[[dict[str, float], float], None]
    differenced: tuple[str, ...] | None = None  # parameters without derivatives; None before anything was seen
    runs: list[Run] = field(default_factory=list)
    outcomes: dict[bytes, tuple[Outcome, ...]] = field(default_factory=dict)

    def values(self, x: np.ndarray) -> dict[str, float]:
        box = self.frame.box
        return {**dict(zip(box.names, map(float, box.from_unit(x)), strict=True)), **self.bench.plan.resolved.fixed}

    def look(self, X: Sequence[np.ndarray], purpose: str = "iterate") -> list[EvaluatedPoint | None]:
        """What runs at X say, with the runs for differences where the backend gives no derivatives."""
        if self.differenced is None:
            self._run(X, purpose)
            done = [o for x in X if _done(o := self.outcomes[x.tobytes()])]
            if not done:
                return [None] * len(X)
            self.differenced = self._without_derivatives(done[0])
        beside = [y for x in X for y in self._beside(x)]
        self._run([*X, *beside], purpose, len(X))
        sights = [self._sight(x) for x in X]
        for sight in sights if purpose == "iterate" else ():
            if sight is not None:
                self.heard(self.values(sight.x), chi2_in_frame(self.data(sight), sight.f, self.frame))
        return sights

    def _run(self, X: Sequence[np.ndarray], purpose: str, first: int | None = None) -> None:
        """Run what was not seen; from the `first`-th on for differences."""
        named = [(x, purpose if first is None or k < first else "difference") for k, x in enumerate(X)]
        new = {x.tobytes(): (x, what) for x, what in named if x.tobytes() not in self.outcomes}
        points = [self.values(x) for x, _ in new.values()]
        for (x, what), v, o in zip(new.values(), points, self.bench.run(points) if points else [], strict=True):
            self.outcomes[x.tobytes()] = o
            self.runs.append(Run(what, v, o))

    def _beside(self, x: np.ndarray) -> list[np.ndarray]:
        """A point beside x along every parameter that has no derivatives, towards the middle of its range."""
        assert self.differenced is not None
        columns = [self.frame.box.names.index(n) for n in self.differenced if n != self.frame.group.reference]
        return [x + RUN_DIFFERENCE_STEP * (1.0 if x[k] <= 0.5 else -1.0) * np.eye(len(x))[k] for k in columns]

    def _without_derivatives(self, outcomes: tuple[Outcome, ...]) -> tuple[str, ...]:
        """Parameters by which the runs have no derivatives, which differences then give; StudyError where the study
        says that it wants the backend's own."""
        plan, box = self.bench.plan, self.frame.box
        answers = [(p, _response(outcomes[plan.case_of[p.experiment]])) for p in self.places]
        lack = {n: p for n in box.names for p, r in answers if set(p.channels) - set(r.gradients.get(n, {}))}
        table = plan.study.search
        if lack and table.derivatives == "backend" and "derivatives" in table.model_fields_set:
            each = ", ".join(f"{p.channel} of {p.experiment!r} by {n}" for n, p in lack.items())
            text = (
                f"the backend {plan.backend.name} gives no derivatives of {each}; choose search.derivatives = "
                '"differences" (that many runs more for each point) or method = "response_surface"'
            )
            raise study_error(plan.study.file, plan.study.lines, [Problem(("search", "method"), text, "gauss_newton")])
        return tuple(lack)

    def _sight(self, x: np.ndarray) -> EvaluatedPoint | None:
        """Curves and slopes; None where a run that is needed has no answer."""
        plan, frame, outcomes = self.bench.plan, self.frame, self.outcomes[x.tobytes()]
        beside = {n: y for n, y in zip(self._wanted(), self._beside(x), strict=True)}
        if not all(_done(self.outcomes[y.tobytes()]) for y in (x, *beside.values())):
            return None
        f, theta = self._curve(outcomes), frame.box.from_unit(x)
        columns: dict[str, np.ndarray] = {}
        for k, n in enumerate(frame.box.names):
            if n in beside:
                moved = frame.box.from_unit(beside[n])[k]
                columns[n] = (self._curve(self.outcomes[beside[n].tobytes()]) - f) / (moved - theta[k])
            elif n not in (self.differenced or ()):
                parts = [resample(_response(outcomes[plan.case_of[p.experiment]]), p, n) for p in self.places]
                columns[n] = np.concatenate(parts)
        reference, e = frame.group.reference, frame.group.exponents
        if reference is not None and reference not in columns:  # Euler: Σ e_k θ_k ∂f/∂θ_k = e f
            value = dict(zip(frame.box.names, theta, strict=True))
            others = sum((e[n] * value[n] * g for n, g in columns.items()), np.zeros_like(f))
            columns[reference] = (frame.powers * f - others) / value[reference]
        return EvaluatedPoint(x, f, np.stack([columns[n] for n in frame.box.names], axis=1))

    def _wanted(self) -> list[str]:
        return [n for n in self.differenced or () if n != self.frame.group.reference]

    def _curve(self, outcomes: tuple[Outcome, ...]) -> np.ndarray:
        case_of = self.bench.plan.case_of
        return np.concatenate([resample(_response(outcomes[case_of[p.experiment]]), p, "") for p in self.places])

    def data(self, sight: EvaluatedPoint) -> tuple[Data, ...]:
        """The measured curves with the numerical error of this run."""
        outcomes, case_of = self.outcomes[sight.x.tobytes()], self.bench.plan.case_of
        answers = [_response(outcomes[case_of[p.experiment]]) for p in self.places]
        return tuple(
            with_model_errors(d, of_response(r, p, d.value))
            for p, d, r in zip(self.places, self.curves, answers, strict=True)
        )


def run_gauss_newton(
    bench: Runner, heard: Callable[[dict[str, float], float], None] = lambda theta, chi2: None
) -> GaussNewtonRun:
    """Every descent that `[search]` asks for; StudyError without derivatives, NothingToFit without any answer.

    `heard` is called with the values and the χ² of every iterate that has an answer.
    """
    plan = bench.plan
    table = plan.study.search
    places, curves = zip(*fitted_readings(plan), strict=True)
    powers = np.concatenate([np.full(len(p.depth), plan.group.outputs[p.channel]) for p in places])
    eyes = _Eyes(bench, TangentFrame(searched_ranges(plan), plan.group, powers), places, curves, heard)
    starts = starting_points(plan)
    proofs, story = _proved(eyes, _first(eyes, starts, table.max_runs))
    found = on_runs(
        eyes.frame,
        eyes.look,
        eyes.data,
        starts,
        tolerance=plan.study.verify.tolerance,
        most=table.max_runs,
        seed=plan.seed,
    )
    good = [d for d in found if d.best is not None]
    if not good:
        lost = [why(o)[1] or "" for r in eyes.runs for o in r.outcomes if not isinstance(o, Done)]
        shown = "; ".join(list(dict.fromkeys(lost))[:MAX_TOLD_REASONS])
        raise NothingToFit(f"no run from which a descent could start is done ({len(eyes.runs)} tried: {shown})")
    best = min(good, key=lambda d: (not d.confirmed, d.chi2))
    assert best.best is not None
    return GaussNewtonRun(
        eyes.frame,
        tuple(found),
        best,
        tuple(eyes.runs),
        proofs,
        story,
        places,
        best.data,
        eyes.outcomes[best.best.x.tobytes()],
        eyes,
        best,
    )


def with_uncertain_inputs(bench: Runner, found: GaussNewtonRun) -> GaussNewtonRun:
    """The descent gone on with from its best run, under errors that hold what uncertain inputs make of the curves.

    The same where the plan knows of no such effect.
    """
    plan, first = bench.plan, found.best.best
    if not plan.effects or first is None:
        return found
    eyes = replace(found.eyes, bench=bench, curves=tuple(d for _, d in fitted_readings(plan)))
    table = plan.study.search
    (last,) = on_runs(
        eyes.frame,
        eyes.look,
        eyes.data,
        first.x[None],
        tolerance=plan.study.verify.tolerance,
        most=table.max_runs,
        seed=plan.seed,
    )
    assert last.best is not None  # it starts from a run that has an answer
    whole = replace(last, iterates=(*found.best.iterates, *last.iterates))
    return replace(
        found,
        descents=tuple(whole if d is found.best else d for d in found.descents),
        best=whole,
        runs=tuple(eyes.runs),
        data=last.data,
        outcomes=eyes.outcomes[last.best.x.tobytes()],
        eyes=eyes,
    )


def starting_points(plan: Plan) -> np.ndarray:
    """Starts (k, d) in the unit cube of the ranges: what the study says (else the middle), then Sobol points."""
    box = searched_ranges(plan)
    middle = dict(zip(box.names, box.from_unit(np.full(box.d, 0.5)), strict=True))
    first = box.to_unit(np.array([{**middle, **plan.resolved.start}[n] for n in box.names]))
    return np.vstack([first, sobol_sequence(box.d, max(plan.study.search.starts - 1, 1), plan.seed)])[
        : plan.study.search.starts
    ]


def _first(eyes: _Eyes, starts: np.ndarray, most: int) -> EvaluatedPoint | None:
    """The first start with an answer, or what :func:`~rso.inference.on_runs` takes in its place."""
    seen = next((s for s in eyes.look(list(starts)) if s is not None), None)
    for x in sobol_sequence(eyes.frame.box.d, 256, eyes.bench.plan.seed)[: most - 1]:
        if seen is not None:
            break
        (seen,) = eyes.look([x])
    return seen


def _proved(eyes: _Eyes, sight: EvaluatedPoint | None) -> tuple[tuple[Proof, ...], str]:
    """Similarity put to the test, on the derivatives of a run or on a second one; it is dropped where it fails."""
    frame, group = eyes.frame, eyes.frame.group
    if group.reference is None or sight is None:
        return (), group.why
    if group.reference not in (eyes.differenced or ()):
        off = frame.imbalance(sight)
        if off <= SIMILARITY_IMBALANCE_TOLERANCE:
            return (), f"{group.why}; the derivatives of the first run agree with it to {off:.1e} (Euler's relation)"
        _drop(eyes, f"not applied: the derivatives of the first run contradict it by {off:.1e} of the curve")
        return (), eyes.frame.group.why
    proof = _second(eyes, sight)
    if proof is None or proof.relative_difference is None:
        _drop(eyes, "not applied: no second run could prove it")
    elif proof.relative_difference > SIMILARITY_TOLERANCE:
        _drop(eyes, f"not applied: two runs differ by {proof.relative_difference:.1e}; the backend is not similar")
    return (() if proof is None else (proof,)), eyes.frame.group.why


def _drop(eyes: _Eyes, reason: str) -> None:
    none: Group = replace(eyes.frame.group, reference=None, why=reason)
    eyes.frame = replace(eyes.frame, group=none)


def _second(eyes: _Eyes, sight: EvaluatedPoint) -> Proof | None:
    """The run that similarity says is the first one scaled; None where the ranges leave no room for it."""
    frame, box, reference = eyes.frame, eyes.frame.box, eyes.frame.group.reference
    assert reference is not None  # there is a similarity to prove
    theta = dict(zip(box.names, box.from_unit(sight.x), strict=True))
    for q in (PROOF_MODULUS_RATIO, 1 / PROOF_MODULUS_RATIO, PROOF_MODULUS_RATIO**0.25, PROOF_MODULUS_RATIO**-0.25):
        moved = {n: v * q ** frame.group.exponents.get(n, 0) for n, v in theta.items()}
        row = np.array([moved[n] for n in box.names])
        if not box.contains(row, 0.0):
            continue
        x = box.to_unit(row)
        eyes._run([x], "proof")
        outcomes = eyes.outcomes[x.tobytes()]
        if not _done(outcomes):
            return Proof(eyes.values(x), None, None, None)
        q_exact = box.from_unit(x)[box.names.index(reference)] / theta[reference]
        direct, similar = eyes._curve(outcomes), sight.f * q_exact**frame.powers
        k = int(np.argmax(np.abs(direct)))
        off = float(np.abs(direct - similar).max() / abs(direct[k]))
        return Proof(eyes.values(x), float(direct[k]), float(similar[k]), off)
    return None


def identify_from_derivatives(plan: Plan, found: GaussNewtonRun) -> tuple[Identified, ConfirmedOptimum]:
    """What the curves determine, by the derivatives of the best run and what all of them say together.

    Where an interval ends far from every run, the model is run there too: a tangent is not believed that far.
    """
    best, eyes, runs = found.best.best, found.eyes, tuple(found.eyes.runs)
    assert best is not None
    known = [i.sight for d in found.descents for i in d.iterates if i.sight is not None]
    tried = [found.frame.reduced(i.x[None])[1][0] for d in found.descents for i in d.iterates]
    for k in range(MAX_DESCENT_END_ROUNDS + 1):
        misfit = with_autocorrelation(Misfit(tangents(found.frame, known, best), found.data), best.x)
        d: Determination = determine(misfit, seed=plan.seed, near=best.x[None], mcmc=False)
        ends = [] if k == MAX_DESCENT_END_ROUNDS else _ends(found.frame, misfit, d, tried, bool(plan.effects))
        if not ends:
            break
        known += [s for s in eyes.look(ends, "interval") if s is not None]
    d = with_usual(d, plan.seed)
    gap = found.best.gap if found.best.gap is not None or not found.best.confirmed else 0.0
    extra, good = tuple(eyes.runs[len(runs) :]), gap is not None and gap <= plan.study.verify.tolerance
    return Identified(found.places, d, {}, {}), ConfirmedOptimum(None, extra, gap, found.best.chi2, good)  # type: ignore[arg-type]


def _ends(
    frame: TangentFrame, misfit: Misfit, d: Determination, tried: list[np.ndarray], alone: bool
) -> list[np.ndarray]:
    """Points (d,) where an interval ends, the other parameters following, and nothing was tried near (noted then).

    With `alone` ends by the information of the best run alone count too: a descent that went on has runs close
    together, and what they say of the bend between them may end an interval early.
    """
    found = []
    for k, known in enumerate(d.known):
        ends = (known.laplace.low, known.laplace.high) if alone else ()
        wide = [min(max(v, 0.0), 1.0) for v in ends]
        for at in (known.profile_interval.low, known.profile_interval.high, *wide):
            start = np.where(np.arange(len(d.fit.x)) == k, at, d.fit.x)
            x = descend_along(misfit, start[None], np.arange(len(start)) != k)[0]
            x = np.clip(np.round(x, RUN_POINT_DIGITS), 0.0, 1.0)
            z = frame.reduced(x[None])[1][0]
            if min(float(np.abs(z - t).max(initial=0.0)) for t in tried) > END_NEARBY_DISTANCE:
                tried.append(z)
                found.append(x)
    return found


def _done(outcomes: tuple[Outcome, ...]) -> bool:
    return all(isinstance(o, Done) for o in outcomes)


def _response(outcome: Outcome) -> Any:
    assert isinstance(outcome, Done)
    return outcome.response
