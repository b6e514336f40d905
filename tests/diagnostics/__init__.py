"""Tests of what a run means: budgets, explanations, scores."""
