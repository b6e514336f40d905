"""Bergs at the start: lattices of elements from outlines, masks, tables or rectangles, their bonds and rifts."""
