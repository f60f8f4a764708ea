"""Recordings as files of the data directory, while they are received and judged."""

from __future__ import annotations

import asyncio
import re
import secrets
import shutil
from collections.abc import AsyncIterator
from pathlib import Path

from oracle_server.core.errors import OracleError

RESERVE = 256 * 2**20
"""Bytes of the disk that recordings leave free: what robots do is kept there."""
_PIECE = 2**20
_UNFIT = re.compile(r"[^A-Za-z0-9_.-]")
_LONGEST = 100


class FullError(OracleError):
    """The disk has no room for a recording, or for what is judged of it."""


class TooLargeError(OracleError):
    """A recording that is larger than one may be."""


class Uploads:
    """A folder with a folder for each recording."""

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self._folder = folder

    def clear(self) -> None:
        """Begin without any: what a server left behind that was killed is deleted."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def check_room(self, more: int = 0) -> None:
        """Raise `FullError` where so many bytes would leave too little room on the disk."""
        place = next(path for path in (self._folder, *self._folder.parents) if path.exists())
        if shutil.disk_usage(place).free < RESERVE + more:
            raise FullError(f"the disk has too little room: {RESERVE >> 20} MiB of it are kept free for what robots do")

    def check_size(self, size: int) -> None:
        """Raise `TooLargeError` where a recording has more bytes than it may have."""
        if size > self.most_bytes:
            most = f"{self.most_bytes / 2**20:g} MiB (ORACLE_MAX_RECORDING)"
            raise TooLargeError(f"a recording may have {most}: judge this one by `oracle-server replay`")

    async def receive(self, name: str, body: AsyncIterator[bytes]) -> Path:
        """Write a recording as it comes; returns where. Raises `FullError` and `TooLargeError`, and leaves nothing."""
        folder = self._folder / secrets.token_hex(8)
        path = folder / (_UNFIT.sub("_", name)[-_LONGEST:].lstrip(".") or "recording")
        try:
            await asyncio.to_thread(folder.mkdir, parents=True)
            size, held = 0, bytearray()
            async for piece in body:
                size += len(piece)
                held += piece
                self.check_size(size)
                if len(held) >= _PIECE:
                    self.check_room()
                    await asyncio.to_thread(_append, path, bytes(held))
                    held.clear()
            await asyncio.to_thread(_append, path, bytes(held))
        except OSError as error:
            await self.remove(path)
            raise FullError(f"the recording can't be written: {error.strerror}") from None
        except BaseException:
            await self.remove(path)
            raise
        return path

    async def remove(self, path: Path) -> None:
        """Delete a recording, and what was unpacked beside it."""
        await asyncio.to_thread(shutil.rmtree, path.parent, ignore_errors=True)


def _append(path: Path, data: bytes) -> None:
    with path.open("ab") as file:
        file.write(data)
