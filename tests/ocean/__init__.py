"""Tests of the grid, of the interpolation and of everything that serves forcing."""
