"""What is kept of sessions."""
