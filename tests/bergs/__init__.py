"""Tests of how bergs come to be: outlines, masks, lattices, bonds."""
