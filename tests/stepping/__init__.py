"""Tests of `riftberg.stepping`."""
