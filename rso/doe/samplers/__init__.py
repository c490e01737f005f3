"""Kinds of designs, one file each; a file with a `SAMPLER` is a kind."""
