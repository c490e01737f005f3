"""What the fitted curves say of the base model by itself: the likelihood of `rso run`, on the library of a diagnosis.

A diagnosis allows for more than a fit does: another program, effects that nobody sees.  Its base model, asked alone,
has to say what `rso run`, `rso ladder` and `rso next` say of the same curves, so it is asked with the same readings,
the same errors (:mod:`rso.inference.error_model`), and the same intervals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rso.calibration.readings import as_data
from rso.contract.responses import FORCE_CHANNELS
from rso.data import combine
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.tables import Library
from rso.discrepancy.library.test_plan import LOADING_BRANCH, Test
from rso.doe import Box
from rso.inference import (
    Data,
    Determination,
    Misfit,
    Model,
    ModelErrors,
    all_minima,
    determine,
    with_autocorrelation,
    with_model_errors,
)
from rso.inference.error_model import shares
from rso.inference.rules import RULES
from rso.inference.verdict import physical
from rso.study.schema import Study


def base_model(study: Study, library: Library, box: Box | None) -> Determination | None:
    """What the loading curves with role "fit" determine of the open parameters in the ranges of the study.

    None where nothing is open, there is no such curve, or readings and their errors allow no likelihood.
    """
    curves = fitted_tests(study, library)
    if not curves or box is None:
        return None
    there = replace(library, plan=replace(library.plan, tests=tuple(t for t, _ in curves), profiles=()))
    misfit = Misfit(Model(box, lambda X: _predicted(there, box, X)), tuple(d for _, d in curves))
    try:
        x = all_minima(misfit, seed=study.study.seed)[0].x
        predicted = np.split(misfit.model.predict(x[None])[0], np.cumsum([len(d.value) for _, d in curves])[:-1])
        errors = [ModelErrors(_numerical(there, t, f)) for (t, _), f in zip(curves, predicted, strict=True)]
        data = tuple(with_model_errors(d, e) for (_, d), e in zip(curves, errors, strict=True))
        misfit = with_autocorrelation(replace(misfit, data=data), x)
        return determine(misfit, seed=study.study.seed, near=x[None], mcmc=False)
    except (ValueError, np.linalg.LinAlgError):
        return None


def fitted_tests(study: Study, library: Library) -> list[tuple[Test, Data]]:
    """Loading of every compared force that is fitted: as a test of one channel at the depths of the readings, and with
    the errors of the measurement."""
    found = []
    numbers = {e.name: k for k, e in enumerate(library.plan.experiments)}
    for e in study.experiments:
        like = next((t for t in library.plan.tests if t.experiment == numbers.get(e.name)), None)
        if e.role != "fit" or e.kind != "force" or like is None:
            continue
        for channel in e.compared:
            curve = combine(study.measurement(e.name), study.noise_of(e.name), channel)
            keep = curve.depth > 0.0
            data = as_data(e.name if len(e.compared) == 1 else f"{e.name} {channel}", e.name, curve, keep)
            n = len(data.depth)
            test = replace(
                like,
                label=data.name,
                channels=(channel,),
                depth=data.depth,
                time=data.depth / like.speed,
                branch=np.full(n, LOADING_BRANCH),
                count=np.ones(n),
                values={channel: data.value},
                since=np.zeros(n),
            )
            found.append((test, data))
    return found


def _predicted(library: Library, box: Box, X: np.ndarray) -> np.ndarray:
    """Curves (k, n) of the base model at X (k, d) of the unit cube of the study's ranges."""
    base, theta = library.base, box.from_unit(X)
    value = dict(zip(box.names, theta.T, strict=True))
    modulus = value.get(base.modulus, np.full(len(X), base.low))  # where it is fixed the ends are one
    at = [a.coordinate(value[a.name], modulus) for a in base.axes]
    x = np.stack(at, axis=1) if at else np.zeros((len(X), 0))
    A, c = predict(library, (), x, base.reference)
    return modulus[:, None] * A + c


def _numerical(library: Library, test: Test, f: np.ndarray) -> np.ndarray:
    """Estimated numerical error (n,) of a predicted force f (n,): of Fz as stated, of lateral ones over the largest."""
    here, (channel,) = library.places[test.place], test.channels
    share = np.interp(test.depth, here.u, here.error[FORCE_CHANNELS.index(channel)])
    size = np.abs(f) if channel == "Fz" else np.full(len(f), float(np.abs(f).max()))
    return share * size


def base_model_block(d: Determination | None) -> dict[str, Any] | None:
    """The `base_model` of diagnosis.json."""
    if d is None:
        return None
    box = d.misfit.model.box
    return {
        "chi2": d.fit.chi2,
        "degrees": d.degrees,
        "p_value": d.p_value,
        "scale": d.scale,
        "story": d.story,
        "errors": {v.name: shares(v) for v in d.misfit.data},
        "parameters": {
            known.name: {
                "value": known.value,
                "interval": list(physical(box, k, known.profile_interval)),
                "sd_log": known.sd_log,
                "verdict": known.verdict.word,
                "story": known.story,
            }
            for k, known in enumerate(d.known)
        },
    }


def base_model_sentence(found: Mapping[str, Any] | None, gap: bool = False) -> list[str]:
    """What the fit alone says, beside what a diagnosis allows for, and why it may agree where there is a `gap`."""
    if not found:
        return []
    stories: Sequence[str] = [v["story"] for v in found["parameters"].values()]
    agrees = gap and found["p_value"] is not None and found["p_value"] > RULES.undecided_fit_chance
    within = (
        "This fit compares loading alone and counts all errors of a test in full; the gap above may be smaller, or in "
        "other readings. "
        if agrees
        else ""
    )
    return [
        f"Fit of the base model alone, over the ranges of the study file. {found['story']} {within}{' '.join(stories)} "
        "A diagnosis also allows for model-form error and for effects that the data do not exclude."
    ]
