"""What a run means: fragments, tracks, scores against observations, reasons of break-ups, speed."""
