"""The command line, `oracle-server`."""

from oracle_server.cli.commands import main

__all__ = ["main"]
