"""Directories of KID and iKID, unchanged: namelists, hourly files, restarts and trajectories, read and written."""
