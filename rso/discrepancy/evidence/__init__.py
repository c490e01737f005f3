"""How likely each hypothesis is: Gaussian mixtures, noise, attribution, verdict, and how far to trust it."""
