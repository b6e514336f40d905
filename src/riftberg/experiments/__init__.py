"""experiments of Riftberg."""
