"""Tests of `riftberg.physics`."""
