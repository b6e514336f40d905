"""Explicit schemes: multiple time stepping (outer and inner kicks), springs and beams, Verlet, Runge-Kutta."""
