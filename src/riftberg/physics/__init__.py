"""physics of Riftberg."""
