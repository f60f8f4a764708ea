"""The open sessions."""
