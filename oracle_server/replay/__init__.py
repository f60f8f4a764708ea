"""Recordings, and judging them."""
