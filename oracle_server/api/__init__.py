"""The HTTP API: its routes, one module for each resource."""
