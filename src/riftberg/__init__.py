"""Riftberg: tabular icebergs as lattices of ice columns joined by breakable bonds."""

__version__ = "0.1.0"
