"""Plans of all specimens: every problem of any of them at once, and simulations that they can share."""

from __future__ import annotations

from collections.abc import Sequence

from rso.calibration.plan import Plan, make_plan
from rso.contract import Backend, digest
from rso.study.cases import N_CURVE_TRAVELS, travels
from rso.study.errors import StudyError
from rso.study.specimens import SpecimenStudies, together

# of the deepest: specimens pressed at least so deep are computed through the same travels
SHARED_TRAVELS_DEPTH_SHARE = 0.8


def specimen_plans(found: SpecimenStudies, backend: Backend | None = None) -> list[Plan]:
    """The plan of each specimen; StudyError with all that the backend or the data of any of them do not allow.

    Specimens of one geometry that were pressed about as deep are computed through the same travels, so that a run of
    one is a run of all: with the same values it has the same key.
    """
    plans: list[Plan] = []
    wrong: dict[str, list[str]] = {}
    for study in found.studies:
        try:
            known = plans[0].backend if plans and study.backend.template is None else backend  # settings are no part
            plans.append(make_plan(study, backend=known))
        except StudyError as error:
            for line in error.problems:
                wrong.setdefault(line, []).append(study.specimen)
    if wrong:
        raise StudyError(together(wrong, len(found.studies)))
    shared = shared_travels(plans)
    return [make_plan(p.study, backend=p.backend, shared=s) if s else p for p, s in zip(plans, shared, strict=True)]


def shared_travels(plans: Sequence[Plan]) -> list[dict[str, tuple[float, ...]]]:
    """Travels (mm) that experiments of each plan share with those of others, by name.

    Only the way there is shared: holds and unloadings are of one record.
    """
    found: list[dict[str, tuple[float, ...]]] = [{} for _ in plans]
    alike: dict[str, list[tuple[int, str]]] = {}
    for k, plan in enumerate(plans):
        for name in plan.case_of:
            curve = plan.curves[name]
            if name in plan.holds or name in plan.creeps.followed or curve.back or len(curve.depth) < N_CURVE_TRAVELS:
                continue
            alike.setdefault(f"{name} {digest(plan.study.settings_of(name))}", []).append((k, name))
    for group in alike.values():
        deepest = {place: float(plans[place[0]].curves[place[1]].depth.max()) for place in group}
        left = sorted(group, key=lambda place: (-deepest[place], place))
        while left:
            first = left[0]
            near = [place for place in left if deepest[place] >= SHARED_TRAVELS_DEPTH_SHARE * deepest[first]]
            common = travels(plans[first[0]].curves[first[1]], set())
            for k, name in near if len(near) > 1 else []:
                found[k][name] = common
            left = [place for place in left if place not in near]
    return found
