"""Tests of downloads and services."""
