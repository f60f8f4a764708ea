"""How many files this process may have open."""

from __future__ import annotations

from contextlib import suppress

import structlog

from oracle_server.core.errors import OracleError

log = structlog.get_logger()

_FEWEST = 20
"""With fewer ones a server has not even its event loop, its listener and its history."""


class FilesError(OracleError):
    """So few files may be open that no server runs."""


def connections(wanted: int, others: int) -> int:
    """How many connections there may be beside other files: fewer than wanted, with a warning, where files are few.

    Raises `FilesError` where they are too few for a server.
    """
    files = allow(wanted + others)
    if files < _FEWEST:
        raise FilesError(f"no more than {files} files may be open at once: allow more (`ulimit -n`, `LimitNOFILE=`)")
    allowed = max(1, files - others)
    if allowed < wanted:
        log.warning("fewer connections are accepted than wanted: too few files may be opened", accepted=allowed)
    return allowed


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
