"""Stated dimensions whose uncertainty a study may state: knobs that are an error of something measured on the bench."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rso.contract import Backend, Gauges, Parameter, PlausibleRanges, StatedDimensions, capability

MISREAD_SETTING_ERRORS = (ValueError, TypeError, LookupError, AttributeError)  # what misread settings end in


@dataclass(frozen=True)
class UncertainInput:
    """A stated input: its knob, the standard uncertainty in the knob's unit, and the experiments that share its error,
    () for all."""

    parameter: Parameter
    uncertainty: float
    experiments: tuple[str, ...] = ()

    @property
    def experiment(self) -> str:
        """The experiments in words; empty for all."""
        return ", ".join(self.experiments)

    @property
    def name(self) -> str:
        """Name of the error that it makes."""
        return f"{self.experiment}: {self.parameter.name}" if self.experiment else self.parameter.name


def dimension_errors(
    backend: Backend, settings: Mapping[str, Any], given: Collection[str] = ()
) -> dict[str, tuple[str, float]]:
    """Knob → how it is measured, in words, and the standard uncertainty of that, in the knob's unit.

    An error of what is stated is absent unless it is said and may have both signs.  Which ones these are the backend
    says (`StatedDimensions`); of one that does not, they are zero where absent, and the same in all tests.
    """
    gauges, ranges = capability(backend, Gauges), capability(backend, PlausibleRanges)
    if gauges is None:
        return {}
    plausible = {} if ranges is None else ranges.plausible(settings, given)
    measured, stated = gauges.gauges(settings), stated_dimensions(backend, settings)
    found = {}
    for p in backend.parameters:
        low, high = plausible.get(p.name, p.plausible) or (0.0, 0.0)
        size = p.name in stated if stated is not None else p.default == 0.0 and p.scope == "study"
        if size and p.name in measured and low < _absent(p) < high:
            found[p.name] = measured[p.name]
    return found


def _absent(p: Parameter) -> float:
    """The value of an error of which nothing was said, 0 of a length and 1 of a scale."""
    if p.neutral is not None:
        return p.neutral
    return float("nan") if p.default is None else p.default


def stated_dimensions(backend: Backend, settings: Mapping[str, Any]) -> Mapping[str, float] | None:
    """Knob → the stated size that it is an error of; None of a backend that names none."""
    offered = capability(backend, StatedDimensions)
    return None if offered is None else offered.dimensions(settings)


def dimensions_of_all(backend: Backend, every: Iterable[Mapping[str, Any]], given: Collection[str] = ()) -> list[str]:
    """Errors of dimensions that any of several settings has; settings that cannot be read have none."""
    found: dict[str, None] = {}
    for settings in every:
        try:
            found |= dict.fromkeys(dimension_errors(backend, settings, given))
        except MISREAD_SETTING_ERRORS:
            continue
    return list(found)
