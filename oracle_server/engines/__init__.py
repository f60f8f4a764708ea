"""One file an engine, the only importers of what they wrap."""
