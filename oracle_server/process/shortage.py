"""What is said where the system gives a process no more memory, or no more threads."""

from __future__ import annotations

_NO_THREAD = "can't start new thread"
"""What Python says where the system gives it none."""


def shortage(error: Exception) -> str | None:
    """What there is too little of, in a sentence, where that is what an error tells; else None."""
    if isinstance(error, MemoryError):
        what, verb = "memory", "is"
    elif isinstance(error, RuntimeError) and str(error) == _NO_THREAD:
        what, verb = "threads", "are"
    else:
        return None
    return f"more {what} {verb} needed than there {verb}, or than this user or container may have"
