"""How many files this process may have open."""

from __future__ import annotations

from contextlib import suppress


def allow(files: int) -> int:
    """Let this process have so many files open at once; returns how many it may have, of these at most.

    Systems let a process have few of its own accord, as 1,024, and far more where it asks for them.
    """
    try:
        import resource
    except ImportError:  # where the system has no such limit
        return files
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != resource.RLIM_INFINITY and soft < files:
        with suppress(OSError, ValueError):
            resource.setrlimit(
                resource.RLIMIT_NOFILE, (files if hard == resource.RLIM_INFINITY else min(files, hard), hard)
            )
        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return files if soft == resource.RLIM_INFINITY else min(files, soft)
