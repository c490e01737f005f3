"""Stated dimensions whose uncertainty a study may state: knobs that are an error of something measured on the bench."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from rso.contract import Backend, Gauges, PlausibleRanges, capability


def dimension_errors(
    backend: Backend, settings: Mapping[str, Any], given: Collection[str] = ()
) -> dict[str, tuple[str, float]]:
    """Knob → how it is measured, in words, and the standard uncertainty of that, in the knob's unit.

    An error of what is stated is zero unless it is said, may have both signs, and is the same in all tests.
    """
    gauges, ranges = capability(backend, Gauges), capability(backend, PlausibleRanges)
    if gauges is None:
        return {}
    plausible = {} if ranges is None else ranges.plausible(settings, given)
    found = {}
    for p in backend.parameters:
        low, high = plausible.get(p.name, p.plausible) or (0.0, 0.0)
        if p.default == 0.0 and p.scope == "study" and low < 0.0 < high and p.name in gauges.gauges(settings):
            found[p.name] = gauges.gauges(settings)[p.name]
    return found
