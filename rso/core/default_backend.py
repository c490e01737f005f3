"""The backend that comes with `rso`, as data: the one place that names it."""

PACKAGE = "fem_backend"
USE = f"{PACKAGE}.backend:BACKEND"  # what a new study says under [backend]
COMMAND_LINE = f"{PACKAGE}.adapter.command_line"  # what the command line asks of it, without what computes
