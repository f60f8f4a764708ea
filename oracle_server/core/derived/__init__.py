"""Signals that are derived from others, and from when they were there: `derive` of a spec."""
