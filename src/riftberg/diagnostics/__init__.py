"""Diagnostics of a run: summary, scores against observations, reasons of break-ups, speed."""
