"""What a history answers that one server has for itself, where others are asked for."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from oracle_server.history.records import Elsewhere, OtherSession, SessionRecord


class Alone:
    """A history of which no other server knows: part of a `History`."""

    @property
    def others(self) -> bool:
        """Whether other servers use it: none does."""
        return False

    @property
    def adrift(self) -> bool:
        """Whether another server may have its sessions by now: none has."""
        return False

    @property
    def fenced(self) -> str | None:
        """Why nothing more can be kept, ever: there is nothing."""
        return None

    @property
    def read_only(self) -> str | None:
        """Why nothing is kept: all is."""
        return None

    async def reserve(self, name: str, number: int) -> int | None:  # noqa: ARG002 -- of a `History`
        """The number of a new session."""
        return number

    async def elsewhere(self, name: str) -> Elsewhere | None:  # noqa: ARG002
        """Who has a session that is open: nobody else."""
        return None

    async def open_elsewhere(self, name: str | None = None, origin: str | None = None) -> list[OtherSession]:  # noqa: ARG002
        """The sessions that other servers have open: none."""
        return []

    async def missing(self, session: SessionRecord) -> Sequence[tuple[int, int]]:  # noqa: ARG002
        """The steps that a robot had deleted before it brought them: none forwards to it."""
        return ()

    async def left(self) -> list[str]:
        """The open sessions that robots have deleted: none forwards to it."""
        return []

    async def take_over(self, known: Collection[int]) -> list[SessionRecord]:  # noqa: ARG002
        """The sessions that this server has got: none."""
        return []

    async def tended(self) -> frozenset[int] | None:
        """The sessions of which it may delete: all."""
        return None
