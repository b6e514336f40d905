"""Files of runs: trajectories and restarts of Riftberg, and in `kid` the directories of the reference."""
