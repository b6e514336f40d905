"""Tests of `riftberg.engines`."""
