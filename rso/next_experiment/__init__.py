"""`rso next`: what experiments that nobody has done yet would tell about the parameters."""
