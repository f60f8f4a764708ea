"""Reads properties in HPL, the language of HAROS, and writes a spec of patterns."""
