"""What no smooth model explains: jumps, steps that stay, periodic disturbances, sensors, autocorrelated readings."""
