"""Proof that Riftberg reproduces the reference: whole cases, compared with its output."""
