"""What the backend shows `rso` beside its answers: priors, alternatives, levels of models, costs."""
