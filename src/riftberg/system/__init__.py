"""The process and its files: signals, locks, files written whole, input files."""
