"""The page of a study with objectives."""
