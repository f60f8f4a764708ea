"""Everything that decides, and nothing that does I/O: time comes in as an argument, results go out as values."""
