"""The command line: one file per command, which turns options into calls and errors into sentences."""
