"""bergs of Riftberg."""
