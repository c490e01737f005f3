"""The study file: study.toml read, checked and given units, and nothing else.

It has no face: what is asked of it stands in its modules, and `rso status` needs the text alone.
"""
