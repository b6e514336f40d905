"""How good forecasts are: scores of ensembles, the benchmark of drift on tracks, forecasts against observations."""
