"""Tests of the life of bergs."""
