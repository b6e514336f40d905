"""Directories of KID and iKID as they stand: namelists, hourly files, restarts and trajectories, read and written."""
