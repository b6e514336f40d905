"""A run as a file and in memory: run file, restart, provenance, tracks, and the scene that pictures are drawn from."""
