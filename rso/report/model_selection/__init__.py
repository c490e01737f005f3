"""Sections and figures of the report of `rso ladder`."""
