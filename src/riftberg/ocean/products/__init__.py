"""products of Riftberg."""
