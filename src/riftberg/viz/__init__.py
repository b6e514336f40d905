"""viz of Riftberg."""
