"""An elastic law with what may be added to it."""

from __future__ import annotations

from dataclasses import dataclass

from fem_backend.laws.fibre import Fibre
from fem_backend.laws.law import Law
from fem_backend.laws.mullins import Mullins
from fem_backend.laws.prony import Prony


@dataclass(frozen=True)
class Material:
    """S = S_vol + Prony(η S_iso), S_iso of the law and the fibre together; absent parts are None.

    The softening acts on the elastic stress, and what is left relaxes.  Raises ValueError for any of them with a
    small-strain law, which has neither Ī₄ nor isochoric stresses with a history.
    """

    law: Law
    fibre: Fibre | None = None
    prony: Prony | None = None
    mullins: Mullins | None = None

    def __post_init__(self) -> None:
        if self.law.small_strain and (self.fibre or self.path_dependent):
            raise ValueError("a small-strain law knows no fibres, relaxation or softening")

    @property
    def shear_modulus(self) -> float:
        """Initial (instantaneous) shear modulus of the isotropic part (MPa)."""
        return self.law.shear_modulus

    @property
    def bulk_modulus(self) -> float:
        """Initial bulk modulus (MPa)."""
        return self.law.bulk_modulus

    @property
    def small_strain(self) -> bool:
        return self.law.small_strain

    @property
    def path_dependent(self) -> bool:
        """Whether the stress depends on more than the strain now."""
        return self.prony is not None or self.mullins is not None
