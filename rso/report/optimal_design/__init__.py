"""The report of `rso next`."""
