"""Forces on elements: media, sizes, the pair law, velocities solved implicitly."""
