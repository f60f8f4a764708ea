"""Judges events in one order: signals to engines, outcomes to verdicts and decisions."""
