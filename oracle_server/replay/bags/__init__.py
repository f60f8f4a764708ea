"""The messages of a bag as events of a spec."""
