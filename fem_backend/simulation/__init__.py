"""One indentation test from its settings, knobs and programme to its curves."""
