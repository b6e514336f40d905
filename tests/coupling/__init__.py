"""Tests of reading and writing KID's files."""
