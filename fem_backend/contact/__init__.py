"""Contact of the deformable surface with rigid bodies."""
