"""cli of Riftberg."""
