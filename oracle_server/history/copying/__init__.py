"""Histories copied from one database to another."""
