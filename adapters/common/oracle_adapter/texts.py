"""Texts for people, which quote what robots and servers say."""

from __future__ import annotations


def one_line(text: str) -> str:
    """A text as one line of printable characters: no robot writes to an operator's terminal."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
