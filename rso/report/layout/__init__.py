"""What every report shares: a document of sections, its two printed forms, numbers as text, one style of figures."""
