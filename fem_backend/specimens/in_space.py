"""What specimens share that are of one piece and modelled in space only."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Self

import numpy as np

from fem_backend.meshing import BadMesh, MeridianMesh, Size
from fem_backend.specimens import own_laws
from fem_backend.specimens.specimen import LAYER_KNOBS

# semi-axes, or half extents, over the semi-axes of the cavity where nobody says otherwise
HALF_SIZE_TO_CAVITY = (4.0, 3.5, 3.5)
# largest semi-axis, or half length, over the radius of the ball: finer meshes are not made, and of a body three times
# as large fTetWild makes no sound one
MAX_SIZE_TO_INDENTER = 70
PROPOSED_PLACE_SHARE = 0.35  # of a semi-axis, or of half an extent: where further tests are proposed


class InSpace:
    """No meridian, no layers, no flat base, nothing beyond the model; a base class, no member."""

    name: ClassVar[str]
    parts: ClassVar[tuple[str, ...]] = ("upper", "lower")
    of_revolution: ClassVar[bool] = False
    alike: ClassVar[bool] = False
    laws: ClassVar[tuple[own_laws.OwnLaw | None, ...]] = ()
    ratios: ClassVar[tuple[float, ...]] = ()

    @property
    def fattest(self) -> float:
        """Its meshes take any indenter."""
        return math.inf

    def under(self, indenter: Any) -> Self:
        """As it is."""
        return self

    def beyond(self, length: float) -> float:
        """Nothing: all of it is modelled."""
        return 0.0

    def absent(self) -> frozenset[str]:
        """It has no layers."""
        return frozenset(LAYER_KNOBS) | own_laws.everything()

    def meridian(self, actual: Any, spacing: Size, fineness: float) -> MeridianMesh:
        """None is made."""
        raise BadMesh(f"a specimen of shape {self.name!r} has no mesh of a meridian")

    def stiffness(self, X: np.ndarray) -> np.ndarray | None:
        """It has no layers."""
        return None

    def layer(self, X: np.ndarray) -> np.ndarray:
        """All is the rest."""
        return np.zeros(X.shape[:-1], int)
