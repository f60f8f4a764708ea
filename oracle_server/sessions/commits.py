"""Tells whoever waits that there is something new; costs nothing where nobody does."""

from __future__ import annotations

import asyncio


class News:
    """Something that happens again and again, until it is over."""

    def __init__(self) -> None:
        self.over = False
        self._waited: asyncio.Future[None] | None = None

    def tell(self) -> None:
        """It happened."""
        waited, self._waited = self._waited, None
        if waited is not None and not waited.done():
            waited.set_result(None)

    def end(self) -> None:
        """It will not happen any more."""
        self.over = True
        self.tell()

    def next(self) -> asyncio.Future[None]:
        """Done at the next time from now. Wait for it with `asyncio.wait`, which leaves it to the others."""
        waited = self._waited or asyncio.get_running_loop().create_future()
        if self.over:
            waited.set_result(None)
        else:
            self._waited = waited
        return waited
