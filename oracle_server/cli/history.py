"""The command `history`: what is done with histories that no server uses."""

from __future__ import annotations

import sys
from typing import Annotated

import typer


def copy(
    source: Annotated[str, typer.Argument(metavar="FROM", help="A data directory, its file, or postgresql://…")],
    target: Annotated[str, typer.Argument(metavar="TO", help="The same; nothing may be there yet.")],
) -> None:
    """Copy a history, as from SQLite to PostgreSQL; where it was ended, the same command goes on."""
    import structlog

    from oracle_server.history.copying.run import copy_history

    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))
    copy_history(source, target)
