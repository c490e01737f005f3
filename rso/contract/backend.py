"""What every backend has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from rso.contract.cases import Case
from rso.contract.parameters import Parameter
from rso.contract.responses import Response


@runtime_checkable
class Backend(Protocol):
    """What `rso` needs of a simulator.  `name` and `numerics` enter the run key.

    `numerics` is raised when, and only when, answers change: the package version does not enter the key.  So does
    `fingerprint` where there is one: of foreign backends the loader sets it to the hash of the files they come from.
    """

    name: str
    numerics: int

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every scalar knob."""

    @property
    def channels(self) -> Mapping[str, str]:
        """Name → unit of every channel a response can hold."""

    def check(self, case: Case) -> None:
        """Raise ValueError for settings this backend does not know, naming key, value and choices."""

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Drop what has no influence on the answer: effects at neutral, rates of an elastic body."""

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """Name → recipe of each artefact the case needs; equal recipes mean the same artefact."""

    def make(self, recipe: str) -> bytes:
        """Make one artefact (a mesh) from its recipe; slow, run once, stored by hash."""

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Compute the response, or raise SimulationFailed."""
