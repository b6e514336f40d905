"""diagnostics of Riftberg."""
