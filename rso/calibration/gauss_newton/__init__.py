"""`[search] method = "gauss_newton"`: parameters identified straight on simulations, with their derivatives."""
