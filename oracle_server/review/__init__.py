"""Judging again what the history has."""
