"""The command line, `oracle-server`."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line; also while its modules are read Ctrl-C ends it with 130, and a failure with 2."""
    try:
        from oracle_server.cli.commands import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:  # of a package of somebody's, which is read in the place of one that is needed
        if sys.flags.dev_mode:
            raise
        from oracle_server.cli.unforeseen import unforeseen

        print(f"oracle-server: {unforeseen(error)}", file=sys.stderr)  # noqa: T201
        sys.exit(2)
    run()
