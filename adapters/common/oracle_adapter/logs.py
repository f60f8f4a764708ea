"""The package's log. A handler of it that fails stops nothing but the line it was given."""

from __future__ import annotations

import logging
from contextlib import suppress

_log = logging.getLogger("oracle_adapter")


def warn(text: str, *arguments: object) -> None:
    """Log a warning; `arguments` are for the `%s` in the text."""
    with suppress(Exception):
        _log.warning(text, *arguments)


def failure(text: str, *arguments: object) -> None:
    """Log the exception that is being handled, with where it came from."""
    with suppress(Exception):
        _log.exception(text, *arguments)
