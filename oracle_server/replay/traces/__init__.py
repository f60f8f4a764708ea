"""Traces in JSON as events of a spec."""
