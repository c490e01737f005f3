"""Whether the design has as many runs as its surrogates need: said before anything is computed."""

from __future__ import annotations

import numpy as np

from rso import doe, emulation
from rso.calibration.plan import Plan, fe_design
from rso.emulation.emulator import reduced_box
from rso.study.errors import Problem, StudyError, study_error

PLENTY_OF_RUNS_MARGIN = 3  # more runs than twice the terms of a polynomial: that many are never too few
MAX_TRIED_RUNS = 64  # runs up to which it is tried how many are needed


def too_few(plan: Plan) -> StudyError | None:
    """The error of a design with too few runs for its surrogates; None where there are enough, or none is fitted.

    Surrogates of the kind and degree that [surrogate] asks for are fitted to a smooth function at that many points.
    """
    similar = plan.group.reference is not None
    box = reduced_box(plan.box, plan.group) if similar else plan.box
    if box is None or plan.study.search.method == "gauss_newton":
        return None
    n = len(fe_design(plan, similar)[0])
    if (why := _refused(plan, box.d, n)) is None:
        return None
    needed = next((m for m in range(n + 1, MAX_TRIED_RUNS) if _refused(plan, box.d, m) is None), None)
    at_least = f"; at least {needed} are needed" if needed else ""
    what = "parameter" if box.d == 1 else "parameters"
    text = f"{n} runs are too few for surrogates of {box.d} {what} ({why}){at_least}"
    return study_error(plan.study.file, plan.study.lines, [Problem(("doe", "runs"), text)])


def _refused(plan: Plan, d: int, n: int) -> str | None:
    """Why n points of d parameters cannot be fitted; None if they can."""
    table = plan.study.surrogate
    terms = len(emulation.common.monomial_exponents(d, table.degree or 1))
    if n > 2 * terms + PLENTY_OF_RUNS_MARGIN:
        return None
    kind = "auto" if table.kind == "whole_curve" else table.kind
    try:
        X = doe.latin(d, max(n, 2), plan.seed)[:n]
        emulation.fit_surrogate(
            kind, X, 2.0 + X.sum(axis=1) + 0.1 * (X**2).sum(axis=1), seed=plan.seed, degree=table.degree
        )
    except (ValueError, np.linalg.LinAlgError) as error:
        return str(error).partition(";")[0]
    return None
