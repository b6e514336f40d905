"""stepping of Riftberg."""
