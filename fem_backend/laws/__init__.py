"""Strain energies and what may be added to them, one law per file.  Stresses in MPa, stretches without unit."""

from fem_backend.laws.admissible import admissible
from fem_backend.laws.fibre import Fibre
from fem_backend.laws.law import Derivatives, Law
from fem_backend.laws.linear_elastic import LinearElastic
from fem_backend.laws.material import Material
from fem_backend.laws.mooney_rivlin import MooneyRivlin
from fem_backend.laws.mullins import Mullins
from fem_backend.laws.neo_hooke import NeoHooke
from fem_backend.laws.ogden import Ogden
from fem_backend.laws.prony import Prony
from fem_backend.laws.yeoh import Yeoh

__all__ = [
    "Derivatives",
    "Fibre",
    "Law",
    "LinearElastic",
    "Material",
    "MooneyRivlin",
    "Mullins",
    "NeoHooke",
    "Ogden",
    "Prony",
    "Yeoh",
    "admissible",
]
