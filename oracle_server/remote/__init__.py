"""Oracles elsewhere."""
