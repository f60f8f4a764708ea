"""The sessions of a data directory in the process of an adapter, without a server."""
