"""Fragments as rigid bodies: pose and dynamics."""
