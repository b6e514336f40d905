"""Exchange with an ocean model: one call for each of its steps, fields in and fields out."""
