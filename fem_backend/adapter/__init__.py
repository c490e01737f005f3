"""What the backend tells `rso` beside its answers: priors, alternatives, levels of models, costs."""
