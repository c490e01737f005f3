"""A body without end below and beside what presses on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from fem_backend import members
from fem_backend.specimens.flat import ON_PLANE_TOLERANCE, FlatTopped
from fem_backend.specimens.specimen import SPECIMENS

MODELLED_LENGTHS = 400.0  # lengths of the indenter that are modelled, see `HalfSpace`
MODELLED_LENGTHS_IN_SPACE = 200.0  # of a model in three dimensions, see `HalfSpace`
UNKNOWN_INDENTER_LENGTH_MM = 3.0  # length (mm) of the indenter where none is known yet


@SPECIMENS.register
@dataclass(frozen=True)
class HalfSpace(FlatTopped):
    """z ≤ height (mm), held 400 lengths L of the indenter below the top and modelled as far beside it.

    What is beyond would give way by F/(2πμ·400 L), which is 16a/(6π·400 L) of the travel: 0.2 % for a contact of
    radius a = L (Johnson 1985, eq. 3.19, ν = 1/2; Hertz's F = 16 μ a d/3).  A model in three dimensions is
    200 L deep and as wide to each side: it misses less than 0.5 %.
    """

    height: float = MODELLED_LENGTHS * UNKNOWN_INDENTER_LENGTH_MM

    class Table(members.MemberTable):
        """{ shape = "half_space" }"""

        shape: Literal["half_space"] = "half_space"
        """A half-space."""

        def build(self) -> HalfSpace:
            """The specimen of these settings."""
            return HalfSpace()

    name: ClassVar[str] = "half_space"
    Knobs: ClassVar[type | None] = None
    alike: ClassVar[bool] = True
    options: ClassVar[tuple[members.SettingsOption, ...]] = (
        members.SettingsOption(
            "half-space",
            (),
            (),
            "a body without end below and beside the indenter",
            settings=lambda: {"specimen": {"shape": "half_space"}},
        ),
    )
    cut: ClassVar[float] = 0.8
    smallest_words: ClassVar[str] = "depth of the model"

    @property
    def half_width(self) -> float:  # type: ignore[override]
        """As far as it is deep (mm)."""
        return self.height

    def under(self, indenter: Any) -> HalfSpace:
        """Deep enough for an indenter."""
        return replace(self, height=MODELLED_LENGTHS * indenter.length)

    def beyond(self, length: float) -> float:
        """What it would give way by, see above: 16/(6π · 400), as the force grows with the travel to 3/2 at most."""
        return 1.5 * 16.0 / (6.0 * math.pi * MODELLED_LENGTHS)

    def part(self, name: str, X: np.ndarray) -> np.ndarray:
        """As of all flat specimens, with the base where the model ends below."""
        base, top = (
            X[:, 2] <= X[:, 2].min() + ON_PLANE_TOLERANCE * self.height,
            X[:, 2] >= self.height * (1.0 - ON_PLANE_TOLERANCE),
        )
        return {"upper": top, "lower": base, "base": base, "side": ~(base | top)}[name]

    def grid_planes(self) -> tuple[list[float], list[float], list[float]]:
        """Those of a box as deep as it reaches to each side; its base lies above that of the meridian."""
        far = MODELLED_LENGTHS_IN_SPACE / MODELLED_LENGTHS * self.height
        return [0.0, far], [0.0, far], [self.height - far, self.height]

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"shape": self.name}

    def actual(self, knobs: Any) -> HalfSpace:
        """It has no sizes."""
        return self

    @property
    def described(self) -> str:
        """It has no sizes."""
        return "a half-space"

    def dimensions(self) -> Mapping[str, float]:
        """Its layer."""
        return self.uppermost()

    def factors(self) -> Mapping[str, float]:
        """It has no sizes."""
        return {}

    @property
    def ratio(self) -> float:
        """That of the indenter it was made for."""
        return self.height / (MODELLED_LENGTHS * UNKNOWN_INDENTER_LENGTH_MM)

    def thickness_along(self, direction: np.ndarray) -> float:
        """No end."""
        return math.inf
