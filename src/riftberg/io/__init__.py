"""io of Riftberg."""
