"""rso is imported before anything imports numpy: it pins the threads of the linear algebra underneath."""

import rso  # noqa: F401
