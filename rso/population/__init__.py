"""Many specimens in one study: each fitted for itself, and what they are together."""
