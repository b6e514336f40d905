"""Pictures of runs: maps, plots, films and the replay page, drawn from run files alone."""
