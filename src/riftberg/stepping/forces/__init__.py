"""Forces on elements: media, sizes, contact of pairs, velocities solved implicitly."""
