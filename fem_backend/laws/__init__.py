"""Strain energies, one law per file, and what may be added to them; stresses in MPa, stretches without unit.

`LAWS` has the laws by name; `ADDITIONS` relax, soften or stiffen any of them.
"""

import sys

from fem_backend.laws.admissible import admissible
from fem_backend.laws.fibre import Fibre
from fem_backend.laws.law import LAWS, Derivatives, Elastic, Law
from fem_backend.laws.material import Material
from fem_backend.laws.mullins import Mullins
from fem_backend.laws.prony import Prony

LAWS.discover(sys.modules[__name__], ("neo_hooke", "linear_elastic", "mooney_rivlin", "yeoh", "ogden"))
ADDITIONS = (Prony, Mullins, Fibre)

from fem_backend.laws.linear_elastic import LinearElastic  # noqa: E402 - after their registration in order
from fem_backend.laws.mooney_rivlin import MooneyRivlin  # noqa: E402
from fem_backend.laws.neo_hooke import NeoHooke  # noqa: E402
from fem_backend.laws.ogden import Ogden  # noqa: E402
from fem_backend.laws.yeoh import Yeoh  # noqa: E402

__all__ = [
    "ADDITIONS",
    "LAWS",
    "Derivatives",
    "Elastic",
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
