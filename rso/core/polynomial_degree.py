"""The highest degree of a polynomial response surface, which study files are held to before any surface is loaded."""

MAX_POLYNOMIAL_DEGREE = 4  # a complete quartic of four parameters has 70 terms, and wants as many runs
