"""`rso next`: what experiments that nobody has done yet would show about the parameters."""
