"""The command line, `oracle-server`."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line; Ctrl-C ends it with 130, also while its modules are still read."""
    try:
        from oracle_server.cli.commands import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    run()
