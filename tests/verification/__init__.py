"""The whole model against theory."""
