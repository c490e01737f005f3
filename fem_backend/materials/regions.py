"""Bodies of several materials: each cell has one of them, and all share what may be added to a law."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from fem_backend.laws import Law, Material, Mullins, Prony


@dataclass(frozen=True, eq=False)
class Regions:
    """Materials and which of them each cell has, `of` (m,); the first is that of the rest, which penalties go with.

    They differ in their laws alone (and in moduli that go with those): fibres, relaxation and softening are in all or
    in none.
    """

    materials: tuple[Material, ...]
    of: np.ndarray

    @property
    def main(self) -> Material:
        """The material of the rest."""
        return self.materials[0]

    @property
    def law(self) -> Law:
        """The law of the rest."""
        return self.main.law

    @property
    def shear_modulus(self) -> float:
        """That of the rest (MPa)."""
        return self.main.shear_modulus

    @property
    def bulk_modulus(self) -> float:
        """That of the rest (MPa)."""
        return self.main.bulk_modulus

    @property
    def small_strain(self) -> bool:
        """None of them is."""
        return False

    @property
    def prony(self) -> Prony | None:
        """That of all."""
        return self.main.prony

    @property
    def mullins(self) -> Mullins | None:
        """That of the rest."""
        return self.main.mullins

    @property
    def path_dependent(self) -> bool:
        """All of them are, or none."""
        return self.main.path_dependent

    def without(self, *names: str) -> Regions:
        """The same with some of `fibre`, `prony`, `mullins` taken away."""
        return replace(self, materials=tuple(_without(m, names) for m in self.materials))


Substance = Material | Regions


def without(material: Substance, *names: str) -> Substance:
    """A material with some of `fibre`, `prony`, `mullins` taken away."""
    if isinstance(material, Regions):
        return material.without(*names)
    return _without(material, names)


def _without(material: Material, names: Collection[str]) -> Material:
    left = {n: None if n in names else getattr(material, n) for n in ("fibre", "prony", "mullins")}
    return Material(material.law, **left)


def region_materials(material: Substance) -> list[tuple[Material, np.ndarray | slice]]:
    """The materials of a body and the cells of each, where it has any."""
    if not isinstance(material, Regions):
        return [(material, slice(None))]
    found = [(m, np.flatnonzero(material.of == k)) for k, m in enumerate(material.materials)]
    return [(m, cells) for m, cells in found if len(cells)]
