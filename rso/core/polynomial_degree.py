"""The highest degree of a polynomial response surface, which study files are held to before any surface is loaded."""

HIGHEST = 4
