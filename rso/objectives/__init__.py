"""Studies without measurements: a design, response surfaces, sensitivities, the Pareto front, and its proof by runs."""
