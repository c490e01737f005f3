"""The base of the specimen is bonded to something rigid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from fem_backend import members
from fem_backend.supports.holding import Holding
from fem_backend.supports.support import SUPPORTS


@SUPPORTS.register
@dataclass(frozen=True)
class Bonded(Holding):
    """u = 0 on the specimen's part `base`."""

    class Table(members.MemberTable):
        """{ kind = "bonded" }"""

        kind: Literal["bonded"] = "bonded"
        """The base is bonded to something rigid."""

        def build(self) -> Bonded:
            """The support of these settings."""
            return Bonded()

    name: ClassVar[str] = "bonded"
    variant: ClassVar[str] = "bonded"
    words: ClassVar[str] = "bonded to a stiff base"

    @property
    def described(self) -> str:
        """Which part of the surface it holds."""
        return "bonded to a rigid base"

    def refusal(self, specimen: Any) -> str | None:
        """Only a specimen with a base."""
        if "base" in specimen.parts:
            return None
        return f'support.kind = "bonded": a {specimen.name} has no flat base; take "fixed"'

    def held(self, specimen: Any, X: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """All components (n, 3) of the nodes of the part `base`."""
        held = np.zeros(X.shape, bool)
        held[surface[specimen.part("base", X[surface])]] = True
        return held

    def holding(self) -> Bonded:
        """It only holds."""
        return self
