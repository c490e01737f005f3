"""Specimens, one file each; `SPECIMENS` has them by name."""

import sys

from fem_backend.specimens.specimen import SPECIMENS, OfOnePlace, Specimen

SPECIMENS.discover(sys.modules[__name__])

__all__ = ["SPECIMENS", "OfOnePlace", "Specimen"]
