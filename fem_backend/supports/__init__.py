"""Supports of the specimen, one file each; `SUPPORTS` has them by name."""

import sys

from fem_backend.supports.support import SUPPORTS, Support

SUPPORTS.discover(sys.modules[__name__], ("fixed", "bowl", "bonded"))

__all__ = ["SUPPORTS", "Support"]
