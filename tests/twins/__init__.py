"""Slow plain twins of the laws and of the time stepping, written from the equations and from nothing else.

Every twin is meant to be read beside the section of the equations that it names: vectors are small NumPy arrays,
projections are matrices, constants are typed in again. Nothing here is imported from the package under test.
"""
