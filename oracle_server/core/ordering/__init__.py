"""Puts the events of all monitors into the order in which they were published."""
