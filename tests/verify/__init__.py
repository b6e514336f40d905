"""Tests of scores, of the benchmark on tracks and of forecasts against observations."""
