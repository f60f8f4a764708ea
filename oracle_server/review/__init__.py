"""Judging a session again from its history: to restore it, to explain a verdict, and to export its trace."""
