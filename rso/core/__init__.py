"""What every room shares: units, similarity, curves, distributions, files that may come from a stranger."""
