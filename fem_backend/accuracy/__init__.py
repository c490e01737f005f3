"""How far a result may be off, and how to get it cheaper or finer: errors, two grids, warm starts, closed forms."""
