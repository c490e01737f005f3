"""[objectives] of a study: what is to be small or large, and what must stay within limits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from rso.core.quantities import Limits, OutputQuantity, read_limits, read_quantity
from rso.study.base_table import StudyFileTable
from rso.study.fields import Depth, list_to_tuple

MAX_OBJECTIVES = 4  # objectives: a front of more is no picture, and nearly every design stands on it


def _each(read: Callable[[str], Any]) -> AfterValidator:
    def check(texts: tuple[str, ...]) -> tuple[str, ...]:
        for text in texts:
            read(text)
        return texts

    return AfterValidator(check)


Quantities = Annotated[tuple[str, ...], BeforeValidator(list_to_tuple), _each(read_quantity)]
LimitTexts = Annotated[tuple[str, ...], BeforeValidator(list_to_tuple), _each(read_limits)]


class ObjectivesTable(StudyFileTable):
    """[objectives]: of a study without measurements, what is to be small or large and what must stay within limits.

    An output is named as `cost`.  Of a curve stress(1.2) is its value at an abscissa.  Its max(stress), min, max_abs,
    mean, integral, argmax, argmin, first and last are what they say, also between two abscissae: integral(force, 0, 5).
    """

    minimise: Quantities = ()
    """Outputs that are to be small."""
    maximise: Quantities = ()
    """Outputs that are to be large."""
    constraints: LimitTexts = ()
    """Limits of outputs, such as "max(stress) <= 250 MPa" or "0.1 <= gap <= 0.3"."""
    travel: Annotated[tuple[Depth, ...], BeforeValidator(list_to_tuple)] | None = Field(
        default=None,
        description="Of a model with an indenter: the travels at which its channels are asked for; these are curves "
        "over travel then. Without it nothing is moved and a channel is one number.",
    )

    @model_validator(mode="after")
    def _something(self) -> ObjectivesTable:
        every = [*self.minimise, *self.maximise]
        if not every:
            raise ValueError('give minimise = ["cost"] or maximise = ["stiffness"]')
        if len(every) > MAX_OBJECTIVES:
            raise ValueError(
                f"{len(every)} objectives: at most {MAX_OBJECTIVES}; state limits for the others (constraints)"
            )
        if twice := [v for k, v in enumerate(every) if v in every[:k]]:
            raise ValueError(f"{twice[0]!r} is listed twice")
        if self.travel is not None and list(self.travel) != sorted(set(self.travel)):
            raise ValueError("travel must increase")
        return self

    def goals(self) -> list[tuple[OutputQuantity, bool]]:
        """Objectives in the order of the file, and whether each is to be small."""
        return [(read_quantity(t), small) for small, g in ((True, self.minimise), (False, self.maximise)) for t in g]

    def limits(self) -> list[Limits]:
        """The limits of outputs."""
        return [read_limits(t) for t in self.constraints]
