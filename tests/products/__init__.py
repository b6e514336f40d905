"""Tests of the readers of data products and of the doctor."""
