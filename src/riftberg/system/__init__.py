"""What belongs to the process and its files: signals, locks, files written whole, input files."""
