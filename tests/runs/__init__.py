"""Tests of a run as a file and in memory."""
