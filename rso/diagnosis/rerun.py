"""The finalist computed anew at its found size: how far the library's interpolation was off."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rso.diagnosis.hypotheses import Hypothesis
from rso.diagnosis.library import FORCES, Library, _asked, _task
from rso.diagnosis.mixture import Posterior
from rso.diagnosis.nodes import timed
from rso.running import Task
from rso.store import Done


def rerun(
    library: Library, chosen: Hypothesis, post: Posterior, run: Callable[[Sequence[Task]], list[Any]]
) -> dict[str, Any]:
    """Loading runs at every place with the median parameters: largest and root mean square deviation over Fz.

    Failed runs are counted, never taken for an answer.
    """
    effects = chosen.effects
    base, d = library.base, len(library.base.axes)
    at = np.median(post.at, axis=0)
    tasks, expected = [], []
    for k in range(len(library.plan.places)):
        speeds = sorted({t.speed for t in library.plan.tests if t.place == k})[:1]
        for v in speeds:
            values, settings, change, column = base.values(at[:d]), {}, 0.0, d
            for e in effects:
                mine = at[column : column + len(e.knobs)]
                column += len(e.knobs)
                for size, s in zip(e.knobs, mine, strict=True):
                    if size.name in {p.name for p in base.backend.parameters}:
                        value = float(size.value(s)) * base.reference**size.exponent
                        values[size.name] = value * (v if timed(size) else 1.0)
                settings |= dict(e.settings)
                change = change + library.change(k, e, mine[None], v)[0][0, 0]
            f = library.forces(k, at[None, :d])[0]
            tasks.append(_task(base, library.plan, k, values, None, settings))
            expected.append((k, f + f[2:] * change))
    deviations, failed = [], 0
    for (k, F), o in zip(expected, run(tasks), strict=True):
        if not isinstance(o, Done):
            failed += 1
            continue
        travel, got = _asked(o.response, base.reference)
        u = library.places[k].u
        want = np.stack([np.interp(travel, u, F[c]) for c in range(len(FORCES))], 1)
        use = travel > 0.15 * travel.max()
        deviations.append(((want - got) / got[:, 2:])[use])
    if not deviations:
        return {"runs": len(tasks), "failed": failed, "largest": None, "rms": None}
    all_of = np.concatenate(deviations)
    return {"runs": len(tasks), "failed": failed, "largest": float(np.abs(all_of).max()),
            "rms": float(np.sqrt(np.mean(all_of[:, 2] ** 2)))}  # fmt: skip
