"""ocean of Riftberg."""
