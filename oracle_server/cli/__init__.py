"""The command line."""

from oracle_server.cli.commands import main

__all__ = ["main"]
