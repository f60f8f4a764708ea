"""The open sessions: their monitors, what is written to the history, and their state."""
