"""The lower half of the specimen's surface is held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from fem_backend import members
from fem_backend.supports.holding import Holding
from fem_backend.supports.support import SUPPORTS


@SUPPORTS.register
@dataclass(frozen=True)
class Fixed(Holding):
    """u = 0 on the specimen's part `lower`."""

    class Table(members.MemberTable):
        """{ kind = "fixed" }"""

        kind: Literal["fixed"] = "fixed"
        """The lower half of the surface is held."""

        def build(self) -> Fixed:
            """The support of these settings."""
            return Fixed()

    name: ClassVar[str] = "fixed"
    variant: ClassVar[str] = "held"
    words: ClassVar[str] = "held"

    @property
    def described(self) -> str:
        """Which part of the surface it holds."""
        return "its lower half held"

    def described_on(self, specimen: Any) -> str:
        """Which part of the surface of this specimen it holds: a flat one has no lower half of it."""
        own = str(getattr(specimen, "held_words", ""))
        return own or ("its base held" if "base" in specimen.parts else self.described)

    def refusal(self, specimen: Any) -> str | None:
        """Every specimen has a lower part."""
        return None

    def offered(self, specimen: Any) -> bool:
        """Of a specimen with a base that is held alone: that is another support."""
        return "base" not in specimen.parts

    def held(self, specimen: Any, X: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """All components (n, 3) of the nodes of the part `lower`."""
        held = np.zeros(X.shape, bool)
        held[surface[specimen.part("lower", X[surface])]] = True
        return held

    def holding(self) -> Fixed:
        """It only holds."""
        return self
