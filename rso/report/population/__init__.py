"""The page of many specimens."""
