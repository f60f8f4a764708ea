"""A robot's history in a file, forwarded to the centre's in PostgreSQL."""
