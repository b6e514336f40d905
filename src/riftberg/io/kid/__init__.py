"""kid of Riftberg."""
