"""How much a process that works beside the server may take."""

from __future__ import annotations

import resource


def bound(limit: int, most: int) -> None:
    """Have this process take at most so much of what a `resource.RLIMIT_…` counts; less where it may not have as much.

    Who started it may have bounded it already, as `ulimit -v` does, and a bound can't be raised again.
    """
    _, hard = resource.getrlimit(limit)
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(limit, (allowed, allowed))


def memory(most: int) -> str:
    """How much memory this process may take, in words; `most` bytes where less is not said."""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    allowed = most if soft == resource.RLIM_INFINITY else min(most, soft)
    return f"{allowed / 2**30:.3g} GiB of memory"
