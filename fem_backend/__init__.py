"""fem_backend: finite element indentation of soft bodies, usable on its own."""

import rso  # noqa: F401  before numpy and numba: threads, and a place for compiled code
