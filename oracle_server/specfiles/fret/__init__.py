"""Reads what FRET exports, and Ogma's variable file, and writes a spec of requirements."""
