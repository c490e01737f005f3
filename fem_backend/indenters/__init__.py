"""Rigid indenters, one file each; `INDENTERS` has them by name."""

import sys

from fem_backend.indenters.indenter import INDENTERS, Contact, Indenter

INDENTERS.discover(sys.modules[__name__])

__all__ = ["INDENTERS", "Contact", "Indenter"]
