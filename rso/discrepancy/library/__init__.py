"""The library of a test plan: which simulations it needs, what they answered, and what they say in between."""
