"""Fracture in equilibrium: criteria, strengths, growth of damage."""
