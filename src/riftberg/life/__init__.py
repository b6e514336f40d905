"""The life of a berg beside its motion: melt, rolling, pieces that break from its edges, death."""
