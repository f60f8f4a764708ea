"""Reads state diagrams of mermaid and DOT, and writes a spec with their machine."""
