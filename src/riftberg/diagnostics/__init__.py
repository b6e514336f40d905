"""What a run means: summary, scores against observations, reasons of break-ups, speed."""
